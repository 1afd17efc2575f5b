//! What an alarm says.

use crate::apply::change::PlatformRms;
use crate::model::Spec;

/// A change of the device since its calibration.
///
/// Written as JSON its fields are those of `rsicalib.alarm/1`, in the same order.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Alarm {
    /// Time of the first row of the change (s), or its number where rows have no time.
    pub since: f64,
    /// Number of that row, from 0, all rows counted, as far as the grid of onsets tells.
    pub since_row: u64,
    /// Number of the row that raised it.
    pub row: u64,
    /// Time of that row (s).
    #[cfg_attr(feature = "serde", serde(rename = "time_s"))]
    pub time: Option<f64>,
    /// The term and what it acts on: `offset@a22`, `link_frame@arm2/2`, `distance@wrist1-wrist2`,
    /// `gain@a22`, `reference@all`; `noise@a22`, `stuck@a22`, `loose@arm2`; `unnamed@arm2`.
    #[cfg_attr(feature = "serde", serde(flatten, serialize_with = "named::serialize"))]
    pub spec: Spec,
    /// How large: the value of a single parameter, or the length of a displacement; of a drift, by
    /// how much it has moved until this row.
    pub size: f64,
    /// Standard deviation of the size.
    pub sd: f64,
    /// Unit of the size.
    pub unit: String,
    /// What goes on: the rate at which the size grows, per hour where rows have a time, else per row.
    /// None for a change that stands still.
    pub rate: Option<Change>,
    /// All parameters of the change.
    pub parameters: Vec<Change>,
    /// What the change does to the platform over poses seen; none without a platform.
    pub platform_rms: Option<PlatformRms>,
    /// Probability of such a deviation by chance, corrected for the number of tests of a sample.
    pub p_value: f64,
    /// Other changes that fit as well.
    #[cfg_attr(feature = "serde", serde(serialize_with = "named::all"))]
    pub also_fits: Vec<Spec>,
    /// Row of an earlier alarm that this one corrects: since then the readings have told what it
    /// was. None for a new change.
    pub revises: Option<u64>,
    /// What to do about it.
    pub action: Action,
    /// Why a change has no name; none of one that has.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub unnamed: Option<Unnamed>,
}

/// Term and target of what has changed, which has no other place.
#[cfg(feature = "serde")]
mod named {
    use serde::ser::{Serialize, SerializeStruct, Serializer};

    use crate::model::Spec;

    struct Named<'a>(&'a Spec);

    impl Serialize for Named<'_> {
        fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
            serialize(self.0, to)
        }
    }

    pub(super) fn serialize<S: Serializer>(spec: &Spec, to: S) -> Result<S::Ok, S::Error> {
        let mut out = to.serialize_struct("Spec", 2)?;
        out.serialize_field("term", &spec.term)?;
        out.serialize_field("target", &spec.target)?;
        out.end()
    }

    pub(super) fn all<S: Serializer>(specs: &[Spec], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(specs.iter().map(Named))
    }
}

/// What a change asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum Action {
    /// It moves the platform by less than the noise of one sample does: go on.
    GoOn,
    /// It is known, and larger: calibrate again.
    #[default]
    Recalibrate,
    /// What the readings say of the platform cannot be trusted, and no calibration mends that: stop.
    Stop,
}

/// Why a change has no name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum Unnamed {
    /// Alarms follow each other faster than false ones may: nothing is tested any more.
    ManyAlarms,
    /// Loops are farther open than any change explains: nothing is tested until they close again.
    FarOff,
}

/// One parameter of a change.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Change {
    /// Its name.
    pub name: String,
    /// By how much it has changed.
    pub value: f64,
    /// Standard deviation of that.
    pub sd: f64,
    /// Unit of both.
    pub unit: String,
}

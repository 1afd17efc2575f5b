//! Observations: a mechanism, its readings, and what is known of them.

use std::sync::Arc;

use crate::Error;
use crate::estimate::options::FitOptions;
use crate::mechanism::{Closure, Mechanism, Value};
use crate::model::{Instance, Model, assembly, check_names};
use crate::readings::{Readings, Table, as_of, codes};
use crate::terms::term::Role;
use crate::text::brief;

/// Readings of a mechanism with what is known of them: a rest pose, weights, options.
#[derive(Debug, Clone)]
pub struct Observations {
    /// The mechanism.
    pub mechanism: Mechanism,
    /// The readings, shared by the copies that differ in weights or options.
    #[doc(hidden)]
    pub readings: Arc<Readings>,
    /// A reading of the rest pose, averaged, one per channel.
    pub rest: Option<Vec<f64>>,
    /// Joint coordinates in the rest pose, one per channel: from the middle of their limits, then others that hold
    /// the platform there, nearer to what the reading says as declared; empty where none are known.
    pub rest_angles: Vec<Vec<f64>>,
    /// Weight of each sample; zero for a sample that is left out.
    pub weights: Vec<f64>,
    /// Readings about which offsets and gains are told apart, one per channel: the means, or as is expected;
    /// zero where no offset is fitted.
    pub centre: Vec<f64>,
    /// Step of the codes of each channel, in its unit; zero where it has none.
    pub steps: Vec<f64>,
    /// Poses, from 0, whose readings are those of an earlier pose over again: they count once.
    pub copies: Vec<usize>,
    /// Rows of held poses that are an earlier row of their pose over again: they count once, and tell no noise.
    #[doc(hidden)]
    pub doubled: Vec<usize>,
    /// The options.
    pub options: FitOptions,
    /// True where the noise is from an earlier fit of these readings, which has judged what
    /// was declared: nothing questions it again.
    #[doc(hidden)]
    pub judged: bool,
    /// True where nothing is presumed of the noise of readings beside play that is declared: only the fit tells it.
    #[doc(hidden)]
    pub by_fit: bool,
    /// The mechanism held at rest and its reading. `None` unless the rest pose was read and is
    /// declared with a standard deviation, which makes the rest pose an observation.
    #[doc(hidden)]
    pub held: Option<(Mechanism, Readings)>,
}

/// Source of an anchor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum AnchorKind {
    /// A reading of the rest pose.
    Rest,
    /// The rest pose at its nominal readings; without a rest pose, the mean reading.
    Nominal,
    /// The nominal offsets, at reading zero.
    NominalOffsets,
    /// The rest pose at the middle of every range.
    RestAtHalfRange,
}

/// A reading of each channel with a known or presumed joint coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchor {
    /// Source of the anchor.
    pub kind: AnchorKind,
    /// Reading and joint coordinate (rad, or length units), one pair per channel.
    pub at: Vec<(f64, f64)>,
    /// True for an anchor that was read, false for one that is presumed.
    pub known: bool,
}

/// Joint coordinates that are further apart than this are others: those of one solution agree to rounding.
const APART: f64 = 1e-3;

/// A recording of more rows is long.
pub const LONG: usize = 8192;

impl Observations {
    /// True for a long recording: it is searched by stretches, and what is known of single rows is
    /// not kept.
    #[must_use]
    pub fn is_long(&self) -> bool {
        self.is_recording() && self.readings.samples > LONG
    }

    /// True where no pose was held: every row is one.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        !self.readings.held && self.readings.merged.is_none()
    }

    /// The model of these readings with these terms, offsets about the mean reading.
    ///
    /// # Errors
    ///
    /// As [`Model::about`].
    pub fn model(&self, instances: Vec<Instance>) -> Result<Model, Error> {
        self.model_after(None, instances)
    }

    /// The same after an earlier model, whose redundant equations it leaves out.
    ///
    /// # Errors
    ///
    /// As [`Model::about`].
    pub(crate) fn model_after(
        &self,
        earlier: Option<&Model>,
        instances: Vec<Instance>,
    ) -> Result<Model, Error> {
        Model::about(earlier, &self.mechanism, &self.readings, instances, &self.centre)
    }

    /// True where the noise of all channels is declared.
    pub(crate) fn declares_noise(&self) -> bool {
        self.options.noise.is_some() || self.mechanism.channels.iter().all(|c| c.noise.is_some())
    }

    /// The model of a fit of these readings with candidates beside its terms.
    ///
    /// # Errors
    ///
    /// As [`Model::about`].
    pub(crate) fn model_beside(&self, model: &Model, more: &[Instance]) -> Result<Model, Error> {
        let instances = [&model.instances, more].concat();
        Model::with_candidates(model, &self.mechanism, &self.readings, instances, &self.centre)
    }

    /// Checks a mechanism and its readings, and computes the rest pose and the anchors.
    ///
    /// `rest` holds readings of the rest pose, row by row, one per channel.
    ///
    /// # Errors
    ///
    /// As [`FitOptions::check`], [`Readings::new`] and [`Mechanism::validate`]; [`Error::Option`] for noise of another
    /// number of channels, [`Error::Unknown`] for a closure in the options that does not exist, [`Error::Mechanism`]
    /// for an unknown term of the mechanism.
    pub fn new(
        mechanism: &Mechanism,
        table: Table,
        rest: Option<Vec<f64>>,
        options: FitOptions,
    ) -> Result<Self, Error> {
        options.check_for(mechanism.channels.len())?;
        let whole = mechanism;
        let mechanism = match &options.closures {
            Some(names) => whole.with_closures(names)?,
            None => whole.clone(),
        };
        let table = as_of(table, whole, &mechanism);
        mechanism.validate()?;
        check_names(&mechanism)?;
        let readings = Arc::new(Readings::new(&mechanism, table)?);
        let rest = match rest {
            Some(values) => {
                let bare =
                    Mechanism { points: Vec::new(), closures: Vec::new(), ..mechanism.clone() };
                Some(Readings::new(&bare, Table { values, ..Table::default() })?.mean)
            }
            None => None,
        };
        let rest_angles = match &mechanism.rest {
            Some(r) if !mechanism.platform.is_empty() => {
                rest_angles(&mechanism, &r.pose, rest.as_deref())
            }
            _ => Vec::new(),
        };
        let held = match (&mechanism.rest, &rest) {
            (Some(declared), Some(row)) if declared.sd.is_some() => {
                let held = assembly::held_at(&mechanism, &declared.pose, declared.sd);
                let table = Table { values: row.clone(), ..Table::default() };
                Some((held.clone(), Readings::new(&held, table)?))
            }
            _ => None,
        };
        let copies = readings.copies();
        let mut weights = vec![1.0; readings.samples];
        let copied = |row: &usize| copies.binary_search(&readings.pose[*row]).is_ok();
        let counters: Vec<bool> = mechanism.channels.iter().map(|c| c.counts()).collect();
        let doubled = readings.doubled(&counters);
        let again = (0..readings.samples).filter(copied).chain(doubled.iter().copied());
        again.for_each(|row| weights[row] = 0.0);
        let steps = codes::steps(&readings.table.values, &counters, readings.held);
        let centre = match &options.expected {
            Some(expected) if expected.centre.len() == mechanism.channels.len() => {
                expected.centre.clone()
            }
            Some(expected) => {
                let found = format!("{} readings to count offsets from", expected.centre.len());
                let channels = format!("{} channels", mechanism.channels.len());
                return Err(Error::option("population", found, channels));
            }
            None => readings.mean.clone(),
        };
        let mut it = Self {
            mechanism,
            readings,
            rest,
            rest_angles,
            weights,
            centre,
            steps,
            copies,
            doubled,
            options,
            judged: false,
            by_fit: false,
            held,
        };
        // What cannot be asked for is said where these are fitted.
        if let Ok(asked) = it.instances() {
            it.leave_offsets_as_drawn(&asked);
        }
        Ok(it)
    }

    /// Lets gains of channels whose offset is not among these turn about reading zero, where the offset stands
    /// that is drawn.
    pub(crate) fn leave_offsets_as_drawn(&mut self, fitted: &[Instance]) {
        let expected = self.options.expected.as_ref().map(|expected| &expected.centre);
        let middle = expected.unwrap_or(&self.readings.mean);
        self.centre = vec![0.0; middle.len()];
        let offsets = fitted.iter().filter(|i| i.term.role() == Role::Offset);
        let at = offsets.flat_map(|i| self.mechanism.channels_at(i.target));
        at.for_each(|channel| self.centre[channel] = middle[channel]);
    }

    /// Checks what may have been changed since these observations were made.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.options.check_for(self.mechanism.channels.len())?;
        Error::same("weights", self.weights.len(), self.readings.samples)?;
        let usable = |weight: &f64| weight.is_finite() && *weight >= 0.0;
        match self.weights.iter().find(|weight| !usable(weight)) {
            Some(weight) => Err(Error::option("weights", brief(*weight), "numbers not below 0")),
            None => Ok(()),
        }
    }

    /// Variance of the rounding of each channel.
    pub fn roundings(&self) -> impl Iterator<Item = f64> {
        self.steps.iter().map(|step| step * step / 12.0)
    }

    /// True where channel `c` reads in steps of its own: of a counter, of more than a count.
    #[must_use]
    pub fn coded(&self, c: usize) -> bool {
        let own = if self.mechanism.channels[c].counts() { 1.0 } else { 0.0 };
        self.steps[c] > own
    }

    /// Least noise of one reading of each channel: that of rounding, where a channel reads in
    /// steps and nobody said so.
    #[must_use]
    pub fn least_noise(&self) -> Vec<f64> {
        let own = |(c, variance): (usize, f64)| if self.coded(c) { variance.sqrt() } else { 0.0 };
        self.roundings().enumerate().map(own).collect()
    }

    /// Factor on the noise of each closure of a sample that every sample draws for itself: 1 where its
    /// length, or a point of it, is measured and differs within held poses; empty where none is.
    #[must_use]
    pub fn measured(&self) -> Vec<f64> {
        let (mechanism, readings) = (&self.mechanism, &self.readings);
        let columns = mechanism.value_columns();
        let closures = || mechanism.closures.iter().filter(|c| !mechanism.is_link(c));
        if !readings.held || columns.is_empty() {
            return Vec::new();
        }
        let differs = |column: &[f64]| {
            (1..readings.samples)
                .filter(|&r| !column[r].is_nan() && !column[r - 1].is_nan())
                .any(|r| readings.pose[r] == readings.pose[r - 1] && column[r] != column[r - 1])
        };
        let named = |name: &String| {
            let column = columns.iter().position(|column| column == name);
            column.is_some_and(|column| differs(&readings.table.columns[column]))
        };
        let of = |closure: &Closure| {
            let ends = mechanism.points.iter().filter(|p| closure.between.contains(&p.name));
            let seen = ends.filter_map(|p| p.columns.as_ref()).flatten();
            let length = match &closure.value {
                Some(Value::Column(name)) => Some(name),
                _ => None,
            };
            length.into_iter().chain(seen).any(named)
        };
        closures().map(|closure| f64::from(u8::from(of(closure)))).collect()
    }

    /// The instances of the terms in the options, or else of those in the mechanism.
    ///
    /// # Errors
    ///
    /// As [`crate::model::parse`].
    pub fn instances(&self) -> Result<Vec<Instance>, Error> {
        let terms = self.options.terms.as_ref().unwrap_or(&self.mechanism.model.terms);
        crate::model::parse(&self.mechanism, &self.readings, terms)
    }

    /// Anchors that may hold the offsets during the search of a start, the best first.
    ///
    /// A reading of the rest pose is the only anchor where there is one, with the joint angles of that pose from
    /// the middle of their limits, and with those from what the reading says as declared, where they are others. Otherwise the first anchor
    /// is the rest pose at its nominal readings. For nominal gains that are far off, the nominal
    /// offsets may be better, or the rest pose at the middle of the range.
    #[must_use]
    pub fn anchors(&self) -> Vec<Anchor> {
        let channels = &self.mechanism.channels;
        let all = |f: &dyn Fn(usize) -> (f64, f64)| (0..channels.len()).map(f).collect();
        let drawn = self.rest_angles.first();
        if let (Some(rest), Some(_)) = (&self.rest, drawn) {
            let anchor = |angles: &Vec<f64>| Anchor {
                kind: AnchorKind::Rest,
                at: all(&|c| (rest[c], angles[c])),
                known: true,
            };
            return self.rest_angles.iter().map(anchor).collect();
        }
        let nominal = |c: usize| match drawn {
            Some(angles) => ((angles[c] - channels[c].offset) / channels[c].gain, angles[c]),
            None => (self.readings.mean[c], channels[c].angle(self.readings.mean[c])),
        };
        let mut anchors = vec![
            Anchor { kind: AnchorKind::Nominal, at: all(&nominal), known: false },
            Anchor {
                kind: AnchorKind::NominalOffsets,
                at: all(&|c| (0.0, channels[c].offset)),
                known: false,
            },
        ];
        if let Some(angles) = drawn
            && channels.iter().all(|c| c.range.is_some())
        {
            let at = all(&|c| (channels[c].middle(), angles[c]));
            anchors.push(Anchor { kind: AnchorKind::RestAtHalfRange, at, known: false });
        }
        anchors
    }
}

/// Joint angles of the rest pose, from the middle of their limits; and those that are reached from what a reading of it
/// says as declared, where these are others: elbows may be up or down.
fn rest_angles(mechanism: &Mechanism, pose: &[f64; 6], rest: Option<&[f64]>) -> Vec<Vec<f64>> {
    let from_middle = assembly::inverse(mechanism, pose).ok();
    let as_read = |rest: &[f64]| {
        let start = mechanism.channels.iter().zip(rest).map(|(c, reading)| c.angle(*reading));
        assembly::inverse_from(mechanism, pose, start.collect()).ok()
    };
    let apart = |a: &[f64], b: &[f64]| {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) > APART
    };
    let mut found: Vec<Vec<f64>> = from_middle.into_iter().collect();
    let as_read = rest.and_then(as_read).filter(|own| found.iter().all(|other| apart(own, other)));
    found.extend(as_read);
    found
}

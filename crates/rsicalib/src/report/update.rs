//! A later session beside an earlier result: what has changed, and whether an update is worth it.

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::apply::earlier::{Applied, lasting};
use crate::diagnosis::options::LEVEL;
use crate::diagnosis::verdict::worth_an_update;
use crate::estimate::intervals::wider;
use crate::estimate::significance::NORMAL_95;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Mechanism;
use crate::monitor::by_parameters::compare_results;
use crate::monitor::compare::{Comparison, Found, Judged, compare};
use crate::monitor::tells_by_rows;
use crate::text::significant;

/// A later session against an earlier result.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Update {
    /// True where something has changed for sure, and this result has the smaller held-out error.
    pub worth: bool,
    /// The same as a sentence.
    pub text: String,
    /// χ² of the readings under the earlier result, its uncertainty counted in, per degree of
    /// freedom; of the parameters that both results have where other loops close in each session.
    pub chi2_per_dof: f64,
    /// Probability of more by chance.
    pub p_value: f64,
    /// Misclosure of the poses under the earlier result, root mean square in units of length.
    pub rms_before: f64,
    /// The same under this result, poses left out in turn; null where that was not computed.
    pub rms_after: Option<f64>,
    /// What has changed, the most certain first.
    pub changes: Vec<Changed>,
    /// Effects of the earlier result that belong to its session, and are not compared.
    pub session_only: Vec<String>,
    /// True where something is not as it was, and no change from one session to the other explains it, or where
    /// that is not told: there are no `changes` then.
    #[cfg_attr(feature = "serde", serde(default))]
    pub unclear: bool,
}

/// A change between two sessions of a device.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Changed {
    /// Id of the term.
    pub term: String,
    /// Where: a channel, a closure, a chain or a link of it.
    pub target: String,
    /// How large: the value of a single parameter, or the length of a displacement.
    pub size: f64,
    /// Standard deviation of the size.
    pub sd: f64,
    /// Unit of both.
    pub unit: String,
    /// Probability of such a change by chance, for any of the candidates.
    pub p_value: f64,
    /// What it does to the platform.
    pub platform_rms: Option<PlatformRms>,
    /// Changes that these readings cannot tell from it, as `offset@a22`.
    #[cfg_attr(feature = "serde", serde(default))]
    pub also_fits: Vec<String>,
}

impl Update {
    /// Of a later session and its fit, under an earlier result with the covariance of its
    /// parameters, row by row; `rms_after` as [`Self::of`] has it.
    ///
    /// # Errors
    ///
    /// As [`compare`] and [`Self::of`].
    pub fn since(
        earlier: &Applied,
        covariance: Option<&[f64]>,
        (observations, fit): (&Observations, &Fit),
        rms_after: Option<f64>,
    ) -> Result<Self, Error> {
        // What no change takes away is in the later fit, too: changes must stand out of it.
        let judged = Judged {
            noise: fit.assumed(),
            inflation: fit.noise.inflation * wider(fit),
            dof: fit.noise.dof_of_pose(),
        };
        let found = match tells_by_rows(&observations.mechanism, earlier) {
            true => compare(earlier, covariance, observations, &judged)?,
            false => compare_results(earlier, covariance, (observations, fit), &judged)?,
        };
        Self::of(&observations.mechanism, earlier, found, rms_after)
    }

    /// Of what has changed since `earlier`, where the loops close to `rms_after` under the new
    /// result, poses left out in turn.
    ///
    /// # Errors
    ///
    /// As [`lasting`].
    pub fn of(
        mechanism: &Mechanism,
        earlier: &Applied,
        found: Comparison,
        rms_after: Option<f64>,
    ) -> Result<Self, Error> {
        let sizes = found.changes.iter().flat_map(|one| &one.parameters).map(|p| (p.value, p.sd));
        let worth = worth_an_update(sizes, found.rms_misclosure, rms_after);
        let specs = || earlier.parameters.iter().map(|p| &p.spec);
        let lasting = lasting(mechanism, specs())?;
        let mut session_only: Vec<String> = Vec::new();
        for spec in specs().filter(|spec| !lasting.contains(spec)).map(ToString::to_string) {
            if !session_only.contains(&spec) {
                session_only.push(spec);
            }
        }
        let unclear = found.open || (found.changes.is_empty() && found.left <= LEVEL);
        let open = found.open;
        let changes: Vec<Changed> = found.changes.into_iter().map(Changed::from).collect();
        let mut update = Self {
            worth,
            text: String::new(),
            chi2_per_dof: found.chi2_per_dof,
            p_value: found.p_value,
            rms_before: found.rms_misclosure,
            rms_after,
            changes,
            session_only,
            unclear,
        };
        update.text = match open {
            true => "what has changed is not told: the loops of this session do not close under its own parameters \
                     either; trace it"
                .into(),
            false => update.sentence(&mechanism.length_unit),
        };
        Ok(update)
    }

    fn sentence(&self, unit: &str) -> String {
        if self.unclear {
            return "something is not as it was, and no change from one session to the other explains it: trace \
                    looks for what happened within this one"
                .into();
        }
        if self.changes.is_empty() {
            return "nothing has changed beyond both uncertainties: the earlier result holds"
                .into();
        }
        let changes: Vec<String> = self.changes.iter().map(Changed::sentence).collect();
        let changes = changes.join(", ");
        let Some(after) = self.rms_after else { return format!("changed: {changes}") };
        let (worth, why) = match (self.worth, after < self.rms_before) {
            (true, _) => ("an update is worth it", ""),
            (false, true) => ("an update is not worth it", ", but by how much is not certain"),
            (false, false) => ("an update is not worth it", ", no better"),
        };
        let [after, before] = [after, self.rms_before].map(|rms| significant(rms, 3));
        format!(
            "changed: {changes}; {worth}: held out, the loops close to {after} {unit} instead of {before}{why}"
        )
    }
}

impl Changed {
    fn sentence(&self) -> String {
        let Self { term, target, size, sd, unit, .. } = self;
        let (size, half) = (significant(*size, 3), significant(NORMAL_95 * sd, 2));
        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
        format!("{term} of {target} by {size} ± {half}{unit}")
    }
}

impl From<Found> for Changed {
    fn from(found: Found) -> Self {
        Self {
            term: found.term,
            target: found.target,
            size: found.size,
            sd: found.sd,
            unit: found.unit,
            p_value: found.p_value,
            platform_rms: found.platform_rms,
            also_fits: found.also_fits.iter().map(|[a, b]| format!("{a}@{b}")).collect(),
        }
    }
}

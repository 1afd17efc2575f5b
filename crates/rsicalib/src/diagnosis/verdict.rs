//! The verdict: one function for a calibration and for a trace.

use crate::diagnosis::options::RESIDUAL_LEVEL;
use crate::diagnosis::plausibility::Absurdity;
use crate::estimate::Fit;
use crate::estimate::directions::Directions;

/// What is said of a calibration, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Verdict {
    /// Nothing is missing: what is left is noise.
    Adequate,
    /// Something was missing and is found: what is left is noise.
    Explained,
    /// Something was missing and is found, and something is left or in doubt.
    PartlyExplained,
    /// Something is left that nothing explains.
    Unexplained,
    /// The data cannot determine what was asked.
    Undetermined,
    /// A calibration, and nothing to judge it by.
    Unjudged,
    /// A calibration that is absurd beside the size of the mechanism.
    Implausible,
}

impl Verdict {
    /// Every verdict.
    pub const ALL: [Self; 7] = [
        Self::Adequate,
        Self::Explained,
        Self::PartlyExplained,
        Self::Unexplained,
        Self::Undetermined,
        Self::Unjudged,
        Self::Implausible,
    ];

    /// What scripts call the verdict.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::Adequate => "adequate",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
            Self::Undetermined => "undetermined",
            Self::Unjudged => "unjudged",
            Self::Implausible => "implausible",
        }
    }

    /// What the command exits with: 0 usable, 3 undetermined, 4 a residual is left or absurd.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Self::Adequate | Self::Explained | Self::Unjudged => 0,
            Self::Undetermined => 3,
            Self::PartlyExplained | Self::Unexplained | Self::Implausible => 4,
        }
    }
}

/// What a verdict rests on.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// The final fit.
    pub fit: &'a Fit,
    /// Directions that the data cannot tell.
    pub directions: &'a Directions,
    /// What is absurd beside the size of the mechanism.
    pub absurd: &'a [Absurdity],
    /// Probability of the residual by chance; none where nothing judges it.
    pub p_value: Option<f64>,
    /// True where effects were found.
    pub found: bool,
    /// True where the effects found may stand for another, or do not hold elsewhere.
    pub doubtful: bool,
}

/// The verdict on a calibration or a trace.
///
/// Undetermined comes first, then implausible, then unjudged, then the rest.
#[must_use]
pub fn verdict(evidence: &Evidence) -> Verdict {
    let Evidence { fit, directions, absurd, p_value, found, doubtful } = *evidence;
    if !determined(fit, directions) {
        return Verdict::Undetermined;
    }
    if !absurd.is_empty() {
        return Verdict::Implausible;
    }
    let Some(p_value) = p_value else { return Verdict::Unjudged };
    match (found, p_value > RESIDUAL_LEVEL, doubtful) {
        (false, true, _) => Verdict::Adequate,
        (true, true, false) => Verdict::Explained,
        (true, ..) => Verdict::PartlyExplained,
        (false, false, _) => Verdict::Unexplained,
    }
}

/// What is off by more than before where a fit has seen nothing: before and after.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Elsewhere {
    /// Known poses: position, rms [length unit].
    Check([f64; 2]),
    /// Poses left out in turn: χ² per equation.
    HeldOut([f64; 2]),
}

/// What is left on poses that a fit has not seen may be so many times what was left before, by
/// chance: the same noise is in both, and an effect that is there takes more away.
pub const WORSE: f64 = 1.05;

/// True where what is left elsewhere grew by more than noise, of so many errors that it is the
/// mean or the root mean square of.
#[must_use]
pub fn worse(before: f64, after: f64, errors: f64) -> bool {
    // Two relative standard deviations of a root mean square.
    after > before * WORSE.max(1.0 + 2.0 / (2.0 * errors.max(1.0)).sqrt())
}

/// True where data determine what a fit was asked for.
#[must_use]
pub fn determined(fit: &Fit, directions: &Directions) -> bool {
    let converged = fit.termination.converged() && fit.plausible;
    converged && fit.dof >= 1.0 && directions.unobservable.is_empty()
}

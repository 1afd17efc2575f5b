//! What a trace says, in the shape of the JSON.

use crate::apply::change::PlatformRms;
use crate::apply::check::CheckReadings;
use crate::diagnosis::curve_law::CurveLaw;
use crate::diagnosis::detectability::Detectability;
use crate::diagnosis::elsewhere::{Elsewhere, NotApplied};
use crate::diagnosis::held_out::HeldOut;
use crate::diagnosis::localisation::Residual;
use crate::diagnosis::unknown_law::{DependsOn, UnknownLaw};
use crate::diagnosis::verdict::{Reason, Verdict};
use crate::estimate::Observations;
use crate::estimate::directions::place;
use crate::mechanism::Mechanism;
use crate::model::Instance;
#[cfg(feature = "serde")]
use crate::numerics::nullable;
use crate::report::beside::GroupsReport;
use crate::report::result::{Estimates, ExcludedReport, FitReport, WithExcluded};
use crate::report::warned::Warned;
use crate::report::words;
use crate::terms::term::{Class, Over};

/// A term at its target.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename = "Name"))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Place {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Where a searched term acts; `2/1` is pose 1 of session 2, where several sessions have that number.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// What people call the target.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
}

impl Place {
    /// Name of an instance, as results have it.
    #[must_use]
    pub fn of(observations: &Observations, instance: &Instance) -> Self {
        let info = instance.term.info();
        Self {
            term: info.id.into(),
            class: info.class,
            target: instance.target.name(&observations.mechanism),
            place: place(observations, instance),
            label: instance.target.label(&observations.mechanism),
        }
    }
}

/// A parameter of a term that was found missing.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct StepParameter {
    /// Name of the parameter.
    pub name: String,
    /// The estimate.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub value: f64,
    /// Standard deviation.
    pub sd: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// As in `Parameter`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub note: Option<String>,
}

/// Effects of results of earlier versions are all applied.
#[cfg(feature = "serde")]
fn yes() -> bool {
    true
}

/// A missing term that was found.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename = "Step"))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct StepReport {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Probability by chance of a χ² that rises so much without it, corrected for the places looked at.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub p_value: f64,
    /// False where the effect is named, and no part of `parameters`.
    #[cfg_attr(feature = "serde", serde(default = "yes"))]
    pub applied: bool,
    /// Why it is not applied.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub not_applied: Option<NotApplied>,
    /// Probability of the explanations with this effect among `rivals`; null where there are none.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub probability: Option<f64>,
    /// By how much χ² would rise without the term.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub chi2_rise: Option<f64>,
    /// Estimates.
    #[cfg_attr(feature = "serde", serde(default))]
    pub parameters: Vec<StepParameter>,
    /// Where a searched term acts; `2/1` is pose 1 of session 2, where several sessions have that number.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// What people call the target.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
    /// How long a wave is of an error that repeats along what has no turn, in the unit of that coordinate.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub wavelength: Option<f64>,
    /// Terms that these poses cannot tell from this one.
    #[cfg_attr(feature = "serde", serde(default))]
    pub also_fits: Vec<Place>,
    /// True where this term changes the size of the whole, or one of these differs from it by that: a length that is
    /// known would tell, no pose does.
    #[cfg_attr(feature = "serde", serde(default))]
    pub needs_length: bool,
    /// True where this term or one of these is of when readings were taken: the first poses once more at the end would tell
    /// them apart.
    #[cfg_attr(feature = "serde", serde(default))]
    pub needs_repeats: bool,
    /// What the term did to the platform pose, the other parameters having absorbed what they can.
    #[cfg_attr(feature = "serde", serde(default))]
    pub platform_rms: Option<PlatformRms>,
    /// Rows of reading and correction, in `curve_unit`; see `curve_over`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub curve: Vec<[f64; 2]>,
    /// Standard deviation of each correction.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub curve_sd: Vec<f64>,
    /// `reading`, or `time`: rows are then time, 0 to 1 over the session, and correction.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_over: Option<Over>,
    /// Unit of the corrections: `rad`, the unit of length for a joint that slides, or `1` for a
    /// fraction of all readings.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_unit: Option<String>,
    /// The closed form behind a free curve, for the readings or times that occur.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_law: Option<CurveLaw>,
    /// Error on poses left out, with this effect and those before.
    #[cfg_attr(feature = "serde", serde(default))]
    pub held_out: Option<HeldOut>,
}

/// Effects that explain a session together, nearly as well as the best do.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Rival")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct RivalReport {
    /// The effects: `unknown_law` is a law that no term has, `unknown_noise` errors that follow none.
    pub terms: Vec<Place>,
    /// Price of the explanation: χ² by the noise that may be, with what its effects, their places and wrong
    /// readings cost.
    pub chi2_penalised: f64,
    /// Probability among the explanations that are listed.
    pub probability: f64,
}

/// What is left when nothing scores any more.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Unexplained {
    /// Probability of the residual by chance.
    pub p_value: Option<f64>,
    /// Where the structure is.
    pub target: Option<String>,
    /// What is left, in words.
    pub text: String,
    /// What it is; null in results of earlier versions.
    #[cfg_attr(feature = "serde", serde(default))]
    pub kind: Option<Left>,
    /// What the likeliest law that no term has depends on, where it ties with what was found, or
    /// something is left.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub depends_on: Vec<DependsOn>,
    /// Other targets of which such a law fits as well, the likeliest first.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub also_of: Vec<String>,
    /// A formula that fits as well as that law, within 6 in price.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub law: Option<FoundLaw>,
}

/// A formula for the errors of a channel, a link or a closure, which no term has.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct FoundLaw {
    /// The channel, the row of a chain or the closure.
    pub target: String,
    /// The correction of its coordinate or value, or by how much its frame moves, as a mechanism file
    /// writes it.
    pub formula: String,
    /// Its parameters.
    pub parameters: Vec<FormulaParameter>,
    /// Its probability among all formulas that were weighed and the smooth function.
    pub probability: f64,
    /// Lines for the mechanism file that make it a term.
    pub term: String,
}

/// A parameter of a formula.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct FormulaParameter {
    /// Its name in the formula.
    pub name: String,
    /// The estimate, to first order.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
}

impl FoundLaw {
    pub(super) fn of(mechanism: &Mechanism, law: &UnknownLaw) -> Option<Self> {
        let written = law.written.as_ref()?;
        let parameters = written.law.parameters.keys().zip(&written.values);
        Some(Self {
            target: law.whose.target.name(mechanism),
            formula: written.law.text().1.to_owned(),
            parameters: parameters
                .map(|(name, [value, sd])| FormulaParameter {
                    name: name.clone(),
                    value: *value,
                    sd: *sd,
                })
                .collect(),
            probability: written.probability,
            term: words::as_term(&written.law),
        })
    }
}

/// What is left after a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Left {
    /// No more than noise.
    Noise,
    /// Nothing but the fit gives the noise: it cannot be judged.
    Unjudged,
    /// No more than noise, but what was found may stand for another effect.
    Doubtful,
    /// Errors of the target alone, by a law that no term has.
    OneTarget,
    /// The noise is larger than it was declared.
    DeclaredNoise,
    /// More than noise, of several.
    Structure,
    /// A kind of a later version.
    #[cfg_attr(feature = "serde", serde(other))]
    Other,
}

impl Left {
    pub(super) fn of(residual: &Residual) -> Self {
        match residual {
            Residual::Noise { .. } => Self::Noise,
            Residual::Unjudged { .. } => Self::Unjudged,
            Residual::Doubtful(_) | Residual::UnknownLaw(_) => Self::Doubtful,
            Residual::Isolated { .. } | Residual::Follows(_) => Self::OneTarget,
            Residual::Louder { .. } => Self::DeclaredNoise,
            Residual::Structure(_) => Self::Structure,
        }
    }
}

/// The result of a trace.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct TraceReport {
    /// The verdict.
    pub verdict: Verdict,
    /// Why it is not better; the first says most.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub reasons: Vec<Reason>,
    /// What is absurd beside the size of the mechanism.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub implausible: Vec<Warned>,
    /// Suspicious things.
    pub warnings: Vec<Warned>,
    /// Readings left out.
    pub excluded: Vec<ExcludedReport>,
    /// The fit as asked for with them.
    pub with_excluded: Option<WithExcluded>,
    /// The fit as asked for.
    pub before: FitReport,
    /// Effects found.
    pub steps: Vec<StepReport>,
    /// What the effects do to predictions elsewhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub elsewhere: Option<Elsewhere>,
    /// Explanations that are nearly as good as the best, itself included; the best first.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub rivals: Vec<RivalReport>,
    /// The fit with them.
    pub after: FitReport,
    /// The known poses with the mechanism as it is declared.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub nominal: Option<FitReport>,
    /// How well points that are touched are repeated.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub groups: Option<GroupsReport>,
    /// What is left.
    pub unexplained: Unexplained,
    /// What could be there unseen, worst first.
    pub could_hide: Vec<Detectability>,
    /// Readings in the known poses, where something is left.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub check_readings: Option<CheckReadings>,
    /// Noise, parameters, covariance and the rest, of the fit after.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub estimates: Estimates,
    /// Residual of each pose in units of its noise, pose by pose, equation by equation, before.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub before_residuals: Vec<f64>,
    /// The same after.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub after_residuals: Vec<f64>,
}

//! Results as documents: the shape of the JSON that the commands print and read back.
//!
//! These types are the contract with files. The JSON Schema that ships with the Python package
//! and the Python classes are generated from them; reading a document checks it against them.
//! What is not known is null; keys that a later version adds are ignored.

use std::collections::BTreeMap;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::apply::accuracy::Predicted;
use crate::apply::check::Check;
use crate::apply::earlier::Reference;
use crate::apply::unseen::Unseen;
use crate::diagnosis::held_out::HeldOut;
use crate::diagnosis::verdict::{Reason, Verdict};
use crate::estimate::between::Grouping;
use crate::estimate::noise::source::Source;
use crate::mechanism::Law;
use crate::report::traced::Left;
use crate::report::warned::Warned;
use crate::terms::term::{Class, Over};

/// Formats of results, with the version that this program writes.
pub const FORMATS: [&str; 2] = ["rsicalib.calibration/1", "rsicalib.trace/1"];

/// Declares a document: the fields that every result has, and its own.
macro_rules! result {
    ($(#[doc = $doc:literal])* $name:ident { $($(#[$meta:meta])* $field:ident: $kind:ty,)* }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[non_exhaustive]
        pub struct $name {
            /// Kind of the document and version of its shape.
            pub format: String,
            /// Version of the program.
            pub version: String,
            /// Name of the mechanism.
            pub mechanism: String,
            /// Unit of every length.
            pub length_unit: String,
            /// The device that was calibrated, as the user calls it.
            #[serde(default)]
            pub device: Option<String>,
            /// What the user noted of the session.
            #[serde(default)]
            pub note: Option<String>,
            /// Date, or date and time, from which the parameters hold: ISO 8601.
            #[serde(default)]
            pub valid_from: Option<String>,
            /// The readings that the result is about.
            pub readings: Data,
            /// How the parameters were found.
            #[serde(default = "implicit_loop")]
            pub method: String,
            /// Noise of one sample.
            pub noise: Option<Noise>,
            /// Suspicious things.
            #[serde(default)]
            pub warnings: Vec<Warned>,
            /// Readings that were left out.
            #[serde(default)]
            pub excluded: Vec<Excluded>,
            /// The calibration with the readings in `excluded`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub with_excluded: Option<WithExcluded>,
            /// The verdict.
            pub verdict: Verdict,
            /// Why it is not better; the first says most.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub reasons: Vec<Reason>,
            /// What is absurd beside the size of the mechanism.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub implausible: Vec<String>,
            /// Estimates.
            pub parameters: Vec<Parameter>,
            /// Covariance of the parameters, in their order and units; null where unknown.
            pub covariance: Vec<Vec<Option<f64>>>,
            /// What changes from group to group, placements or sessions; null where the session has
            /// none, or where they tell nothing.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub between: Option<Between>,
            /// Predicted error at the poses of the session, what changes between groups included;
            /// null where the data determine none.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub predicted: Option<Predicted>,
            /// Directions in the space of parameters that the data cannot tell: those that other
            /// poses could, then those that no reading could, which a convention fixes.
            #[serde(default)]
            pub unobservable: Vec<String>,
            /// Terms without which these poses would determine the rest.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub too_many: Vec<String>,
            /// Directions that the data hardly tell.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub weak: Vec<String>,
            /// Condition number, offsets about the mean reading.
            #[serde(default)]
            pub condition: Option<f64>,
            /// Starts that were tried.
            #[serde(default)]
            pub starts: Vec<Start>,
            /// Why the solver stopped.
            #[serde(default)]
            pub termination: String,
            /// The readings that the parameters refer to.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub reference: Option<Reference>,
            /// The check poses with the mechanism as it is declared.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub nominal: Option<FitQuality>,
            /// Parameters that differ from an earlier result, where one was given.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub moved: Option<Vec<Moved>>,
            /// SHA-256 of the earlier result that this one is meant to replace.
            #[serde(default)]
            pub supersedes: Option<String>,
            /// Digest of the numbers that poses come from, as they were written: others were edited.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub digest: Option<String>,
            /// How the loops close under this result: what a watch compares with.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub misclosure: Option<Misclosure>,
            /// What has changed since an earlier result, and whether it is worth an update.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub update: Option<Update>,
            /// How well points that are touched are repeated, where the mechanism has such.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub groups: Option<Groups>,
            /// What people call channels and links, by target.
            #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
            pub labels: IndexMap<String, String>,
            /// Terms that users wrote, as the mechanism file declared them.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub laws: Vec<Law>,
            $($(#[$meta])* pub $field: $kind,)*
        }

        impl Parts for $name {
            fn parameters(&self) -> &[Parameter] {
                &self.parameters
            }
            fn covariance(&self) -> &[Vec<Option<f64>>] {
                &self.covariance
            }
            fn between(&self) -> Option<&Between> {
                self.between.as_ref()
            }
            fn noise(&self) -> Option<&Noise> {
                self.noise.as_ref()
            }
            fn noise_mut(&mut self) -> Option<&mut Noise> {
                self.noise.as_mut()
            }
            fn reference(&self) -> Option<&Reference> {
                self.reference.as_ref()
            }
            fn fits(&self) -> Vec<(&'static str, &FitQuality)> {
                Self::own_fits(self)
            }
            fn steps(&self) -> &[Step] {
                Self::own_steps(self)
            }
        }
    };
}

/// The parts of a result that must agree with each other.
pub(crate) trait Parts {
    /// Estimates.
    fn parameters(&self) -> &[Parameter];
    /// Their covariance, row by row.
    fn covariance(&self) -> &[Vec<Option<f64>>];
    /// What changes from group to group.
    fn between(&self) -> Option<&Between>;
    /// Noise of one sample.
    fn noise(&self) -> Option<&Noise>;
    /// The same, to complete what an earlier version did not write.
    fn noise_mut(&mut self) -> Option<&mut Noise>;
    /// The readings that the parameters refer to.
    fn reference(&self) -> Option<&Reference>;
    /// How well the models fit, by their keys.
    fn fits(&self) -> Vec<(&'static str, &FitQuality)>;
    /// Effects that were found.
    fn steps(&self) -> &[Step];
}

result! {
    /// A calibration: parameters from joint readings alone.
    Calibration {
        /// How well the model fits.
        fit: FitQuality,
    }
}

result! {
    /// A calibration whose residual was traced.
    Trace {
        /// How well the model fits that the search began with.
        before: FitQuality,
        /// Effects that were found, in their order.
        #[serde(default)]
        steps: Vec<Step>,
        /// Explanations within 12 of the best in penalised χ², itself included; the best first, 8
        /// at most.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        rivals: Vec<Rival>,
        /// How well the model fits with the terms of `steps`.
        after: FitQuality,
        /// What is left.
        #[serde(default)]
        unexplained: Option<Unexplained>,
        /// Absent effects that would not have been seen.
        #[serde(default)]
        could_hide: Vec<Hidden>,
        /// Terms that could not be tried, and what the readings or the mechanism lack for them.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        not_candidates: BTreeMap<String, String>,
    }
}

impl Calibration {
    fn own_fits(&self) -> Vec<(&'static str, &FitQuality)> {
        vec![("fit", &self.fit)]
    }

    fn own_steps(&self) -> &[Step] {
        &[]
    }
}

impl Trace {
    fn own_fits(&self) -> Vec<(&'static str, &FitQuality)> {
        vec![("before", &self.before), ("after", &self.after)]
    }

    fn own_steps(&self) -> &[Step] {
        &self.steps
    }
}

fn implicit_loop() -> String {
    "implicit_loop".into()
}

/// The readings that a result is about.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Data {
    /// Poses.
    pub poses: u64,
    /// Samples.
    pub samples: u64,
    /// Digest of the readings as they were used.
    pub sha256: String,
    /// Files that the readings are from, as they were given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<String>,
    /// Rows that were dropped because the caller asked for it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<Skipped>,
}

/// A row that was dropped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Skipped {
    /// File.
    pub file: String,
    /// Line of a CSV file, the header being line 1; row elsewhere.
    pub line: Option<u64>,
    /// Column.
    pub column: Option<String>,
    /// What was found and what was expected.
    pub reason: String,
}

/// Noise of one sample, by channel, and where it is known from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Noise {
    /// Where the noise is known from, in words.
    pub source: String,
    /// Standard deviation by channel, in each channel's unit, quantisation included.
    pub sigma: IndexMap<String, f64>,
    /// Degrees of freedom; null where the noise was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: Option<f64>,
    /// Unit of the readings, by channel.
    #[serde(default)]
    pub unit: IndexMap<String, String>,
    /// Where the noise is known from; null in results of earlier versions.
    #[serde(default)]
    pub kind: Option<Source>,
    /// How well what is touched holds its place, where only the fit tells it, in `length_unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seating: Option<f64>,
    /// How well each closure holds, one draw for each seating: the standard deviation as it is
    /// declared, or as only the fit tells it, in `length_unit` or as equal coordinates count.
    /// Closures that hold exactly are not listed.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub closures: IndexMap<String, f64>,
}

/// What changes from group to group: placements, or sessions.
///
/// `covariance` holds within the groups of the session. Parameters as means over groups, as another
/// session has them, have the covariance of this table; in one other group each of `parameters`
/// differs from that mean by its `sd` beside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Between {
    /// What tells groups apart.
    pub kind: Grouping,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Most likely standard deviation of the changes, in typical sizes of their parameters.
    pub sd: f64,
    /// Standard deviations between which it lies with 95 % probability.
    pub interval: [f64; 2],
    /// Probability by chance of groups that differ so much, were nothing to change.
    pub p_value: f64,
    /// Parameters that may change, and by how much they are expected to.
    pub parameters: Vec<Changing>,
    /// Covariance of the parameters between groups, in their order and units; null where unknown.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// One half of the groups against the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub halves: Option<Halves>,
}

/// A parameter that may change from group to group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Changing {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// Standard deviation from group to group that is counted with: more than the most likely one
    /// where few groups tell of it.
    pub sd: f64,
    /// Its unit.
    pub unit: String,
}

/// Estimates of every other group against those of the rest: what cross-validation says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Halves {
    /// Names of the groups of each half.
    pub groups: [Vec<String>; 2],
    /// Root mean square difference of a coordinate of predicted positions, in `length_unit`.
    pub difference: f64,
    /// The same as the intervals within groups predict it.
    pub within: f64,
    /// The same with what changes from group to group.
    pub between: f64,
    /// χ² of the difference of the parameters per parameter, by what is within groups.
    pub chi2_within: f64,
    /// The same with what changes from group to group.
    pub chi2_between: f64,
    /// True where each half has told on its own how much changes; else all groups have, the
    /// difference among them.
    pub own: bool,
}

/// How well a model fits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FitQuality {
    /// χ² between poses.
    pub chi2: Option<f64>,
    /// Its degrees of freedom.
    pub dof: Option<f64>,
    /// Probability of a larger χ² by chance; null where lack of fit cannot be judged.
    pub p_value: Option<f64>,
    /// Error of the closures, in `misclosure_unit`.
    pub rms_misclosure: Option<f64>,
    /// Unit of `rms_misclosure`: of length, or of the coordinates that closures make equal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misclosure_unit: Option<String>,
    /// Error on poses left out.
    #[serde(default)]
    pub held_out: Option<HeldOut>,
    /// Error on known poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check: Option<Check>,
    /// As `check`, after the best rigid motion of the instrument.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aligned: Option<Check>,
}

/// An estimate: `value` ± 1.96 `sd` covers the truth 95 times in 100.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Parameter {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// The estimate.
    pub value: Option<f64>,
    /// Standard deviation; null where these poses cannot determine the parameter.
    pub sd: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// Standard deviation of the mean over groups, as of `between.covariance`; null where there are
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd_between: Option<f64>,
    /// Where a searched term acts: a pose, or another channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// What keeps the parameter from being what its term is called.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// What an earlier result says of it, where one was given and knows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub earlier: Option<Before>,
}

/// What an earlier result says of a parameter: the value that it left behind, slips included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Before {
    /// The earlier estimate.
    pub value: f64,
    /// Standard deviation of the difference, by both uncertainties.
    pub sd: f64,
}

/// A start that was tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Start {
    /// Where the start began.
    pub from: String,
    /// `fᵀf` where the start ended.
    pub cost: Option<f64>,
    /// True where a gain went to zero: the trivial solution.
    #[serde(default)]
    pub collapsed: Option<bool>,
}

/// A reading that was found to be bad; null: all of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Excluded {
    /// Label of the pose.
    pub pose: Option<i64>,
    /// Sample of the pose, counted from 1.
    pub sample: Option<i64>,
    /// Values of the columns that tell its unknown points apart.
    pub group: Option<String>,
    /// The chain at fault.
    pub chain: Option<String>,
    /// The channel at fault.
    pub channel: Option<String>,
    /// Why.
    pub reason: String,
    /// How many samples that are.
    #[serde(default)]
    pub samples: Option<u64>,
}

/// The calibration of all readings, where some were left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WithExcluded {
    /// How well the model fits.
    pub fit: FitQuality,
    /// Estimates.
    pub parameters: Vec<Parameter>,
}

/// A parameter that is not what an earlier result says, beyond both uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Moved {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// The earlier estimate.
    pub before: f64,
    /// The estimate now.
    pub after: f64,
    /// Standard deviation of the difference.
    pub sd: f64,
    /// Unit of all three.
    pub unit: String,
}

/// Reference statistics of the misclosure: how the loops close under a result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Misclosure {
    /// Root mean square by closure, in units of length.
    pub rms: IndexMap<String, f64>,
    /// Degrees of freedom of the noise; null where it was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Usual time between neighbouring samples, in seconds; null without times.
    pub interval_s: Option<f64>,
}

/// A later session against an earlier result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Update {
    /// True where something has changed for sure, and this result has the smaller held-out error.
    pub worth: bool,
    /// The same as a sentence.
    pub text: String,
    /// χ² of the readings under the earlier result, its uncertainty counted in, per degree of
    /// freedom.
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
}

/// A change between two sessions of a device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    pub platform_rms: Option<Rms>,
    /// Changes that these readings cannot tell from it, as `offset@a22`.
    #[serde(default)]
    pub also_fits: Vec<String>,
}

/// Mean distance of carried points from their own mean at what they touch, by placement.
///
/// `docs/measured.md` says how the measure is formed. Null where there are no such groups.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Groups {
    /// Mean over the groups that were fitted [unit].
    pub fitted: Option<f64>,
    /// Mean over the groups that the fit has not seen [unit].
    pub others: Option<f64>,
    /// Group by group [unit].
    pub by_group: IndexMap<String, f64>,
    /// Unit of all of them.
    pub unit: String,
    /// `fitted` with the mechanism as it is declared.
    #[serde(default)]
    pub nominal_fitted: Option<f64>,
    /// `others` with the mechanism as it is declared.
    #[serde(default)]
    pub nominal_others: Option<f64>,
    /// `fitted` before effects were traced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before_fitted: Option<f64>,
    /// `others` before effects were traced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before_others: Option<f64>,
}

/// A term at its target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Name {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Where a searched term acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// What people call the target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// What an effect does to the platform pose: root mean square over components.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Rms {
    /// Position, in units of length.
    pub position: Option<f64>,
    /// Orientation, in radians.
    pub orientation: Option<f64>,
}

/// A parameter of a term that was found missing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StepParameter {
    /// Name of the parameter.
    pub name: String,
    /// The estimate.
    pub value: Option<f64>,
    /// Standard deviation.
    pub sd: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// As in `Parameter`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// A missing term that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Probability by chance, corrected for the places looked at.
    pub p_value: Option<f64>,
    /// By how much χ² would rise without the term.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chi2_rise: Option<f64>,
    /// Estimates.
    #[serde(default)]
    pub parameters: Vec<StepParameter>,
    /// Where a searched term acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// What people call the target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Terms that these poses cannot tell from this one.
    #[serde(default)]
    pub also_fits: Vec<Name>,
    /// What the term did to the platform pose, the other parameters having absorbed what they can.
    #[serde(default)]
    pub platform_rms: Option<Rms>,
    /// Rows of reading and correction, in `curve_unit`; see `curve_over`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<[f64; 2]>,
    /// Standard deviation of each correction.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve_sd: Vec<f64>,
    /// `reading`, or `time`: rows are then time, 0 to 1 over the session, and correction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve_over: Option<Over>,
    /// Unit of the corrections: `rad`, the unit of length for a joint that slides, or `1` for a
    /// fraction of all readings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve_unit: Option<String>,
    /// The closed form behind a free curve, for the readings or times that occur.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve_law: Option<CurveLaw>,
    /// Error on poses left out, with this effect and those before.
    #[serde(default)]
    pub held_out: Option<HeldOut>,
}

/// The closed form behind a free curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CurveLaw {
    /// Name of the form; null where no form that is known is the law.
    pub form: Option<String>,
    /// What the curve does, in words.
    pub text: String,
    /// What was searched for, then the amplitudes.
    #[serde(default)]
    pub parameters: Vec<LawParameter>,
    /// Other forms that fit as well.
    #[serde(default)]
    pub also_fits: Vec<String>,
}

/// A number of a closed form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LawParameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Values between which it lies with 95 % probability.
    pub interval: [f64; 2],
    /// Unit of all three.
    pub unit: String,
}

/// Effects that explain a session together, nearly as well as the best do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Rival {
    /// The effects.
    pub terms: Vec<Name>,
    /// χ², with 4 for each parameter of the effects and 4 for a time that was searched.
    pub chi2_penalised: f64,
    /// Probability among the explanations that are listed, all as likely beforehand.
    pub probability: f64,
}

/// What is left when nothing scores any more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Unexplained {
    /// Probability of the residual by chance.
    pub p_value: Option<f64>,
    /// Where the structure is.
    pub target: Option<String>,
    /// What is left, in words.
    pub text: String,
    /// What it is; null in results of earlier versions.
    #[serde(default)]
    pub kind: Option<Left>,
}

/// How large an absent effect would have to be to be seen, and what it would do meanwhile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Hidden {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Size that would have been seen in four sessions of five.
    pub detectable: Option<f64>,
    /// Unit of the size.
    pub unit: String,
    /// What an effect of that size does to the platform.
    #[serde(default)]
    pub platform_rms: Option<Rms>,
    /// Where a searched term would act: another channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// What people call the target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// What the session leaves open of it, for a budget of uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unseen: Option<Unseen>,
}

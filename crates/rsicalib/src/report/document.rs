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
use crate::apply::check::CheckReadings;
use crate::apply::earlier::Reference;
use crate::diagnosis::detectability::Detectability;
use crate::diagnosis::elsewhere::Elsewhere;
use crate::diagnosis::verdict::{Reason, Verdict};
use crate::estimate::directions::ParameterReport;
use crate::mechanism::Law;
use crate::numerics::lm::Termination;
use crate::report::beside::GroupsReport;
use crate::report::between::BetweenReport;
use crate::report::result::{
    ExcludedReport, FitReport, MisclosureReport, NoiseReport, StartReport, WithExcluded,
};
use crate::report::trace_report::{RivalReport, StepReport, Unexplained};
use crate::report::update::Update;
use crate::report::warned::Warned;

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
            pub noise: Option<NoiseReport>,
            /// Suspicious things.
            #[serde(default)]
            pub warnings: Vec<Warned>,
            /// Readings that were left out.
            #[serde(default)]
            pub excluded: Vec<ExcludedReport>,
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
            pub implausible: Vec<Warned>,
            /// Estimates.
            pub parameters: Vec<ParameterReport>,
            /// Covariance of the parameters, in their order and units; null where unknown.
            pub covariance: Vec<Vec<Option<f64>>>,
            /// What changes from group to group, placements or sessions; null where the session has
            /// none, or where they tell nothing.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub between: Option<BetweenReport>,
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
            pub starts: Vec<StartReport>,
            /// Why the solver stopped.
            #[serde(default)]
            pub termination: String,
            /// The same for programs; null where no solver ran, and in results of earlier versions.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub termination_kind: Option<Termination>,
            /// True where the solver ended at a minimum in which every joint moves; null as
            /// `termination_kind`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub converged: Option<bool>,
            /// The readings that the parameters refer to.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub reference: Option<Reference>,
            /// The check poses with the mechanism as it is declared.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub nominal: Option<FitReport>,
            /// Parameters that differ from an earlier result, where one was given.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub moved: Option<Vec<Moved>>,
            /// SHA-256 of the earlier result that this one is meant to replace.
            #[serde(default)]
            pub supersedes: Option<String>,
            /// Digest of the numbers that poses come from, as they were written: others were edited.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub digest: Option<String>,
            /// Digest of the drawing that it was found with; null in results of earlier versions.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub drawing: Option<String>,
            /// How the loops close under this result: what a watch compares with.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub misclosure: Option<MisclosureReport>,
            /// What has changed since an earlier result, and whether it is worth an update.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub update: Option<Update>,
            /// How well points that are touched are repeated, where the mechanism has such.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub groups: Option<GroupsReport>,
            /// What people call channels and links, by target.
            #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
            pub labels: IndexMap<String, String>,
            /// Terms that users wrote, as the mechanism file declared them.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub laws: Vec<Law>,
            $($(#[$meta])* pub $field: $kind,)*
        }

        impl Parts for $name {
            fn verdict(&self) -> Verdict {
                self.verdict
            }
            fn parameters(&self) -> &[ParameterReport] {
                &self.parameters
            }
            fn covariance(&self) -> &[Vec<Option<f64>>] {
                &self.covariance
            }
            fn between(&self) -> Option<&BetweenReport> {
                self.between.as_ref()
            }
            fn noise(&self) -> Option<&NoiseReport> {
                self.noise.as_ref()
            }
            fn noise_mut(&mut self) -> Option<&mut NoiseReport> {
                self.noise.as_mut()
            }
            fn reference(&self) -> Option<&Reference> {
                self.reference.as_ref()
            }
            fn fits(&self) -> Vec<(&'static str, &FitReport)> {
                Self::own_fits(self)
            }
            fn steps(&self) -> &[StepReport] {
                Self::own_steps(self)
            }
        }
    };
}

/// The parts of a result that must agree with each other.
pub(crate) trait Parts {
    /// The verdict.
    fn verdict(&self) -> Verdict;
    /// Estimates.
    fn parameters(&self) -> &[ParameterReport];
    /// Their covariance, row by row.
    fn covariance(&self) -> &[Vec<Option<f64>>];
    /// What changes from group to group.
    fn between(&self) -> Option<&BetweenReport>;
    /// Noise of one sample.
    fn noise(&self) -> Option<&NoiseReport>;
    /// The same, to complete what an earlier version did not write.
    fn noise_mut(&mut self) -> Option<&mut NoiseReport>;
    /// The readings that the parameters refer to.
    fn reference(&self) -> Option<&Reference>;
    /// How well the models fit, by their keys.
    fn fits(&self) -> Vec<(&'static str, &FitReport)>;
    /// Effects that were found.
    fn steps(&self) -> &[StepReport];
}

result! {
    /// A calibration: parameters from joint readings alone.
    Calibration {
        /// How well the model fits.
        fit: FitReport,
    }
}

result! {
    /// A calibration whose residual was traced.
    Trace {
        /// How well the model fits that the search began with.
        before: FitReport,
        /// Effects that were found, in their order.
        #[serde(default)]
        steps: Vec<StepReport>,
        /// What the effects do to predictions elsewhere; null where nothing was found, or where the
        /// session has nothing to leave out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        elsewhere: Option<Elsewhere>,
        /// Explanations within 12 of the best in penalised χ², itself included; the best first, 8
        /// at most.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        rivals: Vec<RivalReport>,
        /// How well the model fits with the terms of `steps`.
        after: FitReport,
        /// What is left.
        #[serde(default)]
        unexplained: Option<Unexplained>,
        /// Absent effects that would not have been seen.
        #[serde(default)]
        could_hide: Vec<Detectability>,
        /// Readings in the known poses, where the result leaves something: by these a certificate tells
        /// how large its errors are.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        check_readings: Option<CheckReadings>,
        /// Terms that could not be tried, and what the readings or the mechanism lack for them.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        not_candidates: BTreeMap<String, String>,
    }
}

impl Calibration {
    fn own_fits(&self) -> Vec<(&'static str, &FitReport)> {
        vec![("fit", &self.fit)]
    }

    fn own_steps(&self) -> &[StepReport] {
        &[]
    }
}

impl Trace {
    fn own_fits(&self) -> Vec<(&'static str, &FitReport)> {
        vec![("before", &self.before), ("after", &self.after)]
    }

    fn own_steps(&self) -> &[StepReport] {
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

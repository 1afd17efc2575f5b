//! Results as documents: the shape of the JSON that the commands print and read back.
//!
//! These types are the contract with files. The JSON Schema that ships with the Python package
//! and the Python classes are generated from them; reading a document checks it against them.
//! What is not known is null; keys that a later version adds are ignored.

use std::collections::BTreeMap;

use indexmap::IndexMap;
use schemars::JsonSchema;
pub use schemars::Schema;
use serde::{Deserialize, Serialize};

use crate::apply::check::Check;
use crate::apply::earlier::Reference;
use crate::diagnosis::held_out::HeldOut;
use crate::diagnosis::verdict::Verdict;
use crate::terms::term::{Class, Over};

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
            /// The readings that the result is about.
            pub readings: Data,
            /// How the parameters were found.
            #[serde(default = "implicit_loop")]
            pub method: String,
            /// Noise of one sample.
            pub noise: Option<Noise>,
            /// Suspicious things.
            #[serde(default)]
            pub warnings: Vec<String>,
            /// Readings that were left out.
            #[serde(default)]
            pub excluded: Vec<Excluded>,
            /// The calibration with the readings in `excluded`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub with_excluded: Option<WithExcluded>,
            /// The verdict.
            pub verdict: Verdict,
            /// What is absurd beside the size of the mechanism.
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub implausible: Vec<String>,
            /// Estimates.
            pub parameters: Vec<Parameter>,
            /// Covariance of the parameters, in their order and units; null where unknown.
            pub covariance: Vec<Vec<Option<f64>>>,
            /// Directions in the space of parameters that the data cannot tell.
            #[serde(default)]
            pub unobservable: Vec<String>,
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
            /// How well points that are touched are repeated, where the mechanism has such.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub groups: Option<Groups>,
            $($(#[$meta])* pub $field: $kind,)*
        }
    };
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
    /// Files, where there are several.
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
    /// Where the noise is known from.
    pub source: String,
    /// Standard deviation by channel, in each channel's unit, quantisation included.
    pub sigma: IndexMap<String, f64>,
    /// Degrees of freedom; null where the noise was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: Option<f64>,
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
    /// Error of the closures [length unit].
    pub rms_misclosure: Option<f64>,
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
    /// Where a searched term acts: a pose, or another channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// What keeps the parameter from being what its term is called.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
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
    /// Terms that these poses cannot tell from this one.
    #[serde(default)]
    pub also_fits: Vec<Name>,
    /// What the term did to the platform pose, the other parameters having absorbed what they can.
    #[serde(default)]
    pub platform_rms: Option<Rms>,
    /// Rows of reading and correction (rad); see `curve_over`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<Vec<f64>>,
    /// Standard deviation of each correction.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve_sd: Vec<f64>,
    /// `reading`, or `time`: rows are then time, 0 to 1 over the session, and correction (rad); for
    /// the converter's reference the correction is the fraction by which all readings change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve_over: Option<Over>,
    /// Error on poses left out, with this effect and those before.
    #[serde(default)]
    pub held_out: Option<HeldOut>,
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
}

/// A result read back from its JSON.
#[derive(Debug, Clone, PartialEq)]
pub enum Document {
    /// Of `rsicalib.calibration/1`.
    Calibration(Box<Calibration>),
    /// Of `rsicalib.trace/1`.
    Trace(Box<Trace>),
}

/// Formats of results, with the version that this program writes.
pub const FORMATS: [&str; 2] = ["rsicalib.calibration/1", "rsicalib.trace/1"];

/// Why a text is not a result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct Refused {
    /// Path of the entry: `parameters[3].value`; `line 7, column 12` where the text is no JSON.
    pub place: String,
    /// What stands there.
    pub found: String,
    /// What could stand there.
    pub expected: String,
}

#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: serde_json::Value,
}

/// Reads a result, and checks that its parts agree.
///
/// # Errors
///
/// [`Refused`] with the place.
pub fn read(text: &str) -> Result<Document, Refused> {
    let head: Head = parse(text)?;
    let format = head.format.as_str().unwrap_or_default().to_owned();
    if format == FORMATS[0] {
        let read: Calibration = parse(text)?;
        check_parts(
            &read.parameters,
            &read.covariance,
            read.noise.as_ref(),
            read.reference.as_ref(),
        )?;
        return Ok(Document::Calibration(Box::new(read)));
    }
    if format == FORMATS[1] {
        let read: Trace = parse(text)?;
        check_parts(
            &read.parameters,
            &read.covariance,
            read.noise.as_ref(),
            read.reference.as_ref(),
        )?;
        return Ok(Document::Trace(Box::new(read)));
    }
    let found = if format.is_empty() { head.format.to_string() } else { format!("{format:?}") };
    Err(Refused { place: "format".into(), found, expected: FORMATS.join(" or ") })
}

fn parse<'de, T: Deserialize<'de>>(text: &'de str) -> Result<T, Refused> {
    let mut from = serde_json::Deserializer::from_str(text);
    let read = serde_path_to_error::deserialize(&mut from).map_err(|error| {
        let (path, inner) = (error.path().to_string(), error.inner());
        let at = format!("line {}, column {}", inner.line(), inner.column());
        let message = inner.to_string();
        let message = message.split(" at line ").next().unwrap_or_default().to_owned();
        let message = if inner.is_data() { message } else { format!("not JSON ({message})") };
        let (found, expected) = match message.split_once(", expected ") {
            Some((found, expected)) => (found.to_owned(), expected.to_owned()),
            None => (message, "a result of `rsicalib calibrate --json` or `trace --json`".into()),
        };
        let place = if path == "." { at } else { format!("{path} ({at})") };
        Refused { place, found, expected }
    })?;
    from.end().map_err(|error| Refused {
        place: format!("line {}, column {}", error.line(), error.column()),
        found: "text after the result".into(),
        expected: "the end".into(),
    })?;
    Ok(read)
}

/// Checks that names are not doubled, and that covariance, noise and reference fit each other.
fn check_parts(
    parameters: &[Parameter],
    covariance: &[Vec<Option<f64>>],
    noise: Option<&Noise>,
    reference: Option<&Reference>,
) -> Result<(), Refused> {
    let refuse =
        |place: String, found: String, expected: String| Err(Refused { place, found, expected });
    let key = |p: &Parameter| (p.term.clone(), p.target.clone(), p.place.clone(), p.name.clone());
    let mut seen = std::collections::HashSet::new();
    for (k, p) in parameters.iter().enumerate() {
        if !seen.insert(key(p)) {
            let found = format!("{} {} {} again", p.term, p.target, p.name);
            return refuse(format!("parameters[{k}]"), found, "each parameter once".into());
        }
        if p.sd.is_some_and(|sd| sd < 0.0) {
            let found = format!("{:?}", p.sd.unwrap_or_default());
            return refuse(format!("parameters[{k}].sd"), found, "0 or more, or null".into());
        }
    }
    let n = parameters.len();
    let square = covariance.len() == n && covariance.iter().all(|row| row.len() == n);
    if !square {
        let found = format!("{} rows", covariance.len());
        return refuse("covariance".into(), found, format!("{n} rows of {n} numbers"));
    }
    let (Some(noise), Some(reference)) = (noise, reference) else { return Ok(()) };
    let channels = noise.sigma.len();
    for (place, found) in
        [("reference.centre", reference.centre.len()), ("reference.span", reference.span.len())]
    {
        if found != channels {
            let expected = format!("{channels}, one for each channel of noise.sigma");
            return refuse(place.into(), format!("{found} entries"), expected);
        }
    }
    match noise.sigma.iter().find(|(_, sigma)| **sigma <= 0.0 || !sigma.is_finite()) {
        Some((name, sigma)) => {
            refuse(format!("noise.sigma.{name}"), sigma.to_string(), "a number above 0".into())
        }
        None => Ok(()),
    }
}

/// JSON Schema of the documents, by format.
#[must_use]
pub fn schemas() -> Vec<(&'static str, Schema)> {
    let calibration = schemars::schema_for!(Calibration);
    let trace = schemars::schema_for!(Trace);
    vec![(FORMATS[0], calibration), (FORMATS[1], trace)]
}

/// For each type of a document, the keys that are always written: the others are left out where
/// nothing is known.
#[must_use]
pub fn written_keys() -> Vec<(String, Vec<String>)> {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    let mut generator = settings.into_generator();
    let roots = [
        generator.root_schema_for::<Calibration>().to_value(),
        generator.root_schema_for::<Trace>().to_value(),
    ];
    let required = |schema: &serde_json::Value| -> Vec<String> {
        let keys = schema["required"].as_array().map_or(&[][..], Vec::as_slice);
        keys.iter().filter_map(|k| k.as_str().map(str::to_owned)).collect()
    };
    let mut all = BTreeMap::new();
    for root in &roots {
        let name = root["title"].as_str().unwrap_or_default();
        all.insert(name.to_owned(), required(root));
        for (name, schema) in root["$defs"].as_object().into_iter().flatten() {
            all.insert(name.clone(), required(schema));
        }
    }
    all.into_iter().collect()
}

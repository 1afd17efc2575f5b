//! Types of the evidence: as the Python classes, which are generated from them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::apply::check::Check;
use crate::estimate::directions::ParameterReport;
use crate::report::trace_report::Place;

/// What the pictures of a report are drawn from, beyond the result itself.
///
/// Residuals are those of the search, which averages the samples of a held pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Evidence {
    /// Closure of each equation; a touch has several.
    pub equations: Vec<String>,
    /// Label of each pose; empty for a recording, whose poses are its rows.
    pub poses: Vec<i64>,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Mean reading of each channel, pose by pose, in its unit; empty for a long recording.
    pub readings: Vec<Vec<f64>>,
    /// One for each effect that was found, in the order of `steps`.
    pub effects: Vec<EffectEvidence>,
    /// Scores of what is not in the final model, best first.
    pub left: Vec<Score>,
    /// What a wrong reading would have to be to be seen; null for a long recording.
    pub reliability: Option<Reliability>,
    /// The mechanism in its poses; null where no chain carries a point.
    pub drawing: Option<Drawing>,
    /// How well the calibration places what is carried, over the workspace or the limits of the
    /// joints.
    pub workspace: Vec<Slice>,
    /// The place that it knows least there; null where nothing is uncertain.
    pub weakest: Option<Weakest>,
    /// The fits with and without each suspect; null where nothing is suspected.
    pub switchboard: Option<Switchboard>,
    /// What a session may be explained by, nothing first, each fitted; empty where nothing is to be
    /// explained.
    pub hypotheses: Vec<Hypothesis>,
}

/// Evidence of one effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EffectEvidence {
    /// The effect as a law of one variable; null where it is no such law.
    pub law: Option<Law>,
    /// The residual against a variable; null beside a law.
    pub against: Option<Against>,
    /// Added-variable plot: what the effect explains, and the residual without it, in units of
    /// noise.
    pub added_variable: Vec<[f64; 2]>,
    /// Equations whose mean one dot of `added_variable` is.
    pub per_dot: u64,
    /// Number of the pose of each dot of `added_variable`, as in the drawing; empty where a dot is
    /// the mean of several.
    pub of_pose: Vec<usize>,
    /// Scores of all candidates without the effect, best first.
    pub scores: Vec<Score>,
}

/// An effect as a law of one variable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Law {
    /// The variable: `reading of a22`, `time`.
    pub over: String,
    /// True where that is the reading of the channel that the law corrects.
    pub of_reading: bool,
    /// Unit of the variable.
    pub unit: String,
    /// Unit of the correction.
    pub correction_unit: String,
    /// The variable, the correction that the law gives and the residual asks for, and its
    /// standard deviation.
    pub dots: Vec<[f64; 3]>,
    /// Poses whose weighted mean one dot is.
    pub per_dot: u64,
    /// Number of the pose of each dot, as in the drawing; empty where a dot is the mean of several.
    pub poses: Vec<usize>,
    /// The law: variable and correction.
    pub line: Vec<[f64; 2]>,
    /// What these poses cannot tell from it, each with the offset and gain of its own fit.
    pub alternatives: Vec<Alternative>,
}

/// A law that fits as well.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Alternative {
    /// The effect.
    pub effect: Place,
    /// Variable and correction.
    pub line: Vec<[f64; 2]>,
}

/// The residual against a variable of the configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Against {
    /// The variable: `angle of a22`, `pose`.
    pub over: String,
    /// Unit of the variable.
    pub unit: String,
    /// The variable, the residual without the effect, and what the effect explains of it, in
    /// units of noise.
    pub dots: Vec<[f64; 3]>,
}

/// How far a candidate stands out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Score {
    /// The candidate.
    pub effect: Place,
    /// By how much χ² would fall with it, to first order, eq. (72).
    pub score: f64,
    /// The same less the charge for its parameters and for the places looked at.
    pub charged: f64,
    /// Degrees of freedom of the score.
    pub dof: f64,
    /// Probability by chance, corrected for the places looked at.
    pub p_value: f64,
    /// True for what was found, or what these poses cannot tell from it.
    pub chosen: bool,
}

/// Reliability of single readings, after Baarda: channel by channel, pose by pose; null where
/// no other reading checks one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Reliability {
    /// Minimum detectable error of the channel's mean reading in the pose, in its unit: seen at the
    /// level 0.001 in four sessions of five.
    pub detectable: Vec<Vec<Option<f64>>>,
    /// External reliability: what an error of that size does to the worst-hit combination of
    /// parameters, in its standard deviations.
    pub external: Vec<Vec<Option<f64>>>,
}

/// The mechanism in its poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Drawing {
    /// Joints, and points that chains carry.
    pub nodes: Vec<Node>,
    /// Pairs of nodes that a body or a closure joins.
    pub edges: Vec<[usize; 2]>,
    /// Number of the pose of each row of `at`.
    pub poses: Vec<usize>,
    /// Coordinates of all nodes in a pose: x, y, z of the first, of the second, … [length unit].
    pub at: Vec<Vec<f64>>,
    /// Position of the platform, or of the first point that a chain carries [length unit].
    pub places: Vec<[f64; 3]>,
    /// Direction in which the parameters determine the position least, one standard deviation
    /// long [length unit].
    pub weakest: Vec<[f64; 3]>,
    /// `places` before: without what was found, or, where nothing was, with the mechanism as it is
    /// declared [length unit].
    pub before: Vec<[f64; 3]>,
    /// Known poses, the instrument moved onto the calibration where that was asked for.
    pub known: Vec<KnownPlace>,
}

/// The position of a known pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KnownPlace {
    /// Where it is known to be [length unit].
    pub at: [f64; 3],
    /// Where it is found before, as in `before` [length unit].
    pub before: [f64; 3],
    /// Where it is found with the calibration [length unit].
    pub after: [f64; 3],
}

/// Effects that a session may be explained by, fitted to the averages of the samples of each pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Hypothesis {
    /// The effects, wrong readings left out; none: the model that the search began with.
    pub effects: Vec<Place>,
    /// What this is.
    pub kind: HypothesisKind,
    /// Estimates of all parameters, in the order of `fit.values`.
    pub parameters: Vec<ParameterName>,
    /// The fit.
    pub fit: SwitchFit,
    /// Error on known poses.
    pub check: Option<Check>,
    /// `places` of the drawing with these effects [length unit].
    pub places: Vec<[f64; 3]>,
    /// Positions of the known poses with these effects [length unit].
    pub known: Vec<[f64; 3]>,
    /// How well the calibration with these effects places what is carried, as `workspace` of the
    /// evidence.
    pub workspace: Vec<Slice>,
}

/// What a hypothesis is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HypothesisKind {
    /// Nothing is missing.
    Nothing,
    /// What was found.
    Found,
    /// An explanation that is nearly as good.
    Rival,
    /// A smooth curve in place of each sensor's law.
    AnyCurve,
    /// A law that no term has: the readings less its likeliest errors. What it does at known poses is
    /// not known.
    UnknownLaw,
}

/// A joint, a point that a chain carries, or an end of closures that no chain carries.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Node {
    /// Channel of the joint, or of the length to a point that stands; name of another point.
    pub name: String,
    /// The chain; of a point that stands its name, and empty for a point that moves.
    pub chain: String,
    /// True for a joint, and for the far end of a length that a channel measures.
    pub joint: bool,
}

/// A plane of the workspace: of a platform at orientation zero, or everything within the limits of
/// the joints, seen from one side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Slice {
    /// The point that is carried, or the chain where it carries several; null: the platform.
    pub of: Option<String>,
    /// Names of the two coordinates that change.
    pub axes: [String; 2],
    /// Name of the third coordinate.
    pub fixed: String,
    /// Its value; null: a cell is the root mean square over all its values [length unit].
    pub value: Option<f64>,
    /// Distance of neighbouring cells along both axes [length unit].
    pub step: [f64; 2],
    /// Both coordinates of a cell, and the standard deviation of the position there, root mean
    /// square of x, y and z, noise of the reading not counted [length unit].
    pub cells: Vec<[f64; 3]>,
}

/// The place of the workspace that is known least.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Weakest {
    /// What is carried there, as for a plane; null: the platform.
    pub of: Option<String>,
    /// x, y, z [length unit].
    pub place: [f64; 3],
    /// Standard deviation there, root mean square of x, y and z [length unit].
    pub sd: f64,
    /// Direction that is known least, one standard deviation long [length unit].
    pub along: [f64; 3],
    /// The parameter that is most correlated with the position along it, offsets about the mean
    /// reading.
    pub parameter: ParameterName,
    /// Size of that correlation.
    pub correlation: f64,
}

/// The fits with and without each suspect, on averages of the samples of each pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Switchboard {
    /// The suspects.
    pub switches: Vec<Switch>,
    /// What each parameter is: of the terms of any fit.
    pub parameters: Vec<ParameterName>,
    /// Number `n` has switch `i` on where bit `i` of `n` is set.
    pub fits: Vec<SwitchFit>,
}

/// A suspect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Switch {
    /// The effect; on: it is in the model. Null for readings.
    pub effect: Option<Place>,
    /// Label of the pose; on: its readings are left out. Null for an effect.
    pub pose: Option<i64>,
    /// The channel at fault, where it can be told.
    pub channel: Option<String>,
}

/// Name of a parameter.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ParameterName {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// Unit of the parameter.
    pub unit: String,
}

impl From<ParameterReport> for ParameterName {
    fn from(ParameterReport { term, target, name, unit, .. }: ParameterReport) -> Self {
        Self { term, target, name, unit }
    }
}

/// One fit of a switchboard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SwitchFit {
    /// χ² between poses.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: f64,
    /// Probability of a larger one by chance; null where lack of fit cannot be judged.
    pub p_value: Option<f64>,
    /// Error of the closures [length unit].
    pub rms_misclosure: f64,
    /// Estimates in the order of `parameters`; null where not in the model.
    pub values: Vec<Option<f64>>,
    /// Their standard deviations; null where unknown.
    pub sd: Vec<Option<f64>>,
    /// Residuals in units of noise, pose by pose, equation by equation.
    pub residuals: Vec<f64>,
}

//! What is expected of parameters before any reading: of a drawing, or of devices of the same design.

use crate::model::Spec;

/// What is expected of the parameters of one device.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expected {
    /// Readings at which offsets are meant, one per channel.
    pub centre: Vec<f64>,
    /// The parameters.
    pub parameters: Vec<Expectation>,
}

/// What is expected of a parameter, as a correction of the drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    /// Its term at its target; without a target, the term wherever it acts.
    pub spec: Spec,
    /// Its name; none: all of the term.
    pub name: Option<String>,
    /// Expectation, in its unit.
    pub mean: f64,
    /// Standard deviation, in its unit.
    pub sd: f64,
}

//! What results say of a parameter.

/// A parameter in one result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Past {
    /// Date, in days.
    pub day: f64,
    /// Estimate.
    pub value: f64,
    /// Its standard deviation, above 0.
    pub sd: f64,
}

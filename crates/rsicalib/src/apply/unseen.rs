//! [`Unseen`].

/// What a session leaves open of an effect that it was not found to have.
///
/// With an effect of `d` parameters `h`, typical sizes `D`, and the projected normal equations `M`,
/// `u` of (71),
///
/// ```text
/// V = (D⁻² + M)⁻¹,    m = V u,    ln B = ½ uᵀ V u - ½ ln det(1 + D M D)      (141)
/// ```
///
/// `h` is normal with mean `m` and covariance `V` if it is there, and `B` is how much more likely
/// the readings are with it than without.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Unseen {
    /// Probability that it is this one, if there is one that nobody named.
    pub probability: f64,
    /// Mean of each of its parameters.
    pub mean: Vec<f64>,
    /// Their covariance, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// By how much each parameter of the result is too large for it, row by row, for one unit of
    /// each of its own: unknown points are left out.
    pub moves: Vec<Vec<f64>>,
}

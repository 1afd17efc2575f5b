//! What devices of one design share: their common error of the drawing, and their spread.
//!
//! | here | symbol | |
//! |---|---|---|
//! | `information`, `told` | `H_d`, `h_d` | what device `d` tells of its parameters, without priors |
//! | `between` | `T` | variance between devices, diagonal, one for each term, by `levels` |
//! | `shift` | `γ` | mean of the devices from the drawing, with the variance `tol²` before |
//! | `lambda`, `b` | `Λ_d`, `b_d` | what device `d` tells of `γ` |
//! | `covariance` | `C` | of `γ` |
//!
//! ```text
//! β_d - β₀ ~ N(γ, T),   V = (H + T⁻¹)⁻¹,   Λ = H - H V H,   b = h - H V h          (121)
//! C = (Σ_d Λ_d + diag tol⁻²)⁻¹,   γ = C Σ_d b_d                                   (122)
//! m_d = β₀ + V (h + T⁻¹ γ),   covariance V + V T⁻¹ C T⁻¹ V                        (123)
//! ```
//!
//! Every number of the fleet is a sum over devices; a device tells `H` and `h` and nothing else.

mod first;
mod found;
mod joint;
mod levels;
mod naming;
mod share;
pub mod standing_out;
mod vectors;

pub use first::{Shift, Summed, beyond_chance, common_shifts, summed};
pub use found::{Common, DesignError, Found, found};
pub use levels::Spread;
pub use naming::Candidate;
pub use share::{Share, candidates, middles, share};

//! NIST's certified problems of nonlinear regression (StRD).
//!
//! | file | what |
//! |---|---|
//! | `data.rs` | the figures, written by `transcribe.py` |
//! | `models.rs` | the models and their derivatives, by hand |
//! | `minpack.py` | which starts MINPACK manages |

#[rustfmt::skip]
mod data;
mod models;

pub use data::ALL;

/// One problem: what to fit, from where, and the certified answer.
pub struct Strd {
    /// NIST's name.
    pub name: &'static str,
    /// One start far from the answer and one near.
    pub starts: [&'static [f64]; 2],
    /// The parameters at the minimum, to 11 digits.
    pub certified: &'static [f64],
    /// Their standard deviations.
    pub sd: &'static [f64],
    /// The sum of the squared residuals at the minimum.
    pub rss: f64,
    /// √(rss / (rows - parameters)).
    pub residual_sd: f64,
    /// What was measured, and the predictors.
    pub data: &'static [(f64, &'static [f64])],
    /// What the model predicts, of what was measured.
    pub response: fn(f64) -> f64,
    /// The model: parameters and predictors in; value returned, derivatives left.
    pub model: fn(&[f64], &[f64], &mut [f64]) -> f64,
}

impl Strd {
    /// The number of residuals.
    pub fn rows(&self) -> usize {
        self.data.len()
    }

    /// The number of parameters.
    pub fn parameters(&self) -> usize {
        self.certified.len()
    }

    /// Residuals: the model less what was measured.
    pub fn residuals(&self, b: &[f64], r: &mut [f64]) {
        let mut unused = vec![0.0; b.len()];
        for ((y, x), r) in self.data.iter().zip(r) {
            *r = (self.model)(b, x, &mut unused) - (self.response)(*y);
        }
    }

    /// Derivatives of the residuals, a column per parameter.
    pub fn jacobian(&self, b: &[f64], j: &mut [f64]) {
        let mut gradient = vec![0.0; b.len()];
        for (row, (_, x)) in self.data.iter().enumerate() {
            (self.model)(b, x, &mut gradient);
            for (column, g) in gradient.iter().enumerate() {
                j[column * self.rows() + row] = *g;
            }
        }
    }
}

/// The number of significant digits to which `found` agrees with `certified`.
///
/// NIST's logarithmic relative error; nothing for a NaN.
pub fn digits(found: f64, certified: f64) -> f64 {
    let error = (found - certified).abs() / certified.abs();
    if error.is_nan() { 0.0 } else { -error.log10() }
}

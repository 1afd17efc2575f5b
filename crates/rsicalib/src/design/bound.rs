//! The Cramér-Rao bound of offsets and gains at readings, before one is taken.
//!
//! A pose with misclosure derivatives `X` by offsets and gains and `A` by readings tells of the
//! parameters, whatever the estimator,
//!
//! ```text
//! M = Xᵀ (A Σ Aᵀ)⁻¹ X        cov ≥ [Σ_poses M]⁻¹                          (91)
//! ```

use faer::{Mat, Side};

use crate::Error;
use crate::estimate::paper::Paper;
use crate::mechanism::{Mechanism, Value};
use crate::numerics::symmetric::invert;

/// The least uncertainty that any unbiased estimator can have.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Bound {
    /// Standard deviation of each offset, at reading zero (rad); infinite where
    /// the poses cannot tell it.
    pub offset_sd: Vec<f64>,
    /// Standard deviation of each gain [rad/reading].
    pub gain_sd: Vec<f64>,
    /// Standard deviation of each joint coordinate, root mean square over the
    /// poses themselves (rad).
    pub joint_sd: Vec<f64>,
}

/// The bound (91) at true readings, row by row, with the noise `sigma` of each channel.
///
/// # Errors
///
/// As [`information`].
pub fn bound(
    mechanism: &Mechanism,
    counts: &[f64],
    offsets: &[f64],
    gains: &[f64],
    sigma: &[f64],
) -> Result<Bound, Error> {
    let told = information(mechanism, counts, offsets, gains, sigma)?;
    let (covariance, unknowable, _) = invert(&told);
    let c = mechanism.channels.len();
    let sd = |i: usize| match unknowable[i] {
        true => f64::INFINITY,
        false => covariance[(i, i)].max(0.0).sqrt(),
    };
    let joint = |i: usize| {
        let square = |a: &f64| {
            covariance[(i, i)]
                + 2.0 * a * covariance[(i, c + i)]
                + a * a * covariance[(c + i, c + i)]
        };
        match unknowable[i] || unknowable[c + i] {
            true => f64::INFINITY,
            false => {
                let squares = counts.iter().skip(i).step_by(c).map(square);
                (squares.sum::<f64>() * c as f64 / counts.len() as f64).sqrt()
            }
        }
    };
    Ok(Bound {
        offset_sd: (0..c).map(sd).collect(),
        gain_sd: (c..2 * c).map(sd).collect(),
        joint_sd: (0..c).map(joint).collect(),
    })
}

/// Information (91) of true readings, row by row, in rad and rad/reading: the offsets of all channels
/// and then their gains.
///
/// # Errors
///
/// As [`Paper::new`]; [`Error::Shape`] unless there is one offset, gain and sigma per channel.
pub fn information(
    mechanism: &Mechanism,
    counts: &[f64],
    offsets: &[f64],
    gains: &[f64],
    sigma: &[f64],
) -> Result<Mat<f64>, Error> {
    let paper = Paper::new(mechanism, counts)?;
    let c = mechanism.channels.len();
    Error::same("sigma", sigma.len(), c)?;
    let (k, n) = (mechanism.equations(), 2 * c);
    let jacobian = paper.jacobian(offsets, gains)?;
    let play = play(mechanism);
    let mut sum = Mat::zeros(n, n);
    for x in jacobian.chunks_exact(k * n) {
        // A = G diag(k), and G are the offset columns of X.
        let s = Mat::from_fn(k, k, |i, j| {
            let of = |m: usize| x[i * n + m] * x[j * n + m] * (gains[m] * sigma[m]).powi(2);
            (0..c).map(of).sum::<f64>() + if i == j { play[i] } else { 0.0 }
        });
        let w = whiten(&s, Mat::from_fn(k, n, |i, j| x[i * n + j]));
        sum += w.transpose() * &w;
    }
    Ok(sum)
}

/// Variance that declared play gives each equation.
fn play(mechanism: &Mechanism) -> Vec<f64> {
    mechanism
        .closures
        .iter()
        .flat_map(|c| {
            let value = c.value.as_ref().and_then(Value::known);
            let variance = (c.noise.unwrap_or(0.0) * c.kind.facts().per_length(value)).powi(2);
            std::iter::repeat_n(variance, c.kind.equations())
        })
        .collect()
}

/// `L⁻¹ x` with `L Lᵀ = s`; what a singular `s` would know exactly is left out.
fn whiten(s: &Mat<f64>, x: Mat<f64>) -> Mat<f64> {
    let k = s.nrows();
    let Ok(eigen) = s.self_adjoint_eigen(Side::Lower) else { return x };
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let largest = (0..k).map(|i| values[i]).fold(0.0, f64::max);
    let by = |i: usize| match values[i] > 1e-12 * largest {
        true => values[i].sqrt().recip(),
        false => 0.0,
    };
    let turned = vectors.transpose() * x;
    Mat::from_fn(k, turned.ncols(), |i, j| turned[(i, j)] * by(i))
}

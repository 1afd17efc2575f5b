//! Which poses to visit: the Cramér-Rao bound before a reading is taken.
//!
//! A pose with misclosure derivatives `X` by offsets and gains and `A` by
//! readings tells of the parameters, whatever the estimator,
//!
//! ```text
//! M = Xᵀ (A Σ Aᵀ)⁻¹ X        cov ≥ [Σ_poses M]⁻¹                          (91)
//! ```
//!
//! Poses are chosen from candidates by exchange (Fedorov 1972): whichever pose
//! of the plan is best replaced by a candidate is replaced, until none is. With
//! `C = [Σ M]⁻¹` and the whitened rows `W` of a pose, `M = Wᵀ W`, one exchange
//! costs a few products of small matrices,
//!
//! ```text
//! C' = C - C Wᵀ (± I + W C Wᵀ)⁻¹ W C                                      (92)
//! ```

use faer::{Mat, Side};

use crate::Error;
use crate::estimate::paper::Paper;
use crate::mechanism::{Mechanism, Value};

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

/// Poses with what they tell.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// Readings, row by row.
    pub(crate) counts: Vec<f64>,
    pub(crate) channels: usize,
    /// Whitened rows `L⁻¹ X` of each pose, columns scaled by `scale`.
    pub(crate) rows: Vec<Mat<f64>>,
    pub(crate) scale: Vec<f64>,
    /// `Ω` of the platform in scaled parameters, where it is asked for.
    pub(crate) platform: Option<Mat<f64>>,
}

impl Candidates {
    /// Of true readings, row by row, with the noise `sigma` of each channel.
    ///
    /// # Errors
    ///
    /// As [`Paper::new`]; [`Error::Shape`] unless there is one offset, gain and
    /// sigma per channel.
    pub fn new(
        mechanism: &Mechanism,
        counts: Vec<f64>,
        offsets: &[f64],
        gains: &[f64],
        sigma: &[f64],
    ) -> Result<Self, Error> {
        let paper = Paper::new(mechanism, &counts)?;
        let c = mechanism.channels.len();
        Error::same("sigma", sigma.len(), c)?;
        let (k, n) = (mechanism.equations(), 2 * c);
        let jacobian = paper.jacobian(offsets, gains)?;
        let mut scale = vec![1.0; c];
        scale.extend((0..c).map(|i| {
            let largest = counts.iter().skip(i).step_by(c).fold(0.0_f64, |m, v| m.max(v.abs()));
            if largest > 0.0 { largest } else { 1.0 }
        }));
        let play: Vec<f64> = play(mechanism);
        let rows = jacobian.chunks_exact(k * n).map(|x| {
            // A = G diag(k), and G are the offset columns of X.
            let s = Mat::from_fn(k, k, |i, j| {
                let of = |m: usize| x[i * n + m] * x[j * n + m] * (gains[m] * sigma[m]).powi(2);
                (0..c).map(of).sum::<f64>() + if i == j { play[i] } else { 0.0 }
            });
            let x = Mat::from_fn(k, n, |i, j| x[i * n + j] / scale[j]);
            whiten(&s, x)
        });
        let rows = rows.collect();
        Ok(Self { counts, channels: c, rows, scale, platform: None })
    }

    /// How many poses.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True where there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Information of some of the poses, in scaled parameters.
    pub(crate) fn information(&self, chosen: &[usize]) -> Mat<f64> {
        let n = self.scale.len();
        let mut sum = Mat::zeros(n, n);
        for &pose in chosen {
            sum += self.rows[pose].transpose() * &self.rows[pose];
        }
        sum
    }

    /// Information (91) of all poses, in rad and rad/reading.
    #[must_use]
    pub fn gram(&self) -> Mat<f64> {
        let all: Vec<usize> = (0..self.len()).collect();
        let m = self.information(&all);
        let n = self.scale.len();
        Mat::from_fn(n, n, |i, j| m[(i, j)] * self.scale[i] * self.scale[j])
    }

    /// The bound (91) for some of the poses.
    #[must_use]
    pub fn bound(&self, chosen: &[usize]) -> Bound {
        let (covariance, unknowable, _) =
            crate::numerics::symmetric::invert(&self.information(chosen));
        let c = self.channels;
        let sd = |i: usize| match unknowable[i] {
            true => f64::INFINITY,
            false => covariance[(i, i)].max(0.0).sqrt() / self.scale[i],
        };
        let joint = |i: usize| {
            let square = |&pose: &usize| {
                let a = self.counts[pose * c + i] / self.scale[c + i];
                covariance[(i, i)]
                    + 2.0 * a * covariance[(i, c + i)]
                    + a * a * covariance[(c + i, c + i)]
            };
            match unknowable[i] || unknowable[c + i] {
                true => f64::INFINITY,
                false => {
                    (chosen.iter().map(square).sum::<f64>() / chosen.len().max(1) as f64).sqrt()
                }
            }
        };
        Bound {
            offset_sd: (0..c).map(sd).collect(),
            gain_sd: (c..2 * c).map(sd).collect(),
            joint_sd: (0..c).map(joint).collect(),
        }
    }

    /// Mean diagonal element of a pose's information.
    pub(crate) fn typical(&self) -> f64 {
        let squares = self.rows.iter().map(|w| w.squared_norm_l2()).sum::<f64>();
        squares / (self.len() * self.scale.len()).max(1) as f64
    }
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

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

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::algebraic::Paper;
use crate::{Error, Mechanism, platform};

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Criterion {
    /// Sum of the variances of the offsets (A-optimal for what the paper reports).
    #[default]
    Offsets,
    /// Variance of the joint coordinates, averaged over the candidates (I-optimal).
    Joints,
    /// Volume of the confidence ellipsoid (D-optimal).
    Volume,
}

/// Names of the criteria, as users write them.
pub const CRITERIA: [(&str, Criterion); 3] =
    [("offsets", Criterion::Offsets), ("joints", Criterion::Joints), ("volume", Criterion::Volume)];

impl Criterion {
    /// The criterion of a name.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn find(name: &str) -> Result<Self, Error> {
        CRITERIA.iter().find(|c| c.0 == name).map(|c| c.1).ok_or_else(|| Error::Unknown {
            kind: "criterion",
            found: name.into(),
            known: CRITERIA.map(|c| c.0).join(", "),
        })
    }
}

/// The least uncertainty that any unbiased estimator can have.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Bound {
    /// Standard deviation of each offset, at reading zero [rad]; infinite where
    /// the poses cannot tell it.
    pub offset_sd: Vec<f64>,
    /// Standard deviation of each gain [rad/reading].
    pub gain_sd: Vec<f64>,
    /// Standard deviation of each joint coordinate, root mean square over the
    /// poses themselves [rad].
    pub joint_sd: Vec<f64>,
}

impl Bound {
    /// Root mean square of the offsets' standard deviations [rad].
    #[must_use]
    pub fn offset_rms(&self) -> f64 {
        rms(&self.offset_sd)
    }

    /// Root mean square of the gains' standard deviations [rad/reading].
    #[must_use]
    pub fn gain_rms(&self) -> f64 {
        rms(&self.gain_sd)
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Poses with what they tell.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// Readings, row by row.
    counts: Vec<f64>,
    channels: usize,
    /// Whitened rows `L⁻¹ X` of each pose, columns scaled by `scale`.
    rows: Vec<Mat<f64>>,
    scale: Vec<f64>,
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
        if sigma.len() != c {
            return Err(Error::Shape { what: "sigma".into(), found: sigma.len(), expected: c });
        }
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
        Ok(Self { counts, channels: c, rows, scale })
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
    fn information(&self, chosen: &[usize]) -> Mat<f64> {
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
        let (covariance, unknowable, _) = crate::fit::invert(&self.information(chosen));
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

    /// Chooses so many poses beside those that are `kept` anyway.
    ///
    /// `start` is where the exchange begins, as indices of candidates; a pose may
    /// be visited more than once, those that are kept are not visited again.
    /// Also returns what was made small. Deterministic.
    #[must_use]
    pub fn exchange(
        &self,
        start: &[usize],
        kept: &[usize],
        criterion: Criterion,
    ) -> (Vec<usize>, f64) {
        let mut chosen = start.to_vec();
        let weight = self.weight(criterion);
        // A trace of information everywhere, so that any start can be improved.
        let n = self.scale.len();
        let faint = Mat::<f64>::identity(n, n) * (1e-9 * self.typical());
        for _ in 0..SWEEPS {
            let mut changed = false;
            for place in 0..chosen.len() {
                let others: Vec<usize> = (0..chosen.len())
                    .filter(|p| *p != place)
                    .map(|p| chosen[p])
                    .chain(kept.iter().copied())
                    .collect();
                let rest = self.information(&others) + &faint;
                let Ok(factor) = rest.llt(Side::Lower) else { continue };
                let inverse = factor.solve(Mat::<f64>::identity(n, n));
                let best = self.best(&inverse, weight.as_ref(), chosen[place], kept);
                changed |= best != chosen[place];
                chosen[place] = best;
            }
            if !changed {
                break;
            }
        }
        let every: Vec<usize> = chosen.iter().chain(kept).copied().collect();
        let score = match (self.information(&every).llt(Side::Lower), weight) {
            (Err(_), _) => f64::INFINITY,
            (Ok(factor), None) => (0..n).map(|i| -2.0 * factor.L()[(i, i)].ln()).sum(),
            (Ok(factor), Some(omega)) => {
                let product = factor.solve(omega);
                (0..n).map(|i| product[(i, i)]).sum()
            }
        };
        (chosen, score)
    }

    /// The candidate that adds most to information with inverse `c`; `now` unless one is better.
    fn best(&self, c: &Mat<f64>, weight: Option<&Mat<f64>>, now: usize, kept: &[usize]) -> usize {
        let spread = weight.map(|w| c * w * c);
        let gain = |pose: usize| -> f64 {
            let w = &self.rows[pose];
            let k = w.nrows();
            let inner = w * c * w.transpose();
            let inner = Mat::from_fn(k, k, |i, j| inner[(i, j)] + if i == j { 1.0 } else { 0.0 });
            let Ok(factor) = inner.llt(Side::Lower) else { return f64::NEG_INFINITY };
            match &spread {
                // log det M' - log det M = log det (I + W C Wᵀ)
                None => 2.0 * (0..k).map(|i| factor.L()[(i, i)].ln()).sum::<f64>(),
                // tr(Ω C) - tr(Ω C') = tr((I + W C Wᵀ)⁻¹ W C Ω C Wᵀ), from (92)
                Some(spread) => {
                    let solved = factor.solve(w * spread * w.transpose());
                    (0..k).map(|i| solved[(i, i)]).sum()
                }
            }
        };
        let mut best = (gain(now) * (1.0 + 1e-9), now);
        for pose in (0..self.len()).filter(|pose| !kept.contains(pose)) {
            let value = gain(pose);
            if value > best.0 {
                best = (value, pose);
            }
        }
        best.1
    }

    /// `Ω` of the criterion `tr(Ω C)`; none for the volume.
    fn weight(&self, criterion: Criterion) -> Option<Mat<f64>> {
        let (c, n) = (self.channels, 2 * self.channels);
        let poses = self.len() as f64;
        match criterion {
            Criterion::Volume => None,
            Criterion::Offsets => {
                Some(Mat::from_fn(n, n, |i, j| if i == j && i < c { 1.0 } else { 0.0 }))
            }
            Criterion::Joints => {
                let mut omega = Mat::zeros(n, n);
                for i in 0..c {
                    let a = self.counts.iter().skip(i).step_by(c).map(|v| v / self.scale[c + i]);
                    let (sum, square) = a.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
                    omega[(i, i)] = 1.0;
                    omega[(i, c + i)] = sum / poses;
                    omega[(c + i, i)] = sum / poses;
                    omega[(c + i, c + i)] = square / poses;
                }
                Some(omega)
            }
        }
    }

    /// Mean diagonal element of a pose's information.
    fn typical(&self) -> f64 {
        let squares = self.rows.iter().map(|w| w.squared_norm_l2()).sum::<f64>();
        squares / (self.len() * self.scale.len()).max(1) as f64
    }
}

/// Sweeps of the exchange; it has never needed more than a dozen.
const SWEEPS: usize = 50;

/// Variance that declared play gives each equation.
fn play(mechanism: &Mechanism) -> Vec<f64> {
    use crate::mechanism::{ClosureKind, Value};
    mechanism
        .closures
        .iter()
        .flat_map(|c| {
            let scale = match (c.kind, &c.value) {
                (ClosureKind::Distance, Some(Value::Known(d))) => 2.0 * d,
                _ => 1.0,
            };
            let variance = (c.noise.unwrap_or(0.0) * scale).powi(2);
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

/// Readings that hold the platform at a pose; none out of reach, beyond a joint
/// limit, or within `margin` readings of the end of a range.
///
/// # Errors
///
/// [`Error::Missing`] without a platform.
pub fn readings_at(
    mechanism: &Mechanism,
    pose: &[f64; 6],
    offsets: &[f64],
    gains: &[f64],
    margin: f64,
) -> Result<Option<Vec<f64>>, Error> {
    let angles = match platform::inverse(mechanism, pose) {
        Ok(angles) => angles,
        Err(Error::OutOfReach { .. }) => return Ok(None),
        Err(other) => return Err(other),
    };
    let mut counts = Vec::with_capacity(angles.len());
    for (c, (channel, angle)) in mechanism.channels.iter().zip(angles).enumerate() {
        let count = (angle - offsets[c]) / gains[c];
        let within = channel.limits.is_none_or(|[low, high]| angle >= low && angle <= high)
            && channel
                .range
                .is_none_or(|[low, high]| count >= low + margin && count <= high - margin);
        if !within || !count.is_finite() {
            return Ok(None);
        }
        counts.push(count);
    }
    Ok(Some(counts))
}

//! What a session leaves open of an effect that was not found, (141).

use faer::{Mat, Side};

use crate::apply::unseen::Unseen;
use crate::diagnosis::score::projection::Projected;
use crate::numerics::order;

/// Effects that are together less than this part of the variance at the session's own poses are left
/// out.
const SMALL: f64 = 1e-3;

/// Where nothing tells what they do, those that are less probable are.
const RARE: f64 = 1e-4;

/// An effect after a session.
pub(crate) struct Open {
    /// Logarithm of the Bayes factor.
    factor: f64,
    mean: Vec<f64>,
    /// Independent directions, one standard deviation long.
    directions: Vec<Vec<f64>>,
}

impl Open {
    /// (141) of a candidate in these units, a column for each direction of typical size.
    pub(crate) fn of(candidate: &Projected, units: &Mat<f64>) -> Option<Self> {
        let d = units.nrows();
        // D M D
        let square = units.transpose() * &candidate.square * units;
        let eigen = square.self_adjoint_eigen(Side::Lower).ok()?;
        let (values, axes) = (eigen.S().column_vector(), eigen.U());
        let (mut factor, mut mean, mut directions) = (0.0, vec![0.0; d], Vec::with_capacity(d));
        let axes = units * axes;
        for k in 0..units.ncols() {
            let axis: Vec<f64> = (0..d).map(|i| axes[(i, k)]).collect();
            let variance = 1.0 / (1.0 + values[k].max(0.0));
            let along: f64 = axis.iter().zip(&candidate.gradient).map(|(a, u)| a * u).sum();
            factor += 0.5 * (along * along * variance + variance.ln());
            mean.iter_mut().zip(&axis).for_each(|(mean, a)| *mean += a * variance * along);
            directions.push(axis.into_iter().map(|a| a * variance.sqrt()).collect());
        }
        factor.is_finite().then_some(Self { factor, mean, directions })
    }

    /// Mean square of what it does, where `moves` says what a direction does.
    pub(crate) fn size(&self, moves: impl Fn(&[f64]) -> Option<f64>) -> Option<f64> {
        let mut all = std::iter::once(&self.mean).chain(&self.directions);
        all.try_fold(0.0, |sum, direction| Some(sum + moves(direction)?.powi(2)))
    }

    /// The same in the parameters that a result reports; its probability is still the logarithm.
    pub(crate) fn unseen(
        self,
        to_reported: &Mat<f64>,
        absorbed: &Mat<f64>,
        terms: usize,
    ) -> Unseen {
        let all = to_reported * absorbed;
        let d = self.mean.len();
        let covariance = |i: usize, j: usize| self.directions.iter().map(|v| v[i] * v[j]).sum();
        let row = |of: &dyn Fn(usize) -> f64| (0..d).map(|k| written(of(k))).collect();
        Unseen {
            probability: self.factor,
            mean: row(&|k| self.mean[k]),
            covariance: (0..d).map(|i| row(&|j| covariance(i, j))).collect(),
            moves: (0..terms).map(|i| row(&|k| all[(i, k)])).collect(),
        }
    }
}

/// Logarithms of Bayes factors as probabilities: before the session all effects are as likely. What
/// does next to nothing by its mean square `sizes` is left out, where those are known.
pub(crate) fn weigh<'a>(
    unseen: impl Iterator<Item = &'a mut Option<Unseen>>,
    sizes: &[Option<f64>],
) {
    let mut all: Vec<_> = unseen.collect();
    let factor = |u: &&mut Option<Unseen>| u.as_ref().map(|u| u.probability);
    let most = all.iter().filter_map(factor).fold(f64::MIN, f64::max);
    let sum: f64 = all.iter().filter_map(factor).map(|factor| (factor - most).exp()).sum();
    let mut shares = Vec::with_capacity(all.len());
    for (k, one) in all.iter_mut().enumerate() {
        let Some(unseen) = one.as_mut() else { continue };
        unseen.probability = (unseen.probability - most).exp() / sum;
        let share = sizes.get(k).copied().flatten().map(|size| unseen.probability * size);
        shares.push((k, unseen.probability, share));
    }
    let whole: f64 = shares.iter().filter_map(|(.., share)| *share).sum();
    order::ascending(&mut shares, |a| a.2.unwrap_or(f64::MAX));
    let mut left = 0.0;
    for (k, probability, share) in shares {
        left += share.unwrap_or(0.0);
        let small = if share.is_some() { left < SMALL * whole } else { probability < RARE };
        if small {
            *all[k] = None;
        }
    }
}

/// A number with as many digits as a budget can use.
fn written(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

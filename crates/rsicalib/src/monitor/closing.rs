//! Whether the loops close under a result, in readings that it has not seen.
//!
//! A result that was edited, or that is of another device, opens its loops. With `r` and `G` of
//! (101) and no change, the readings move the estimate of `δ` from zero to `μ`, and its covariance
//! from `P₀` to `P`. If the result holds,
//!
//! ```text
//! T = μᵀ (P₀ - P)⁺ μ ~ χ²(rank (P₀ - P))                                      (107)
//! ```
//!
//! A result whose parameters cannot be moved to where the loops close leaves the innovations of
//! the samples large: their median is compared with `χ²` of one sample, as a bad reading or two
//! do not speak against a result.

use nalgebra::DMatrix;

use crate::Error;
use crate::apply::earlier::Applied;
use crate::mechanism::Mechanism;
use crate::monitor::rows::Rows;
use crate::monitor::state::State;
use crate::monitor::thresholds::{as_chi2, log_tail};
use crate::monitor::watched::Watched;
use crate::numerics::lanes::WIDTH;

/// Directions of which the readings tell less than this share are not compared.
const TOLD: f64 = 1e-3;

/// How the loops close under a result.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Closing {
    /// Misclosure, root mean square in units of length.
    pub rms_misclosure: f64,
    /// What the noise makes of it: a result whose sensors are all too steep, or too noisy, explains
    /// any misclosure.
    pub expected_rms: f64,
    /// Probability of more by chance, if the result holds.
    pub p_value: f64,
}

/// Compares readings, `values` row by row, with a result whose parameters have this covariance.
///
/// `scale` is the variance of its residual over that of its noise, `dof` the degrees of freedom of
/// the noise; none where it was declared.
///
/// # Errors
///
/// As [`super::Monitor::new`].
pub fn closing(
    mechanism: &Mechanism,
    applied: &Applied,
    covariance: Option<&[f64]>,
    values: &[f64],
    scale: f64,
    dof: Option<f64>,
) -> Result<Closing, Error> {
    let watched = Watched::new(mechanism, applied, covariance, Vec::new())?;
    let (width, equations) = (watched.order.len(), watched.under.model.equations());
    let mut rows = Rows::new(&watched, &watched.under.noise);
    let lengths = watched.under.model.lengths();
    let used: Vec<(u64, &[f64])> =
        values.chunks_exact(mechanism.channels.len()).map(|row| (0, row)).collect();
    let (mut squares, mut expected) = (0.0, 0.0);
    for block in used.chunks(WIDTH) {
        for (lane, (_, readings)) in block.iter().enumerate() {
            rows.put(lane, readings);
        }
        squares += rows.misclosure(&watched, &lengths, block.len());
        rows.linearise(&watched, 0);
        expected += rows.expected(&lengths, block.len());
    }
    let rms = |sum: f64| (sum / (used.len() * lengths.len()).max(1) as f64).sqrt();

    let mut state = State::new(watched.prior.clone(), watched.uncertain, width, equations);
    let mut innovations = Vec::with_capacity(used.len());
    rows.each(&watched, &used, |_, r, g| {
        innovations.push(state.compare(r, g, width));
        state.absorb();
    });
    innovations.sort_by(f64::total_cmp);
    let median = innovations.get(innovations.len() / 2).copied().unwrap_or(0.0);
    let (moved, rank) = shift(&watched.prior, &state);
    let tail = |statistic: f64, dof_of: f64| {
        let statistic = statistic / scale.max(1.0);
        let statistic = dof.map_or(statistic, |dof| as_chi2(statistic, dof));
        if statistic.is_finite() { log_tail(statistic, dof_of).exp() } else { 0.0 }
    };
    let shifted = if rank > 0 { tail(moved, rank as f64) } else { 1.0 };
    let p_value = (2.0 * shifted.min(tail(median, equations as f64))).min(1.0);
    Ok(Closing { rms_misclosure: rms(squares), expected_rms: rms(expected), p_value })
}

/// `T` of (107) and its degrees of freedom.
fn shift(prior: &[f64], state: &State) -> (f64, usize) {
    let m = state.size;
    if m == 0 || state.mean.iter().chain(&state.covariance).any(|v| !v.is_finite()) {
        return (f64::INFINITY, usize::from(m > 0));
    }
    let before = DMatrix::from_row_slice(m, m, prior);
    let told = &before - DMatrix::from_row_slice(m, m, &state.covariance);
    // In units in which P₀ is 1, so that each direction is told by a share from 0 to 1.
    let own = before.symmetric_eigen();
    let largest = own.eigenvalues.max();
    let kept: Vec<usize> = (0..m).filter(|&k| own.eigenvalues[k] > 1e-12 * largest).collect();
    let units = DMatrix::from_fn(m, kept.len(), |i, k| {
        own.eigenvectors[(i, kept[k])] / own.eigenvalues[kept[k]].sqrt()
    });
    let shares = (units.transpose() * told * &units).symmetric_eigen();
    let mean = DMatrix::from_column_slice(m, 1, &state.mean);
    let along = shares.eigenvectors.transpose() * units.transpose() * mean;
    let (mut statistic, mut rank) = (0.0, 0);
    for (share, value) in shares.eigenvalues.iter().zip(along.iter()) {
        if *share > TOLD {
            statistic += value * value / share;
            rank += 1;
        }
    }
    (statistic, rank)
}

//! Held poses that moved while they were sampled.

use crate::numerics::order::Ends;
use std::ops::Range;

use crate::numerics::median::median;
use crate::numerics::order;
use crate::readings::codes::steps;
use crate::screening::raw::rows::{Raw, span};
use crate::screening::raw::suspect::Suspect;
use crate::screening::raw::units::whole_way;

/// Part of a channel's range by which no held pose moves: the guide takes 2 % of it for a tremor.
const MOVED: f64 = 0.05;

/// Poses with several samples from which on it is known what is typical.
const TYPICAL: usize = 8;

/// Standard deviations that a normal number is above once in 50 million times.
const FAR: f64 = 5.5;

/// A trembling hand moves some joints more than others, by pose.
const TREMOR: f64 = 2.0;

/// Scatter of a channel that reads on no grid, in parts of its span.
const LEAST: f64 = 1e-6;

/// Held poses that scatter far beyond what is typical of the others, the farthest first.
pub(super) fn moved_poses(raw: &Raw<'_>) -> Vec<Suspect> {
    let several = poses_with_repeats(raw);
    if several.len() < TYPICAL {
        return Vec::new();
    }
    let channels = 0..raw.channels.len();
    let scatter: Vec<Vec<f64>> = several.iter().map(|pose| scatter(raw, pose)).collect();
    let median_of = |c: usize| median(scatter.iter().map(|own| own[c]).collect());
    let least = resolution(raw);
    let typical: Vec<f64> = channels.clone().map(|c| median_of(c).max(least[c])).collect();
    let moved = |(pose, own): (&Range<usize>, &Vec<f64>)| {
        let dof = (pose.len() - 1) as f64;
        let limit = TREMOR * (chi2_per_dof(dof, FAR) / chi2_per_dof(dof, 0.0)).sqrt();
        // Of what never changes, no scatter is far.
        let excess = |c: usize| if own[c] == 0.0 { 0.0 } else { own[c] / typical[c] / limit };
        // The first of those that are equally far.
        let channel = channels.clone().rev().greatest_by(|&a| excess(a))?;
        let others = channels.clone().filter(|&c| c != channel && excess(c) > 1.0).count();
        let (row, scatter, typical) = (pose.start, own[channel], typical[channel]);
        let moved = Suspect::MovedPose { row, channel, scatter, typical, others };
        (excess(channel) > 1.0).then_some((excess(channel), moved))
    };
    let mut found: Vec<_> = several.iter().zip(&scatter).filter_map(moved).collect();
    order::descending(&mut found, |a| a.0);
    found.into_iter().map(|(_, moved)| moved).collect()
}

/// Poses within which joints go through a good part of their range.
pub(super) fn poses_not_held(raw: &Raw<'_>) -> Vec<Suspect> {
    let several = if raw.held { poses_with_repeats(raw) } else { Vec::new() };
    let part = |pose: &Range<usize>| {
        let own = |(c, channel)| span(raw.part(pose, c)) / whole_way(channel);
        raw.channels.iter().enumerate().map(own).fold(0.0, f64::max)
    };
    let part = median(several.iter().map(part).collect());
    let poses = raw.poses.len();
    if part > MOVED { vec![Suspect::Unheld { part, poses }] } else { Vec::new() }
}

/// Scatter that rounding alone gives; a millionth of the span where there is no grid.
pub(super) fn resolution(raw: &Raw<'_>) -> Vec<f64> {
    let rounding = steps(raw.values, &raw.counts(), true).into_iter().map(|s| s / 12.0_f64.sqrt());
    rounding.zip(raw.spans()).map(|(own, span)| own.max(LEAST * span)).collect()
}

fn poses_with_repeats(raw: &Raw<'_>) -> Vec<Range<usize>> {
    raw.poses.iter().filter(|rows| rows.len() > 1).cloned().collect()
}

/// Standard deviation of each channel within a pose.
fn scatter(raw: &Raw<'_>, pose: &Range<usize>) -> Vec<f64> {
    let n = pose.len() as f64;
    let own = |c: usize| {
        let mean = raw.part(pose, c).sum::<f64>() / n;
        let squares = raw.part(pose, c).map(|v| (v - mean).powi(2));
        (squares.sum::<f64>() / (n - 1.0)).sqrt()
    };
    (0..raw.channels.len()).map(own).collect()
}

/// Quantile of χ² per degree of freedom, `z` normal deviations out (Wilson and Hilferty): so far out
/// that a probability says it no more.
fn chi2_per_dof(dof: f64, z: f64) -> f64 {
    let h = 2.0 / (9.0 * dof);
    (1.0 - h + z * h.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::chi2_per_dof;

    #[test]
    fn far_quantiles_agree_with_scipy() {
        // scipy.stats.chi2.isf(norm.sf(z), dof) / dof, version 1.17. In the tail of few degrees of
        // freedom Wilson and Hilferty are a tenth off, and the limit allows twice as much.
        for (dof, z, expected) in
            [(3.0, 5.5, 12.9386), (7.0, 5.5, 7.0564), (31.0, 5.5, 3.0714), (31.0, 0.0, 0.9786)]
        {
            let found = chi2_per_dof(dof, z);
            assert!((found / expected - 1.0).abs() < 0.1, "{dof} {z}: {found}");
        }
    }
}

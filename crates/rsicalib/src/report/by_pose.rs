//! Residuals pose by pose.

use crate::estimate::{Fit, Implicit, Observations, Part};

/// Whitened residuals of poses, in their order, equation by equation: the sum of those of their samples over the root of
/// how many there are. A pose that was left out has the residual that it would have with the weight of the others.
pub(crate) fn by_pose(observations: &Observations, fit: &Fit) -> Vec<f64> {
    let (readings, k) = (&observations.readings, fit.residuals.equations.max(1));
    let weighs = |row: usize| observations.weights[row] > 0.0;
    let mut used = vec![false; readings.poses()];
    (0..readings.samples)
        .filter(|&row| weighs(row))
        .for_each(|row| used[readings.pose[row]] = true);
    let part = Part { model: &fit.model, readings, weights: None };
    let all = used.contains(&false).then(|| {
        Implicit::of(part, fit.assumed()).residuals_keeping(&fit.beta, false, Some(&[])).whitened
    });
    let (mut sums, mut counts) = (vec![0.0; used.len() * k], vec![0.0; used.len()]);
    for (row, &pose) in
        readings.pose.iter().enumerate().filter(|(row, pose)| weighs(*row) || !used[**pose])
    {
        let own = all.as_ref().filter(|_| !used[pose]).unwrap_or(&fit.residuals.whitened);
        counts[pose] += 1.0;
        let of_row = &own[row * k..(row + 1) * k];
        sums[pose * k..(pose + 1) * k].iter_mut().zip(of_row).for_each(|(sum, r)| *sum += r);
    }
    for (sums, count) in sums.chunks_exact_mut(k).zip(counts) {
        sums.iter_mut().for_each(|sum| *sum /= f64::sqrt(count));
    }
    sums
}

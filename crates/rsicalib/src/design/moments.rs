//! How the platform moves with the parameters: means of products of derivatives.

use faer::Mat;
use rayon::prelude::*;

use crate::apply::poses::short_way;

/// Means over poses and components of products of the derivatives of the platform by parameters:
/// `eᵀ M e` is the mean square of what a small change `e` of the parameters does to a component.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    /// Of x, y, z.
    pub(crate) position: Mat<f64>,
    /// Of rx, ry, rz.
    pub(crate) orientation: Mat<f64>,
}

/// Moments of the poses that `place` gives for parameters `beta`, by differences of these steps.
///
/// `columns` are the numbers of the parameters among `n`; others do not act.
pub(crate) fn moments_of(
    beta: &[f64],
    steps: &[f64],
    columns: &[usize],
    n: usize,
    place: impl Fn(&[f64]) -> Vec<[f64; 6]> + Sync,
) -> Moments {
    let slope_of = |own: usize| -> Vec<[f64; 6]> {
        let moved = |sign: f64| {
            let mut there = beta.to_vec();
            there[own] += sign * steps[own];
            place(&there)
        };
        let slope = |(a, b): (&[f64; 6], &[f64; 6])| -> [f64; 6] {
            std::array::from_fn(|i| {
                let d = if i < 3 { a[i] - b[i] } else { short_way(a[i] - b[i]) };
                d / (2.0 * steps[own])
            })
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        up.iter().zip(&down).map(slope).collect()
    };
    let slopes: Vec<Vec<[f64; 6]>> = (0..beta.len()).into_par_iter().map(slope_of).collect();
    let rows = slopes.first().map_or(0, Vec::len);
    let share = 1.0 / (3 * rows).max(1) as f64;
    let product = |first: usize| {
        let mut j = Mat::<f64>::zeros(3 * rows, n);
        for (slope, &column) in slopes.iter().zip(columns) {
            for (r, d) in slope.iter().enumerate() {
                (0..3).for_each(|i| j[(3 * r + i, column)] = d[first + i]);
            }
        }
        (j.transpose() * &j) * share
    };
    Moments { position: product(0), orientation: product(3) }
}

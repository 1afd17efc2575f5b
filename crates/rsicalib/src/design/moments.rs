//! How the platform moves with the parameters: means of products of derivatives.

use faer::Mat;

use crate::apply::poses::short_way;
use crate::numerics::workers;

/// Means over poses and components of products of the derivatives of the platform by parameters:
/// `eᵀ M e` is the mean square of what a small change `e` of the parameters does to a component.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    /// Of x, y, z.
    pub(crate) position: Mat<f64>,
    /// Of rx, ry, rz.
    pub(crate) orientation: Mat<f64>,
}

/// Derivatives of poses by one parameter, pose by pose.
pub(crate) type PoseSlopes = Vec<[f64; 6]>;

/// Derivatives of the poses that `place` gives for parameters `beta`, by some of these, by
/// differences of these steps: parameter by parameter.
pub(crate) fn slopes_of(
    beta: &[f64],
    some: &[(usize, f64)],
    place: impl Fn(&[f64]) -> Vec<[f64; 6]> + Sync,
) -> Vec<PoseSlopes> {
    let slope_of = |&(own, step): &(usize, f64)| -> PoseSlopes {
        let moved = |sign: f64| {
            let mut there = beta.to_vec();
            there[own] += sign * step;
            place(&there)
        };
        let slope = |(a, b): (&[f64; 6], &[f64; 6])| -> [f64; 6] {
            std::array::from_fn(|i| {
                let d = if i < 3 { a[i] - b[i] } else { short_way(a[i] - b[i]) };
                d / (2.0 * step)
            })
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        up.iter().zip(&down).map(slope).collect()
    };
    workers::map(some, slope_of)
}

/// Moments by derivatives of so many parameters; those that are not among `columns` do not act.
pub(crate) fn moments_of(slopes: &[PoseSlopes], columns: &[usize], n: usize) -> Moments {
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

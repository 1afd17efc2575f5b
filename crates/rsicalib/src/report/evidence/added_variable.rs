//! Added-variable plots: what is left without an effect against what the effect explains of it.
//!
//! In a linear model the residual without an effect is that with it plus the effect's columns,
//! projected off what the other parameters absorb, times its estimates. The difference of both
//! residuals is that product, and the dots lie about a line of slope one through zero.

use crate::estimate::{Fit, Observations};
use crate::report::evidence::thinned::grouped;

/// What an effect explains and what is left without it, in units of noise, and the number of
/// equations that one dot is the mean of.
pub fn added_variable(
    observations: &Observations,
    without: &Fit,
    with: &Fit,
) -> (Vec<[f64; 2]>, u64) {
    let k = with.residuals.equations;
    let (before, after) = (&without.residuals.whitened, &with.residuals.whitened);
    let live = |row: &usize| observations.weights[*row] > 0.0;
    let mut dots: Vec<[f64; 2]> = (0..observations.readings.samples)
        .filter(live)
        .flat_map(|row| row * k..(row + 1) * k)
        .map(|i| [before[i] - after[i], before[i]])
        .collect();
    dots.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (groups, size) = grouped(&dots);
    let mean = |group: &[[f64; 2]]| {
        let n = group.len() as f64;
        [0, 1].map(|i| group.iter().map(|dot| dot[i]).sum::<f64>() / n)
    };
    (groups.map(mean).collect(), size)
}

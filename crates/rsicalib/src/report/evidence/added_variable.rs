//! Added-variable plots: what is left without an effect against what the effect explains of it.
//!
//! In a linear model the residual without an effect is that with it plus the effect's columns,
//! projected off what the other parameters absorb, times its estimates. The difference of both
//! residuals is that product, and the dots lie about a line of slope one through zero.

use crate::estimate::{Fit, Observations};
use crate::numerics::order;
use crate::report::evidence::thinned::grouped;

/// An added-variable plot.
pub struct AddedVariable {
    /// What an effect explains and what is left without it, in units of noise.
    pub dots: Vec<[f64; 2]>,
    /// Equations that one dot is the mean of.
    pub per_dot: u64,
    /// Row of each dot; none where a dot is the mean of several.
    pub rows: Vec<usize>,
}

/// What an effect explains, against what is left without it.
pub fn added_variable(observations: &Observations, without: &Fit, with: &Fit) -> AddedVariable {
    let k = with.residuals.equations;
    let (before, after) = (&without.residuals.whitened, &with.residuals.whitened);
    let live = |row: &usize| observations.weights[*row] > 0.0;
    let mut dots: Vec<(usize, [f64; 2])> = (0..observations.readings.samples)
        .filter(live)
        .flat_map(|row| (row * k..(row + 1) * k).map(move |i| (row, i)))
        .map(|(row, i)| (row, [before[i] - after[i], before[i]]))
        .collect();
    order::ascending(&mut dots, |a| a.1[0]);
    let (groups, per_dot) = grouped(&dots);
    let mean = |group: &[(usize, [f64; 2])]| {
        let n = group.len() as f64;
        [0, 1].map(|i| group.iter().map(|(_, dot)| dot[i]).sum::<f64>() / n)
    };
    let rows = if per_dot == 1 { dots.iter().map(|(row, _)| *row).collect() } else { Vec::new() };
    AddedVariable { dots: groups.map(mean).collect(), per_dot, rows }
}

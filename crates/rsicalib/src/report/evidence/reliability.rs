//! Minimum detectable errors and external reliability of readings, after Baarda (A testing
//! procedure for use in geodetic networks, 1968).
//!
//! An error `∇` of one reading shifts the whitened equations of its pose by `z ∇`, `z` the column
//! of the reading in `L⁻¹A`. Of it the residuals show `zᵀ(I - H)z`, with the hat matrix `H` of the
//! fit. Where a test of noncentrality `δ0²` sees it,
//!
//! ```text
//! ∇ = δ0 / √(zᵀ(I - H)z),   external reliability = ∇ √(zᵀHz)
//! ```
//!
//! The second is the largest shift of any combination of parameters in its standard deviations.

use crate::estimate::at_fit::{AtFit, Column};
use crate::estimate::{Fit, Observations};
use crate::numerics::distributions::normal_quantile;
use crate::numerics::symmetric::SEEN;
use crate::report::evidence::shapes::Reliability;

/// Level of the test, and how often it sees the error.
const LEVEL: f64 = 0.001;
const POWER: f64 = 0.8;

/// A longer recording checks each of its readings by many others.
const MOST_SAMPLES: usize = 2000;

/// Reliability of the readings of a fit; none for a long recording.
pub fn reliability(observations: &Observations, fit: &Fit) -> Option<Reliability> {
    let readings = &observations.readings;
    if readings.samples > MOST_SAMPLES {
        return None;
    }
    let at = AtFit::new(observations, fit);
    let channels = readings.channels;
    let noncentral = normal_quantile(1.0 - 0.5 * LEVEL) + normal_quantile(POWER);
    let mut detectable = vec![vec![None; readings.poses()]; channels];
    let mut external = detectable.clone();
    for (pose, rows) in readings.rows_of_poses().iter().enumerate() {
        let live: Vec<usize> =
            rows.iter().copied().filter(|&row| observations.weights[row] > 0.0).collect();
        for channel in 0..channels {
            let mut column = Column::new(at.rank());
            for e in live.iter().flat_map(|&row| at.equations(row)) {
                column.add(&at, e, at.by_reading(e, channel));
            }
            let shown = column.left();
            if shown > SEEN * column.zz {
                let error = noncentral / shown.sqrt();
                detectable[channel][pose] = Some(error);
                external[channel][pose] = Some(error * (column.zz - shown).max(0.0).sqrt());
            }
        }
    }
    Some(Reliability { detectable, external })
}

//! What the noise of the readings makes of the columns of `G`.
//!
//! `G` of a row is taken at its readings, and turns with their noise, in step with the row's own `r`.
//! While a pose lasts, a direction of a candidate that its columns have in this alone is fitted to the
//! noise: its score has a mean, and no change is needed for it. Of `N` rows the noise makes
//!
//! ```text
//! ν_z = Σ_rows Σ_c |G_z(x + σ_c) - G_z(x)|² / Σ_rows |G_z|²                     (163)
//! ```
//!
//! of the information about a column, and a mean of its score up to `√(N ν)` deviations, where `ν` is
//! its share of what the other parameters leave. So a direction counts where that is below one. The noise
//! of a calibration is small enough for (101) to be linear. What is unsteady moves the readings as well,
//! by several times as much: `ν` grows as their misclosure does, and is taken where something is.

use crate::monitor::recent::numbered;
use crate::monitor::watching::Monitor;

/// Rows at which (163) is taken.
const TAKEN: u64 = 8;

impl Monitor {
    /// Takes (163) at some of the last rows, up to this one.
    pub(super) fn take_turned(&mut self, last: u64) {
        let step = (self.age / TAKEN).clamp(1, self.recent.most() / (2 * TAKEN));
        let first = |k: u64| last.saturating_sub(k * step);
        let rows: Vec<_> =
            (0..TAKEN).filter_map(|k| self.recent.between(first(k), first(k))).flatten().collect();
        let Some((row, ..)) = rows.first() else { return };
        let row = *row;
        let sigma = self.watched.under.noise.sigma.clone();
        let width = self.watched.order.len();
        let (mut whole, mut turned, mut loud) = (vec![0.0; width], vec![0.0; width], 0.0);
        let Self { again, watched, unsteady, whitener, scale, .. } = self;
        let scale = *scale;
        for (_, _, readings) in &rows {
            let mut changed: Vec<Vec<f64>> = vec![readings.clone()];
            for (c, sigma) in sigma.iter().enumerate() {
                let mut other = readings.clone();
                other[c] += sigma * scale.sqrt();
                changed.push(other);
            }
            let all: Vec<_> = changed.into_iter().map(|readings| (row, None, readings)).collect();
            let mut here = Vec::new();
            again.each(watched, &numbered(&all), |place, r, g| {
                if place == 0 {
                    loud += watched.loudness(unsteady, g, r.len(), scale);
                }
                whitener.row(watched, unsteady, scale, row, r, g);
                if place == 0 {
                    here = g.to_vec();
                }
                for (k, (g, here)) in g.iter().zip(&here).enumerate() {
                    let sum = if place == 0 { &mut whole } else { &mut turned };
                    let by = if place == 0 { *g } else { g - here };
                    sum[k % width] += by * by;
                }
            });
        }
        let louder = 1.0 + loud / rows.len() as f64;
        let share = |(turned, whole): (&f64, &f64)| {
            if *whole > 0.0 { louder * turned / whole } else { 0.0 }
        };
        self.score.turned = turned.iter().zip(&whole).map(share).collect();
    }
}

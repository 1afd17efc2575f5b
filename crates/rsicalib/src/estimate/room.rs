//! How much room an explanation leaves the readings: what the density of them has beside its exponent.
//!
//! A closure with play says of a reading how likely it is, and not what it is. An effect that makes a
//! joint stand still where it was read explains then whatever play has done to that joint: `χ²` falls
//! with each pose, and the effect says less of the readings the more it explains. Their density tells.
//! With readings that are beforehand anywhere where the session has been, normal with the variances
//! `T`, and closures that hold, it is
//!
//! ```text
//! -2 ln p(a) = wᵀ S⁻¹ w + ln |S| - ln |S_T| + …,    S = A Σ Aᵀ + Π,   S_T = A T Aᵀ + Π    (168)
//! ```
//!
//! and where something is unknown in one pose alone, with `B` of (59), `ln |S| + ln |Bᵀ S⁻¹ B|` in place
//! of `ln |S|`, and the same of `S_T`. Without play both change alike with `A`, and nothing is left of
//! it. It is of the sample as it is weighed: `Π` of one seating, `Σ` over its repeats.
//!
//! A first-order score knows nothing of that: a column that follows a reading follows what play has done
//! to it, and so the residual. Columns are therefore those of readings that are moved onto the closures
//! as if play were as little as it is beside `T`,
//!
//! ```text
//! ã = â - T Aᵀ S_T⁻¹ f(â)                                                                (169)
//! ```
//!
//! What another instrument measures errs by itself, and moves no joint: there `Π` is its noise, and
//! neither is asked for.

use nalgebra::{Cholesky, DMatrix};

use crate::estimate::fitted::Fit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::settle::settled;
use crate::estimate::spread::{seats, spread};
use crate::model::{Want, Workspace};
use crate::numerics::lanes::WIDTH;

/// `ln |S| - ln |S_T|` of each sample, (168); zero of one that does not count.
pub(crate) struct Rooms {
    /// The noise with which they are computed.
    noise: Noise,
    /// Variance of the readings of each channel over the session.
    spread: Vec<f64>,
    of_samples: Vec<f64>,
}

impl Rooms {
    /// At a fit; none where no closure has play.
    pub(crate) fn of(session: &Observations, fit: &Fit) -> Option<Self> {
        let noise = fit.assumed();
        seats(&fit.model, &noise).then(|| {
            let spread = spread(&session.readings);
            let of_samples = of_samples(session, fit, &noise, &spread);
            Self { noise, spread, of_samples }
        })
    }

    /// What another fit of the session leaves less of it than this one, over the samples that count in
    /// both. What larger noise does to `|S|` is charged where that is said, (75).
    pub(crate) fn price(&self, session: &Observations, fit: &Fit) -> f64 {
        let other = of_samples(session, fit, &self.noise, &self.spread);
        let both = self.of_samples.iter().zip(&other).filter(|(a, b)| **a != 0.0 && **b != 0.0);
        both.map(|(before, after)| after - before).sum()
    }
}

fn of_samples(session: &Observations, fit: &Fit, noise: &Noise, spread: &[f64]) -> Vec<f64> {
    let (model, readings) = (&fit.model, &*session.readings);
    let part = Part { model, readings, weights: None };
    let play = noise.of_closures(model).whole();
    let (k, c, n) = (model.rows(), spread.len(), model.pose_unknowns());
    let adjusted = fit.adjusted_of(readings);
    let mut ws = Workspace::default();
    let mut rooms = vec![0.0; readings.samples];
    for block in 0..readings.blocks().len() {
        let known = adjusted.map(|all| all[block * part.stride()..][..part.stride()].to_vec());
        let at = known.unwrap_or_else(|| settled(&part, noise, block, &fit.beta));
        model.evaluate(readings, block, &at, &fit.beta, Want { x: false, a: true }, &mut ws);
        let meta = &readings.blocks()[block];
        for lane in 0..meta.live.min(WIDTH) {
            let row = meta.rows[lane];
            let weight = session.weights[row];
            if weight == 0.0 {
                continue;
            }
            let a = DMatrix::from_fn(k, c, |i, j| ws.a[i * c + j].0[lane]);
            let b = DMatrix::from_fn(k, n, |i, j| ws.b[i * n + j].0[lane]);
            let with = |variance: &dyn Fn(usize) -> f64| {
                let mut scaled = a.clone();
                scaled.column_iter_mut().enumerate().for_each(|(j, mut column)| {
                    column *= variance(j);
                });
                let mut s = &scaled * a.transpose();
                play.iter().enumerate().for_each(|(e, play)| s[(e, e)] += play);
                volume(s, &b)
            };
            let of_noise = |j: usize| (noise.sigma[j] / weight).powi(2);
            let ratio = with(&of_noise).zip(with(&|j| spread[j].max(of_noise(j))));
            rooms[row] = ratio.map_or(0.0, |(noise, spread)| noise - spread);
        }
    }
    rooms
}

/// `ln |S| + ln |Bᵀ S⁻¹ B|`; none where one is singular.
fn volume(s: DMatrix<f64>, b: &DMatrix<f64>) -> Option<f64> {
    let of = |factor: &Cholesky<f64, nalgebra::Dyn>| {
        2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
    };
    let factor = Cholesky::new(s)?;
    if b.ncols() == 0 {
        return Some(of(&factor));
    }
    let inner = Cholesky::new(b.transpose() * factor.solve(b))?;
    Some(of(&factor) + of(&inner))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::volume;

    #[test]
    fn a_place_that_is_unknown_takes_its_part_of_the_equations() {
        // Two equations f = (a₁ - ξ, a₂ - ξ): what is left is a₁ - a₂, whose variance is that of both.
        let variances = DMatrix::from_diagonal(&DVector::from_vec(vec![0.3, 1.7]));
        let b = DMatrix::from_element(2, 1, -1.0);
        let left = volume(variances, &b).expect("a covariance");
        assert!((left - 2.0_f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn a_singular_covariance_has_no_volume() {
        assert!(volume(DMatrix::from_element(2, 2, 1.0), &DMatrix::zeros(2, 0)).is_none());
    }
}

//! Draws of normal numbers and of what is made of them.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, SymmetricEigen};

use crate::numerics::distributions::chi2_quantile;
use crate::numerics::random::Random;

/// A stream of draws, one at a time.
#[derive(Debug, Clone)]
pub struct Draws {
    random: Random,
    waiting: Option<f64>,
}

impl Draws {
    /// The stream of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { random: Random::new(seed), waiting: None }
    }

    /// A number between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        self.random.uniform(0.0, 1.0)
    }

    /// A normal number, by Box & Muller (1958).
    pub fn normal(&mut self) -> f64 {
        if let Some(waiting) = self.waiting.take() {
            return waiting;
        }
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (sin, cos) = (TAU * self.uniform()).sin_cos();
        self.waiting = Some(radius * sin);
        radius * cos
    }

    /// What normal numbers are multiplied by to be Student's: `√(ν/χ²)`; 1 where `ν` is infinite.
    pub fn student_scale(&mut self, dof: f64) -> f64 {
        if !dof.is_finite() {
            return 1.0;
        }
        let chi2 = chi2_quantile(self.uniform(), dof);
        (dof / chi2.max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// `R` with `R Rᵀ` a covariance, whose parts may differ by many orders of magnitude; what is negative by
/// rounding is zero.
#[must_use]
pub fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let sd: Vec<f64> = covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect();
    let unit = DMatrix::from_fn(sd.len(), sd.len(), |i, j| {
        let by = sd[i] * sd[j];
        if by > 0.0 { covariance[(i, j)] / by } else { 0.0 }
    });
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(unit);
    DMatrix::from_fn(sd.len(), sd.len(), |i, k| {
        sd[i] * eigenvectors[(i, k)] * eigenvalues[k].max(0.0).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_gives_its_covariance_however_the_units_differ() {
        let root = DMatrix::from_row_slice(3, 2, &[1e3, 0.0, 2e-6, 1e-6, -0.4, 0.9]);
        let covariance = &root * root.transpose();
        let found = square_root(&covariance);
        let again = &found * found.transpose();
        for i in 0..3 {
            for j in 0..3 {
                // Of the two deviations, each with the rounding of an eigenproblem of three.
                let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
                let off = again[(i, j)] - covariance[(i, j)];
                assert!(off.abs() < 1e-13 * size, "{i}, {j}: off by {off} of {size}");
            }
        }
    }

    #[test]
    fn few_degrees_of_freedom_have_the_tails_of_student() {
        let (mut draws, n, dof) = (Draws::new(5), 40_000, 6.0);
        // P(|t| > 2.447) of 6 degrees of freedom is 5 %, from tables.
        let beyond = (0..n).filter(|_| {
            let t = draws.normal() * draws.student_scale(dof);
            t.abs() > 2.447
        });
        let share = beyond.count() as f64 / f64::from(n);
        assert!((share - 0.05).abs() < 4.0 * (0.05 * 0.95 / f64::from(n)).sqrt(), "{share}");
    }
}

//! Poses that make variances small, beside poses visited already.
//!
//! ```text
//! tr Ω C → least,   C' = C - C Wᵀ (I + W C Wᵀ)⁻¹ W C                      (92)
//! ```
//!
//! with `Ω` the mean of `JᵀJ` over the workspace, `J` the derivative of the platform's position by
//! the parameters: then `tr Ω C` is the mean variance of the platform (V-optimal). Without `Ω`, the
//! determinant of `C` is made small.

use faer::Mat;

use crate::design::contest::{Rows, forward, inverse_of, spread};

/// What is known after some poses.
#[derive(Debug, Clone)]
pub(crate) struct Precision {
    /// `C`, row by row.
    inverse: Vec<f64>,
    omega: Option<Mat<f64>>,
    /// `C Ω C`, row by row.
    product: Vec<f64>,
    /// `tr Ω C`.
    trace: f64,
    /// `ln det C`, from the old poses.
    log_volume: f64,
    n: usize,
}

impl Precision {
    /// Of information `N`, priors included.
    #[must_use]
    pub fn new(information: &Mat<f64>, omega: Option<Mat<f64>>) -> Self {
        let n = information.nrows();
        let c = inverse_of(information);
        let inverse = (0..n * n).map(|ij| c[(ij / n, ij % n)]).collect();
        let mut made = Self { inverse, omega, product: Vec::new(), trace: 0.0, log_volume: 0.0, n };
        made.multiply();
        made
    }

    fn multiply(&mut self) {
        let n = self.n;
        self.trace = self.trace();
        self.product = match &self.omega {
            None => Vec::new(),
            Some(omega) => {
                let c = self.covariance();
                let product = &c * omega * &c;
                (0..n * n).map(|ij| product[(ij / n, ij % n)]).collect()
            }
        };
    }

    /// `C`.
    #[must_use]
    pub fn covariance(&self) -> Mat<f64> {
        Mat::from_fn(self.n, self.n, |i, j| self.inverse[i * self.n + j])
    }

    /// `tr Ω C`; zero for the determinant.
    #[must_use]
    pub fn trace(&self) -> f64 {
        let of = |omega: &Mat<f64>| -> f64 {
            let n = self.n;
            (0..n * n).map(|ij| omega[(ij / n, ij % n)] * self.inverse[ij]).sum()
        };
        self.omega.as_ref().map_or(0.0, of)
    }

    /// By how much a pose makes it smaller: `tr Ω C`, or `ln det C`.
    #[must_use]
    pub fn gain(&self, w: Rows<'_>) -> f64 {
        let (n, k) = (self.n, w.len().checked_div(self.n).unwrap_or(0));
        let (_, factor) = spread(w, &self.inverse, 1.0);
        if self.omega.is_none() {
            return (0..k).map(|e| 2.0 * factor[e * k + e].ln()).sum();
        }
        // tr((I + W C Wᵀ)⁻¹ W C Ω C Wᵀ), column by column of Wᵀ.
        let mut inner = vec![0.0; k * k];
        for (i, line) in self.product.chunks_exact(n.max(1)).enumerate() {
            for (f, row) in w.chunks_exact(n.max(1)).enumerate() {
                let along: f64 = line.iter().zip(row).map(|(a, b)| a * b).sum();
                for e in 0..k {
                    inner[e * k + f] += w[e * n + i] * along;
                }
            }
        }
        // L⁻¹ M L⁻ᵀ has the same trace as (L Lᵀ)⁻¹ M.
        for f in 0..k {
            let mut column: Vec<f64> = (0..k).map(|e| inner[e * k + f]).collect();
            forward(&factor, &mut column);
            (0..k).for_each(|e| inner[e * k + f] = column[e]);
        }
        let mut trace = 0.0;
        for e in 0..k {
            let row = &mut inner[e * k..(e + 1) * k];
            forward(&factor, row);
            trace += row[e];
        }
        trace
    }

    /// `ln tr Ω C`, or `ln det C` from an arbitrary zero.
    #[must_use]
    pub fn measure(&self) -> f64 {
        match self.omega {
            Some(_) => self.trace().max(f64::MIN_POSITIVE).ln(),
            None => self.log_volume,
        }
    }

    /// [`Precision::measure`] with one more pose.
    #[must_use]
    pub fn measure_with(&self, w: Rows<'_>) -> f64 {
        let gain = self.gain(w);
        match self.omega {
            Some(_) => (self.trace - gain).max(f64::MIN_POSITIVE).ln(),
            None => self.log_volume - gain,
        }
    }

    /// Takes one more pose, (92).
    pub fn visit(&mut self, w: Rows<'_>) {
        let (n, k) = (self.n, w.len().checked_div(self.n).unwrap_or(0));
        let (mut u, factor) = spread(w, &self.inverse, 1.0);
        self.log_volume -= (0..k).map(|e| 2.0 * factor[e * k + e].ln()).sum::<f64>();
        for i in 0..n {
            forward(&factor, &mut u[i * k..(i + 1) * k]);
        }
        for i in 0..n {
            for j in 0..n {
                let less: f64 = (0..k).map(|e| u[i * k + e] * u[j * k + e]).sum();
                self.inverse[i * n + j] -= less;
            }
        }
        self.multiply();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;
    use crate::numerics::symmetric::invert;

    #[test]
    fn what_a_pose_gains_is_the_difference_of_two_inverses() {
        let mut random = Random::new(77);
        let mut draw =
            |rows, columns| Mat::from_fn(rows, columns, |_, _| random.uniform(-1.0, 1.0));
        let (old, w, half) = (draw(9, 4), draw(2, 4), draw(4, 4));
        let omega = half.transpose() * &half;
        let information = old.transpose() * &old;
        let more = &information + w.transpose() * &w;
        let trace = |m: &Mat<f64>| -> f64 { (0..4).map(|i| m[(i, i)]).sum() };
        let of = |m: &Mat<f64>| trace(&(&omega * invert(m).0));
        let rows: Vec<f64> = (0..8).map(|i| w[(i / 4, i % 4)]).collect();
        let mut found = Precision::new(&information, Some(omega.clone()));
        assert!((found.trace() / of(&information) - 1.0).abs() < 1e-7);
        assert!((found.gain(&rows) / (of(&information) - of(&more)) - 1.0).abs() < 1e-7);
        found.visit(&rows);
        assert!((found.trace() / of(&more) - 1.0).abs() < 1e-7);
        let log = |m: &Mat<f64>| m.determinant().ln();
        let volume = Precision::new(&information, None);
        assert!((volume.gain(&rows) / (log(&more) - log(&information)) - 1.0).abs() < 1e-7);
    }
}

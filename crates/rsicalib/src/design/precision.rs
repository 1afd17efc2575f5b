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

use crate::design::choice::Measure;
use crate::design::contest::{Rows, factor, flat, forward, inverse_of, spread};
use crate::design::linearised::Whitened;

/// What is known after some poses.
#[derive(Debug, Clone)]
pub(crate) struct Precision {
    /// `N` = `C⁻¹`.
    pub(crate) information: Mat<f64>,
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
        let mut made = Self {
            information: information.clone(),
            inverse: flat(&inverse_of(information)),
            omega,
            product: Vec::new(),
            trace: 0.0,
            log_volume: 0.0,
            n: information.nrows(),
        };
        made.multiply();
        made
    }

    fn multiply(&mut self) {
        let n = self.n;
        let Some(omega) = &self.omega else { return };
        self.trace = (0..n * n).map(|ij| omega[(ij / n, ij % n)] * self.inverse[ij]).sum();
        let c = Mat::from_fn(n, n, |i, j| self.inverse[i * n + j]);
        self.product = flat(&(&c * omega * &c));
    }

    /// By how much a pose makes it smaller: `tr Ω C`, or `ln det C`.
    #[must_use]
    pub fn gain(&self, w: Rows<'_>) -> f64 {
        let k = w.len().checked_div(self.n).unwrap_or(0);
        let mut spread = self.between(w, &self.inverse);
        (0..k).for_each(|e| spread[e * k + e] += 1.0);
        factor(&mut spread, k);
        if self.omega.is_none() {
            return (0..k).map(|e| 2.0 * spread[e * k + e].ln()).sum();
        }
        // tr((I + W C Wᵀ)⁻¹ W C Ω C Wᵀ), and L⁻¹ M L⁻ᵀ has the same trace as (L Lᵀ)⁻¹ M.
        let mut inner = self.between(w, &self.product);
        let mut column = vec![0.0; k];
        for f in 0..k {
            (0..k).for_each(|e| column[e] = inner[e * k + f]);
            forward(&spread, &mut column);
            (0..k).for_each(|e| inner[e * k + f] = column[e]);
        }
        let trace = inner.chunks_exact_mut(k.max(1)).enumerate().map(|(e, row)| {
            forward(&spread, row);
            row[e]
        });
        trace.sum()
    }

    /// `W S Wᵀ` of a symmetric `S`, given row by row.
    fn between(&self, w: Rows<'_>, s: &[f64]) -> Vec<f64> {
        let (n, k) = (self.n, w.len().checked_div(self.n).unwrap_or(0));
        let mut out = vec![0.0; k * k];
        let mut line = vec![0.0; n];
        for (e, row) in w.chunks_exact(n.max(1)).enumerate() {
            // Row by row of `S`: sums that do not wait for each other.
            line.fill(0.0);
            for (weight, s) in row.iter().zip(s.chunks_exact(n)) {
                line.iter_mut().zip(s).for_each(|(l, s)| *l += weight * s);
            }
            for (f, other) in w.chunks_exact(n.max(1)).enumerate() {
                out[e * k + f] = line.iter().zip(other).map(|(l, o)| l * o).sum();
            }
        }
        out
    }

    /// `ln tr Ω C`, or `ln det C` from an arbitrary zero.
    #[must_use]
    pub fn measure(&self) -> f64 {
        match self.omega {
            Some(_) => self.trace.max(f64::MIN_POSITIVE).ln(),
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
        self.information += gram_of(w, n);
        self.multiply();
    }

    /// Takes a visited pose back. `C` is inverted anew: of few poses each may tell what no other does.
    pub fn leave(&mut self, w: Rows<'_>) {
        self.information -= gram_of(w, self.n);
        self.inverse = flat(&inverse_of(&self.information));
        let k = w.len().checked_div(self.n).unwrap_or(0);
        let (_, factor) = spread(w, &self.inverse, 1.0);
        self.log_volume += (0..k).map(|e| 2.0 * factor[e * k + e].ln()).sum::<f64>();
        self.multiply();
    }
}

/// `WᵀW` of the rows of one pose.
fn gram_of(rows: Rows<'_>, n: usize) -> Mat<f64> {
    let w = Mat::from_fn(rows.len().checked_div(n).unwrap_or(0), n, |e, i| rows[e * n + i]);
    w.transpose() * &w
}

/// What is known, and the rows of candidates.
#[derive(Debug, Clone)]
pub(crate) struct Known<'a> {
    pub(crate) precision: Precision,
    pub(crate) rows: &'a Whitened,
}

impl Measure for Known<'_> {
    fn now(&self) -> f64 {
        self.precision.measure()
    }

    fn with(&self, candidate: usize) -> f64 {
        self.precision.measure_with(self.rows.of(candidate))
    }

    fn take(&mut self, candidate: usize) {
        self.precision.visit(self.rows.of(candidate));
    }

    fn leave(&mut self, candidate: usize) {
        self.precision.leave(self.rows.of(candidate));
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
        assert!((found.trace / of(&information) - 1.0).abs() < 1e-7);
        assert!((found.gain(&rows) / (of(&information) - of(&more)) - 1.0).abs() < 1e-7);
        found.visit(&rows);
        assert!((found.trace / of(&more) - 1.0).abs() < 1e-7);
        found.leave(&rows);
        assert!((found.trace / of(&information) - 1.0).abs() < 1e-7);
        let log = |m: &Mat<f64>| m.determinant().ln();
        let mut volume = Precision::new(&information, None);
        assert!((volume.gain(&rows) / (log(&more) - log(&information)) - 1.0).abs() < 1e-7);
        volume.visit(&rows);
        volume.leave(&rows);
        assert!(volume.measure().abs() < 1e-7);
    }
}

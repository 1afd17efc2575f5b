//! Correlation of neighbouring samples: the filter that makes the residual white.
//!
//! The residual follows an autoregression of second order,
//!
//! ```text
//! y_t = (r_t - φ₁ r_{t-1} - φ₂ r_{t-2}) / √v                             (103)
//! ```
//!
//! with `φ` and `v` of Levinson's recursion from the correlations of neighbours at distances one and
//! two. These are learned from the residual; the calibration gives where they begin. The
//! derivatives pass through the same filter. Mains hum, a filter before the converter and
//! noise with rounding on top are close to such a process.

use crate::monitor::kept::keep;
use crate::monitor::state::{axpy, dot};

/// Order of the autoregression.
const ORDER: usize = 2;

/// Values after which older ones fade.
const MEMORY: f64 = 1e6;

/// Residuals are cut off here, in standard deviations, before they are learned from.
const CLIP: f64 = 4.0;

/// Largest partial correlation.
const LARGEST_CORRELATION: f64 = 0.98;

/// The filter, and what it has learned.
#[derive(Debug, Clone)]
pub(crate) struct Whitening {
    equations: usize,
    /// Number of values, and sums of products, at distances 0, 1 and 2.
    weight: [f64; ORDER + 1],
    products: [f64; ORDER + 1],
    /// Residuals of the last samples, the newest first.
    residuals: [Vec<f64>; ORDER + 1],
    /// `r`, then `G`, of the last samples, the newest first.
    past: [Vec<f64>; ORDER + 1],
    /// Number of samples without a gap between them, the newest counted, at most `ORDER + 1`.
    known: usize,
    /// Distance of the neighbour of the next row in rows, if rows are missing between; else 0.
    distance: u64,
    /// For no, one and two neighbours: coefficients and `1/√v`.
    filters: [([f64; ORDER], f64); ORDER + 1],
}

impl Whitening {
    /// Begins with a correlation of neighbours, as if `weight` values had shown it. A sample has
    /// `columns` derivatives of each equation.
    pub(crate) fn new(correlation: f64, weight: f64, equations: usize, columns: usize) -> Self {
        let mut own = Self {
            equations,
            weight: [weight; ORDER + 1],
            products: std::array::from_fn(|lag| weight * correlation.powi(lag as i32)),
            residuals: std::array::from_fn(|_| vec![0.0; equations]),
            past: std::array::from_fn(|_| vec![0.0; equations * (columns + 1)]),
            known: 0,
            distance: 0,
            filters: [([0.0; ORDER], 1.0); ORDER + 1],
        };
        own.update();
        own
    }

    /// Correlation of neighbouring samples, as learned so far.
    pub(crate) fn correlation(&self) -> f64 {
        self.at(1)
    }

    fn at(&self, lag: usize) -> f64 {
        self.products[lag] * self.weight[0] / (self.weight[lag] * self.products[0])
    }

    /// Levinson's recursion.
    fn update(&mut self) {
        let one = self.at(1).clamp(-LARGEST_CORRELATION, LARGEST_CORRELATION);
        let first = 1.0 - one * one;
        let second =
            ((self.at(2) - one * one) / first).clamp(-LARGEST_CORRELATION, LARGEST_CORRELATION);
        let both = first * (1.0 - second * second);
        self.filters[1] = ([one, 0.0], 1.0 / first.sqrt());
        self.filters[2] = ([one * (1.0 - second), second], 1.0 / both.sqrt());
    }

    /// Forgets the neighbours: a gap of unknown length.
    pub(crate) fn interrupt(&mut self) {
        (self.known, self.distance) = (0, 0);
    }

    /// Some rows are missing: the next one has its neighbour that much farther away.
    pub(crate) fn skip(&mut self, missing: u64) {
        self.distance = if self.known > 0 { missing + 1 } else { 0 };
        self.known = 0;
    }

    /// Coefficients and `1/√v` for the next row.
    fn present(&self) -> ([f64; ORDER], f64) {
        if self.distance == 0 {
            return self.filters[self.known.min(ORDER)];
        }
        let far = self
            .at(1)
            .clamp(-LARGEST_CORRELATION, LARGEST_CORRELATION)
            .powi(self.distance.min(1000) as i32);
        ([far, 0.0], 1.0 / (1.0 - far * far).sqrt())
    }

    /// Counts from a state that has moved by `shift`.
    pub(crate) fn recentre(&mut self, shift: &[f64]) {
        let k = self.equations;
        for past in &mut self.past {
            let (r, g) = past.split_at_mut(k);
            let columns = g.len() / k;
            for (r, g) in r.iter_mut().zip(g.chunks_exact(columns.max(1))) {
                *r -= dot(shift, g);
            }
        }
    }

    /// Passes `r` and `G` of the next sample through the filter, in place.
    #[inline(always)]
    pub(crate) fn filter(&mut self, r: &mut [f64], g: &mut [f64]) {
        let k = self.equations;
        let (factors, inverse) = self.present();
        self.distance = 0;
        self.past.rotate_right(1);
        let (now, before) = self.past.split_at_mut(1);
        now[0][..k].copy_from_slice(r);
        now[0][k..].copy_from_slice(g);
        for (factor, past) in factors.iter().zip(before) {
            if *factor != 0.0 {
                axpy(-factor, &past[..k], r);
                axpy(-factor, &past[k..], g);
            }
        }
        if inverse != 1.0 {
            r.iter_mut().chain(g).for_each(|value| *value *= inverse);
        }
        self.known = (self.known + 1).min(ORDER + 1);
    }

    /// Learns from the residual that `expected` leaves of the newest sample: called once after
    /// each [`Whitening::filter`].
    pub(crate) fn learn(&mut self, expected: impl Fn(&[f64]) -> f64) {
        let k = self.equations;
        self.residuals.rotate_right(1);
        let (r, g) = self.past[0].split_at(k);
        let columns = g.len() / k;
        for (i, residual) in self.residuals[0].iter_mut().enumerate() {
            let left = r[i] - expected(&g[i * columns..(i + 1) * columns]);
            *residual = left.clamp(-CLIP, CLIP);
        }
        for lag in 0..self.known {
            let pairs = self.residuals[0].iter().zip(&self.residuals[lag]);
            self.products[lag] += pairs.map(|(a, b)| a * b).sum::<f64>();
            self.weight[lag] += k as f64;
            if self.weight[lag] > MEMORY {
                let fade = MEMORY / self.weight[lag];
                self.weight[lag] *= fade;
                self.products[lag] *= fade;
            }
        }
        self.update();
    }
}

impl Whitening {
    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = usize> {
        self.residuals.iter().chain(&self.past).map(Vec::len)
    }
}

keep!(Whitening: weight, products, residuals, past, known, distance, filters);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;

    /// A stream with correlation `rho` of neighbours, and white noise of variance `white` on it.
    fn stream(rho: f64, white: f64, seed: u64) -> impl FnMut() -> f64 {
        let mut random = Random::new(seed);
        // Twelve uniforms: variance one, close to normal.
        let mut normal = move || (0..12).map(|_| random.uniform(-0.5, 0.5)).sum::<f64>();
        let mut slow = 0.0;
        move || {
            slow = rho * slow + (1.0 - rho * rho).sqrt() * normal();
            slow * (1.0 - white).sqrt() + white.sqrt() * normal()
        }
    }

    #[test]
    fn a_correlated_residual_becomes_white_with_unit_variance() {
        for (rho, white) in [(0.0, 0.0), (0.6, 0.0), (0.6, 0.3), (-0.4, 0.0)] {
            let (mut draw, mut filter) = (stream(rho, white, 7), Whitening::new(0.0, 200.0, 1, 0));
            let (mut out, mut none) = (Vec::new(), []);
            for row in 0..40_000 {
                let mut r = [draw()];
                filter.filter(&mut r, &mut none);
                filter.learn(|_| 0.0);
                if row >= 4_000 {
                    out.push(r[0]);
                }
            }
            let mean = |f: &dyn Fn(usize) -> f64| {
                (20..out.len()).map(f).sum::<f64>() / (out.len() - 20) as f64
            };
            let variance = mean(&|i| out[i] * out[i]);
            // 36000 values: standard deviations 0.0075 of the variance, 0.0053 of a correlation.
            // Second order does not follow white noise on top of a slow one exactly.
            assert!((variance - 1.0).abs() < 0.03, "{rho} {white}: {variance}");
            for lag in 1..8 {
                let correlation = mean(&|i| out[i] * out[i - lag]);
                assert!(correlation.abs() < 0.03, "{rho} {white} {lag}: {correlation}");
            }
        }
    }

    #[test]
    fn a_gap_separates_neighbours() {
        let mut filter = Whitening::new(0.5, 1e9, 1, 1);
        let pass = |filter: &mut Whitening, value: f64| {
            let (mut r, mut g) = ([value], [value]);
            filter.filter(&mut r, &mut g);
            filter.learn(|_| 0.0);
            assert_eq!(r, g);
            r[0]
        };
        assert_eq!(pass(&mut filter, 1.0), 1.0);
        // (1 - 0.5) / √0.75
        assert!((pass(&mut filter, 1.0) - 0.577_350_269).abs() < 1e-6);
        filter.interrupt();
        assert_eq!(pass(&mut filter, 1.0), 1.0);
        filter.skip(1);
        // Correlated by 0.25 with the row before the one that is missing: 0.75 / √(1 - 0.0625).
        assert!((pass(&mut filter, 1.0) - 0.774_596_669).abs() < 1e-6);
    }
}

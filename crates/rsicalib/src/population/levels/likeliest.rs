//! The variances that are likeliest.
//!
//! ```text
//! A_lm = û_lᵀ T_l⁻¹ û_l(û_m),   Σ_m A_lm Δτ_m²/τ_m² = (Q_l - k_l) Q_l/k_l
//! ```
//!
//! `û_l(û_m)` is what (161) makes of the deviations `û_m`, taken for readings. This is a step of
//! Newton for `k/Q = 1`: `A` is the mean of the observed and the expected information (Gilmour,
//! Thompson and Cullis 1995), and of groups that are known alike `k/Q` is straight in `τ²`. A step
//! is halved until the restricted likelihood grows; where it does not, (124) itself says where it does.

use faer::Mat;

use crate::numerics::symmetric::{dot, invert};
use crate::population::levels::solve::{At, Tree};

/// Steps at most; a handful are usual.
const ROUNDS: usize = 100;

/// `ln τ²` changes by less than this where steps have converged.
const CONVERGED: f64 = 1e-6;

/// Parts of a step of Newton, and of (124), halved in turn, that are tried at most: the second is one
/// in which the likelihood grows.
const HALVES: [usize; 2] = [4, 12];

/// Twice the logarithm of the likelihood grows by this part of what its slope says, or more (Armijo 1966).
const ENOUGH: f64 = 1e-4;

/// A likelihood that is less by this is the same: an interval of 95 % is where it is less by 3.8.
const SAME: f64 = 1e-9;

/// Largest `ln τ²`: its square is still a number.
const LARGEST: f64 = 350.0;

impl Tree {
    /// `A` of some ranks and classes.
    fn information(&self, at: &At, of: &[usize]) -> Mat<f64> {
        let n = self.n();
        let mut found = Mat::<f64>::zeros(of.len(), of.len());
        let mut deviation = vec![0.0; n];
        for (a, &one) in of.iter().enumerate() {
            let (rank, class) = (one / self.classes, one % self.classes);
            let (root, all) = (&at.eliminated.roots[rank], &at.deviations[rank]);
            let mut told = vec![0.0; self.told.len()];
            let units = told.chunks_mut(n).zip(self.information.chunks(n * n));
            for ((told, h), &group) in units.zip(&self.grouping.of_unit[rank]) {
                for (i, d) in deviation.iter_mut().enumerate() {
                    let own = self.class[i] == class;
                    *d = if own { root[i] * all[n * group + i] } else { 0.0 };
                }
                for (i, told) in told.iter_mut().enumerate() {
                    *told = dot(&h[i * n..(i + 1) * n], &deviation);
                }
            }
            let seen = self.solve(&at.eliminated, told).deviations;
            for (b, &other) in of.iter().enumerate() {
                let (rank, class) = (other / self.classes, other % self.classes);
                let pairs = at.deviations[rank].chunks(n).zip(seen[rank].chunks(n));
                let product = |(w, seen): (&[f64], &[f64])| {
                    let own = (0..n).filter(|&i| self.class[i] == class);
                    own.map(|i| w[i] * seen[i]).sum::<f64>()
                };
                let sum: f64 = pairs.map(product).sum();
                found[(a, b)] += 0.5 * sum;
                found[(b, a)] += 0.5 * sum;
            }
        }
        found
    }

    /// Steps of `ln τ²`, but for one that is held: that of Newton, and (124). The likelihood grows where
    /// the second begins.
    fn steps(&self, ln: &[f64], at: &At, held: Option<usize>) -> [Vec<f64>; 2] {
        let moves = |&one: &usize| {
            let Some(least) = self.least[one] else { return false };
            held != Some(one) && (at.q[one] > at.k[one] || ln[one] > least)
        };
        let free: Vec<usize> = (0..ln.len()).filter(moves).collect();
        let ratio = |one: usize| at.q[one] / at.k[one].max(f64::MIN_POSITIVE);
        let within = |one: usize, step: f64| {
            let least = self.least[one].unwrap_or(ln[one]);
            (ln[one] + step).max(least).min(LARGEST) - ln[one]
        };
        let (mut newton, mut simple) = (vec![0.0; ln.len()], vec![0.0; ln.len()]);
        if free.is_empty() {
            return [newton, simple];
        }
        let a = self.information(at, &free);
        let inverse = invert(&a).0;
        let right: Vec<f64> =
            free.iter().map(|&one| (at.q[one] - at.k[one]) * ratio(one)).collect();
        for (i, &one) in free.iter().enumerate() {
            let change: f64 = (0..free.len()).map(|j| inverse[(i, j)] * right[j]).sum();
            // (124) itself, where a rank shows no deviation at all.
            simple[one] = within(one, ratio(one).ln());
            let known = a[(i, i)] > 0.0 && change.is_finite();
            let step = if known { change.max(-1.0).ln_1p() } else { simple[one] };
            newton[one] = within(one, step);
        }
        [newton, simple]
    }

    /// The likeliest variances from some on, but for one that is held.
    pub(super) fn fit(&self, mut ln: Vec<f64>, held: Option<usize>) -> (Vec<f64>, At) {
        let mut at = self.at(&ln);
        for _ in 0..ROUNDS {
            let steps = self.steps(&ln, &at, held);
            let mut tries = steps.iter().zip(HALVES);
            let Some(next) = tries.find_map(|(step, halves)| self.along(&ln, &at, step, halves))
            else {
                break;
            };
            let moved = ln.iter().zip(&next.0).map(|(ln, next)| (next - ln).abs());
            let moved = moved.fold(0.0, f64::max);
            (ln, at) = next;
            if moved < CONVERGED {
                break;
            }
        }
        (ln, at)
    }

    /// Where the likelihood has grown along a step, or a step ends that changes nothing.
    fn along(&self, ln: &[f64], at: &At, step: &[f64], halves: usize) -> Option<(Vec<f64>, At)> {
        let rise = slope(at, step);
        let small = step.iter().all(|s| s.abs() < CONVERGED);
        if !small && (rise <= 0.0 || rise.is_nan()) {
            return None;
        }
        (0..halves).map(|half| 0.5_f64.powi(half as i32)).find_map(|part| {
            let next: Vec<f64> = ln.iter().zip(step).map(|(ln, s)| ln + part * s).collect();
            let found = self.at(&next);
            let enough = self.gained(&found, at) >= ENOUGH * part * rise - SAME;
            (small || enough).then_some((next, found))
        })
    }
}

/// Twice the slope of the restricted likelihood along a step of `ln τ²`.
fn slope(at: &At, step: &[f64]) -> f64 {
    at.q.iter().zip(&at.k).zip(step).map(|((q, k), s)| (q - k) * s).sum()
}

//! Thresholds from a promised rate of false alarms.
//!
//! A window of level `z` is tested every `s_z` samples for each of `J` candidates. With
//! probability `p_z` of exceeding its threshold by chance, the expected number of false alarms
//! per sample is at most `Σ_z J p_z / s_z`. A level is tested first `5/2 s_z` samples after the
//! last alarm; at the promised rate `α` that many samples pass without an alarm with
//! probability `e_z`. The levels share the rate in proportion to it:
//!
//! ```text
//! p_z = F α s_z e_z / (J Σ e²),   e_z = exp(-5/2 α s_z),   P(χ²(q) > h_zq) = p_z     (104)
//! ```
//!
//! The factor `F` would be 1 if no two tests exceeded their thresholds in the same samples. In one
//! pose all candidates move the same few distances, and windows overlap: tests exceed them
//! together, most of all where thresholds are low, and the alarms are fewer than the exceedances.
//! `F` is from [`TOGETHER`].
//!
//! A long window is tested seldom, and has a lower threshold. Where the scale of the noise is
//! known from `ν` values only, `T` follows `q F(q, ν)`; `ν ln(1 + T/ν)`, corrected as Wallace
//! (1959) has it for Student's t, is compared with the threshold of `χ²`.

use crate::monitor::tails::Tails;
use crate::numerics::distributions::{chi2_quantile, chi2_tail};

/// Largest rank of a candidate.
const MOST_RANK: usize = 16;

/// Samples after an alarm until a level is tested, over those between its tests.
const REACHED: f64 = 2.5;

/// Share of windows of which at most so many are in the tail that is learned: the windows are enough
/// to learn from, and the tail is close to exponential.
const TAIL: f64 = 0.1;

/// Factor `F` for a promised rate: from alarms of sound hand controllers in motion, counted by
/// `python -m tests.watch.run rate --noise white --seed 101` for 1e-5, 1e-4 and 1e-3, and carried on
/// from there to either side. `F` is interpolated in the logarithms of both.
const TOGETHER: [(f64, f64); 5] = [(1e-6, 1.0), (1e-5, 1.3), (1e-4, 1.9), (1e-3, 3.6), (1e-2, 7.0)];

/// Thresholds of every level and rank.
#[derive(Debug, Clone)]
pub(crate) struct Thresholds {
    /// Level by level, [`MOST_RANK`] entries each.
    limits: Vec<f64>,
    /// `-ln p` of every level.
    levels: Vec<f64>,
    /// Statistic of every rank beyond which tails are learned, and `u` of (129).
    begins: Vec<f64>,
    pub(crate) tail: f64,
    /// Number of tests whose p-value counts as one sample's.
    tests: f64,
}

impl Thresholds {
    /// For a rate per sample, shared by `levels` levels whose windows are tested every `step`
    /// samples, for each of `candidates`.
    pub(crate) fn new(
        rate: f64,
        levels: usize,
        candidates: usize,
        step: impl Fn(usize) -> f64,
    ) -> Self {
        let tests = (levels * candidates.max(1)) as f64;
        let reached = |level: usize| (-REACHED * rate * step(level)).exp();
        let all: f64 = (0..levels).map(|level| reached(level).powi(2)).sum();
        let bound = together(rate) * rate;
        let chance = |level: usize| {
            let share = reached(level) / all;
            (bound * share * step(level) / candidates.max(1) as f64).min(0.5)
        };
        let ranks = |p: f64| (1..=MOST_RANK).map(move |rank| chi2_quantile(p, rank as f64));
        let limits = (0..levels).flat_map(|level| ranks(chance(level))).collect();
        let tail = TAIL / candidates.max(1) as f64;
        let begins = ranks(tail).collect();
        let levels = (0..levels).map(|level| -chance(level).ln()).collect();
        Self { limits, levels, begins, tail: -tail.ln(), tests }
    }

    /// `-ln P` of a statistic by chance, with the scale known from `dof` values, where it is in the
    /// tail or above its threshold.
    #[inline(always)]
    pub(crate) fn far(&self, level: usize, rank: usize, statistic: f64, dof: f64) -> Option<f64> {
        let place = rank.clamp(1, MOST_RANK) - 1;
        let least = self.limits[level * MOST_RANK + place].min(self.begins[place]);
        if rank == 0 || statistic <= least {
            return None;
        }
        let statistic = as_chi2(statistic, dof);
        (statistic > least).then(|| -log_tail(statistic, rank as f64))
    }

    /// True where a window in which the loudest test has this `-ln P` raises an alarm, with the tails
    /// of this device, which learn from it.
    pub(crate) fn exceeded(&self, level: usize, log: f64, tails: &mut Tails) -> bool {
        let (limit, beyond) = (self.levels[level], log - self.tail);
        if beyond <= 0.0 {
            return log > limit;
        }
        let alarm = self.tail + tails.worth(level, beyond) > limit;
        let counted = if alarm { beyond.min((limit - self.tail).max(0.0)) } else { beyond };
        tails.learn(level, counted, alarm);
        alarm
    }

    /// Probability of a larger statistic by chance, corrected for the number of tests.
    pub(crate) fn p_value(&self, rank: usize, statistic: f64, dof: f64) -> f64 {
        (chi2_tail(as_chi2(statistic, dof), rank as f64) * self.tests).min(1.0)
    }
}

/// The factor of [`TOGETHER`] for a rate.
fn together(rate: f64) -> f64 {
    let [first, .., last] = TOGETHER;
    let x = rate.clamp(first.0, last.0).ln();
    let above = TOGETHER.iter().position(|(at, _)| at.ln() >= x).unwrap_or(TOGETHER.len() - 1);
    let [(x0, f0), (x1, f1)] = [TOGETHER[above.max(1) - 1], TOGETHER[above.max(1)]]
        .map(|(rate, factor)| (rate.ln(), factor.ln()));
    (f0 + (f1 - f0) * (x - x0) / (x1 - x0)).exp()
}

/// The value of `χ²` that is as probable as `statistic`, whose scale is known from `dof` values.
pub(crate) fn as_chi2(statistic: f64, dof: f64) -> f64 {
    let correction = ((8.0 * dof + 1.0) / (8.0 * dof + 3.0)).powi(2);
    dof * (statistic / dof).ln_1p() * correction
}

/// `ln P(χ²(dof) > x)`, also where the probability is below the smallest number.
pub(crate) fn log_tail(x: f64, dof: f64) -> f64 {
    let tail = chi2_tail(x, dof);
    if tail > 1e-280 {
        return tail.ln();
    }
    // First term of the asymptotic series; its error is below 1 % there.
    (0.5 * dof - 1.0) * (0.5 * x).ln() - 0.5 * x - statrs::function::gamma::ln_gamma(0.5 * dof)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distributions::f_tail;

    #[test]
    fn quantiles_are_those_of_tables_and_reach_far_out() {
        // Abramowitz & Stegun, Table 26.8: P = 0.001.
        for (dof, expected) in [(1.0, 10.8276), (2.0, 13.8155), (6.0, 22.4577)] {
            assert!((chi2_quantile(1e-3, dof) - expected).abs() < 1e-4);
        }
        // Two degrees of freedom: exp(-x/2).
        assert!((chi2_quantile(1e-14, 2.0) - 64.472_4).abs() < 1e-3);
    }

    #[test]
    fn the_rates_of_all_tests_add_up_to_the_promise_and_its_factor() {
        let step = |level: usize| 2.0_f64.powi(level as i32 + 1);
        let (levels, candidates) = (18, 15);
        let own = Thresholds::new(1e-5, levels, candidates, step);
        // Levels whose windows are longer than the time between alarms are seldom reached.
        let reached = |z: usize| (-REACHED * 1e-5 * step(z)).exp();
        let tail = |z: usize| chi2_tail(own.limits[z * MOST_RANK + 2], 3.0);
        let rate: f64 =
            (0..levels).map(|z| candidates as f64 * reached(z) * tail(z) / step(z)).sum();
        assert!((rate / (together(1e-5) * 1e-5) - 1.0).abs() < 1e-6, "{rate}");
    }

    #[test]
    fn the_factor_of_tests_that_exceed_together_is_interpolated() {
        for (rate, factor) in TOGETHER {
            assert!((together(rate) - factor).abs() < 1e-9);
        }
        let middle = together(1e-4 * 10.0_f64.sqrt());
        assert!((middle - (TOGETHER[2].1 * TOGETHER[3].1).sqrt()).abs() < 1e-9);
        // Out of the range there is no such promise, or next to nothing exceeds together.
        assert!((together(1e-9) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn an_estimated_scale_is_charged() {
        for (rank, statistic, dof) in [(1, 30.0, 200.0), (1, 45.0, 60.0), (6, 60.0, 300.0)] {
            let exact = f_tail(statistic / rank as f64, rank as f64, dof);
            let found = chi2_tail(as_chi2(statistic, dof), rank as f64);
            // Exact for no rank; a fifth of the probability is a hundredth of the threshold.
            assert!((found / exact).ln().abs() < 0.25, "{rank} {dof}: {found} {exact}");
        }
    }
}

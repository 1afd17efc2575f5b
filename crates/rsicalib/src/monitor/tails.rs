//! Tails of the tests, as the device shows them.
//!
//! (102) follows `χ²` where the noise is normal. Readings with heavy tails, or with coarse steps whose
//! rounding stays the same while a joint turns slowly, make windows of which more are far out.
//! So the watch counts its own tests. With `L = -ln P(χ²(q) > T)` of the candidate that
//! speaks loudest in a window, and `u = ln(10 J)`, normal noise lets at most one window in ten
//! exceed `u` by chance, and `x = L - u` of these is exponential of mean one. A device may have
//! another mean: with the number `n` of such windows, and `s` the sum of their `x`, that of the next
//! is beyond `x` with the probability
//!
//! ```text
//! P(X > x) = (1 + x / (s₀ + s))^-(n₀ + n),                              (129)
//! ```
//!
//! the prediction from exponential tails of an unknown mean, with its conjugate prior. `L` of a
//! test becomes `u - ln P`, never more than `L`. A window that raises an alarm counts in `s` up
//! to its limit, and not in `n`: it is known to be beyond. So alarms without a change make the
//! next one rarer, and a change counts as one window at most.
//!
//! Levels have tails of their own. What one level shows is known beforehand at the next
//! with half the weight, as the sum over twice as many samples is closer to normal.

use crate::monitor::kept::keep;

/// Windows beyond `u` for which normal noise counts beforehand, `n₀` and `s₀`.
const NORMAL: f64 = 20.0;

/// Windows beyond `u` of one level after which older ones fade.
const MEMORY: f64 = 1e4;

/// What windows of each level have shown.
#[derive(Debug, Clone)]
pub(crate) struct Tails {
    /// `n` and `s` of each level.
    seen: Vec<[f64; 2]>,
}

impl Tails {
    pub(crate) fn new(levels: usize) -> Self {
        Self { seen: vec![[0.0; 2]; levels] }
    }

    /// `n₀ + n` and `s₀ + s` of a level.
    fn known(&self, level: usize) -> [f64; 2] {
        let mut known = [NORMAL; 2];
        for [n, s] in &self.seen[..=level] {
            let weight = 0.5_f64.max(NORMAL / known[0]);
            known = [weight * known[0] + n, weight * known[1] + s];
            // A light tail of one level is no promise of the next.
            known[1] = known[1].max(known[0]);
        }
        known
    }

    /// What `x` is worth where tails are normal: `-ln P` of (129).
    pub(crate) fn worth(&self, level: usize, x: f64) -> f64 {
        let [n, s] = self.known(level);
        (n * (x / s).ln_1p()).min(x)
    }

    /// Learns from a window beyond `u`; from one that raised an alarm that it is beyond `x`.
    pub(crate) fn learn(&mut self, level: usize, x: f64, alarm: bool) {
        let [n, s] = &mut self.seen[level];
        *n += if alarm { 0.0 } else { 1.0 };
        *s += x;
        if *n > MEMORY {
            let fade = MEMORY / *n;
            (*n, *s) = (*n * fade, *s * fade);
        }
    }

    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> [usize; 1] {
        [self.seen.len()]
    }
}

keep!(Tails: seen);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;

    /// A stream of exponential `x` of some mean: how often the worth exceeds a limit.
    fn exceeded(mean: f64, limit: f64, seed: u64) -> (f64, f64) {
        let (mut random, mut tails) = (Random::new(seed), Tails::new(2));
        let (mut count, rows) = (0.0, 200_000);
        for _ in 0..rows {
            let x = -mean * random.uniform(0.0, 1.0).max(f64::MIN_POSITIVE).ln();
            let alarm = tails.worth(0, x) > limit;
            tails.learn(0, if alarm { x.min(limit) } else { x }, alarm);
            count += f64::from(u8::from(alarm));
        }
        (count, f64::from(rows) * (-limit).exp())
    }

    #[test]
    fn a_promise_is_kept_by_tails_of_any_mean() {
        for (mean, seed) in [(0.7, 1), (1.0, 2), (1.5, 3), (3.0, 4)] {
            let (found, promised) = exceeded(mean, 6.0, seed);
            // 496 alarms: the promise and four standard errors. The prior is normal, so the first
            // windows of a heavy tail, some twenty, may raise one each.
            assert!(found < promised + 4.0 * promised.sqrt() + 20.0, "{mean}: {found} {promised}");
            // A normal tail loses little; a censored mean is low by the share of alarms.
            let least = if mean < 1.0 { 0.0 } else { 0.7 * promised };
            assert!(found > least, "{mean}: {found} {promised}");
        }
    }

    #[test]
    fn normal_noise_is_charged_for_what_is_not_known_yet_and_a_light_tail_earns_nothing() {
        let mut tails = Tails::new(3);
        // 20 ln(1 + 10/20)
        assert!((tails.worth(2, 10.0) - 20.0 * 1.5_f64.ln()).abs() < 1e-12);
        (0..10_000).for_each(|_| tails.learn(0, 0.5, false));
        // As exponential of mean one, known from 10,020 windows.
        let known = 10_020.0 * (10.0_f64 / 10_020.0).ln_1p();
        assert!((tails.worth(0, 10.0) - known).abs() < 1e-9);
        (0..100).for_each(|_| tails.learn(1, 3.0, false));
        assert!(tails.worth(1, 10.0) < 10.0);
    }
}

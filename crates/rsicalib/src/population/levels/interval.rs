//! Intervals of variances: (162).

use crate::numerics::distributions::{chi2_tail, normal_quantile};
use crate::population::levels::solve::Tree;

/// Part by which a variance is changed for the derivative of `k`.
const STEP: f64 = 1e-3;

/// Units of `ln τ²` above the best one in which an upper end is looked for: a factor of 3,000 of `τ`.
const FARTHEST: f64 = 16.0;

/// Ends are looked for until their deviate is as near to its place: a part in 20,000 of it.
const NEAR: f64 = 1e-4;

/// Standard deviations between which 95 % is; the upper end is none where nothing bounds it, the
/// interval where there is less than what is below makes, or where no unit tells the class.
pub(super) fn interval(tree: &Tree, best: &[f64], one: usize) -> Option<(f64, Option<f64>)> {
    let edge = normal_quantile(0.975);
    let least = tree.least[one]?;
    let mut beside = best.to_vec();
    let mut at = |ln: f64| {
        beside[one] = ln;
        let (fitted, y) = deviate(tree, std::mem::take(&mut beside), one);
        beside = fitted;
        [ln, y]
    };
    let first = at(least);
    if first[1] > edge {
        return None;
    }
    // The deviate grows with the variance, from `first` on.
    let middle = if best[one] > least { at(best[one]) } else { first };
    let low = if first[1] >= -edge { 0.0 } else { end(first, middle, -edge, &mut at)? };
    Some((low, end(first, middle, edge, &mut at)))
}

/// The standard deviation at which the deviate is `to`, above `first`.
fn end(
    first: [f64; 2],
    middle: [f64; 2],
    to: f64,
    at: &mut dyn FnMut(f64) -> [f64; 2],
) -> Option<f64> {
    let (mut low, mut high) = (first, middle);
    let (mut far, mut further) = (0.0, 1.0);
    while high[1] < to {
        if far >= FARTHEST {
            return None;
        }
        far = FARTHEST.min(far + further);
        further *= 2.0;
        low = high;
        high = at(middle[0] + far);
    }
    Some((0.5 * crossing(low, high, to, at)).exp())
}

/// Probability of a smaller `Q` of a rank and class, as a normal deviate, with the other variances at
/// their best, which are told.
fn deviate(tree: &Tree, ln: Vec<f64>, one: usize) -> (Vec<f64>, f64) {
    let (ln, at) = tree.fit(ln, Some(one));
    let k_at = |by: f64| {
        let mut other = ln.clone();
        other[one] += by;
        tree.k(&other)[one]
    };
    let (q, k) = (at.q[one], at.k[one]);
    let slope = (k_at(STEP) - k_at(-STEP)) / (2.0 * STEP);
    let k2 = (k - slope).max(f64::MIN_POSITIVE);
    let tail = chi2_tail(q * k / k2, k * k / k2);
    (ln, normal_quantile(tail.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON)))
}

/// Where a function that grows from below `to` to above it passes it: chords, of which one end that
/// stays counts half (Dowell and Jarratt 1971).
fn crossing(
    mut low: [f64; 2],
    mut high: [f64; 2],
    to: f64,
    at: &mut dyn FnMut(f64) -> [f64; 2],
) -> f64 {
    low[1] -= to;
    high[1] -= to;
    let mut last = 0.0;
    for _ in 0..60 {
        let part = -low[1] / (high[1] - low[1]);
        let part = if part.is_finite() { part.clamp(1e-3, 1.0 - 1e-3) } else { 0.5 };
        let found = at(low[0] + part * (high[0] - low[0]));
        let y = found[1] - to;
        if y.abs() < NEAR || high[0] - low[0] < 1e-9 {
            return found[0];
        }
        if y < 0.0 {
            low = [found[0], y];
            high[1] *= if last < 0.0 { 0.5 } else { 1.0 };
        } else {
            high = [found[0], y];
            low[1] *= if last > 0.0 { 0.5 } else { 1.0 };
        }
        last = y;
    }
    0.5 * (low[0] + high[0])
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::interval;
    use crate::population::levels::Levels;

    /// Interval of what units with an error `s` differ by.
    fn of(units: &[f64], s: f64) -> Option<(f64, Option<f64>)> {
        let precision = s.powi(-2);
        let information = vec![Mat::from_fn(1, 1, |_, _| precision); units.len()];
        let told: Vec<Vec<f64>> = units.iter().map(|x| vec![precision * x]).collect();
        let of = Levels::new(&information, &told, &[0], &[], 0.0).expect("alike");
        interval(&of.tree, &of.best, 0)
    }

    /// Ends are a part in 20,000 of a deviate away, which is less than this of a standard deviation.
    fn near(found: f64, witness: f64) {
        assert!((found / witness - 1.0).abs() < 1e-3, "{found} and not {witness}");
    }

    #[test]
    fn of_units_known_alike_the_interval_is_the_exact_one() {
        // Squares over τ² + s² are χ², of 7 units more than the mean: 1.689869 and 16.012764.
        let units = [0.3, -1.9, 2.2, 0.9, -0.4, 1.7, -2.6, 3.1];
        let mean = units.iter().sum::<f64>() / 8.0;
        let squares: f64 = units.iter().map(|x| (x - mean).powi(2)).sum();
        let (low, high) = of(&units, 0.5).expect("more than their errors");
        near(low, (squares / 16.012764 - 0.25).sqrt());
        near(high.expect("bounded"), (squares / 1.689869 - 0.25).sqrt());
    }

    #[test]
    fn two_groups_bound_little() {
        // χ² of one: 0.000982069 and 5.023886; squares of a difference of 1 are a half.
        let (low, high) = of(&[0.0, 1.0], 1e-6).expect("more than their errors");
        near(low, (0.5_f64 / 5.023886).sqrt());
        near(high.expect("bounded"), (0.5_f64 / 0.000982069).sqrt());
    }

    #[test]
    fn what_is_within_the_errors_may_be_none() {
        let units = [0.3, -0.5, 0.4, -0.1, -0.4, 0.6, -0.2, 0.1];
        let mean = units.iter().sum::<f64>() / 8.0;
        let squares: f64 = units.iter().map(|x| (x - mean).powi(2)).sum();
        // Between the two quantiles: nothing is possible, and the upper end is.
        let s = (squares / 7.0).sqrt();
        let (low, high) = of(&units, s).expect("as much as their errors");
        assert!(low == 0.0);
        near(high.expect("bounded"), (squares / 1.689869 - s * s).sqrt());
        // Below the lower one: less than the errors make.
        let s = (squares / 1.6).sqrt();
        assert_eq!(of(&units, s), None);
        assert_eq!(of(&[0.7; 8], 1.0), None);
    }
}

//! Probabilities of several explanations, and what counts as a rival.

use crate::numerics::order;

/// An effect fits as well as the named one where its refitted χ², with extra parameters charged,
/// is within this of the best.
pub const AS_WELL: f64 = 6.0;

/// An explanation is a rival of the best where its penalised χ² is within this of it. The best is
/// then `exp(6)` = 400 times as likely as the worst rival, for equal prior probabilities.
pub const RIVAL: f64 = 12.0;

/// Probability that the listed targets include the right one.
pub const SURE: f64 = 0.8;

/// Probability of each target of the scores `(value, target)`, the most likely target first.
/// The best rival of a target stands for the target. A value is twice a log-likelihood with
/// parameters charged. The prior probability is the same for every target.
#[must_use]
pub fn probabilities<T: PartialEq + Copy>(scores: &[(f64, T)]) -> Vec<(T, f64)> {
    let best = scores.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mut targets: Vec<(T, f64)> = Vec::new();
    for &(value, target) in scores {
        let weight = (0.5 * (value - best)).exp();
        match targets.iter_mut().find(|t| t.0 == target) {
            Some(known) => known.1 = known.1.max(weight),
            None => targets.push((target, weight)),
        }
    }
    let all: f64 = targets.iter().map(|t| t.1).sum();
    targets.iter_mut().for_each(|t| t.1 /= all);
    order::descending(&mut targets, |a| a.1);
    targets
}

#[cfg(test)]
mod tests {
    use super::probabilities;

    /// A likelihood ratio in units of χ².
    fn times(ratio: f64) -> f64 {
        2.0 * f64::ln(ratio)
    }

    #[test]
    fn probabilities_are_likelihoods_over_their_sum_best_of_each_target() {
        let scores = [(times(1.0), 'b'), (times(3.0), 'a'), (times(2.0), 'a')];
        let found = probabilities(&scores);
        assert_eq!(found.iter().map(|f| f.0).collect::<String>(), "ab");
        assert!((found[0].1 - 0.75).abs() < 1e-12 && (found[1].1 - 0.25).abs() < 1e-12);
        assert!(probabilities::<char>(&[]).is_empty());
    }
}

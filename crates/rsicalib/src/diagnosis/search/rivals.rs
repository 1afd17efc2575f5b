//! Explanations of a session that are nearly as good as the best.

use crate::diagnosis::price::in_steps;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::{AS_WELL, RIVAL};
use crate::numerics::order;
use crate::numerics::order::Ends;

/// Id of noise that nobody knows of.
pub const UNKNOWN_NOISE: &str = "unknown_noise";

/// Upper limit of explanations.
const MOST_RIVALS: usize = 8;

/// Effects that explain a session together.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// The effects, wrong readings left out; none where these, noise or nothing explain it.
    pub effects: Vec<Instance>,
    /// Whose noise that nobody knows of explains it, without an effect.
    pub noise: Option<Target>,
    /// Its price, (113).
    pub chi2: f64,
    /// Probability among the explanations that are listed.
    pub probability: f64,
    /// How far from the best one it puts the platform, or carried points [length unit]; none where
    /// these cannot be had.
    pub apart: Option<f64>,
}

/// Those within [`RIVAL`] of the best, the best first, with their probabilities.
pub(crate) fn nearest<T>(mut all: Vec<(Explanation, T)>) -> Vec<(Explanation, T)> {
    order::ascending(&mut all, |(e, _)| in_steps(e.chi2));
    let best = all.first().map_or(0.0, |(e, _)| e.chi2);
    all.retain(|(e, _)| e.chi2 <= best + RIVAL);
    all.truncate(MOST_RIVALS);
    let weight = |e: &Explanation| (0.5 * (best - e.chi2)).exp();
    let sum: f64 = all.iter().map(|(e, _)| weight(e)).sum();
    for (explanation, _) in &mut all {
        explanation.probability = weight(explanation) / sum;
    }
    all
}

/// The explanation that fits as well as the best and puts the platform farthest from where what was
/// found puts it, if by more than twice the standard deviation that is predicted, and how far.
#[must_use]
pub fn elsewhere(rivals: &[Explanation], predicted: f64) -> Option<(&Explanation, f64)> {
    let best = rivals.first()?.chi2;
    let as_well = rivals.iter().filter(|e| e.chi2 <= best + AS_WELL && e.noise.is_none());
    let far = as_well.filter_map(|e| e.apart.map(|apart| (e, apart)));
    let farthest = far.greatest_by(|a| a.1)?;
    (farthest.1 > BEYOND * predicted).then_some(farthest)
}

/// Predicted standard deviations of the platform that explanations which fit as well may be apart.
const BEYOND: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::{Explanation, elsewhere, nearest};

    fn of(chi2: f64) -> Explanation {
        Explanation { effects: Vec::new(), noise: None, chi2, probability: 0.0, apart: None }
    }

    #[test]
    fn rivals_are_within_twelve_of_the_best_and_eight_at_most() {
        let with = |chi2: f64| (of(chi2), ());
        let found = nearest([30.0, 18.0, 31.0, 20.0].map(with).to_vec());
        assert_eq!(found.iter().map(|(e, ())| e.chi2).collect::<Vec<_>>(), [18.0, 20.0, 30.0]);
        // Likelihood ratios 1 : e⁻¹ : e⁻⁶.
        let sum = 1.0 + 0.367_879_441_171_442_3 + 0.002_478_752_176_666_358_5;
        assert!((found[0].0.probability - 1.0 / sum).abs() < 1e-12);
        assert!((found[2].0.probability - 0.002_478_752_176_666_358_5 / sum).abs() < 1e-12);
        assert_eq!(nearest((0..20).map(|k| with(f64::from(k) / 10.0)).collect()).len(), 8);
    }

    #[test]
    fn only_what_fits_as_well_is_elsewhere() {
        let at = |chi2, apart| Explanation { apart: Some(apart), ..of(chi2) };
        let far = |rivals: &[Explanation]| elsewhere(rivals, 1.0).map(|(_, apart)| apart);
        assert_eq!(far(&[at(18.0, 0.0), at(20.0, 1.9), at(29.0, 9.0)]), None);
        assert_eq!(far(&[at(18.0, 0.0), at(20.0, 2.5), at(21.0, 3.0)]), Some(3.0));
        assert_eq!(far(&[]), None);
    }
}

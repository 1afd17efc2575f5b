//! Explanations of a session that are nearly as good as the best.

use crate::Error;
use crate::diagnosis::score::scored::{self, Scored};
use crate::diagnosis::stepwise::alternatives::charge;
use crate::diagnosis::stepwise::moves::{Stepwise, cost, physical};
use crate::estimate::Fit;
use crate::model::Instance;
use crate::numerics::credible_set::RIVAL;

/// Upper limit of explanations.
const MOST: usize = 8;

/// Effects that explain a session together.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// The effects, wrong readings left out.
    pub effects: Vec<Instance>,
    /// χ² with what priors add to it and what the effects are charged.
    pub chi2: f64,
    /// Probability among the explanations that are listed, all as likely beforehand.
    pub probability: f64,
}

impl Stepwise<'_> {
    /// The explanations within [`RIVAL`] of the best, the best first: what was found, and the same
    /// with one effect replaced by one of its alternatives `near`. None where no effect was found.
    ///
    /// # Errors
    ///
    /// As [`crate::estimate::fit`].
    pub fn rivals(
        &self,
        current: &Fit,
        found: &[Scored],
        near: &[Vec<Scored>],
    ) -> Result<Vec<Explanation>, Error> {
        let effects = |of: &[Scored]| -> Vec<Instance> {
            of.iter().map(|s| s.instance).filter(|i| !scored::is_data(i)).collect()
        };
        let charges = |of: &[Scored]| of.iter().map(charge).sum::<f64>();
        if effects(found).is_empty() {
            return Ok(Vec::new());
        }
        let own = cost(current) + charges(found);
        let mut explanations =
            vec![Explanation { effects: effects(found), chi2: own, probability: 1.0 }];
        for (index, alternatives) in near.iter().enumerate() {
            if scored::is_data(&found[index].instance) {
                continue;
            }
            let without = self.without(current, &[found[index].instance])?;
            for other in alternatives.iter().take(MOST) {
                if found.iter().any(|s| s.instance == other.instance) {
                    continue;
                }
                let mut others = found.to_vec();
                others[index] = *other;
                let refit = self.with(&without, &[other.instance])?;
                let sensible = refit.plausible && physical(&refit, &other.instance);
                if sensible && refit.termination.converged() {
                    let chi2 = cost(&refit) + charges(&others);
                    let effects = effects(&others);
                    explanations.push(Explanation { effects, chi2, probability: 0.0 });
                }
            }
        }
        Ok(nearest(explanations))
    }
}

/// Those within [`RIVAL`] of the best, the best first, with their probabilities.
fn nearest(mut all: Vec<Explanation>) -> Vec<Explanation> {
    all.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let best = all.first().map_or(0.0, |e| e.chi2);
    all.retain(|e| e.chi2 <= best + RIVAL);
    all.truncate(MOST);
    let weight = |e: &Explanation| (0.5 * (best - e.chi2)).exp();
    let sum: f64 = all.iter().map(weight).sum();
    for explanation in &mut all {
        explanation.probability = weight(explanation) / sum;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::{Explanation, nearest};

    #[test]
    fn rivals_are_within_twelve_of_the_best_and_eight_at_most() {
        let of = |chi2: f64| Explanation { effects: Vec::new(), chi2, probability: 0.0 };
        let found = nearest([30.0, 18.0, 31.0, 20.0].map(of).to_vec());
        assert_eq!(found.iter().map(|e| e.chi2).collect::<Vec<_>>(), [18.0, 20.0, 30.0]);
        // Likelihood ratios 1 : e⁻¹ : e⁻⁶.
        let sum = 1.0 + 0.367_879_441_171_442_3 + 0.002_478_752_176_666_358_5;
        assert!((found[0].probability - 1.0 / sum).abs() < 1e-12);
        assert!((found[2].probability - 0.002_478_752_176_666_358_5 / sum).abs() < 1e-12);
        assert_eq!(nearest((0..20).map(|k| of(f64::from(k) / 10.0)).collect()).len(), 8);
    }
}

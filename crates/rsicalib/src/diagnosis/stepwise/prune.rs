//! What is dropped in the end: what is no longer needed, or does not stand out after all.

use std::slice;

use crate::Error;
use crate::diagnosis::options::{LEVEL, Rule};
use crate::diagnosis::score::scored::Scored;
use crate::diagnosis::stepwise::moves::{Stepwise, cost};
use crate::estimate::{Fit, fit};
use crate::model::Instance;

impl Stepwise<'_> {
    /// Drops what explains no more than is paid for it beside the others, worst first: what was
    /// exchanged for another may leave an effect with nothing to explain, or a load that lifts.
    pub fn keep_gains(&self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<(), Error> {
        if !self.search.uses(Rule::KeepGains) {
            return Ok(());
        }
        loop {
            self.prepare_without(current, found.iter().map(|s| slice::from_ref(&s.instance)));
            let mut worst: Option<(f64, usize, Fit)> = None;
            for (index, step) in found.iter().enumerate() {
                let without = self.without(current, &[step.instance])?;
                let gain = self.gain(&without, current, slice::from_ref(step));
                if gain <= worst.as_ref().map_or(0.0, |(gain, ..)| *gain) {
                    worst = Some((gain, index, without));
                }
            }
            let Some((_, index, without)) = worst else { return Ok(()) };
            found.remove(index);
            *current = without;
        }
    }

    /// Drops what does not stand out against what stays unexplained.
    ///
    /// Where the catalogue lacks the effect, structure is left, and its crests look
    /// like bad readings and faint effects. Then the rest is the noise that a name
    /// must be above: scores are divided by its χ² per degree of freedom.
    pub fn against_the_rest(
        &mut self,
        current: &mut Fit,
        found: &mut Vec<Scored>,
        poses: &mut Vec<Scored>,
    ) -> Result<(), Error> {
        let judge = self.judge(current);
        if !self.search.uses(Rule::AgainstTheRest) {
            return Ok(());
        }
        if judge.lack_of_fit(current).is_none_or(|p| p > LEVEL) {
            return Ok(());
        }
        let rest = current.chi2 / current.dof;
        let stands_out = |score: f64, step: &Scored| {
            judge.too_large(score / rest, step.width) * step.places <= self.search.alpha
        };
        self.prepare_without(current, found.iter().map(|s| slice::from_ref(&s.instance)));
        let mut kept = Vec::new();
        for step in found.iter() {
            let without = self.without(current, &[step.instance])?;
            if stands_out(cost(&without) - cost(current), step) {
                kept.push(*step);
            }
        }
        let whole: Vec<Scored> =
            poses.iter().copied().filter(|step| stands_out(step.score, step)).collect();
        if kept.len() == found.len() && whole.len() == poses.len() {
            return Ok(());
        }
        let dropped = |i: &Instance| {
            found.iter().any(|s| s.instance == *i) && !kept.iter().any(|s| s.instance == *i)
        };
        let instances = current.model.instances.iter().copied().filter(|i| !dropped(i)).collect();
        for step in poses.iter().filter(|s| !whole.contains(s)) {
            self.small.weights[step.instance.place] = self.counts[step.instance.place];
        }
        (*found, *poses) = (kept, whole);
        *current = fit(&self.small, instances, Some(current))?;
        self.rescale(current)
    }
}

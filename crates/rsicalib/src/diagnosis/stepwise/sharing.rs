//! One constant for chains that are drawn alike, or one for each of them.

use crate::Error;
use crate::diagnosis::score::scored::Scored;
use crate::diagnosis::stepwise::moves::Stepwise;
use crate::estimate::Fit;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::terms::targets::shared;

impl Stepwise<'_> {
    /// Replaces effects of single chains by the one that the chains share where that explains as
    /// much, paid for; and a shared one by single ones where a chain differs. True where it did.
    pub(crate) fn share(
        &mut self,
        current: &mut Fit,
        found: &mut Vec<Scored>,
    ) -> Result<bool, Error> {
        let divided = self.divide(current, found)?;
        Ok(self.unite(current, found)? || divided)
    }

    /// A shared effect beside the same effect of one of the chains says that the chains differ.
    fn divide(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let differing = found.iter().find_map(|s| {
            let parts = self.parts_of(&s.instance)?;
            found.iter().any(|other| parts.contains(&other.instance)).then_some((*s, parts))
        });
        let Some((all, parts)) = differing else { return Ok(false) };
        let gone = |s: &Scored| *s == all || parts.contains(&s.instance);
        let those: Vec<Instance> = found.iter().filter(|s| gone(s)).map(|s| s.instance).collect();
        let without = self.without(current, &those)?;
        let scored = self.scan(&without)?;
        let single = |part: &Instance| scored.iter().find(|s| s.instance == *part).copied();
        let Some(singles) = parts.iter().map(single).collect::<Option<Vec<Scored>>>() else {
            return Ok(false);
        };
        let refit = self.with(&without, &parts)?;
        if !self.gain(&without, &refit, &singles).is_finite() {
            return Ok(false);
        }
        found.retain(|s| !gone(s));
        found.extend(singles);
        *current = refit;
        self.rescale(current)?;
        self.keep_gains(current, found)?;
        Ok(true)
    }

    /// The same effect of several chains is one that all share, where that explains as much.
    fn unite(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let mut united = false;
        let mechanism = self.small.mechanism.clone();
        let mut tried: Vec<(&str, Target)> = Vec::new();
        while let Some((all, gone)) = found.iter().find_map(|s| {
            let term = s.instance.term;
            shared(term, &mechanism).into_iter().find_map(|target| {
                let all = Instance { target, ..s.instance };
                let parts = self.parts_of(&all)?;
                let gone: Vec<Scored> =
                    found.iter().filter(|s| parts.contains(&s.instance)).copied().collect();
                let new = !tried.contains(&(term.info().id, target));
                (new && gone.len() > 1 && gone.contains(s)).then_some((all, gone))
            })
        }) {
            tried.push((all.term.info().id, all.target));
            let those: Vec<Instance> = gone.iter().map(|s| s.instance).collect();
            let without = self.without(current, &those)?;
            let scored = self.scan(&without)?;
            let Some(one) = scored.into_iter().find(|s| s.instance == all) else { continue };
            let refit = self.with(&without, &[all])?;
            if self.gain(&without, &refit, &[one]) < self.gain(&without, current, &gone) {
                continue;
            }
            found.retain(|s| !gone.contains(s));
            found.push(one);
            *current = refit;
            self.rescale(current)?;
            united = true;
        }
        Ok(united)
    }

    /// True where one is what chains share, and the other the same of one of them.
    pub(crate) fn overlap(&self, a: &Instance, b: &Instance) -> bool {
        let within = |all: &Instance, one: &Instance| {
            self.parts_of(all).is_some_and(|parts| parts.contains(one))
        };
        within(a, b) || within(b, a)
    }

    /// The instances of the single chains that a shared one stands for; none for another.
    pub(crate) fn parts_of(&self, instance: &Instance) -> Option<Vec<Instance>> {
        let shared = instance.target.is_shared();
        shared.then(|| {
            let parts = self.small.mechanism.parts(instance.target).into_iter();
            parts.map(|target| Instance { target, ..*instance }).collect()
        })
    }
}

//! Effects for effects: what was found first may have been half of the truth, or both halves of it.

use std::ops::Range;

use crate::Error;
use crate::diagnosis::options::{FEW_EFFECTS, LEVEL, Rule};
use crate::diagnosis::score::pairs::Pair;
use crate::diagnosis::score::scored::{self, Family, Scored, excluded_pose};
use crate::diagnosis::stepwise::moves::{BETTER, Stepwise};
use crate::estimate::Fit;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;

/// So many poses at an end of the session may each be read wrong, and look like a slip; of more
/// a slip is by far the likelier story.
const FEW_POSES: usize = 6;

/// Every two of them, those of the first ones first.
fn pairs_of(found: &[Scored]) -> impl Iterator<Item = [Scored; 2]> {
    (0..found.len()).flat_map(move |b| (0..b).map(move |a| [found[a], found[b]]))
}

impl Stepwise<'_> {
    /// One effect for two, and two for one or two, where that explains more; true where it
    /// does. What takes many effects to make up is not made up of pairs.
    pub fn exchange(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let uses = |rule| self.search.uses(rule);
        let [reads, shares, merges, pairs] =
            [Rule::ReadSlips, Rule::Share, Rule::MergePairs, Rule::FindPairs].map(uses);
        let read = reads && self.read_slips(current, found)?;
        let shared = shares && self.share(current, found)?;
        if found.len() > FEW_EFFECTS + 1 {
            return Ok(read || shared);
        }
        let merged = merges && self.merge_pairs(current, found)?;
        let paired = pairs && self.find_pairs(current, found)?;
        Ok((shares && self.share(current, found)?) || paired || merged || read || shared)
    }

    /// Replaces a slip near an end of the session, and the wrong readings there, by wrong
    /// readings alone where as many do as well: two that are off alike look like a slip with a
    /// wrong reading beside it.
    fn read_slips(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let slips: Vec<Scored> =
            found.iter().copied().filter(|s| s.family.happened_once()).collect();
        let mut replaced = false;
        for slip in slips {
            let Some(end) = self.end_of(slip.instance.place) else { continue };
            let there =
                |s: &&Scored| scored::is_data(&s.instance) && end.contains(&s.instance.place);
            let gone: Vec<Scored> = found.iter().filter(there).copied().chain([slip]).collect();
            let Some((readings, fit)) = self.readings_for(current, &gone, &end)? else { continue };
            found.retain(|s| !gone.contains(s));
            found.extend(readings);
            *current = fit;
            replaced = true;
        }
        if replaced {
            self.rescale(current)?;
        }
        Ok(replaced)
    }

    /// The poses on one side of a slip, where they are few.
    fn end_of(&self, place: usize) -> Option<Range<usize>> {
        let poses = self.small.weights.len();
        [0..place, place..poses].into_iter().find(|end| end.len() <= FEW_POSES)
    }

    /// Wrong readings at the end of a session that do as well as these effects, and their fit.
    fn readings_for(
        &self,
        current: &Fit,
        gone: &[Scored],
        end: &Range<usize>,
    ) -> Result<Option<(Vec<Scored>, Fit)>, Error> {
        let those: Vec<Instance> = gone.iter().map(|s| s.instance).collect();
        let without = self.without(current, &those)?;
        let needed = (self.gain(&without, current, gone) - AS_WELL).max(0.0);
        let (mut readings, mut fit) = (Vec::new(), without.clone());
        while readings.len() < gone.len().max(2) {
            let mut scored = self.scan(&fit)?;
            scored.retain(|s| {
                s.family == Family::Bad
                    && excluded_pose(&s.instance).is_none()
                    && end.contains(&s.instance.place)
                    && s.corrected <= self.search.alpha
            });
            let best = scored.into_iter().max_by(|a, b| a.score.total_cmp(&b.score));
            let Some(best) = best else { break };
            fit = self.with(&fit, &[best.instance])?;
            readings.push(best);
        }
        let gain = self.gain(&without, &fit, &readings);
        Ok((gain > needed).then_some((readings, fit)))
    }

    /// Replaces two effects by one that explains as much, its places paid for:
    /// the first of two may have been half of the truth.
    fn merge_pairs(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let (mut a, mut b, mut merged) = (0, 1, false);
        let pairs = pairs_of(found).map(|pair| pair.map(|s| s.instance));
        let pairs: Vec<[Instance; 2]> = pairs.collect();
        self.prepare_without(current, pairs.iter().map(<[_; 2]>::as_slice));
        while b < found.len() {
            if let Some((one, fit)) =
                self.one_for_two(current, [found[a].instance, found[b].instance])?
            {
                found.remove(b);
                found[a] = one;
                *current = fit;
                self.rescale(current)?;
                (a, b, merged) = (0, 1, true);
                continue;
            }
            a += 1;
            if a == b {
                (a, b) = (0, b + 1);
            }
        }
        Ok(merged)
    }

    /// The one effect that does what two do, and its fit.
    fn one_for_two(
        &self,
        current: &Fit,
        pair: [Instance; 2],
    ) -> Result<Option<(Scored, Fit)>, Error> {
        let without = self.without(current, &pair)?;
        let mut scored = self.scan(&without)?;
        let price: f64 =
            scored.iter().filter(|s| pair.contains(&s.instance)).map(Scored::paid).sum();
        let both = self.fall(&without, current) - price;
        scored.retain(|s| {
            !pair.contains(&s.instance)
                && excluded_pose(&s.instance).is_none()
                && s.charged() > 0.5 * both
                && s.corrected <= self.search.alpha
        });
        scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        let singles = scored.into_iter().take(self.search.refits).map(|s| [s]);
        Ok(self.best(&without, both, singles)?.map(|([one], fit)| (one, fit)))
    }

    /// Those that gain most when refitted, if more than is needed and than nothing, and their fit.
    fn best<const N: usize>(
        &self,
        without: &Fit,
        needed: f64,
        candidates: impl Iterator<Item = [Scored; N]>,
    ) -> Result<Option<([Scored; N], Fit)>, Error> {
        let candidates: Vec<[Scored; N]> = candidates.collect();
        let instances: Vec<_> = candidates.iter().map(|them| them.map(|s| s.instance)).collect();
        self.prepare_with(without, instances.iter().map(<[_; N]>::as_slice));
        let mut best: Option<(f64, [Scored; N], Fit)> = None;
        for added in candidates {
            let refit = match self.with(without, &added.map(|s| s.instance)) {
                Err(Error::TooFew { .. }) => continue,
                refit => refit?,
            };
            let gain = self.gain(without, &refit, &added);
            if gain > best.as_ref().map_or(needed.max(0.0), |(g, ..)| *g) {
                best = Some((gain, added, refit));
            }
        }
        Ok(best.map(|(_, added, refit)| (added, refit)))
    }

    /// Replaces one effect or two, or none where something is left, by two that explain
    /// more: of two that hide each other neither is found before the other.
    fn find_pairs(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<bool, Error> {
        let mut exchanged = false;
        for _ in 0..=FEW_EFFECTS {
            let Some((both, fit)) = self.two_for_any(current, found)? else { break };
            let new = both.map(|s| s.instance);
            found.retain(|s| {
                fit.model.instances.contains(&s.instance) && !new.contains(&s.instance)
            });
            found.extend(both);
            *current = fit;
            self.rescale(current)?;
            exchanged = true;
        }
        Ok(exchanged)
    }

    /// Two effects that replace some of those that were found, and their fit.
    fn two_for_any(
        &self,
        current: &Fit,
        found: &[Scored],
    ) -> Result<Option<([Scored; 2], Fit)>, Error> {
        let quiet = self.judge(current).lack_of_fit(current).is_none_or(|p| p > LEVEL);
        let none = (!quiet && found.len() < FEW_EFFECTS).then_some(Vec::new());
        let one = found.iter().filter(|_| found.len() <= FEW_EFFECTS).map(|s| vec![*s]);
        let two = pairs_of(found).map(Vec::from);
        let all: Vec<Vec<Scored>> = two.chain(one).chain(none).collect();
        let instances = |gone: &Vec<Scored>| gone.iter().map(|s| s.instance).collect();
        let those: Vec<Vec<Instance>> = all.iter().map(instances).collect();
        self.prepare_without(current, those.iter().map(Vec::as_slice));
        let mut without = Vec::with_capacity(all.len());
        for (gone, those) in all.iter().zip(&those) {
            let fit = self.without(current, those)?;
            let needed = self.gain(&fit, current, gone) + BETTER;
            without.push((fit, needed));
        }
        for ((those, (without, needed)), pairs) in
            those.iter().zip(&without).zip(self.pairs(&without))
        {
            let better = self.two_for(those, without, *needed, pairs?)?;
            if better.is_some() {
                return Ok(better);
            }
        }
        Ok(None)
    }

    /// The two effects that gain more than is needed without these, and their fit.
    fn two_for(
        &self,
        those: &[Instance],
        without: &Fit,
        needed: f64,
        mut pairs: Vec<Pair>,
    ) -> Result<Option<([Scored; 2], Fit)>, Error> {
        pairs.retain(|p| !p.both.iter().all(|s| those.contains(&s.instance)));
        pairs.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        self.best(without, needed, pairs.iter().take(self.search.refits / 2).map(|p| p.both))
    }
}

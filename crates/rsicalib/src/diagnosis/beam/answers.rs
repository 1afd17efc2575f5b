//! What is asked of the beam: what was found, what fits as well, which explanations are nearly as good.

use crate::Error;
use crate::apply::change::apart;
use crate::diagnosis::beam::Beam;
use crate::diagnosis::beam::account::Account;
use crate::diagnosis::isolation::{Isolated, isolate};
use crate::diagnosis::options::Rule;
use crate::diagnosis::score::scored::{self, Scored, excluded_pose};
use crate::diagnosis::stepwise::moves::Stepwise;
use crate::diagnosis::stepwise::orders::one_order;
use crate::diagnosis::stepwise::rivals::{Explanation, nearest};
use crate::diagnosis::stepwise::search::{FoundEffect, Searched, search_and_isolate};
use crate::estimate::progress::Stage;
use crate::estimate::{Fit, fit};
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::workers;
use crate::screening::blame::Blame;

/// The search, and once more where the declared noise is a bound by what it found.
///
/// # Errors
///
/// As [`fit`].
pub fn search_effects(
    stepwise: &mut Stepwise,
    start: &Fit,
) -> Result<(Searched, Option<Isolated>), Error> {
    let search = match stepwise.search.uses(Rule::Stepwise) {
        true => search_and_isolate,
        false => searched,
    };
    let weights = stepwise.small.weights.clone();
    let explained = search(stepwise, start)?;
    if explained.0.found.is_empty() || !stepwise.bounded_by(&explained.0.current) {
        return Ok(explained);
    }
    stepwise.release(weights);
    search(stepwise, start)
}

/// What the likeliest explanation says, and what the beam knows beside it.
///
/// # Errors
///
/// As [`fit`].
fn searched(stepwise: &mut Stepwise, start: &Fit) -> Result<(Searched, Option<Isolated>), Error> {
    let beam = Beam::search(stepwise, start)?;
    let ranked = beam.ranked();
    let best = &beam.accounts[ranked[0]];
    let poses: Vec<Scored> =
        best.items.iter().copied().filter(|s| excluded_pose(&s.instance).is_some()).collect();
    let found: Vec<Scored> =
        best.items.iter().copied().filter(|s| excluded_pose(&s.instance).is_none()).collect();
    let rivals = beam.rivals(&ranked);
    let mut beside: Vec<Beside> =
        found.iter().map(|item| beam.beside(best, item)).collect::<Result<_, _>>()?;
    let (noise, mut current) = (best.noise, best.fit.clone());
    let last = beam.scores(best)?;
    drop(beam);
    poses.iter().for_each(|pose| stepwise.small.weights[pose.instance.place] = 0.0);
    let isolated = noise.map(|noise| Isolated {
        target: noise.target,
        p_value: stepwise.judge(&current).lack_of_fit(&current).unwrap_or(1.0),
        wrong: Vec::new(),
    });
    if noise.is_some() {
        current = fit(&stepwise.small, current.model.instances.clone(), Some(&current))?;
    }
    stepwise.rescale(&mut current)?;
    let mut steps = Vec::new();
    for (index, scored) in found.iter().enumerate() {
        let Beside { mut also, blame, all, laws, fit } = std::mem::take(&mut beside[index]);
        for one in stepwise.beside_tolerances(&current, &found, index, &all)? {
            if !also.contains(&one.instance) {
                also.push(one.instance);
            }
        }
        let without = match fit.filter(|_| noise.is_none()) {
            Some(fit) => fit,
            None => stepwise.without(&current, &[scored.instance])?,
        };
        let scores = scored::best_places(&all);
        steps.push(FoundEffect { scored: *scored, also, blame, without, scores, laws });
    }
    let left = last.iter().copied().min_by(|a, b| a.corrected.total_cmp(&b.corrected));
    let scores = scored::best_places(&last);
    let (wrong, more) = (Vec::new(), false);
    let it = Searched { current, found: steps, poses, wrong, left, scores, rivals, more };
    let settled = it.settled(stepwise) || !stepwise.search.uses(Rule::Isolation);
    if isolated.is_none() && !settled {
        stepwise.small.options.progress.enter(Stage::Isolation);
        let at_fault = isolate(&stepwise.all(), start, &stepwise.judge(start), stepwise.search)?;
        return Ok((it, at_fault));
    }
    Ok((it, isolated))
}

/// What is known beside one item.
#[derive(Default)]
struct Beside {
    also: Vec<Instance>,
    blame: Blame,
    /// Scores of everything without it.
    all: Vec<Scored>,
    laws: Vec<(Instance, std::sync::Arc<crate::model::Model>, Vec<f64>)>,
    /// The fit without it.
    fit: Option<Fit>,
}

impl Beam<'_, '_> {
    /// What stands in place of one item of an explanation, the others kept.
    fn beside(&self, best: &Account, item: &Scored) -> Result<Beside, Error> {
        let own = item.instance;
        let rest: Vec<Scored> = best.items.iter().copied().filter(|s| s.instance != own).collect();
        let others: Vec<Instance> = rest.iter().map(|s| s.instance).collect();
        let of = self.known(&rest, best.noise.as_ref()).map(|k| &self.accounts[k]);
        let all = of.map_or(Ok(Vec::new()), |of| self.scores(of))?;
        // Those with one item in its place.
        let instead = self.accounts.iter().filter_map(|account| {
            let same = account.admitted
                && account.items.len() == best.items.len()
                && account.noise.map(|n| n.target) == best.noise.map(|n| n.target)
                && rest.iter().all(|item| account.has(&item.instance));
            let new = account.items.iter().find(|s| !others.contains(&s.instance))?;
            let fits = same
                && same_kind(&new.instance, &own)
                && excluded_pose(&new.instance).is_none()
                && !others.iter().any(|other| self.stepwise.overlap(&new.instance, other))
                && (new.instance == own || !one_order(&best.fit, &new.instance, &own));
            fits.then_some((account, new.instance))
        });
        let instead: Vec<(&Account, Instance)> = instead.collect();
        let of_targets = instead.iter().map(|(account, i)| (-account.price, i.target));
        let blame = Blame::among(of_targets, &self.stepwise.small.mechanism);
        let mut near: Vec<_> = instead
            .iter()
            .filter(|(account, i)| account.price < best.price + AS_WELL && *i != own)
            .collect();
        near.sort_by(|a, b| a.0.price.total_cmp(&b.0.price));
        let also = near.iter().map(|(_, i)| *i).collect();
        let laws = near.iter().filter(|(_, i)| i.target == own.target);
        let laws = laws.map(|(a, i)| (*i, a.fit.model.clone(), a.fit.beta.clone())).collect();
        let fit = of.map(|of| of.fit.clone());
        Ok(Beside { also, blame, all, laws, fit })
    }

    /// The likeliest explanations; those that say more than a likelier one are none.
    fn rivals(&self, ranked: &[usize]) -> Vec<Explanation> {
        let best = &self.accounts[ranked[0]];
        let mut listed: Vec<(Explanation, &Fit)> = Vec::new();
        for account in ranked.iter().map(|k| &self.accounts[*k]) {
            let effects: Vec<Instance> =
                account.items.iter().map(|s| s.instance).filter(|i| !scored::is_data(i)).collect();
            let same = |one: &(Explanation, &Fit)| {
                let known = &one.0.effects;
                known.len() == effects.len() && known.iter().all(|i| effects.contains(i))
            };
            let of_same_noise = account.noise.map(|n| n.target) == best.noise.map(|n| n.target);
            let dearer = |k: &usize| account.extends(&self.accounts[*k]);
            if effects.is_empty()
                || !of_same_noise
                || listed.iter().any(same)
                || ranked
                    .iter()
                    .take_while(|k| self.accounts[**k].price < account.price)
                    .any(dearer)
            {
                continue;
            }
            let (chi2, probability) = (account.price, 1.0);
            listed.push((Explanation { effects, chi2, probability, apart: None }, &account.fit));
        }
        let first = best.items.iter().any(|s| !scored::is_data(&s.instance));
        if !first {
            return Vec::new();
        }
        let small = &self.stepwise.small;
        workers::map(nearest(listed), |(mut explanation, refit)| {
            explanation.apart = apart(small, &best.fit, refit);
            explanation
        })
    }
}

/// Bad readings are rivals of bad readings of the same pose, effects of effects.
fn same_kind(a: &Instance, b: &Instance) -> bool {
    scored::is_data(a) == scored::is_data(b) && (!scored::is_data(a) || a.place == b.place)
}

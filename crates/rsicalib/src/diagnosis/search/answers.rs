//! What is asked of the beam: what was found, what fits as well, which explanations are nearly as good.

use crate::Error;
use crate::apply::change::apart;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::isolation::{Isolated, belongs, isolate, isolated_at};
use crate::diagnosis::options::Rule;
use crate::diagnosis::plausibility::absurdities;
use crate::diagnosis::price::{Family, in_steps, prior};
use crate::diagnosis::score::scored::{self, Scored, excluded_pose, is_data};
use crate::diagnosis::search::account::Account;
use crate::diagnosis::search::beam::Beam;
use crate::diagnosis::search::orders::one_order;
use crate::diagnosis::search::outcome::{FoundEffect, Searched};
use crate::diagnosis::search::rivals::{Explanation, nearest};
use crate::estimate::progress::Stage;
use crate::estimate::{Fit, fit};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::order;
use crate::numerics::order::Ends;
use crate::numerics::workers;
use crate::screening::blame::Blame;
use crate::terms::term::{Acts, Class};

/// The search, and once more where the declared noise is a bound by what it found.
///
/// # Errors
///
/// As [`fit`].
pub fn search_effects(
    averaged: &mut Averaged,
    start: &Fit,
) -> Result<(Searched, Option<Isolated>), Error> {
    let weights = averaged.small.weights.clone();
    let explained = searched(averaged, start)?;
    if explained.0.found.is_empty() || !averaged.bounded_by(&explained.0.current) {
        return Ok(explained);
    }
    averaged.small.weights = weights;
    searched(averaged, start)
}

/// What the likeliest explanation says, and what the beam knows beside it.
///
/// # Errors
///
/// As [`fit`].
fn searched(averaged: &mut Averaged, start: &Fit) -> Result<(Searched, Option<Isolated>), Error> {
    let beam = Beam::search(averaged, start)?;
    let ranked = beam.ranked();
    let best = &beam.accounts[ranked[0]];
    let (poses, found): (Vec<Scored>, Vec<Scored>) =
        best.items.iter().partition(|s| excluded_pose(&s.instance).is_some());
    let rivals = beam.rivals(&ranked);
    let beside: Vec<Beside> =
        found.iter().map(|item| beam.beside(best, item)).collect::<Result<_, _>>()?;
    let (noise, mut current) = (best.noise, best.fit.clone());
    let last = beam.scores(best)?;
    drop(beam);
    poses.iter().for_each(|pose| averaged.small.weights[pose.instance.place] = 0.0);
    if noise.is_some() {
        // What is said is fitted with the noise of the session.
        current = fit(&averaged.small, current.model.instances.clone(), Some(&current))?;
    }
    averaged.rescale(&mut current)?;
    let found = steps(averaged, &current, &found, beside, noise.is_some())?;
    let left = last.iter().copied().least_by(|a| a.corrected);
    let scores = scored::best_places(&last);
    let it = Searched { current, found, poses, left, scores, rivals };
    let lost = it.found.is_empty() && !absurdities(&averaged.small, start, &[]).is_empty();
    if lost || it.is_answer(averaged) || !averaged.search.uses(Rule::Isolation) {
        return Ok((it, None));
    }
    averaged.small.options.progress.enter(Stage::Isolation);
    let mut effects = it.found.iter().map(|step| step.scored.instance).filter(|i| !is_data(i));
    let of_noise = noise.map(|noise| noise.target);
    // Noise is at fault alone where no effect is found elsewhere; that of a closure is looked for alone.
    let mechanism = &averaged.small.mechanism;
    if of_noise.is_some_and(|noise| effects.any(|i| !belongs(mechanism, i.target, noise))) {
        return Ok((it, None));
    }
    let alone = isolate(&averaged.all(), start, &averaged.judge(start), averaged.search)?;
    let of_closure = alone.as_ref().is_some_and(|it| matches!(it.target, Target::Closure(_)));
    let at_fault = match of_noise {
        Some(target) if !of_closure => {
            let judge = averaged.judge(&it.current);
            isolated_at(&averaged.small, &it.current, target, &judge, averaged.search)?
        }
        _ => alone,
    };
    Ok((it, at_fault))
}

/// The items that were found, each with what is known beside it; with other noise `refitted` without it.
fn steps(
    averaged: &Averaged,
    current: &Fit,
    found: &[Scored],
    beside: Vec<Beside>,
    refitted: bool,
) -> Result<Vec<FoundEffect>, Error> {
    let one = |(index, beside): (usize, Beside)| -> Result<FoundEffect, Error> {
        let (scored, Beside { also, blame, all, laws, fit }) = (found[index], beside);
        let without = match fit.filter(|_| !refitted) {
            Some(fit) => fit,
            None => averaged.without(current, &[scored.instance])?,
        };
        let scores = scored::best_places(&all);
        Ok(FoundEffect { scored, also, blame, without, scores, laws })
    };
    beside.into_iter().enumerate().map(one).collect()
}

/// What is known beside one item.
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
                && !others.iter().any(|other| self.overlap(&new.instance, other))
                && (new.instance == own || !one_order(&best.fit, &new.instance, &own));
            fits.then_some((account, new))
        });
        let instead: Vec<(&Account, &Scored)> = instead.collect();
        let of_targets = instead.iter().map(|(account, s)| (-account.price, s.instance.target));
        let blame = Blame::among(of_targets, &self.averaged.small.mechanism);
        // What poses cannot tell rests on no opinion of which kind is more common: with ours, or with none.
        // A free shape is no kind beside others: it holds the laws of its sensor.
        let alike = |account: &Account, s: &Scored| account.price + 2.0 * prior(s.family).ln();
        let limits = [best.price, alike(best, item)].map(|price| price + AS_WELL);
        let as_well = |(account, s): &(&Account, &Scored)| {
            let kind = s.family != Family::Free;
            account.price < limits[0] || (kind && alike(account, s) < limits[1])
        };
        let mut near: Vec<(&Account, Instance)> = instead
            .iter()
            .filter(|one| as_well(one) && one.1.instance != own)
            .map(|(account, s)| (*account, s.instance))
            .collect();
        order::ascending(&mut near, |(account, _)| in_steps(account.price));
        let mut also: Vec<Instance> = near.iter().map(|(_, i)| *i).collect();
        for other in self.across_surfaces(best, item) {
            if !also.contains(&other) {
                also.push(other);
            }
        }
        let laws = near.iter().filter(|(_, i)| i.target == own.target);
        let laws = laws.map(|(a, i)| (*i, a.fit.model.clone(), a.fit.beta.clone())).collect();
        let fit = of.map(|of| of.fit.clone());
        Ok(Beside { also, blame, all, laws, fit })
    }

    /// Errors of surfaces in explanations that fit as well without an error of what touches them, or the
    /// other way round: one bends as the other curves.
    fn across_surfaces(&self, best: &Account, item: &Scored) -> Vec<Instance> {
        let other = |s: &Scored| match is_of_surface(item) {
            true => is_drawn(s),
            false => is_drawn(item) && is_of_surface(s),
        };
        if !self.averaged.search.uses(Rule::AcrossSurfaces) {
            return Vec::new();
        }
        let as_well = self.accounts.iter().filter(|account| {
            account.admitted && account.price < best.price + AS_WELL && !account.has(&item.instance)
        });
        let theirs = as_well.flat_map(|account| &account.items);
        let theirs = theirs.filter(|s| other(s) && !best.has(&s.instance));
        theirs.map(|s| s.instance).collect()
    }

    /// The likeliest explanations, by their effects; those that say more than a likelier one are none. One
    /// without effects says that readings are wrong, or noise that nobody knows of, or nothing.
    fn rivals(&self, ranked: &[usize]) -> Vec<Explanation> {
        let best = &self.accounts[ranked[0]];
        if best.noise.is_none() && best.items.iter().all(|s| is_data(&s.instance)) {
            return Vec::new();
        }
        let mut listed: Vec<(Explanation, &Fit)> = Vec::new();
        for account in ranked.iter().map(|k| &self.accounts[*k]) {
            let effects: Vec<Instance> =
                account.items.iter().map(|s| s.instance).filter(|i| !is_data(i)).collect();
            let noise = account.noise.filter(|_| effects.is_empty()).map(|noise| noise.target);
            let same = |one: &(Explanation, &Fit)| {
                let known = &one.0.effects;
                known.len() == effects.len()
                    && known.iter().all(|i| effects.contains(i))
                    && one.0.noise == noise
            };
            let dearer = |k: &usize| account.extends(&self.accounts[*k]);
            if listed.iter().any(same)
                || ranked
                    .iter()
                    .take_while(|k| self.accounts[**k].price < account.price)
                    .any(dearer)
            {
                continue;
            }
            let (chi2, probability) = (account.price, 1.0);
            let one = Explanation { effects, noise, chi2, probability, apart: None };
            listed.push((one, &account.fit));
        }
        let small = &self.averaged.small;
        workers::map(nearest(listed), |(mut explanation, refit)| {
            explanation.apart = apart(small, &best.fit, refit);
            explanation
        })
    }
}

/// Bad readings are rivals of bad readings of the same pose, effects of effects.
fn same_kind(a: &Instance, b: &Instance) -> bool {
    is_data(a) == is_data(b) && (!is_data(a) || a.place == b.place)
}

/// True for a lasting error of one thing that is drawn.
fn is_drawn(scored: &Scored) -> bool {
    let info = scored.instance.term.info();
    let drawn = matches!(info.class, Class::Sensor | Class::Geometry);
    drawn && scored.family == Family::Named
}

/// True for a lasting error of a surface.
fn is_of_surface(scored: &Scored) -> bool {
    let surface = matches!(scored.instance.term.acts(), Acts::Surface(_));
    surface && scored.family == Family::Named
}

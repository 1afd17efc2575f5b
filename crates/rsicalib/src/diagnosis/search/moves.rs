//! The moves of the search: from one explanation to its neighbours.

use std::borrow::Cow;

use crate::Error;
use crate::diagnosis::options::Rule;
use crate::diagnosis::price::charge;
use crate::diagnosis::score::scored::{Scored, excluded_pose, is_data};
use crate::diagnosis::score::times::{happened_once, retimed};
use crate::diagnosis::score::{candidates, pairs};
use crate::diagnosis::search::account::{Account, More};
use crate::diagnosis::search::admissible::physical;
use crate::diagnosis::search::beam::{Beam, MOST_REFITS, charge_of};
use crate::diagnosis::search::noise::{Shown, UnknownNoise, unknown_noises};
use crate::diagnosis::search::orders::nearest_place;
use crate::estimate::{Fit, Observations, fit};
use crate::model::Instance;
use crate::numerics::credible_set::RIVAL;
use crate::numerics::order;
use crate::numerics::workers;

/// After so many moves noise and fit agree, or never will.
const NOISE_MOVES: usize = 6;

/// After so many moves an order is the last, or there is none.
const ORDER_MOVES: usize = 3;

impl Beam<'_, '_> {
    /// The explanation without some of its items, by their numbers.
    pub(super) fn without(&mut self, of: usize, gone: &[usize]) -> Result<usize, Error> {
        if gone.is_empty() {
            return Ok(of);
        }
        let Account { items, noise, fit: from, .. } = &self.accounts[of];
        let kept = items.iter().enumerate().filter(|(k, _)| !gone.contains(k));
        let (items, noise): (Vec<Scored>, _) = (kept.map(|(_, item)| *item).collect(), *noise);
        if let Some(known) = self.known(&items, noise.as_ref()) {
            return Ok(known);
        }
        let gone: Vec<Instance> =
            gone.iter().map(|k| self.accounts[of].items[*k].instance).collect();
        let kept = from.model.instances.iter().copied().filter(|i| !gone.contains(i)).collect();
        let session = self.session(&items, noise.as_ref());
        let mut fitted = fit(&session, kept, Some(from))?;
        drop(session);
        let mut noise = noise;
        if let Some(own) = noise {
            let (shown, last) = self.in_turn(&items, own, fitted, true)?;
            (noise, fitted) = (Some(shown), last);
        }
        let base = &self.accounts[0].fit;
        let admitted = self.admits(&items, &fitted) && self.averaged.sensible(base, &fitted);
        let price = self.price(&fitted, &items, noise.as_ref());
        self.accounts.push(Account { admitted, ..Account::of(items, noise, fitted, price) });
        Ok(self.accounts.len() - 1)
    }

    /// Adds one item to an explanation, those within the limit by their scores.
    pub(super) fn grow(&mut self, of: usize, limit: f64) -> Result<(), Error> {
        self.scan(of)?;
        let account = &self.accounts[of];
        let Some(scored) = &account.scored else { return Ok(()) };
        if account.items.len() >= self.averaged.search.most {
            return Ok(());
        }
        let left = MOST_REFITS.saturating_sub(account.tried);
        let rest = scored.iter().skip(account.tried).take(left);
        let likely: Vec<More> = rest
            .take_while(|s| self.price_with(account, s) < limit)
            .map(|s| More::Items(vec![*s]))
            .collect();
        self.accounts[of].tried += likely.len();
        self.add(of, likely)
    }

    /// Adds two items at once to an explanation.
    pub(super) fn pair(&mut self, of: usize, best: f64) -> Result<(), Error> {
        self.accounts[of].paired = true;
        let account = &self.accounts[of];
        let search = self.averaged.search;
        if account.items.len() + 2 > search.most || !search.uses(Rule::FindPairs) {
            return Ok(());
        }
        let session = self.session(&account.items, account.noise.as_ref());
        let mut named =
            candidates::candidates(&session, &account.fit, &self.averaged.search.without);
        named.retain(|i| !i.term.info().penalised);
        let judge = self.averaged.judge(&account.fit);
        let needed = account.price - best;
        let said = self.averaged.said(&account.fit);
        let priced = |width: f64, score: f64| charge(width, said.fall(score));
        let mut two = pairs::pairs(&session, &account.fit, &judge, &named, &priced, needed)?;
        drop(session);
        order::descending(&mut two, |a| a.charged());
        let likely = two.iter().take(MOST_REFITS / 2).map(More::from).collect();
        self.add(of, likely)?;
        self.two_wrong(of, best)
    }

    /// Adds two wrong readings to an explanation: the likeliest, and the likeliest beside it.
    fn two_wrong(&mut self, of: usize, best: f64) -> Result<(), Error> {
        if !self.averaged.search.uses(Rule::TwoWrong) {
            return Ok(());
        }
        self.scan(of)?;
        let likeliest = |account: &Account| {
            account.scored.iter().flatten().find(|s| is_data(&s.instance)).copied()
        };
        let Some(first) = likeliest(&self.accounts[of]) else { return Ok(()) };
        let limit = best + RIVAL;
        // The second is taken to be as likely as the first.
        let each = self.price_with(&self.accounts[of], &first) - self.accounts[of].price;
        if self.accounts[of].price + 2.0 * each > limit {
            return Ok(());
        }
        self.add(of, vec![More::Items(vec![first])])?;
        let items = [&self.accounts[of].items[..], &[first]].concat();
        let Some(one) = self.known(&items, self.accounts[of].noise.as_ref()) else {
            return Ok(());
        };
        self.scan(one)?;
        let scored = self.accounts[one].scored.iter().flatten();
        let second = scored.filter(|s| is_data(&s.instance)).take(MOST_REFITS / 2);
        let second = second.map(|s| More::Items(vec![*s])).collect();
        self.add(one, second)
    }

    /// Moves of an explanation itself: one item more, all joints that give.
    pub(super) fn moves_of(&mut self, of: usize) -> Result<(), Error> {
        self.scan(of)?;
        self.grow(of, self.accounts[of].price)?;
        self.give(of)?;
        self.accounts[of].moved = true;
        Ok(())
    }

    /// Noise that nobody knows of beside an explanation.
    pub(super) fn noise_beside(&mut self, of: usize) -> Result<(), Error> {
        self.accounts[of].noised = true;
        if !self.averaged.search.uses(Rule::UnknownNoise) {
            return Ok(());
        }
        let account = &self.accounts[of];
        let session = self.session(&account.items, None);
        let noises = unknown_noises(&session, &account.fit, &self.averaged.said(&account.fit));
        drop(session);
        self.add(of, noises.into_iter().map(More::Noise).collect())
    }

    /// Noise and fit in turn, as long as the price falls; where it is `new`, larger noise as well.
    pub(super) fn in_turn(
        &self,
        items: &[Scored],
        noise: UnknownNoise,
        mut fitted: Fit,
        new: bool,
    ) -> Result<(UnknownNoise, Fit), Error> {
        let shown = |noise: UnknownNoise, at: &Fit| {
            Shown::of(&self.session(items, Some(&noise)), at, noise, self.averaged.said(at))
        };
        let mut here = shown(noise, &fitted);
        for _ in 0..NOISE_MOVES {
            let price = self.price(&fitted, items, Some(&here.itself()));
            let mut better = None;
            for next in here.next(new) {
                let session = self.session(items, Some(&next));
                let there = fit(&session, fitted.model.instances.clone(), Some(&fitted))?;
                let next = shown(next, &there);
                if self.price(&there, items, Some(&next.itself())) < price {
                    better = Some((next, there));
                    break;
                }
            }
            let Some((next, there)) = better else { break };
            (here, fitted) = (next, there);
        }
        Ok((here.itself(), fitted))
    }

    /// Parts what chains share where it stands beside the same of one of them.
    fn part(&mut self, of: usize) -> Result<(), Error> {
        let Some((gone, parts)) = self.shared_and_own(&self.accounts[of].items) else {
            return Ok(());
        };
        let rest = self.without(of, &gone)?;
        let mut each = self.scores(&self.accounts[rest])?;
        each.retain(|s| parts.contains(&s.instance));
        match each.len() == parts.len() {
            true => self.add(rest, vec![More::Items(each)]),
            false => Ok(()),
        }
    }

    /// True for items that physics admits beside each other.
    pub(super) fn admits(&self, items: &[Scored], fitted: &Fit) -> bool {
        items.iter().all(|item| physical(fitted, &item.instance))
            && (self.shared_and_own(items).is_none() || !self.averaged.search.uses(Rule::Parts))
    }

    /// What chains share beside the same of one of them, by their numbers, with what stands for both:
    /// one for each of the chains.
    fn shared_and_own(&self, items: &[Scored]) -> Option<(Vec<usize>, Vec<Instance>)> {
        items.iter().enumerate().find_map(|(k, shared)| {
            let parts = self.parts_of(&shared.instance)?;
            let own = |item: &Scored| parts.contains(&item.instance);
            let gone = (0..items.len()).filter(|j| *j == k || own(&items[*j]));
            items.iter().any(own).then(|| (gone.collect(), parts.clone()))
        })
    }

    /// True where one is what chains share, and the other the same of one of them.
    pub(super) fn overlap(&self, a: &Instance, b: &Instance) -> bool {
        let within = |all: &Instance, one: &Instance| {
            self.parts_of(all).is_some_and(|parts| parts.contains(one))
        };
        within(a, b) || within(b, a)
    }

    /// The instances of the single chains that a shared one stands for; none for another, and for a
    /// delay: one joint may be later than all are.
    fn parts_of(&self, instance: &Instance) -> Option<Vec<Instance>> {
        let shared = instance.target.is_shared() && !instance.term.is_late();
        shared.then(|| {
            let parts = self.averaged.small.mechanism.parts(instance.target).into_iter();
            parts.map(|target| Instance { target, ..*instance }).collect()
        })
    }

    /// All joints that give under the links' weight at once.
    fn give(&mut self, of: usize) -> Result<(), Error> {
        let account = &self.accounts[of];
        let Cow::Borrowed(_) = self.session(&account.items, account.noise.as_ref()) else {
            return Ok(());
        };
        let scored = self.scores(account)?;
        let joint = self.averaged.yielding(&account.fit, &scored)?;
        let Some((mut joints, fitted)) = joint else { return Ok(()) };
        let said = self.averaged.said(&account.fit);
        joints.iter_mut().for_each(|s| s.charge = charge_of(s, &said));
        let items = [&account.items[..], &joints].concat();
        if self.known(&items, None).is_some() {
            return Ok(());
        }
        let price = self.price(&fitted, &items, None);
        self.accounts.push(Account::of(items, None, fitted, price));
        Ok(())
    }

    /// Refits an explanation with more, each by itself.
    fn add(&mut self, of: usize, more: Vec<More>) -> Result<(), Error> {
        let account = &self.accounts[of];
        let noisy = account.noise.is_some();
        let wanted = more.into_iter().map(|more| {
            let (mut items, mut noise) = (account.items.clone(), account.noise);
            match more {
                More::Items(more) => items.extend(more),
                More::Noise(more) => noise = Some(more),
            }
            (items, noise)
        });
        let new: Vec<_> =
            wanted.filter(|(items, noise)| self.known(items, noise.as_ref()).is_none()).collect();
        let before = &account.fit;
        let refits = workers::map(new, |(items, noise)| -> Result<_, Error> {
            let session = self.session(&items, noise.as_ref());
            let old = account.items.len();
            let mut found = refit(&session, before, items, old)?;
            if self.price(&found.1, &found.0, noise.as_ref()) < account.price {
                let there = at_likeliest_times(&session, before, found.clone(), old)?;
                if self.admits(&there.0, &there.1) {
                    found = there;
                }
            }
            let ((items, mut fitted), mut noise) = (found, noise);
            if let Some(own) = noise {
                let (shown, last) = self.in_turn(&items, own, fitted, !noisy)?;
                (noise, fitted) = (Some(shown), last);
            }
            Ok((items, noise, fitted))
        });
        let mut found = Vec::new();
        for refit in refits {
            let (items, noise, fitted) = match refit {
                Err(Error::TooFew { .. }) => continue,
                refit => refit?,
            };
            let quieter = noise.is_some() != noisy;
            let admitted = self.admits(&items, &fitted)
                && (quieter || self.averaged.sensible(before, &fitted));
            let price = self.price(&fitted, &items, noise.as_ref());
            found.push(Account { admitted, ..Account::of(items, noise, fitted, price) });
        }
        let first = self.accounts.len();
        for account in found {
            if self.known(&account.items, account.noise.as_ref()).is_none() {
                self.accounts.push(account);
            }
        }
        let limit = self.limit();
        let near = |new: &usize| self.accounts[*new].price < limit;
        let near: Vec<usize> = (first..self.accounts.len()).filter(near).collect();
        near.into_iter().try_for_each(|new| self.part(new))
    }
}

/// The fit with items from number `old` on added, an order at the place where the fit has tuned it.
fn refit(
    session: &Observations,
    before: &Fit,
    mut items: Vec<Scored>,
    old: usize,
) -> Result<(Vec<Scored>, Fit), Error> {
    let with = |items: &[Scored]| {
        let mut instances = before.model.instances.clone();
        let new = items[old..].iter().map(|item| item.instance);
        instances.extend(new.filter(|i| excluded_pose(i).is_none()));
        fit(session, instances, Some(before))
    };
    let mut fitted = with(&items)?;
    for _ in 0..ORDER_MOVES {
        let moved = (old..items.len())
            .find_map(|k| nearest_place(&fitted, &items[k].instance).map(|place| (k, place)));
        let Some((k, place)) = moved else { break };
        items[k].instance.place = place;
        fitted = with(&items)?;
    }
    Ok((items, fitted))
}

/// The same with what happened once at its likeliest time.
fn at_likeliest_times(
    session: &Observations,
    before: &Fit,
    (mut items, mut fitted): (Vec<Scored>, Fit),
    old: usize,
) -> Result<(Vec<Scored>, Fit), Error> {
    for item in items[old..].iter_mut().filter(|item| happened_once(&item.instance)) {
        (item.instance, fitted) = retimed(session, before, fitted, item.instance)?;
    }
    Ok((items, fitted))
}

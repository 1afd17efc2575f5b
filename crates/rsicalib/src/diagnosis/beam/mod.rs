//! The search: a beam over explanations of a session, likeliest first.
//!
//! The explanation of the lowest price (113) whose neighbours are not all known is taken, until those of
//! every one within [`RIVAL`] of the best are. Neighbours of an explanation are it with one item more or
//! less, with two more, with one for one, one for two and two for one or two: whatever is said of what
//! is left when none, one or two of its items are taken away. Of what is added the first-order score, (71)
//! and (72), says what its price would be; what cannot be among the best is not refitted.

mod account;
pub mod answers;
mod noise;

use std::borrow::Cow;

use crate::Error;
use crate::diagnosis::beam::account::{Account, More};
use crate::diagnosis::beam::noise::unknown_noises;
use crate::diagnosis::options::Rule;
use crate::diagnosis::price::{CHARGE, Family, charge, room};
use crate::diagnosis::score::scored::{Scored, excluded_pose, is_data, one_place_each};
use crate::diagnosis::score::{candidates, pairs, scan};
use crate::diagnosis::stepwise::moves::{Stepwise, cost, physical};
use crate::diagnosis::stepwise::orders::nearest_place;
use crate::estimate::{Fit, Observations, fit};
use crate::model::Instance;
use crate::numerics::credible_set::RIVAL;
use crate::numerics::workers;

/// Neighbours of one explanation that are refitted at a time, on all cores.
const AT_ONCE: usize = 8;

/// Neighbours of one explanation that are refitted at the most.
const MOST_REFITS: usize = 24;

/// Explanations whose neighbours are looked for at the most.
const WIDTH: usize = 4;

/// Of explanations of more items, two are not taken away.
const FEW: usize = 3;

/// The search on its way.
pub struct Beam<'s, 'a> {
    stepwise: &'s Stepwise<'a>,
    accounts: Vec<Account>,
}

/// What is done next: neighbours of one explanation, once some items are taken away.
enum Next {
    /// Moves of the explanation itself.
    Own(usize),
    /// Others in place of what was taken away, below a price.
    Around(usize, f64),
    /// Two in place of what was taken away.
    Pairs(usize),
}

impl<'s, 'a> Beam<'s, 'a> {
    /// Everything that is likely, from a fit in which nothing is wrong.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn search(stepwise: &'s Stepwise<'a>, start: &Fit) -> Result<Self, Error> {
        let price = stepwise.said_of(start);
        let nothing = Account::of(Vec::new(), None, start.clone(), price);
        let mut beam = Self { stepwise, accounts: vec![nothing] };
        while let Some(next) = beam.next()? {
            match next {
                Next::Own(of) => beam.moves_of(of)?,
                Next::Around(of, limit) => beam.grow(of, limit)?,
                Next::Pairs(of) => beam.pair(of)?,
            }
        }
        Ok(beam)
    }

    /// The likeliest explanations, likeliest first.
    pub fn ranked(&self) -> Vec<usize> {
        let limit = self.best_price() + RIVAL;
        let within = |k: &usize| self.accounts[*k].admitted && self.accounts[*k].price <= limit;
        let mut ranked: Vec<usize> = (0..self.accounts.len()).filter(within).collect();
        ranked.sort_by(|a, b| self.accounts[*a].price.total_cmp(&self.accounts[*b].price));
        ranked
    }

    fn best_price(&self) -> f64 {
        let admitted = self.accounts.iter().filter(|account| account.admitted);
        admitted.map(|account| account.price).fold(f64::INFINITY, f64::min)
    }

    /// What is not known yet of the likeliest.
    fn next(&mut self) -> Result<Option<Next>, Error> {
        let ranked = self.ranked();
        let best = self.best_price();
        for (rank, &k) in ranked.iter().take(WIDTH).enumerate() {
            if !self.accounts[k].moved {
                return Ok(Some(Next::Own(k)));
            }
            let items = self.accounts[k].items.len();
            for gone in 0..items {
                let of = self.without(k, &[gone])?;
                if self.open(of, best + RIVAL) {
                    return Ok(Some(Next::Around(of, best + RIVAL)));
                }
            }
            if rank > 0 || items > FEW {
                continue;
            }
            let two = (0..items).flat_map(|b| (0..b).map(move |a| vec![a, b]));
            let one = (0..items).map(|a| vec![a]);
            let all: Vec<Vec<usize>> = two.clone().chain(one).chain([Vec::new()]).collect();
            for gone in two {
                let of = self.without(k, &gone)?;
                if self.open(of, best) {
                    return Ok(Some(Next::Around(of, best)));
                }
            }
            for gone in all {
                let of = self.without(k, &gone)?;
                if !self.accounts[of].paired {
                    return Ok(Some(Next::Pairs(of)));
                }
            }
        }
        Ok(None)
    }

    /// True where something may still be added to an explanation whose price is then below a limit.
    fn open(&self, of: usize, limit: f64) -> bool {
        let account = &self.accounts[of];
        let Some(scored) = &account.scored else { return true };
        account.items.len() < self.stepwise.search.most
            && account.tried < scored.len().min(MOST_REFITS)
            && self.at_best(account, &scored[account.tried]) < limit
    }

    /// The explanation without some of its items, by their numbers.
    fn without(&mut self, of: usize, gone: &[usize]) -> Result<usize, Error> {
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
        let fitted = fit(&session, kept, Some(from))?;
        let base = &self.accounts[0].fit;
        let admitted = items.iter().all(|item| physical(&fitted, &item.instance))
            && self.stepwise.sensible(base, &fitted);
        let price = self.price(&fitted, &items, noise.as_ref());
        self.accounts.push(Account { admitted, ..Account::of(items, noise, fitted, price) });
        Ok(self.accounts.len() - 1)
    }

    fn known(&self, items: &[Scored], noise: Option<&noise::UnknownNoise>) -> Option<usize> {
        self.accounts.iter().position(|account| account.says(items, noise))
    }

    fn price(&self, fit: &Fit, items: &[Scored], noise: Option<&noise::UnknownNoise>) -> f64 {
        let paid: f64 = items.iter().map(Scored::paid).sum();
        self.stepwise.said_of(fit) + paid + noise.map_or(0.0, |noise| noise.paid)
    }

    /// The session in which these poses say nothing, with this noise.
    fn session(
        &self,
        items: &[Scored],
        noise: Option<&noise::UnknownNoise>,
    ) -> Cow<'_, Observations> {
        let small = &self.stepwise.small;
        let poses: Vec<usize> = items.iter().filter_map(|i| excluded_pose(&i.instance)).collect();
        if poses.is_empty() && noise.is_none() {
            return Cow::Borrowed(small);
        }
        let mut session = small.clone();
        poses.into_iter().for_each(|pose| session.weights[pose] = 0.0);
        if let Some(noise) = noise {
            noise.in_session(&mut session, &self.accounts[0].fit);
        }
        Cow::Owned(session)
    }

    /// The least price that an explanation with one more item may have: scores are first order.
    fn at_best(&self, account: &Account, item: &Scored) -> f64 {
        self.with_score(account, item.score + room(item.score)) + item.paid()
    }

    /// The price of an explanation of which χ² falls by a score.
    fn with_score(&self, account: &Account, score: f64) -> f64 {
        account.price - self.fall(account, score)
    }

    /// By how much what readings say of an explanation falls where χ² does by a score.
    fn fall(&self, account: &Account, score: f64) -> f64 {
        let chi2 = cost(&account.fit);
        self.stepwise.data_of(chi2) - self.stepwise.data_of((chi2 - score).max(0.0))
    }

    /// What parameters cost beside an explanation.
    fn charge(&self, account: &Account, width: f64, score: f64) -> f64 {
        match self.stepwise.search.uses(Rule::Charge) {
            true => CHARGE * width,
            false => charge(width, self.fall(account, score)),
        }
    }

    /// Scores everything beside an explanation, likeliest first.
    fn scan(&mut self, of: usize) -> Result<(), Error> {
        if self.accounts[of].scored.is_some() {
            return Ok(());
        }
        let account = &self.accounts[of];
        let mut scored = self.scores(account)?;
        scored.iter_mut().for_each(|s| {
            s.charge = match s.family {
                Family::Free if self.stepwise.search.uses(Rule::Marginal) => s.marginal,
                _ => self.charge(account, s.width, s.score),
            };
        });
        let limit = account.price + RIVAL;
        let priced = |s: &Scored| self.with_score(account, s.score) + s.paid();
        let near = scored.into_iter().filter(|s| self.at_best(account, s) < limit);
        let mut order: Vec<(f64, Scored)> = near.map(|s| (priced(&s), s)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut scored: Vec<Scored> = order.into_iter().map(|(_, s)| s).collect();
        // Neighbouring orders, and times, are one candidate.
        one_place_each(&mut scored, |i| !is_data(i));
        self.accounts[of].scored = Some(scored);
        Ok(())
    }

    /// Scores of everything beside an explanation.
    fn scores(&self, account: &Account) -> Result<Vec<Scored>, Error> {
        match self.session(&account.items, account.noise.as_ref()) {
            Cow::Borrowed(_) => self.stepwise.scan(&account.fit),
            Cow::Owned(session) => {
                let judge = self.stepwise.judge(&account.fit);
                scan::scan(&session, &account.fit, &judge, self.stepwise.search)
            }
        }
    }

    /// Adds one item to an explanation, those first that may be within the limit.
    fn grow(&mut self, of: usize, limit: f64) -> Result<(), Error> {
        self.scan(of)?;
        let account = &self.accounts[of];
        let Some(scored) = &account.scored else { return Ok(()) };
        if account.items.len() >= self.stepwise.search.most {
            return Ok(());
        }
        let left = MOST_REFITS.saturating_sub(account.tried).min(AT_ONCE);
        let rest = scored.iter().skip(account.tried).take(left);
        let likely: Vec<More> = rest
            .take_while(|s| self.at_best(account, s) < limit)
            .map(|s| More::Items(vec![*s]))
            .collect();
        self.accounts[of].tried += likely.len();
        self.add(of, likely)
    }

    /// Adds two items at once to an explanation.
    fn pair(&mut self, of: usize) -> Result<(), Error> {
        self.accounts[of].paired = true;
        let account = &self.accounts[of];
        if account.items.len() + 2 > self.stepwise.search.most {
            return Ok(());
        }
        let session = self.session(&account.items, account.noise.as_ref());
        let mut named =
            candidates::candidates(&session, &account.fit, &self.stepwise.search.without);
        named.retain(|i| !i.term.info().penalised);
        let judge = self.stepwise.judge(&account.fit);
        let needed = account.price - self.best_price();
        let (data, chi2) = (self.stepwise.data, cost(&account.fit));
        let constant = self.stepwise.search.uses(Rule::Charge);
        let priced = move |width: f64, score: f64| match constant {
            true => CHARGE * width,
            false => charge(width, data.of(chi2) - data.of((chi2 - score).max(0.0))),
        };
        let mut two = pairs::pairs(&session, &account.fit, &judge, &named, None, &priced, needed)?;
        drop(session);
        two.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        let likely = two.iter().take(AT_ONCE / 2).map(More::from).collect();
        self.add(of, likely)
    }

    /// Moves of an explanation itself: one item more, all joints that give, noise that nobody knows of.
    fn moves_of(&mut self, of: usize) -> Result<(), Error> {
        self.scan(of)?;
        let limit = self.accounts[of].price.min(self.best_price() + RIVAL);
        self.grow(of, limit)?;
        let account = &self.accounts[of];
        if account.noise.is_none() && self.stepwise.search.uses(Rule::UnknownNoise) {
            let session = self.session(&account.items, None);
            let noises = unknown_noises(&session, &account.fit);
            let likely = noises.into_iter().filter(|n| n.paid < n.fall).map(More::Noise).collect();
            drop(session);
            self.add(of, likely)?;
        }
        self.part(of)?;
        self.give(of)?;
        self.accounts[of].moved = true;
        Ok(())
    }

    /// What chains share beside the same of one of them: one for each of them.
    fn part(&mut self, of: usize) -> Result<(), Error> {
        let items = self.accounts[of].items.clone();
        let parts = items.iter().enumerate().find_map(|(k, shared)| {
            let parts = self.stepwise.parts_of(&shared.instance)?;
            let own = |item: &Scored| parts.contains(&item.instance);
            items.iter().any(own).then(|| {
                let gone = (0..items.len()).filter(|j| *j == k || own(&items[*j]));
                (gone.collect::<Vec<usize>>(), parts.clone())
            })
        });
        let Some((gone, parts)) = parts else { return Ok(()) };
        let rest = self.without(of, &gone)?;
        let mut each = self.scores(&self.accounts[rest])?;
        each.retain(|s| parts.contains(&s.instance));
        let there = &self.accounts[rest];
        each.iter_mut().for_each(|s| s.charge = self.charge(there, s.width, s.score));
        match each.len() == parts.len() {
            true => self.add(rest, vec![More::Items(each)]),
            false => Ok(()),
        }
    }

    /// All joints that give under the links' weight at once.
    fn give(&mut self, of: usize) -> Result<(), Error> {
        let account = &self.accounts[of];
        let Cow::Borrowed(_) = self.session(&account.items, account.noise.as_ref()) else {
            return Ok(());
        };
        let scored = self.scores(account)?;
        let Some((_, mut joints, fitted)) = self.stepwise.yielding(&account.fit, &scored)? else {
            return Ok(());
        };
        joints.iter_mut().for_each(|s| s.charge = self.charge(account, s.width, s.score));
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
        let old = account.items.len();
        let sessions: Vec<_> =
            new.iter().map(|(items, noise)| self.session(items, noise.as_ref())).collect();
        let before = &account.fit;
        let refits = workers::map(new.iter().zip(&sessions), |((items, _), session)| {
            refit(session, before, items.clone(), old)
        });
        let mut found = Vec::new();
        for ((_, noise), refit) in new.into_iter().zip(refits) {
            let (items, fitted) = match refit {
                Err(Error::TooFew { .. }) => continue,
                refit => refit?,
            };
            let quieter = noise.is_some() != account.noise.is_some();
            let admitted = items.iter().all(|item| physical(&fitted, &item.instance))
                && (quieter || self.stepwise.sensible(before, &fitted));
            let price = self.price(&fitted, &items, noise.as_ref());
            found.push(Account { admitted, ..Account::of(items, noise, fitted, price) });
        }
        drop(sessions);
        for account in found {
            if self.known(&account.items, account.noise.as_ref()).is_none() {
                self.accounts.push(account);
            }
        }
        Ok(())
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

/// After so many moves an order has settled, or never will.
const ORDER_MOVES: usize = 3;

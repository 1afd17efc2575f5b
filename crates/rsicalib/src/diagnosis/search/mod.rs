//! The search: a beam over explanations of a session, likeliest first.
//!
//! The explanation of the lowest price (113) whose neighbours are not all known is taken, until those of
//! every one within [`RIVAL`] of the best are. Neighbours of an explanation are it with one item more or
//! less, with two more, with one for one, one for two and two for one or two: whatever is said of what
//! is left when none, one or two of its items are taken away. Of what is added the first-order score, (71)
//! and (72), says what its price would be; what would not be among the best by that is not refitted.

mod account;
pub(crate) mod admissible;
pub mod answers;
mod beam;
pub(crate) mod known;
mod moves;
pub mod noise;
pub(crate) mod orders;
pub mod outcome;
pub mod rivals;
mod yielding;

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::plausibility::{Absurdity, absurdities};
use crate::diagnosis::price::in_steps;
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::search::account::Account;
use crate::diagnosis::search::beam::{Beam, MOST_REFITS};
use crate::estimate::Fit;
use crate::model::Instance;
use crate::numerics::credible_set::RIVAL;
use crate::numerics::order;

/// Explanations whose neighbours are looked for at the most.
const WIDTH: usize = 2;

/// Of explanations of more items, two are not taken away.
const FEW: usize = 3;

/// What is done next: neighbours of one explanation, once some items are taken away.
enum Next {
    /// Moves of the explanation itself.
    Own(usize),
    /// Noise that nobody knows of beside the explanation.
    Noise(usize),
    /// Others in place of what was taken away, below a price.
    Around(usize, f64),
    /// Two in place of what was taken away, beside the likeliest of this price.
    Pairs(usize, f64),
}

impl<'s, 'a> Beam<'s, 'a> {
    /// Everything that is likely, from a fit in which nothing is wrong.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn search(averaged: &'s Averaged<'a>, start: &Fit) -> Result<Self, Error> {
        let price = averaged.said_of(start);
        let nothing = Account::of(Vec::new(), None, start.clone(), price);
        let lost = !absurdities(&averaged.small, start, &[]).is_empty();
        let mut beam = Self { averaged, accounts: vec![nothing] };
        while let Some(next) = beam.next()? {
            // Effects and wrong readings have been tried; noise would take all of it.
            if lost && matches!(next, Next::Noise(_)) && beam.leads_nowhere() {
                beam.accounts.truncate(1);
                break;
            }
            match next {
                Next::Own(of) => beam.moves_of(of)?,
                Next::Noise(of) => beam.noise_beside(of)?,
                Next::Around(of, limit) => beam.grow(of, limit)?,
                Next::Pairs(of, best) => beam.pair(of, best)?,
            }
        }
        Ok(beam)
    }

    /// True where what explains an absurd fit best is absurd itself: readings that are not of this
    /// mechanism fit any, once effects are large enough to undo what its joints do.
    fn leads_nowhere(&self) -> bool {
        let best = self.ranked().first().map(|k| &self.accounts[*k]);
        // A reading that is wrong may be all that keeps loops open.
        let sound = |best: &&Account| best.items.iter().all(|item| !is_data(&item.instance));
        best.filter(sound).is_some_and(|best| {
            let effects: Vec<Instance> = best.items.iter().map(|item| item.instance).collect();
            let of_effects = |it: &Absurdity| !it.is_of_readings();
            absurdities(&self.averaged.small, &best.fit, &effects).iter().any(of_effects)
        })
    }

    /// The likeliest explanations, likeliest first.
    pub fn ranked(&self) -> Vec<usize> {
        self.ranked_of(|_| true)
    }

    /// The likeliest of some, likeliest first.
    fn ranked_of(&self, some: impl Fn(&Account) -> bool) -> Vec<usize> {
        let of = |k: &usize| self.accounts[*k].admitted && some(&self.accounts[*k]);
        let mut ranked: Vec<usize> = (0..self.accounts.len()).filter(of).collect();
        order::ascending(&mut ranked, |k| in_steps(self.accounts[*k].price));
        let limit = ranked.first().map_or(0.0, |best| self.accounts[*best].price + RIVAL);
        ranked.retain(|k| self.accounts[*k].price <= limit);
        ranked
    }

    /// What is not known yet: first without noise that nobody knows of, which in one step explains what
    /// takes two readings that are wrong.
    fn next(&mut self) -> Result<Option<Next>, Error> {
        let without_noise = self.ranked_of(|account| account.noise.is_none());
        if let Some(next) = self.next_of(&without_noise)? {
            return Ok(Some(next));
        }
        let mut bases = std::iter::once(0).chain(without_noise.into_iter().take(WIDTH));
        if let Some(of) = bases.find(|of| !self.accounts[*of].noised) {
            return Ok(Some(Next::Noise(of)));
        }
        let limit = self.limit();
        let hopeful = |it: &Account| it.noise.is_some() && self.is_hopeful(it, limit);
        let with_noise = self.ranked_of(hopeful);
        if let Some(next) = self.next_of(&with_noise)? {
            return Ok(Some(next));
        }
        self.next_of(&self.ranked())
    }

    /// True where an explanation would be listed if something were added that costs nothing and leaves noise.
    fn is_hopeful(&self, account: &Account, limit: f64) -> bool {
        let left = (account.fit.cost() - account.fit.dof).max(0.0);
        self.with_score(account, left) < limit
    }

    /// What is not known yet of the likeliest.
    fn next_of(&mut self, ranked: &[usize]) -> Result<Option<Next>, Error> {
        let best = ranked.first().map_or(0.0, |best| self.accounts[*best].price);
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
                    return Ok(Some(Next::Pairs(of, best)));
                }
            }
        }
        Ok(None)
    }

    /// True where something may still be added to an explanation whose price is then below a limit.
    fn open(&self, of: usize, limit: f64) -> bool {
        let account = &self.accounts[of];
        let Some(scored) = &account.scored else { return true };
        account.items.len() < self.averaged.search.most
            && account.tried < scored.len().min(MOST_REFITS)
            && self.price_with(account, &scored[account.tried]) < limit
    }
}

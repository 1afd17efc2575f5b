//! What a search knows: explanations with their prices, and what scores beside them.

use std::borrow::Cow;

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::price::{Family, Said, charge, in_steps};
use crate::diagnosis::score::scan;
use crate::diagnosis::score::scored::{Scored, excluded_pose, is_data, one_place_each, paid};
use crate::diagnosis::score::times::over_times;
use crate::diagnosis::search::account::Account;
use crate::diagnosis::search::noise::UnknownNoise;
use crate::estimate::{Fit, Observations};
use crate::numerics::credible_set::RIVAL;
use crate::numerics::order;

/// Neighbours of one explanation that are refitted at the most.
pub(super) const MOST_REFITS: usize = 8;

/// The search on its way.
pub struct Beam<'s, 'a> {
    pub(super) averaged: &'s Averaged<'a>,
    pub(super) accounts: Vec<Account>,
}

impl Beam<'_, '_> {
    /// Prices of explanations that are listed are below this.
    pub(super) fn limit(&self) -> f64 {
        let admitted = self.accounts.iter().filter(|account| account.admitted);
        admitted.map(|account| account.price).fold(f64::INFINITY, f64::min) + RIVAL
    }

    pub(super) fn known(&self, items: &[Scored], noise: Option<&UnknownNoise>) -> Option<usize> {
        self.accounts.iter().position(|account| account.says(items, noise))
    }

    pub(super) fn price(&self, fit: &Fit, items: &[Scored], noise: Option<&UnknownNoise>) -> f64 {
        self.averaged.said_of(fit)
            + paid(items)
            + noise.map_or(0.0, |noise| noise.paid_beside(items))
    }

    /// The session in which these poses say nothing, with this noise.
    pub(super) fn session(
        &self,
        items: &[Scored],
        noise: Option<&UnknownNoise>,
    ) -> Cow<'_, Observations> {
        let small = &self.averaged.small;
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

    /// The price of an explanation with one more item, by its first-order score.
    pub(super) fn price_with(&self, account: &Account, item: &Scored) -> f64 {
        self.with_score(account, item.score) + account.paid_with(item)
    }

    /// The price of an explanation of which χ² falls by a score.
    pub(super) fn with_score(&self, account: &Account, score: f64) -> f64 {
        account.price - self.averaged.said(&account.fit).fall(score)
    }

    /// Scores everything beside an explanation, likeliest first.
    pub(super) fn scan(&mut self, of: usize) -> Result<(), Error> {
        if self.accounts[of].scored.is_some() {
            return Ok(());
        }
        let account = &self.accounts[of];
        let scored = self.scores(account)?;
        let limit = account.price + RIVAL;
        let priced = scored.into_iter().map(|s| (self.price_with(account, &s), s));
        let mut order: Vec<(f64, Scored)> = priced.filter(|(price, _)| *price < limit).collect();
        order::ascending(&mut order, |(price, _)| in_steps(*price));
        let mut scored: Vec<Scored> = order.into_iter().map(|(_, s)| s).collect();
        // Neighbouring orders, and times, are one candidate.
        one_place_each(&mut scored, |i| !is_data(i));
        self.accounts[of].scored = Some(scored);
        Ok(())
    }

    /// Scores of everything beside an explanation, with what it costs there.
    pub(super) fn scores(&self, account: &Account) -> Result<Vec<Scored>, Error> {
        let mut scored = match self.session(&account.items, account.noise.as_ref()) {
            Cow::Borrowed(_) => self.averaged.scan(&account.fit)?,
            Cow::Owned(session) => {
                let judge = self.averaged.judge(&account.fit);
                scan::scan(&session, &account.fit, &judge, self.averaged.search)?
            }
        };
        let said = self.averaged.said(&account.fit);
        scored.iter_mut().for_each(|s| s.charge = charge_of(s, &said));
        over_times(&mut scored, &said);
        Ok(scored)
    }
}

/// What parameters cost beside a fit; those of a free shape over its own amplitudes, (117).
pub(super) fn charge_of(scored: &Scored, beside: &Said) -> f64 {
    match scored.family {
        Family::Free => scored.charge,
        _ => charge(scored.told, beside.fall(scored.score)),
    }
}

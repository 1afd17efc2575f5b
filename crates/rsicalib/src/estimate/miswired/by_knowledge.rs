//! Mistakes in few poses, judged by all that is known beside the readings.
//!
//! From few poses almost any wiring leads to a good fit of gains and offsets that nobody knows.
//! Where gains have priors, these and a held rest pose are equations, too: a wrong wire then
//! costs χ². A mistake is named only where it is the only one that explains the poses.

use crate::Error;
use crate::estimate::miswired::again::DECISIVE;
use crate::estimate::miswired::mistake::Mistake;
use crate::estimate::miswired::rewired::Rewired;
use crate::estimate::search::{End, StartSearch, anchored};
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::mechanism::Mechanism;
use crate::numerics::order;
use crate::readings::Readings;

/// The poses, each the mean of its samples, with the square root of their number as its weight.
struct Poses<'a> {
    search: &'a StartSearch<'a>,
    readings: Readings,
    weights: Vec<f64>,
}

impl<'a> Poses<'a> {
    fn new(search: &'a StartSearch<'a>) -> Result<Self, Error> {
        let (all, mechanism) = (&*search.readings, &search.observations.mechanism);
        let (readings, live) = match all.held {
            true => all.averaged(mechanism, &search.weights)?,
            false => (all.clone(), search.weights.clone()),
        };
        Ok(Self { search, readings, weights: live.into_iter().map(f64::sqrt).collect() })
    }

    /// χ² per equation of the best fit from a start, with the rest pose `held`.
    fn from(&self, readings: &Readings, held: Option<&(Mechanism, Readings)>, x: &[f64]) -> f64 {
        self.search.end_knowing(readings, &self.weights, held, x).score
    }

    /// The same from the rest pose and nominal gains, without a mistake.
    fn without(&self, Rewired { readings, observations }: &Rewired) -> f64 {
        let factors = vec![1.0; readings.channels];
        let start = anchored(observations, self.search.model, &factors);
        self.from(readings, observations.held.as_ref(), &start)
    }

    /// The same as it is declared, also from the best end of the search.
    fn declared(&self, best: Option<&End>) -> f64 {
        let observations = self.search.observations;
        let anchor = anchored(observations, self.search.model, &vec![1.0; self.readings.channels]);
        let starts = [Some(&anchor), best.map(|end| &end.beta)];
        let scores = starts
            .into_iter()
            .flatten()
            .map(|start| self.from(&self.readings, observations.held.as_ref(), start));
        scores.fold(f64::INFINITY, f64::min)
    }

    /// Every mistake with the readings and the χ² per equation that are left without it, the best
    /// first.
    fn mistakes(&self) -> Vec<(f64, Mistake, Rewired)> {
        let of = self.search.observations;
        let wires = Mistake::exchanges(of).chain(Mistake::reversals(of));
        let undone = |mistake: Mistake| {
            let rewired = mistake.undone(of, &self.readings)?;
            Some((self.without(&rewired), mistake, rewired))
        };
        let mut found: Vec<_> = wires.chain(Mistake::units(of)).filter_map(undone).collect();
        order::ascending(&mut found, |a| a.0);
        found
    }
}

/// The only mistake with which the poses agree with what is known, if they do not without one.
/// `best` is the best end of the search, where there is one.
#[must_use]
pub(crate) fn suspect(search: &StartSearch<'_>, best: Option<&End>) -> Option<Suspicion> {
    let poses = Poses::new(search).ok()?;
    let declared = poses.declared(best);
    if declared < DECISIVE {
        return None;
    }
    let mut found = poses.mistakes().into_iter();
    let (with, mistake, rewired) = found.next()?;
    let next = found.next().map_or(f64::INFINITY, |(score, ..)| score);
    let chances = mistake.by_chance(&rewired);
    let by_chance = chances.map(|(other, counts)| counts * poses.without(&other));
    let by_chance = by_chance.fold(f64::INFINITY, f64::min);
    let limit = declared.min(next).min(by_chance) / DECISIVE;
    let suspected = with.max(1.0) <= limit.min(search.observations.options.good_start);
    suspected.then(|| mistake.suspicion(Closes { with, declared }))
}

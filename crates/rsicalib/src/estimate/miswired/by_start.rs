//! Mistakes that the search for a start tells, a track whose gap lies within the range of motion among
//! them.
//!
//! No start leads to a good fit then. Each mistake is tried in turn: where the loop
//! closes with it and with no other, it is named.

use crate::numerics::order;
use crate::numerics::order::Ends;
use std::cmp::Ordering;

use crate::estimate::miswired::again::{DECISIVE, LITTLE};
use crate::estimate::miswired::mistake::Mistake;
use crate::estimate::miswired::rewired::{Rewired, stays};
use crate::estimate::search::{End, StartSearch, anchored, ratios};
use crate::estimate::suspicion::{Closes, Shown, Suspicion};
use crate::readings::Table;
use crate::terms::term::Role;

/// A suspicion, and the fit that takes the mistake into account where that needs no other
/// readings.
#[derive(Debug, Clone)]
pub struct Suspected {
    /// What looks wrong.
    pub suspicion: Suspicion,
    /// The fit.
    pub end: Option<End>,
    /// What may have been done instead, and closes the loop as well.
    pub instead: Vec<Suspicion>,
}

/// Part of the range without a single reading that makes a jump.
const JUMP: f64 = 0.3;

/// Part of the range that counts as its end.
const EDGE: f64 = 1e-3;

/// Common factors on the gains from which each mistake is tried.
const FACTORS: [f64; 3] = [1.0, 0.7, 1.4];

/// The mistake that explains why no start led to a χ² per equation below `best`.
#[must_use]
pub fn suspect(search: &StartSearch<'_>, best: f64) -> Option<Suspected> {
    let limit = search.observations.options.good_start.min(best / DECISIVE);
    let mut found: Option<(f64, Suspected)> = None;
    let mut consider = |end: End, keep: bool, suspicion: &dyn Fn(Closes) -> Suspicion| {
        if end.score < found.as_ref().map_or(limit, |f| f.0) {
            let suspicion = suspicion(Closes { with: end.score, declared: best });
            let (score, end) = (end.score, keep.then_some(end));
            found = Some((score, Suspected { suspicion, end, instead: Vec::new() }));
        }
    };
    let channels = search.model.scales.len();
    if let Some(Turned { end, mistakes, channels }) = Turned::of(search, limit) {
        consider(end, true, &|closes| {
            let either = Mistake::either(&mistakes, closes).pop();
            either.unwrap_or_else(|| Suspicion::Reversed { channels: channels.clone(), closes })
        });
    }
    let of = search.observations;
    let units = Mistake::units(of).chain(Mistake::offsets(of));
    // What no gain can reverse is reversed in the readings; of a leader and its follower it is the follower.
    let apart = |it: &Mistake| match it {
        Mistake::Reversed(c) => {
            search.model.column(Role::Gain, *c).is_none() && !of.mechanism.leads(*c)
        }
        _ => true,
    };
    let reversals = Mistake::reversals(of).filter(apart);
    let mut wires: Vec<(f64, Mistake)> = Vec::new();
    for mistake in Mistake::exchanges(of).chain(reversals).chain(units) {
        let Some(other) = mistake.undone(of, &search.readings) else { continue };
        let Some(end) = rewired(search, &other) else { continue };
        if is_evidence(search, &mistake, &other, &end) {
            let keep = matches!(mistake, Mistake::Offsets { .. });
            wires.push((end.score, mistake.clone()));
            consider(end, keep, &|closes| mistake.suspicion(closes));
        }
    }
    for channel in 0..channels {
        let Some(gap) = Gap::of(search, channel) else { continue };
        let Some(end) = gap.without(search) else { continue };
        let (shown, rows, of) = (gap.shown, gap.rows.len(), search.readings.samples);
        consider(end, false, &|closes| Suspicion::Gap { channel, shown, rows, of, closes });
    }
    let (least, mut found) = found?;
    // What closes as well as the best, of wires.
    wires.retain(|(score, _)| *score <= (1.0 + LITTLE) * least);
    let is_best = wires.iter().any(|(score, _)| *score <= least);
    let alike: Vec<Mistake> = wires.into_iter().map(|(_, mistake)| mistake).collect();
    let mut said = Mistake::either(&alike, Closes { with: least, declared: best });
    if is_best {
        found.suspicion = said.remove(0);
    }
    found.instead = said;
    Some(found)
}

/// The best of a few ends.
fn best_of(ends: impl Iterator<Item = End>) -> Option<End> {
    ends.least_by(|a| a.score)
}

/// The best fit in which gains have the other sign.
struct Turned {
    end: End,
    /// The channels of these gains.
    channels: Vec<usize>,
    /// Reversals of one channel each that close the loop as well, this one among them.
    mistakes: Vec<Mistake>,
}

impl Turned {
    /// The best of all, and of images in a mirror one with the fewest channels: of two in a loop whose joints turn
    /// about parallel axes, either is reversed; of three one is, or the two others are.
    fn of(search: &StartSearch<'_>, limit: f64) -> Option<Self> {
        let channels = search.model.scales.len();
        let mut ends: Vec<End> = (0..channels).map(|c| reversed(search, |i| i == c)).collect();
        ends.push(reversed(search, |_| true));
        let turned = |end: End| {
            // A start may find another channel than the one that it reversed.
            let ratios = ratios(search.model, &end.beta).enumerate();
            let wrong: Vec<usize> =
                ratios.filter(|(_, ratio)| *ratio < 0.0).map(|(c, _)| c).collect();
            (end, wrong)
        };
        let mut ends: Vec<(End, Vec<usize>)> = ends.into_iter().map(turned).collect();
        ends.retain(|(end, wrong)| !wrong.is_empty() && end.score.is_finite());
        let best = ends.iter().least_by(|(a, _)| a.score);
        if let Some((End { beta, score, .. }, wrong)) = best
            && let ([one], true) = (&wrong[..], *score < limit)
        {
            // From a reversed gain with an offset far off, a search may not find the way.
            let others = (0..channels).filter(|other| other != one);
            let image = |other| (turned(image(search, beta, [*one, other])), other);
            let images: Vec<_> = others.map(image).collect();
            let alone = images.into_iter().filter(|((_, wrong), other)| wrong[..] == [*other]);
            ends.extend(alone.map(|(found, _)| found));
        }
        let least = ends.iter().map(|(end, _)| end.score).fold(f64::INFINITY, f64::min);
        // What is left of images in a mirror is the same.
        ends.retain(|(end, _)| end.score <= (1.0 + LITTLE) * least);
        ends.sort_by(|(a, of), (b, other)| {
            (of.len(), a.score).partial_cmp(&(other.len(), b.score)).unwrap_or(Ordering::Equal)
        });
        let mut alone: Vec<usize> =
            ends.iter().filter(|(_, wrong)| wrong.len() == 1).map(|(_, wrong)| wrong[0]).collect();
        alone.sort_unstable();
        alone.dedup();
        let mistakes = alone.into_iter().map(Mistake::Reversed).collect();
        let (end, channels) = ends.into_iter().next()?;
        Some(Self { end, channels, mistakes })
    }
}

/// The fit from the image in a mirror that turns two joints the other way: their gains and angles have the other sign.
fn image(search: &StartSearch<'_>, beta: &[f64], of: [usize; 2]) -> End {
    let model = search.model;
    let mut start = beta.to_vec();
    for c in of {
        let scale = &model.scales[c];
        if let Some(column) = model.column(Role::Gain, c) {
            start[column] = -2.0 * scale.gain - beta[column];
        }
        if let Some(column) = model.column(Role::Offset, c) {
            start[column] = -2.0 * scale.angle - beta[column];
        }
    }
    search.end_with(&search.readings, &search.weights, &start)
}

/// The fit from gains of the other sign at some channels.
fn reversed(search: &StartSearch<'_>, at: impl Fn(usize) -> bool) -> End {
    let channels = search.model.scales.len();
    let from = |factor: f64| {
        let sign = |c: usize| if at(c) { -factor } else { factor };
        let factors: Vec<f64> = (0..channels).map(sign).collect();
        let start = anchored(search.observations, search.model, &factors);
        search.end_with(&search.readings, &search.weights, &start)
    };
    let (cost, score) = (f64::INFINITY, f64::INFINITY);
    let nothing = End { beta: search.model.nominal(), cost, score, elsewhere: false };
    best_of(FACTORS.into_iter().map(from)).unwrap_or(nothing)
}

/// The fit with the readings as they would be without a mistake.
fn rewired(search: &StartSearch<'_>, without: &Rewired) -> Option<End> {
    let Rewired { readings, observations } = without;
    let from = |factor: f64| {
        let factors = vec![factor; search.model.scales.len()];
        let start = anchored(observations, search.model, &factors);
        search.end_with(readings, &search.weights, &start)
    };
    best_of(FACTORS.into_iter().map(from))
}

/// True where an end without a mistake says that it was made.
fn is_evidence(search: &StartSearch<'_>, mistake: &Mistake, other: &Rewired, end: &End) -> bool {
    match mistake {
        Mistake::Readings { .. } => {
            let score = |(other, counts)| rewired(search, &other).map(|end| counts * end.score);
            let by_chance = mistake.by_chance(other).filter_map(score);
            end.score * DECISIVE < by_chance.fold(f64::INFINITY, f64::min)
        }
        Mistake::Offsets { channels, .. } => {
            let factors = vec![1.0; search.model.scales.len()];
            let from = anchored(&other.observations, search.model, &factors);
            stays(search.model, channels, [&from, &end.beta])
        }
        // What closes with a gain that has turned says that one is reversed.
        Mistake::Exchanged(_) | Mistake::Reversed(_) => {
            ratios(search.model, &end.beta).all(|ratio| ratio > 0.0)
        }
    }
}

/// Rows in which a potentiometer may have been on the gap of its track, or beyond.
struct Gap {
    rows: Vec<usize>,
    shown: Shown,
}

impl Gap {
    fn of(search: &StartSearch<'_>, channel: usize) -> Option<Self> {
        let [low, high] = search.observations.mechanism.channels[channel].range?;
        let Table { values, .. } = &search.readings.table;
        let read = |row: usize| values[row * search.readings.channels + channel];
        let rows = || 0..search.readings.samples;
        let edge = EDGE * (high - low);
        let at_end: Vec<usize> =
            rows().filter(|&r| read(r) <= low + edge || read(r) >= high - edge).collect();
        if !at_end.is_empty() {
            return Some(Self { rows: at_end, shown: Shown::AtEnd });
        }
        let mut sorted: Vec<f64> = rows().map(read).collect();
        order::sort(&mut sorted);
        let widest = sorted.windows(2).greatest_by(|a| a[1] - a[0])?;
        let (below, above) = (widest[0], widest[1]);
        if above - below < JUMP * (high - low) {
            return None;
        }
        let (lower, upper): (Vec<usize>, Vec<usize>) = rows().partition(|&r| read(r) <= below);
        let shown = Shown::Jump { below, above };
        Some(Self { rows: if lower.len() < upper.len() { lower } else { upper }, shown })
    }

    /// The fit without these rows, if enough are left.
    fn without(&self, search: &StartSearch<'_>) -> Option<End> {
        let mut weights = search.weights.clone();
        self.rows.iter().for_each(|&r| weights[r] = 0.0);
        let live = weights.iter().filter(|w| **w > 0.0).count() * search.model.equations();
        if live < search.model.parameters + search.model.parameters / 2 {
            return None;
        }
        let from = |factor: f64| {
            let factors = vec![factor; search.model.scales.len()];
            let start = anchored(search.observations, search.model, &factors);
            search.end_with(&search.readings, &weights, &start)
        };
        best_of(FACTORS.into_iter().map(from))
    }
}

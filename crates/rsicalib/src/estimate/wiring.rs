//! Mistakes at first wiring: a reversed channel, two exchanged ones, a potentiometer
//! whose gap lies within the range of motion, degrees for radians.
//!
//! No start leads to a good fit then. Each mistake is tried in turn: where the loop
//! closes with it and with no other, it is named.

use crate::estimate::rewired::{DECISIVE, OTHER_UNIT, Rewired, stays};
use crate::estimate::search::{End, StartSearch, anchored, ratios};
use crate::estimate::suspicion::{Closes, InDegrees, Scaled, Shown, Suspicion};
use crate::readings::Table;

/// A suspicion, and the fit that takes the mistake into account where that needs no other
/// readings.
#[derive(Debug, Clone)]
pub struct Suspected {
    /// What looks wrong.
    pub suspicion: Suspicion,
    /// The fit.
    pub end: Option<End>,
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
            found = Some((end.score, Suspected { suspicion, end: keep.then_some(end) }));
        }
    };
    let channels = search.model.scales.len();
    let mut turned: Vec<End> = (0..channels).map(|c| reversed(search, |i| i == c)).collect();
    turned.push(reversed(search, |_| true));
    for end in turned {
        // A start may find another channel than the one that it reversed.
        let ratios = ratios(search.model, &end.beta).enumerate();
        let wrong: Vec<usize> = ratios.filter(|(_, ratio)| *ratio < 0.0).map(|(c, _)| c).collect();
        consider(end, true, &|closes| Suspicion::Reversed { channels: wrong.clone(), closes });
    }
    for (other, channels) in Rewired::every_exchange(search.observations, &search.readings) {
        if let Some(end) = rewired(search, &other) {
            consider(end, false, &|closes| Suspicion::Exchanged { channels, closes });
        }
    }
    for (other, channels, times) in Rewired::every_unit(search.observations, &search.readings) {
        let by_chance = other
            .by_chance(true)
            .filter_map(|(other, counts)| rewired(search, &other).map(|end| counts * end.score));
        let by_chance = by_chance.fold(f64::INFINITY, f64::min);
        if let Some(end) = rewired(search, &other).filter(|e| e.score * DECISIVE < by_chance) {
            let of = |closes| InDegrees::Loop { what: Scaled::Readings, times, closes };
            consider(end, false, &|closes| Suspicion::Degrees {
                channels: channels.clone(),
                of: of(closes),
            });
        }
    }
    for times in OTHER_UNIT {
        let Some((other, channels)) =
            Rewired::offsets(search.observations, &search.readings, times)
        else {
            continue;
        };
        let from =
            anchored(&other.observations, search.model, &vec![1.0; search.model.scales.len()]);
        let stays = |end: &End| stays(search.model, &channels, [&from, &end.beta]);
        if let Some(end) = rewired(search, &other).filter(stays) {
            consider(end, true, &|closes| Suspicion::Degrees {
                channels: channels.clone(),
                of: InDegrees::Loop { what: Scaled::Offsets, times, closes },
            });
        }
    }
    for channel in 0..channels {
        let Some(gap) = Gap::of(search, channel) else { continue };
        let Some(end) = gap.without(search) else { continue };
        let (shown, rows, of) = (gap.shown, gap.rows.len(), search.readings.samples);
        consider(end, false, &|closes| Suspicion::Gap { channel, shown, rows, of, closes });
    }
    found.map(|f| f.1)
}

/// The best of a few ends.
fn best_of(ends: impl Iterator<Item = End>) -> Option<End> {
    ends.min_by(|a, b| a.score.total_cmp(&b.score))
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
        sorted.sort_by(f64::total_cmp);
        let widest = sorted.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
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

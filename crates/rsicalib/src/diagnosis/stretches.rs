//! Stretches of a long recording: neighbouring rows that the search takes as one sample.
//!
//! Neighbours of a motion see nearly the same of any effect, and each has noise of its own. With `â`
//! the readings of a row moved onto the closures by (52), noise of the closures aside, a stretch of
//! `n` rows is the sample
//!
//! ```text
//! ā = â_m + Σ (a_i - â_i) / n,    σ̄² = s σ² / n                                        (76)
//! ```
//!
//! in the context of its middle row `m`: to first order its misclosure is the mean of its rows'.
//! `s` is how much more slow means vary than those of independent rows, (64): a mean of few
//! neighbours varies by less, so this errs on the safe side.

use std::ops::Range;

use crate::diagnosis::price::{Family, least_that_pays, prior};
use crate::diagnosis::score::scored::Scored;
use crate::estimate::noise::source::NoiseEstimate;
use crate::estimate::on_closures::OnClosures;
use crate::estimate::settle::Room;
use crate::estimate::{Fit, Implicit, LONG, Observations, Part};
use crate::model::Instance;
use crate::numerics::lanes::Lanes;
use crate::numerics::order;
use crate::readings::Readings;
use crate::readings::course::pause;
use crate::terms::term::{ORDER_STEP, ORDERS, Placed};

/// A long recording is searched by so many stretches at the most, evenly spread: all of them would
/// take longer in proportion, and what stands out of them alone is tiny.
const MOST_STRETCHES: usize = LONG;

/// Rows of a stretch at the most. Twice as many would save little: motion ends most of them before.
const ROWS: usize = 8;

/// Standard deviations of a reading that are no motion: the first and the last of a stretch differ by
/// so many once in ten thousand times.
const NOISE: f64 = 6.0;

/// Rows that look bad, at the most, that stay by themselves.
const MOST_APART: usize = 256;

/// Stretches on either side of a slip whose rows are looked at one by one.
const BESIDE: usize = 2;

/// True for a recording that is searched by stretches: one of many rows, or of rows that resemble
/// their neighbours. A search takes samples for independent, and (76) says what such rows are worth.
fn are_searched(observations: &Observations, noise: &NoiseEstimate) -> bool {
    observations.is_long() || observations.is_recording() && noise.slow > 1.0
}

/// The stretches of a recording.
#[derive(Debug, Clone)]
pub struct Stretches {
    /// The rows of each, of which those of weight zero do not count.
    rows: Vec<Range<usize>>,
    /// Rows of the recording that count.
    live: usize,
}

impl Stretches {
    /// The stretches of a recording with this noise, and these rows, ascending, by themselves; none
    /// where every row is a sample of its own.
    #[must_use]
    pub fn of(observations: &Observations, noise: &NoiseEstimate, apart: &[usize]) -> Option<Self> {
        if !are_searched(observations, noise) {
            return None;
        }
        let ends = Ends::new(observations, &noise.sigma);
        let rows = 0..observations.readings.samples;
        let live: Vec<usize> = rows.filter(|&row| observations.weights[row] > 0.0).collect();
        let alone = |row: usize| apart.binary_search(&row).is_ok();
        let mut rows: Vec<Range<usize>> = Vec::new();
        let (mut counted, mut before) = (0, 0);
        for &row in &live {
            let goes_on = |stretch: &&mut Range<usize>| {
                let single = alone(row) || alone(before);
                counted < ROWS && !single && !ends.between(stretch.start, before, row)
            };
            match rows.last_mut().filter(goes_on) {
                Some(stretch) => (stretch.end, counted) = (row + 1, counted + 1),
                None => {
                    rows.push(row..row + 1);
                    counted = 1;
                }
            }
            before = row;
        }
        Some(Self { rows: spread(rows, alone), live: live.len() })
    }

    /// The rows from the first of some stretches to the first one after them.
    #[must_use]
    pub fn rows(&self, stretches: &Range<usize>, samples: usize) -> Range<usize> {
        let first = |k: usize| self.rows.get(k).map_or(samples, |stretch| stretch.start);
        let start = if stretches.start == 0 { 0 } else { first(stretches.start) };
        start..first(stretches.end)
    }

    /// An instance of the search as one of the recording: what is at a stretch is at its first row.
    #[must_use]
    pub fn in_all(&self, instance: &Instance) -> Instance {
        match instance.term.placed() {
            Placed::AtPose => {
                let place = self.rows.get(instance.place).map_or(instance.place, |r| r.start);
                Instance { place, ..*instance }
            }
            _ => *instance,
        }
    }

    /// The same where the search may have been by stretches.
    #[must_use]
    pub fn in_session(these: Option<&Self>, instance: &Instance) -> Instance {
        these.map_or(*instance, |stretches| stretches.in_all(instance))
    }

    /// One sample for each stretch by (76), and how many rows it is the mean of.
    #[must_use]
    pub fn merged(&self, observations: &Observations, fit: &Fit) -> (Readings, Vec<f64>) {
        let Observations { readings, weights, .. } = observations;
        let part = Part { model: &fit.model, readings, weights: None };
        let mut settled = OnClosures::new(part, &fit.beta, &fit.assumed());
        let (mut values, mut counts) = (Vec::new(), Vec::new());
        let mut ends = Vec::with_capacity(self.rows.len());
        for stretch in &self.rows {
            let live: Vec<usize> = stretch.clone().filter(|&row| weights[row] > 0.0).collect();
            let middle = live[live.len() / 2];
            let mut sample = vec![0.0; observations.readings.channels];
            for &row in &live {
                let raw = readings.row(row);
                for (c, sum) in sample.iter_mut().enumerate() {
                    *sum += (raw[c] - settled.at(row, c)) / live.len() as f64;
                }
            }
            for (c, sum) in sample.iter_mut().enumerate() {
                *sum += settled.at(middle, c);
            }
            values.extend(sample);
            counts.push(live.len() as f64);
            ends.push([stretch.start, middle, live.len()]);
        }
        (observations.readings.merged(&ends, values, self.live), counts)
    }

    /// Rows to look at by themselves beside what was found: where a channel slipped between two
    /// stretches or within one, and of a stretch that looks bad as one.
    #[must_use]
    pub fn closer<'a>(&self, found: impl Iterator<Item = &'a Scored>) -> Vec<usize> {
        let single = |k: usize| self.rows[k].len() == 1;
        let mut rows = Vec::new();
        for scored in found {
            let place = scored.instance.place;
            match scored.family {
                Family::Slip if place > 0 => {
                    let next = self.rows[place - 1].end == self.rows[place].start;
                    if !(next && single(place - 1) && single(place)) {
                        let first = &self.rows[place.saturating_sub(BESIDE)];
                        let last = &self.rows[(place + BESIDE).min(self.rows.len() - 1)];
                        rows.extend(first.start..last.end);
                    }
                }
                Family::Bad if !single(place) => rows.extend(self.rows[place].clone()),
                _ => {}
            }
        }
        rows
    }
}

/// [`MOST_STRETCHES`] stretches, evenly spread, beside those of rows that stay alone.
fn spread(mut rows: Vec<Range<usize>>, alone: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let all = rows.len();
    let mut number = 0;
    rows.retain(|stretch| {
        number += 1;
        // Those at which the share of all that is kept reaches another whole number.
        all <= MOST_STRETCHES
            || number * MOST_STRETCHES / all > (number - 1) * MOST_STRETCHES / all
            || alone(stretch.start)
    });
    rows
}

/// Where stretches end.
struct Ends<'a> {
    observations: &'a Observations,
    /// How far a channel may move within a stretch, in its unit.
    travel: Vec<f64>,
    /// How long a pause may be (s).
    pause: Vec<f64>,
    /// The group of each row.
    group: Vec<usize>,
}

impl<'a> Ends<'a> {
    fn new(observations: &'a Observations, sigma: &[f64]) -> Self {
        let Observations { readings, mechanism, .. } = observations;
        // Half of the shortest wave that the catalogue has: the mean over it keeps 2/π of that
        // wave, and more of any other.
        let waves = ORDER_STEP * *ORDERS.end() as f64;
        let travel = mechanism.channels.iter().zip(sigma);
        let travel = travel.map(|(c, sigma)| (c.half_range() / waves).max(NOISE * sigma)).collect();
        let mut rows = vec![0.0; readings.sessions];
        for row in 0..readings.samples {
            rows[readings.session_of_pose[readings.pose[row]]] += 1.0;
        }
        let usual = readings.clock.iter().zip(&rows).map(|([first, last], n)| (last - first) / n);
        let mut group = vec![0; readings.samples];
        for meta in readings.blocks() {
            meta.rows[..meta.live].iter().for_each(|row| group[*row] = meta.group);
        }
        let pause = usual.map(|usual| pause() * usual).collect();
        Self { observations, travel, pause, group }
    }

    /// True where a stretch from `first` to `before` ends before a row: at a session, a key, a
    /// pause, where a channel turns back, or where one has moved far.
    fn between(&self, first: usize, before: usize, row: usize) -> bool {
        let readings = &self.observations.readings;
        let session = |row: usize| readings.session_of_pose[readings.pose[row]];
        if session(before) != session(row) || self.group[before] != self.group[row] {
            return true;
        }
        let clock = readings.table.time.as_ref();
        if clock.is_some_and(|time| time[row] - time[before] > self.pause[session(row)]) {
            return true;
        }
        let (from, to) = (readings.row(first), readings.row(row));
        let c = readings.channels;
        let side = |row: usize| &readings.sides()[row * c..(row + 1) * c];
        let far = from.iter().zip(to).zip(&self.travel).any(|((a, b), most)| (a - b).abs() > *most);
        far || side(before) != side(row)
    }
}

/// Rows of a long recording whose readings look bad at a fit, ascending: those that pay for
/// their places among all rows, against what the fit leaves, and by far the worst of them.
#[must_use]
pub fn bad_rows(observations: &Observations, fit: &Fit) -> Vec<usize> {
    let Observations { readings, weights, .. } = observations;
    if !are_searched(observations, &fit.noise) {
        return Vec::new();
    }
    let rest = (fit.chi2 / fit.dof.max(1.0)).max(1.0);
    let tests = readings.samples * readings.channels;
    let limit = least_that_pays(1.0, tests as f64 / prior(Family::Bad));
    let least = limit * fit.noise.slow * rest;
    let part = Part { model: &fit.model, readings, weights: Some(weights) };
    let problem = Implicit::of(part, fit.assumed());
    let look = |found: &mut Vec<(f64, usize)>, block: usize, room: &mut Room| {
        room.whiten_readings();
        let best = most_by_one(&room.w, &room.ws.a);
        let meta = &readings.blocks()[block];
        for (&row, score) in meta.rows[..meta.live].iter().zip(best.0) {
            if weights[row] > 0.0 && score > least {
                found.push((score, row));
            }
        }
    };
    let mut found = problem.over_blocks(&fit.beta, |_| true, look, |all, part| all.extend(part));
    order::descending(&mut found, |a| a.0);
    found.truncate(MOST_APART);
    let mut rows: Vec<usize> = found.into_iter().map(|(_, row)| row).collect();
    rows.sort_unstable();
    rows
}

/// The largest decrease of χ² by an error of one channel, `(aᵀr)² / aᵀa`, of whitened residuals `r`
/// and their derivatives by the readings, equation by equation.
fn most_by_one(r: &[Lanes], by_reading: &[Lanes]) -> Lanes {
    let channels = by_reading.len() / r.len().max(1);
    let mut most = Lanes::ZERO;
    for channel in 0..channels {
        let (mut along, mut square) = (Lanes::ZERO, Lanes::splat(f64::MIN_POSITIVE));
        for (r, row) in r.iter().zip(by_reading.chunks_exact(channels)) {
            along = row[channel].mul_add(*r, along);
            square = row[channel].mul_add(row[channel], square);
        }
        let score = along * along / square;
        most = Lanes(std::array::from_fn(|lane| most.0[lane].max(score.0[lane])));
    }
    most
}

#[cfg(test)]
mod tests {
    use super::{MOST_STRETCHES, ROWS, Stretches};
    use crate::estimate::noise::source::{NoiseEstimate, Source};
    use crate::estimate::{FitOptions, Observations};
    use crate::mechanism::Mechanism;
    use crate::readings::Table;

    /// A recording in which the first channel goes up and down by `step` counts a row, and turns back
    /// every 500 rows; with a pause before row 3750, and another session from row 6250 on.
    fn recording(rows: usize, step: usize) -> Observations {
        let mechanism = Mechanism::rsi();
        let value = |row: usize| (1000 + step * (row % 1000).abs_diff(500)) as f64;
        let of_row = |row: usize| (0..9).map(move |c| if c == 0 { value(row) } else { 2000.0 });
        let time = |row: usize| 0.005 * row as f64 + if row < 3750 { 0.0 } else { 10.0 };
        let table = Table {
            values: (0..rows).flat_map(of_row).collect(),
            time: Some((0..rows).map(time).collect()),
            session: Some((0..rows).map(|row| usize::from(row >= 6250)).collect()),
            ..Table::default()
        };
        Observations::new(&mechanism, table, None, FitOptions::default()).expect("readings")
    }

    /// Noise of one count, of means of which the variance is so many times that of independent rows.
    fn noise(slow: f64) -> NoiseEstimate {
        NoiseEstimate {
            source: Source::Neighbours,
            sigma: vec![1.0; 9],
            weighed: vec![1.0; 9],
            lasting: vec![false; 9],
            still: false,
            play: 1.0,
            weighed_play: 1.0,
            seating: Vec::new(),
            measured: Vec::new(),
            dof: 1000.0,
            share: 1.0,
            correlation: 0.0,
            inflation: 1.0,
            slow,
            apart: 0,
        }
    }

    fn stretches(observations: &Observations, apart: &[usize]) -> Stretches {
        Stretches::of(observations, &noise(1.0), apart).expect("a long recording")
    }

    #[test]
    fn a_short_recording_has_stretches_where_rows_resemble_their_neighbours() {
        let short = recording(2000, 1);
        assert!(Stretches::of(&short, &noise(1.0), &[]).is_none());
        let found = Stretches::of(&short, &noise(3.0), &[]).expect("stretches");
        assert!(found.rows.len() < 2000 / 4);
    }

    #[test]
    fn a_stretch_goes_on_until_something_changes() {
        let found = stretches(&recording(9000, 1), &[2501]);
        // All rows, in order, in stretches of eight where nothing happens.
        assert_eq!(found.rows.first().map(|r| r.start), Some(0));
        assert!(found.rows.windows(2).all(|pair| pair[0].end == pair[1].start));
        assert_eq!(found.rows.last().map(|r| r.end), Some(9000));
        assert!(found.rows.iter().all(|r| r.len() <= ROWS));
        assert!(found.rows.iter().filter(|r| r.len() == ROWS).count() > 1000);
        // A row by itself; a pause and a session between two stretches.
        assert!(found.rows.contains(&(2501..2502)));
        for end in [3750, 6250] {
            assert!(found.rows.iter().any(|r| r.start == end));
        }
        // A direction is known to a few rows: a stretch hardly goes beyond where a channel turns.
        let beyond = |r: &std::ops::Range<usize>, turn| r.end.min(turn + ROWS) - turn;
        for turn in (500..9000).step_by(500) {
            let over = found.rows.iter().find(|r| r.contains(&turn)).expect("a stretch");
            assert!(beyond(over, turn) <= 4, "{over:?}");
        }
    }

    #[test]
    fn a_stretch_ends_where_a_channel_has_moved_far() {
        // Five counts a row: a two-hundredth of 4096 counts is passed in four.
        let found = stretches(&recording(9000, 5), &[]);
        assert!(found.rows.iter().all(|r| r.len() <= 5));
    }

    #[test]
    fn of_many_stretches_evenly_spread_ones_are_looked_at_and_single_rows_always() {
        let found = stretches(&recording(200_000, 1), &[100_003, 100_004]);
        assert!(found.rows.len() >= MOST_STRETCHES && found.rows.len() <= MOST_STRETCHES + 2);
        assert!(found.rows.contains(&(100_003..100_004)));
        assert!(found.rows.contains(&(100_004..100_005)));
        let usual = 200_000 / MOST_STRETCHES;
        assert!(found.rows.windows(2).all(|pair| pair[1].start - pair[0].start <= 2 * usual));
    }
}

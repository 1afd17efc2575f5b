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

use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::scored::{Family, Scored};
use crate::estimate::settle::Room;
use crate::estimate::{Fit, Implicit, LONG, Noise, Observations, Part};
use crate::model::Instance;
use crate::numerics::distributions;
use crate::numerics::lanes::Lanes;
use crate::readings::Readings;
use crate::terms::term::{ORDER_STEP, ORDERS, Placed};

/// A long recording is searched by so many stretches at the most, evenly spread: all of them would
/// take longer in proportion, and what stands out of them alone is tiny.
const MOST: usize = LONG;

/// Rows of a stretch at the most. Twice as many would save little: motion ends most of them before.
const ROWS: usize = 8;

/// The same for what the readings of a channel scatter by, in standard deviations: noise is no
/// motion.
const NOISE: f64 = 6.0;

/// A pause of so many usual times between rows ends a stretch.
const PAUSE: f64 = 4.0;

/// Rows that look bad, at the most, that stay by themselves.
const MOST_APART: usize = 256;

/// Stretches on either side of a slip whose rows are looked at one by one.
const BESIDE: usize = 2;

/// The stretches of a recording.
#[derive(Debug, Clone)]
pub struct Stretches {
    /// The rows of each, of which those of weight zero do not count.
    rows: Vec<Range<usize>>,
    /// Rows of the recording that count.
    live: usize,
}

impl Stretches {
    /// The stretches of a recording, with these rows, ascending, by themselves; none for held poses
    /// and where there are few rows.
    #[must_use]
    pub fn of(observations: &Observations, fit: &Fit, apart: &[usize]) -> Option<Self> {
        let Observations { readings, weights, .. } = observations;
        if !observations.is_long() {
            return None;
        }
        let ends = Ends::new(observations, fit);
        let live: Vec<usize> = (0..readings.samples).filter(|&row| weights[row] > 0.0).collect();
        let alone = |row: usize| apart.binary_search(&row).is_ok();
        let mut rows: Vec<Range<usize>> = Vec::new();
        let mut counted = 0;
        for (order, &row) in live.iter().enumerate() {
            let joins = rows.last().is_some_and(|stretch| {
                let before = live[order - 1];
                let full = counted == ROWS || alone(row) || alone(before);
                !full && !ends.between(stretch.start, before, row)
            });
            match rows.last_mut().filter(|_| joins) {
                Some(stretch) => (stretch.end, counted) = (row + 1, counted + 1),
                None => {
                    rows.push(row..row + 1);
                    counted = 1;
                }
            }
        }
        let all = rows.len();
        let mut number = 0..all;
        rows.retain(|stretch| {
            let k = number.next().unwrap_or_default();
            // Evenly spread: those in which the count of those that are kept goes up.
            let kept = all <= MOST || (k + 1) * MOST / all > k * MOST / all;
            kept || alone(stretch.start)
        });
        Some(Self { rows, live: live.len() })
    }

    /// Number of stretches.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows.len()
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

    /// One sample for each stretch by (76), and how many rows it is the mean of.
    #[must_use]
    pub fn merged(&self, observations: &Observations, fit: &Fit) -> (Readings, Vec<f64>) {
        let mut settled = Settled::new(observations, fit);
        let weights = &observations.weights;
        let (mut values, mut counts) = (Vec::new(), Vec::new());
        let mut ends = Vec::with_capacity(self.rows.len());
        for stretch in &self.rows {
            let live: Vec<usize> = stretch.clone().filter(|&row| weights[row] > 0.0).collect();
            let middle = live[live.len() / 2];
            let mut sample = vec![0.0; observations.readings.channels];
            for &row in &live {
                let raw = observations.readings.row(row);
                for (c, sum) in sample.iter_mut().enumerate() {
                    *sum += (raw[c] - settled.at(row, c)) / live.len() as f64;
                }
            }
            for (c, sum) in sample.iter_mut().enumerate() {
                *sum += settled.at(middle, c);
            }
            values.extend(sample);
            counts.push(live.len() as f64);
            ends.push([stretch.start, middle]);
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
    fn new(observations: &'a Observations, fit: &Fit) -> Self {
        let Observations { readings, mechanism, .. } = observations;
        // Half of the shortest wave that the catalogue has: the mean over it keeps 2/π of that
        // wave, and more of any other.
        let waves = ORDER_STEP * *ORDERS.end() as f64;
        let travel = mechanism.channels.iter().zip(&fit.noise.sigma);
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
        let pause = usual.map(|usual| PAUSE * usual).collect();
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

/// Readings on the closures, block by block.
struct Settled<'a> {
    part: Part<'a>,
    fit: &'a Fit,
    room: Room,
    /// Block and lane of each row.
    lane_of: Vec<(usize, usize)>,
    block: Option<usize>,
    a_hat: Vec<Lanes>,
}

/// Share of the noise of closures with which readings are moved onto them: where closures say the
/// same of a pose, none at all would leave nothing to divide by.
const HARDLY: f64 = 1e-6;

impl<'a> Settled<'a> {
    fn new(observations: &'a Observations, fit: &'a Fit) -> Self {
        let readings = &observations.readings;
        let part = Part { model: &fit.model, readings, weights: None };
        let noise = Noise { play: HARDLY * fit.noise.play, ..fit.assumed() };
        let room = Room::new(&fit.model, &noise);
        let lane_of = readings.lane_of_rows();
        Self { part, fit, room, lane_of, block: None, a_hat: Vec::new() }
    }

    /// `â` of a row and channel: quick where rows are asked for one after another.
    fn at(&mut self, row: usize, channel: usize) -> f64 {
        let (block, lane) = self.lane_of[row];
        if self.block.replace(block) != Some(block) {
            self.a_hat = self.part.readings.raw(block).to_vec();
            self.room.settle(&self.part, block, &self.fit.beta, &mut self.a_hat, false);
        }
        self.a_hat[channel].0[lane]
    }
}

/// Rows of a long recording whose readings look bad at a fit, ascending: those that stand out of
/// all rows at the level of a search, against what the fit leaves, and by far the worst of them.
#[must_use]
pub fn bad_rows(observations: &Observations, fit: &Fit, search: &SearchOptions) -> Vec<usize> {
    let Observations { readings, weights, .. } = observations;
    if !observations.is_long() {
        return Vec::new();
    }
    let rest = (fit.chi2 / fit.dof.max(1.0)).max(1.0);
    let tests = readings.samples * readings.channels;
    let limit = distributions::two_sided_limit(search.alpha, tests).powi(2);
    let least = limit * fit.noise.slow * rest;
    let part = Part { model: &fit.model, readings, weights: Some(weights) };
    let problem = Implicit::new(vec![(part, fit.assumed())], &[]);
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
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
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

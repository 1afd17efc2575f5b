//! Scores of errors that repeat many times per turn: one candidate of two columns for each sensor
//! and order.
//!
//! The columns of one sensor at one order are `a sin nφ` and `a cos nφ`, with `a` its column and `φ`
//! its nominal angle, which follows from the reading alone: sums over places score all orders, (71)
//! and (72).

use std::f64::consts::{PI, TAU};

use crate::diagnosis::score::candidates::places_of;
use crate::diagnosis::score::room::Room;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::Observations;
use crate::estimate::angles::Angles;
use crate::estimate::at_fit::AtFit;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::workers;
use crate::terms;
use crate::terms::targets::targets;
use crate::terms::term::{ORDER_STEP, ORDERS, Placed, Term};

/// Fewer waves than this over the readings that occur are the free curve's, which has as many: a
/// step or a dead band looks like few waves, and the closed form behind that curve tells which.
const WAVES: f64 = 4.0;

/// Orders are tried so many radians apart over the readings: halfway between two of them a wave
/// loses a twentieth of its score.
const BETWEEN: f64 = 1.6;

/// Part of what errors of the sensor explain by whatever law that one order must explain. Of `K`
/// independent angles the best of `N` orders explains `2 (ln N + 0.58) / K` by chance (Gumbel), a
/// fifth at `K = 48`.
const SHARE: f64 = 0.5;

/// Euler's constant, the mean of Gumbel's distribution.
const EULER: f64 = 0.577_215_664_901_532_9;

/// Places of readings of one sensor: the highest order has 1/20 of a wave in a two-thousandth of a
/// turn, and most sensors use less than a turn.
const PLACES: usize = 2048;

/// Scores of two degrees of freedom below this are never named, at however few orders.
const SURPRISE: f64 = 8.0;

/// Scores every order of every sensor at a fit.
pub fn score(at: &AtFit, judge: &Judge, without: &[String]) -> Vec<Scored> {
    let Observations { mechanism, readings, .. } = at.observations;
    let tried = |term: &&&dyn Term| {
        term.placed() == Placed::AtOrder && !without.iter().any(|id| id == term.info().id)
    };
    let all = terms::all(mechanism);
    let Some(&term) = all.iter().find(tried) else { return Vec::new() };
    let angles = Angles::of(&at.observations.readings, &at.fit.model, &at.fit.beta);
    let live: Vec<usize> =
        (0..readings.samples).filter(|&row| at.observations.weights[row] > 0.0).collect();
    let of_sensor = |target: &Target| {
        let Target::Channel(channel) = *target else { return (Vec::new(), 0.0) };
        let scale = &at.fit.model.scales[channel];
        let phi = |row: usize| (readings.row(row)[channel] - scale.middle) * scale.turn;
        let samples = live.iter().map(|&row| (phi(row), row)).collect();
        let Some(room) = Room::new(at, &angles, channel, samples, PLACES) else {
            return (Vec::new(), 0.0);
        };
        let orders = Orders::over(room.high - room.low);
        let wanted = orders.least_places().min(live.len());
        if places_of(at.observations, at.fit, channel, wanted) < wanted {
            return (Vec::new(), 0.0);
        }
        let least = (SHARE * room.any_law()).max(SURPRISE);
        let scores = orders.scores(&room).into_iter().filter(|(_, score)| *score > least);
        let at_place = |(place, score)| (Instance { term, target: *target, place }, score);
        (scores.map(at_place).collect(), orders.independent())
    };
    let targets = targets(term, mechanism);
    let found: Vec<(Vec<(Instance, f64)>, f64)> = workers::map(&targets, of_sensor);
    let tests: f64 = found.iter().map(|(_, tests)| tests).sum();
    let all = found.into_iter().flat_map(|(found, _)| found);
    let new = all.filter(|(instance, _)| !at.fit.model.instances.contains(instance));
    let of = |(instance, score): (Instance, f64)| {
        // The order is the third parameter: the search pays for that one.
        let p_value = judge.p_value(score, 2.0);
        Scored::of(instance, Family::Periodic, score, 3.0, p_value, tests)
    };
    new.map(of).collect()
}

/// The orders that have several waves over readings, close enough to miss no wave between.
struct Orders {
    /// Between the lowest and the highest angle.
    span: f64,
    places: Vec<usize>,
}

impl Orders {
    fn over(span: f64) -> Self {
        let lowest = (WAVES * TAU / (ORDER_STEP * span)).ceil();
        let (first, last) = (*ORDERS.start(), *ORDERS.end());
        let first = first.max(lowest.min((last + 1) as f64) as usize);
        let stride = (BETWEEN / (ORDER_STEP * span)).floor().clamp(1.0, last as f64);
        Self { span, places: (first..=last).step_by(stride as usize).collect() }
    }

    /// Number of independent tests that all orders amount to: waves that differ by half a wave over
    /// the readings are independent.
    fn independent(&self) -> f64 {
        let [Some(first), Some(last)] = [self.places.first(), self.places.last()] else {
            return 0.0;
        };
        1.0 + ORDER_STEP * (last - first) as f64 * self.span / PI
    }

    /// Places of which no order of so many explains as much by chance as is asked of one. At fewer some order is any
    /// law; where every sample has a place of its own it is for the price to say.
    fn least_places(&self) -> usize {
        (2.0 * (self.independent().max(1.0).ln() + EULER) / SHARE).ceil() as usize
    }

    /// `T` of (72) at every order at which offset, gain and other effects do not take up the wave.
    fn scores(&self, room: &Room) -> Vec<(usize, f64)> {
        let Some(&first) = self.places.first() else { return Vec::new() };
        let stride = self.places.get(1).map_or(1, |second| second - first);
        let wave = |places: usize, phi: f64| -> [f64; 2] {
            (ORDER_STEP * places as f64 * phi).sin_cos().into()
        };
        // Each wave turns by the same angle from one order to the next.
        let mut waves: Vec<[f64; 2]> = room.places().map(|phi| wave(first, phi)).collect();
        let turns: Vec<[f64; 2]> = room.places().map(|phi| wave(stride, phi)).collect();
        let mut scores = Vec::new();
        for &place in &self.places {
            scores.extend(room.score_two(&waves).map(|score| (place, score)));
            for ([sin, cos], [turn_sin, turn_cos]) in waves.iter_mut().zip(&turns) {
                (*sin, *cos) =
                    (*sin * turn_cos + *cos * turn_sin, *cos * turn_cos - *sin * turn_sin);
            }
        }
        scores
    }
}

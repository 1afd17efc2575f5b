//! Scores of errors that repeat many times per turn: one candidate of two columns for each sensor
//! and order.
//!
//! The columns of one sensor at one order are its column `L⁻¹A` times `sin nφ` and `cos nφ`. `φ`
//! follows from the reading alone, so sums over short stretches of readings score all orders,
//! (71) and (72).

use std::f64::consts::{PI, TAU};

use faer::Mat;
use rayon::prelude::*;

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part, Residuals};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::symmetric::dot;
use crate::terms;
use crate::terms::targets::targets;
use crate::terms::term::{ORDER_STEP, ORDERS, Placed};

/// Fewer waves than this over the readings that occur are the free curve's, which has as many: a
/// step or a dead band looks like few waves, and the closed form behind that curve tells which.
const WAVES: f64 = 4.0;

/// Orders are tried so many radians apart over the readings: halfway between two of them a wave
/// loses a twentieth of its score.
const BETWEEN: f64 = 1.6;

/// Part of what errors of the sensor explain by whatever law that one order must explain. Of angles
/// that are drawn anew in every pose the best of all orders explains a fifth.
const SHARE: f64 = 0.5;

/// Stretches of readings of one sensor: the highest order has 1/20 of a wave in a hundredth of a
/// turn, and most sensors use less than a turn.
const STRETCHES: usize = 2048;

/// Scores of two degrees of freedom below this are never named, at however few orders.
const SURPRISE: f64 = 8.0;

/// Part of a column's length that must be left after the projection.
const VISIBLE: f64 = 1e-6;

/// Scores every order of every sensor at a fit; `inverse` is that of its Gram matrix.
///
/// # Errors
///
/// As [`Observations::model`].
pub fn score(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    inverse: &Mat<f64>,
    without: &[String],
) -> Result<Vec<Scored>, Error> {
    let mechanism = &observations.mechanism;
    let tried = |term: &&&dyn terms::term::Term| {
        term.placed() == Placed::AtOrder && !without.iter().any(|id| id == term.info().id)
    };
    let all = terms::all(mechanism);
    let Some(&term) = all.iter().find(tried) else { return Ok(Vec::new()) };
    let part = Part {
        model: &fit.model,
        readings: &observations.readings,
        weights: Some(&observations.weights),
    };
    let residuals = Implicit::new(vec![(part, fit.assumed())], &[]).residuals(&fit.beta, true);
    let n = fit.model.parameters;
    let inverse: Vec<f64> = (0..n * n).map(|i| inverse[(i / n, i % n)]).collect();
    let channels = targets(term, mechanism).into_iter().filter_map(|target| match target {
        Target::Channel(channel) => Some(channel),
        _ => None,
    });
    let channels: Vec<usize> = channels.collect();
    let of_channel = |&channel: &usize| {
        let sums = Stretches::new(observations, &residuals, channel, n);
        let at = |place| Instance { term, target: Target::Channel(channel), place };
        let least = SHARE * sums.any_law();
        let scores = sums.scores(&inverse).into_iter().filter(|(_, score)| *score > least);
        (scores.map(|(place, score)| (at(place), score)).collect(), sums.independent())
    };
    let found: Vec<(Vec<(Instance, f64)>, f64)> = channels.par_iter().map(of_channel).collect();
    let tests: f64 = found.iter().map(|(_, tests)| tests).sum();
    let surprising = |(instance, score): &(Instance, f64)| {
        *score > SURPRISE && !fit.model.instances.contains(instance)
    };
    let scored = found.into_iter().flat_map(|(found, _)| found).filter(surprising);
    let of = |(instance, score): (Instance, f64)| {
        // The order is the third parameter: the search pays for that one.
        let p_value = judge.p_value(score, 2.0);
        Scored::of(instance, Family::Periodic, score, 3.0, p_value, tests)
    };
    Ok(scored.map(of).collect())
}

/// One stretch of readings: its angle, and sums over the equations of its samples.
#[derive(Clone)]
struct Stretch {
    phi: f64,
    zr: f64,
    zz: f64,
    zx: Vec<f64>,
}

/// All stretches of one sensor.
struct Stretches {
    stretches: Vec<Stretch>,
    /// Between the lowest and the highest angle.
    span: f64,
}

impl Stretches {
    fn new(observations: &Observations, residuals: &Residuals, channel: usize, n: usize) -> Self {
        let (readings, weights) = (&observations.readings, &observations.weights);
        let declared = &observations.mechanism.channels[channel];
        let (middle, gain) = (declared.middle(), declared.gain);
        let count = readings.channels;
        let angle = |row: usize| (readings.table.values[row * count + channel] - middle) * gain;
        let mut live: Vec<(f64, usize)> = (0..readings.samples)
            .filter(|&row| weights[row] > 0.0)
            .map(|row| (angle(row), row))
            .collect();
        live.sort_by(|a, b| a.0.total_cmp(&b.0));
        let span = match (live.first(), live.last()) {
            (Some(first), Some(last)) => last.0 - first.0,
            _ => 0.0,
        };
        let k = residuals.equations;
        let of = |rows: &[(f64, usize)]| {
            let phi = rows.iter().map(|(phi, _)| phi).sum::<f64>() / rows.len() as f64;
            let mut sums = Stretch { phi, zr: 0.0, zz: 0.0, zx: vec![0.0; n] };
            for e in rows.iter().flat_map(|&(_, row)| row * k..(row + 1) * k) {
                let z = residuals.by_reading[e * count + channel];
                sums.zr += z * residuals.whitened[e];
                sums.zz += z * z;
                let x = &residuals.by_parameter[e * n..(e + 1) * n];
                sums.zx.iter_mut().zip(x).for_each(|(sum, x)| *sum += z * x);
            }
            sums
        };
        let each = live.len().div_ceil(STRETCHES).max(1);
        Self { stretches: live.chunks(each).map(of).collect(), span }
    }

    /// The orders that have several waves in these readings, close enough to miss no wave between.
    fn orders(&self) -> std::iter::StepBy<std::ops::RangeInclusive<usize>> {
        let span = self.span.max(1e-9);
        let lowest = (WAVES * TAU / (ORDER_STEP * span)).ceil();
        let (first, last) = (*ORDERS.start(), *ORDERS.end());
        let first = first.max(lowest.min((last + 1) as f64) as usize);
        let stride = (BETWEEN / (ORDER_STEP * span)).floor().clamp(1.0, last as f64);
        (first..=last).step_by(stride as usize)
    }

    /// Number of independent tests that all orders amount to: waves that differ by half a wave over
    /// the readings are independent.
    fn independent(&self) -> f64 {
        let mut orders = self.orders();
        let (Some(first), Some(last)) = (orders.next(), orders.last()) else { return 0.0 };
        1.0 + ORDER_STEP * (last - first) as f64 * self.span / PI
    }

    /// `T` of (72) at every order at which offset, gain and other effects do not take up the wave.
    fn scores(&self, inverse: &[f64]) -> Vec<(usize, f64)> {
        let mut orders = self.orders();
        let (Some(first), second) = (orders.next(), orders.next()) else { return Vec::new() };
        let step = second.map_or(1, |second| second - first);
        // Each wave turns by the same angle from one order to the next.
        let wave = |places: usize, phi: f64| (ORDER_STEP * places as f64 * phi).sin_cos();
        let mut waves: Vec<(f64, f64)> =
            self.stretches.iter().map(|s| wave(first, s.phi)).collect();
        let turns: Vec<(f64, f64)> = self.stretches.iter().map(|s| wave(step, s.phi)).collect();
        let mut scores = Vec::new();
        for place in self.orders() {
            scores.extend(self.score(&waves, inverse).map(|score| (place, score)));
            for ((sin, cos), (turn_sin, turn_cos)) in waves.iter_mut().zip(&turns) {
                (*sin, *cos) =
                    (*sin * turn_cos + *cos * turn_sin, *cos * turn_cos - *sin * turn_sin);
            }
        }
        scores
    }

    /// What errors of this sensor explain, by whatever law, above what noise has them explain: an
    /// angle of its own for each stretch.
    fn any_law(&self) -> f64 {
        let seen = self.stretches.iter().filter(|s| s.zz > 0.0);
        seen.map(|s| s.zr * s.zr / s.zz - 1.0).sum::<f64>().max(0.0)
    }

    fn score(&self, waves: &[(f64, f64)], inverse: &[f64]) -> Option<f64> {
        let n = self.stretches.first()?.zx.len();
        let (mut u, mut square) = ([0.0; 2], [0.0; 3]);
        let (mut along_sin, mut along_cos) = (vec![0.0; n], vec![0.0; n]);
        for (stretch, &(sin, cos)) in self.stretches.iter().zip(waves) {
            u[0] += sin * stretch.zr;
            u[1] += cos * stretch.zr;
            square[0] += sin * sin * stretch.zz;
            square[1] += sin * cos * stretch.zz;
            square[2] += cos * cos * stretch.zz;
            for ((s, c), zx) in along_sin.iter_mut().zip(&mut along_cos).zip(&stretch.zx) {
                *s += sin * zx;
                *c += cos * zx;
            }
        }
        let cross = [along_sin, along_cos];
        let absorbed = cross.each_ref().map(|cross| {
            let along = |row: &[f64]| dot(row, cross);
            inverse.chunks_exact(n.max(1)).map(along).collect::<Vec<f64>>()
        });
        let m = [
            square[0] - dot(&cross[0], &absorbed[0]),
            square[1] - dot(&cross[0], &absorbed[1]),
            square[2] - dot(&cross[1], &absorbed[1]),
        ];
        let determinant = m[0] * m[2] - m[1] * m[1];
        if determinant < VISIBLE * square[0] * square[2] {
            return None;
        }
        let form = m[2] * u[0] * u[0] - 2.0 * m[1] * u[0] * u[1] + m[0] * u[1] * u[1];
        Some(form / determinant)
    }
}

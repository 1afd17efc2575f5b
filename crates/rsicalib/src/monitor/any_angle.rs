//! The angle by which a joint has turned, wherever in a turn that is: farther than a linearisation reaches.

use crate::monitor::watched::Watched;
use crate::numerics::order::Ends;

/// Angles of a turn that are tried: between two of them a sum of squares has one minimum.
const ANGLES: usize = 64;

/// Times that the room for an angle is narrowed by the golden section: from two steps of the turn to rounding.
const NARROWED: usize = 40;

/// The angle of a joint that explains some rows best.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turned {
    pub(super) candidate: usize,
    /// By what angle (rad), and the standard deviation of that.
    pub(super) shift: f64,
    pub(super) sd: f64,
    /// What it leaves of the rows.
    pub(super) squares: f64,
}

impl Turned {
    /// By an angle, with the sum of squares that each angle leaves; `step` is a small one.
    pub(super) fn at(
        candidate: usize,
        shift: f64,
        squares: &mut impl FnMut(f64) -> f64,
        step: f64,
    ) -> Self {
        let sd = sd_about(&mut |by| squares(shift + by), step);
        Self { candidate, shift, sd, squares: squares(shift) }
    }

    /// Goes on from there. The covariance of what is uncertain is wider by that of the angle, if this is among it.
    pub(super) fn go_on(&self, watched: &mut Watched, covariance: &mut [f64]) {
        let position = watched.candidates[self.candidate].columns[0];
        watched.at[watched.order[position]] += self.shift;
        let size = covariance.len().isqrt();
        if position < size {
            covariance[position * (size + 1)] += (self.sd / watched.scale[position]).powi(2);
        }
    }
}

/// The angle (rad) at which a sum of squares is least, and that sum.
pub(super) fn nearest_turn(at: &mut impl FnMut(f64) -> f64) -> (f64, f64) {
    let step = std::f64::consts::TAU / ANGLES as f64;
    let shift = |k: usize| (k as f64 - 0.5 * ANGLES as f64) * step;
    let tried: Vec<f64> = (0..ANGLES).map(|k| at(shift(k))).collect();
    // A linkage may be closed in several ways, or nearly.
    let valleys = (0..ANGLES).filter(|&k| {
        let beside = [ANGLES - 1, 1].map(|by| tried[(k + by) % ANGLES]);
        beside.iter().all(|own| tried[k] <= *own)
    });
    let lowest = valleys.map(|k| lowest(at, shift(k), step));
    lowest.least_by(|a| a.0).unwrap_or((f64::INFINITY, 0.0))
}

/// Standard deviation of an angle, from the curvature of a sum of squares about it.
fn sd_about(at: &mut impl FnMut(f64) -> f64, step: f64) -> f64 {
    let curvature = (at(step) + at(-step) - 2.0 * at(0.0)) / (step * step);
    (2.0 / curvature.max(f64::MIN_POSITIVE)).sqrt().min(std::f64::consts::PI)
}

/// The least value of a function within a step of a place, and where, by the golden section.
fn lowest(at: &mut impl FnMut(f64) -> f64, near: f64, step: f64) -> (f64, f64) {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = (near - step, near + step);
    let inner = |low: f64, high: f64| [high - golden * (high - low), low + golden * (high - low)];
    let mut x = inner(low, high);
    let mut y = x.map(&mut *at);
    for _ in 0..NARROWED {
        if y[0] < y[1] {
            high = x[1];
            x = inner(low, high);
            y = [at(x[0]), y[0]];
        } else {
            low = x[0];
            x = inner(low, high);
            y = [y[1], at(x[1])];
        }
    }
    let place = 0.5 * (low + high);
    (at(place), place)
}

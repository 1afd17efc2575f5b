//! A place of what is unknown in one pose, and the nearest one at which the closures are least open.

use nalgebra::{DMatrix, DVector};

use crate::model::compiled::Model;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::Readings;

/// The one rule of rank for what is unknown in one pose: a direction that moves the equations less
/// than this part of what the strongest does is not determined there.
pub(crate) const RANK: f64 = 1e-6;

/// Steps towards (58).
const STEPS: usize = 60;

/// A step of this part of the place is none.
const STILL: f64 = 1e-13;

/// The other of two solutions is taken where it leaves less than this part of the squares.
const CLEARLY: f64 = 0.25;

/// Squares of the equations of eight samples at a place, with `f` and `B`.
pub(super) struct Near {
    pub(super) xi: Vec<Lanes>,
    pub(super) f: Vec<Lanes>,
    pub(super) b: Vec<Lanes>,
    cost: [f64; WIDTH],
}

impl Model {
    /// The equations at a place.
    pub(super) fn look(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        xi: &[Lanes],
        ws: &mut Workspace,
    ) -> Near {
        let at: Vec<Lanes> = a[..self.scales.len()].iter().chain(xi).copied().collect();
        self.evaluate_at(readings, block, &at, beta, Want { x: false, a: true }, ws);
        let mut cost = [0.0; WIDTH];
        for (f, length) in ws.f.iter().zip(&self.lengths()) {
            cost.iter_mut().zip(f.0).for_each(|(cost, f)| *cost += (f * length).powi(2));
        }
        Near { xi: xi.to_vec(), f: ws.f.clone(), b: ws.b.clone(), cost }
    }

    /// Damped least squares from a start, lane by lane.
    pub(super) fn nearest(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        start: Vec<Lanes>,
        ws: &mut Workspace,
    ) -> Near {
        let lengths = self.lengths();
        let mut look = |xi: &[Lanes]| self.look(readings, block, a, beta, xi, ws);
        let mut here = look(&start);
        let mut damping = [1e-3; WIDTH];
        for _ in 0..STEPS {
            let mut xi = here.xi.clone();
            let mut moved = false;
            for (lane, damping) in damping.iter().enumerate() {
                let Some(step) = here.step(lane, *damping, &lengths) else { continue };
                for (x, step) in xi.iter_mut().zip(step.iter()) {
                    moved |= step.abs() > STILL * (1.0 + x.0[lane].abs());
                    x.0[lane] += step;
                }
            }
            if !moved {
                break;
            }
            let there = look(&xi);
            for (lane, damping) in damping.iter_mut().enumerate() {
                if there.cost[lane] < here.cost[lane] {
                    here.take(&there, lane);
                    *damping *= 0.1;
                } else {
                    *damping = (*damping * 10.0).min(1e12);
                }
            }
        }
        here
    }
}

impl Near {
    /// The damped step of one lane; none where nothing is to be had.
    fn step(&self, lane: usize, damping: f64, lengths: &[f64]) -> Option<DVector<f64>> {
        let n = self.xi.len();
        let mut gram = DMatrix::<f64>::zeros(n, n);
        let mut slope = DVector::<f64>::zeros(n);
        for (k, length) in lengths.iter().enumerate() {
            let row = |j: usize| self.b[k * n + j].0[lane] * length;
            for i in 0..n {
                slope[i] -= row(i) * self.f[k].0[lane] * length;
                for j in 0..n {
                    gram[(i, j)] += row(i) * row(j);
                }
            }
        }
        let least = RANK * RANK * gram.diagonal().max();
        for i in 0..n {
            gram[(i, i)] += damping * gram[(i, i)].max(least);
        }
        let step = gram.cholesky()?.solve(&slope);
        step.iter().all(|s| s.is_finite()).then_some(step)
    }

    /// Largest coordinate of the place of one lane.
    pub(super) fn size(&self, lane: usize) -> f64 {
        self.xi.iter().map(|x| x.0[lane].abs()).fold(0.0, f64::max)
    }

    /// True where the equations of one lane are closed to rounding.
    pub(super) fn closed(&self, lane: usize) -> bool {
        self.cost[lane] < (1e-9 * self.size(lane)).powi(2)
    }

    /// Takes another place in the lanes where it closes clearly better.
    pub(super) fn take_better(&mut self, other: &Self) {
        for lane in 0..WIDTH {
            let own = self.cost[lane];
            if !self.closed(lane) && (other.cost[lane] < CLEARLY * own || own.is_nan()) {
                self.take(other, lane);
            }
        }
    }

    fn take(&mut self, other: &Self, lane: usize) {
        let pairs = [(&mut self.xi, &other.xi), (&mut self.f, &other.f), (&mut self.b, &other.b)];
        for (own, other) in pairs {
            own.iter_mut().zip(other).for_each(|(own, other)| own.0[lane] = other.0[lane]);
        }
        self.cost[lane] = other.cost[lane];
    }
}

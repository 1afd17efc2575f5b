//! Where things are that are unknown in one pose alone.
//!
//! In each sample, at readings `a` and parameters `β`, `ξ` is where the closures are nearest to
//! closed, all lengths alike:
//!
//! ```text
//! ξ = argmin Σ (f / length)²                                              (58)
//! ```
//!
//! This is where a fit starts; it then settles `ξ` with the weights of the noise, (59). Of mirror
//! solutions the one is taken that the search finds from where the mechanism's file looks for it.

use nalgebra::{DMatrix, DVector};

use crate::model::compiled::Model;
use crate::model::ends::End;
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
struct Near {
    xi: Vec<Lanes>,
    f: Vec<Lanes>,
    b: Vec<Lanes>,
    cost: [f64; WIDTH],
}

impl Model {
    /// Misclosure and derivatives of one block at readings `a` and parameters `beta`, written to
    /// `ws`. `a` holds one [`Lanes`] per channel, and after them what is unknown in one pose alone;
    /// without it, that is where the closures are nearest to closed. `beta` holds one number per
    /// parameter.
    ///
    /// # Panics
    ///
    /// Where `block` is beyond the last block, or `a` or `beta` is too short.
    pub fn evaluate(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        if a.len() < self.stride() {
            let a = self.placed(readings, block, a, beta, ws);
            return self.evaluate_at(readings, block, &a, beta, want, ws);
        }
        self.evaluate_at(readings, block, a, beta, want, ws);
    }

    /// The readings of a block, and after them what is unknown in each of its poses, (58).
    pub(crate) fn placed(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        ws: &mut Workspace,
    ) -> Vec<Lanes> {
        let drawn = self.posed.slots();
        let drawn = drawn.filter(|(slot, _)| slot.is_some()).map(|(_, at)| Lanes::splat(at));
        let mut best = self.nearest(readings, block, a, beta, drawn.collect(), ws);
        let among = self.among(readings, block, beta, ws);
        let other = self.nearest(readings, block, a, beta, among, ws);
        for lane in 0..WIDTH {
            let size: f64 = best.xi.iter().map(|x| x.0[lane].abs()).fold(0.0, f64::max);
            let closed = best.cost[lane] < (1e-9 * size).powi(2);
            let better = other.cost[lane] < CLEARLY * best.cost[lane] || best.cost[lane].is_nan();
            if !closed && better {
                for (best, other) in best.xi.iter_mut().zip(&other.xi) {
                    best.0[lane] = other.0[lane];
                }
            }
        }
        a[..self.scales.len()].iter().copied().chain(best.xi).collect()
    }

    /// Amid the ends that hold each point.
    fn among(&self, readings: &Readings, block: usize, beta: &[f64], ws: &Workspace) -> Vec<Lanes> {
        let (group, seen) = (readings.blocks()[block].group, readings.columns(block));
        let mut sums = vec![[Lanes::ZERO; 3]; self.posed.points.len()];
        let mut counts = vec![0.0; self.posed.points.len()];
        for closure in self.closures.iter().filter(|c| c.kind.is_between_points()) {
            let (number, other) = match closure.ends {
                [End::Posed(number), other] | [other, End::Posed(number)] => (number, other),
                _ => continue,
            };
            if matches!(other, End::Posed(_)) {
                continue;
            }
            let at = self.end_point(&other, group, seen, beta, ws);
            sums[number].iter_mut().zip(at).for_each(|(sum, at)| *sum += at);
            counts[number] += 1.0;
        }
        let mut xi = Vec::with_capacity(self.pose_unknowns());
        for ((posed, sum), count) in self.posed.points.iter().zip(&sums).zip(counts) {
            for ((slot, sum), at) in posed.slots.iter().zip(sum).zip(posed.at) {
                if slot.is_some() {
                    let none = count == 0.0;
                    xi.push(if none { Lanes::splat(at) } else { *sum * (1.0 / count) });
                }
            }
        }
        let bodies = self.posed.bodies.iter().flat_map(|body| body.slots.iter().zip(body.pose));
        xi.extend(bodies.filter(|(slot, _)| slot.is_some()).map(|(_, at)| Lanes::splat(at)));
        xi
    }

    /// Damped least squares from a start, lane by lane.
    fn nearest(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        start: Vec<Lanes>,
        ws: &mut Workspace,
    ) -> Near {
        let lengths = self.lengths();
        let mut look = |xi: &[Lanes]| {
            let at: Vec<Lanes> = a[..self.scales.len()].iter().chain(xi).copied().collect();
            self.evaluate_at(readings, block, &at, beta, Want { x: false, a: true }, ws);
            let mut cost = [0.0; WIDTH];
            for (f, length) in ws.f.iter().zip(&lengths) {
                cost.iter_mut().zip(f.0).for_each(|(cost, f)| *cost += (f * length).powi(2));
            }
            Near { xi: xi.to_vec(), f: ws.f.clone(), b: ws.b.clone(), cost }
        };
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

    /// Leaves as drawn what no closure determines of the points that are somewhere else in each pose.
    pub(crate) fn leave_out_loose_coordinates(&mut self, readings: &Readings) {
        if self.pose_unknowns() == 0 {
            return;
        }
        let (n, lengths, beta) = (self.pose_unknowns(), self.lengths(), self.nominal());
        let mut ws = Workspace::default();
        let mut kept: Vec<usize> = Vec::new();
        let all = readings.blocks().len();
        for block in [0, all / 2, all - 1] {
            let want = Want { x: false, a: true };
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let b = DMatrix::from_fn(self.equations, n, |k, j| ws.b[k * n + j].0[0] * lengths[k]);
            let here = independent(&b);
            if here.len() > kept.len() {
                kept = here;
            }
        }
        if kept.len() == n {
            return;
        }
        for slot in self.posed.slots_mut() {
            *slot = slot.and_then(|own| kept.iter().position(|k| *k == own));
        }
        self.posed.unknowns = kept.len();
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

    fn take(&mut self, other: &Self, lane: usize) {
        let pairs = [(&mut self.xi, &other.xi), (&mut self.f, &other.f), (&mut self.b, &other.b)];
        for (own, other) in pairs {
            own.iter_mut().zip(other).for_each(|(own, other)| own.0[lane] = other.0[lane]);
        }
        self.cost[lane] = other.cost[lane];
    }
}

/// Columns of a matrix that are independent of those before them.
fn independent(columns: &DMatrix<f64>) -> Vec<usize> {
    let largest = columns.column_iter().map(|c| c.norm()).fold(0.0, f64::max);
    let mut kept = Vec::new();
    let mut base: Vec<DVector<f64>> = Vec::new();
    for (k, column) in columns.column_iter().enumerate() {
        let mut left = column.into_owned();
        for direction in base.iter().chain(&base) {
            left -= direction * direction.dot(&left);
        }
        if left.norm() > RANK * largest {
            kept.push(k);
            base.push(left.normalize());
        }
    }
    kept
}

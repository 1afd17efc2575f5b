//! A place of what is unknown in one pose, and the nearest one at which the closures are least open.

use crate::model::compiled::Model;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH, dispatch, solve_lower, solve_transposed};
use crate::numerics::order;
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

/// Steps in which what is open at a start closes.
const APPROACH: usize = 10;

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
        let (f, b) = (ws.f.clone(), ws.b.clone());
        let mut near = Near { xi: xi.to_vec(), f, b, cost: [0.0; WIDTH] };
        near.weigh(&self.lengths());
        near
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
        self.lowest(&mut |xi: &[Lanes]| self.look(readings, block, a, beta, xi, ws), start)
    }

    /// The same of equations as `look` has them.
    fn lowest(&self, look: &mut dyn FnMut(&[Lanes]) -> Near, start: Vec<Lanes>) -> Near {
        let lengths = self.lengths();
        let mut here = look(&start);
        let mut damping = [1e-3; WIDTH];
        for _ in 0..STEPS {
            let step = here.step(Lanes(damping), &lengths);
            let far = |(x, step): (&Lanes, &Lanes)| {
                x.zip(*step, |x, step| step.abs() - STILL * (1.0 + x.abs()))
                    .0
                    .iter()
                    .any(|s| *s > 0.0)
            };
            let moved = here.xi.iter().zip(&step).any(far);
            let xi: Vec<Lanes> = here.xi.iter().zip(&step).map(|(x, step)| *x + *step).collect();
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

    /// The place that is found in steps from a start, as what is open there closes, (180).
    pub(super) fn walked(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        start: Vec<Lanes>,
        ws: &mut Workspace,
    ) -> Near {
        let open = self.look(readings, block, a, beta, &start, ws).f;
        let mut look = |xi: &[Lanes], part: f64| {
            let mut near = self.look(readings, block, a, beta, xi, ws);
            near.f.iter_mut().zip(&open).for_each(|(f, open)| *f -= *open * part);
            near.weigh(&self.lengths());
            near
        };
        let before = (1..APPROACH).fold(start, |xi, k| {
            let part = 1.0 - k as f64 / APPROACH as f64;
            self.lowest(&mut |xi: &[Lanes]| look(xi, part), xi).xi
        });
        self.nearest(readings, block, a, beta, before, ws)
    }
}

impl Near {
    /// The damped step, by Cholesky's factor; zero in lanes where nothing is to be had.
    fn step(&self, damping: Lanes, lengths: &[f64]) -> Vec<Lanes> {
        let n = self.xi.len();
        debug_assert!(n > 0, "something is unknown in a pose");
        let (mut l, mut step) = (vec![Lanes::ZERO; n * n], vec![Lanes::ZERO; n]);
        dispatch(
            #[inline(always)]
            || {
                for ((row, f), length) in self.b.chunks_exact(n).zip(&self.f).zip(lengths) {
                    let square = length * length;
                    for i in 0..n {
                        let by = row[i] * square;
                        step[i] -= by * *f;
                        for j in 0..=i {
                            l[i * n + j] += by * row[j];
                        }
                    }
                }
                let mut least = Lanes::ZERO;
                for i in 0..n {
                    least = least.zip(l[i * n + i], f64::max);
                }
                for i in 0..n {
                    let own = l[i * n + i];
                    l[i * n + i] += damping * own.zip(least * (RANK * RANK), f64::max);
                }
                for i in 0..n {
                    for j in 0..=i {
                        let mut left = l[i * n + j];
                        for m in 0..j {
                            left -= l[i * n + m] * l[j * n + m];
                        }
                        l[i * n + j] = if i == j { left.sqrt() } else { left / l[j * n + j] };
                    }
                }
                solve_lower(&l, &mut step);
                solve_transposed(&l, &mut step);
            },
        );
        // What is not positive definite has no root, or divides by zero.
        for lane in 0..WIDTH {
            if !step.iter().all(|s| s.0[lane].is_finite()) {
                step.iter_mut().for_each(|s| s.0[lane] = 0.0);
            }
        }
        step
    }

    /// Largest coordinate of the place of one lane.
    pub(super) fn size(&self, lane: usize) -> f64 {
        self.xi.iter().map(|x| x.0[lane].abs()).fold(0.0, f64::max)
    }

    /// True where the equations of one lane are closed to rounding.
    pub(super) fn closed(&self, lane: usize) -> bool {
        self.cost[lane] < (1e-9 * self.size(lane)).powi(2)
    }

    /// True where a lane is far more open than half of all.
    pub(super) fn is_uneven(&self) -> bool {
        let mut sorted = self.cost;
        order::sort(&mut sorted);
        let far = |cost: f64| cost.is_nan() || CLEARLY * CLEARLY * cost > sorted[WIDTH / 2];
        (0..WIDTH).any(|lane| !self.closed(lane) && far(self.cost[lane]))
    }

    /// Squares of the equations, each over its length.
    fn weigh(&mut self, lengths: &[f64]) {
        self.cost = [0.0; WIDTH];
        for (f, length) in self.f.iter().zip(lengths) {
            self.cost.iter_mut().zip(f.0).for_each(|(cost, f)| *cost += (f * length).powi(2));
        }
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

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::numerics::random::Random;

    #[test]
    fn a_step_is_that_of_the_normal_equations_in_every_lane() {
        let (n, equations) = (3, 5);
        let mut random = Random::new(8);
        let mut lanes = |count: usize| -> Vec<Lanes> {
            (0..count).map(|_| Lanes(std::array::from_fn(|_| random.uniform(-1.0, 1.0)))).collect()
        };
        let (xi, f, mut b) = (lanes(n), lanes(equations), lanes(equations * n));
        // Nothing moves the equations of one lane.
        b.iter_mut().for_each(|b| b.0[2] = 0.0);
        let near = Near { xi, f, b, cost: [0.0; WIDTH] };
        let (damping, lengths) = (1e-3, [1.0, 2.0, 0.5, 1.5, 3.0]);
        let step = near.step(Lanes::splat(damping), &lengths);
        for lane in (0..WIDTH).filter(|lane| *lane != 2) {
            let b = DMatrix::from_fn(equations, n, |k, i| near.b[k * n + i].0[lane] * lengths[k]);
            let f = DVector::from_fn(equations, |k, _| near.f[k].0[lane] * lengths[k]);
            let mut square = b.transpose() * &b;
            (0..n).for_each(|i| square[(i, i)] *= 1.0 + damping);
            let expected = square.lu().solve(&(b.transpose() * -f)).expect("full rank");
            // Condition of a random matrix of three columns: its square is below 1e6.
            assert!((0..n).all(|i| (step[i].0[lane] - expected[i]).abs() < 1e-9), "{lane}");
        }
        assert!(step.iter().all(|step| step.0[2] == 0.0));
    }
}

//! The other place of what is unknown in one pose, across a free motion.
//!
//! Near a pose in which a body can move while no closure changes, a second place nearly closes: a body on
//! cables that do not cross is turned to the other side. At a place `ξ`, with the direction `v` that moves the
//! closures least, `b = B v`, the change `q` of `b` along `v`, and `P`, which takes out what the other
//! directions take up, the squares along `v` are
//!
//! ```text
//! |P (f + b t + ½ q t²)|²                                                  (169)
//! ```
//!
//! Where `ξ` is a minimum they have another one at the root, farther from zero, of
//! `½ q·q t² + ³⁄₂ b·q t + b·b + f·q = 0`, in which `P` stands before each. Where no root is real there is
//! one place.

use std::array;

use nalgebra::{DMatrix, DVector};

use crate::model::compiled::Model;
use crate::model::near::{Near, RANK};
use crate::model::workspace::Workspace;
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::order;
use crate::readings::Readings;

/// Step by which `q` is differentiated, in radians, and in parts of lengths.
const STEP: f64 = 1e-4;

/// Turn from which a body is looked for again where (169) finds no place that closes, in radians.
const TURN: f64 = 0.5;

impl Model {
    /// Where the closures are nearest to closed across the free motion next to each place; where there is
    /// none, near that place. None where no place has one.
    pub(super) fn across(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        here: &Near,
        ws: &mut Workspace,
    ) -> Option<Near> {
        let lengths = self.lengths();
        let ways: [Option<Way>; WIDTH] =
            array::from_fn(|lane| Way::of(here, lane, &lengths, &self.posed.turns()));
        if ways.iter().all(Option::is_none) {
            return None;
        }
        let mut look = |by: f64| {
            let mut xi = here.xi.clone();
            for (lane, way) in ways.iter().enumerate() {
                let Some(way) = way else { continue };
                xi.iter_mut().zip(way.weakest().iter()).for_each(|(x, v)| x.0[lane] += by * v);
            }
            self.look(readings, block, a, beta, &xi, ws)
        };
        let (ahead, back) = (look(STEP), look(-STEP));
        let mut start = here.xi.clone();
        let mut found = false;
        for (lane, way) in ways.iter().enumerate() {
            let of = |near: &Near| column(near, lane, &lengths);
            let step = way.as_ref().and_then(|way| way.other([&back, here, &ahead].map(of)));
            let Some(step) = step else { continue };
            start.iter_mut().zip(step.iter()).for_each(|(x, step)| x.0[lane] += step);
            found = true;
        }
        found.then(|| self.nearest(readings, block, a, beta, start, ws))
    }

    /// The readings of a block, and after them the other place of what is unknown in each of its poses, where
    /// `xi` is one; none where there is no other.
    pub(crate) fn placed_across(
        &self,
        readings: &Readings,
        block: usize,
        xi: &[Lanes],
        beta: &[f64],
        ws: &mut Workspace,
    ) -> Option<Vec<Lanes>> {
        let a = readings.raw(block);
        let here = self.look(readings, block, a, beta, xi, ws);
        let other = self.across(readings, block, a, beta, &here, ws)?;
        Some(a.iter().copied().chain(other.xi).collect())
    }

    /// The same from where each body is turned by [`TURN`], to and fro about each of its axes: how the closures change
    /// far from `ξ` is not what (169) has.
    pub(crate) fn placed_turned(
        &self,
        readings: &Readings,
        block: usize,
        xi: &[Lanes],
        beta: &[f64],
        ws: &mut Workspace,
    ) -> Vec<Vec<Lanes>> {
        let a = readings.raw(block);
        let turns = self.posed.turns().into_iter().flat_map(|turn| [(turn, TURN), (turn, -TURN)]);
        let there = turns.map(|(turn, by)| {
            let mut start = xi.to_vec();
            start[turn] += Lanes::splat(by);
            let there = self.nearest(readings, block, a, beta, start, ws);
            a.iter().copied().chain(there.xi).collect()
        });
        there.collect()
    }
}

/// `f` of one lane as lengths.
fn column(near: &Near, lane: usize, lengths: &[f64]) -> DVector<f64> {
    DVector::from_fn(lengths.len(), |k, _| near.f[k].0[lane] * lengths[k])
}

/// How the closures change with one lane's place.
struct Way {
    /// Coordinates of the place for each of the directions, the weakest first.
    directions: DMatrix<f64>,
    /// `B` times each.
    moved: DMatrix<f64>,
}

impl Way {
    /// At a place; none where all is closed, or where nothing tells of a direction. `turns` are the coordinates
    /// that are angles.
    fn of(here: &Near, lane: usize, lengths: &[f64], turns: &[usize]) -> Option<Self> {
        let (n, rows) = (here.xi.len(), lengths.len());
        let b = DMatrix::from_fn(rows, n, |k, j| here.b[k * n + j].0[lane] * lengths[k]);
        if rows <= n || here.closed(lane) || !b.iter().all(|b| b.is_finite()) {
            return None;
        }
        // A length is told in arms of the body, so that no direction depends on the unit. Where there are lengths
        // alone none does, and only the step of differences is of that size.
        let square = |of: &dyn Fn(&usize) -> bool| -> f64 {
            let own: Vec<f64> = (0..n).filter(of).map(|j| b.column(j).norm_squared()).collect();
            own.iter().sum::<f64>() / own.len() as f64
        };
        let arm = (square(&|j| turns.contains(j)) / square(&|j| !turns.contains(j))).sqrt();
        let arm = if turns.is_empty() { 1.0 + here.size(lane) } else { arm };
        let units = DVector::from_fn(n, |j, _| if turns.contains(&j) { 1.0 } else { arm });
        let b = &b * DMatrix::from_diagonal(&units);
        let eigen = (b.transpose() * &b).symmetric_eigen();
        let mut order: Vec<usize> = (0..n).collect();
        order::ascending(&mut order, |i| eigen.eigenvalues[*i]);
        let told = eigen.eigenvalues[order[0]] > RANK * RANK * eigen.eigenvalues[order[n - 1]];
        let sorted = eigen.eigenvectors.select_columns(&order);
        let moved = &b * &sorted;
        told.then(|| Self { directions: DMatrix::from_diagonal(&units) * sorted, moved })
    }

    /// The weakest direction.
    fn weakest(&self) -> DVector<f64> {
        self.directions.column(0).into_owned()
    }

    /// From `f` a step back, here and a step ahead along the weakest direction: the step to the other
    /// minimum of (169), with what the other directions take up; none where there is none.
    fn other(&self, [back, f, ahead]: [DVector<f64>; 3]) -> Option<DVector<f64>> {
        let b = (&ahead - &back) / (2.0 * STEP);
        let q = (ahead - 2.0 * &f + back) / (STEP * STEP);
        let others = || self.moved.column_iter().enumerate().skip(1);
        let left = |of: &DVector<f64>| {
            let mut left = of.clone();
            others().for_each(|(_, m)| left -= m * (m.dot(of) / m.norm_squared()));
            left
        };
        let [pf, pb, pq] = [&f, &b, &q].map(left);
        let (qq, bq) = (pq.norm_squared(), pb.dot(&pq));
        let square = 2.25 * bq * bq - 2.0 * qq * (pb.norm_squared() + pf.dot(&pq));
        let t = (-1.5 * bq - square.sqrt().copysign(bq)) / qq;
        if !t.is_finite() {
            return None;
        }
        let there = f + b * t + q * (0.5 * t * t);
        let mut step = self.weakest() * t;
        for (k, m) in others() {
            step -= self.directions.column(k) * (m.dot(&there) / m.norm_squared());
        }
        Some(step)
    }
}

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
//! solutions the one is taken that the search finds from where the mechanism's file looks for it. Where
//! there is another place across a free motion, (169), that closes clearly better, it is taken. What turns may be
//! found by half a turn off: where a sample is far more open than those beside, it is looked for in steps, too,
//!
//! ```text
//! ξ_k = argmin Σ ((f - (1 - k/10) f(ξ_0)) / length)²                      (180)
//! ```
//!
//! each from the one before, from `ξ_0` as drawn, where all is closed.

use nalgebra::{DMatrix, DVector};

use crate::model::compiled::Model;
use crate::model::ends::End;
use crate::model::near::RANK;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::readings::Readings;

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
        let drawn: Vec<Lanes> = drawn.collect();
        let mut best = self.nearest(readings, block, a, beta, drawn.clone(), ws);
        let among = self.among(readings, block, beta, ws);
        best.take_better(&self.nearest(readings, block, a, beta, among, ws));
        if let Some(other) = self.across(readings, block, a, beta, &best, ws) {
            best.take_better(&other);
        }
        if !self.posed.bodies.is_empty() && best.is_uneven() {
            best.take_better(&self.walked(readings, block, a, beta, drawn, ws));
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

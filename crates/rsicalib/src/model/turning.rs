//! Steps of unknown frames.
//!
//! A frame may stand far from all that it sees. A long step of its turns, as a straight line in `x y z rx ry rz`,
//! would move what it sees by much: points on one line, which such a turn leaves where they are, would be torn
//! off it. A step `s` of the turns is a rotation vector, and the mean `m` of the points that the frame sees goes
//! where the derivatives say, with `t` where the frame is and `d` the step of that:
//!
//! ```text
//! R ← exp(s) R,    t ← t + d + R m + s × R m - exp(s) R m                 (170)
//! ```
//!
//! Roll and yaw turn a frame about the same axis where its pitch is a quarter turn: no step of `rx ry rz`
//! then turns it about the third. While a start is looked for, a step is one about the axes of the base.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Vector3};

use crate::model::compiled::Model;
use crate::model::ends::{End, Measured, turn_axes};
use crate::model::thing::Thing;
use crate::readings::Readings;

/// What a frame sees stays in place where it moves by less than this part of how far the frame and its turn move
/// it: rounding and noise of a direction are far less, other directions more.
const STAYS: f64 = 0.01;

impl Model {
    /// The same with steps about the axes of the base; itself where no frame is unknown.
    pub(crate) fn turning(&self) -> Self {
        Self { turning: true, ..self.clone() }
    }

    /// The axes about which the derivatives by its turns have an unknown frame turn.
    #[inline(always)]
    pub(super) fn axes_of_turns(&self, rpy: &[f64]) -> [[f64; 3]; 3] {
        match self.turning {
            true => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            false => turn_axes(rpy),
        }
    }

    /// Parameters a step away.
    pub(crate) fn moved(&self, beta: &[f64], step: &[f64]) -> Vec<f64> {
        let mut there: Vec<f64> = beta.iter().zip(step).map(|(b, s)| b + s).collect();
        for (frame, mean) in self.unknowns.iter().zip(&self.seen) {
            if !matches!(frame.thing, Thing::Frame(_)) {
                continue;
            }
            let first = self.term_parameters + frame.first;
            let own = first..first + 6;
            let [.., rx, ry, rz] = &beta[own.clone()] else { continue };
            let by = &step[own.clone()][3..6];
            if by.iter().all(|by| *by == 0.0) {
                continue;
            }
            let axes = self.axes_of_turns(&[*rx, *ry, *rz]).map(Vector3::from);
            let turn: Vector3<f64> = axes.iter().zip(by).map(|(axis, by)| axis * *by).sum();
            let before = Rotation3::from_euler_angles(*rx, *ry, *rz);
            let after = Rotation3::new(turn) * before;
            let arm = before * mean;
            let bent = arm + turn.cross(&arm) - after * mean;
            let there = &mut there[own];
            there.iter_mut().zip(bent.iter()).for_each(|(at, bent)| *at += bent);
            there[3..].copy_from_slice(&angles_near(&after, [*rx, *ry, *rz]));
        }
        there
    }

    /// The angle by which a step turns an unknown frame about the mean of the points that it sees; none where that
    /// mean moves, and of what is no frame.
    pub(crate) fn turn_in_place(&self, unknown: usize, beta: &[f64], step: &[f64]) -> Option<f64> {
        let first = self.term_parameters + self.unknowns[unknown].first;
        let frame = matches!(self.unknowns[unknown].thing, Thing::Frame(_));
        let ([.., rx, ry, rz], [x, y, z, by @ ..]) =
            (beta.get(first..first + 6).filter(|_| frame)?, step.get(first..first + 6)?)
        else {
            return None;
        };
        let axes = self.axes_of_turns(&[*rx, *ry, *rz]).map(Vector3::from);
        let turn: Vector3<f64> = axes.iter().zip(by).map(|(axis, by)| axis * *by).sum();
        let arm = Rotation3::from_euler_angles(*rx, *ry, *rz) * self.seen[unknown];
        let (moved, back) = (Vector3::new(*x, *y, *z), turn.cross(&arm));
        let stays = (moved + back).norm() < STAYS * (moved.norm() + back.norm());
        stays.then(|| turn.norm())
    }

    /// For each unknown frame, the mean of the points that it sees, there; zero for all else.
    pub(super) fn mean_seen(&self, readings: &Readings) -> Vec<Vector3<f64>> {
        let mut sums = vec![(Vector3::zeros(), 0.0); self.unknowns.len()];
        for (block, meta) in readings.blocks().iter().enumerate() {
            let columns = readings.columns(block);
            for closure in &self.closures {
                for end in &closure.ends {
                    let End::Seen(own, Measured::Unknown(frame), _) = end else { continue };
                    let sum = &mut sums[self.owned[*frame].numbers[meta.group]];
                    for lane in readings.lanes(block, closure.number) {
                        let at = Vector3::from(own.map(|column| columns[column].0[lane]));
                        if at.iter().all(|x| x.is_finite()) {
                            *sum = (sum.0 + at, sum.1 + 1.0);
                        }
                    }
                }
            }
        }
        sums.into_iter().map(|(sum, count)| sum / f64::max(count, 1.0)).collect()
    }
}

/// Roll, pitch and yaw of a rotation, of all that are the same those nearest to others.
fn angles_near(rotation: &Rotation3<f64>, to: [f64; 3]) -> [f64; 3] {
    let (rx, ry, rz) = rotation.euler_angles();
    let near = |angles: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| angles[i] + TAU * ((to[i] - angles[i]) / TAU).round())
    };
    let off = |angles: &[f64; 3]| angles.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let [one, other] = [near([rx, ry, rz]), near([rx + PI, PI - ry, rz + PI])];
    if off(&other) < off(&one) { other } else { one }
}

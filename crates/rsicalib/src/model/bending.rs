//! Eq. (43): joints give under gravity, and the derivatives of that.

use crate::kinematics::elements::{Element, Source, Way};
use crate::kinematics::posture::{Carried, Lever, Posture};
use crate::model::compiled::{LoadAt, Model};
use crate::model::drives::Drives;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, cross, dispatch, dot};
use crate::readings::{Block, Readings};

/// The largest magnitude in the samples of a block.
fn largest_of(torque: Lanes, block: &Block) -> f64 {
    torque.0[..block.live].iter().fold(0.0, |most: f64, t| most.max(t.abs()))
}

impl Model {
    /// Eq. (43): joints give under gravity.
    #[inline(always)]
    pub(super) fn bend(&self, block: usize, beta: &[f64], ws: &mut Workspace) {
        if let Some(drives) = &self.drives {
            for load in self.loads.iter().filter(|load| beta[load.parameter] != 0.0) {
                for channel in drives.joints(load.chain).filter(|c| load.asks(*c)) {
                    let torque = drives.at(block, load.whose, channel);
                    ws.angles[channel] += torque * beta[load.parameter];
                }
            }
            return;
        }
        ws.unloaded.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.unloaded.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta, &ws.gates);
        }
        // The sums of weights are the same for all loads of one kind on one chain.
        ws.carried.resize_with(2 * self.steps.len(), Vec::new);
        for (k, load) in self.loads.iter().enumerate() {
            if k == 0 || self.loads[k - 1].slot() != load.slot() {
                let carried = &mut ws.carried[load.slot()];
                ws.unloaded[load.chain].carried(load.whose, carried);
            }
        }
        for load in self.loads.iter().filter(|load| beta[load.parameter] != 0.0) {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                if let Some(channel) = load.gives(lever) {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    ws.angles[channel] += torque * beta[load.parameter];
                }
            }
        }
    }

    /// Largest torque of gravity of each load in these readings, by the drawing.
    pub(crate) fn largest_torques(&self, readings: &Readings) -> Vec<f64> {
        match &self.drives {
            _ if self.loads.is_empty() => Vec::new(),
            Some(drives) => self.largest_of_drives(drives, readings),
            None => self.largest_as_drawn(readings),
        }
    }

    /// Largest torque of the drives that give under each load.
    fn largest_of_drives(&self, drives: &Drives, readings: &Readings) -> Vec<f64> {
        let largest = |load: &LoadAt| {
            let each = readings.blocks().iter().enumerate().flat_map(|(block, meta)| {
                let joints = drives.joints(load.chain).filter(|c| load.asks(*c));
                joints.map(move |c| largest_of(drives.at(block, load.whose, c), meta))
            });
            each.fold(0.0, f64::max)
        };
        self.loads.iter().map(largest).collect()
    }

    /// Largest torque about the levers that give under each load, where nothing but the joints moves.
    fn largest_as_drawn(&self, readings: &Readings) -> Vec<f64> {
        let moves = |step: &&Element| match step {
            Element::Move(_, _, source) => matches!(source, Source::Channel(_)),
            _ => true,
        };
        let drawn = self.steps.iter().map(|steps| steps.iter().filter(moves).cloned().collect());
        let drawn: Vec<Vec<Element>> = drawn.collect();
        let mut postures = vec![Posture::new(); drawn.len()];
        let (mut carried, mut largest) = (Vec::new(), vec![0.0; self.loads.len()]);
        for (block, meta) in readings.blocks().iter().enumerate() {
            let angles: Vec<Lanes> = (self.scales.iter().zip(readings.raw(block)))
                .map(|(scale, reading)| scale.nominal(*reading))
                .collect();
            for (posture, steps) in postures.iter_mut().zip(&drawn) {
                dispatch(
                    #[inline(always)]
                    || posture.take(steps, &angles, &[], &[]),
                );
            }
            for (k, (load, largest)) in self.loads.iter().zip(&mut largest).enumerate() {
                let posture = &postures[load.chain];
                if k == 0 || self.loads[k - 1].slot() != load.slot() {
                    posture.carried(load.whose, &mut carried);
                }
                for (lever, carried) in posture.levers.iter().zip(&carried) {
                    if load.gives(lever).is_some() {
                        let torque = dot(&carried.moved_by(lever), &self.gravity);
                        *largest = f64::max(*largest, largest_of(torque, meta));
                    }
                }
            }
        }
        largest
    }

    /// The columns of load terms where torques are those of drives, (46).
    #[inline(always)]
    pub(super) fn driven_back(&self, drives: &Drives, block: usize, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        for load in &self.loads {
            for channel in drives.joints(load.chain).filter(|c| load.asks(*c)) {
                let torque = drives.at(block, load.whose, channel);
                for k in 0..self.equations {
                    ws.x[k * width + load.parameter] += ws.g[k * channels + channel] * torque;
                }
            }
        }
    }

    /// `G ← G ∂q'/∂q`, the columns of load terms, and the change of torques by geometry terms.
    #[inline(always)]
    pub(super) fn bend_back(&self, beta: &[f64], want: Want, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        ws.turned.clear();
        ws.turned.extend_from_slice(&ws.g);
        for load in &self.loads {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                let Some(channel) = load.gives(lever) else { continue };
                if want.x {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    for k in 0..self.equations {
                        ws.x[k * width + load.parameter] +=
                            ws.turned[k * channels + channel] * torque;
                    }
                }
                if beta[load.parameter] == 0.0 {
                    continue;
                }
                for (s, by) in posture.levers.iter().enumerate() {
                    let slope = self.torque_slope(&posture.levers, carried, j, s);
                    let slope = slope * beta[load.parameter];
                    for k in 0..self.equations {
                        let change = ws.turned[k * channels + channel] * slope;
                        match by.source {
                            Source::Channel(c) => ws.g[k * channels + c] += change,
                            Source::Parameter(p) if want.x => ws.x[k * width + p] += change,
                            Source::Gated(p, gate) if want.x => {
                                ws.x[k * width + p] += change * ws.gates[gate];
                            }
                            Source::Parameter(_) | Source::Gated(..) | Source::Law(_) => {}
                        }
                    }
                }
            }
        }
    }

    /// Derivative of the torque of gravity about lever `j` by lever `s`.
    #[inline(always)]
    pub(crate) fn torque_slope(
        &self,
        levers: &[Lever],
        carried: &[Carried],
        j: usize,
        s: usize,
    ) -> Lanes {
        // All bodies after the later lever move rigidly with the earlier lever.
        let (turning, moved) = match s <= j {
            true => (&levers[s], carried[j].moved_by(&levers[j])),
            false => (&levers[j], carried[s].moved_by(&levers[s])),
        };
        match turning.way {
            Way::Turn => dot(&cross(&turning.axis, &moved), &self.gravity),
            Way::Slide => Lanes::ZERO,
        }
    }
}

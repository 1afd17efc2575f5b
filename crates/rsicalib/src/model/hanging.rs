//! Torques of drives in closed loops, where some joints have none.
//!
//! Along every motion that the closures allow, the work of the weights is that of the drives, and
//! a passive joint does none. With the slopes `g` of the weights' fall by the joints, and `J` of
//! the closures, of driven joints `d` and passive ones `p`,
//!
//! ```text
//! τ_d = g_d - J_dᵀ (J_pᵀ)⁺ g_p,   τ_p = 0                                     (46)
//! ```
//!
//! Where there are more drives than the loops leave freedoms, the shares of the drives are those
//! without forces that the weights do not ask for.

use nalgebra::{DMatrix, DVector};

use crate::kinematics::elements::{Source, Weight};
use crate::kinematics::posture::Posture;
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::drives::Drives;
use crate::model::ends::End;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, dot};
use crate::readings::Readings;

/// Two joints that nearly follow from the closures alone are told apart down to this.
const SINGULAR: f64 = 1e-9;

impl Model {
    /// The torques of a model as it is drawn, where the mechanism has joints without a drive.
    pub(super) fn drives_of_drawn(&self, readings: &Readings) -> Drives {
        let (beta, mut ws) = (self.nominal(), Workspace::default());
        let want = Want { x: false, a: true };
        let blocks = readings.blocks().iter().enumerate().map(|(block, meta)| {
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            [Weight::Tip, Weight::Links].map(|whose| self.felt(&ws, whose, meta.live))
        });
        let torques = blocks.collect();
        let chains = (0..self.scales.len()).map(|c| self.mechanism.chain_of(c)).collect();
        Drives::new(torques, chains)
    }

    /// The torque of the weights about every joint of a model as it is drawn, block by block, at some
    /// `settled` readings of each: see [`Model::torques`].
    pub(super) fn torques_at<'a>(
        &self,
        readings: &Readings,
        settled: impl Fn(usize) -> &'a [Lanes],
    ) -> Vec<Vec<Lanes>> {
        let (beta, mut ws) = (self.nominal(), Workspace::default());
        let want = Want { x: false, a: true };
        let blocks = readings.blocks().iter().enumerate().map(|(block, _)| {
            self.evaluate(readings, block, settled(block), &beta, want, &mut ws);
            let links = self.pulls(&ws.postures, Weight::Links);
            match links.iter().any(|pull| pull.0.iter().any(|v| *v != 0.0)) {
                true => links,
                false => self.pulls(&ws.postures, Weight::Tip),
            }
        });
        blocks.collect()
    }

    /// Eq. (46) in the samples that were evaluated.
    fn felt(&self, ws: &Workspace, whose: Weight, live: usize) -> Vec<Lanes> {
        let pulls = self.pulls(&ws.postures, whose);
        let joints = 0..pulls.len();
        let (free, driven): (Vec<usize>, Vec<usize>) =
            joints.partition(|&c| self.mechanism.channels[c].passive);
        let slopes = self.slopes(ws);
        let closed = self.inner_equations();
        let mut felt = vec![Lanes::ZERO; pulls.len()];
        for lane in 0..live {
            let slope =
                |k: usize, c: usize| ws.a[closed[k] * pulls.len() + c].0[lane] / slopes[c].0[lane];
            let by_free = DMatrix::from_fn(free.len(), closed.len(), |i, k| slope(k, free[i]));
            let pulled = DVector::from_iterator(free.len(), free.iter().map(|&c| pulls[c].0[lane]));
            let size = SINGULAR * by_free.norm();
            let Ok(inverse) = by_free.pseudo_inverse(size) else { continue };
            let held = inverse * pulled;
            for &c in &driven {
                let by_loops = (0..closed.len()).map(|k| slope(k, c) * held[k]).sum::<f64>();
                felt[c].0[lane] = pulls[c].0[lane] - by_loops;
            }
        }
        felt
    }

    /// Equations of the closures that hold the mechanism together: not of those by which it touches
    /// what stands elsewhere.
    fn inner_equations(&self) -> Vec<usize> {
        let inside = |end: &End| matches!(end, End::Carried(..) | End::Fixed(_));
        let inner = |c: &&CompiledClosure| c.on.is_none() && c.ends.iter().all(inside);
        let closures = self.closures.iter().filter(inner);
        closures.flat_map(|c| c.equation..c.equation + c.equations()).collect()
    }

    /// How far all weights of one kind fall as each joint moves, times the weights.
    fn pulls(&self, postures: &[Posture], whose: Weight) -> Vec<Lanes> {
        let (mut out, mut carried) = (vec![Lanes::ZERO; self.scales.len()], Vec::new());
        for posture in postures {
            posture.carried(whose, &mut carried);
            for (lever, carried) in posture.levers.iter().zip(&carried) {
                if let Source::Channel(c) = lever.source {
                    out[c] += dot(&carried.moved_by(lever), &self.gravity);
                }
            }
        }
        out
    }
}

//! Torques of drives in closed loops, where some joints have none.
//!
//! Along every motion that the closures allow, the work of the weights is that of the drives, and
//! a passive joint does none. With the slopes `g` of the weights' fall by the joints, `J` of the
//! closures, and a base `N` of the motions of all joints, `N_d` those of the drives,
//!
//! ```text
//! N_dᵀ τ_d = Nᵀ g,   J N = 0,   τ_p = 0                                        (46)
//! ```
//!
//! What a column of the readings tells of a drive is known. Where there are more of the other drives
//! than motions, these may work against each other. With the shares `S` that the mechanism states,
//! they do not: of all torques that hold the weights theirs have the least `τᵀ S⁻¹ τ`,
//!
//! ```text
//! τ_d = S N_d (N_dᵀ S N_d)⁺ Nᵀ g                                               (155)
//! ```
//!
//! Without shares such torques are not told, and no load is looked for there.

use nalgebra::{DMatrix, DVector};

use crate::kinematics::elements::{Source, Weight};
use crate::kinematics::posture::Posture;
use crate::mechanism::{Channel, Mechanism};
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::drives::Drives;
use crate::model::ends::End;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, dot};
use crate::readings::{Readings, is_absent};

/// Two joints that nearly follow from the closures alone are told apart down to this.
const SINGULAR: f64 = 1e-9;

/// Part of a drive's torque that no weight asks for, above which there is one: of a drive that no
/// other can work against the part is rounding.
const OPEN: f64 = 1e-6;

impl Model {
    /// The torques of a model as it is drawn, where the mechanism says something of its drives.
    ///
    /// `closures` are names: of what a model holds besides, no drive feels anything.
    pub(super) fn drives_of_drawn(&self, readings: &Readings, closures: &[&str]) -> Drives {
        let (beta, mut ws) = (self.nominal(), Workspace::default());
        let want = Want { x: false, a: true };
        let mut untold = [(); 2].map(|()| vec![false; self.scales.len()]);
        let blocks = (0..readings.blocks().len()).map(|block| {
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let motions = self.motions(&ws, closures, readings.blocks()[block].live);
            [Weight::Tip, Weight::Links].map(|whose| {
                self.felt(&ws, &motions, whose, (block, readings), &mut untold[whose as usize])
            })
        });
        let torques = blocks.collect();
        let chains = (0..self.scales.len()).map(|c| self.mechanism.chain_of(c)).collect();
        Drives::new(torques, chains, untold)
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

    /// The motions that closures of these names allow in each sample that was evaluated, where there are
    /// such.
    fn motions(&self, ws: &Workspace, closures: &[&str], live: usize) -> Vec<Option<DMatrix<f64>>> {
        let (closed, slopes) = (self.inner_equations(closures), self.slopes(ws));
        let joints = slopes.len();
        let of_lane = |lane: usize| {
            let slope =
                |k: usize, c: usize| ws.a[closed[k] * joints + c].0[lane] / slopes[c].0[lane];
            let loops = DMatrix::from_fn(closed.len(), joints, slope);
            allowed(&loops).filter(|motions| motions.ncols() > 0)
        };
        (0..live).map(of_lane).collect()
    }

    /// Eqs. (46) and (155) in the samples that were evaluated; marks drives in `untold`.
    fn felt(
        &self,
        ws: &Workspace,
        motions: &[Option<DMatrix<f64>>],
        whose: Weight,
        block: (usize, &Readings),
        untold: &mut [bool],
    ) -> Vec<Lanes> {
        let pulls = self.pulls(&ws.postures, whose);
        let channels = &self.mechanism.channels;
        let measured = measured(&self.mechanism, whose, block);
        let told = |c: &usize| measured[*c].is_some();
        let (known, drives): (Vec<usize>, Vec<usize>) =
            (0..pulls.len()).filter(|&c| !channels[c].passive).partition(told);
        let shares: Vec<f64> = drives.iter().map(|&c| channels[c].share.unwrap_or(1.0)).collect();
        let mut felt = vec![Lanes::ZERO; pulls.len()];
        for (lane, motions) in motions.iter().enumerate() {
            let Some(motions) = motions else { continue };
            let mut work = DVector::zeros(motions.ncols());
            for (c, pull) in pulls.iter().enumerate() {
                work += motions.row(c).transpose() * pull.0[lane];
            }
            for &c in &known {
                felt[c].0[lane] = measured[c].map_or(0.0, |torque| torque.0[lane]);
                work -= motions.row(c).transpose() * felt[c].0[lane];
            }
            let by_drive = motions.select_rows(&drives);
            let shared = DMatrix::from_diagonal(&DVector::from_column_slice(&shares)) * &by_drive;
            let size = SINGULAR * shared.norm();
            let Ok(inverse) = (by_drive.transpose() * &shared).pseudo_inverse(size) else {
                continue;
            };
            let torques = &shared * (&inverse * work);
            let held = &shared * inverse * by_drive.transpose();
            let open = |k: &usize| 1.0 - held[(*k, *k)] > OPEN;
            let against: Vec<usize> = (0..drives.len()).filter(open).collect();
            let stated = against.iter().all(|&k| channels[drives[k]].share.is_some());
            against.iter().filter(|_| !stated).for_each(|&k| untold[drives[k]] = true);
            for (&c, torque) in drives.iter().zip(&torques) {
                felt[c].0[lane] = *torque;
            }
        }
        felt
    }

    /// Equations of the closures that hold the mechanism together: not of those by which it touches
    /// what stands elsewhere.
    fn inner_equations(&self, named: &[&str]) -> Vec<usize> {
        let inside = |end: &End| matches!(end, End::Carried(..) | End::Fixed(_));
        let own =
            |c: &CompiledClosure| named.contains(&self.mechanism.closures[c.number].name.as_str());
        let inner = |c: &&CompiledClosure| own(c) && c.on.is_none() && c.ends.iter().all(inside);
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

/// An orthonormal base of the motions that closures with these slopes allow, joints by motions.
fn allowed(loops: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let joints = loops.ncols();
    // With as many rows as joints all directions of the joints are among the singular vectors.
    let mut square = DMatrix::zeros(loops.nrows().max(joints), joints);
    for (k, row) in loops.row_iter().enumerate() {
        let size = row.norm();
        if size > 0.0 {
            square.set_row(k, &(row / size));
        }
    }
    let svd = square.svd(false, true);
    let least = SINGULAR * svd.singular_values.max();
    let free: Vec<usize> = (0..joints).filter(|&k| svd.singular_values[k] <= least).collect();
    Some(svd.v_t?.select_rows(&free).transpose())
}

/// What columns tell of drives, channel by channel, as the load that a drive holds: the weights of the
/// links, and not a unit weight.
fn measured(
    mechanism: &Mechanism,
    whose: Weight,
    (block, readings): (usize, &Readings),
) -> Vec<Option<Lanes>> {
    let columns = mechanism.value_columns();
    let told = |channel: &Channel| {
        let name = channel.torque.as_ref().filter(|_| whose == Weight::Links)?;
        let column = columns.iter().position(|column| column == name)?;
        let known = !is_absent(&readings.table.columns[column]);
        Some(Lanes::ZERO - *readings.columns(block).get(column).filter(|_| known)?)
    };
    mechanism.channels.iter().map(told).collect()
}

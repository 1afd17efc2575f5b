//! Equations that follow from the others in every pose: the tip of a spherical mechanism touches
//! radially whatever its joints do, and of the fifteen distances between six points of a body
//! twelve say where all of them are.
//!
//! With `A` of readings that close the loops, a direction `n` of the equations is redundant where
//!
//! ```text
//! nᵀ A = 0    at the closed readings of up to eight samples                       (56)
//! ```
//!
//! spread over the session. Such a combination has no variance, and its misclosure is of second order in the noise: weighed
//! by the inverse of its variance it would outweigh all others. As many equations as there are
//! redundant directions are left out, those that these directions depend on most in all poses:
//! the others then say the same. A touch is turned first, so that what it has redundant is along
//! one axis as far as it can be. Equations with play, or with an unknown point, follow from none.

use crate::numerics::order::Ends;
use nalgebra::{DMatrix, DVector};

use crate::model::compiled::{CompiledClosure, Model};
use crate::model::ends::End;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::numerics::order;
use crate::readings::Readings;

/// Samples are looked at in so many blocks, spread over the session.
const BLOCKS: usize = 4;

/// Part of the largest eigenvalue of `A Aᵀ`, equations and joints scaled, above which the least one
/// shows without closing that nothing is redundant. Far from closed, redundant equations differ.
const CLEAR: f64 = 0.03;

/// The same at closed readings, below which one counts as zero.
const NULL: f64 = 1e-12;

/// Damping of the steps towards closed readings, in parts of the mean eigenvalue: redundant
/// directions have eigenvalues below it on the way, and what is said along them moves nothing.
const DAMPING: f64 = 1e-6;

/// Steps towards closed readings, and the length of the last one (rad) where they have closed.
const STEPS: usize = 16;
const CLOSED: f64 = 1e-6;

/// Least part that a redundant direction must have along an equation that is left out for it.
const LEAST: f64 = 0.03;

/// `A` of one sample with equations and joints scaled, and the misclosure in the same unit.
struct Slopes {
    /// Equations by joints.
    a: DMatrix<f64>,
    /// What a step of one joint is in its reading.
    readings: Vec<f64>,
    f: DVector<f64>,
    /// `A Aᵀ`, and one for an equation that varies by itself.
    gram: DMatrix<f64>,
}

impl Model {
    /// Leaves out equations that follow from the others in every pose, (56).
    pub(crate) fn leave_out_equations_that_follow(&mut self, readings: &Readings) {
        let Some(mut redundant) = self.redundant(readings) else { return };
        let turned: Vec<_> =
            self.closures.iter().map(|closure| turned(closure, &mut redundant)).collect();
        let Some(out) = most_dependent(redundant) else { return };
        for (closure, axes) in self.closures.iter_mut().zip(turned) {
            let own = closure.equation..closure.equation + closure.equations();
            if !own.clone().any(|row| out.contains(&row)) {
                continue;
            }
            let kept = own.zip(axes).filter(|(row, _)| !out.contains(row));
            closure.along = Some(kept.map(|(_, axis)| axis).collect());
        }
        self.number_equations();
    }

    /// An orthonormal base of the redundant directions in each of some samples, equations by
    /// directions; none where there is a sample without.
    fn redundant(&self, readings: &Readings) -> Option<Vec<DMatrix<f64>>> {
        if self.equations < 2 {
            return None;
        }
        let own: Vec<bool> = self.closures.iter().flat_map(varies_by_itself).collect();
        let all = readings.blocks().len();
        let mut blocks: Vec<usize> =
            (0..BLOCKS).map(|k| k * all.saturating_sub(1) / (BLOCKS - 1)).collect();
        blocks.dedup();
        let mut found = Vec::new();
        for block in blocks {
            found.extend(self.redundant_in(readings, block, &own)?);
        }
        let fewest = found.iter().map(|(_, count)| *count).min()?;
        let bases = found.into_iter().map(|(base, _)| base.columns(0, fewest).into_owned());
        Some(bases.collect())
    }

    /// The same in the first and the last sample of a block: all directions, the most redundant
    /// first, and the number of those that are. None where a sample that closes has none; distances
    /// that contradict each other do not close, and are redundant anywhere.
    fn redundant_in(
        &self,
        readings: &Readings,
        block: usize,
        own: &[bool],
    ) -> Option<Vec<(DMatrix<f64>, usize)>> {
        let (beta, want) = (self.nominal(), Want { x: false, a: true });
        let mut samples = vec![(0, 0.0), (readings.blocks()[block].live - 1, 0.0)];
        samples.dedup();
        // What does not hold follows from anything: such a row tells nothing of what does.
        let whole = |lane: usize| {
            let row = readings.blocks()[block].rows[lane];
            self.closures.iter().all(|c| readings.holding.holds(row, c.number))
        };
        samples.retain(|(lane, _)| whole(*lane));
        let mut at: Vec<Lanes> = readings.raw(block).to_vec();
        let mut ws = Workspace::default();
        for turn in 0..STEPS {
            self.evaluate(readings, block, &at, &beta, want, &mut ws);
            for (lane, step) in &mut samples {
                let here = self.scaled(&ws, *lane, own)?;
                if turn == 0 && here.is_clear() {
                    return None;
                }
                *step = here.towards_closed(&mut at, *lane)?;
            }
            if samples.iter().all(|(_, step)| *step < CLOSED * CLOSED) {
                break;
            }
        }
        self.evaluate(readings, block, &at, &beta, want, &mut ws);
        let mut found = Vec::new();
        for (lane, step) in samples {
            match self.scaled(&ws, lane, own)?.directions() {
                Some(directions) => found.push(directions),
                None if step < CLOSED => return None,
                None => {}
            }
        }
        Some(found)
    }

    /// `A` of one sample, scaled; none where it is not to be had.
    fn scaled(&self, ws: &Workspace, lane: usize, own: &[bool]) -> Option<Slopes> {
        let channels = self.scales.len();
        let by_joint = |c: usize| 1.0 / self.scales[c].gain;
        let mut a = DMatrix::from_fn(self.equations, channels, |row, c| {
            ws.a[row * channels + c].0[lane] * by_joint(c)
        });
        let mut f = DVector::from_fn(self.equations, |row, _| ws.f[row].0[lane]);
        for closure in &self.closures {
            // All axes of a touch alike: it may be turned.
            let mut rows = a.rows_mut(closure.equation, closure.equations());
            let scale = 1.0 / rows.norm();
            if scale.is_finite() {
                rows *= scale;
                let mut rows = f.rows_mut(closure.equation, closure.equations());
                rows *= scale;
            }
        }
        let long = |c: usize| Some(a.column(c).norm()).filter(|long| *long > 0.0);
        let scales: Vec<f64> = (0..channels).map(|c| long(c).map_or(0.0, f64::recip)).collect();
        for (mut column, scale) in a.column_iter_mut().zip(&scales) {
            column *= *scale;
        }
        let mut gram = &a * a.transpose();
        own.iter().enumerate().filter(|(_, own)| **own).for_each(|(k, _)| gram[(k, k)] += 1.0);
        let readings = (0..channels).map(|c| scales[c] * by_joint(c)).collect();
        let finite = gram.iter().chain(f.iter()).all(|value| value.is_finite());
        finite.then_some(Slopes { a, readings, f, gram })
    }
}

impl Slopes {
    /// True where nothing is redundant, closed or not.
    fn is_clear(&self) -> bool {
        let values = self.gram.clone().symmetric_eigenvalues();
        values.min() > CLEAR * values.max()
    }

    /// Moves a sample towards closed loops; the length of the step.
    fn towards_closed(&self, at: &mut [Lanes], lane: usize) -> Option<f64> {
        let n = self.f.len();
        let damping = DAMPING * self.gram.trace() / n as f64;
        let damped = &self.gram + DMatrix::identity(n, n) * damping;
        let step = self.a.transpose() * damped.cholesky()?.solve(&self.f);
        for ((at, step), reading) in at.iter_mut().zip(step.iter()).zip(&self.readings) {
            at.0[lane] -= step * reading;
        }
        Some(step.norm())
    }

    /// Directions of the equations, the most redundant first, and how many are; none where none is.
    fn directions(&self) -> Option<(DMatrix<f64>, usize)> {
        let eigen = self.gram.clone().symmetric_eigen();
        let mut order: Vec<usize> = (0..self.f.len()).collect();
        order::ascending(&mut order, |&i| eigen.eigenvalues[i]);
        let least = NULL * eigen.eigenvalues.max();
        let count = eigen.eigenvalues.iter().filter(|value| **value < least).count();
        (count > 0).then(|| (eigen.eigenvectors.select_columns(&order), count))
    }
}

/// For each equation of a closure, whether it may vary while no reading does.
fn varies_by_itself(closure: &CompiledClosure) -> Vec<bool> {
    let told = |end: &End| matches!(end, End::Unknown(..) | End::Posed(_) | End::Seen(..));
    let unknown = closure.ends.iter().any(told) || closure.on.is_some();
    let measured = closure.column.is_some();
    vec![unknown || measured || closure.noise > 0.0; closure.equations()]
}

/// Axes of a touch, turned so that what is redundant is along the first as far as it can be; the
/// redundant directions are then in these axes. A distance has one equation, which stays.
fn turned(closure: &CompiledClosure, redundant: &mut [DMatrix<f64>]) -> Vec<[f64; 3]> {
    let axes = closure.along.clone().unwrap_or_else(|| {
        (0..closure.equations()).map(|k| [0, 1, 2].map(|i| f64::from(u8::from(i == k)))).collect()
    });
    if !closure.kind.facts().is_vector || axes.len() < 2 {
        return axes;
    }
    let (first, n) = (closure.equation, axes.len());
    let squares = redundant.iter().fold(DMatrix::zeros(n, n), |sum, base| {
        let own = base.rows(first, n);
        sum + own * own.transpose()
    });
    let eigen = squares.symmetric_eigen();
    let mut order: Vec<usize> = (0..n).collect();
    order::descending(&mut order, |&i| eigen.eigenvalues[i]);
    let turn = eigen.eigenvectors.select_columns(&order).transpose();
    for base in redundant {
        let own = &turn * base.rows(first, n);
        base.rows_mut(first, n).copy_from(&own);
    }
    let along =
        |k: usize, i: usize| axes.iter().enumerate().map(|(m, a)| turn[(k, m)] * a[i]).sum();
    (0..n).map(|k| [0, 1, 2].map(|i| along(k, i))).collect()
}

/// As many equations as there are redundant directions, in turn that one which they depend on most
/// in the pose where they do least; none where there is no such equation.
fn most_dependent(mut redundant: Vec<DMatrix<f64>>) -> Option<Vec<usize>> {
    let (equations, count) = redundant.first()?.shape();
    let mut out: Vec<usize> = Vec::new();
    for _ in 0..count {
        let least = |row: usize| {
            redundant.iter().map(|base| base.row(row).norm()).fold(f64::INFINITY, f64::min)
        };
        let (row, part) = (0..equations).map(|row| (row, least(row))).greatest_by(|a| a.1)?;
        if part < LEAST {
            return None;
        }
        out.push(row);
        for base in &mut redundant {
            let taken = base.row(row).transpose().normalize();
            let rest = &*base - (&*base * &taken) * taken.transpose();
            *base = rest;
        }
    }
    Some(out)
}

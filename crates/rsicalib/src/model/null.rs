//! Equations that nothing can violate: the third of a touch in a planar mechanism.
//!
//! With the rows `G = [A X]` of a touch over all samples, and its misclosure `f`, a direction
//! `u` is null where
//!
//! ```text
//! uᵀ G = 0  and  uᵀ f = 0    in every sample                              (54)
//! ```
//!
//! to rounding. Such an equation says `0 = 0`: without play its variance is zero too, and
//! with play it would pass for a quiet one. An equation that no reading moves and that has no
//! play has no variance, whatever the parameters do to it, and cannot be weighed: `X` is
//! looked at where there is play. Directions need not be axes: a plane may lie anywhere.
//!
//! A chain that touches an unknown point always coincides with it on average. There `uᵀ X` and
//! `uᵀ f` are null where they are the same in all samples of one point: its coordinate along `u`
//! is where the chain touches it, and enters no other equation. A prior holds it there.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::model::compiled::Model;
use crate::model::ends::{End, Measured};
use crate::model::prior::Prior;
use crate::model::workspace::{Want, Workspace};
use crate::readings::Readings;

/// Part of the largest singular value below which one counts as zero. Sines are rounded to
/// 1e-16, and a drawing to some digits more than a workshop holds: 1e-9 rad is 1 nm in a metre.
const NULL: f64 = 1e-9;

/// Standard deviation of a coordinate that a null equation without play determines, in parts of
/// the largest singular value. Nothing depends on its size: no reading moves the coordinate.
const HELD: f64 = 1e-6;

/// Directions of a touch that are not null, and the others.
struct Parted {
    kept: Vec<[f64; 3]>,
    null: Vec<[f64; 3]>,
    /// The largest singular value.
    largest: f64,
}

impl Model {
    /// Leaves out equations that nothing can violate.
    pub(crate) fn leave_out_null_equations(&mut self, readings: &Readings) {
        let touches: Vec<usize> = (0..self.closures.len())
            .filter(|&k| self.closures[k].kind.facts().is_vector)
            .filter(|&k| !self.tells_of_places(k))
            .filter(|&k| self.unknown_of(k).is_none_or(|point| self.touched_once(point)))
            .collect();
        let found: Vec<_> =
            touches.into_iter().map(|k| (k, self.directions(k, readings))).collect();
        self.held.clear();
        for (k, parted) in found {
            let Some(parted) = parted else { continue };
            let held = self.held_along(k, readings, &parted);
            self.held.extend(held);
            self.closures[k].along = Some(parted.kept);
        }
        self.number_equations();
    }

    /// The unknown point that a closure touches.
    fn unknown_of(&self, closure: usize) -> Option<usize> {
        self.closures[closure].ends.iter().find_map(|end| match end {
            End::Unknown(point, ..) => Some(*point),
            _ => None,
        })
    }

    /// True for a closure that tells where something is in one pose alone, where a frame is, or where
    /// a point is that is known in part.
    fn tells_of_places(&self, closure: usize) -> bool {
        self.closures[closure].ends.iter().any(|end| match end {
            End::Posed(_) | End::Seen(_, Measured::Unknown(_), _) => true,
            End::Unknown(.., free) => free.contains(&false),
            _ => false,
        })
    }

    /// True where one closure touches an unknown point: what two touch, one may violate.
    fn touched_once(&self, point: usize) -> bool {
        (0..self.closures.len()).filter(|&k| self.unknown_of(k) == Some(point)).count() == 1
    }

    /// Directions of a touch by whether they are null, (54); none where all three count.
    fn directions(&self, closure: usize, readings: &Readings) -> Option<Parted> {
        let (unknown, closure) = (self.unknown_of(closure), &self.closures[closure]);
        let (channels, width, beta) = (self.scales.len(), self.width(), self.nominal());
        let want = Want { x: closure.noise > 0.0, a: true };
        // An unknown point is where the chain touches it: its own columns say nothing.
        let own = unknown.map_or(width..width, |point| {
            let first = self.unknown_column(point);
            first..first + 3
        });
        let mut ws = Workspace::default();
        let (mut span, mut open) = (Matrix3::<f64>::zeros(), Matrix3::<f64>::zeros());
        let mut first: Vec<Option<Vec<Vector3<f64>>>> = vec![None; readings.groups.len()];
        for (block, meta) in readings.blocks().iter().enumerate() {
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let mut columns: Vec<Vector3<f64>> = Vec::new();
            for lane in readings.lanes(block, closure.number) {
                let row = |k: usize| closure.equation + k;
                columns.extend((0..channels).map(|c| {
                    // In joint coordinates, so that units of readings do not matter.
                    let by_joint = 1.0 / self.scales[c].gain;
                    Vector3::from_fn(|k, _| ws.a[row(k) * channels + c].0[lane] * by_joint)
                }));
                let mut fixed = vec![Vector3::from_fn(|k, _| ws.f[row(k)].0[lane])];
                if want.x {
                    let of = |p: usize| Vector3::from_fn(|k, _| ws.x[row(k) * width + p].0[lane]);
                    fixed.extend((0..width).filter(|p| !own.contains(p)).map(of));
                }
                if unknown.is_some() {
                    let same = first[meta.group].get_or_insert_with(|| fixed.clone());
                    fixed.iter_mut().zip(same).for_each(|(column, same)| *column -= *same);
                }
                open += fixed[0] * fixed[0].transpose();
                columns.extend_from_slice(&fixed[1..]);
            }
            span = joined(&span, &columns);
            if full(&span) {
                return None;
            }
        }
        let svd = span.svd(true, false);
        let (u, values) = (svd.u?, svd.singular_values);
        let largest = values.max();
        // The misclosure over the length of the levers: both are lengths.
        let violated = |k: usize| {
            let u = u.column(k);
            (u.transpose() * open * u)[0].max(0.0).sqrt() > NULL * largest
        };
        let (kept, null): (Vec<usize>, Vec<usize>) =
            (0..3).partition(|&k| values[k] > NULL * largest || violated(k));
        let of = |some: Vec<usize>| some.iter().map(|&k| [0, 1, 2].map(|i| u[(i, k)])).collect();
        (!null.is_empty()).then(|| Parted { kept: of(kept), null: of(null), largest })
    }

    /// Where the chain touches unknown points along null directions.
    fn held_along(&self, closure: usize, readings: &Readings, parted: &Parted) -> Vec<Prior> {
        let closure = &self.closures[closure];
        let (touching, point) = match closure.ends {
            [End::Unknown(point, ..), other] | [other, End::Unknown(point, ..)] => (other, point),
            _ => return Vec::new(),
        };
        let sd = closure.noise.max(HELD * parted.largest);
        let (beta, want) = (self.nominal(), Want { x: false, a: false });
        let (mut ws, mut held) = (Workspace::default(), Vec::new());
        let mut known: Vec<usize> = Vec::new();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let number = self.owned[point].numbers[meta.group];
            let Some(lane) = readings.lanes(block, closure.number).next() else { continue };
            if known.contains(&number) {
                continue;
            }
            known.push(number);
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let seen = readings.columns(block);
            let at = self.end_point(&touching, meta.group, seen, &beta, &ws);
            held.extend(parted.null.iter().map(|direction| Prior::Along {
                point: self.term_parameters + self.unknowns[number].first,
                direction: *direction,
                mean: (0..3).map(|k| direction[k] * at[k].0[lane]).sum(),
                sd,
            }));
        }
        held
    }
}

/// `U Σ` of the columns so far and of more of them: squares would lose half of the digits.
fn joined(span: &Matrix3<f64>, more: &[Vector3<f64>]) -> Matrix3<f64> {
    let all = DMatrix::from_fn(3, 3 + more.len(), |i, j| match j {
        0..3 => span[(i, j)],
        _ => more[j - 3][i],
    });
    let svd = all.svd(true, false);
    let Some(u) = svd.u else { return *span };
    Matrix3::from_fn(|i, j| u[(i, j)] * svd.singular_values[j])
}

/// True where no direction is null.
fn full(span: &Matrix3<f64>) -> bool {
    let values = span.singular_values();
    values.min() > NULL * values.max()
}

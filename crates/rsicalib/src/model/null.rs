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

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::mechanism::ClosureKind;
use crate::model::compiled::{End, Model};
use crate::model::evaluation::{Want, Workspace};
use crate::readings::Readings;

/// Part of the largest singular value below which one counts as zero. Sines are rounded to
/// 1e-16, and a drawing to some digits more than a workshop holds: 1e-9 rad is 1 nm in a metre.
const NULL: f64 = 1e-9;

impl Model {
    /// Leaves out equations that nothing can violate.
    pub(crate) fn leave_out_null_equations(&mut self, readings: &Readings) {
        let unknown = |end: &End| matches!(end, End::Unknown(_));
        let touches: Vec<usize> = (0..self.closures.len())
            .filter(|&k| self.closures[k].kind == ClosureKind::Touch)
            .filter(|&k| !self.closures[k].ends.iter().any(unknown))
            .collect();
        let found: Vec<_> =
            touches.into_iter().map(|k| (k, self.directions(k, readings))).collect();
        for (k, along) in found {
            self.closures[k].along = along;
        }
        self.number_equations();
    }

    /// Directions of a touch that are not null, (54); none where all three count.
    fn directions(&self, closure: usize, readings: &Readings) -> Option<Vec<[f64; 3]>> {
        let (closure, beta) = (&self.closures[closure], self.nominal());
        let (channels, width) = (self.scales.len(), self.width());
        let want = Want { x: closure.noise > 0.0, a: true };
        let mut ws = Workspace::default();
        let (mut span, mut open) = (Matrix3::<f64>::zeros(), Matrix3::<f64>::zeros());
        for block in 0..readings.blocks().len() {
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let mut columns: Vec<Vector3<f64>> = Vec::new();
            for lane in 0..readings.blocks()[block].live {
                let row = |k: usize| closure.equation + k;
                columns.extend((0..channels).map(|c| {
                    // In joint coordinates, so that units of readings do not matter.
                    let by_joint = 1.0 / self.scales[c].gain;
                    Vector3::from_fn(|k, _| ws.a[row(k) * channels + c].0[lane] * by_joint)
                }));
                if want.x {
                    let of = |p: usize| Vector3::from_fn(|k, _| ws.x[row(k) * width + p].0[lane]);
                    columns.extend((0..width).map(of));
                }
                let f = Vector3::from_fn(|k, _| ws.f[row(k)].0[lane]);
                open += f * f.transpose();
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
        let kept = (0..3).filter(|&k| values[k] > NULL * largest || violated(k));
        let kept: Vec<[f64; 3]> = kept.map(|k| [u[(0, k)], u[(1, k)], u[(2, k)]]).collect();
        (kept.len() < 3).then_some(kept)
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

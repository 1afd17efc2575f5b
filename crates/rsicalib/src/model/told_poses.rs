//! Where things are in each pose by what is known alone: a plate by its legs, without the instrument
//! that sees it.
//!
//! An unknown frame, plane or point is placed by what it touches. Its own closures say nothing before,
//! and would pull a plate to wherever the frame is drawn.

use nalgebra::DMatrix;

use crate::model::compiled::Model;
use crate::model::near::RANK;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::Readings;

impl Model {
    /// The same with those closures alone that touch nothing unknown.
    pub(super) fn of_known(&self) -> Self {
        let mut known = self.clone();
        known.closures.retain(|closure| closure.unknowns().next().is_none());
        known.number_equations();
        known
    }

    /// The readings of a block, and after them what is unknown in each of its poses, (58): no number
    /// where the closures leave it open.
    pub(super) fn told_poses(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        ws: &mut Workspace,
    ) -> Vec<Lanes> {
        let (n, raw) = (self.pose_unknowns(), readings.raw(block));
        if n == 0 {
            return raw.to_vec();
        }
        let mut a = self.placed(readings, block, raw, beta, ws);
        self.evaluate_at(readings, block, &a, beta, Want { x: false, a: true }, ws);
        let lengths = self.lengths();
        for lane in 0..WIDTH {
            let b = DMatrix::from_fn(lengths.len(), n, |k, i| ws.b[k * n + i].0[lane] * lengths[k]);
            let xi = a[self.scales.len()..].iter_mut().zip(open(b));
            xi.filter(|(_, open)| *open).for_each(|(xi, _)| xi.0[lane] = f64::NAN);
        }
        a
    }
}

/// True for each column that takes part in a motion that these equations leave open.
fn open(mut b: DMatrix<f64>) -> Vec<bool> {
    let n = b.ncols();
    if b.iter().any(|b| !b.is_finite()) {
        return vec![true; n];
    }
    // Lengths and angles alike.
    for mut column in b.column_iter_mut() {
        let norm = column.norm();
        column /= norm.max(f64::MIN_POSITIVE);
    }
    let eigen = (b.transpose() * b).symmetric_eigen();
    let least = RANK * RANK * eigen.eigenvalues.max();
    let free = (0..n).filter(|&k| eigen.eigenvalues[k] <= least);
    let free: Vec<_> = free.map(|k| eigen.eigenvectors.column(k)).collect();
    (0..n).map(|i| free.iter().any(|motion| motion[i].abs() > RANK)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_free_motion_moves_is_open() {
        // Equations of x + y, of z in another unit, and of z again: x and y may change together.
        let b = DMatrix::from_row_slice(3, 3, &[1.0, 1.0, 0.0, 0.0, 0.0, 1e4, 0.0, 0.0, 2e4]);
        assert_eq!(open(b), [true, true, false]);
        assert_eq!(open(DMatrix::zeros(0, 2)), [true, true]);
        assert_eq!(open(DMatrix::identity(2, 2)), [false, false]);
    }
}

//! Where an unknown point is that distances alone tell: amid spheres.
//!
//! With the centres `p` of the spheres, their radii `d`, and means `¯` over all of them, `q = p - p¯`,
//! the differences of `|x - p|² = d²` are linear in `y = x - p¯`:
//!
//! ```text
//! 2 q · y = |q|² - |q|²¯ - (d² - d²¯),   |y|² = d²¯ - |q|²¯                       (49)
//! ```
//!
//! Where the centres are in a plane the second says how far `x` is from it, to either side.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::model::near::RANK;

/// A centre and a radius.
pub(crate) type Sphere = (Vector3<f64>, f64);

/// The point that is nearest to all spheres by (49), on the side of `near`; none for fewer than three.
pub(crate) fn amid(spheres: &[Sphere], near: Vector3<f64>) -> Option<Vector3<f64>> {
    let count = spheres.len() as f64;
    if spheres.len() < 3 {
        return None;
    }
    let mean = spheres.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / count;
    let away = |k: usize| spheres[k].0 - mean;
    let power = |k: usize| away(k).norm_squared() - spheres[k].1.powi(2);
    let middle = (0..spheres.len()).map(power).sum::<f64>() / count;
    let q = DMatrix::from_fn(spheres.len(), 3, |k, i| 2.0 * away(k)[i]);
    let rest = DVector::from_fn(spheres.len(), |k, _| power(k) - middle);
    let svd = q.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let largest = svd.singular_values.max();
    let (mut y, mut across) = (Vector3::zeros(), None);
    for (k, value) in svd.singular_values.iter().enumerate() {
        let direction = Vector3::from_fn(|i, _| v_t[(k, i)]);
        if *value > RANK * largest {
            y += direction * (u.column(k).dot(&rest) / value);
        } else {
            across = Some(direction);
        }
    }
    if let Some(across) = across {
        let height = (-middle - y.norm_squared()).max(0.0).sqrt();
        let side = across.dot(&(near - mean));
        y += across * height * if side < 0.0 { -1.0 } else { 1.0 };
    }
    Some(mean + y).filter(|at| at.iter().all(|v| v.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_point_amid_spheres_is_where_they_meet() {
        let at = Vector3::new(0.3, -1.2, 0.7);
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [0.3, 1.9, 0.2], [0.2, 0.4, 2.1]];
        let sphere = |p: [f64; 3]| (Vector3::from(p), (at - Vector3::from(p)).norm());
        let found = amid(&corners.map(sphere), Vector3::zeros()).expect("four");
        // Lengths of a few units, condition below 10.
        assert!((found - at).norm() < 1e-13);
    }

    #[test]
    fn of_two_points_the_nearer_is_taken() {
        let flat = [[0.0, 0.0, 1.0], [2.0, 0.1, 1.0], [0.3, 1.9, 1.0], [1.5, 1.5, 1.0]];
        for z in [-0.4, 2.4] {
            let at = Vector3::new(0.5, 0.6, z);
            let sphere = |p: [f64; 3]| (Vector3::from(p), (at - Vector3::from(p)).norm());
            let found = amid(&flat.map(sphere), Vector3::new(0.0, 0.0, z)).expect("four");
            // A square root of rounding would be 1e-8; the height is 1.4.
            assert!((found - at).norm() < 1e-12);
        }
    }
}

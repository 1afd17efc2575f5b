//! The rigid motion that fits points to other points best.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Pose `x y z rx ry rz` (length units, rad) that takes the platform points `q` nearest to `r`, in
/// least squares. NaN where the singular values cannot be computed.
///
/// The rotation is Kabsch's, from the singular values of the cross-covariance.
#[must_use]
pub fn rigid_fit(q: &[Vector3<f64>], r: &[Vector3<f64>]) -> [f64; 6] {
    let n = q.len() as f64;
    let (q0, r0) = (q.iter().sum::<Vector3<f64>>() / n, r.iter().sum::<Vector3<f64>>() / n);
    let mut cross = Matrix3::zeros();
    for (q, r) in q.iter().zip(r) {
        cross += (r - r0) * (q - q0).transpose();
    }
    let svd = cross.svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return [f64::NAN; 6] };
    let mut flip = Matrix3::identity();
    flip[(2, 2)] = (u * vt).determinant().signum();
    let rotation = Rotation3::from_matrix_unchecked(u * flip * vt);
    let at = r0 - rotation * q0;
    let (rx, ry, rz) = rotation.euler_angles();
    [at.x, at.y, at.z, rx, ry, rz]
}

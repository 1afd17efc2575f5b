//! The rigid motion that fits points to other points best.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Pose `x y z rx ry rz` (length units, rad) that takes the platform points `q` nearest to `r`, in
/// least squares. NaN where the singular values cannot be computed.
///
/// The rotation is Kabsch's, from the singular values of the cross-covariance.
#[must_use]
pub fn rigid_fit(q: &[Vector3<f64>], r: &[Vector3<f64>]) -> [f64; 6] {
    fitted(q, r, &Matrix3::zeros())
}

/// The same, turned as `drawn` where the points do not tell it: as if each of them stood for three that turned as
/// drawn, as far apart as the fit leaves the points off.
#[must_use]
pub(crate) fn rigid_fit_near(
    q: &[Vector3<f64>],
    r: &[Vector3<f64>],
    drawn: &Rotation3<f64>,
) -> [f64; 6] {
    let [x, y, z, rx, ry, rz] = rigid_fit(q, r);
    let (rotation, at) = (Rotation3::from_euler_angles(rx, ry, rz), Vector3::new(x, y, z));
    let off = |(q, r): (&Vector3<f64>, &Vector3<f64>)| (rotation * q + at - r).norm_squared();
    let square: f64 = q.iter().zip(r).map(off).sum();
    fitted(q, r, &(drawn.matrix() * square))
}

/// The rigid fit, with so much cross-covariance beside that of the points.
fn fitted(q: &[Vector3<f64>], r: &[Vector3<f64>], beside: &Matrix3<f64>) -> [f64; 6] {
    let n = q.len() as f64;
    let (q0, r0) = (q.iter().sum::<Vector3<f64>>() / n, r.iter().sum::<Vector3<f64>>() / n);
    let mut cross = *beside;
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

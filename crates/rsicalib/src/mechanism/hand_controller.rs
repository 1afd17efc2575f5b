//! Closed forms of the RSI hand controller, eqs. (1)-(8) of the paper.
//!
//! | symbol | here | |
//! |---|---|---|
//! | l1, l2, l3, l4 | [`L1`] … [`L4`] | Table I, inches |
//! | θi0 | [`THETA_0`] | bearing of the base of arm i |
//! | θij | `angles[i][j]` | joint angles, rad |
//! | r_i | `wrists[i]` | wrist points in the base frame, inches |
//!
//! The generic kinematics of [`crate::kinematics`] do not use this file.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::Error;
use crate::closures::ClosureKind;
use crate::mechanism::drawing::{
    COUNT, Chain, Channel, Closure, Mechanism, ModelSection, Point, Rest, Row, Value,
};

/// Radius of the base circle with its sign: the Denavit-Hartenberg length of the fixed row (in).
#[doc(hidden)]
pub const L1: f64 = -4.5;

/// Shoulder to elbow (in).
#[doc(hidden)]
pub const L2: f64 = 3.2;

/// Elbow to wrist (in).
#[doc(hidden)]
pub const L3: f64 = 3.971;

/// Handle centre to wrist (in).
#[doc(hidden)]
pub const L4: f64 = 1.5;

/// Bearing of each arm's base frame (rad).
#[doc(hidden)]
pub const THETA_0: [f64; 3] = [PI, PI / 3.0, -PI / 3.0];

/// Joint limits of Fig. 4, rad.
#[doc(hidden)]
pub const LIMITS: [[f64; 2]; 3] = [[-PI / 2.0, PI / 2.0], [-PI, 0.0], [-PI / 2.0, PI / 2.0]];

/// Workspace of the handle: lowest and highest x, y, z (in), rx, ry, rz (rad).
#[doc(hidden)]
pub const WORKSPACE: [[f64; 2]; 6] = {
    let turn = PI / 6.0;
    [[-3.0, 3.0], [-3.0, 3.0], [-5.7, -0.3], [-turn, turn], [-turn, turn], [-turn, turn]]
};

/// Wrist points for joint angles, eq. (2): `r_i = A_i0 r_i0`.
///
/// `angles[i][j]` is `θ_ij` (rad); the wrist points are in the base frame (in).
#[doc(hidden)]
#[must_use]
pub fn wrists(angles: &[[f64; 3]; 3]) -> [Vector3<f64>; 3] {
    std::array::from_fn(|i| {
        let [t1, t2, t3] = angles[i];
        let reach = L3 * t3.cos();
        let x = L2 * t1.cos() + reach * (t1 + t2).cos();
        let y = L2 * t1.sin() + reach * (t1 + t2).sin();
        arm_base(i) * Vector3::new(x, y, L3 * t3.sin()) + base_origin(i)
    })
}

/// Handle pose `x y z rx ry rz` from three wrist points, eqs. (3)-(5).
///
/// The wrist points are in the base frame (in); the pose is in inches and radians. Wrist points
/// that are not exactly `l4 √3` apart give axes that are not exactly unit vectors, as in the
/// paper.
#[doc(hidden)]
#[must_use]
pub fn handle(r: &[Vector3<f64>; 3]) -> [f64; 6] {
    let r_h = (r[0] + r[1] + r[2]) / 3.0; // (3)
    let x_h = (r[0] - r_h) / L4; // (4)
    let y_h = (r[2] - r[1]) / (L4 * 3.0_f64.sqrt());
    let z_h = x_h.cross(&y_h);
    let rz = x_h.y.atan2(x_h.x); // (5)
    let ry = (-x_h.z).atan2(x_h.x * rz.cos() + x_h.y * rz.sin());
    let rx = y_h.z.atan2(z_h.z);
    [r_h.x, r_h.y, r_h.z, rx, ry, rz]
}

/// Handle pose `x y z rx ry rz` (in, rad) for joint angles (rad), eqs. (2)-(5).
#[must_use]
pub fn forward(angles: &[[f64; 3]; 3]) -> [f64; 6] {
    handle(&wrists(angles))
}

/// Joint angles (rad) for a handle pose (in, rad), eqs. (6)-(8), within the joint limits.
///
/// # Errors
///
/// [`Error::OutOfReach`] with the arm that does not reach the pose, or the joint that would be
/// beyond its limit, and by how much.
pub fn inverse(pose: &[f64; 6]) -> Result<[[f64; 3]; 3], Error> {
    let r_h = Vector3::new(pose[0], pose[1], pose[2]);
    let turn = Rotation3::from_euler_angles(pose[3], pose[4], pose[5]); // (1)
    let mut angles = [[0.0; 3]; 3];
    for (i, angles) in angles.iter_mut().enumerate() {
        let bearing = -2.0 * PI / 3.0 * i as f64;
        let q = Vector3::new(L4 * bearing.cos(), L4 * bearing.sin(), 0.0);
        let r_i0 = arm_base(i).transpose() * (r_h + turn * q - base_origin(i));
        *angles = arm_angles(i, &r_i0)?;
    }
    Ok(angles)
}

/// Eqs. (6)-(8) for one arm; `r` is the wrist in frame i0.
fn arm_angles(arm: usize, r: &Vector3<f64>) -> Result<[f64; 3], Error> {
    let unreachable = |by: f64, unit: &str, why: String| Error::OutOfReach {
        pose: None,
        arm: format!("arm{}", arm + 1),
        by,
        unit: unit.into(),
        why,
    };
    if r.z.abs() > L3 {
        let why = "sideways beyond the forearm".into();
        return Err(unreachable(r.z.abs() - L3, "in", why));
    }
    let t3 = (r.z / L3).asin(); // (6)
    let reach = L3 * t3.cos();
    let rho = r.x.hypot(r.y);
    if rho > L2 + reach {
        return Err(unreachable(rho - L2 - reach, "in", "farther than the stretched arm".into()));
    }
    if rho < (L2 - reach).abs() {
        let by = (L2 - reach).abs() - rho;
        return Err(unreachable(by, "in", "nearer than the folded arm".into()));
    }
    let cos2 = (rho * rho - L2 * L2 - reach * reach) / (2.0 * L2 * reach);
    let t2 = -cos2.clamp(-1.0, 1.0).acos(); // (7)
    let cos1 = (rho * rho + L2 * L2 - reach * reach) / (2.0 * L2 * rho);
    let t1 = r.y.atan2(r.x) + cos1.clamp(-1.0, 1.0).acos(); // (8)
    let t1 = if t1 > PI { t1 - 2.0 * PI } else { t1 };
    let angles = [t1, t2, t3];
    for (j, (angle, [low, high])) in angles.iter().zip(LIMITS).enumerate() {
        let by = (low - angle).max(angle - high);
        if by > 1e-12 {
            return Err(unreachable(by, "rad", format!("limit of joint {}", j + 1)));
        }
    }
    Ok(angles)
}

/// Rotation of `A_i0`: `Rz(θi0) Rx(π/2)`.
fn arm_base(arm: usize) -> Matrix3<f64> {
    let (s, c) = THETA_0[arm].sin_cos();
    Matrix3::new(c, 0.0, s, s, 0.0, -c, 0.0, 1.0, 0.0)
}

/// Translation of `A_i0`.
fn base_origin(arm: usize) -> Vector3<f64> {
    let (s, c) = THETA_0[arm].sin_cos();
    Vector3::new(L1 * c, L1 * s, 0.0)
}

impl Mechanism {
    /// The RSI 6-DOF hand controller (Hollerbach & Lokhorst, Table I).
    ///
    /// Lengths are in inches. The nominal gain follows from the electrical angle of 340° over
    /// 4096 counts, and the nominal offsets from the rest pose at count 2048, eq. (14).
    #[must_use]
    pub fn rsi() -> Self {
        let gain = -340.0_f64.to_radians() / 4096.0;
        let theta_0 = [PI, PI / 3.0, -PI / 3.0];
        let rest = [0.0, 0.0, -2.666, 0.0, 0.0, 0.0];
        let limits = [[-FRAC_PI_2, FRAC_PI_2], [-PI, 0.0], [-FRAC_PI_2, FRAC_PI_2]];
        let mut mechanism = Self {
            name: "rsi".into(),
            length_unit: "in".into(),
            gravity: Some([0.0, 0.0, -1.0]),
            channels: Vec::new(),
            chains: Vec::new(),
            points: Vec::new(),
            planes: Vec::new(),
            lines: Vec::new(),
            frames: Vec::new(),
            columns: Vec::new(),
            closures: Vec::new(),
            platform: BTreeMap::new(),
            rest: Some(Rest { pose: rest, sd: None }),
            workspace: Some(WORKSPACE.into()),
            model: ModelSection::default(),
            laws: Vec::new(),
        };
        let wrist = |i: usize| format!("wrist{}", i + 1);
        for (i, theta) in theta_0.into_iter().enumerate() {
            let joint = |j: usize| Some(format!("a{}{}", i + 1, j + 1));
            for (j, limits) in limits.into_iter().enumerate() {
                mechanism.channels.push(Channel {
                    name: format!("a{}{}", i + 1, j + 1),
                    unit: COUNT.into(),
                    range: Some([0.0, 4095.0]),
                    gain,
                    limits: Some(limits),
                    ..Channel::default()
                });
            }
            mechanism.chains.push(Chain {
                name: format!("arm{}", i + 1),
                rows: vec![
                    Row { theta, a: -4.5, alpha: FRAC_PI_2, ..Row::default() },
                    Row { channel: joint(0), a: 3.2, ..Row::default() },
                    Row { channel: joint(1), alpha: FRAC_PI_2, ..Row::default() },
                    Row { channel: joint(2), ..Row::default() },
                ],
            });
            mechanism.points.push(Point {
                name: wrist(i),
                chain: Some(format!("arm{}", i + 1)),
                at: Some([3.971, 0.0, 0.0]),
                ..Point::default()
            });
            // Wrists clockwise from above, wrist 1 at +x of the handle.
            let bearing = -2.0 * PI / 3.0 * i as f64;
            let on_handle = [1.5 * bearing.cos(), 1.5 * bearing.sin(), 0.0];
            mechanism.platform.insert(wrist(i), on_handle);
        }
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            mechanism.closures.push(Closure {
                name: format!("{}-{}", wrist(a), wrist(b)),
                kind: ClosureKind::Distance,
                between: [wrist(a), wrist(b)],
                value: Some(Value::Known(1.5 * 3.0_f64.sqrt())),
                ..Closure::default()
            });
        }
        // Eq. (14): offset = θ_rest - k · 2048.
        if let Ok(angles) = inverse(&rest) {
            for (channel, angle) in mechanism.channels.iter_mut().zip(angles.iter().flatten()) {
                channel.offset = angle - gain * 2048.0;
            }
        }
        mechanism
    }
}

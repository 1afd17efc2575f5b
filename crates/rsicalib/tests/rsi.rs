//! The closed forms of the hand controller, and the misprints of the paper.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix3, Rotation3, Vector3};
use rsicalib::Error;
use rsicalib::mechanism::Mechanism;
use rsicalib::mechanism::hand_controller::{self, L1, L2, L3, L4, LIMITS};

/// Seeded numbers: SplitMix64.
struct Rng(u64);

impl Rng {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Poses in a box about the workspace, most of them in reach for `wide = 1`.
fn poses(n: usize, wide: f64) -> impl Iterator<Item = [f64; 6]> {
    let mut rng = Rng(7);
    (0..n).map(move |_| {
        let mut within = |low: f64, high: f64| rng.uniform(low, high);
        let [x, y] = [(); 2].map(|()| within(-3.0 * wide, 3.0 * wide));
        let z = within(-3.0 - 2.7 * wide, -3.0 + 2.7 * wide);
        let [rx, ry, rz] = [(); 3].map(|()| within(-0.52, 0.52));
        [x, y, z, rx, ry, rz]
    })
}

/// The same, with their joint angles, where they are in reach.
fn reachable(n: usize) -> Vec<([f64; 6], [[f64; 3]; 3])> {
    let all = poses(n, 1.0).filter_map(|pose| Some((pose, hand_controller::inverse(&pose).ok()?)));
    let all: Vec<_> = all.collect();
    assert!(all.len() > n / 4, "only {} of {n} poses are in reach", all.len());
    all
}

/// Wrist `i` of a handle pose in frame i0, by plain matrix products.
fn wrist_in_arm(pose: &[f64; 6], i: usize) -> Vector3<f64> {
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), pose[5])
        * Rotation3::from_axis_angle(&Vector3::y_axis(), pose[4])
        * Rotation3::from_axis_angle(&Vector3::x_axis(), pose[3]); // (1)
    let clockwise = -2.0 * PI / 3.0 * i as f64;
    let on_handle = Vector3::new(L4 * clockwise.cos(), L4 * clockwise.sin(), 0.0);
    let wrist = Vector3::new(pose[0], pose[1], pose[2]) + rotation * on_handle;
    let theta = [PI, PI / 3.0, -PI / 3.0][i];
    let foot = Vector3::new(L1 * theta.cos(), L1 * theta.sin(), 0.0);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), theta)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    turn.inverse() * (wrist - foot)
}

/// Where an arm's angles put its wrist in frame i0, eq. (2).
fn reached([t1, t2, t3]: [f64; 3]) -> Vector3<f64> {
    let shoulder = Rotation3::from_axis_angle(&Vector3::z_axis(), t1);
    let elbow = Rotation3::from_axis_angle(&Vector3::z_axis(), t2)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), t3);
    shoulder * (Vector3::new(L2, 0.0, 0.0) + elbow * Vector3::new(L3, 0.0, 0.0))
}

fn apart(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).fold(0.0, |m, (a, b)| (a - b).abs().max(m))
}

#[test]
fn poses_come_back_from_their_joint_angles() {
    for (pose, angles) in reachable(20_000) {
        // Rounding of 6 in, magnified by 1/sin θ2 near the stretched arm.
        let slack = angles.iter().fold(1.0_f64, |m, a| m.min(a[1].sin().abs()));
        let back = hand_controller::forward(&angles);
        assert!(apart(&pose, &back) < 1e-12 / slack.min(0.1) * 0.1, "{pose:?} became {back:?}");
        for (arm, angles) in angles.iter().enumerate() {
            let off = reached(*angles) - wrist_in_arm(&pose, arm);
            assert!(off.norm() < 1e-12 / slack.min(0.1) * 0.1, "{pose:?}, arm {arm}: {off}");
        }
    }
}

#[test]
fn joint_angles_come_back_from_their_pose_and_keep_the_limits() {
    for (_, angles) in reachable(20_000) {
        for (angle, [low, high]) in angles.iter().flat_map(|a| a.iter().zip(LIMITS)) {
            assert!((low - 1e-12..=high + 1e-12).contains(angle));
        }
        let slack = angles.iter().fold(1.0_f64, |m, a| m.min(a[1].sin().abs()));
        let Ok(back) = hand_controller::inverse(&hand_controller::forward(&angles)) else {
            assert!(slack < 1e-6, "{angles:?}");
            continue;
        };
        for (a, b) in angles.iter().flatten().zip(back.iter().flatten()) {
            // An arc cosine at cos θ2 errs by the rounding over sin θ2, twice.
            assert!((a - b).abs() < 1e-13 / slack.powi(2).min(0.1), "{angles:?} became {back:?}");
        }
    }
}

#[test]
fn wrists_of_a_pose_are_the_handles_sides_apart() {
    let d = L4 * 3.0_f64.sqrt();
    for (_, angles) in reachable(2_000) {
        let r = hand_controller::wrists(&angles);
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            let slack = angles.iter().fold(1.0_f64, |m, a| m.min(a[1].sin().abs()));
            assert!(((r[a] - r[b]).norm() - d).abs() < 1e-12 / slack.min(0.1) * 0.1);
        }
    }
}

/// Axes of the handle by (3) and (4), the second with a divisor of its own.
fn axes(r: &[Vector3<f64>; 3], middle: Vector3<f64>) -> Matrix3<f64> {
    let r_h = (r[0] + r[1] + r[2]) / 3.0;
    let x = (r[0] - r_h) / L4;
    let y = (r[2] - middle) / (L4 * 3.0_f64.sqrt() / 2.0);
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

#[test]
fn equation_4_takes_the_middle_of_the_side_not_half_of_it() {
    for (_, angles) in reachable(200) {
        let r = hand_controller::wrists(&angles);
        let ours = axes(&r, (r[2] + r[1]) / 2.0);
        assert!((ours.transpose() * ours - Matrix3::identity()).norm() < 1e-10);
        let printed = axes(&r, (r[2] - r[1]) / 2.0);
        let y = printed.column(1);
        assert!((y.norm() - 1.0).abs() > 0.1, "as printed, y is {} long", y.norm());
    }
}

#[test]
fn equation_5_inverts_equation_1_only_with_x_and_y_exchanged() {
    for (pose, angles) in reachable(2_000) {
        let r = hand_controller::wrists(&angles);
        let h = axes(&r, (r[2] + r[1]) / 2.0);
        let (x, y, z) = (h.column(0), h.column(1), h.column(2));
        let rz = x[1].atan2(x[0]);
        let about_y = (-x[2]).atan2(x[0] * rz.cos() + x[1] * rz.sin());
        let about_x = y[2].atan2(z[2]);
        let closes = |rx: f64, ry: f64| {
            let turn = Rotation3::from_euler_angles(rx, ry, rz); // Rz Ry Rx
            (turn.matrix() - h).norm()
        };
        assert!(closes(about_x, about_y) < 1e-10);
        // As printed, exchanged, with either sign: wrong by about the angles.
        for sign in [1.0, -1.0] {
            let wrong = closes(sign * about_y, about_x);
            let angle = (sign * pose[4] - pose[3]).abs();
            assert!(wrong > 0.5 * angle, "{wrong}, {angle}");
        }
    }
}

#[test]
fn equation_8_adds_the_arc_cosine() {
    let mut tested = 0;
    for (pose, angles) in reachable(2_000) {
        for (arm, [t1, t2, t3]) in angles.iter().enumerate() {
            let r = wrist_in_arm(&pose, arm);
            let (rho, reach) = (r.x.hypot(r.y), L3 * t3.cos());
            let between =
                ((rho * rho + L2 * L2 - reach * reach) / (2.0 * L2 * rho)).clamp(-1.0, 1.0).acos();
            let bearing = r.y.atan2(r.x);
            // A shaft that has turned once is where it was.
            assert!((bearing + between - t1).sin().abs() < 1e-9);
            let printed = reached([bearing - between, *t2, *t3]);
            // Wrong by twice that angle, seen from the shoulder.
            let expected = 2.0 * rho * between.sin();
            assert!(((printed - r).norm() - expected).abs() < 1e-9);
            tested += usize::from(expected > 0.5);
        }
    }
    assert!(tested > 1_000, "too few arms are bent");
}

#[test]
fn nominal_offsets_follow_from_the_rest_pose() {
    let gain = -340.0_f64.to_radians() / 4096.0;
    let mechanism = Mechanism::rsi();
    for (c, channel) in mechanism.channels.iter().enumerate() {
        assert_eq!(channel.gain, gain);
        // Printed to three decimals.
        let printed = [3.387, 0.996, 2.967][c % 3];
        assert!((channel.offset - printed).abs() < 5e-4, "{} {}", channel.name, channel.offset);
    }
    // θ13 is zero at rest: half the electrical angle is left, not 2.99.
    assert!((mechanism.channels[2].offset - 170.0_f64.to_radians()).abs() < 1e-12);
    // Pose 3 of Table II as printed, z = -3.966, gives others.
    let printed = hand_controller::inverse(&[0.0, 0.0, -3.966, 0.0, 0.0, 0.0]).expect("in reach");
    let offset = |j: usize| printed[0][j] - gain * 2048.0;
    assert!((offset(0) - 3.39).abs() > 0.1 && (offset(1) - 1.00).abs() > 0.1);
}

#[test]
fn out_of_reach_says_which_arm_by_how_much_and_why() {
    let mut seen = std::collections::BTreeMap::new();
    for pose in poses(20_000, 2.5) {
        let error = match hand_controller::inverse(&pose) {
            Ok(_) => continue,
            Err(error) => error,
        };
        let Error::OutOfReach { pose: row, arm, by, unit, why } = &error else {
            panic!("{error}");
        };
        assert_eq!(*row, None);
        let i = ["arm1", "arm2", "arm3"].iter().position(|a| a == arm).expect("an arm");
        let r = wrist_in_arm(&pose, i);
        let rho = r.x.hypot(r.y);
        let reach = (L3 * L3 - r.z * r.z).max(0.0).sqrt();
        let (expected, its_unit) = match why.as_str() {
            "sideways beyond the forearm" => (r.z.abs() - L3, "in"),
            "farther than the stretched arm" => (rho - L2 - reach, "in"),
            "nearer than the folded arm" => ((L2 - reach).abs() - rho, "in"),
            "limit of joint 1" => {
                let inner = (rho * rho + L2 * L2 - reach * reach) / (2.0 * L2 * rho);
                let t1 = r.y.atan2(r.x) + inner.acos();
                let t1 = t1.sin().atan2(t1.cos()); // the same shaft, within a turn
                if t1.abs() < FRAC_PI_2 {
                    println!("WRAP {pose:?} {error}");
                }
                (t1.abs() - FRAC_PI_2, "rad")
            }
            other => panic!("an unknown reason: {other}"),
        };
        assert!(*by > 0.0 && (by - expected).abs() < 1e-9, "{error}: {expected}");
        assert_eq!(unit, its_unit);
        *seen.entry(why.clone()).or_insert(0) += 1;
    }
    assert_eq!(seen.len(), 4, "not every reason was met: {seen:?}");

    let error = hand_controller::inverse(&[3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        .expect_err("wrist 1 in its shoulder");
    let text = "arm1 is out of reach by 0.7710 in (nearer than the folded arm)";
    assert_eq!(error.to_string(), text);
}

#[test]
fn the_joints_of_a_pose_do_not_depend_on_the_name_of_a_closure() {
    use rsicalib::mechanism::Value;
    use rsicalib::model::assembly;
    let drawn = Mechanism::rsi();
    let mut other = drawn.clone();
    other.closures[0].name = "side held".into();
    other.closures[0].value = Some(Value::Known(2.7)); // no closure of the drawing takes part
    for (pose, angles) in reachable(5) {
        let found = assembly::inverse(&other, &pose).expect("within reach");
        let apart = |(found, angle): (&f64, f64)| (found - angle).abs();
        let angles = angles.into_iter().flatten();
        assert!(found.iter().zip(angles).map(apart).fold(0.0, f64::max) < 1e-8);
    }
}

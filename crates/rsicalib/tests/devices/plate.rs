//! A rigid body that is elsewhere in each pose, on legs that measure their length.

use nalgebra::{Rotation3, Vector3};

use super::{
    Channel, Closure, ClosureKind, Device, Frame, How, Mechanism, Point, Rng, empty, point, table,
    wander,
};

/// Two more than a pose has coordinates.
const LEGS: usize = 8;

/// How high the plate is above its base, and how far it goes from there along each axis [in].
const HIGH: f64 = 2.5;
const REACH: f64 = 0.4;

/// How far it turns about each axis.
const TURN: f64 = 0.3;

/// Marks on a plate that an instrument sees.
const MARKS: usize = 3;

/// Where the instrument stands: `x y z rx ry rz`.
pub const INSTRUMENT: [f64; 6] = [4.0, -3.0, 1.0, 0.3, -0.2, 1.1];

/// A plate on legs between points of it and of the base that are drawn at random.
pub fn plate(how: How, seed: u64) -> Device {
    made(how, seed, 0)
}

/// The same with marks that an instrument sees.
pub fn watched_plate(how: How, seed: u64) -> Device {
    made(how, seed, MARKS)
}

fn made(how: How, seed: u64, marks: usize) -> Device {
    let mut rng = Rng::new(seed);
    let mut mechanism = empty("plate".into());
    mechanism.frames.push(Frame {
        name: "plate".into(),
        unknown: Some(vec!["pose".into()]),
        pose: Some([0.0, 0.0, HIGH, 0.0, 0.0, 0.0]),
    });
    for k in 0..LEGS {
        let [foot, joint, length] = ["foot", "joint", "length"].map(|name| format!("{name}{k}"));
        mechanism.channels.push(Channel {
            name: length.clone(),
            unit: "count".into(),
            range: Some([0.0, 4095.0]),
            gain: 1.5e-3,
            offset: 0.3,
            ..Channel::default()
        });
        let on_plate = point(&mut rng, &joint, None);
        mechanism.points.push(Point { frame: Some("plate".into()), ..on_plate });
        let mut stands = point(&mut rng, &foot, None);
        // The base is wider than the plate, and flatter.
        stands.at = stands.at.map(|[x, y, z]| [2.0 * x, 2.0 * y, 0.5 * z]);
        mechanism.points.push(stands);
        mechanism.closures.push(Closure {
            name: format!("leg{k}"),
            kind: ClosureKind::Distance,
            between: [foot, joint],
            channel: Some(length),
            ..Closure::default()
        });
    }
    if marks > 0 {
        let (name, pose) = ("instrument".into(), Some(INSTRUMENT));
        mechanism.frames.push(Frame { name, unknown: None, pose });
    }
    for k in 0..marks {
        let [mark, seen] = ["mark", "seen"].map(|name| format!("{name}{k}"));
        let on_plate = point(&mut rng, &mark, None);
        mechanism.points.push(Point { frame: Some("plate".into()), ..on_plate });
        mechanism.points.push(Point {
            name: seen.clone(),
            columns: Some(["x", "y", "z"].map(|axis| format!("{axis}{k}"))),
            frame: Some("instrument".into()),
            ..Point::default()
        });
        mechanism.closures.push(Closure {
            name: format!("look{k}"),
            kind: ClosureKind::Touch,
            between: [mark, seen],
            noise: Some(1e-3),
            ..Closure::default()
        });
    }
    let (mut wander, mut poses) = (wander(&mut rng, how, 6), Vec::new());
    let mut table = table(&mechanism, how, |row| {
        let w = wander(row);
        let [x, y, z] = [REACH * w[0], REACH * w[1], HIGH + REACH * w[2]];
        let pose = [x, y, z, TURN * w[3], TURN * w[4], TURN * w[5]];
        poses.push(pose);
        lengths(&mechanism, &pose, &[[0.0; 3]; LEGS])
    });
    table.columns = (0..marks).flat_map(|k| seen(&mechanism, &poses, k)).collect();
    Device { mechanism, table, points: Vec::new() }
}

/// Columns of what the instrument reads of a mark, in plain products.
fn seen(mechanism: &Mechanism, poses: &[[f64; 6]], k: usize) -> [Vec<f64>; 3] {
    let mark = format!("mark{k}");
    let at = mechanism.points.iter().find(|p| p.name == mark).and_then(|p| p.at).expect("drawn");
    let stands = Vector3::from_row_slice(&INSTRUMENT[..3]);
    let read = |pose: &[f64; 6]| {
        let there = turned(pose) * Vector3::from(at) + Vector3::from_row_slice(&pose[..3]);
        turned(&INSTRUMENT).inverse() * (there - stands)
    };
    [0, 1, 2].map(|axis| poses.iter().map(|pose| read(pose)[axis]).collect())
}

/// The rotation of `rx ry rz`, about the axes of the base one after another.
fn turned(pose: &[f64; 6]) -> Rotation3<f64> {
    let axes = [Vector3::z_axis(), Vector3::y_axis(), Vector3::x_axis()];
    let each = axes.iter().zip([pose[5], pose[4], pose[3]]);
    let each = each.map(|(axis, angle)| Rotation3::from_axis_angle(axis, angle));
    each.fold(Rotation3::identity(), |all, one| all * one)
}

/// Lengths of the legs where the joints of the plate are moved along its axes, in plain products.
pub fn lengths(mechanism: &Mechanism, pose: &[f64; 6], moved: &[[f64; 3]]) -> Vec<f64> {
    let at = |name: &String| {
        let point = mechanism.points.iter().find(|p| p.name == *name).and_then(|p| p.at);
        Vector3::from(point.expect("drawn"))
    };
    let turned = turned(pose);
    let legs = mechanism.closures.iter().zip(moved);
    let long = legs.map(|(leg, moved)| {
        let [foot, joint] = leg.between.each_ref().map(at);
        let joint = turned * (joint + Vector3::from(*moved)) + Vector3::from_row_slice(&pose[..3]);
        (joint - foot).norm()
    });
    long.collect()
}

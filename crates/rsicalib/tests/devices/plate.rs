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

/// A plate on legs between points of it and of the base that are drawn at random.
pub fn plate(how: How, seed: u64) -> Device {
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
    let mut wander = wander(&mut rng, how, 6);
    let table = table(&mechanism, how, |row| {
        let w = wander(row);
        let [x, y, z] = [REACH * w[0], REACH * w[1], HIGH + REACH * w[2]];
        lengths(&mechanism, &[x, y, z, TURN * w[3], TURN * w[4], TURN * w[5]], &[[0.0; 3]; LEGS])
    });
    Device { mechanism, table, points: Vec::new() }
}

/// Lengths of the legs where the joints of the plate are moved along its axes, in plain products.
pub fn lengths(mechanism: &Mechanism, pose: &[f64; 6], moved: &[[f64; 3]]) -> Vec<f64> {
    let at = |name: &String| {
        let point = mechanism.points.iter().find(|p| p.name == *name).and_then(|p| p.at);
        Vector3::from(point.expect("drawn"))
    };
    let turned = [Vector3::z_axis(), Vector3::y_axis(), Vector3::x_axis()];
    let turned = turned.iter().zip([pose[5], pose[4], pose[3]]);
    let turned = turned.map(|(axis, angle)| Rotation3::from_axis_angle(axis, angle));
    let turned = turned.fold(Rotation3::identity(), |all, one| all * one);
    let legs = mechanism.closures.iter().zip(moved);
    let long = legs.map(|(leg, moved)| {
        let [foot, joint] = leg.between.each_ref().map(at);
        let joint = turned * (joint + Vector3::from(*moved)) + Vector3::from_row_slice(&pose[..3]);
        (joint - foot).norm()
    });
    long.collect()
}

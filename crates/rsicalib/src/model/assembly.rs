//! Inverse kinematics: joint coordinates that hold the platform at a pose.

use crate::numerics::order::Ends;
use nalgebra::{Rotation3, Vector3};

use std::cell::RefCell;

use crate::Error;
use crate::closures::kind::Part;
use crate::mechanism::{Channel, Closure, Mechanism, Point, Value};
use crate::model::compiled::Model;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::numerics::random::Random;
use crate::numerics::{dense, lm};
use crate::readings::{Readings, Table};

/// Places from which the joint coordinates of a pose are looked for, beside the middle of their limits.
const OTHERS: usize = 4;

/// Angle (rad) to each side in which they are, of a joint without limits.
const BENT: f64 = 1.5;

/// Names and positions of the platform's points at a pose, in base coordinates. `pose` is
/// `x y z rx ry rz` (length units, rad), eq. (1).
#[must_use]
pub fn placed(mechanism: &Mechanism, pose: &[f64; 6]) -> Vec<(String, Vector3<f64>)> {
    let turn = Rotation3::from_euler_angles(pose[3], pose[4], pose[5]);
    let at = Vector3::new(pose[0], pose[1], pose[2]);
    let place = |q: &[f64; 3]| at + turn * Vector3::from(*q);
    mechanism.platform.iter().map(|(name, q)| (name.clone(), place(q))).collect()
}

/// The mechanism with a touch for each platform point, which holds that point at a pose. `noise`
/// is the standard deviation of these touches in length units. What is unknown, or measured by columns, and its closures
/// are left out.
#[must_use]
pub fn held_at(mechanism: &Mechanism, pose: &[f64; 6], noise: Option<f64>) -> Mechanism {
    let mut held = mechanism.clone();
    held.points.retain(|p| !p.is_unknown() && p.columns.is_none());
    let known = |(part, name): (Part, &String)| match part {
        Part::Point => held.points.iter().any(|point| point.name == *name),
        Part::Plane => {
            held.planes.iter().any(|plane| plane.name == *name && plane.unknown.is_none())
        }
        Part::Line => held.lines.iter().any(|line| line.name == *name && line.unknown.is_none()),
        Part::Channel => true,
    };
    held.closures.retain(|closure| {
        let mut ends = closure.kind.facts().between.into_iter().zip(&closure.between);
        ends.all(known) && !matches!(closure.value, Some(Value::Column(_)))
    });
    let (points, closures): (Vec<_>, Vec<_>) = touches(mechanism, pose, noise).unzip();
    held.points.extend(points);
    held.closures.extend(closures);
    held
}

/// The places of the platform's points at a pose, and the closures that hold the points there.
fn touches(
    mechanism: &Mechanism,
    pose: &[f64; 6],
    noise: Option<f64>,
) -> impl Iterator<Item = (Point, Closure)> {
    placed(mechanism, pose).into_iter().map(move |(name, at)| {
        let fixed = format!("{name} held");
        let at = Some([at.x, at.y, at.z]);
        let point = Point { name: fixed.clone(), at, ..Point::default() };
        (point, Closure { noise, ..Closure::touch(fixed.clone(), [name, fixed]) })
    })
}

/// Joint coordinates (rad, or length units) that hold the platform at a pose, one per channel.
///
/// The solver starts at the middle of the joint limits, and, where that leads nowhere, from a few other places within
/// them: a leg that is straight there cannot bend. `pose` is `x y z rx ry rz` (length units, rad), eq. (1).
///
/// # Errors
///
/// [`Error::Missing`] without a platform; [`Error::OutOfReach`] for a pose that no joint
/// coordinates reach.
pub fn inverse(mechanism: &Mechanism, pose: &[f64; 6]) -> Result<Vec<f64>, Error> {
    let size = mechanism.platform.values().flatten().map(|v| v.abs()).fold(0.0, f64::max);
    let within = |(c, channel): (usize, &Channel)| {
        let about = channel.angle(channel.middle());
        let half = if mechanism.slides(c) { size } else { BENT };
        channel.limits.unwrap_or([about - half, about + half])
    };
    let within: Vec<[f64; 2]> = mechanism.channels.iter().enumerate().map(within).collect();
    let middle = within.iter().map(|[low, high]| 0.5 * (low + high)).collect();
    let found = inverse_from(mechanism, pose, middle);
    let random = &mut Random::new(0);
    let others = (0..OTHERS).map(|_| {
        let start = within.iter().map(|[low, high]| random.uniform(*low, *high));
        inverse_from(mechanism, pose, start.collect())
    });
    let inside = |angles: &[f64]| {
        let within = |(channel, angle): (&Channel, &f64)| {
            channel.limits.is_none_or(|[low, high]| (low..=high).contains(angle))
        };
        mechanism.channels.iter().zip(angles).all(within)
    };
    match &found {
        Ok(angles) if inside(angles) => return found,
        Ok(_) | Err(Error::OutOfReach { .. }) => {}
        Err(_) => return found,
    }
    // Of several that hold it there, one within the limits: near those of this one, or from elsewhere.
    let nearest = |(angle, [low, high]): (&f64, &[f64; 2])| angle.clamp(*low, *high);
    let near = found.as_ref().ok().map(|angles| angles.iter().zip(&within).map(nearest).collect());
    let near = near.map(|start| inverse_from(mechanism, pose, start));
    let mut first = None;
    for other in near.into_iter().chain(others).flatten() {
        if inside(&other) {
            return Ok(other);
        }
        first.get_or_insert(other);
    }
    found.or_else(|error| first.ok_or(error))
}

/// The same from these joint coordinates: of several that hold the platform there, elbows up or down, those that the
/// solver comes to from here.
///
/// # Errors
///
/// As [`inverse`].
pub(crate) fn inverse_from(
    mechanism: &Mechanism,
    pose: &[f64; 6],
    start: Vec<f64>,
) -> Result<Vec<f64>, Error> {
    if mechanism.platform.is_empty() {
        let why = "the inverse kinematics needs the points that carry it";
        return Err(Error::missing(&mechanism.name, "platform", why));
    }
    let mut bare = held_at(mechanism, pose, None);
    bare.closures = touches(mechanism, pose, None).map(|(_, closure)| closure).collect();
    for channel in &mut bare.channels {
        channel.unit = "rad".into();
        (channel.gain, channel.offset, channel.range) = (1.0, 0.0, None);
    }
    let table = Table { values: start.clone(), ..Table::default() };
    let readings = Readings::new(&bare, table)?;
    let model = Model::uncentred(&bare, &readings, Vec::new())?;
    let (m, n) = (model.equations(), start.len());
    let room = RefCell::new(Workspace::default());
    let at = |q: &[f64], want: Want| {
        let mut ws = room.borrow_mut();
        let lanes: Vec<Lanes> = q.iter().map(|q| Lanes::splat(*q)).collect();
        model.evaluate(&readings, 0, &lanes, &[], want, &mut ws);
        ws
    };
    let problem = dense::Dense::new(
        m,
        n,
        |q: &[f64], r: &mut [f64]| {
            let ws = at(q, Want { x: false, a: false });
            for (r, f) in r.iter_mut().zip(&ws.f) {
                *r = f.0[0];
            }
        },
        |q: &[f64], j: &mut [f64]| {
            let ws = at(q, Want { x: false, a: true });
            for row in 0..m {
                for col in 0..n {
                    j[col * m + row] = ws.a[row * n + col].0[0];
                }
            }
        },
    );
    let outcome = lm::minimize(&problem, &start, &lm::SolverOptions::default());
    let missed = (2.0 * outcome.cost).sqrt();
    let size: f64 = mechanism.platform.values().flatten().map(|v| v.abs()).fold(1e-3, f64::max);
    if missed < 1e-8 * size {
        return Ok(outcome.x);
    }
    let ws = at(&outcome.x, Want { x: false, a: false });
    let worst = (0..m / 3)
        .greatest_by(|&i| (0..3).map(|k| ws.f[3 * i + k].0[0].powi(2)).sum())
        .unwrap_or(0);
    Err(Error::OutOfReach {
        pose: None,
        arm: bare.closures[worst].between[0].clone(),
        by: (0..3).map(|k| ws.f[3 * worst + k].0[0].powi(2)).sum::<f64>().sqrt(),
        unit: mechanism.length_unit.clone(),
        why: "no joint angles bring it nearer".into(),
    })
}

//! Ends of closures: where they are, and what moves them.

use nalgebra::Rotation3;

use crate::Error;
use crate::closures::kind::Part;
use crate::kinematics::elements::Source;
use crate::mechanism::{Closure, Mechanism};
use crate::model::numbering::Owned;
use crate::model::thing::Thing;
use crate::numerics::lanes::{Lanes, Vec3};

/// The frame of a measured point.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Measured {
    /// The base.
    Base,
    /// A frame that stands still: rotation, row by row, and origin.
    Known([f64; 9], [f64; 3]),
    /// An unknown frame, by its number among what is unknown.
    Unknown(usize),
}

/// One end of a closure.
#[derive(Debug, Clone, Copy)]
pub(crate) enum End {
    /// On a chain: index of the chain, and position in the frame at its end.
    Carried(usize, [f64; 3]),
    /// Fixed in the base.
    Fixed([f64; 3]),
    /// An unknown point: its number among what is unknown, and what is drawn; its free coordinates
    /// in their order are its parameters.
    Unknown(usize, [f64; 3], [bool; 3]),
    /// A point that is somewhere else in each pose: its number among those.
    Posed(usize),
    /// A point that another instrument measures: columns of its coordinates, and their frame.
    Seen([usize; 3], Measured),
    /// The coordinate of a channel, as the first of three.
    Coordinate(usize),
}

/// An end of a closure that a term moves along the axes of the base.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MovedEnd {
    /// The first end or the second.
    pub(crate) end: usize,
    /// The first of three parameters.
    pub(crate) first: usize,
    /// Number of its gate; none where it acts in all samples.
    pub(crate) gate: Option<usize>,
    /// The place whose end it moves; none where it moves all.
    pub(crate) only: Option<Only>,
}

/// One place of something unknown: a part of a closure's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Only {
    /// Number of the thing among what is unknown.
    pub(crate) thing: usize,
    /// Number of the place; beyond the last where these readings do not touch it.
    pub(crate) place: usize,
}

impl MovedEnd {
    /// Where its movement along an axis comes from.
    #[inline(always)]
    pub(crate) fn source(&self, axis: usize) -> Source {
        match self.gate {
            Some(gate) => Source::Gated(self.first + axis, gate),
            None => Source::Parameter(self.first + axis),
        }
    }
}

/// A point that is somewhere else in each pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posed {
    /// Where it is looked for, and what stays as drawn.
    pub(crate) at: [f64; 3],
    /// For each coordinate its number among those of a pose; none where it is as drawn.
    pub(crate) slots: [Option<usize>; 3],
}

/// The points of a mechanism that are somewhere else in each pose, and how many coordinates they have.
pub(crate) fn posed_points(mechanism: &Mechanism) -> (Vec<Posed>, usize) {
    let mut count = 0;
    let moving = mechanism.points.iter().filter(|p| p.moves());
    let points = moving.map(|p| {
        let mut next = || {
            count += 1;
            count - 1
        };
        let slots = p.frees().map(|free| free.then(&mut next));
        Posed { at: p.at.unwrap_or_default(), slots }
    });
    let points = points.collect();
    (points, count)
}

/// The ends of a closure.
pub(crate) fn ends(
    mechanism: &Mechanism,
    closure: &Closure,
    owned: &[Owned],
) -> Result<[End; 2], Error> {
    let [one, other] = closure.kind.facts().between();
    let end = |part: Part, name: &str| match part {
        Part::Point => point(mechanism, name, owned),
        Part::Plane => Ok(End::Fixed([0.0; 3])),
        Part::Line => Ok(End::Fixed(mechanism.lines[mechanism.line_index(name)?].counts_from())),
        Part::Channel => Ok(End::Coordinate(mechanism.channel_index(name)?)),
    };
    Ok([end(one, &closure.between[0])?, end(other, &closure.between[1])?])
}

fn point(mechanism: &Mechanism, name: &str, owned: &[Owned]) -> Result<End, Error> {
    let index = mechanism.point_index(name)?;
    let point = &mechanism.points[index];
    let at = point.at.unwrap_or_default();
    let number = |thing: Thing| owned.iter().position(|o| o.thing == thing);
    if point.moves() {
        return Ok(End::Posed(mechanism.points[..index].iter().filter(|p| p.moves()).count()));
    }
    if let Some(number) = number(Thing::Point(index)) {
        return Ok(End::Unknown(number, at, point.frees()));
    }
    if let Some(columns) = &point.columns {
        let all = mechanism.value_columns();
        let place = |name: &String| all.iter().position(|c| c == name).unwrap_or_default();
        let frame = match &point.frame {
            None => Measured::Base,
            Some(frame) => {
                let index = mechanism.frame_index(frame)?;
                match (number(Thing::Frame(index)), mechanism.frames[index].pose) {
                    (Some(number), _) => Measured::Unknown(number),
                    (None, pose) => {
                        let pose = pose.unwrap_or_default();
                        Measured::Known(turned(&pose[3..]), [pose[0], pose[1], pose[2]])
                    }
                }
            }
        };
        return Ok(End::Seen(columns.each_ref().map(place), frame));
    }
    Ok(match &point.chain {
        Some(chain) => End::Carried(mechanism.chain_index(chain)?, at),
        None => End::Fixed(at),
    })
}

/// The rotation of roll, pitch and yaw, row by row, eq. (1).
pub(crate) fn turned(rpy: &[f64]) -> [f64; 9] {
    let turn = Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
    std::array::from_fn(|k| turn[(k / 3, k % 3)])
}

/// A place in base coordinates, in the frame that has this origin and rotation.
pub(crate) fn seen_from(rotation: &[f64; 9], origin: &[f64], at: [f64; 3]) -> [f64; 3] {
    let column = |k: usize| (0..3).map(|i| rotation[3 * i + k] * (at[i] - origin[i])).sum();
    std::array::from_fn(column)
}

/// The axes about which roll, pitch and yaw turn a frame, eq. (1).
pub(crate) fn turn_axes(rpy: &[f64]) -> [[f64; 3]; 3] {
    let (sin_y, cos_y) = rpy[1].sin_cos();
    let (sin_z, cos_z) = rpy[2].sin_cos();
    [[cos_z * cos_y, sin_z * cos_y, -sin_y], [-sin_z, cos_z, 0.0], [0.0, 0.0, 1.0]]
}

/// A vector turned by a rotation.
#[inline(always)]
pub(crate) fn rotate(rotation: &[f64; 9], vector: &Vec3) -> Vec3 {
    let mut out = [Lanes::ZERO; 3];
    for (i, out) in out.iter_mut().enumerate() {
        let [a, b, c] = [rotation[3 * i], rotation[3 * i + 1], rotation[3 * i + 2]];
        *out = vector[0] * a + vector[1] * b + vector[2] * c;
    }
    out
}

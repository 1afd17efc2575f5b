//! Ends of closures: where they are, and what moves them.

use nalgebra::Rotation3;

use crate::Error;
use crate::closures::kind::Part;
use crate::kinematics::elements::Source;
use crate::mechanism::{Closure, Mechanism};
use crate::model::numbering::Owned;
use crate::model::thing::Thing;
use crate::numerics::lanes::{Lanes, Vec3, cross, minus};
use crate::terms::term::OfInstrument;

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

/// A move along three axes, or along and about them: of a term at the end of a closure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Move {
    /// The first of three parameters, or of six.
    pub(crate) first: usize,
    /// Number of its gate; none where it acts in all samples.
    pub(crate) gate: Option<usize>,
}

impl Move {
    /// Where the move along an axis, or from the fourth on about one, comes from.
    #[inline(always)]
    pub(crate) fn source(&self, k: usize) -> Source {
        match self.gate {
            Some(gate) => Source::Gated(self.first + k, gate),
            None => Source::Parameter(self.first + k),
        }
    }

    /// How much of it acts in each sample.
    #[inline(always)]
    pub(crate) fn acts(&self, gates: &[Lanes]) -> Lanes {
        self.gate.map_or(Lanes::ONE, |gate| gates[gate])
    }

    /// A point that is moved along these axes.
    #[inline(always)]
    pub(crate) fn along(&self, point: &mut Vec3, axes: &[Vec3; 3], beta: &[f64], gates: &[Lanes]) {
        let acts = self.acts(gates);
        for (k, axis) in axes.iter().enumerate() {
            let by = acts * beta[self.first + k];
            for (at, axis) in point.iter_mut().zip(axis) {
                *at += *axis * by;
            }
        }
    }
}

/// What a term does to an instrument.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Knock {
    pub(crate) by: Move,
    pub(crate) of: OfInstrument,
}

impl Knock {
    /// Its parameters.
    pub(crate) fn columns(&self) -> std::ops::Range<usize> {
        self.by.first..self.by.first + self.of.width()
    }

    /// What an instrument reads that is turned about its own axes.
    #[inline(always)]
    pub(crate) fn turned(&self, read: &Vec3, beta: &[f64]) -> Vec3 {
        rotate(&turned(&beta[self.by.first + 3..self.by.first + 6]), read)
    }

    /// By how much a point that the instrument reads is elsewhere, along its own axes.
    #[inline(always)]
    pub(crate) fn moves(&self, read: &Vec3, beta: &[f64], gates: &[Lanes]) -> Vec3 {
        let (acts, first) = (self.by.acts(gates), self.by.first);
        match self.of {
            OfInstrument::Scale => read.map(|read| acts * read * beta[first]),
            OfInstrument::Motion => {
                let there = self.turned(read, beta);
                std::array::from_fn(|axis| {
                    acts * (there[axis] - read[axis] + Lanes::splat(beta[first + axis]))
                })
            }
        }
    }
}

/// A point that a term moves along the axes of the chain or the body that carries it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Attached {
    /// Its number in the mechanism.
    pub(crate) point: usize,
    /// By what it is moved.
    pub(crate) by: Move,
}

/// Which of these, sorted by their points, move a point: the first, and one beyond the last.
pub(crate) fn moves_of(attached: &[Attached], point: usize) -> [usize; 2] {
    [point, point + 1].map(|limit| attached.partition_point(|own| own.point < limit))
}

/// One end of a closure.
#[derive(Debug, Clone, Copy)]
pub(crate) enum End {
    /// On a chain: index of the chain, position in the frame at its end, and which of the attached points are
    /// this one: the first, and one beyond the last.
    Carried(usize, [f64; 3], [usize; 2]),
    /// Fixed in the base.
    Fixed([f64; 3]),
    /// An unknown point: its number among what is unknown, and what is drawn; its free coordinates
    /// in their order are its parameters.
    Unknown(usize, [f64; 3], [bool; 3]),
    /// A point that is somewhere else in each pose: its number among those.
    Posed(usize),
    /// A point that another instrument measures: columns of its coordinates, their frame, and which of the
    /// knocks of instruments are of this one: the first, and one beyond the last.
    Seen([usize; 3], Measured, [usize; 2]),
    /// The coordinate of a channel, as the first of three.
    Coordinate(usize),
}

/// An end of a closure that a term moves along the axes of the base.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MovedEnd {
    /// The first end or the second.
    pub(crate) end: usize,
    /// By what it is moved.
    pub(crate) by: Move,
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

/// A point that is somewhere else in each pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posed {
    /// Where it is looked for, and what stays as drawn; of a point of a body where that has it.
    pub(crate) at: [f64; 3],
    /// For each coordinate its number among those of a pose; none where it is as drawn.
    pub(crate) slots: [Option<usize>; 3],
    /// The body that carries it.
    pub(crate) body: Option<usize>,
    /// Which of the attached points are this one: the first, and one beyond the last.
    pub(crate) moved_by: [usize; 2],
}

/// A rigid body that is somewhere else in each pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Body {
    /// Where it is looked for, and what stays as drawn: `x y z rx ry rz`.
    pub(crate) pose: [f64; 6],
    /// For each of them its number among those of a pose; none where it is as drawn.
    pub(crate) slots: [Option<usize>; 6],
}

/// What is somewhere else in each pose.
#[derive(Debug, Clone, Default)]
pub(crate) struct Moving {
    /// Points.
    pub(crate) points: Vec<Posed>,
    /// Rigid bodies.
    pub(crate) bodies: Vec<Body>,
    /// Number of their coordinates.
    pub(crate) unknowns: usize,
}

impl Moving {
    /// What a mechanism has of it.
    pub(crate) fn of(mechanism: &Mechanism) -> Self {
        let mut unknowns = 0;
        let mut next = || {
            unknowns += 1;
            unknowns - 1
        };
        let frames: Vec<usize> =
            (0..mechanism.frames.len()).filter(|f| mechanism.frames[*f].moves()).collect();
        let points = mechanism.points.iter().filter(|p| mechanism.is_moving(p));
        let points = points.map(|p| Posed {
            at: p.at.unwrap_or_default(),
            slots: p.frees().map(|free| free.then(&mut next)),
            body: mechanism.body_of(p).and_then(|own| frames.iter().position(|f| *f == own)),
            moved_by: [0, 0],
        });
        let points = points.collect();
        let bodies = frames.iter().map(|f| Body {
            pose: mechanism.frames[*f].pose.unwrap_or_default(),
            slots: std::array::from_fn(|_| Some(next())),
        });
        let bodies = bodies.collect();
        Self { points, bodies, unknowns }
    }

    /// The slots of all coordinates, with what is drawn of each.
    pub(crate) fn slots(&self) -> impl Iterator<Item = (&Option<usize>, f64)> {
        let points = self.points.iter().flat_map(|p| p.slots.iter().zip(p.at));
        points.chain(self.bodies.iter().flat_map(|b| b.slots.iter().zip(b.pose)))
    }

    /// Numbers of the coordinates that are angles.
    pub(crate) fn turns(&self) -> Vec<usize> {
        self.bodies.iter().flat_map(|b| b.slots[3..].iter().flatten().copied()).collect()
    }

    /// The slots of all coordinates.
    pub(crate) fn slots_mut(&mut self) -> impl Iterator<Item = &mut Option<usize>> {
        let points = self.points.iter_mut().flat_map(|p| &mut p.slots);
        points.chain(self.bodies.iter_mut().flat_map(|b| &mut b.slots))
    }

    /// Where a point is as drawn, with what its coordinates in a pose are.
    #[inline(always)]
    pub(crate) fn place(&self, number: usize, xi: &[Lanes]) -> Vec3 {
        let Posed { at, slots, body, .. } = &self.points[number];
        let Some(body) = body else {
            return std::array::from_fn(|i| slots[i].map_or(Lanes::splat(at[i]), |k| xi[k]));
        };
        let (origin, rotation, _) = self.pose(*body, xi);
        std::array::from_fn(|i| {
            let turned = (0..3).map(|j| rotation[i][j] * at[j]);
            turned.fold(origin[i], |sum, part| sum + part)
        })
    }

    /// The axes of the body that carries a point; those of the base where none does.
    #[inline(always)]
    pub(crate) fn axes(&self, number: usize, xi: &[Lanes]) -> [Vec3; 3] {
        let Some(body) = self.points[number].body else { return [unit(0), unit(1), unit(2)] };
        let (_, [x, y, z], _) = self.pose(body, xi);
        [0, 1, 2].map(|k| [x[k], y[k], z[k]])
    }

    /// How a point moves with each of its coordinates in a pose.
    #[inline(always)]
    pub(crate) fn moves(
        &self,
        number: usize,
        point: &Vec3,
        xi: &[Lanes],
    ) -> impl Iterator<Item = (usize, Vec3)> + use<> {
        let Posed { slots, body, .. } = &self.points[number];
        let mut each = [None; 6];
        let (along, turns) = each.split_at_mut(3);
        let translations = body.map_or(*slots, |b| [0, 1, 2].map(|k| self.bodies[b].slots[k]));
        for (axis, (entry, slot)) in along.iter_mut().zip(translations).enumerate() {
            *entry = slot.map(|slot| (slot, unit(axis)));
        }
        if let Some(body) = body {
            let (origin, _, axes) = self.pose(*body, xi);
            let arm = minus(point, &origin);
            for (entry, (slot, axis)) in
                turns.iter_mut().zip(self.bodies[*body].slots[3..].iter().zip(axes))
            {
                *entry = slot.map(|slot| (slot, cross(&axis, &arm)));
            }
        }
        each.into_iter().flatten()
    }

    /// Origin of a body, its rotation row by row, and the axes about which `rx ry rz` turn it, eq. (1).
    #[inline(always)]
    fn pose(&self, body: usize, xi: &[Lanes]) -> (Vec3, [Vec3; 3], [Vec3; 3]) {
        let Body { pose, slots } = &self.bodies[body];
        let of = |k: usize| slots[k].map_or(Lanes::splat(pose[k]), |slot| xi[slot]);
        let [(sx, cx), (sy, cy), (sz, cz)] = [3, 4, 5].map(|k| of(k).sin_cos());
        let (zero, one) = (Lanes::ZERO, Lanes::ONE);
        let rotation = [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ];
        let axes = [[cz * cy, sz * cy, -sy], [-sz, cz, zero], [zero, zero, one]];
        ([of(0), of(1), of(2)], rotation, axes)
    }
}

/// The unit vector of an axis of the base.
#[inline(always)]
pub(crate) fn unit(axis: usize) -> Vec3 {
    let mut unit = [Lanes::ZERO; 3];
    unit[axis] = Lanes::ONE;
    unit
}

/// The ends of a closure.
///
/// `attached` are points that terms move on what carries them, sorted.
pub(crate) fn ends(
    mechanism: &Mechanism,
    closure: &Closure,
    owned: &[Owned],
    attached: &[Attached],
) -> Result<[End; 2], Error> {
    let [one, other] = closure.kind.facts().between;
    let end = |part: Part, name: &str| match part {
        Part::Point => point(mechanism, name, owned, attached),
        Part::Plane => Ok(End::Fixed([0.0; 3])),
        Part::Line => Ok(End::Fixed(mechanism.lines[mechanism.line_index(name)?].counts_from())),
        Part::Channel => Ok(End::Coordinate(mechanism.channel_index(name)?)),
    };
    Ok([end(one, &closure.between[0])?, end(other, &closure.between[1])?])
}

fn point(
    mechanism: &Mechanism,
    name: &str,
    owned: &[Owned],
    attached: &[Attached],
) -> Result<End, Error> {
    let index = mechanism.point_index(name)?;
    let point = &mechanism.points[index];
    let at = point.at.unwrap_or_default();
    let number = |thing: Thing| owned.iter().position(|o| o.thing == thing);
    if mechanism.is_moving(point) {
        return Ok(End::Posed(number_of_moving(mechanism, index)));
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
        return Ok(End::Seen(columns.each_ref().map(place), frame, [0, 0]));
    }
    Ok(match (&point.chain, &point.frame) {
        (Some(chain), _) => {
            End::Carried(mechanism.chain_index(chain)?, at, moves_of(attached, index))
        }
        (None, None) => End::Fixed(at),
        (None, Some(frame)) => {
            let pose = mechanism.frames[mechanism.frame_index(frame)?].pose.unwrap_or_default();
            let (turned, at) = (turned(&pose[3..]), at.map(Lanes::splat));
            let turned = rotate(&turned, &at).map(|lanes| lanes.0[0]);
            End::Fixed(std::array::from_fn(|i| pose[i] + turned[i]))
        }
    })
}

/// The number of a point among those that are somewhere else in each pose.
pub(crate) fn number_of_moving(mechanism: &Mechanism, index: usize) -> usize {
    mechanism.points[..index].iter().filter(|point| mechanism.is_moving(point)).count()
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

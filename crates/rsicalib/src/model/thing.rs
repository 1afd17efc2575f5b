//! What may be unknown and no term, and all that is asked of it: points, planes, lines and frames.

use nalgebra::Vector3;

use crate::closures::kind::Part;
use crate::mechanism::{Closure, Mechanism, around};
use crate::model::lean::{Lean, Spread};

/// What results call unknown things, in the place of a term.
pub const UNKNOWN_THINGS: [&str; 4] =
    ["unknown_point", "unknown_plane", "unknown_line", "unknown_frame"];

/// True for what results call an unknown thing, which is no term.
#[must_use]
pub fn is_unknown_thing(id: &str) -> bool {
    UNKNOWN_THINGS.contains(&id)
}

/// A part of a mechanism whose place is not known: its index among those of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Thing {
    /// A point.
    Point(usize),
    /// A plane.
    Plane(usize),
    /// A line.
    Line(usize),
    /// A frame in which points are measured.
    Frame(usize),
}

impl Thing {
    /// What results call it, in the place of a term.
    #[must_use]
    pub fn term(self) -> &'static str {
        let [point, plane, line, frame] = UNKNOWN_THINGS;
        match self {
            Self::Point(_) => point,
            Self::Plane(_) => plane,
            Self::Line(_) => line,
            Self::Frame(_) => frame,
        }
    }

    /// Its unknown coordinates, and whether each is a length; tilts and turns are angles.
    #[must_use]
    pub fn coordinates(self, mechanism: &Mechanism) -> Vec<(&'static str, bool)> {
        match self {
            Self::Point(p) => {
                let axes = ["x", "y", "z"].into_iter().zip(mechanism.points[p].frees());
                axes.filter(|(_, free)| *free).map(|(axis, _)| (axis, true)).collect()
            }
            Self::Plane(_) => vec![("tilt1", false), ("tilt2", false), ("offset", true)],
            Self::Line(_) => {
                vec![("tilt1", false), ("tilt2", false), ("offset1", true), ("offset2", true)]
            }
            Self::Frame(_) => {
                let place = ["x", "y", "z"].map(|axis| (axis, true));
                let turn = ["rx", "ry", "rz"].map(|axis| (axis, false));
                place.into_iter().chain(turn).collect()
            }
        }
    }

    /// Its unknown coordinates where it is drawn; zeros where it is not.
    pub(crate) fn drawn(self, mechanism: &Mechanism) -> Vec<f64> {
        match self {
            Self::Point(p) => {
                let point = &mechanism.points[p];
                let at = point.at.unwrap_or_default().into_iter().zip(point.frees());
                at.filter(|(_, free)| *free).map(|(at, _)| at).collect()
            }
            Self::Plane(p) => {
                let known = mechanism.planes[p].known();
                vec![0.0, 0.0, known.map_or(0.0, |(_, offset)| offset)]
            }
            Self::Line(l) => {
                let at = Vector3::from(mechanism.lines[l].at.unwrap_or_default());
                let [_, u, v] = self.leans_from(mechanism).map(Vector3::from);
                vec![0.0, 0.0, u.dot(&at), v.dot(&at)]
            }
            Self::Frame(f) => mechanism.frames[f].pose.unwrap_or_default().to_vec(),
        }
    }

    /// The normal of a plane or the direction of a line, as drawn.
    fn faces(self, mechanism: &Mechanism) -> Option<[f64; 3]> {
        match self {
            Self::Plane(p) => mechanism.planes[p].normal,
            Self::Line(l) => mechanism.lines[l].direction,
            Self::Point(_) | Self::Frame(_) => None,
        }
    }

    /// The axes from which the normal of a plane or the direction of a line leans, as drawn.
    pub(crate) fn leans_from(self, mechanism: &Mechanism) -> [[f64; 3]; 3] {
        around(self.faces(mechanism).unwrap_or([0.0, 0.0, 1.0]))
    }

    /// True for a plane or a line of which nobody has drawn where it faces.
    pub(crate) fn faces_anywhere(self, mechanism: &Mechanism) -> bool {
        matches!(self, Self::Plane(_) | Self::Line(_)) && self.faces(mechanism).is_none()
    }

    /// How a plane or a line of these tilts holds points; nothing else does.
    #[inline(always)]
    pub(crate) fn leans(self, axes: &[[f64; 3]; 3], tilts: [f64; 2]) -> Lean {
        match self {
            Self::Plane(_) => Lean::of_plane(axes, tilts),
            Self::Line(_) => Lean::of_line(axes, tilts),
            Self::Point(_) | Self::Frame(_) => Lean::default(),
        }
    }

    /// The normal or the direction of the plane or the line nearest to points, and their middle; none
    /// for too few of them.
    pub(crate) fn nearest(self, points: &[Vector3<f64>]) -> Option<[Vector3<f64>; 2]> {
        match self {
            Self::Plane(_) => Spread::of(points, 3).map(Spread::least),
            Self::Line(_) => Spread::of(points, 2).map(Spread::most),
            Self::Point(_) | Self::Frame(_) => None,
        }
    }

    /// Coordinates of a plane or a line of these tilts through a place.
    pub(crate) fn through(
        self,
        axes: &[[f64; 3]; 3],
        tilts: [f64; 2],
        at: &Vector3<f64>,
    ) -> Vec<f64> {
        let lean = self.leans(axes, tilts);
        let offsets = lean.along.iter().map(|axis| Vector3::from(*axis).dot(at));
        tilts.into_iter().chain(offsets.take(lean.rows)).collect()
    }

    /// Its name, and the columns that tell its places apart.
    pub(super) fn identity(self, mechanism: &Mechanism) -> (&str, &[String]) {
        match self {
            Self::Point(p) => (&mechanism.points[p].name, mechanism.points[p].keys()),
            Self::Plane(p) => (&mechanism.planes[p].name, mechanism.planes[p].keys()),
            Self::Line(l) => (&mechanism.lines[l].name, mechanism.lines[l].keys()),
            Self::Frame(f) => (&mechanism.frames[f].name, mechanism.frames[f].keys()),
        }
    }

    /// All of a mechanism, points first.
    pub(super) fn all(mechanism: &Mechanism) -> impl Iterator<Item = Self> {
        let points = mechanism.points.iter().enumerate().filter(|(_, p)| p.is_unknown());
        let points = points.filter(|(_, p)| !p.moves()).map(|(k, _)| Self::Point(k));
        let planes = mechanism.planes.iter().enumerate().filter(|(_, p)| p.unknown.is_some());
        let lines = mechanism.lines.iter().enumerate().filter(|(_, l)| l.unknown.is_some());
        let frames =
            mechanism.frames.iter().enumerate().filter(|(_, f)| f.unknown.is_some() && !f.moves());
        let on = planes.map(|(k, _)| Self::Plane(k)).chain(lines.map(|(k, _)| Self::Line(k)));
        points.chain(on).chain(frames.map(|(k, _)| Self::Frame(k)))
    }

    /// What a closure names as its second, where it is a plane or a line.
    pub(super) fn touched(mechanism: &Mechanism, closure: &Closure) -> Option<Self> {
        let (part, name) = (closure.kind.facts().between[1], &closure.between[1]);
        let index = mechanism.index_of(part, name).ok()?;
        match part {
            Part::Plane => Some(Self::Plane(index)),
            Part::Line => Some(Self::Line(index)),
            Part::Point | Part::Channel => None,
        }
    }
}

//! Elements of a compiled chain, from the base to the tip.

use nalgebra::Isometry3;

/// One axis of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// First axis.
    X,
    /// Second axis.
    Y,
    /// Third axis, the axis of joints.
    Z,
}

/// Rotation or translation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// About the axis, rad.
    Turn,
    /// Along the axis, length units.
    Slide,
}

/// Source of a motion's coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The joint coordinate of a channel.
    Channel(usize),
    /// A parameter of the model.
    Parameter(usize),
    /// A parameter of the model that does not act alike in all samples: the parameter, and the number
    /// of the gate that multiplies it in each.
    Gated(usize, usize),
    /// The amount of a law, by its number among the coordinates: after those of the channels.
    Law(usize),
}

impl Source {
    /// True for a parameter of the model, false for a coordinate of a joint or a law.
    #[inline(always)]
    pub(crate) fn is_parameter(self) -> bool {
        matches!(self, Self::Parameter(_) | Self::Gated(..))
    }
}

/// One element of a chain.
#[derive(Debug, Clone)]
pub enum Element {
    /// A rigid transformation: rotation matrix, row by row, and translation in length units.
    Rigid([f64; 9], [f64; 3]),
    /// A motion about or along one axis of the current frame.
    Move(Axis, Way, Source),
    /// A motion about or along z by a ratio of the coordinate of a channel.
    Geared(Way, usize, f64),
    /// A weight: its kind, its centre in the current frame, and its size.
    Mass(Weight, [f64; 3], f64),
}

impl Element {
    /// The joint of a row, about or along z: it moves by the coordinate of its channel, or by a
    /// ratio of it.
    #[must_use]
    pub fn joint(way: Way, channel: usize, ratio: Option<f64>) -> Self {
        match ratio {
            None => Self::Move(Axis::Z, way, Source::Channel(channel)),
            Some(ratio) => Self::Geared(way, channel, ratio),
        }
    }
}

/// Appends a rigid transformation, merged with a rigid transformation before it.
pub fn push_rigid(steps: &mut Vec<Element>, place: &Isometry3<f64>) {
    let mut place = *place;
    if let Some(Element::Rigid(r, t)) = steps.last() {
        place = isometry(r, t) * place;
        steps.pop();
    }
    if place == Isometry3::identity() {
        return;
    }
    let m = place.rotation.to_rotation_matrix();
    // Quarter turns are exact: 6e-17 is the rounding of π/2.
    let snap = |v: f64| if v.abs() < 1e-15 { 0.0 } else { v };
    let rotation = std::array::from_fn(|k| snap(m[(k / 3, k % 3)]));
    let t = place.translation;
    steps.push(Element::Rigid(rotation, [snap(t.x), snap(t.y), snap(t.z)]));
}

fn isometry(r: &[f64; 9], t: &[f64; 3]) -> Isometry3<f64> {
    let m = nalgebra::Matrix3::from_row_slice(r);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(m);
    Isometry3::from_parts((*t).into(), nalgebra::UnitQuaternion::from_rotation_matrix(&rotation))
}

/// The weight that bends a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// A unit weight at the points that the chain carries.
    Tip,
    /// The link masses of the mechanism.
    Links,
}

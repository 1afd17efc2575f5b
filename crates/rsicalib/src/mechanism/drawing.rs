//! A mechanism as data: channels, chains, points, closures, platform, rest.
//!
//! A mechanism is the same value in Rust, in Python and in TOML. The RSI hand controller is
//! [`Mechanism::rsi`]; no other part of this crate is written for that one mechanism.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::closures::ClosureKind;
#[cfg(feature = "serde")]
use crate::mechanism::exactly;
use crate::mechanism::law::Law;
use crate::mechanism::places::{Column, Frame, Line, Plane, is_of_each_pose};

/// Serial chains with sensed joints, and the closures between the chains.
///
/// Lengths are in `length_unit`, angles in radians, points in the frame that each field names.
/// [`Mechanism::validate`] checks names and numbers.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Mechanism {
    /// Name of the mechanism.
    pub name: String,
    /// Unit of every length: `in`, `mm`, `m`.
    pub length_unit: String,
    /// Direction in which weights pull, in base coordinates; any length but zero.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub gravity: Option<[f64; 3]>,
    /// Sensors, in the order of the columns of readings.
    #[cfg_attr(feature = "serde", serde(rename = "channel"))]
    pub channels: Vec<Channel>,
    /// Serial chains of joints; a sled on belts has none.
    #[cfg_attr(feature = "serde", serde(rename = "chain", default))]
    pub chains: Vec<Chain>,
    /// Points on the chains, points fixed in the base, and unknown points.
    #[cfg_attr(feature = "serde", serde(rename = "point", default))]
    pub points: Vec<Point>,
    /// Planes that points touch.
    #[cfg_attr(feature = "serde", serde(rename = "plane", default))]
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub planes: Vec<Plane>,
    /// Lines that points touch.
    #[cfg_attr(feature = "serde", serde(rename = "line", default))]
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub lines: Vec<Line>,
    /// Frames in which other instruments measure points.
    #[cfg_attr(feature = "serde", serde(rename = "frame", default))]
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub frames: Vec<Frame>,
    /// Columns of the readings that laws use.
    #[cfg_attr(feature = "serde", serde(rename = "column", default))]
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub columns: Vec<Column>,
    /// Equations that hold in every pose.
    #[cfg_attr(feature = "serde", serde(rename = "closure"))]
    pub closures: Vec<Closure>,
    /// The points that carry the platform: names of `points`, and positions in the platform's frame.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "BTreeMap::is_empty"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::named"))]
    pub platform: BTreeMap<String, [f64; 3]>,
    /// A platform pose that is known without a measurement.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub rest: Option<Rest>,
    /// Poses that the platform can be brought to.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub workspace: Option<Workspace>,
    /// The terms that are identified by default.
    #[cfg_attr(feature = "serde", serde(default))]
    pub model: ModelSection,
    /// Terms of its own, beside those of the catalogue.
    #[cfg_attr(feature = "serde", serde(rename = "term", default))]
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub laws: Vec<Law>,
}

/// A box of platform poses: lowest and highest of each coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Workspace {
    /// In length units.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub x: [f64; 2],
    /// In length units.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub y: [f64; 2],
    /// In length units.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub z: [f64; 2],
    /// In radians, eq. (1).
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub rx: [f64; 2],
    /// In radians.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub ry: [f64; 2],
    /// In radians.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub rz: [f64; 2],
}

impl Workspace {
    /// The box in the order of a pose.
    #[must_use]
    pub fn bounds(&self) -> [[f64; 2]; 6] {
        [self.x, self.y, self.z, self.rx, self.ry, self.rz]
    }
}

impl From<[[f64; 2]; 6]> for Workspace {
    fn from([x, y, z, rx, ry, rz]: [[f64; 2]; 6]) -> Self {
        Self { x, y, z, rx, ry, rz }
    }
}

/// A sensor: `angle = gain * reading + offset`, eq. (9).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Channel {
    /// Name of the column of the readings.
    pub name: String,
    /// Unit of a reading: `count`, `rad`, `deg`, `m`, ...
    ///
    /// In a mechanism file all of a channel in `deg` is in degrees: `range` and `noise`, as
    /// readings are, and `offset` and `limits` of the joint; `gain` is in degrees per degree. Of a
    /// joint that slides, `offset` and `limits` are lengths, and `gain` is a length per radian.
    ///
    /// The Rust value is in radians: [`Mechanism::from_written_units`].
    pub unit: String,
    /// What people call it, for reports.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
    /// Lowest and highest reading, if bounded.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub range: Option<[f64; 2]>,
    /// Joint coordinate per reading: rad per reading, or length per reading for a prismatic joint.
    pub gain: f64,
    /// Joint coordinate at reading zero: rad, or length for a prismatic joint.
    pub offset: f64,
    /// Joint limits, in the joint's coordinate.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub limits: Option<[f64; 2]>,
    /// Standard deviation of one reading, in its unit, where it is known.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub noise: Option<f64>,
    /// True for a joint that has no drive: its torque is zero, and the drives of the loop that it
    /// is in carry what it would.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "is_default"))]
    pub passive: bool,
    /// Column of the readings with the torque of its drive, positive where the drive pushes towards
    /// larger coordinates: the mass of a link times `length_unit`, without g.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub torque: Option<String>,
    /// What this drive carries, in proportion to others, where a loop has more drives than motions and
    /// these do not work against each other.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub share: Option<f64>,
}

/// The unit of a channel that reads whole codes of a converter.
pub(crate) const COUNT: &str = "count";

/// An encoder of no name that reads its joint: 1 rad per radian, zero at zero.
impl Default for Channel {
    fn default() -> Self {
        Self {
            name: String::new(),
            unit: "rad".into(),
            label: None,
            range: None,
            gain: 1.0,
            offset: 0.0,
            limits: None,
            noise: None,
            passive: false,
            torque: None,
            share: None,
        }
    }
}

impl Channel {
    /// True for the whole codes of a converter; another unit is a physical one.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.unit == COUNT
    }

    /// Standard deviation of one reading before anything tells it: as declared, else one count, or 1e-5 of the
    /// joint's coordinate.
    #[must_use]
    pub fn presumed_noise(&self) -> f64 {
        self.noise.unwrap_or_else(|| if self.counts() { 1.0 } else { 1e-5 / self.gain.abs() })
    }

    /// True for a voltage that a converter reads against its reference, in counts or in volts;
    /// an encoder has none.
    #[must_use]
    pub fn is_converted(&self) -> bool {
        self.counts() || matches!(self.unit.as_str(), "V" | "mV" | "volt")
    }

    /// Variance that rounding to whole counts adds to a reading: 1/12 count², zero in other units.
    #[must_use]
    pub fn quantisation(&self) -> f64 {
        if self.counts() { 1.0 / 12.0 } else { 0.0 }
    }

    /// Lowest and highest reading: of the range, or at the joint's limits where there is none.
    #[must_use]
    pub fn ends(&self) -> Option<[f64; 2]> {
        let at_limits = |[low, high]: [f64; 2]| {
            let [one, other] = [low, high].map(|angle| (angle - self.offset) / self.gain);
            [one.min(other), one.max(other)]
        };
        self.range.or_else(|| self.limits.map(at_limits))
    }

    /// The reading midway between the [ends](Self::ends); zero for an unbounded channel.
    #[must_use]
    pub fn middle(&self) -> f64 {
        self.ends().map_or(0.0, |[low, high]| 0.5 * (low + high))
    }

    /// Half the way between the [ends](Self::ends), in readings; half a turn for an unbounded
    /// channel.
    #[must_use]
    pub fn half_range(&self) -> f64 {
        self.ends().map_or(PI / self.gain.abs(), |[low, high]| 0.5 * (high - low))
    }

    /// The nominal joint coordinate at a reading, eq. (9): rad, or length for a prismatic joint.
    #[must_use]
    pub fn angle(&self, reading: f64) -> f64 {
        self.gain * reading + self.offset
    }
}

/// How a joint moves about or along its z axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Motion {
    /// Turns; its coordinate is an angle in radians.
    #[default]
    Revolute,
    /// Slides; its coordinate is a length.
    Prismatic,
}

/// One row of a chain: a joint, then the body that carries the next row.
///
/// ```text
/// Rz(theta) · joint(q) · Tz(d) Tx(a) Rx(alpha) · T(xyz) R(rpy)
/// ```
///
/// Denavit-Hartenberg rows use `theta`, `d`, `a` and `alpha`; URDF links use `xyz` and `rpy`.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Row {
    /// Name of the link, for reports.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub name: Option<String>,
    /// The channel that senses this joint; `None` for a fixed row.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub channel: Option<String>,
    /// How the joint moves.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub joint: Motion,
    /// How far the joint moves for one unit of the channel's coordinate, where it does not move as
    /// that does; a channel may drive several rows of a chain with such ratios.
    ///
    /// A parallelogram that keeps a link's direction while the link before it turns: a row of that
    /// link's channel with the ratio -1. A differential: the sum of two channels with the ratios
    /// 1/2 and 1/2, and their difference with 1/2 and -1/2.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub ratio: Option<f64>,
    /// Fixed angle about z, before the joint (rad).
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub theta: f64,
    /// Offset along z, in length units.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub d: f64,
    /// Length along x, in length units.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub a: f64,
    /// Twist about x (rad).
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub alpha: f64,
    /// A second translation, in length units, after `alpha`: the origin of a URDF link.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub xyz: [f64; 3],
    /// A second rotation, roll-pitch-yaw (rad).
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub rpy: [f64; 3],
    /// Mass of the body after the joint; any unit, the same for all rows.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub mass: Option<f64>,
    /// Centre of that mass, in the frame after the joint, in length units.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub com: [f64; 3],
}

#[cfg(feature = "serde")]
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Row {
    /// The body after the joint: the transformation `joint_from_next`.
    #[must_use]
    pub fn body(&self) -> Isometry3<f64> {
        let dh = Isometry3::from_parts(
            Translation3::new(self.a, 0.0, self.d),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha),
        );
        let [roll, pitch, yaw] = self.rpy;
        dh * Isometry3::from_parts(
            Translation3::from(Vector3::from(self.xyz)),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }

    /// True for a link that is drawn as a URDF has it: `xyz` leads to the next joint, and nothing is
    /// in the terms of Denavit and Hartenberg.
    #[must_use]
    pub fn is_vector(&self) -> bool {
        self.xyz != [0.0; 3] && [self.theta, self.d, self.a, self.alpha] == [0.0; 4]
    }

    /// The axes of the link in the frame after the joint: x along it, z across it, where a link of
    /// Denavit and Hartenberg is along x and is displaced along z.
    ///
    /// Of a link drawn as `xyz`, x leads to the next joint, and z is as near to the axis of the
    /// joint as it can be; of a link along that axis, to the axis of the next one.
    #[must_use]
    pub fn link(&self) -> UnitQuaternion<f64> {
        if !self.is_vector() {
            return UnitQuaternion::identity();
        }
        let along = Vector3::from(self.xyz).normalize();
        let next = self.body().rotation * Vector3::z();
        let across = |axis: Vector3<f64>| {
            let part = axis - along * along.dot(&axis);
            (part.norm() > PARALLEL).then(|| part.normalize())
        };
        let z = [Vector3::z(), next, Vector3::x()].into_iter().find_map(across);
        let z = z.unwrap_or_else(Vector3::z);
        let axes = Matrix3::from_columns(&[along, z.cross(&along), z]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
    }

    /// Axes in the frame after the joint, x leading to the next joint; `None` for a body without a
    /// length.
    #[must_use]
    pub fn along(&self) -> Option<UnitQuaternion<f64>> {
        let way = self.body().translation.vector;
        let turn = || {
            UnitQuaternion::rotation_between(&Vector3::x(), &way)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI))
        };
        (way != Vector3::zeros()).then(turn)
    }
}

/// Sine of an angle below which two directions of a drawing are meant to be one: it is written in
/// four digits or more.
const PARALLEL: f64 = 1e-4;

/// A serial chain of rows, base first.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Chain {
    /// Name of the chain in reports.
    pub name: String,
    /// Rows of the chain, base first.
    #[cfg_attr(feature = "serde", serde(rename = "dh"))]
    pub rows: Vec<Row>,
}

impl Chain {
    /// Axes in the frame after the joint of a row, x along the common normal of the axes of this
    /// joint and of the next: the way that a Denavit-Hartenberg length has.
    ///
    /// `None` where length and offset of the link, [`Row::link`], already move it so: in rows of
    /// Denavit and Hartenberg, where no joint follows, and where the normal is nearer to the plane of
    /// these two than to the way across it.
    #[must_use]
    pub fn side(&self, row: usize) -> Option<UnitQuaternion<f64>> {
        let own = &self.rows[row];
        if own.channel.is_none() || (own.xyz == [0.0; 3] && own.rpy == [0.0; 3]) {
            return None;
        }
        let next = self.to_next_joint(row)?;
        let (axis, other) = (Vector3::z(), next.rotation * Vector3::z());
        let across = |way: Vector3<f64>| way - axis * axis.dot(&way);
        let [along, beside, up] =
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|own_axis| own.link() * own_axis);
        // Parallel axes are apart by what of the link is across them. Axes that are one line may come
        // apart in any direction.
        let way = next.translation.vector;
        let apart = across(way.try_normalize(0.0).unwrap_or_default());
        let candidates = [axis.cross(&other), apart, beside];
        let normal = candidates.into_iter().find(|n| n.norm() > PARALLEL)?.normalize();
        let covered = along.dot(&normal).powi(2) + up.dot(&normal).powi(2);
        let turn = || {
            UnitQuaternion::rotation_between(&Vector3::x(), &normal)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI))
        };
        (covered < 0.5).then(turn)
    }

    /// From the frame after the joint of a row to the next row with a joint; `None` where none follows.
    fn to_next_joint(&self, row: usize) -> Option<Isometry3<f64>> {
        let mut way = self.rows[row].body();
        for next in &self.rows[row + 1..] {
            if next.channel.is_some() {
                return Some(way);
            }
            way *= Isometry3::rotation(Vector3::z() * next.theta) * next.body();
        }
        None
    }
}

/// A point on a chain, fixed in the base, or unknown but constant.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Point {
    /// Name of the point, for closures and the platform.
    pub name: String,
    /// The chain that carries the point; `None` for a point fixed in the base.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub chain: Option<String>,
    /// Position in length units, in the frame at the end of the chain, in `frame`, or in the base. Of an
    /// unknown point where it is looked for, and what stays as drawn.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub at: Option<[f64; 3]>,
    /// Key columns of the readings: each distinct combination of their values is one unknown point;
    /// `[]` is one point for all rows, `["pose"]` one for each pose.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub unknown: Option<Vec<String>>,
    /// The coordinates that are unknown, of `x`, `y` and `z`; all three where it is left out.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub free: Option<Vec<String>>,
    /// Columns of the readings with its measured coordinates, in length units.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub columns: Option<[String; 3]>,
    /// The frame of the measured coordinates, or of `at` of a point of a rigid body; the base where it is
    /// left out.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub frame: Option<String>,
}

impl Point {
    /// True for a point whose place is not known.
    #[must_use]
    pub fn is_unknown(&self) -> bool {
        self.unknown.is_some()
    }

    /// True for a point that is unknown in each pose by itself: it is no parameter.
    #[must_use]
    pub fn moves(&self) -> bool {
        is_of_each_pose(self.unknown.as_ref())
    }

    /// Columns that tell the unknown places of this point apart; none for one place in all rows.
    #[must_use]
    pub fn keys(&self) -> &[String] {
        if self.moves() { &[] } else { self.unknown.as_deref().unwrap_or_default() }
    }

    /// For each of `x`, `y` and `z` whether it is unknown.
    #[must_use]
    pub fn frees(&self) -> [bool; 3] {
        let named =
            |axis: &str| self.free.as_ref().is_none_or(|free| free.iter().any(|f| f == axis));
        ["x", "y", "z"].map(|axis| self.is_unknown() && named(axis))
    }
}

/// A known distance in length units: a number, or a column of the readings.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(
    feature = "serde",
    serde(untagged, expecting = "expected a number, or the name of a column of the readings")
)]
pub enum Value {
    /// A distance that is the same in every pose.
    Known(f64),
    /// A measured distance: the name of a value column.
    Column(String),
}

impl Value {
    /// The distance that is the same in every pose.
    #[must_use]
    pub fn known(&self) -> Option<f64> {
        match self {
            Self::Known(value) => Some(*value),
            Self::Column(_) => None,
        }
    }
}

/// An equation that holds in every pose.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Closure {
    /// Name of the closure in reports.
    pub name: String,
    /// What holds.
    pub kind: ClosureKind,
    /// Names of what it is between: two points, a point and a plane or a line, or two channels.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub between: [String; 2],
    /// The distance, or of a plane the column that says how high above it the point is; `None` for a kind
    /// without, or where a channel measures it.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub value: Option<Value>,
    /// The channel that measures the distance itself: a belt, a wire, a ruler.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub channel: Option<String>,
    /// How well the closure itself holds: standard deviation per equation, in length units, of
    /// equal channels in the unit of their coordinates (degrees in the file of two in degrees).
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub noise: Option<f64>,
    /// Standard deviation of the value, in length units.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sd: Option<f64>,
}

impl Closure {
    /// Two points that coincide.
    #[must_use]
    pub fn touch(name: impl Into<String>, between: [String; 2]) -> Self {
        Self { name: name.into(), kind: ClosureKind::Touch, between, ..Self::default() }
    }
}

/// A platform pose that is known without a measurement.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Rest {
    /// `x y z` in length units, `rx ry rz` in radians, eq. (1).
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::array"))]
    pub pose: [f64; 6],
    /// Standard deviation of each point of the platform in this pose, in length units; `None`: the
    /// pose is a start of the search and not an observation.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sd: Option<f64>,
}

/// The terms that a calibration identifies by default.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct ModelSection {
    /// Ids of terms.
    pub terms: Vec<String>,
    /// Prior standard deviation of each parameter of a term, in its unit.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "BTreeMap::is_empty"))]
    pub sd: BTreeMap<String, f64>,
}

impl Default for ModelSection {
    fn default() -> Self {
        Self { terms: vec!["offset".into(), "gain".into()], sd: BTreeMap::new() }
    }
}

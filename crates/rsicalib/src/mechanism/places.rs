//! Planes, lines and frames of a mechanism, and columns that laws may use.

use nalgebra::Vector3;

#[cfg(feature = "serde")]
use crate::mechanism::exactly;

/// In the place of a key column: one unknown for each pose.
const EACH_POSE: &str = "pose";

/// How far the length of a unit normal is from 1 that is written with three digits, at most.
const ROUNDED: f64 = 1e-3;

/// A plane that points touch: `normal · p = offset`. It is at `offset / |normal|` from the origin of the base;
/// heights above it are lengths, whatever that of the normal.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Plane {
    /// Name of the plane, for closures.
    pub name: String,
    /// The normal, in base coordinates; any length but zero. Of an unknown plane the direction from
    /// which its tilts are counted; the nearest axis of the base where it is left out.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub normal: Option<[f64; 3]>,
    /// What `normal · p` is on the plane: its distance from the origin of the base, in length units, where the
    /// normal has length 1.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub offset: Option<f64>,
    /// Key columns of the readings: each distinct combination of their values is one unknown plane;
    /// `[]` is one plane for all rows.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub unknown: Option<Vec<String>>,
}

/// A straight line that points touch: known by `at` and `direction`, or `unknown`.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Line {
    /// Name of the line, for closures.
    pub name: String,
    /// A point of the line, in base coordinates, in length units. Of an unknown line where it is looked
    /// for in rows that do not tell.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub at: Option<[f64; 3]>,
    /// Direction of the line, in base coordinates; any length but zero. Of an unknown line the direction
    /// from which its tilts are counted; the nearest axis of the base where it is left out.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub direction: Option<[f64; 3]>,
    /// Key columns of the readings: each distinct combination of their values is one unknown line;
    /// `[]` is one line for all rows.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub unknown: Option<Vec<String>>,
}

/// A frame in which another instrument measures points, or of a rigid body that carries points.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Frame {
    /// Name of the frame, for points.
    pub name: String,
    /// Where it is in the base: `x y z` in length units, `rx ry rz` in radians, eq. (1). Of a body that is
    /// somewhere else in each pose where it is looked for, and what stays as drawn.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exactly::optional"))]
    pub pose: Option<[f64; 6]>,
    /// Key columns of the readings: each distinct combination of their values is one unknown frame;
    /// `[]` is one frame for all rows, `["pose"]` one for each pose: a body that moves.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub unknown: Option<Vec<String>>,
}

/// A numeric column of the readings, for laws: a force, a current, the humidity.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Column {
    /// Name of the column.
    pub name: String,
    /// Unit of its numbers, for reports.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub unit: Option<String>,
}

/// Columns that tell unknown things apart.
fn keys(unknown: Option<&Vec<String>>) -> &[String] {
    unknown.map(Vec::as_slice).unwrap_or_default()
}

/// True for something that has another unknown place in each pose.
pub(super) fn is_of_each_pose(unknown: Option<&Vec<String>>) -> bool {
    keys(unknown).iter().any(|key| key == EACH_POSE)
}

impl Plane {
    /// Columns that tell its unknown places apart; none for one place in all rows.
    #[must_use]
    pub fn keys(&self) -> &[String] {
        keys(self.unknown.as_ref())
    }

    /// The unit normal of a known plane, and its distance from the origin along it.
    #[must_use]
    pub fn known(&self) -> Option<([f64; 3], f64)> {
        let normal = Vector3::from(self.normal?);
        let long = normal.norm();
        (long > 0.0).then(|| ((normal / long).into(), self.offset.unwrap_or(0.0) / long))
    }

    /// Length of the normal of a known plane, where it is not 1 and moves the plane: an offset that is meant
    /// as a distance is another one then. A normal that is written with three digits has length 1.
    #[must_use]
    pub(crate) fn scales_offset(&self) -> Option<f64> {
        let known = self.unknown.is_none() && self.offset.is_some_and(|offset| offset != 0.0);
        let long = Vector3::from(self.normal.filter(|_| known)?).norm();
        ((long - 1.0).abs() > ROUNDED).then_some(long)
    }
}

impl Frame {
    /// True for a body that is somewhere else in each pose: it is no parameter.
    #[must_use]
    pub fn moves(&self) -> bool {
        is_of_each_pose(self.unknown.as_ref())
    }

    /// Columns that tell its unknown places apart; none for one place in all rows.
    #[must_use]
    pub fn keys(&self) -> &[String] {
        if self.moves() { &[] } else { keys(self.unknown.as_ref()) }
    }
}

impl Line {
    /// Columns that tell its unknown places apart; none for one place in all rows.
    #[must_use]
    pub fn keys(&self) -> &[String] {
        keys(self.unknown.as_ref())
    }

    /// Two unit vectors across the line and each other, as drawn; none where no direction is.
    #[must_use]
    pub fn across(&self) -> Option<[[f64; 3]; 2]> {
        let [_, u, v] = around(self.direction?);
        Some([u, v])
    }

    /// A point of a known line; of an unknown one the origin of the base, from which it is counted.
    pub(crate) fn counts_from(&self) -> [f64; 3] {
        self.at.filter(|_| self.unknown.is_none()).unwrap_or_default()
    }
}

/// A vector made a unit vector, and two more that make a right-handed frame with it: for an axis of
/// the base the next two axes.
#[must_use]
pub(crate) fn around(vector: [f64; 3]) -> [[f64; 3]; 3] {
    let n = Vector3::from(vector).normalize();
    let next = (n.iamax() + 1) % 3;
    let axis = Vector3::from_fn(|i, _| f64::from(u8::from(i == next)));
    let u = (axis - n * n.dot(&axis)).normalize();
    [n, u, n.cross(&u)].map(Into::into)
}

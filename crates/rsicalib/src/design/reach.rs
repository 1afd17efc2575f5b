//! Readings that hold the platform at a pose.

use crate::Error;
use crate::design::exchange::{CRITERIA, Criterion};
use crate::mechanism::Mechanism;
use crate::model::assembly;

impl Criterion {
    /// The criterion of a name.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn find(name: &str) -> Result<Self, Error> {
        CRITERIA.iter().find(|c| c.0 == name).map(|c| c.1).ok_or_else(|| Error::Unknown {
            kind: "criterion",
            found: name.into(),
            known: CRITERIA.map(|c| c.0).join(", "),
        })
    }
}

/// Readings that hold the platform at a pose; none out of reach, beyond a joint
/// limit, or within `margin` readings of the end of a range.
///
/// # Errors
///
/// [`Error::Missing`] without a platform.
pub fn readings_at(
    mechanism: &Mechanism,
    pose: &[f64; 6],
    offsets: &[f64],
    gains: &[f64],
    margin: f64,
) -> Result<Option<Vec<f64>>, Error> {
    let angles = match assembly::inverse(mechanism, pose) {
        Ok(angles) => angles,
        Err(Error::OutOfReach { .. }) => return Ok(None),
        Err(other) => return Err(other),
    };
    let mut counts = Vec::with_capacity(angles.len());
    for (c, (channel, angle)) in mechanism.channels.iter().zip(angles).enumerate() {
        let count = (angle - offsets[c]) / gains[c];
        let within = channel.limits.is_none_or(|[low, high]| angle >= low && angle <= high)
            && channel
                .range
                .is_none_or(|[low, high]| count >= low + margin && count <= high - margin);
        if !within || !count.is_finite() {
            return Ok(None);
        }
        counts.push(count);
    }
    Ok(Some(counts))
}

//! Readings that hold the platform at a pose.

use crate::Error;
use crate::mechanism::{Mechanism, hand_controller};
use crate::model::assembly;

/// True for the geometry of the hand controller, whatever its sensors: (6) to (8) hold.
pub(crate) fn has_closed_form(mechanism: &Mechanism) -> bool {
    let rsi = Mechanism::rsi();
    let within = |limits: Option<[f64; 2]>, own: Option<[f64; 2]>| match (limits, own) {
        (Some([low, high]), Some([least, most])) => low >= least && high <= most,
        _ => false,
    };
    let limits =
        mechanism.channels.iter().zip(&rsi.channels).all(|(c, own)| within(c.limits, own.limits));
    mechanism.chains == rsi.chains
        && mechanism.points == rsi.points
        && mechanism.platform == rsi.platform
        && mechanism.channels.len() == rsi.channels.len()
        && limits
}

/// Joint coordinates (rad, or length units) that hold the platform at a pose, one per channel: of the
/// geometry of the hand controller by (6) to (8), within its joint limits.
///
/// # Errors
///
/// As [`assembly::inverse`].
pub fn angles_at(mechanism: &Mechanism, pose: &[f64; 6]) -> Result<Vec<f64>, Error> {
    inverse(mechanism, None)(pose)
}

/// [`angles_at`] for many poses of a mechanism; where it has been, those that are near these joint coordinates come first.
pub(crate) fn inverse(
    mechanism: &Mechanism,
    been: Option<Vec<f64>>,
) -> impl Fn(&[f64; 6]) -> Result<Vec<f64>, Error> + Sync + '_ {
    let closed = has_closed_form(mechanism);
    move |pose| {
        if closed {
            return hand_controller::inverse(pose).map(|angles| angles.concat());
        }
        let near = been.clone().map(|been| assembly::inverse_from(mechanism, pose, been));
        match near {
            Some(Ok(found)) => Ok(found),
            _ => assembly::inverse(mechanism, pose),
        }
    }
}

/// Readings that hold the platform at a pose; none out of reach, beyond a joint
/// limit, or within `margin` readings of the end of a range.
///
/// # Errors
///
/// [`Error::Missing`] without a platform; [`Error::Shape`] unless there is one offset and gain
/// per channel.
pub fn readings_at(
    mechanism: &Mechanism,
    pose: &[f64; 6],
    offsets: &[f64],
    gains: &[f64],
    margin: f64,
) -> Result<Option<Vec<f64>>, Error> {
    let expected = mechanism.channels.len();
    for (what, found) in [("offsets", offsets.len()), ("gains", gains.len())] {
        Error::same(what, found, expected)?;
    }
    let angles = match angles_at(mechanism, pose) {
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

//! Positions of known poses under a fit.

use nalgebra::Vector3;

use crate::Error;
use crate::apply::check::{found, motion_of};
use crate::apply::known::rows_of_known;
use crate::estimate::{Fit, Observations};
use crate::readings::average;
use crate::report::evidence::points::has_platform;
use crate::report::result::Known;

/// Where the known poses are, and where a fit puts them.
pub struct Positions {
    /// As they are known, pose by pose.
    pub known: Vec<[f64; 6]>,
    /// As the fit has them, after the best rigid motion where that was asked for.
    pub found: Vec<[f64; 6]>,
}

/// The known poses under parameters of a fit; none without a platform.
///
/// # Errors
///
/// As [`crate::apply::check::check`].
pub fn positions(
    session: &Observations,
    fit: &Fit,
    beta: &[f64],
    known: &Known,
) -> Result<Option<Positions>, Error> {
    if known.point.is_none() && !has_platform(&fit.model) && !session.mechanism.platform.is_empty()
    {
        return Ok(None);
    }
    let channels = session.mechanism.channels.len();
    let parts = rows_of_known(&known.table, channels, &known.poses).concat();
    if parts.is_empty() {
        return Ok(None);
    }
    let fit = &Fit { beta: beta.to_vec(), ..fit.clone() };
    let found = found(session, fit, known, average(&known.table, channels, &parts))?;
    let at: Vec<[f64; 6]> = parts.iter().map(|rows| known.poses[rows.start]).collect();
    let pairs: Vec<_> = at.iter().copied().zip(found.iter().copied()).collect();
    let (turn, shift) = motion_of(&pairs, known.align);
    let moved = |pose: &[f64; 6]| {
        let place = turn * Vector3::new(pose[0], pose[1], pose[2]) + shift;
        [place.x, place.y, place.z, pose[3], pose[4], pose[5]]
    };
    Ok(Some(Positions { known: at, found: found.iter().map(moved).collect() }))
}

/// The position of a pose.
pub fn place(pose: &[f64; 6]) -> [f64; 3] {
    [pose[0], pose[1], pose[2]]
}

//! Random configurations of a mechanism at work, within the limits of its joints.
//!
//! Closures between points that chains carry hold: a linkage, a part that two arms share. What
//! chains touch in the base does not hold them: a socket, or the ball at the other end of a bar, is
//! there for the session alone.

use crate::Error;
use crate::apply::earlier::opened;
use crate::mechanism::{Closure, Mechanism, Point};
use crate::model::configurations::Configurations;
use crate::numerics::random::Random;

/// Readings of random configurations, row by row, one for each channel, within limits and ranges.
///
/// Offsets and gains are those of the mechanism's channels. Closures of carried points hold as
/// drawn.
///
/// # Errors
///
/// [`Error::Missing`] where no chain carries a point; [`Error::Mechanism`] where the loops cannot
/// be closed near random configurations.
pub fn within_limits(mechanism: &Mechanism, count: usize, seed: u64) -> Result<Vec<f64>, Error> {
    let mut random = Random::new(seed);
    let values = match at_work(mechanism)? {
        Some(linked) => {
            let configurations = Configurations::new(&linked, &mut random)?;
            configurations.closed(count, &mut random)?.table.values
        }
        None => {
            let configurations = Configurations::new(&opened(mechanism)?, &mut random)?;
            configurations.open(&vec![0; count], &mut random)?.table.values
        }
    };
    let inside = |row: &&[f64]| {
        mechanism.channels.iter().zip(*row).all(|(channel, reading)| {
            channel.range.is_none_or(|[low, high]| *reading >= low && *reading <= high)
        })
    };
    Ok(values.chunks_exact(mechanism.channels.len()).filter(inside).flatten().copied().collect())
}

/// The mechanism with the closures that hold at work; none where no closure does.
fn at_work(mechanism: &Mechanism) -> Result<Option<Mechanism>, Error> {
    let carried = |name: &String| {
        mechanism.points.iter().any(|p| p.name == *name && p.chain.is_some() && p.at.is_some())
    };
    let holds = |closure: &&Closure| closure.between.iter().all(carried);
    let closures: Vec<Closure> = mechanism.closures.iter().filter(holds).cloned().collect();
    if closures.is_empty() {
        return Ok(None);
    }
    let points: Vec<Point> = mechanism.points.iter().filter(|p| !p.is_unknown()).cloned().collect();
    Ok(Some(Mechanism { points, closures, ..mechanism.clone() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_platform_holds_its_arms_together_within_ranges() -> Result<(), Error> {
        let rsi = Mechanism::rsi();
        let rows = within_limits(&rsi, 40, 0)?;
        assert!(rows.len() >= 30 * 9 && rows.len().is_multiple_of(9));
        for (k, reading) in rows.iter().enumerate() {
            let channel = &rsi.channels[k % 9];
            let [low, high] = channel.limits.unwrap_or([f64::MIN, f64::MAX]);
            let angle = channel.angle(*reading);
            assert!(angle >= low && angle <= high);
        }
        Ok(())
    }

    #[test]
    fn what_an_arm_touches_in_the_base_does_not_hold_it() -> Result<(), Error> {
        let mut arm = Mechanism::rsi();
        arm.chains.truncate(1);
        arm.channels.truncate(3);
        arm.points.truncate(1);
        (arm.platform, arm.rest, arm.workspace) = (Default::default(), None, None);
        let table = Point { name: "table".into(), at: Some([0.0; 3]), ..Point::default() };
        arm.points.push(table);
        arm.closures.truncate(1);
        arm.closures[0].between = [arm.points[0].name.clone(), "table".into()];
        assert_eq!(at_work(&arm)?, None);
        assert_eq!(within_limits(&arm, 20, 0)?, within_limits(&arm, 20, 0)?);
        Ok(())
    }
}

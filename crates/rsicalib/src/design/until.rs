//! As few poses as bring the platform to a target.

use crate::Error;
use crate::design::criterion::Criterion;
use crate::design::further::{Explained, Further, FurtherOptions, further};
use crate::estimate::Observations;

/// How a plan stands to its target.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "snake_case"))]
pub enum Standing {
    /// The session has reached it: no pose is worth a visit.
    Already,
    /// These poses reach it, and a plan of one less does not. Plans are searched for, and do not grow by one pose: now and
    /// then a still shorter one would reach it.
    Reached,
    /// As many as were allowed do not.
    Missed {
        /// So many like them would: what they tell, 1/sd², adds to what is known without them. Infinite where
        /// they tell nothing.
        needed: f64,
    },
}

/// The plan of as few poses as bring the standard deviation of the platform to `target`, of `options.poses` at
/// the most.
///
/// # Errors
///
/// As [`further`].
pub fn until(
    observations: &Observations,
    rivals: &[Explained],
    options: &FurtherOptions,
    target: f64,
) -> Result<(Further, Standing), Error> {
    let planned = |poses: usize| {
        let criterion = Some(Criterion::Platform);
        further(observations, rivals, &FurtherOptions { poses, criterion, ..options.clone() })
    };
    let sd = |found: &Further| found.forecast.platform_sd.map(|sd| sd.position);
    let (mut plan, standing) = shortest(planned, sd, options.poses, target)?;
    if standing == Standing::Already {
        plan.worth.fill(false);
    }
    Ok((plan, standing))
}

/// By `sd` before and after: doubled until the target is reached, then halved, as the way of a plan grows
/// with its poses.
fn shortest<P>(
    planned: impl Fn(usize) -> Result<P, Error>,
    sd: impl Fn(&P) -> [f64; 2],
    most: usize,
    target: f64,
) -> Result<(P, Standing), Error> {
    // What is not known is infinitely uncertain.
    let sd = |plan: &P| sd(plan).map(|sd| if sd.is_nan() { f64::INFINITY } else { sd });
    let (mut low, mut high, mut plan) = (0, 1, planned(1)?);
    let [before, _] = sd(&plan);
    if before <= target {
        return Ok((plan, Standing::Already));
    }
    while sd(&plan)[1] > target && high < most {
        (low, high) = (high, most.min(2 * high));
        plan = planned(high)?;
    }
    let [_, after] = sd(&plan);
    if after > target {
        let [told, wanted] = [after, target].map(|sd| sd.powi(-2) - before.powi(-2));
        let needed = if told > 0.0 { high as f64 * wanted / told } else { f64::INFINITY };
        return Ok((plan, Standing::Missed { needed }));
    }
    while high - low > 1 {
        let middle = usize::midpoint(low, high);
        let fewer = planned(middle)?;
        if sd(&fewer)[1] <= target { (high, plan) = (middle, fewer) } else { low = middle }
    }
    Ok((plan, Standing::Reached))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poses each of which tells as much: 1/sd² is 1 before, and grows by 1/4.
    fn told(poses: usize) -> Result<[f64; 2], Error> {
        Ok([1.0, (1.0 + 0.25 * poses as f64).powf(-0.5)])
    }

    #[test]
    fn as_few_poses_as_reach_a_target_are_found() -> Result<(), Error> {
        for poses in 1..=40 {
            let target = told(poses)?[1];
            let (plan, standing) = shortest(told, |sd| *sd, 64, target)?;
            assert_eq!((plan, standing), (told(poses)?, Standing::Reached));
        }
        let (_, standing) = shortest(told, |sd| *sd, 64, 1.0)?;
        assert_eq!(standing, Standing::Already);
        // Forty would reach it, of which ten are allowed.
        let (plan, standing) = shortest(told, |sd| *sd, 10, told(40)?[1])?;
        let Standing::Missed { needed } = standing else { panic!("{standing:?}") };
        assert!(plan == told(10)? && (needed - 40.0).abs() < 1e-9, "{needed}");
        Ok(())
    }

    #[test]
    fn poses_that_tell_nothing_reach_nothing() -> Result<(), Error> {
        let nothing = |_| Ok([f64::NAN, f64::NAN]);
        let (_, standing) = shortest(nothing, |sd| *sd, 4, 1.0)?;
        assert_eq!(standing, Standing::Missed { needed: f64::INFINITY });
        Ok(())
    }
}

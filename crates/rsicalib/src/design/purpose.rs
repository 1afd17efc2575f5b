//! What each pose of a plan is visited for, and whether it is worth it.

use crate::design::contest::DECIDED;
use crate::numerics::order;

/// What poses must bring together to `λ`, a growth of χ², to be more than its noise of one.
const SEEN: f64 = 1.0;

/// Share by which poses must bring down together what is made small.
const BETTER: f64 = 0.01;

/// What a pose is visited for.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "snake_case"))]
pub enum Purpose {
    /// It tells two explanations apart.
    Tells {
        /// Their numbers.
        apart: [usize; 2],
        /// By how much `λ` grows.
        gain: f64,
    },
    /// It shows where the platform is.
    Platform {
        /// Standard deviation of the platform before the pose [length unit].
        before: f64,
        /// The same after it.
        after: f64,
    },
    /// What is made small falls.
    Falls {
        /// By this factor.
        times: f64,
    },
}

impl Purpose {
    /// By how much `λ` grows; none where nothing is told apart.
    fn gain(&self) -> Option<f64> {
        match self {
            Self::Tells { gain, .. } => Some(gain.max(0.0)),
            _ => None,
        }
    }

    /// By what share the pose makes small what it is for, where it tells nothing apart.
    fn share(&self) -> f64 {
        match self {
            Self::Tells { .. } => 0.0,
            Self::Falls { times } => 1.0 - times,
            Self::Platform { before, .. } if !before.is_finite() => 1.0,
            Self::Platform { before, after } if *before > 0.0 => 1.0 - after / before,
            Self::Platform { .. } => 0.0,
        }
    }
}

/// Of each pose of a plan, whether it is worth a visit: poses that together bring next to nothing are
/// copies of others, or of the session.
pub(crate) fn worth(purposes: &[Purpose]) -> Vec<bool> {
    let (brings, least): (Vec<f64>, f64) = match purposes.iter().any(|p| p.gain().is_some()) {
        true => (purposes.iter().map(|p| p.gain().unwrap_or(0.0)).collect(), SEEN),
        false => (purposes.iter().map(Purpose::share).collect(), BETTER),
    };
    let mut order: Vec<usize> = (0..purposes.len()).collect();
    order::ascending(&mut order, |&a| brings[a]);
    let (mut together, mut worth) = (0.0, vec![false; purposes.len()]);
    for k in order {
        together += brings[k];
        worth[k] = together >= least;
    }
    worth
}

/// How many poses like those of a plan would be a decision, where they add `least` to `λ` together.
pub(crate) fn poses_to_decide(poses: usize, least: Option<f64>) -> Option<f64> {
    let least = least.filter(|least| *least > 0.0 && poses > 0)?;
    Some(poses as f64 * DECIDED / least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_that_bring_next_to_nothing_together_are_no_visits() {
        let tells = |gain| Purpose::Tells { apart: [0, 1], gain };
        assert_eq!(worth(&[8.0, 0.009, 6.0, 0.004].map(tells)), [true, false, true, false]);
        assert_eq!(worth(&[0.009; 10].map(tells)), [false; 10]);
        // Three that bring 0.4 each: two of them are less than the noise of χ², three are more.
        assert_eq!(worth(&[0.4; 3].map(tells)), [false, false, true]);
        let falls = |times| Purpose::Falls { times };
        assert_eq!(worth(&[0.9, 0.999, 0.98].map(falls)), [true, false, true]);
        let platform = |before, after| Purpose::Platform { before, after };
        let poses = [platform(f64::INFINITY, 1.0), platform(1.0, 0.999), platform(0.0, 0.0)];
        assert_eq!(worth(&poses), [true, false, false]);
    }

    #[test]
    fn poses_to_decide_grow_as_what_they_tell_is_less() {
        assert_eq!(poses_to_decide(3, Some(3.0)), Some(12.0));
        assert_eq!(poses_to_decide(3, Some(24.0)), Some(1.5));
        assert_eq!([poses_to_decide(0, Some(1.0)), poses_to_decide(3, Some(0.0))], [None; 2]);
    }
}

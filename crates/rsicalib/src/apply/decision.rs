//! Whether a limit is kept, by ISO 14253-1: only what is beyond the uncertainty is said.

use crate::numerics::distributions::chi2_quantile;

/// What can be said of a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Decision {
    /// The known error and the expanded uncertainty together are within the limit.
    #[cfg_attr(feature = "serde", serde(rename = "within"))]
    Within,
    /// The known error without its uncertainty is beyond the limit.
    #[cfg_attr(feature = "serde", serde(rename = "not within"))]
    NotWithin,
    /// Neither has been shown.
    #[cfg_attr(feature = "serde", serde(rename = "undecided"))]
    Undecided,
}

/// An error that has been seen: how large at known poses, and with what uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The largest.
    pub largest: f64,
    /// Its expanded uncertainty.
    pub expanded: f64,
    /// Noise of a reading alone makes the largest error elsewhere at least so large.
    pub noise: f64,
}

impl Seen {
    /// The largest of errors at `poses` known poses, whose coordinates scatter by `sd` from the noise of
    /// their readings: with the probability `p`, the noise of none is longer than
    ///
    /// ```text
    /// U = sd √(χ²₃⁻¹(p^(1/poses)))                                               (144)
    /// ```
    #[must_use]
    pub fn at_poses(largest: f64, sd: f64, poses: usize, noise: f64, confidence: f64) -> Self {
        let beyond = 1.0 - confidence.powf(1.0 / poses.max(1) as f64);
        Self { largest, expanded: sd * chi2_quantile(beyond, 3.0).sqrt(), noise }
    }

    /// The largest error elsewhere is at least so large.
    #[must_use]
    pub fn at_least(&self) -> f64 {
        (self.largest - self.expanded).max(self.noise)
    }

    /// What adds to an expanded uncertainty: nothing where that explains the error, which would
    /// count twice; else all of it.
    #[must_use]
    pub fn unexplained(&self, expanded: f64) -> f64 {
        if self.largest <= expanded.hypot(self.expanded) { 0.0 } else { self.largest }
    }
}

/// What can be said of a limit, of an error that is `known` beside the expanded uncertainty.
///
/// ```text
/// within:      known + unexplained + U <= limit
/// not within:  max(seen - U(seen), noise) > limit,  or  known - U > limit         (145)
/// ```
#[must_use]
pub fn decide(limit: f64, expanded: f64, known: f64, seen: Option<Seen>) -> Decision {
    let left = seen.map_or(0.0, |seen| seen.unexplained(expanded));
    if seen.is_some_and(|seen| seen.at_least() > limit) || known - expanded > limit {
        Decision::NotWithin
    } else if known + left + expanded <= limit {
        Decision::Within
    } else {
        Decision::Undecided
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_decided_only_beyond_the_uncertainty() {
        let seen = |largest| Some(Seen { largest, expanded: 0.1, noise: 0.2 });
        assert_eq!(decide(1.0, 0.9, 0.0, None), Decision::Within);
        assert_eq!(decide(1.0, 1.1, 0.0, None), Decision::Undecided);
        assert_eq!(decide(1.0, 0.5, 0.6, None), Decision::Undecided);
        assert_eq!(decide(1.0, 0.5, 1.6, None), Decision::NotWithin);
        // An error that the uncertainty explains does not count twice; one that it does not counts.
        assert_eq!(decide(1.0, 0.9, 0.0, seen(0.8)), Decision::Within);
        assert_eq!(decide(1.0, 0.5, 0.0, seen(0.7)), Decision::Undecided);
        assert_eq!(decide(1.0, 2.0, 0.0, seen(1.05)), Decision::Undecided);
        assert_eq!(decide(1.0, 2.0, 0.0, seen(1.2)), Decision::NotWithin);
        assert_eq!(decide(0.19, 2.0, 0.0, seen(0.1)), Decision::NotWithin);
        // What is not a number decides nothing.
        assert_eq!(decide(1.0, f64::NAN, 0.0, None), Decision::Undecided);
    }

    #[test]
    fn the_longest_of_so_many_noises_is_within_its_uncertainty_as_often_as_asked() {
        use crate::numerics::draws::Draws;
        let (mut draws, poses, trials) = (Draws::new(3), 10, 4000);
        let bound = Seen::at_poses(0.0, 2.0, poses, 0.0, 0.95).expanded;
        let mut length = || (0..3).map(|_| (2.0 * draws.normal()).powi(2)).sum::<f64>().sqrt();
        let within = (0..trials)
            .filter(|_| (0..poses).map(|_| length()).fold(0.0, f64::max) <= bound)
            .count();
        let share = within as f64 / f64::from(trials);
        assert!((share - 0.95).abs() < 4.0 * (0.95 * 0.05 / f64::from(trials)).sqrt(), "{share}");
    }
}

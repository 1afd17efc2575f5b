//! A guided session, pose by pose: from where on it is traced, and when it is done.

use crate::mechanism::Mechanism;

/// Equations beyond the parameters, from which on a session is traced.
const SPARE: usize = 6;

/// Poses at most to decide what is open, once the target is reached.
const DECIDING: usize = 12;

/// A pose that parts what is open by less, in units of χ², is not worth taking.
const PARTS: f64 = 2.0;

/// Poses at most after the target is reached, where the residual is in doubt.
const AFTER: usize = 6;

/// A residual with a smaller p-value is in doubt: of clean sessions one in ten goes on for it. Few poses hide an
/// effect, and p is then only small.
const DOUBT: f64 = 0.1;

/// Whether poses that touch so many unknown places are enough for a trace.
#[must_use]
pub fn traceable(mechanism: &Mechanism, poses: usize, touched: usize) -> bool {
    poses * mechanism.equations() >= unknowns(mechanism) + 3 * touched + SPARE
}

/// Poses from which on a trace is possible; none where that depends on what is touched.
#[must_use]
pub fn needed_poses(mechanism: &Mechanism) -> Option<usize> {
    let needed = unknowns(mechanism) + SPARE;
    mechanism.key_columns().is_empty().then(|| needed.div_ceil(mechanism.equations().max(1)))
}

/// An offset and a gain of every channel.
fn unknowns(mechanism: &Mechanism) -> usize {
    2 * mechanism.channels.len()
}

/// How far a guided session is.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Progress {
    /// Poses that were taken.
    pub poses: usize,
    /// Poses at most.
    pub most: usize,
    /// Poses since the target was reached; none before.
    pub beyond: Option<usize>,
    /// Whether a pose is to be measured again.
    pub repeat: bool,
    /// Whether more than one explanation is open.
    pub open: bool,
    /// Whether the next pose is chosen to decide between them.
    pub deciding: bool,
    /// By how much it parts them, in units of χ²; none where that is not known.
    pub gain: Option<f64>,
    /// Whether the result explains its poses.
    pub usable: bool,
    /// Probability of its residual by chance.
    pub p_value: Option<f64>,
    /// Whether a pose does not fit though it was measured again: the others may be wrong, too.
    pub unmended: bool,
    /// Whether a pose was kept out of the fit, to check it.
    pub checked: bool,
    /// Whether nobody is there who could go on later: a session that explains nothing goes on to its last pose.
    pub alone: bool,
}

impl Progress {
    /// Whether the session is done.
    #[must_use]
    pub fn done(&self) -> bool {
        self.poses >= self.most || self.beyond.is_some_and(|beyond| self.enough(beyond))
    }

    /// The same, so many poses after the target was reached.
    fn enough(&self, beyond: usize) -> bool {
        if self.repeat {
            return false;
        }
        if self.open {
            let hopeless = self.gain.is_some_and(|gain| gain < PARTS);
            return beyond >= DECIDING || hopeless || !self.deciding;
        }
        let doubtful = !self.usable || self.p_value.is_some_and(|p| p < DOUBT);
        let sound = !doubtful && !self.unmended && self.checked;
        sound || (beyond >= AFTER && (self.usable || !self.alone))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> Progress {
        let p_value = Some(0.5);
        Progress {
            poses: 9,
            most: 60,
            beyond: Some(0),
            usable: true,
            p_value,
            checked: true,
            ..Progress::default()
        }
    }

    #[test]
    fn the_hand_controller_needs_eight_poses() {
        let rsi = Mechanism::rsi();
        // 18 unknowns and 6 equations to spare, of three equations each.
        assert_eq!(needed_poses(&rsi), Some(8));
        assert!(traceable(&rsi, 8, 0) && !traceable(&rsi, 7, 0) && !traceable(&rsi, 8, 1));
    }

    #[test]
    fn a_session_is_done_at_its_target_where_nothing_is_in_doubt() {
        let done = |change: &dyn Fn(&mut Progress)| {
            let mut progress = sound();
            change(&mut progress);
            progress.done()
        };
        assert!(done(&|_| ()));
        assert!(!done(&|p| p.beyond = None), "the target is not reached");
        assert!(!done(&|p| p.repeat = true), "a pose is to be measured again");
        assert!(!done(&|p| p.checked = false), "nothing checks the fit");
        assert!(!done(&|p| p.unmended = true), "a pose does not fit");
        assert!(!done(&|p| p.p_value = Some(0.05)), "the residual is in doubt");
        assert!(done(&|p| p.p_value = None), "nothing tells of the residual");
        assert!(done(&|p| (p.repeat, p.poses) = (true, 60)), "as many as were allowed");
    }

    #[test]
    fn doubt_lasts_six_poses_and_no_explanation_lasts_where_nobody_is_there() {
        let after = |beyond, usable, alone| {
            Progress { beyond: Some(beyond), usable, alone, p_value: Some(0.05), ..sound() }.done()
        };
        assert!(!after(5, true, false) && after(6, true, false) && after(6, true, true));
        assert!(after(6, false, false) && !after(6, false, true));
    }

    #[test]
    fn what_is_open_is_decided_as_long_as_the_next_pose_parts_it() {
        let done = |beyond, gain, deciding| {
            let gain = Some(gain);
            Progress { beyond: Some(beyond), open: true, gain, deciding, ..sound() }.done()
        };
        assert!(!done(0, 3.0, true) && !done(11, 3.0, true) && done(12, 3.0, true));
        assert!(done(0, 1.0, true) && done(0, 3.0, false), "no pose parts it");
    }
}

//! Instances: one term at one target, and its place there.

use crate::Error;
use crate::mechanism::{Mechanism, Target, list};
use crate::readings::Readings;
use crate::terms::targets::{shared, targets};
use crate::terms::term::{Needs, ORDER_STEP, Outlasts, Per, Placed, Term};

/// One term at one target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// The term.
    pub term: &'static dyn Term,
    /// The target.
    pub target: Target,
    /// The place: the pose or the other channel where a searched term acts, the session of a term
    /// that each session has anew, else zero.
    pub place: usize,
}

impl Instance {
    /// Number of parameters.
    #[must_use]
    pub fn width(&self) -> usize {
        self.term.info().parameters.len()
    }

    /// True for what happened before the first pose, and has acted ever since: all that
    /// other readings see of what happened once.
    #[must_use]
    pub fn is_past(&self) -> bool {
        self.place == 0 && self.term.outlasts() == Outlasts::Value
    }

    /// Refuses a target that the mechanism does not have or that is not of the term's kind, and,
    /// for a term with a channel as its place, a place that is not a channel.
    pub(crate) fn check(&self, mechanism: &Mechanism) -> Result<(), Error> {
        let kind = match self.term.info().per {
            Per::All => matches!(self.target, Target::All),
            Per::Channel => matches!(
                self.target,
                Target::Channel(_) | Target::EachJoint(..) | Target::Together(_)
            ),
            Per::Row => matches!(self.target, Target::Row(..) | Target::EachRow(..)),
            Per::Chain => matches!(self.target, Target::Chain(_) | Target::EachChain(_)),
            Per::ChainOrAll => matches!(self.target, Target::Chain(_) | Target::All),
            Per::Closure => matches!(
                self.target,
                Target::Closure(_) | Target::Place(_) | Target::EachClosure(_)
            ),
        };
        if !kind || !self.target.is_in(mechanism) {
            let all = targets(self.term, mechanism).into_iter().chain(shared(self.term, mechanism));
            let known = all.map(|t| t.name(mechanism));
            return Err(Error::Unknown {
                kind: "target",
                found: self.target.name(mechanism),
                known: known.collect::<Vec<_>>().join(", "),
            });
        }
        if self.term.placed() == Placed::AtChannel && self.place >= mechanism.channels.len() {
            return Err(Error::Unknown {
                kind: "place",
                found: self.place.to_string(),
                known: list(mechanism.channels.iter().map(|c| &c.name)),
            });
        }
        Ok(())
    }
}

/// True for a term with parameters of its own in each session: a drift starts again.
#[must_use]
pub fn bound_to_session(term: &dyn Term) -> bool {
    term.info().needs == Needs::Order && term.placed() == Placed::Once
}

/// Places of a term at a target: the sessions, or the places of a searched term.
#[must_use]
pub fn places(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
    channel: usize,
) -> Vec<usize> {
    if bound_to_session(term) {
        (0..readings.sessions).collect()
    } else {
        term.places(mechanism, channel, readings.poses())
    }
}

fn pose_name(readings: &Readings, pose: usize) -> String {
    let Some(label) = readings.labels.get(pose) else { return String::new() };
    let several = readings.held && readings.sessions > 1;
    match several && readings.labels.iter().filter(|other| *other == label).count() > 1 {
        true => format!("{}/{label}", readings.session_of_pose[pose] + 1),
        false => label.to_string(),
    }
}

/// Name of the place of a term: a pose label, a channel, or a session counted from 1; empty for a
/// place that does not exist. A label that several sessions have stands behind the number of its session: `2/1`.
#[must_use]
pub fn place_name(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
    place: usize,
) -> String {
    match term.placed() {
        Placed::AtChannel => {
            mechanism.channels.get(place).map(|c| c.name.clone()).unwrap_or_default()
        }
        Placed::AtOrder => (ORDER_STEP * place as f64).to_string(),
        Placed::AtPose => pose_name(readings, place),
        Placed::Once if bound_to_session(term) => (place + 1).to_string(),
        Placed::Once => String::new(),
    }
}

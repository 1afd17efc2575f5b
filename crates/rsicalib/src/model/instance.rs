//! One term at one target, and the places that it may have there.

use crate::mechanism::{Mechanism, Target};
use crate::readings::Readings;
use crate::terms::term::{Needs, Outlasts, Placed, Term};

/// One term at one target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// The term.
    pub term: &'static dyn Term,
    /// Where it acts.
    pub target: Target,
    /// Where a searched term acts: a pose, or another channel.
    pub place: usize,
}

impl Instance {
    /// Number of its parameters.
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
}

/// True for a term that each session has anew: what drifts starts again.
#[must_use]
pub fn bound_to_session(term: &dyn Term) -> bool {
    term.info().needs == Needs::Order && term.placed() == Placed::Once
}

/// Places of a term at a target: a session, or where a searched term acts.
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

/// How users call the place of a term: a pose label, a channel, or a session.
#[must_use]
pub fn place_name(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
    place: usize,
) -> String {
    match term.placed() {
        Placed::AtChannel => mechanism.channels[place].name.clone(),
        Placed::AtPose => readings.labels.get(place).map(ToString::to_string).unwrap_or_default(),
        Placed::Once if bound_to_session(term) => (place + 1).to_string(),
        Placed::Once => String::new(),
    }
}

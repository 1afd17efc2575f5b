//! [`Ratio`].

use std::sync::LazyLock;

use crate::mechanism::{Mechanism, Motion, Moves, Target};
use crate::terms::coupled::Coupled;
use crate::terms::law;
use crate::terms::term::{Acts, Term};

term! {
    /// A parallelogram or a differential whose ratio is not the one declared.
    ///
    /// Turns a row that the mechanism declares to move by a ratio of a channel by `ratio` times the
    /// nominal angle of that channel, from the middle of its range: bars of unequal length, wheels
    /// of other numbers of teeth.
    Ratio("ratio", Geometry, per Row, needs Nothing) {
        ratio: "1" ~ 5e-3,
    } acts Acts::Coupled(&LAW)
}

static LAW: LazyLock<Coupled> =
    LazyLock::new(|| law::of_catalogue(&Ratio::INFO, Some(Moves::Rz), "ratio * phi"));

impl Term for Ratio {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        // What slides by a ratio has its scale in the gain of its channel.
        let Target::Row(chain, row) = target else { return false };
        let row = &mechanism.chains[chain].rows[row];
        row.ratio.is_some() && row.joint == Motion::Revolute
    }
}

//! [`Counterbalance`].

use std::sync::LazyLock;

use crate::terms::coupled::Coupled;
use crate::terms::law;
use crate::terms::term::{Acts, Term};

term! {
    /// A joint that a counterbalance turns against the weight.
    ///
    /// Subtracts `compliance` times the torque of gravity about this joint: a spring or a
    /// counterweight lifts more than the chain weighs, and the drive or the bearing gives. Where
    /// none is built in, gravity may be declared the wrong way round.
    Counterbalance("counterbalance", Load, per Channel, needs Gravity) {
        compliance: "rad/torque" ~ 4e-3,
    } acts Acts::Coupled(&LAW)
}

static LAW: LazyLock<Coupled> =
    LazyLock::new(|| law::of_catalogue(&Counterbalance::INFO, None, "-compliance * torque"));

impl Term for Counterbalance {}

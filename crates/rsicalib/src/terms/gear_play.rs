//! [`GearPlay`].

use std::sync::LazyLock;

use crate::terms::coupled::Coupled;
use crate::terms::law;
use crate::terms::term::{Acts, Term};

term! {
    /// A gear with play, in which the joint lies on the side to which gravity pulls.
    ///
    /// Adds `side` where gravity turns the joint up in its coordinate, and `-side` where gravity
    /// turns it down: `side` is half the play of the gear of a servo, which holds by its motor and
    /// reads there. The pull is that of a unit weight at the points that the chain carries, or of
    /// the links' masses. Where it never changes its side the effect is an offset.
    GearPlay("gear_play", Load, per Channel, needs Gravity) {
        side: "rad" ~ 1e-3,
    } acts Acts::Coupled(&LAW)
}

static LAW: LazyLock<Coupled> =
    LazyLock::new(|| law::of_catalogue(&GearPlay::INFO, None, "side * sign(torque)"));

impl Term for GearPlay {}

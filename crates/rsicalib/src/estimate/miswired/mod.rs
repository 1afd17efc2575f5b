//! Mistakes that were made when a device was wired or described: exchanged and reversed channels,
//! readings or offsets in degrees for radians, a track whose gap lies within the range of motion, a sensor that is
//! stuck.
//!
//! A mistake is undone in the readings, and everything is fitted again: where the loop closes then,
//! and by far not as declared, it is suspected. What judges depends on what there is: the search for a
//! start, what is known of gains and the rest pose, or whole fits.

mod again;
mod by_knowledge;
mod by_motion;
mod by_refit;
mod by_start;
mod mistake;
mod rewired;
mod stuck;

pub(crate) use again::DECISIVE;
pub(super) use again::{Again, LITTLE, closing};
pub(super) use by_refit::{in_other_unit, miswired};
pub(super) use mistake::OTHER_UNIT;
pub(super) use rewired::{NEAR, apart};
pub(super) use stuck::stuck;

pub(super) use by_knowledge::suspect as by_knowledge;
pub(super) use by_motion::suspect as by_motion;
pub(super) use by_start::{Suspected, suspect as by_start};

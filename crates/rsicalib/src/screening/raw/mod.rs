//! What looks wrong in raw readings that can be used, before anything is fitted.
//!
//! Each rule asks for evidence that clean readings would give less than once in a million files.
//! What needs the closed loop to be seen (exchanged channels, reversed signs, single bad readings)
//! is left to the fit.

mod codes;
mod copies;
mod poses;
mod rows;
mod suspect;
mod units;
mod unlabelled;

pub use rows::Raw;
pub use suspect::Suspect;
pub use unlabelled::{Shown, Unlabelled, unlabelled};

/// What looks wrong in these readings, rule by rule.
#[must_use]
pub fn suspects(raw: &Raw<'_>) -> Vec<Suspect> {
    let rules = [
        codes::constant_channels,
        codes::faults_of_converters,
        codes::ends_of_ranges,
        poses::moved_poses,
        poses::poses_not_held,
        units::other_units,
        copies::stale_rows,
        copies::copied_poses,
    ];
    rules.iter().flat_map(|rule| rule(raw)).collect()
}

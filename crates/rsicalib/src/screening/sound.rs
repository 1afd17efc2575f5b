//! The fit without what is wrong whatever the model lacks.

use crate::Error;
use crate::estimate::{Fit, Observations, fit};
use crate::screening::excluded::Excluded;
use crate::screening::{converter, outliers, placements};

/// The fit without what is wrong whatever the model lacks, which is left out of the
/// session: faults of converters, single bad samples, placements.
///
/// # Errors
///
/// As [`fit`].
pub fn sound(observations: &mut Observations, before: &Fit) -> Result<(Fit, Vec<Excluded>), Error> {
    let base = &before.model.instances;
    let faults = converter::faults(&observations.mechanism, &observations.readings);
    let mut excluded = converter::set_apart(observations, before, &faults);
    let sound = if excluded.is_empty() {
        before.clone()
    } else {
        converter::seen_by(before, fit(observations, base.clone(), Some(before))?)
    };
    let faulty = excluded.len();
    excluded.extend(outliers::samples(observations, &sound));
    excluded.extend(placements::find(observations, &sound)?);
    let clean = if excluded.len() == faulty {
        sound
    } else {
        converter::seen_by(before, fit(observations, base.clone(), Some(&sound))?)
    };
    Ok((clean, excluded))
}

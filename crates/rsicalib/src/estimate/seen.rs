//! Columns of an instrument that are left-handed, as two of them are exchanged or one has the other sign, or in another unit.
//!
//! Points that are seen in an unknown frame may be turned in any way, and so their columns may follow each other as they
//! like; their image in a mirror is another set of points, unless all are on one plane.

use crate::Error;
use crate::estimate::lengths::UNITS;
use crate::estimate::miswired::{Again, closing};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, Suspicion};

/// The point whose columns are in another unit, or mirrored, where the loop closes with that undone, and by far not as they
/// are: `left` is χ² per degree of freedom by a `noise`, and `refit` a fit of other observations.
pub(crate) fn miswritten(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let mechanism = &observations.mechanism;
    let columns = mechanism.value_columns();
    let seen = (0..mechanism.points.len()).filter(|&p| mechanism.points[p].columns.is_some());
    let again = |point: usize, times: [f64; 3]| {
        let mut table = observations.readings.table.clone();
        for (name, times) in mechanism.points[point].columns.as_ref()?.iter().zip(times) {
            let column = columns.iter().position(|column| column == name)?;
            table.columns[column].iter_mut().for_each(|value| *value *= times);
        }
        Some(Again::of(observations, (mechanism, table), noise, &refit)?.left)
            .filter(|with| *with < limit)
    };
    let closes = |with: f64| Closes { with, declared: left };
    let units = UNITS.into_iter().flat_map(|unit| [unit, 1.0 / unit]);
    let tried = seen.flat_map(|point| {
        let mirrored = again(point, [1.0, 1.0, -1.0])
            .map(|with| (with, Suspicion::LeftHanded { point, closes: closes(with) }));
        let scaled = units.clone().filter_map(move |times| {
            let with = again(point, [times; 3])?;
            Some((with, Suspicion::SeenInUnit { point, times, closes: closes(with) }))
        });
        mirrored.into_iter().chain(scaled)
    });
    tried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, suspicion)| suspicion)
}

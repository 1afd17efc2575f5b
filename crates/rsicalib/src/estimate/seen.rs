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
use crate::numerics::order::Ends;

/// The first point that an instrument sees whose columns are in another unit, or mirrored, where the loop closes with that
/// undone for all points that it sees, and by far not as they are: `left` is χ² per degree of freedom by a `noise`, and
/// `refit` a fit of other observations.
pub(crate) fn miswritten(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let mechanism = &observations.mechanism;
    let (columns, points) = (mechanism.value_columns(), &mechanism.points);
    let alike = |p: usize, other: usize| points[p].frame == points[other].frame;
    let of_instrument = |p: usize| points[p].columns.is_some();
    let seen = (0..points.len()).filter(|&p| of_instrument(p));
    let first = |p: &usize| !(0..*p).any(|other| of_instrument(other) && alike(*p, other));
    let seen = seen.filter(first);
    let again = |point: usize, times: [f64; 3]| {
        let mut table = observations.readings.table.clone();
        let mut by = vec![1.0; columns.len()];
        for own in points.iter().filter(|own| own.frame == points[point].frame) {
            for (name, times) in own.columns.iter().flatten().zip(times) {
                by[columns.iter().position(|column| column == name)?] = times;
            }
        }
        for (column, by) in table.columns.iter_mut().zip(by) {
            column.iter_mut().for_each(|value| *value *= by);
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
    tried.least_by(|a| a.0).map(|(_, suspicion)| suspicion)
}

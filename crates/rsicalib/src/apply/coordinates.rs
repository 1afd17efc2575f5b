//! Coordinates of joints under a result.

use crate::Error;
use crate::apply::earlier::{Applied, Under};
use crate::estimate::angles::Angles;
use crate::mechanism::Mechanism;
use crate::readings::Table;

/// Coordinate of the joint of each channel after all corrections [rad, or length units], row by row of a table.
///
/// # Errors
///
/// As [`crate::apply::earlier::points`], but that no chain need carry a point.
pub fn coordinates(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<f64>, Error> {
    let carried = mechanism.points.iter().any(|point| point.chain.is_some());
    let build = if carried { Under::open } else { Under::new };
    let under = build(mechanism, applied, table, &[])?;
    let beta = under.internal(&under.values);
    Ok(Angles::of(&under.readings, &under.model, &beta).all())
}

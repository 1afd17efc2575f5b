//! What is written beside the channels belongs to the pose before, or to the next: a tracker that began a pose late, labels
//! of a list from which one is missing.

use crate::Error;
use crate::estimate::miswired::{Again, closing};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::numerics::order::Ends;
use crate::readings::{Readings, Table};

/// Columns that may be shifted together, by their numbers.
struct Columns {
    /// Among those that tell places apart.
    keys: Vec<usize>,
    /// Among those of numbers.
    values: Vec<usize>,
}

impl Columns {
    /// True where one of them says something in a row.
    fn say(&self, readings: &Readings, row: usize) -> bool {
        let table = &readings.table;
        self.keys.iter().any(|&k| !table.keys[k][row].is_empty())
            || self.values.iter().any(|&k| !table.columns[k][row].is_nan())
    }
}

/// Columns with which the loop closes where each pose has those of its neighbour, and by far not as they are: `left` is χ²
/// per degree of freedom by a `noise`, and `refit` a fit of other observations.
pub(super) fn shifted(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let Observations { mechanism, readings, .. } = observations;
    let rows = rows_of_a_pose(readings)?;
    let (names, numbers) = (mechanism.key_columns(), mechanism.value_columns());
    let seen = mechanism.instrument_columns();
    let keys: Vec<usize> = (0..names.len()).collect();
    let values: Vec<usize> = (0..numbers.len()).filter(|&k| seen.contains(&numbers[k])).collect();
    let all = Columns { keys: keys.clone(), values: values.clone() };
    let groups = [Columns { keys: Vec::new(), values }, Columns { keys, values: Vec::new() }, all];
    let told = |columns: &&Columns| !(columns.keys.is_empty() && columns.values.is_empty());
    let one_kind = groups[2].keys.is_empty() || groups[2].values.is_empty();
    let groups = groups.iter().filter(told).take(if one_kind { 1 } else { 3 });
    let tried = groups.flat_map(|columns| [(columns, true), (columns, false)]);
    let closes = |(columns, later): (&Columns, bool)| {
        // Of rows in which they say something, as a tracker that sees some poses has rows of its own.
        let own: Vec<usize> =
            (0..readings.samples).filter(|&row| columns.say(readings, row)).collect();
        let from = |row: usize| match own.binary_search(&row) {
            Ok(at) if later => own.get(at + rows).copied(),
            Ok(at) => at.checked_sub(rows).map(|at| own[at]),
            Err(_) => Some(row),
        };
        // Nothing is known of the pose at the end.
        let mut weights = observations.weights.clone();
        let ends = own.iter().filter(|&&row| from(row).is_none());
        ends.for_each(|&row| weights[row] = 0.0);
        let without = Observations { weights, ..observations.clone() };
        let table = moved(&readings.table, columns, &from);
        let with = Again::of(&without, (mechanism, table), noise, &refit)?.left;
        let keys = columns.keys.iter().map(|&k| names[k].clone());
        let columns = keys.chain(columns.values.iter().map(|&k| numbers[k].clone())).collect();
        let closes = Closes { with, declared: left };
        (with < limit).then_some((with, Suspicion::Shifted { columns, later, closes }))
    };
    tried.filter_map(closes).least_by(|a| a.0).map(|it| it.1)
}

/// Rows of each pose; none where they are not as many in all.
fn rows_of_a_pose(readings: &Readings) -> Option<usize> {
    let poses = readings.rows_of_poses();
    let rows = poses.first()?.len();
    poses.iter().all(|own| own.len() == rows).then_some(rows)
}

/// The table with these columns from other rows; those of a row that has none stay.
fn moved(table: &Table, columns: &Columns, from: &impl Fn(usize) -> Option<usize>) -> Table {
    let mut moved = table.clone();
    for &k in &columns.keys {
        for (row, key) in moved.keys[k].iter_mut().enumerate() {
            key.clone_from(&table.keys[k][from(row).unwrap_or(row)]);
        }
    }
    for &k in &columns.values {
        for (row, value) in moved.columns[k].iter_mut().enumerate() {
            *value = table.columns[k][from(row).unwrap_or(row)];
        }
    }
    moved
}

//! How well a mechanism repeats the points that it touched, placement by placement.
//!
//! For each group of readings, the mean distance of the point that a chain carries from its own
//! mean at the unknown point that it touches, all samples of the group counted alike. Groups that a
//! fit has not seen tell more than those that it has.

use crate::Error;
use crate::apply::earlier::{Applied, points};
use crate::mechanism::Mechanism;
use crate::readings::Table;

/// A touch: number of the point among those that chains carry, and the columns that tell the
/// unknown points apart.
struct Touch<'a> {
    carried: usize,
    columns: &'a [String],
}

/// Touches of unknown points, closure by closure.
fn touches(mechanism: &Mechanism) -> Vec<Touch<'_>> {
    let point = |name: &String| mechanism.points.iter().find(|p| p.name == *name);
    let number = |name: &String| {
        let mut carried = mechanism.points.iter().filter(|p| p.chain.is_some());
        carried.position(|p| p.name == *name)
    };
    let touch = |one: &String, other: &String| {
        let columns = point(other)?.keys();
        (!columns.is_empty()).then_some(Touch { carried: number(one)?, columns })
    };
    let closed = mechanism.closures.iter().filter(|c| c.kind.facts().is_vector);
    closed
        .flat_map(|c| [touch(&c.between[0], &c.between[1]), touch(&c.between[1], &c.between[0])])
        .flatten()
        .collect()
}

/// The group of each row, by `groups` or else by the first column that tells unknown points apart; none for a mechanism
/// whose chains touch no unknown points.
///
/// # Errors
///
/// [`Error::Shape`] unless there is an entry for each row.
pub fn groups_of<'a>(
    mechanism: &Mechanism,
    table: &'a Table,
    groups: Option<&'a [String]>,
) -> Result<Option<&'a [String]>, Error> {
    let touches = touches(mechanism);
    let Some(first) = touches.first() else { return Ok(None) };
    match groups {
        Some(groups) => expect_rows("group", groups, rows(mechanism, table)),
        None => column(mechanism, table, &first.columns[0]),
    }
    .map(Some)
}

/// A column that tells unknown points apart.
fn column<'a>(
    mechanism: &Mechanism,
    table: &'a Table,
    name: &String,
) -> Result<&'a [String], Error> {
    let at = mechanism.key_columns().iter().position(|k| k == name);
    let cells = at.and_then(|k| table.keys.get(k)).map_or(&[][..], Vec::as_slice);
    expect_rows(name, cells, rows(mechanism, table))
}

fn rows(mechanism: &Mechanism, table: &Table) -> usize {
    table.values.len() / mechanism.channels.len()
}

/// Mean distance of carried points from their own means at what they touch, by group in the
/// order of the readings; empty for a mechanism whose chains touch no unknown points.
///
/// `groups` names the group of each row; without it the first column does that tells unknown
/// points apart.
///
/// # Errors
///
/// As [`points`]; [`Error::Shape`] unless every column has an entry for each row.
pub fn spread(
    mechanism: &Mechanism,
    applied: &Applied,
    table: &Table,
    groups: Option<&[String]>,
) -> Result<Vec<(String, f64)>, Error> {
    let touches = touches(mechanism);
    let Some(groups) = groups_of(mechanism, table, groups)? else { return Ok(Vec::new()) };
    let column = |name: &String| column(mechanism, table, name);
    let places = points(mechanism, applied, table.clone())?;
    // Name, sum of the distances, and their number.
    let mut found: Vec<(&String, f64, f64)> = Vec::new();
    for touch in &touches {
        let cells = touch.columns.iter().map(column).collect::<Result<Vec<_>, _>>()?;
        // Where a key is blank nothing is touched.
        let touching = |row: &usize| cells.iter().all(|cells| !cells[*row].is_empty());
        let rows: Vec<usize> = (0..groups.len()).filter(touching).collect();
        let own: Vec<[f64; 3]> = rows.iter().map(|&row| places[touch.carried][row]).collect();
        let distances = from_means(&own, |one, other| {
            cells.iter().all(|cells| cells[rows[one]] == cells[rows[other]])
        });
        for (name, distance) in rows.iter().map(|&row| &groups[row]).zip(distances) {
            match found.iter_mut().find(|(known, ..)| *known == name) {
                Some((_, sum, count)) => (*sum, *count) = (*sum + distance, *count + 1.0),
                None => found.push((name, distance, 1.0)),
            }
        }
    }
    Ok(found.into_iter().map(|(name, sum, count)| (name.clone(), sum / count)).collect())
}

fn expect_rows<'a>(name: &str, cells: &'a [String], rows: usize) -> Result<&'a [String], Error> {
    Error::same(&format!("column {name}"), cells.len(), rows).map(|()| cells)
}

/// Distance of each place from the mean of those that belong together.
fn from_means(places: &[[f64; 3]], together: impl Fn(usize, usize) -> bool) -> Vec<f64> {
    // A row of each set, and the sum and number of its places.
    let mut sets: Vec<(usize, [f64; 3], f64)> = Vec::new();
    let mut own = Vec::with_capacity(places.len());
    for (row, place) in places.iter().enumerate() {
        let known = sets.iter().position(|(first, ..)| together(row, *first));
        let set = known.unwrap_or_else(|| {
            sets.push((row, [0.0; 3], 0.0));
            sets.len() - 1
        });
        let (_, sum, count) = &mut sets[set];
        sum.iter_mut().zip(place).for_each(|(sum, v)| *sum += v);
        *count += 1.0;
        own.push(set);
    }
    let distance = |(place, set): (&[f64; 3], &usize)| {
        let (_, sum, count) = sets[*set];
        (0..3).map(|k| (place[k] - sum[k] / count).powi(2)).sum::<f64>().sqrt()
    };
    places.iter().zip(&own).map(distance).collect()
}

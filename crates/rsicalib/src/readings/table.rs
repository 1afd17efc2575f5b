//! Raw readings: a table, row by row.

use std::ops::Range;
use std::sync::Arc;

use crate::mechanism::Mechanism;

/// Rows of a session as it was taken, of which a table has some.
///
/// From where a pose was approached, how far a channel had travelled, and when it was read is of the
/// session: which of its rows are used changes none of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// All rows, in the order in which they were taken.
    pub whole: Arc<Table>,
    /// Which of them each row of the table is, or is the mean from.
    pub rows: Vec<usize>,
}

/// Raw readings, row by row. Every column has one entry per row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Readings, row by row, one per channel of the mechanism, in the channel's unit.
    pub values: Vec<f64>,
    /// Label of the held pose of each row; `None` for a recording in motion, or poses that were read
    /// once each.
    pub pose: Option<Vec<i64>>,
    /// Time of each row (s).
    pub time: Option<Vec<f64>>,
    /// Temperature at each row (°C).
    pub temperature: Option<Vec<f64>>,
    /// Number of the session of each row, from 0; `None` for a single session.
    pub session: Option<Vec<usize>>,
    /// For each key column of the mechanism, the text of each row; empty where the closures that need it
    /// do not hold.
    pub keys: Vec<Vec<String>>,
    /// For each value column of the mechanism, the number of each row; NaN where the closures that need
    /// it do not hold.
    pub columns: Vec<Vec<f64>>,
    /// The session that these are rows of; `None` where they are all of it.
    pub part: Option<Part>,
}

impl Table {
    /// Some rows of a table with so many channels: a part of its session.
    #[must_use]
    pub fn some(&self, channels: usize, rows: &[usize]) -> Self {
        Self { part: self.part_of(rows.iter().copied()), ..self.alone(channels, rows) }
    }

    /// The same rows by themselves, as if no others had been taken.
    #[must_use]
    pub(crate) fn alone(&self, channels: usize, rows: &[usize]) -> Self {
        let pick = |column: &Vec<f64>| rows.iter().map(|&r| column[r]).collect::<Vec<_>>();
        let of_row = |r: &usize| self.values[r * channels..(r + 1) * channels].iter().copied();
        Self {
            values: rows.iter().flat_map(of_row).collect(),
            pose: self.pose.as_ref().map(|p| rows.iter().map(|&r| p[r]).collect()),
            time: self.time.as_ref().map(pick),
            temperature: self.temperature.as_ref().map(pick),
            session: self.session.as_ref().map(|s| rows.iter().map(|&r| s[r]).collect()),
            keys: self.keys.iter().map(|k| rows.iter().map(|&r| k[r].clone()).collect()).collect(),
            columns: self.columns.iter().map(pick).collect(),
            part: None,
        }
    }

    /// True where each session begins after the one before has ended, by the times of the rows; true without times.
    #[must_use]
    pub fn has_one_clock(&self) -> bool {
        let (Some(time), Some(session)) = (&self.time, &self.session) else { return true };
        let mut begins = (1..time.len()).filter(|&row| session[row] != session[row - 1]);
        let ended = |row: usize| time[..row].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        begins.all(|row| time[row] >= ended(row))
    }

    /// True where the clock tells when other rows were read beside these: it goes on from session to session, and the
    /// others begin after the first of them has begun, or end before. True without times.
    #[must_use]
    pub(crate) fn has_clock_of(&self, other: &Self) -> bool {
        let (Some(mine), Some([first, last])) = (ends(&self.time), ends(&other.time)) else {
            return true;
        };
        self.has_one_clock() && (first > mine[0] || last < mine[0])
    }

    /// Moves the clock so that these rows are read after others, where theirs does not tell when.
    pub(crate) fn read_after(&mut self, others: &Self) {
        let (Some([_, end]), Some([first, _])) = (ends(&others.time), ends(&self.time)) else {
            return;
        };
        if !others.has_clock_of(self) {
            self.time.iter_mut().flatten().for_each(|time| *time += end - first);
        }
    }

    /// What some rows are a part of.
    pub(crate) fn part_of(&self, rows: impl Iterator<Item = usize>) -> Option<Part> {
        Some(match &self.part {
            Some(Part { whole, rows: own }) => {
                Part { whole: whole.clone(), rows: rows.map(|row| own[row]).collect() }
            }
            None => Part { whole: Arc::new(self.clone()), rows: rows.collect() },
        })
    }

    /// Changes the readings of each row, of the session as well.
    pub(crate) fn change(&mut self, channels: usize, change: impl Fn(&mut [f64])) {
        self.values.chunks_exact_mut(channels).for_each(&change);
        if let Some(Part { whole, .. }) = &mut self.part {
            Arc::make_mut(whole).values.chunks_exact_mut(channels).for_each(&change);
        }
    }

    /// Session of a row, from 0.
    #[must_use]
    pub(crate) fn session_of(&self, row: usize) -> usize {
        self.session.as_ref().map_or(0, |session| session[row])
    }
}

/// The first and the last of the times of some rows.
fn ends(time: &Option<Vec<f64>>) -> Option<[f64; 2]> {
    let (first, rest) = time.as_ref()?.split_first()?;
    Some(rest.iter().fold([*first; 2], |[low, high], t| [low.min(*t), high.max(*t)]))
}

/// The runs of rows with the same pose: every row, of a recording.
#[must_use]
pub(crate) fn runs_of_poses(table: &Table, channels: usize) -> Vec<Range<usize>> {
    let rows = table.values.len().checked_div(channels).unwrap_or(0);
    match &table.pose {
        Some(labels) => runs_of(labels),
        None => (0..rows).map(|row| row..row + 1).collect(),
    }
}

/// The runs of entries that are equal.
#[must_use]
pub(crate) fn runs_of<T: PartialEq>(entries: &[T]) -> Vec<Range<usize>> {
    let end = |start: &mut usize, run: &[T]| {
        let own = *start..*start + run.len();
        *start = own.end;
        Some(own)
    };
    entries.chunk_by(T::eq).scan(0, end).collect()
}

/// Mean of the numbers among these; NaN where there is none.
pub(super) fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    values.filter(|v| !v.is_nan()).for_each(|v| (sum, count) = (sum + v, count + 1.0));
    sum / count
}

/// Rows of a mechanism as rows of another one that uses some of its keys and columns.
#[must_use]
pub(crate) fn as_of(table: Table, whole: &Mechanism, some: &Mechanism) -> Table {
    fn chosen<T: Clone>(all: Vec<T>, named: &[String], wanted: &[String]) -> Vec<T> {
        if all.len() != named.len() {
            return all;
        }
        let places = wanted.iter().filter_map(|name| named.iter().position(|own| own == name));
        places.map(|place| all[place].clone()).collect()
    }
    let keys = chosen(table.keys, &whole.key_columns(), &some.key_columns());
    let columns = chosen(table.columns, &whole.value_columns(), &some.value_columns());
    Table { keys, columns, ..table }
}

/// One row for each of these sets of rows, the mean of its rows.
#[must_use]
pub(crate) fn average<R: ExactSizeIterator<Item = usize> + Clone>(
    table: &Table,
    channels: usize,
    poses: &[R],
) -> Table {
    let firsts: Vec<usize> = poses.iter().filter_map(|rows| rows.clone().next()).collect();
    let mean =
        |f: &dyn Fn(usize) -> f64, rows: &R| rows.clone().map(f).sum::<f64>() / rows.len() as f64;
    let column = |values: &Option<Vec<f64>>| {
        values.as_ref().map(|v| poses.iter().map(|p| mean(&|r| v[r], p)).collect::<Vec<f64>>())
    };
    // Of what was not measured in some rows, the mean of the others.
    let measured = |v: &Vec<f64>| poses.iter().map(|p| mean_of(p.clone().map(|r| v[r]))).collect();
    Table {
        values: poses
            .iter()
            .flat_map(|p| (0..channels).map(move |c| (p, c)))
            .map(|(p, c)| mean(&|r| table.values[r * channels + c], p))
            .collect(),
        pose: table.pose.as_ref().map(|labels| firsts.iter().map(|&r| labels[r]).collect()),
        time: column(&table.time),
        temperature: column(&table.temperature),
        session: table.session.as_ref().map(|s| firsts.iter().map(|&r| s[r]).collect()),
        keys: table.keys.iter().map(|k| firsts.iter().map(|&r| k[r].clone()).collect()).collect(),
        columns: table.columns.iter().map(measured).collect(),
        part: table.part_of(firsts.into_iter()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_at(time: &[f64]) -> Table {
        Table { values: vec![0.0; time.len()], time: Some(time.to_vec()), ..Table::default() }
    }

    #[test]
    fn a_clock_that_begins_with_the_session_or_before_tells_nothing() {
        let session = read_at(&[0.0, 10.0, 20.0]);
        let after = |time: &[f64]| {
            let mut other = read_at(time);
            let told = session.has_clock_of(&other);
            other.read_after(&session);
            (told, other.time.unwrap_or_default())
        };
        assert_eq!(after(&[5.0, 6.0]), (true, vec![5.0, 6.0]));
        assert_eq!(after(&[-9.0, -1.0]), (true, vec![-9.0, -1.0]));
        assert_eq!(after(&[0.0, 3.0]), (false, vec![20.0, 23.0]));
        assert_eq!(after(&[-1.0, 3.0]), (false, vec![20.0, 24.0]));
        let timeless = Table { time: None, ..session.clone() };
        assert!(session.has_clock_of(&timeless) && timeless.has_clock_of(&session));
        // The clock of a second session begins anew.
        let sessions = Table { session: Some(vec![0, 0, 1]), ..read_at(&[0.0, 10.0, 2.0]) };
        assert!(!sessions.has_clock_of(&read_at(&[50.0])));
    }
}

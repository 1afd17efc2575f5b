//! The last rows, to look at a change again once it is known better.

use crate::monitor::kept::keep;

/// Rows that are kept.
const KEPT_ROWS: usize = 512;

/// Number, time (s) and readings of a row.
pub(crate) type Kept = (u64, Option<f64>, Vec<f64>);

/// Number and time (s) of a row, with its `r` and `G`.
pub(crate) type Linearised = (u64, Option<f64>, Vec<f64>, Vec<f64>);

/// Number and readings of rows.
pub(crate) fn numbered(rows: &[Kept]) -> Vec<(u64, &[f64])> {
    rows.iter().map(|(number, _, readings)| (*number, &**readings)).collect()
}

/// A ring of rows.
#[derive(Debug, Clone)]
pub(crate) struct Recent {
    channels: usize,
    readings: Vec<f64>,
    times: Vec<Option<f64>>,
    /// Number of each row, all rows counted; none for a row that is left out.
    numbers: Vec<Option<u64>>,
    next: usize,
}

impl Recent {
    pub(crate) fn new(channels: usize) -> Self {
        let (readings, times) = (vec![0.0; KEPT_ROWS * channels], vec![None; KEPT_ROWS]);
        Self { channels, readings, times, numbers: vec![None; KEPT_ROWS], next: 0 }
    }

    /// Keeps a row in the place of the oldest.
    pub(crate) fn keep(&mut self, number: u64, time: Option<f64>, readings: &[f64]) {
        let first = self.next * self.channels;
        self.readings[first..first + self.channels].copy_from_slice(readings);
        (self.numbers[self.next], self.times[self.next]) = (Some(number), time);
        self.next = (self.next + 1) % KEPT_ROWS;
    }

    /// Time of a row that is there (s).
    pub(crate) fn time_of(&self, number: u64) -> Option<f64> {
        let at = self.numbers.iter().position(|n| *n == Some(number))?;
        self.times[at]
    }

    /// Rows that are kept, at most.
    pub(crate) fn most(&self) -> u64 {
        self.numbers.len() as u64
    }

    /// Leaves out a row that turned out to be bad.
    pub(crate) fn leave_out(&mut self, number: u64) {
        if let Some(found) = self.numbers.iter_mut().find(|n| **n == Some(number)) {
            *found = None;
        }
    }

    /// The rows from `first` to `last`, oldest first; none where older ones are gone.
    pub(crate) fn between(&self, first: u64, last: u64) -> Option<Vec<Kept>> {
        let oldest = self.numbers.iter().flatten().min()?;
        if *oldest > first {
            return None;
        }
        let mut found: Vec<(u64, usize)> = (0..KEPT_ROWS)
            .filter_map(|k| Some((self.numbers[k]?, k)))
            .filter(|(number, _)| (first..=last).contains(number))
            .collect();
        found.sort_unstable();
        let row = |k: usize| self.readings[k * self.channels..(k + 1) * self.channels].to_vec();
        Some(found.into_iter().map(|(number, k)| (number, self.times[k], row(k))).collect())
    }
}

impl Recent {
    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> [usize; 3] {
        [self.readings.len(), self.times.len(), self.numbers.len()]
    }
}

keep!(Recent: readings, times, numbers, next);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_in_order_as_long_as_they_are_there() {
        let mut recent = Recent::new(1);
        (0..700).for_each(|n| recent.keep(n, None, &[n as f64]));
        recent.leave_out(601);
        let found: Vec<f64> =
            recent.between(600, 603).into_iter().flatten().map(|(.., row)| row[0]).collect();
        assert_eq!(found, [600.0, 602.0, 603.0]);
        assert!(recent.between(100, 603).is_none());
    }
}

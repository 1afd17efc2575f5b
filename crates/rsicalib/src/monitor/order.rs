//! Rows on their way in: unreadable, repeated, late and missing ones.

use crate::mechanism::Channel;
use crate::monitor::kept::keep;

/// Rows of a watch, by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Counts {
    /// All rows given.
    pub rows: u64,
    /// Rows that were tested.
    pub used: u64,
    /// Rows with a reading that is no number in the channel's range.
    pub unreadable: u64,
    /// Rows equal to the row before, or with its time.
    pub repeated: u64,
    /// Rows with a time before that of an earlier row.
    pub late: u64,
    /// Rows that did not come, told by a gap in time.
    pub missing: u64,
    /// Rows far outside that no later row confirmed: bad readings.
    pub outliers: u64,
    /// Rows that were not tested: a channel was stuck, or the device has changed in a way that has no
    /// name.
    pub silent: u64,
    /// Alarms raised.
    pub alarms: u64,
}

/// What becomes of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Row {
    /// It follows the row before.
    Next,
    /// It comes after a gap, or is the first.
    AfterGap,
    /// It is counted, and left out.
    LeftOut,
}

/// A gap is longer than this number of usual intervals.
const GAP: f64 = 1.5;

/// Share of a new interval in the usual one.
const RECENT: f64 = 0.02;

/// So many late rows in order, none in time between them, are no rows that came late: a stream that is put in order again
/// holds back fewer.
const SET_BACK: u64 = 20;

/// The order of rows.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    ranges: Vec<[f64; 2]>,
    last: Vec<f64>,
    time: Option<f64>,
    /// Usual time between neighbouring rows (s).
    pub(crate) interval: Option<f64>,
    broken: bool,
    /// Time of the last late row, and how many late ones in order it ended.
    late: Option<f64>,
    behind: u64,
}

impl Order {
    pub(crate) fn new(channels: &[Channel]) -> Self {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        Self {
            ranges: channels.iter().map(|c| c.range.unwrap_or(all)).collect(),
            last: vec![f64::NAN; channels.len()],
            time: None,
            interval: None,
            broken: true,
            late: None,
            behind: 0,
        }
    }

    /// Judges a row, and counts it.
    pub(crate) fn judge(
        &mut self,
        readings: &[f64],
        time: Option<f64>,
        counts: &mut Counts,
    ) -> Row {
        counts.rows += 1;
        let inside = |(a, [low, high]): (&f64, &[f64; 2])| a.is_finite() && a >= low && a <= high;
        let readable = readings.len() == self.ranges.len()
            && readings.iter().zip(&self.ranges).all(inside)
            && time.is_none_or(f64::is_finite);
        if !readable {
            counts.unreadable += 1;
            self.broken = true;
            return Row::LeftOut;
        }
        let same = readings == self.last;
        let step = self.time.zip(time).map(|(before, now)| now - before);
        if same || step == Some(0.0) {
            counts.repeated += 1;
            self.time = time.or(self.time);
            return Row::LeftOut;
        }
        let late = step.is_some_and(|s| s < 0.0);
        if late && !self.is_set_back(time) {
            counts.late += 1;
            return Row::LeftOut;
        }
        // Nobody knows how many rows are missing where a clock was set back.
        self.broken |= late;
        self.behind = 0;
        let gap = step.is_some_and(|s| s > 0.0 && self.gap(s, counts));
        let next = !(gap || self.broken);
        self.broken = false;
        self.last.copy_from_slice(readings);
        self.time = time;
        if next { Row::Next } else { Row::AfterGap }
    }

    /// True where so many rows one after the other are late, and in order among themselves, that the clock was set back.
    fn is_set_back(&mut self, time: Option<f64>) -> bool {
        let follows = self.late.zip(time).is_some_and(|(before, now)| now > before);
        self.behind = if follows { self.behind + 1 } else { 1 };
        self.late = time;
        self.behind > SET_BACK
    }

    /// True where rows are missing before this one.
    fn gap(&mut self, step: f64, counts: &mut Counts) -> bool {
        let usual = *self.interval.get_or_insert(step);
        let missing = step > GAP * usual;
        if missing {
            let rows = ((step / usual).round() as u64).saturating_sub(1);
            counts.missing = counts.missing.saturating_add(rows);
            // A stream that has become slower shows gaps only until its pace is learned.
            self.interval = Some(usual + RECENT * (step.min(2.0 * usual) - usual));
        } else {
            self.interval = Some(usual + RECENT * (step - usual));
        }
        missing
    }
}
impl Order {
    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> [usize; 1] {
        [self.last.len()]
    }
}

keep!(Order: last, time, interval, broken, late, behind);
keep!(Counts: rows, used, unreadable, repeated, late, missing, outliers, silent, alarms);

#[cfg(test)]
mod tests {
    use super::*;

    /// What becomes of rows at these times, each with readings of its own.
    fn judged(times: &[f64]) -> (Vec<Row>, Counts) {
        let channel = Channel { name: "q".into(), unit: "rad".into(), ..Channel::default() };
        let (mut order, mut counts) = (Order::new(&[channel]), Counts::default());
        let one = |(row, time): (usize, &f64)| order.judge(&[row as f64], Some(*time), &mut counts);
        (times.iter().enumerate().map(one).collect(), counts)
    }

    #[test]
    fn a_watch_goes_on_after_its_clock_was_set_back() {
        let before = (0..50).map(|k| 5000.0 + f64::from(k));
        let times: Vec<f64> = before.chain((0..60).map(|k| 1000.0 + f64::from(k))).collect();
        let (rows, counts) = judged(&times);
        assert_eq!(counts.late, SET_BACK);
        let first = 50 + SET_BACK as usize;
        assert!(rows[50..first].iter().all(|row| *row == Row::LeftOut));
        assert_eq!(rows[first], Row::AfterGap);
        assert!(rows[first + 1..].iter().all(|row| *row == Row::Next));
        assert_eq!(counts.missing, 0);
    }

    #[test]
    fn rows_that_come_late_are_left_out_each_time() {
        // Every fifth row comes three rows late.
        let time = |k: u32| f64::from(if k % 5 == 4 { k - 3 } else { k });
        let (_, counts) = judged(&(0..500).map(time).collect::<Vec<f64>>());
        assert_eq!(counts.late + counts.repeated, 100);
    }
}

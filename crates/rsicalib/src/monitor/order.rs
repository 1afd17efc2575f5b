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

/// The order of rows.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    ranges: Vec<[f64; 2]>,
    last: Vec<f64>,
    time: Option<f64>,
    /// Usual time between neighbouring rows (s).
    pub(crate) interval: Option<f64>,
    broken: bool,
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
        if step.is_some_and(|s| s < 0.0) {
            counts.late += 1;
            return Row::LeftOut;
        }
        let gap = step.is_some_and(|s| self.gap(s, counts));
        let next = !(gap || self.broken);
        self.broken = false;
        self.last.copy_from_slice(readings);
        self.time = time;
        if next { Row::Next } else { Row::AfterGap }
    }

    /// True where rows are missing before this one.
    fn gap(&mut self, step: f64, counts: &mut Counts) -> bool {
        let usual = *self.interval.get_or_insert(step);
        let missing = step > GAP * usual;
        if missing {
            counts.missing += ((step / usual).round() as u64).saturating_sub(1);
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

keep!(Order: last, time, interval, broken);
keep!(Counts: rows, used, unreadable, repeated, late, missing, outliers, silent, alarms);

//! Onsets of a change: row by row among the last, on the grid of the windows before.

use crate::monitor::recent::{Linearised, numbered};
use crate::monitor::watching::Monitor;
use crate::monitor::windows::{Mark, Sums};

/// Number of the last rows of which each may be the first of the change.
const ROW_BY_ROW: u64 = 64;

/// Rows before these that fill the filter which makes the residual white.
const FILL: u64 = 2;

impl Monitor {
    /// The sums before each onset that is possible, marked with the first row of the change.
    ///
    /// A large change is named from few rows: there an onset on the grid would take rows before the
    /// change for rows after it, and another name might fit these better.
    pub(super) fn onsets(&mut self, last: u64, broken: Option<u64>) -> Vec<Sums> {
        let kept = self.windows.onsets();
        let mut onsets: Vec<Sums> =
            kept.into_iter().map(|k| self.windows.onset(k).clone()).collect();
        let first = (last + 1).saturating_sub(ROW_BY_ROW).max(self.windows.began);
        let mut after = Sums::new(self.watched.order.len());
        let tested = self.watched.tested();
        for (row, time, r, g) in self.filtered(first, last, broken).into_iter().rev() {
            after.take(&r, &g, &tested);
            let mut before = self.windows.now.minus(&after);
            let samples = self.windows.now.mark.samples.saturating_sub(after.mark.samples);
            before.mark = Mark { samples, row, time };
            onsets.push(before);
        }
        onsets
    }

    /// The rows from `first` to `last` with their numbers and times, linearised and filtered as the
    /// state has them: the first row after a start has no neighbour, nor has the row `broken`.
    pub(super) fn filtered(
        &mut self,
        first: u64,
        last: u64,
        broken: Option<u64>,
    ) -> Vec<Linearised> {
        let fill = first.saturating_sub(FILL).max(self.windows.began).min(first);
        let rows = self.recent.between(fill, last);
        let rows = rows.or_else(|| self.recent.between(first, last)).unwrap_or_default();
        let mut found = Vec::new();
        let Self { again, watched, whitening, unsteady, whitener, .. } = self;
        whitening.interrupt();
        again.each(watched, &numbered(&rows), |place, r, g| {
            let (row, time, _) = rows[place];
            whitener.row(watched, unsteady, self.scale, row, r, g);
            if broken == Some(row) {
                whitening.interrupt();
            }
            whitening.filter(r, g);
            if row >= first {
                found.push((row, time, r.to_vec(), g.to_vec()));
            }
        });
        found
    }
}

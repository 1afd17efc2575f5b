//! Readings that repeat: a channel is stuck where one does for longer than chance lets it.

use crate::monitor::kept::keep;
use crate::readings::repeating::Repeating;

/// Readings that repeat: how long each channel has, while others move.
#[derive(Debug, Clone)]
pub(crate) struct Runs {
    last: Vec<f64>,
    /// Rows of the present run, the first one counted, and number of the first.
    length: Vec<u64>,
    began: Vec<u64>,
    /// Of the runs that have ended: rows that repeated the one before, and rows at which a run of
    /// two or more might have ended, or did.
    repeats: Vec<f64>,
    chances: Vec<f64>,
}

impl Runs {
    pub(crate) fn new(channels: usize) -> Self {
        Self {
            last: vec![f64::NAN; channels],
            length: vec![0; channels],
            began: vec![0; channels],
            repeats: vec![Repeating::UNKNOWN.again; channels],
            chances: vec![Repeating::UNKNOWN.chances; channels],
        }
    }

    /// Takes in the reading of one channel in a row; nothing is learned from a run of a channel that
    /// is known to be stuck. True where the reading is another one.
    pub(crate) fn see(&mut self, channel: usize, reading: f64, row: u64, stuck: bool) -> bool {
        if reading == self.last[channel] {
            self.length[channel] += 1;
            return false;
        }
        if !stuck {
            let mut shown = self.shown(channel);
            shown.end(self.length[channel]);
            (self.repeats[channel], self.chances[channel]) = (shown.again, shown.chances);
        }
        (self.last[channel], self.length[channel], self.began[channel]) = (reading, 1, row);
        true
    }

    /// First row of the present run of a channel, and the logarithm of the probability that a run of
    /// two goes on for so long by chance.
    pub(crate) fn of(&self, channel: usize) -> (u64, f64) {
        (self.began[channel], self.shown(channel).chance(self.length[channel]))
    }

    /// What the runs that have ended show.
    fn shown(&self, channel: usize) -> Repeating {
        Repeating { again: self.repeats[channel], chances: self.chances[channel] }
    }

    /// Rows of the present run.
    pub(crate) fn rows(&self, channel: usize) -> u64 {
        self.length[channel]
    }

    /// The reading that is repeated.
    pub(crate) fn reading(&self, channel: usize) -> f64 {
        self.last[channel]
    }

    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> [usize; 5] {
        let Self { last, length, began, repeats, chances } = self;
        [last.len(), length.len(), began.len(), repeats.len(), chances.len()]
    }
}

keep!(Runs: last, length, began, repeats, chances);

#[cfg(test)]
mod tests {
    use super::Runs;

    #[test]
    fn a_run_is_as_rare_as_the_channel_has_repeated_before() {
        let mut runs = Runs::new(1);
        // Three of a kind, then another: a run of three goes on once of two chances.
        for row in 0..4_000_u64 {
            runs.see(0, (row / 3) as f64, row, false);
        }
        (4_000..4_010).for_each(|row| {
            runs.see(0, -1.0, row, false);
        });
        let (began, chance) = runs.of(0);
        assert_eq!((began, runs.rows(0)), (4_000, 10));
        assert!((chance - 8.0 * 0.5_f64.ln()).abs() < 0.01, "{chance}");
    }
}

//! Candidates, each at its best onset.

use crate::monitor::thresholds::log_tail;
use crate::monitor::watching::Monitor;
use crate::monitor::windows::Sums;
use crate::numerics::order;

/// The best onset of a candidate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Suspect {
    pub(super) candidate: usize,
    pub(super) onset: usize,
    pub(super) statistic: f64,
    pub(super) rank: usize,
    pub(super) log_p: f64,
}

impl Suspect {
    /// A candidate of which nothing else is known.
    pub(super) fn of(candidate: usize) -> Self {
        Self { candidate, onset: 0, statistic: 0.0, rank: 0, log_p: 0.0 }
    }
}

impl Monitor {
    /// Every candidate at its best onset, the least probable by chance first.
    pub(super) fn suspects(&mut self, onsets: &[Sums]) -> Vec<Suspect> {
        let mut all: Vec<Suspect> = Vec::new();
        for (number, candidate) in self.watched.candidates.iter().enumerate() {
            let mut best: Option<Suspect> = None;
            for (onset, begin) in onsets.iter().enumerate() {
                let (statistic, rank) =
                    self.score.test(&candidate.columns, &self.state, &self.windows.now, begin);
                if rank == 0 {
                    continue;
                }
                let statistic = statistic / self.scale;
                let log_p = log_tail(statistic, rank as f64);
                if best.is_none_or(|b| log_p < b.log_p) {
                    best = Some(Suspect { candidate: number, onset, statistic, rank, log_p });
                }
            }
            all.extend(best);
        }
        order::ascending(&mut all, |a| a.log_p);
        all
    }
}

//! Sums since onsets on a grid: windows of 8, 16, 32, … samples.
//!
//! At every second sample the window of one level ends: that of level `z` where 2 divides the
//! number of the sample `z + 1` times. So the work of all samples is alike. Level `z` has windows of
//! `2^(z+3)` samples, one every `2^(z+2)`. The sums at those samples are kept, three of each level,
//! and the sums within a window are differences.

use crate::monitor::kept::{Bytes, Keep, fields, keep};
use crate::monitor::state::{axpy, dot};

/// Sums that are kept of a level: at the end of a window, in its middle, and where it begins.
const KEPT: usize = 3;

/// Sums over all samples up to one of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sums {
    /// `Σ GᵀG`, row by row; the rows of columns that no candidate has are not filled.
    pub(crate) products: Vec<f64>,
    /// `Σ Gᵀy`.
    pub(crate) scores: Vec<f64>,
    /// The first row after them, and its place among the samples since the start.
    pub(crate) mark: Mark,
}

/// The row after which sums end.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Mark {
    /// Number of samples in the sums.
    pub(crate) samples: u64,
    /// Number of the last row in the sums, all rows counted, plus one.
    pub(crate) row: u64,
    /// Time of that row (s).
    pub(crate) time: Option<f64>,
}

/// The sums up to now, and up to the onsets.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    width: usize,
    levels: usize,
    /// Columns that candidates have: only their rows of the products are needed.
    tested: Vec<usize>,
    /// Columns that may be other than zero: rates of what has never changed are behind them.
    live: usize,
    /// The first row since the start.
    pub(crate) began: u64,
    pub(crate) now: Sums,
    /// Level by level, [`KEPT`] entries each.
    past: Vec<Sums>,
}

impl Sums {
    /// Of no sample.
    pub(crate) fn new(width: usize) -> Self {
        let (products, scores) = (vec![0.0; width * width], vec![0.0; width]);
        Self { products, scores, mark: Mark::default() }
    }

    /// Takes in one sample, with these columns of the candidates.
    pub(crate) fn take(&mut self, y: &[f64], g: &[f64], tested: &[usize]) {
        self.take_first(y, g, tested, self.scores.len());
    }

    /// As [`Sums::take`], where only the first `live` columns are not zero.
    #[inline(always)]
    fn take_first(&mut self, y: &[f64], g: &[f64], tested: &[usize], live: usize) {
        let width = self.scores.len();
        for (y, g) in y.iter().zip(g.chunks_exact(width)) {
            let g = &g[..live];
            axpy(*y, g, &mut self.scores);
            for &row in tested {
                if g[row] != 0.0 {
                    axpy(g[row], g, &mut self.products[row * width..row * width + live]);
                }
            }
        }
        self.mark.samples += 1;
    }

    /// The samples of these sums that are not in `before`.
    pub(crate) fn minus(&self, before: &Self) -> Self {
        let less = |all: &[f64], part: &[f64]| all.iter().zip(part).map(|(a, b)| a - b).collect();
        let products = less(&self.products, &before.products);
        Self { products, scores: less(&self.scores, &before.scores), mark: self.mark }
    }

    /// Adds other samples.
    pub(crate) fn add(&mut self, other: &Self) {
        axpy(1.0, &other.products, &mut self.products);
        axpy(1.0, &other.scores, &mut self.scores);
    }

    fn copy(&mut self, other: &Self) {
        self.products.copy_from_slice(&other.products);
        self.scores.copy_from_slice(&other.scores);
        self.mark = other.mark;
    }
}

impl Windows {
    /// Without samples. `width` is the number of columns of `G`; the longest window has
    /// `2^(levels + 2)` samples.
    pub(crate) fn new(width: usize, levels: usize, tested: Vec<usize>) -> Self {
        let past = (0..levels * KEPT).map(|_| Sums::new(width)).collect();
        Self { width, levels, tested, live: width, began: 0, now: Sums::new(width), past }
    }

    /// How often a window of a level ends, in samples.
    pub(crate) fn step(level: usize) -> f64 {
        2.0_f64.powi(level as i32 + 2)
    }

    /// With so many columns that may be other than zero, the first of all.
    pub(crate) fn with_live(mut self, live: usize) -> Self {
        self.live = live;
        self
    }

    /// Counts from here on that all columns may be other than zero.
    pub(crate) fn all_live(&mut self) {
        self.live = self.width;
    }

    /// Starts again after the last row, with these columns of the candidates.
    pub(crate) fn restart(&mut self, tested: Vec<usize>) {
        self.tested = tested;
        self.now.products.fill(0.0);
        self.now.scores.fill(0.0);
        self.now.mark.samples = 0;
        self.began = self.now.mark.row;
        self.past.iter_mut().for_each(|sums| sums.mark.samples = 0);
    }

    /// Adds one sample.
    #[inline(always)]
    pub(crate) fn add(&mut self, y: &[f64], g: &[f64], row: u64, time: Option<f64>) {
        self.now.take_first(y, g, &self.tested, self.live);
        (self.now.mark.row, self.now.mark.time) = (row + 1, time);
    }

    /// Keeps the sums of this sample; the level whose window ends here, and the onset where it
    /// begins, if there are samples enough.
    #[inline(always)]
    pub(crate) fn keep(&mut self) -> Option<(usize, usize)> {
        let n = self.now.mark.samples;
        if !n.is_multiple_of(2) {
            return None;
        }
        let level = n.trailing_zeros() as usize - 1;
        if level >= self.levels {
            return None;
        }
        let turn = (n >> (level + 2)) as usize;
        let begin = level * KEPT + (turn + 1) % KEPT;
        self.past[level * KEPT + turn % KEPT].copy(&self.now);
        // After a start the oldest onset of a level is not there yet.
        (turn + 1 >= KEPT).then_some((level, begin))
    }

    /// Counts from a state that has moved by `shift`: `y` is smaller by `G` times that.
    pub(crate) fn recentre(&mut self, shift: &[f64]) {
        let width = self.width;
        for sums in self.past.iter_mut().chain([&mut self.now]) {
            for &row in &self.tested {
                sums.scores[row] -= dot(shift, &sums.products[row * width..]);
            }
        }
    }

    /// The sums at an onset.
    #[inline(always)]
    pub(crate) fn onset(&self, kept: usize) -> &Sums {
        &self.past[kept]
    }

    /// All onsets since the start, oldest first.
    pub(crate) fn onsets(&self) -> Vec<usize> {
        let samples = |k: &usize| self.past[*k].mark.samples;
        let within = |k: &usize| samples(k) > 0 && samples(k) < self.now.mark.samples;
        let mut all: Vec<usize> = (0..self.past.len()).filter(within).collect();
        all.sort_by_key(samples);
        all
    }
}

impl Windows {
    /// True where a state that was read can be gone on from.
    pub(crate) fn fits(&self) -> bool {
        self.live <= self.width && self.tested.iter().all(|column| *column < self.width)
    }

    /// Lengths that a state cannot change.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = usize> {
        let own = |sums: &Sums| [sums.products.len(), sums.scores.len()];
        [&self.now].into_iter().chain(&self.past).flat_map(own)
    }
}

impl Keep for Windows {
    fn keep(&mut self, bytes: &mut Bytes) {
        fields!(bytes, self.tested, self.live, self.began, self.now);
        for sums in &mut self.past {
            // What was begun and dropped is not looked at again.
            sums.mark.keep(bytes);
            if sums.mark.samples > 0 {
                fields!(bytes, sums.products, sums.scores);
            }
        }
    }
}

keep!(Sums: products, scores, mark);
keep!(Mark: samples, row, time);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_of_each_level_ends_in_turn_and_its_sums_are_differences() {
        let mut windows = Windows::new(1, 4, vec![0]);
        let mut ended = [0_u64; 4];
        for n in 1..=400_u64 {
            windows.add(&[n as f64], &[1.0], n, None);
            let Some((level, onset)) = windows.keep() else { continue };
            ended[level] += 1;
            let begin = windows.onset(onset).mark.samples;
            assert_eq!(n - begin, 8 << level);
            let sum = windows.now.scores[0] - windows.onset(onset).scores[0];
            assert_eq!(sum, (begin + 1..=n).sum::<u64>() as f64);
        }
        // Every 4, 8, 16, 32 samples from 2, 4, 8, 16 on: 100, 50, 25 and 13 times up to 400 (the
        // last of them 16 + 12 · 32), less the two that begin the first window.
        assert_eq!(ended, [98, 48, 23, 11]);
    }

    #[test]
    fn after_a_start_no_window_reaches_back() {
        let mut windows = Windows::new(1, 3, vec![0]);
        for n in 0..57 {
            windows.add(&[1.0], &[1.0], n, None);
            windows.keep();
        }
        windows.restart(vec![0]);
        assert!(windows.onsets().is_empty());
        for n in 0..57 {
            windows.add(&[1.0], &[1.0], n, None);
            if let Some((level, onset)) = windows.keep() {
                assert_eq!(n + 1 - windows.onset(onset).mark.samples, 8 << level);
            }
        }
    }
}

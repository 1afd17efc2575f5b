//! Rows without labels that repeat held poses: told by the numbers of the samples, or by the readings.

use crate::numerics::order;
use crate::numerics::order::Ends;
use std::ops::Range;

use crate::screening::raw::poses::resolution;
use crate::screening::raw::rows::{Raw, span};

/// Rows that repeat differ by so many times less than poses: in motion all sizes between occur.
const APART: f64 = 30.0;

/// Poses that must have repeats.
const FEWEST: usize = 5;

/// Steps of rows that walk along a grid add up to how far they go; those of repeats to more than
/// this many times as much. Only a warning hangs on it.
const WALKED: f64 = 1.5;

/// Rows of the shortest table of which anything is said.
const SHORTEST: usize = 4;

/// Poses that nothing numbers. Rows are counted from 0.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "snake_case"))]
pub enum Unlabelled {
    /// Rows look like repeats of poses.
    Repeats {
        /// What shows it.
        by: Shown,
        /// Rows at which poses begin, the first aside.
        begins: Vec<usize>,
        /// True where the readings stand in between: they are repeats.
        stand: bool,
    },
    /// Groups of one size, within which rows are nearer to each other than to other groups: repeats in
    /// a small part of the range, or poses beside one another.
    Gathered {
        /// Rows of a group.
        size: usize,
    },
}

/// What shows poses that nothing numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Shown {
    /// The number of the sample begins again.
    Sample,
    /// Rows come in groups that repeat the same readings within noise.
    Readings,
}

/// Poses that nothing numbers; none where every row is a pose of its own. `sample` has the number of the
/// sample of each row. Of labelled poses only those are looked at that have one row each, and a number
/// of the sample that begins again.
#[must_use]
pub fn unlabelled(raw: &Raw<'_>, sample: Option<&[i64]>) -> Option<Unlabelled> {
    if raw.rows() < SHORTEST || raw.poses.len() < raw.rows() {
        return None;
    }
    let steps = Steps::of(raw);
    let begins: Vec<usize> =
        (1..raw.rows()).filter(|&r| sample.is_some_and(|s| s[r] <= s[r - 1])).collect();
    if !begins.is_empty() {
        let stand = steps.stand_between(&begins);
        let by = Shown::Sample;
        return (stand || !raw.held).then_some(Unlabelled::Repeats { by, begins, stand });
    }
    if raw.held || !raw.spans().iter().any(|&span| span > 0.0) {
        return None;
    }
    match steps.jumps(raw, finest(raw)) {
        Some(begins) => Some(Unlabelled::Repeats { by: Shown::Readings, begins, stand: true }),
        None => steps.group_size(raw).map(|size| Unlabelled::Gathered { size }),
    }
}

/// The largest change that rounding alone makes, in parts of the span of a channel that moves.
fn finest(raw: &Raw<'_>) -> f64 {
    let both = resolution(raw).into_iter().zip(raw.spans());
    both.filter(|(_, span)| *span > 0.0).map(|(own, span)| own / span).fold(0.0, f64::max)
}

/// Largest change of any channel from each row to the next, in parts of its span.
struct Steps(Vec<f64>);

impl Steps {
    fn of(raw: &Raw<'_>) -> Self {
        let spans = raw.spans();
        let step = |row: usize| {
            let both = raw.row(row - 1).iter().zip(raw.row(row)).zip(&spans);
            let moving = both.filter(|(_, span)| **span > 0.0);
            moving.map(|((a, b), span)| (b - a).abs() / span).fold(0.0, f64::max)
        };
        Self((1..raw.rows()).map(step).collect())
    }

    /// The largest step within a run of rows.
    fn within(&self, rows: &Range<usize>) -> f64 {
        self.0[rows.start..rows.end - 1].iter().copied().fold(0.0, f64::max)
    }

    /// The runs of rows that begin at the first row and at these.
    fn runs(&self, begins: &[usize]) -> Vec<Range<usize>> {
        let ends = begins.iter().copied().chain([self.0.len() + 1]);
        [0].iter().chain(begins).zip(ends).map(|(&start, end)| start..end).collect()
    }

    /// True where readings stand between most of these rows, and change at them.
    ///
    /// They change at a row where they do so by more than within both runs of rows that meet there. Of
    /// a motion this holds of one row in three at the most.
    fn stand_between(&self, begins: &[usize]) -> bool {
        let runs = self.runs(begins);
        let changes = |both: &&[Range<usize>]| {
            self.0[both[1].start - 1] > self.within(&both[0]).max(self.within(&both[1]))
        };
        let repeated = runs.iter().any(|run| run.len() > 1);
        repeated && 2 * runs.windows(2).filter(changes).count() > begins.len()
    }

    /// Rows at which groups of repeats begin, the first aside; none where rows are no repeats. `finest`
    /// is the largest step that rounding makes. What moves on from row to row is no repeat, however small its
    /// steps are beside the jump of an encoder that begins a turn anew, or of a recording that was interrupted.
    fn jumps(&self, raw: &Raw<'_>, finest: f64) -> Option<Vec<usize>> {
        let mut sizes = self.0.clone();
        order::sort(&mut sizes);
        let times = |k: usize| sizes[k].max(finest) / sizes[k - 1].max(finest);
        // The first of those that are equally large.
        let at = (1..sizes.len()).rev().greatest_by(|&a| times(a))?;
        let begins: Vec<usize> =
            (1..=self.0.len()).filter(|&row| self.0[row - 1] >= sizes[at]).collect();
        // Noise goes to and fro: it does not reach further than twice its largest step.
        let reach = 2.0 * sizes[at - 1].max(finest);
        let spans = raw.spans();
        let stands = |run: &&Range<usize>| {
            let mut moving = spans.iter().enumerate().filter(|(_, whole)| **whole > 0.0);
            run.len() > 1 && moving.all(|(c, whole)| span(raw.part(run, c)) <= reach * whole)
        };
        let several = self.runs(&begins).iter().filter(stands).count();
        (times(at) >= APART && several >= FEWEST && 2 * several >= begins.len()).then_some(begins)
    }

    /// The size of groups of rows, if from each to the next more changes than within any of them.
    ///
    /// By chance the largest steps stand at equal distances once in as many sessions as there are ways
    /// to place them.
    fn group_size(&self, raw: &Raw<'_>) -> Option<usize> {
        let rows = raw.rows();
        let sizes = (3..=rows / FEWEST).filter(|size| rows.is_multiple_of(*size));
        sizes.into_iter().find(|&size| {
            let groups = || (0..rows).step_by(size).map(|start| start..start + size);
            let between = self.0[size - 1..].iter().step_by(size).copied();
            let between = between.fold(f64::INFINITY, f64::min);
            // A group reaches as far as its largest step: most sizes are out by that.
            if between <= groups().map(|group| self.within(&group)).fold(0.0, f64::max) {
                return false;
            }
            let reach = |(c, whole): (usize, &f64)| {
                let widest = groups().map(|group| span(raw.part(&group, c))).fold(0.0, f64::max);
                (*whole > 0.0).then(|| (widest / whole, c, *whole))
            };
            let spans = raw.spans();
            let reached = spans.iter().enumerate().filter_map(reach);
            let Some((reach, c, whole)) = reached.rev().greatest_by(|a| a.0) else {
                return false;
            };
            let steps = groups().flat_map(|group| {
                let own = raw.part(&group, c);
                own.clone().skip(1).zip(own).map(|(b, a)| (b - a).abs() / whole)
            });
            // What walks on from row to row ends as far away as it has gone.
            let to_and_fro = (size - 1) as f64 * steps.fold(0.0, f64::max) > WALKED * reach;
            to_and_fro && between > reach
        })
    }
}

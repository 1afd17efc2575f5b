//! A change that goes on: a parameter that moves by the same amount in every row.
//!
//! A sensor that drifts is a step `θ` at the onset `τ` with a rate `ρ` beside it,
//!
//! ```text
//! θ_t = θ + ρ (t - τ),     t in rows                                     (106)
//! ```
//!
//! `ρ` is a column like any other: that of its parameter times the age `t - τ`. So all that
//! holds of a change that stands still, (102) and (105), holds of one that goes on.
//!
//! Rows before a change was named are gone, but for the last few; their sums are kept on the
//! grid of onsets. There the age of all rows between two marks is taken for that in their middle.

use crate::monitor::windows::{Sums, Windows};

/// The rate of one parameter. Both are positions in [`super::watched::Watched::order`].
#[derive(Debug, Clone)]
pub(crate) struct Drift {
    /// Column of the rate.
    pub(crate) own: usize,
    /// Column of the parameter.
    pub(crate) base: usize,
    /// The row from which the parameter counts; none as long as it has never changed.
    pub(crate) since: Option<u64>,
}

impl Drift {
    /// Age of a row, if the parameter has ever changed.
    #[inline(always)]
    pub(crate) fn age(&self, row: u64) -> Option<f64> {
        self.since.map(|since| row as f64 - since as f64)
    }
}

/// Sums of the samples after `begin`, the row `since` being the first of them, with the columns and
/// rows of these drifts counted from there.
pub(crate) fn sums_since(windows: &Windows, begin: &Sums, since: u64, drifts: &[&Drift]) -> Sums {
    let inside = |mark: u64| mark > begin.mark.samples;
    let kept = windows.onsets().into_iter().map(|kept| windows.onset(kept));
    let mut ends: Vec<&Sums> = kept.filter(|sums| inside(sums.mark.samples)).collect();
    ends.push(&windows.now);
    let width = begin.scores.len();
    let mut all = Sums::new(width);
    let (mut before, mut row) = (begin, since);
    for end in ends {
        let mut part = end.minus(before);
        let age = 0.5 * (row as f64 + end.mark.row as f64 - 1.0) - since as f64;
        for drift in drifts {
            for sums in part.products.chunks_exact_mut(width) {
                sums[drift.own] = age * sums[drift.base];
            }
        }
        for drift in drifts {
            for column in 0..width {
                part.products[drift.own * width + column] =
                    age * part.products[drift.base * width + column];
            }
            part.scores[drift.own] = age * part.scores[drift.base];
        }
        all.add(&part);
        (before, row) = (end, end.mark.row);
    }
    all.mark = windows.now.mark;
    all
}

//! Exchanged channels of followers that are late.
//!
//! Where followers are late, no loop closes as long as they move, with wires exchanged or not. But the course of each
//! follower is that of one leader, some rows later. For a leader `a` and a follower `b`, with the correlation `r`
//! of the leader's rows and the follower's `k` rows later, what is left of a line of one over the other is
//!
//! ```text
//! u_ab(k) = 1 - r²                                                                          (158)
//! ```
//!
//! of its variance. The likeliest exchange of two followers `i` and `j` is that of the least `u_ij + u_ji`. Undone, with all
//! followers `k` rows earlier, it must close the loops as any other mistake: by far better than the likeliest `k` by itself.

use crate::estimate::miswired::again::DECISIVE;
use crate::estimate::miswired::mistake::Mistake;
use crate::estimate::miswired::rewired::Rewired;
use crate::estimate::observations::Observations;
use crate::estimate::search::{StartSearch, anchored};
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::numerics::order::Ends;
use crate::readings::Readings;

/// Rows by which followers may be late: one second at 30 rows a second.
const FARTHEST: usize = 30;

/// The exchange with which the loops of a recording close beside a delay of all followers; none where there is
/// none, or they close with a delay alone. `best` is χ² per equation as declared.
pub(crate) fn suspect(search: &StartSearch<'_>, best: f64) -> Option<Suspicion> {
    let of = search.observations;
    let pairs = of.mechanism.equal_channels();
    if of.readings.held || !of.readings.timed || of.is_long() || pairs.len() < 2 {
        return None;
    }
    let late = Late { search, pairs };
    let [i, j, rows] = late.exchanged()?;
    let wires = [late.pairs[i][1], late.pairs[j][1]];
    let with = late.left(Some(&Mistake::Exchanged(wires)), rows)?;
    let good_start = of.options.good_start;
    if with >= good_start.min(best / DECISIVE) {
        return None;
    }
    let declared = late.left(None, late.declared()?)?.min(best);
    let closes = Closes { with, declared };
    (with < declared / DECISIVE).then_some(Suspicion::Exchanged {
        channels: vec![wires],
        closes,
        late: true,
    })
}

/// Leaders and followers that are late by some rows.
struct Late<'a> {
    search: &'a StartSearch<'a>,
    pairs: Vec<[usize; 2]>,
}

impl Late<'_> {
    /// Two pairs, and by how many rows their followers are late, that are most alike when exchanged.
    fn exchanged(&self) -> Option<[usize; 3]> {
        let n = self.pairs.len();
        let two = (0..n).flat_map(|i| (i + 1..n).map(move |j| [i, j]));
        let all = two.flat_map(|[i, j]| (0..=FARTHEST).map(move |rows| [i, j, rows]));
        let left = |[i, j, rows]: [usize; 3]| self.apart(i, j, rows) + self.apart(j, i, rows);
        all.map(|one| (left(one), one)).least_by(|a| a.0).map(|best| best.1)
    }

    /// Rows by which the followers are late if none are exchanged.
    fn declared(&self) -> Option<usize> {
        let left = |rows| (0..self.pairs.len()).map(|i| self.apart(i, i, rows)).sum::<f64>();
        let all = (0..=FARTHEST).map(|rows| (left(rows), rows));
        all.least_by(|a| a.0).map(|best| best.1)
    }

    /// (158) of a leader and a follower.
    fn apart(&self, leader: usize, follower: usize, rows: usize) -> f64 {
        let Observations { readings, weights, .. } = self.search.observations;
        let counts = |row: &usize| {
            weights[*row] > 0.0 && later(readings, *row, rows).is_some_and(|to| weights[to] > 0.0)
        };
        let value =
            |row: usize, channel: usize| readings.table.values[row * readings.channels + channel];
        let [a, b] = [self.pairs[leader][0], self.pairs[follower][1]];
        let (mut n, mut sum, mut square) = (0.0, [0.0; 2], [0.0; 3]);
        for row in (0..readings.samples).filter(counts) {
            let x = value(row, a) - readings.mean[a];
            let y = value(row + rows, b) - readings.mean[b];
            n += 1.0;
            sum = [sum[0] + x, sum[1] + y];
            square = [square[0] + x * x, square[1] + x * y, square[2] + y * y];
        }
        let of = |k: usize, i: usize, j: usize| square[k] - sum[i] * sum[j] / n;
        let apart = 1.0 - of(1, 0, 1).powi(2) / (of(0, 0, 0) * of(2, 1, 1));
        if apart.is_finite() { apart } else { 1.0 }
    }

    /// χ² per equation with a mistake undone and all followers so many rows earlier.
    fn left(&self, mistake: Option<&Mistake>, rows: usize) -> Option<f64> {
        let Observations { mechanism, readings, weights, .. } = self.search.observations;
        let (counted, mut weights) = (weights, weights.clone());
        let mut table = readings.table.clone();
        for (row, weight) in weights.iter_mut().enumerate() {
            match later(readings, row, rows).filter(|&to| counted[to] > 0.0) {
                None => *weight = 0.0,
                Some(to) => self.pairs.iter().for_each(|&[_, follower]| {
                    let own = |row: usize| row * readings.channels + follower;
                    table.values[own(row)] = readings.table.values[own(to)];
                }),
            }
        }
        let earlier = Readings::beside(mechanism, table, readings).ok()?;
        let all = self.search.observations;
        let Rewired { readings, observations } = match mistake {
            Some(mistake) => mistake.undone(all, &earlier)?,
            None => Rewired { readings: earlier, observations: all.clone() },
        };
        let start = anchored(&observations, self.search.model, &vec![1.0; readings.channels]);
        Some(self.search.end_with(&readings, &weights, &start).score)
    }
}

/// The row so many rows later; none beyond the end of its session.
fn later(readings: &Readings, row: usize, rows: usize) -> Option<usize> {
    let table = &readings.table;
    let to = row + rows;
    (to < readings.samples && table.session_of(row) == table.session_of(to)).then_some(to)
}

//! Poses chosen from candidates.
//!
//! From a start, or from nothing, poses are taken one after the other. Then each is exchanged for the
//! candidate that is best beside all others (Fedorov 1972), once or until no exchange helps. The
//! chosen poses are refined among others around them.

use crate::numerics::order;
use crate::numerics::order::Ends;
use std::cmp::Ordering;

use crate::Error;
use crate::design::candidates::{Candidates, Space};
use crate::design::linearised::Whitened;
use crate::numerics::random::Random;
use crate::numerics::workers;

/// Chosen poses are refined among poses around them, within these shares of the box.
const CLOSER: [f64; 3] = [0.15, 0.05, 0.02];

/// Poses around all chosen ones in a round.
const AROUND: usize = 400;

/// Candidates that are scored in one piece of work.
const TOGETHER: usize = 64;

/// What is made small, a natural logarithm, of the candidates that are taken.
pub(crate) trait Measure: Sync {
    /// Of those that are taken.
    fn now(&self) -> f64;

    /// With one more.
    fn with(&self, candidate: usize) -> f64;

    /// Takes one more.
    fn take(&mut self, candidate: usize);

    /// Gives one back.
    fn leave(&mut self, candidate: usize);
}

/// How poses are chosen.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    /// Number of poses.
    pub(crate) poses: usize,
    /// Reading of where the way begins.
    pub(crate) from: Vec<f64>,
    /// Weight of the way, in units of the measure.
    pub(crate) way: f64,
    /// Times that each pose is exchanged at the most.
    pub(crate) sweeps: usize,
    /// True where a pose may be visited more than once.
    pub(crate) again: bool,
}

impl Choice {
    /// Poses beside those of a start, each exchanged; in an order of short ways, with the measure and
    /// the weight of the way.
    pub(crate) fn of(
        &self,
        mut measure: impl Measure,
        found: &Candidates,
        start: &[usize],
    ) -> (Vec<usize>, f64) {
        let mut chosen = start.to_vec();
        start.iter().for_each(|&k| measure.take(k));
        let most = if self.again { self.poses } else { self.poses.min(found.len()) };
        while chosen.len() < most {
            let from = chosen.last().map_or(&self.from[..], |&k| found.row(k));
            let (_, best) = least(found.len(), self.closed_to(&chosen), |k| {
                measure.with(k) + self.way * found.distance(from, found.row(k))
            });
            measure.take(best);
            chosen.push(best);
        }
        // A single pose was chosen from all, with its way.
        let sweeps = if start.is_empty() && most < 2 { 0 } else { self.sweeps };
        for _ in 0..sweeps {
            if !self.exchange(&mut measure, found.len(), &mut chosen) {
                break;
            }
        }
        let (order, way) = found.tour(chosen, &self.from);
        (order, measure.now() + self.way * way)
    }

    /// Exchanges each pose where another one is better; true where one was.
    fn exchange(&self, measure: &mut impl Measure, count: usize, chosen: &mut [usize]) -> bool {
        let mut changed = false;
        for place in 0..chosen.len() {
            let own = chosen[place];
            measure.leave(own);
            let others: Vec<usize> = chosen.iter().copied().filter(|&k| k != own).collect();
            let (score, best) = least(count, self.closed_to(&others), |k| measure.with(k));
            if score < measure.with(own) - 1e-9 {
                chosen[place] = best;
                changed = true;
            }
            measure.take(chosen[place]);
        }
        changed
    }

    /// Those of the chosen poses that are not to be chosen again.
    fn closed_to<'a>(&self, chosen: &'a [usize]) -> &'a [usize] {
        if self.again { &[] } else { chosen }
    }
}

/// Poses, their rows, and those that are chosen: from all candidates, the best of several starts;
/// then from others around the chosen ones, round by round, where that is better.
pub(crate) fn refined(
    choose: impl Fn(&Whitened, &Candidates, &[usize]) -> (Vec<usize>, f64) + Sync,
    rows_of: impl Fn(&Candidates) -> Result<Whitened, Error>,
    (mut found, mut rows): (Candidates, Whitened),
    starts: &[Vec<usize>],
    space: &Space<'_>,
    random: &mut Random,
) -> Result<(Candidates, Whitened, Vec<usize>), Error> {
    let all = workers::map(starts, |start| choose(&rows, &found, start));
    let best = all.into_iter().least_by(|a| a.1);
    let (mut chosen, mut score) = best.unwrap_or_default();
    for share in CLOSER {
        let each = AROUND.div_ceil(chosen.len().max(1));
        let Some(near) = space.around(&found.some(&chosen), (share, each), random)? else { break };
        let rows_near = rows_of(&near)?;
        let same: Vec<usize> = (0..chosen.len().min(near.len())).collect();
        let (other, better) = choose(&rows_near, &near, &same);
        if better < score {
            (found, rows, chosen, score) = (near, rows_near, other, better);
        }
    }
    Ok((found, rows, chosen))
}

/// The candidate with the least score, of those not taken; ties to the first. What has no number as score comes last.
pub(crate) fn least(
    count: usize,
    taken: &[usize],
    score: impl Fn(usize) -> f64 + Sync,
) -> (f64, usize) {
    let none = (f64::INFINITY, usize::MAX);
    let of = |score: f64| if score.is_nan() { f64::INFINITY } else { score };
    let first =
        |a: (f64, usize), b: (f64, usize)| match order::compare(b.0, a.0).then(b.1.cmp(&a.1)) {
            Ordering::Less => b,
            _ => a,
        };
    let parts = workers::map((0..count).step_by(TOGETHER), |from| {
        let open = (from..count.min(from + TOGETHER)).filter(|k| !taken.contains(k));
        open.map(|k| (of(score(k)), k)).fold(none, first)
    });
    parts.into_iter().fold(none, first)
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;
    use crate::design::precision::{Known, Precision};
    use crate::numerics::symmetric::invert;
    use crate::readings::Table;

    /// Poses of two equations and four parameters, and where one channel reads at each.
    fn candidates(count: usize, seed: u64) -> (Candidates, Whitened) {
        let mut random = Random::new(seed);
        let mut drawn = |n: usize| (0..n).map(|_| random.uniform(-1.0, 1.0)).collect::<Vec<f64>>();
        let table = Table { values: drawn(count), ..Table::default() };
        let found = Candidates { poses: vec![], table, channels: 1, span: vec![[-1.0, 1.0]] };
        (found, Whitened { equations: 2, width: 4, values: drawn(8 * count) })
    }

    fn choice(poses: usize, again: bool) -> Choice {
        Choice { poses, from: vec![0.0], way: 0.0, sweeps: 50, again }
    }

    #[test]
    fn what_has_no_score_is_taken_last() {
        let score = |k: usize| [f64::NAN, 3.0, -f64::NAN, 2.0][k];
        assert_eq!(least(4, &[], score).1, 3);
        assert_eq!(least(4, &[3], score).1, 1);
        assert_eq!(least(4, &[1, 3], score), (f64::INFINITY, 0));
    }

    /// `ln tr C`, or `ln det C`, of some poses beside a trace of everything, by dense matrices.
    fn judged(rows: &Whitened, chosen: &[usize], volume: bool) -> f64 {
        let w = Mat::from_fn(2 * chosen.len(), 4, |i, j| rows.of(chosen[i / 2])[i % 2 * 4 + j]);
        let n = w.transpose() * &w + Mat::<f64>::identity(4, 4) * FAINT;
        let c = invert(&n).0;
        match volume {
            true => -n.determinant().ln() + 4.0 * FAINT.ln(),
            false => (0..4).map(|i| c[(i, i)]).sum::<f64>().ln(),
        }
    }

    const FAINT: f64 = 1e-6;

    fn known(rows: &Whitened, volume: bool) -> Known<'_> {
        let faint = Mat::<f64>::identity(4, 4) * FAINT;
        let omega = (!volume).then(|| Mat::identity(4, 4));
        Known { precision: Precision::new(&faint, omega), rows }
    }

    #[test]
    fn no_single_exchange_improves_a_choice() {
        let (found, rows) = candidates(30, 5);
        for (volume, start) in
            [(true, &[0, 1, 2, 3, 4][..]), (false, &[0, 0, 0, 0, 0]), (false, &[])]
        {
            let (chosen, score) = choice(5, true).of(known(&rows, volume), &found, start);
            let here = judged(&rows, &chosen, volume);
            assert!((score - here).abs() < 1e-6, "{score} is not {here}");
            for place in 0..5 {
                for other in 0..30 {
                    let mut changed = chosen.clone();
                    changed[place] = other;
                    assert!(judged(&rows, &changed, volume) > here - 1e-8, "{place} -> {other}");
                }
            }
        }
    }

    #[test]
    fn two_poses_are_the_best_of_all_pairs() {
        let (found, rows) = candidates(20, 6);
        let pairs = (0..20).flat_map(|a| (0..a).map(move |b| [a, b]));
        let least = pairs.map(|pair| judged(&rows, &pair, false)).fold(f64::INFINITY, f64::min);
        let starts = [[0, 1], [5, 10], [13, 2], [7, 8]];
        let of = |start: [usize; 2]| choice(2, false).of(known(&rows, false), &found, &start).1;
        let best = starts.map(of).into_iter().fold(f64::INFINITY, f64::min);
        assert!((best - least).abs() < 1e-6, "{best} is not {least}");
    }

    #[test]
    fn poses_are_chosen_once_unless_they_may_be_visited_again() {
        let (found, rows) = candidates(3, 7);
        let of = |again| choice(5, again).of(known(&rows, true), &found, &[]).0;
        let mut once = of(false);
        once.sort_unstable();
        assert_eq!((once, of(true).len()), (vec![0, 1, 2], 5));
    }
}

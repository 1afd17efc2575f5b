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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::score::Score;
    use crate::monitor::state::State;
    use crate::numerics::random::Random;

    /// A parameter that moves by 0.01 a row from row 500 on, found in row 1000.
    #[test]
    fn a_rate_is_estimated_from_sums_on_the_grid() {
        let (own, base) = (1, 0);
        let drift = Drift { own, base, since: Some(500) };
        let mut random = Random::new(4);
        let mut windows = Windows::new(2, 10, vec![base]);
        let mut begin = windows.now.clone();
        for row in 0..1000 {
            if row == 500 {
                begin = windows.now.clone();
            }
            let g = [random.uniform(-1.0, 1.0), 0.0];
            let moved = 0.3 + 0.01 * drift.age(row).expect("counted");
            let y = random.uniform(-1.0, 1.0) + if row < 500 { 0.0 } else { g[0] * moved };
            windows.add(&[y], &g, row, None);
            windows.keep();
        }
        let within = sums_since(&windows, &begin, 500, &[&drift]);
        let state = State::new(Vec::new(), 0, 2, 1);
        let mut score = Score::new(2);
        score.test(&[base, own], &state, &within, &Sums::new(2));
        let (found, covariance) = score.estimate(&[0.0, 0.0]).expect("regular");
        // Noise of variance 1/3, and what the middle of a part leaves of a ramp.
        for (k, truth) in [0.3, 0.01].into_iter().enumerate() {
            let sd = covariance[(k, k)].sqrt();
            assert!((found[k] - truth).abs() < 2.0 * sd, "{k}: {} ± {sd}", found[k]);
        }
        // Beside a step, n rows tell a rate to √(12/(n³ var g)), with their own ages: 0.00054.
        assert!((0.0005..0.0007).contains(&covariance[(1, 1)].sqrt()));
    }

    #[test]
    fn a_parameter_is_counted_from_where_its_rate_has_moved_it() {
        let mut state = State::new(vec![0.04, 0.01, 0.01, 0.09], 2, 2, 1);
        state.mean = vec![1.0, 0.5];
        state.move_on(0, 1, 10.0);
        assert_eq!(state.mean, [6.0, 0.5]);
        // 0.04 + 2·10·0.01 + 100·0.09 and 0.01 + 10·0.09
        let expected = [9.24, 0.91, 0.91, 0.09];
        for (found, expected) in state.covariance.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12);
        }
    }
}

//! Codes of a reading: the step of the grid on which readings of a channel lie.
//!
//! A coarse encoder knows few codes, whatever its unit. With sorted distinct readings and
//! their gaps `d`, the step `s` is that of
//!
//! ```text
//! d_i = m_i s,    m_i whole,    s = Σ d_i m_i / Σ m_i²                     (60)
//! ```
//!
//! The step of a counter is one count, or the whole number of counts of which all differences of
//! its readings are multiples.

use crate::numerics::order;
use std::collections::HashSet;

/// A gap may differ from whole steps by this part of a step: readings may have been rounded
/// again when they were written, to a tenth of a step or finer.
const OFF: f64 = 0.1;

/// Probability that gaps of continuous readings are taken for whole steps: of one gap
/// `2 OFF`, and all must be.
const CHANCE: f64 = 1e-6;

/// Whole numbers up to here are exact.
const WHOLE: f64 = 9e15;

/// The step of each channel of `values`, of which `counts` says whether it is a counter; zero where
/// readings lie on no grid. `held` says that rows are of poses.
#[must_use]
pub fn steps(values: &[f64], counts: &[bool], held: bool) -> Vec<f64> {
    (0..counts.len()).map(|c| step_of(values, counts, held, c)).collect()
}

/// The step of one channel, as [`steps`] has it.
pub(super) fn step_of(values: &[f64], counts: &[bool], held: bool, channel: usize) -> f64 {
    let channels = counts.len();
    let column = values.iter().skip(channel).step_by(channels).copied();
    if counts[channel] {
        return counts_of_a_step(column).unwrap_or(1.0);
    }
    let visits = || visits(values, channels, held, channel);
    step(column.collect(), visits).unwrap_or(0.0)
}

/// How often a channel went to what it reads: a row that a logger has written again is none, nor are readings of
/// a held pose that stay.
fn visits(values: &[f64], channels: usize, held: bool, channel: usize) -> usize {
    let bits = |row: &&[f64]| row.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let mut seen = HashSet::new();
    let rows = values.chunks_exact(channels).filter(|row| seen.insert(bits(row)));
    let mut readings: Vec<f64> = rows.map(|row| row[channel]).collect();
    if held {
        readings.dedup();
    }
    readings.len()
}

/// The counts of a step of these readings of one counter; none where a step is one count.
fn counts_of_a_step(readings: impl Iterator<Item = f64>) -> Option<f64> {
    let mut readings = readings.peekable();
    let first = *readings.peek()?;
    let (mut step, mut codes) = (0, HashSet::new());
    for reading in readings {
        let apart = (reading - first).abs();
        if apart.fract() != 0.0 || apart > WHOLE {
            return None;
        }
        step = common_divisor(step, apart as u64);
        if step == 1 {
            return None;
        }
        codes.insert(reading.to_bits());
    }
    // Of two codes the difference gives the step, and each other one repeats it by chance.
    let told = codes.len().saturating_sub(2) as i32;
    (step > 1 && (step as f64).powi(-told) <= CHANCE).then_some(step as f64)
}

fn common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The step of these readings of one channel, which went so often to what it reads; none where they lie on
/// no grid.
fn step(mut sorted: Vec<f64>, visits: impl Fn() -> usize) -> Option<f64> {
    order::sort(&mut sorted);
    sorted.dedup();
    let gaps: Vec<f64> = sorted.windows(2).map(|w| w[1] - w[0]).collect();
    // The smallest gap is the first guess; it gives the first multiple, and says nothing.
    let told = gaps.len().saturating_sub(1) as i32;
    if (2.0 * OFF).powi(told) > CHANCE {
        return None;
    }
    // Where readings are few, no two of them need be neighbours.
    let least = gaps.iter().copied().fold(f64::INFINITY, f64::min);
    let step = (1..=4).find_map(|parts| fitted(&gaps, least / f64::from(parts)))?;
    // Even steps of whoever placed the joint are no codes: a sensor repeats some and skips others.
    let even = gaps.iter().all(|gap| (gap / step).round() == (gaps[0] / step).round());
    let placed = even && by_design(visits(), sorted.len());
    (!placed).then_some(step)
}

/// True where so many visits read each of these codes and skip none, and a sensor would not: each once, or,
/// visits of one code being nearly a Poisson variable, with less than this chance.
fn by_design(visits: usize, codes: usize) -> bool {
    let skipped = codes as f64 * (-(visits as f64) / codes as f64).exp();
    visits <= codes || (-skipped).exp() < CHANCE
}

/// Eq. (60) from a first guess, small gaps first: each makes the step sharper for the next.
fn fitted(gaps: &[f64], guess: f64) -> Option<f64> {
    let mut sorted = gaps.to_vec();
    order::sort(&mut sorted);
    let (mut step, mut along, mut square) = (guess, 0.0, 0.0);
    for gap in sorted {
        let whole = (gap / step).round().max(1.0);
        if (gap / step - whole).abs() > OFF {
            return None;
        }
        along += gap * whole;
        square += whole * whole;
        step = along / square;
    }
    Some(step)
}

#[cfg(test)]
mod tests {
    use super::{step_of, steps};

    /// Numbers between 0 and 6 that follow no rule.
    fn odd(i: usize) -> f64 {
        6.0 * (0.5 + 0.618_033_988_749_895 * i as f64).fract()
    }

    /// The step of a sensor alone, each of whose readings is a visit.
    fn step(readings: impl Iterator<Item = f64>) -> Option<f64> {
        let beside = |(i, reading): (usize, f64)| [reading, odd(11 * i + 5)];
        let values: Vec<f64> = readings.enumerate().flat_map(beside).collect();
        let step = step_of(&values, &[false; 2], true, 0);
        (step > 0.0).then_some(step)
    }

    #[test]
    fn a_grid_is_found_by_its_step() {
        let found = step((0..150).map(|i| (odd(i) / 5e-3).round() * 5e-3));
        assert!(found.is_some_and(|s| (s / 5e-3 - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_grid_is_found_through_the_digits_of_a_file() {
        let code = std::f64::consts::TAU / 4096.0;
        let printed = |v: f64| (v * 1e6).round() / 1e6;
        // Readings of a session lie anywhere: some of them are neighbours.
        let anywhere = |i: usize| odd(i) * odd(7 * i + 3) / 6.0;
        let found = step((0..150).map(|i| printed((anywhere(i) / code).round() * code)));
        // Rounded to 1e-6, of a step of 1.5e-3: 150 gaps tell the step to 1e-5.
        assert!(found.is_some_and(|s| (s / code - 1.0).abs() < 1e-4), "{found:?}");
    }

    #[test]
    fn a_counter_that_skips_counts_has_their_step() {
        let counts = |i: usize| (100.0 * odd(i)).round();
        let coarse = |i: usize| 512.0 + 3.0 * counts(7 * i + 3);
        let rows: Vec<f64> =
            (0..60).flat_map(|i| [counts(i), coarse(i), 0.25 * counts(i)]).collect();
        assert_eq!(steps(&rows, &[true; 3], true), [1.0, 3.0, 1.0]); // the third is of means
        // A dozen even counts are chance: one dozen in 2,000 of them is.
        let few: Vec<f64> = (0..12).map(|i| 2.0 * counts(i)).collect();
        assert_eq!(steps(&few, &[true], true), [1.0]);
    }

    #[test]
    fn poses_at_even_steps_are_no_codes() {
        let turned = |i: usize| 0.1 * i as f64 + 1e-4 * (odd(i) - 3.0); // by hand, and read finely
        assert!(step((0..60).map(turned)).is_none());
        // A logger has written one row again, or each of them; a drive stands still for four samples.
        let again = |rows: Vec<usize>| -> Vec<f64> {
            rows.iter().flat_map(|&i| [turned(i), odd(i)]).collect()
        };
        for rows in [(0..60).chain([20]).collect(), (0..120).map(|i| i / 2).collect()] {
            assert_eq!(steps(&again(rows), &[false; 2], false)[0], 0.0);
        }
        let stands: Vec<f64> = (0..240).flat_map(|i| [turned(i / 4), odd(i)]).collect();
        assert_eq!(steps(&stands, &[false; 2], true)[0], 0.0);
    }

    #[test]
    fn a_coarse_sensor_that_skips_no_code_has_them() {
        // Of 13 codes 150 poses skip one in 8,000 cases.
        assert!(step((0..150).map(|i| (2.0 * odd(i)).round())).is_some_and(|s| s == 1.0));
        // A slow motion reads one after the other, beside a sensor that reads finely.
        let slow: Vec<f64> = (0..150).flat_map(|i| [f64::from(i / 5), odd(i as usize)]).collect();
        assert_eq!(steps(&slow, &[false; 2], false)[0], 1.0);
    }

    #[test]
    fn continuous_readings_have_none() {
        assert!(step((0..150).map(|i| odd(i) + 0.1 * odd(7 * i + 3))).is_none());
        assert!(step([1.0, 2.0, 3.0].into_iter()).is_none());
    }
}

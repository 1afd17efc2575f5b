//! When and where what is left lies: in which poses, at which readings, from which side.

use crate::diagnosis::trace::Traced;
use crate::numerics::order;
use crate::numerics::order::Ends;

/// Parts into which the session, and the range of a channel, are divided.
const PARTS: usize = 6;

/// A part stands out that has this share of what is left,
const SHARE: f64 = 0.4;

/// and this many times its own share of the poses.
const DENSE: f64 = 2.0;

/// Difference between the two directions of approach, in standard deviations.
const SIDES: f64 = 4.0;

/// What is left in one pose, as an error of one channel.
struct Wrong {
    /// Error over its variance: `aᵀr`.
    pull: f64,
    /// Inverse variance: `aᵀa`.
    weight: f64,
    reading: f64,
    side: f64,
    label: i64,
}

impl Wrong {
    /// χ² that it takes up beyond what it would of noise.
    fn excess(&self) -> f64 {
        self.pull * self.pull / self.weight - 1.0
    }
}

/// Where errors of a channel would lie that made what is left; nothing is known where they
/// would lie anywhere.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Location {
    /// The channel.
    pub channel: Option<usize>,
    /// True where the labels are of held poses, not of rows of a recording.
    pub held: bool,
    /// First and last label of a part of the session that has so many per cent.
    pub labels: Option<([i64; 2], f64)>,
    /// Lowest and highest reading of a part of the range that has so many per cent.
    pub readings: Option<([f64; 2], f64)>,
    /// True where the sign is that of the direction of approach.
    pub sided: bool,
}

/// Where errors of a channel would lie that made what is left.
#[must_use]
pub fn location(traced: &Traced, channel: usize) -> Location {
    let errors = errors_of(traced, channel);
    let labels = dense(&errors).map(|(first, last, share)| {
        let labels = [errors[first].label, errors[last].label];
        (labels, share)
    });
    let mut by_reading: Vec<&Wrong> = errors.iter().collect();
    order::ascending(&mut by_reading, |a| a.reading);
    let readings = dense_of(&by_reading)
        .map(|(first, last, share)| ([by_reading[first].reading, by_reading[last].reading], share));
    let pull: f64 = errors.iter().map(|e| e.side * e.pull).sum();
    let weight: f64 = errors.iter().map(|e| e.side * e.side * e.weight).sum();
    // Judged against what is left, which is more than noise.
    let spread = errors.iter().map(|e| e.excess() + 1.0).sum::<f64>() / errors.len().max(1) as f64;
    let sided = weight > 0.0 && pull.abs() > SIDES * (weight * spread.max(1.0)).sqrt();
    let held = traced.small.readings.held;
    Location { channel: Some(channel), held, labels, readings, sided }
}

fn errors_of(traced: &Traced, channel: usize) -> Vec<Wrong> {
    let (observations, residuals) = (&traced.small, &traced.last.residuals);
    let (readings, k, c) =
        (&observations.readings, residuals.equations, observations.readings.channels);
    let mut side = vec![0.0; readings.samples];
    for (block, meta) in readings.blocks().iter().enumerate() {
        for (row, lane) in meta.rows.iter().zip(0..meta.live) {
            side[*row] = readings.approach(block)[channel].0[lane];
        }
    }
    let error = |row: usize| {
        let a = |e: usize| residuals.by_reading[(row * k + e) * c + channel];
        let pull = (0..k).map(|e| a(e) * residuals.whitened[row * k + e]).sum();
        let weight = (0..k).map(|e| a(e) * a(e)).sum();
        let (reading, label) = (readings.row(row)[channel], readings.labels[readings.pose[row]]);
        Wrong { pull, weight, reading, side: side[row], label }
    };
    (0..readings.samples)
        .filter(|&row| observations.weights[row] > 0.0)
        .map(error)
        .filter(|e| e.weight > 0.0)
        .collect()
}

fn dense(errors: &[Wrong]) -> Option<(usize, usize, f64)> {
    dense_of(&errors.iter().collect::<Vec<_>>())
}

/// The densest part of a sequence: its first and last, and its share in per cent.
fn dense_of(errors: &[&Wrong]) -> Option<(usize, usize, f64)> {
    let all: f64 = errors.iter().map(|e| e.excess()).sum();
    let n = errors.len();
    let part = |p: usize| (n * p / PARTS, n * (p + 1) / PARTS);
    let share = |p: usize| {
        let (first, end) = part(p);
        errors[first..end].iter().map(|e| e.excess()).sum::<f64>() / all
    };
    let best = (0..PARTS).greatest_by(|&a| share(a))?;
    let (first, end) = part(best);
    let enough = n >= 4 * PARTS && all > 0.0 && share(best) >= SHARE;
    (enough && share(best) >= DENSE / PARTS as f64)
        .then(|| (first, end - 1, (100.0 * share(best)).min(100.0)))
}

//! Faults of a converter, seen in the raw codes before anything is fitted.
//!
//! A bit that never toggles, and codes that pile up at one value as at a wall. Each
//! rule asks for evidence that sound codes would give less than once in a million
//! files, so that a fault is worth acting upon.

use std::collections::BTreeSet;

use crate::estimate::noise::source::{NoiseEstimate, Source};
use crate::estimate::{Fit, Observations};
use crate::mechanism::Mechanism;
use crate::numerics::distributions;
use crate::readings::Readings;
use crate::screening::excluded::{Cause, Excluded};

pub use crate::screening::fault::FaultKind;

/// How often a rule may speak up in sound data, per file.
pub(crate) const RARE: f64 = 1e-6;

/// A fault of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// The channel.
    pub channel: usize,
    /// What is wrong.
    pub kind: FaultKind,
}

impl Fault {
    /// Standard deviation of the error that stuck bits make, the same in all samples
    /// of a pose: each is off by nothing or by its worth.
    #[must_use]
    pub fn lasting(&self) -> f64 {
        match &self.kind {
            FaultKind::StuckBits(bits) => {
                bits.iter().map(|(bit, _)| 0.25 * 4_f64.powi(*bit as i32)).sum::<f64>().sqrt()
            }
            FaultKind::Clipped { .. } => 0.0,
        }
    }
}

/// Faults of the channels that are read in whole counts.
#[must_use]
pub fn faults(mechanism: &Mechanism, readings: &Readings) -> Vec<Fault> {
    let counts: Vec<bool> = mechanism.channels.iter().map(|c| c.counts()).collect();
    of_codes(&readings.table.values, &counts, &readings.pose, readings.held)
}

/// As [`faults`], from readings row by row, the channels that are read in counts, the
/// pose of each row, counted from 0, and whether poses were held.
#[must_use]
pub fn of_codes(values: &[f64], counts: &[bool], pose: &[usize], held: bool) -> Vec<Fault> {
    let mut found = Vec::new();
    let channels = counts.len();
    for channel in (0..channels).filter(|&c| counts[c]) {
        let column = values.iter().skip(channel).step_by(channels);
        if column.clone().any(|v| v.fract() != 0.0) {
            continue; // averages of codes have no bits
        }
        let codes: Vec<i64> = column.map(|v| *v as i64).collect();
        let bits = constant_bits(&codes, pose, channels);
        if !bits.is_empty() {
            found.push(Fault { channel, kind: FaultKind::StuckBits(bits) });
        }
        for sign in [1, -1] {
            if let Some((at, poses)) = clipped(&codes, pose, held, sign, channels) {
                found.push(Fault { channel, kind: FaultKind::Clipped { at, poses } });
            }
        }
    }
    found
}

/// Bits of codes that are looked at, at the most: doubles hold no more of a count.
const LARGEST: u32 = 53;

/// Bits and their constant values, for bits that smooth data would have toggled.
///
/// Bit `b` halves every block of `2^(b+1)` codes. Readings spread over several blocks,
/// all in the same half, are as many tosses of a coin as there are independent places:
/// different cells of an eighth of a half (neighbours in a cell say nothing new), and
/// not more than different blocks seen in each pose (repeats say nothing new).
fn constant_bits(codes: &[i64], pose: &[usize], channels: usize) -> Vec<(u32, bool)> {
    let (Some(low), Some(high)) = (codes.iter().min(), codes.iter().max()) else {
        return Vec::new();
    };
    let bits = (u64::BITS - high.abs_diff(*low).leading_zeros()).min(LARGEST);
    let tosses = (f64::from(bits.max(1)) * channels as f64 / RARE).log2();
    let stuck = |b: &u32| {
        let high = (codes[0] >> b) & 1 == 1;
        if codes.iter().any(|code| ((code >> b) & 1 == 1) != high) {
            return None;
        }
        let blocks: BTreeSet<i64> = codes.iter().map(|code| code >> (b + 1)).collect();
        let cells: BTreeSet<i64> = codes.iter().map(|code| code >> b.saturating_sub(3)).collect();
        let visits: BTreeSet<(usize, i64)> =
            pose.iter().zip(codes).map(|(pose, code)| (*pose, code >> (b + 1))).collect();
        let places = visits.len().min(cells.len()) as f64;
        (places >= tosses && blocks.len() >= 4).then_some((*b, high))
    };
    (0..bits).filter_map(|b| stuck(&b)).collect()
}

/// Codes next to the wall that say how many would be at it by chance.
const NEAR: i64 = 16;

/// Rows of a recording that stay at the wall each time it is reached.
const FLAT: usize = 3;

/// The highest code (`sign` 1) or the lowest (-1) and the poses that read nothing else,
/// where there are more than the density beside it can give.
fn clipped(
    codes: &[i64],
    pose: &[usize],
    held: bool,
    sign: i64,
    channels: usize,
) -> Option<(f64, Vec<usize>)> {
    let wall = codes.iter().map(|code| code.saturating_mul(sign)).max()?;
    let poses = pose.iter().max()? + 1;
    let (mut at, mut near) = (vec![true; poses], vec![false; poses]);
    for (code, &p) in codes.iter().zip(pose) {
        let depth = wall.saturating_sub(code.saturating_mul(sign));
        at[p] &= depth == 0;
        near[p] |= (1..=NEAR).contains(&depth);
    }
    let (times, beside) = if held {
        let count = |list: &[bool]| list.iter().filter(|here| **here).count();
        (count(&at), count(&near))
    } else {
        visits(&at, &near)
    };
    let chance = distributions::poisson_tail(times as f64, (beside + 1) as f64 / NEAR as f64);
    let moves = codes.iter().any(|code| code.saturating_mul(sign) != wall);
    (moves && chance * 2.0 * (channels as f64) < RARE)
        .then(|| (wall.saturating_mul(sign) as f64, (0..poses).filter(|&p| at[p]).collect()))
}

/// How often a recording came to the wall and stayed, and how often near it.
fn visits(at: &[bool], near: &[bool]) -> (usize, usize) {
    let (mut stayed, mut came, mut flat, mut longest) = (0, 0, 0, 0);
    for row in 0..=at.len() {
        if row < at.len() && (at[row] || near[row]) {
            flat = if at[row] { flat + 1 } else { 0 };
            longest = longest.max(flat);
        } else if row > 0 && (at[row - 1] || near[row - 1]) {
            came += 1;
            stayed += usize::from(longest >= FLAT);
            (flat, longest) = (0, 0);
        }
    }
    (stayed, came)
}

/// Acts on faults before effects are looked for: clipped poses are left out, and stuck
/// bits are counted into the noise of their channel, once for each pose.
pub fn set_apart(observations: &mut Observations, fit: &Fit, faults: &[Fault]) -> Vec<Excluded> {
    let mut excluded = Vec::new();
    if faults.is_empty() {
        return excluded;
    }
    let rows = observations.readings.rows_of_poses();
    let usual = fit.assumed().sigma;
    let mut sigma = usual.clone();
    for fault in faults {
        let channel = Some(fault.channel);
        let chain = observations.mechanism.chain_of(fault.channel);
        let entry = |pose, samples, cause| Excluded {
            channel,
            chain,
            ..Excluded::of(pose, samples, cause)
        };
        match &fault.kind {
            FaultKind::StuckBits(_) => {
                let samples = observations.readings.samples as f64 / rows.len().max(1) as f64;
                let lasting = fault.lasting();
                // Lowest bits are a coarser step, whose rounding the noise has counted.
                let rounding = observations.roundings().nth(fault.channel).unwrap_or(0.0);
                if lasting * lasting > rounding {
                    sigma[fault.channel] = sigma[fault.channel].hypot(lasting * samples.sqrt());
                }
                let cause = Cause::StuckBits { kind: fault.kind.clone(), error: lasting };
                excluded.push(entry(None, 0, cause));
            }
            FaultKind::Clipped { poses, .. } if enough(observations, fit, poses) => {
                let clipped = poses.iter().flat_map(|&pose| &rows[pose]);
                clipped.for_each(|&r| observations.weights[r] = 0.0);
                let count = |p: &usize| rows[*p].len();
                if observations.readings.held {
                    let cause = Cause::Clipped { kind: fault.kind.clone(), whole: false };
                    let own = |p: &usize| entry(Some(*p), count(p), cause.clone());
                    excluded.extend(poses.iter().map(own));
                } else {
                    let all = poses.iter().map(count).sum();
                    let cause = Cause::Clipped { kind: fault.kind.clone(), whole: true };
                    excluded.push(entry(None, all, cause));
                }
            }
            // Without them there would be too little left: it is said, and that is all.
            FaultKind::Clipped { .. } => {}
        }
    }
    if sigma != usual {
        observations.options.noise = Some(sigma);
        observations.options.play = fit.noise.play;
        observations.options.seating = fit.noise.seating.clone();
        observations.options.measured = Some(fit.noise.measured.clone());
        observations.judged = true;
    }
    excluded
}

/// A fit whose noise was seen by an earlier one, although faults were added to it.
#[must_use]
pub fn seen_by(before: &Fit, fit: Fit) -> Fit {
    let (source, dof) = match fit.noise.source {
        Source::Declared | Source::Presumed => (before.noise.source, before.noise.dof),
        source => (source, fit.noise.dof),
    };
    Fit { noise: NoiseEstimate { source, dof, ..fit.noise.clone() }, ..fit }
}

/// True where the poses that are left give equations for twice the parameters.
fn enough(observations: &Observations, fit: &Fit, without: &[usize]) -> bool {
    let left = observations.readings.poses() - without.len();
    left * fit.model.equations() >= 2 * fit.model.parameters
}

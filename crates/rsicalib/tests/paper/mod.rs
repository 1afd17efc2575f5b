//! The paper's poses, and readings of them by the closed forms.

#![allow(dead_code)] // each test file takes what it needs

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, FRAC_PI_6, PI};

use rsicalib::mechanism::{Mechanism, hand_controller};

/// Table II, pose 3 corrected.
pub const TABLE_II: [[f64; 6]; 12] = [
    [0.0, 0.0, -3.966, 0.0, 0.0, 0.0],
    [0.0, 0.0, -3.966, 0.0, 0.0, -FRAC_PI_2],
    [0.0, 0.0, -2.666, 0.0, 0.0, 0.0],
    [0.0, 0.0, -2.666, 0.0, 0.0, -FRAC_PI_2],
    [-1.5, 0.0, -3.966, 0.0, 0.0, 0.0],
    [-1.5, 0.0, -3.966, 0.0, 0.0, -FRAC_PI_4],
    [-1.5, 0.0, -2.666, 0.0, 0.0, 0.0],
    [-1.5, 0.0, -2.666, 0.0, 0.0, -FRAC_PI_4],
    [0.0, 1.5, -3.966, 0.0, 0.0, 0.0],
    [0.0, 1.5, -3.966, 0.0, 0.0, -FRAC_PI_4],
    [0.0, 1.5, -2.666, 0.0, 0.0, 0.0],
    [0.0, 1.5, -2.666, 0.0, 0.0, -FRAC_PI_4],
];

/// Table III.
pub fn table_iii() -> Vec<[f64; 6]> {
    let a = FRAC_PI_6;
    let mut poses = Vec::new();
    for (i, j) in [(3, 4), (3, 5), (4, 5)] {
        for (s, t) in [(a, a), (a, -a), (-a, a), (-a, -a)] {
            let mut pose = [0.0, 0.0, -1.3, 0.0, 0.0, 0.0];
            (pose[i], pose[j]) = (s, t);
            poses.push(pose);
        }
    }
    poses
}

/// Offsets and gains off nominal by fixed patterns of these sizes: rad, fraction.
pub fn rsi_parameters(offset: f64, gain: f64) -> (Vec<f64>, Vec<f64>) {
    let channels = Mechanism::rsi().channels;
    let pattern = |c: usize, k: f64| (c as f64 * k).sin();
    let offsets = channels.iter().enumerate().map(|(c, ch)| ch.offset + offset * pattern(c, 1.3));
    let gains = channels.iter().enumerate().map(|(c, ch)| ch.gain * (1.0 + gain * pattern(c, 2.1)));
    (offsets.collect(), gains.collect())
}

/// Exact readings of poses, row by row, by eqs. (6)-(8) and (9).
pub fn counts_of(poses: &[[f64; 6]], offsets: &[f64], gains: &[f64]) -> Vec<f64> {
    poses
        .iter()
        .flat_map(|pose| {
            let angles = hand_controller::inverse(pose).expect("within reach");
            let angles: Vec<f64> = angles.into_iter().flatten().collect();
            (0..9).map(move |c| angles[c]).zip(offsets.iter().zip(gains)).collect::<Vec<_>>()
        })
        .map(|(angle, (offset, gain))| (angle - offset) / gain)
        .collect()
}

/// Seeded numbers: SplitMix64.
pub struct Rng(u64);

impl Rng {
    /// A sequence of its own for each seed.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15))
    }

    /// Between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().max(1e-300).ln()).sqrt() * (2.0 * PI * self.uniform()).cos()
    }
}

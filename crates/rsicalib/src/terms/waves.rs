//! `cos(k π s)` for `k` from 1 on: the basis functions of free shapes.

use std::f64::consts::PI;

use crate::numerics::lanes::Lanes;

/// `Σ_k p_k cos(k π s)`
pub fn sum(p: &[f64], s: Lanes) -> Lanes {
    let mut sum = Lanes::ZERO;
    for (k, p) in p.iter().enumerate() {
        sum += wave(k, s).1 * *p;
    }
    sum
}

/// `cos(k π s)` for `k` from 1 to the length of `out`.
pub fn each(s: Lanes, out: &mut [Lanes]) {
    for (k, out) in out.iter_mut().enumerate() {
        *out = wave(k, s).1;
    }
}

/// `d/ds Σ_k p_k cos(k π s)`
pub fn slope(p: &[f64], s: Lanes) -> Lanes {
    let mut sum = Lanes::ZERO;
    for (k, p) in p.iter().enumerate() {
        sum -= wave(k, s).0 * (PI * (k + 1) as f64 * p);
    }
    sum
}

/// Sine and cosine of the wave number `k`, counted from 0.
fn wave(k: usize, s: Lanes) -> (Lanes, Lanes) {
    (s * (PI * (k + 1) as f64)).sin_cos()
}

//! The models of NIST's problems, with their derivatives.
//!
//! Each takes the parameters `b` and the predictors `x` of one row, returns
//! the value, and leaves the derivative by `b[k]` in `g[k]`. The formula of
//! each problem, as NIST's file has it, stands over its figures in `data.rs`.

use std::f64::consts::{PI, TAU};

pub fn bennett5(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let base = b[1] + x[0];
    let power = base.powf(-1.0 / b[2]);
    g[0] = power;
    g[1] = -b[0] * power / (b[2] * base);
    g[2] = b[0] * power * base.ln() / (b[2] * b[2]);
    b[0] * power
}

pub fn saturation(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let decay = (-b[1] * x[0]).exp();
    g[0] = 1.0 - decay;
    g[1] = b[0] * x[0] * decay;
    b[0] * g[0]
}

pub fn chwirut(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let denominator = b[1] + b[2] * x[0];
    let value = (-b[0] * x[0]).exp() / denominator;
    g[0] = -x[0] * value;
    g[1] = -value / denominator;
    g[2] = x[0] * g[1];
    value
}

pub fn danwood(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let power = x[0].powf(b[1]);
    g[0] = power;
    g[1] = b[0] * power * x[0].ln();
    b[0] * power
}

pub fn enso(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let (sin, cos) = (TAU * x[0] / 12.0).sin_cos();
    g[0] = 1.0;
    g[1] = cos;
    g[2] = sin;
    let mut value = b[0] + b[1] * cos + b[2] * sin;
    // Two more waves; the first parameter of each is its period.
    for k in [3, 6] {
        let phase = TAU * x[0] / b[k];
        let (sin, cos) = phase.sin_cos();
        g[k] = (b[k + 1] * sin - b[k + 2] * cos) * phase / b[k];
        g[k + 1] = cos;
        g[k + 2] = sin;
        value += b[k + 1] * cos + b[k + 2] * sin;
    }
    value
}

pub fn eckerle4(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let z = (x[0] - b[2]) / b[1];
    let bell = (-0.5 * z * z).exp() / b[1];
    g[0] = bell;
    g[1] = b[0] * bell * (z * z - 1.0) / b[1];
    g[2] = b[0] * bell * z / b[1];
    b[0] * bell
}

pub fn gauss(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let decay = (-b[1] * x[0]).exp();
    g[0] = decay;
    g[1] = -b[0] * x[0] * decay;
    let mut value = b[0] * decay;
    // Two peaks: height, place and width.
    for k in [2, 5] {
        let z = (x[0] - b[k + 1]) / b[k + 2];
        let bell = (-z * z).exp();
        g[k] = bell;
        g[k + 1] = b[k] * bell * 2.0 * z / b[k + 2];
        g[k + 2] = g[k + 1] * z;
        value += b[k] * bell;
    }
    value
}

pub fn cubic_over_cubic(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    rational(b, 4, x[0], g)
}

pub fn kirby2(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    rational(b, 3, x[0], g)
}

/// A ratio of polynomials: the first `above` parameters are the numerator's, from the constant
/// up; the denominator's constant is 1, and not a parameter.
fn rational(b: &[f64], above: usize, x: f64, g: &mut [f64]) -> f64 {
    let polynomial = |b: &[f64]| b.iter().rfold(0.0, |sum, b| sum * x + b);
    let denominator = 1.0 + x * polynomial(&b[above..]);
    let value = polynomial(&b[..above]) / denominator;
    let mut power = 1.0 / denominator;
    for g in &mut g[..above] {
        *g = power;
        power *= x;
    }
    for k in above..b.len() {
        g[k] = -value * x * g[k - above];
    }
    value
}

pub fn lanczos(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let mut value = 0.0;
    for k in [0, 2, 4] {
        let decay = (-b[k + 1] * x[0]).exp();
        g[k] = decay;
        g[k + 1] = -b[k] * x[0] * decay;
        value += b[k] * decay;
    }
    value
}

pub fn mgh09(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let x = x[0];
    let denominator = x * x + x * b[2] + b[3];
    g[0] = (x * x + x * b[1]) / denominator;
    g[1] = b[0] * x / denominator;
    let value = b[0] * g[0];
    g[2] = -value * x / denominator;
    g[3] = -value / denominator;
    value
}

pub fn mgh10(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let shifted = x[0] + b[2];
    let growth = (b[1] / shifted).exp();
    g[0] = growth;
    g[1] = b[0] * growth / shifted;
    g[2] = -g[1] * b[1] / shifted;
    b[0] * growth
}

pub fn mgh17(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let first = (-x[0] * b[3]).exp();
    let second = (-x[0] * b[4]).exp();
    g[0] = 1.0;
    g[1] = first;
    g[2] = second;
    g[3] = -b[1] * x[0] * first;
    g[4] = -b[2] * x[0] * second;
    b[0] + b[1] * first + b[2] * second
}

pub fn misra1b(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let base = 1.0 + b[1] * x[0] / 2.0;
    g[0] = 1.0 - base.powi(-2);
    g[1] = b[0] * x[0] * base.powi(-3);
    b[0] * g[0]
}

pub fn misra1c(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let base = 1.0 + 2.0 * b[1] * x[0];
    g[0] = 1.0 - base.powf(-0.5);
    g[1] = b[0] * x[0] * base.powf(-1.5);
    b[0] * g[0]
}

pub fn misra1d(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let base = 1.0 + b[1] * x[0];
    g[0] = b[1] * x[0] / base;
    g[1] = b[0] * x[0] / (base * base);
    b[0] * g[0]
}

/// Two predictors: weeks, and the temperature of the ageing.
pub fn nelson(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let growth = (-b[2] * x[1]).exp();
    g[0] = 1.0;
    g[1] = -x[0] * growth;
    g[2] = b[1] * x[0] * x[1] * growth;
    b[0] + b[1] * g[1]
}

pub fn rat42(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let u = b[1] - b[2] * x[0];
    // The two halves of a logistic curve: neither overflows for a large |u|.
    let (done, left) = (1.0 / (1.0 + u.exp()), 1.0 / (1.0 + (-u).exp()));
    g[0] = done;
    g[1] = -b[0] * done * left;
    g[2] = -x[0] * g[1];
    b[0] * done
}

pub fn rat43(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let u = b[1] - b[2] * x[0];
    let (base, left) = (1.0 + u.exp(), 1.0 / (1.0 + (-u).exp()));
    let power = base.powf(-1.0 / b[3]);
    g[0] = power;
    g[1] = -b[0] * power * left / b[3];
    g[2] = -x[0] * g[1];
    g[3] = b[0] * power * base.ln() / (b[3] * b[3]);
    b[0] * power
}

pub fn roszman1(b: &[f64], x: &[f64], g: &mut [f64]) -> f64 {
    let distance = x[0] - b[3];
    let squares = PI * (distance * distance + b[2] * b[2]);
    g[0] = 1.0;
    g[1] = -x[0];
    g[2] = -distance / squares;
    g[3] = -b[2] / squares;
    b[0] - b[1] * x[0] - (b[2] / distance).atan() / PI
}

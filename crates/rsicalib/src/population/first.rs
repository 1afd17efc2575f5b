//! What the rows of a fleet tell without a joint estimate: the summed χ² and common shifts.

use faer::Mat;

use crate::Error;
use crate::numerics::distributions::{
    chi2_quantile, f_tail, normal_cdf, normal_quantile, student_quantile,
};
use crate::population::levels::{Levels, Spread};

/// Common error of the noise of a fleet, in parts, that a sum of χ² must not take for an effect.
const NOISE: f64 = 0.01;

/// The χ² of many devices together.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Summed {
    /// Number of devices.
    pub devices: usize,
    /// Sum of χ².
    pub chi2: f64,
    /// Sum of the degrees of freedom.
    pub dof: f64,
    /// Probability of as much where every device is sound, and noise is known to 1 %.
    pub p_value: f64,
}

/// Sums the tests of fit of many devices: χ², degrees of freedom and p-value of each.
///
/// A sum of χ² does not know how well each noise is known, its p-value does. With `w² = dof`,
///
/// ```text
/// z = Σ w Φ⁻¹(1 - p) / √Σ w² - 2 ε √(Σ dof / 2)                                   (126)
/// ```
///
/// is normal where no device lacks anything; the last part is what a noise that is `ε` = 1 % too
/// small everywhere would make.
#[must_use]
pub fn summed(devices: &[(f64, f64, f64)]) -> Option<Summed> {
    let known = |d: &&(f64, f64, f64)| d.0.is_finite() && d.1 >= 1.0 && (0.0..=1.0).contains(&d.2);
    let all: Vec<_> = devices.iter().filter(known).collect();
    let (chi2, dof) = all.iter().fold((0.0, 0.0), |(c, n), d| (c + d.0, n + d.1));
    // A p-value of zero is one that has no number: 37 standard deviations.
    let z = |p: f64| -normal_quantile(p.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON));
    let sum: f64 = all.iter().map(|d| d.1.sqrt() * z(d.2)).sum();
    let z = sum / dof.sqrt() - 2.0 * NOISE * (dof / 2.0).sqrt();
    (all.len() > 1).then(|| Summed { devices: all.len(), chi2, dof, p_value: normal_cdf(-z) })
}

/// Mean of a parameter over devices beside the drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Shift {
    /// Number of devices.
    pub devices: usize,
    /// Mean distance from the drawing, in the parameter's unit.
    pub value: f64,
    /// Half width of the interval of 95 %; none where fewer than three are independent.
    pub half: Option<f64>,
    /// Standard deviation between devices, beside the noise of their estimates.
    pub between: f64,
    /// Interval of 95 % of that.
    pub between_interval: [f64; 2],
    /// Probability of as much where the drawing is right; none as of `half`.
    pub p_value: Option<f64>,
}

/// Common shift of a parameter: estimates and standard deviations of devices, from the drawing.
///
/// Devices differ by `τ²` beside the noise of their estimates (Paule and Mandel 1982: the `τ²`
/// with which the weighted squares are as many as the devices less one). With the weights
/// `w = 1/(sd² + τ²)` the variance of the mean is `Σ w (x - m)² / ((D-1) Σ w)`, and the bound is Student's
/// (Hartung and Knapp 2001): it holds where standard deviations are wrong by a common factor. At the true
/// `τ²` the weighted squares are χ² of `D-1`, which bounds `τ²` (Viechtbauer 2007).
#[must_use]
pub fn common_shift(devices: &[(f64, f64)]) -> Option<Shift> {
    let known = |d: &&(f64, f64)| d.0.is_finite() && d.1.is_finite() && d.1 > 0.0;
    let all: Vec<_> = devices.iter().filter(known).copied().collect();
    if all.len() < 3 {
        return None;
    }
    let dof = all.len() as f64 - 1.0;
    let at = |tau2: f64| {
        let weights = all.iter().map(|d| (d.1 * d.1 + tau2).recip());
        let sum: f64 = weights.clone().sum();
        let mean = weights.clone().zip(&all).map(|(w, d)| w * d.0).sum::<f64>() / sum;
        let squares = all.iter().map(|d| (d.0 - mean).powi(2));
        let q: f64 = weights.clone().zip(squares.clone()).map(|(w, s)| w * s).sum();
        let slope: f64 = weights.zip(squares).map(|(w, s)| w * w * s).sum();
        (mean, sum, q, slope)
    };
    let mean = all.iter().map(|d| d.0).sum::<f64>() / all.len() as f64;
    let spread: f64 = all.iter().map(|d| (d.0 - mean).powi(2)).sum();
    // The weighted squares `Q` fall with τ²: where they are `target`, or zero. Newton's steps for
    // `1/Q`, which is nearly straight, within what is known.
    let tau2 = |target: f64| {
        let (mut low, mut high, mut tau2) = (0.0, spread / target, 0.0);
        for _ in 0..60 {
            let (_, _, q, slope) = at(tau2);
            if q > target {
                low = tau2
            } else {
                high = tau2
            }
            let next = tau2 + q * (q - target) / (target * slope);
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if high <= low || (next - tau2).abs() <= 1e-12 * next {
                break;
            }
            tau2 = next;
        }
        tau2
    };
    let between = tau2(dof);
    let (value, sum, q, _) = at(between);
    let variance = q.max(f64::MIN_POSITIVE) / (dof * sum);
    Some(Shift {
        devices: all.len(),
        value,
        half: Some(student_quantile(0.975, dof) * variance.sqrt()),
        between: between.sqrt(),
        between_interval: [0.025, 0.975].map(|p| tau2(chi2_quantile(p, dof)).sqrt()),
        p_value: Some(f_tail(value * value / variance, 1.0, dof)),
    })
}

/// [`common_shift`] of what has levels above it, and how each level differs, what is given first:
/// `levels` says for each level in which group each one is.
///
/// The largest groups are independent where levels nest: their means, with all that is below and
/// themselves as noise, are what the shift is from. Where levels cross nothing is independent, and the
/// shift has no bound.
///
/// # Errors
///
/// As [`Levels::new`].
pub fn common_shift_of_levels(
    devices: &[(f64, f64)],
    levels: &[Vec<usize>],
) -> Result<Option<(Shift, Vec<Spread>)>, Error> {
    let known = |d: &(f64, f64)| d.0.is_finite() && d.1.is_finite() && d.1 > 0.0;
    let which: Vec<usize> = (0..devices.len()).filter(|&d| known(&devices[d])).collect();
    if which.len() < 3 {
        return Ok(None);
    }
    let precision = |d: &usize| devices[*d].1.powi(-2);
    let information: Vec<Mat<f64>> =
        which.iter().map(|d| Mat::from_fn(1, 1, |_, _| precision(d))).collect();
    let told: Vec<Vec<f64>> = which.iter().map(|d| vec![precision(d) * devices[*d].0]).collect();
    let groups: Vec<Vec<usize>> = levels
        .iter()
        .map(|level| which.iter().filter_map(|&d| level.get(d).copied()).collect())
        .collect();
    let of = Levels::new(&information, &told, &[0], &groups, 0.0)?;
    let spreads: Vec<Spread> = of.spreads().into_iter().map(|level| level[0]).collect();
    let means = of.means();
    let shift = means.as_deref().and_then(common_shift);
    let alone = || Shift {
        devices: which.len(),
        value: of.mean(),
        half: None,
        between: 0.0,
        between_interval: [0.0; 2],
        p_value: None,
    };
    Ok(Some((Shift { devices: which.len(), ..shift.unwrap_or_else(alone) }, spreads)))
}

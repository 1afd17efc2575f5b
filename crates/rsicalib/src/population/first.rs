//! What the rows of a fleet tell without a joint estimate: the summed χ² and common shifts.

use faer::Mat;

use crate::Error;
use crate::estimate::significance::CLEAN;
use crate::numerics::distributions::{
    chi2_quantile, f_tail, normal_cdf, normal_quantile, student_quantile,
};
use crate::numerics::workers;
use crate::population::levels::{Levels, Spread};

/// Common error of the noise of a fleet, in parts, that a sum of χ² must not take for an effect.
const NOISE: f64 = 0.01;

/// Which of some tests are beyond chance, all of them counted in: chance calls any of them so in [`CLEAN`] of
/// cases. A test without a probability says nothing.
#[must_use]
pub fn beyond_chance(p_values: &[Option<f64>]) -> Vec<bool> {
    let tests = p_values.iter().flatten().count();
    let level = CLEAN / tests.max(1) as f64;
    p_values.iter().map(|p| p.is_some_and(|p| p < level)).collect()
}

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
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Shift {
    /// Number of devices.
    pub devices: usize,
    /// Mean distance from the drawing, in the parameter's unit.
    pub value: f64,
    /// Half width of the interval of 95 %; none where fewer than three are independent.
    pub half: Option<f64>,
    /// Standard deviation between devices, beside the noise of their estimates and beside levels.
    pub between: Option<f64>,
    /// Interval of 95 % of that, whose upper end is none where nothing bounds it; none where devices
    /// differ by less than the noise of their estimates makes them.
    pub between_interval: Option<(f64, Option<f64>)>,
    /// Probability of as much where the drawing is right; none as of `half`.
    pub p_value: Option<f64>,
    /// How each level differs, devices first; empty without levels.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub levels: Vec<Spread>,
}

impl Shift {
    /// The same in a unit of which one of these has so many.
    fn times(self, unit: f64) -> Self {
        let interval = |(low, high): (f64, Option<f64>)| (low * unit, high.map(|h| h * unit));
        Self {
            value: self.value * unit,
            half: self.half.map(|half| half * unit),
            between: self.between.map(|between| between * unit),
            between_interval: self.between_interval.map(interval),
            levels: self.levels.into_iter().map(|level| level.times(unit)).collect(),
            ..self
        }
    }
}

/// Largest distance from the drawing, in units of the best known device: the square of its square is
/// still a number.
const FARTHEST: f64 = 1e77;

/// Common shift of each of some parameters: estimates and standard deviations of devices, from the
/// drawing. `levels` says for each level in which group each device is.
///
/// Devices differ by `τ²` beside the noise of their estimates (Paule and Mandel 1982: the `τ²`
/// with which the weighted squares are as many as the devices less one). With the weights
/// `w = 1/(sd² + τ²)` the variance of the mean is `Σ w (x - m)² / ((D-1) Σ w)`, and the bound is Student's
/// (Hartung and Knapp 2001): it holds where standard deviations are wrong by a common factor. At the true
/// `τ²` the weighted squares are χ² of `D-1`, which bounds `τ²` (Viechtbauer 2007).
///
/// With levels variances are those of (160), and the bound is from the largest groups, with what is
/// below as noise: they alone are independent. Where levels cross nothing is, and the shift has no bound.
///
/// # Errors
///
/// [`Error::Shape`] for a level that does not have a group for each device, [`Error::Option`] for more
/// groups of levels that cross than can be solved together.
pub fn common_shifts(
    parameters: &[Vec<(f64, f64)>],
    levels: &[Vec<usize>],
) -> Result<Vec<Option<Shift>>, Error> {
    workers::map(parameters, |devices| common_shift(devices, levels)).into_iter().collect()
}

fn common_shift(devices: &[(f64, f64)], levels: &[Vec<usize>]) -> Result<Option<Shift>, Error> {
    for level in levels {
        Error::same("groups of a level", level.len(), devices.len())?;
    }
    let known = |d: &(f64, f64)| d.0.is_finite() && d.1.is_finite() && d.1 > 0.0;
    let least = devices.iter().filter(|d| known(d)).map(|d| d.1).fold(f64::INFINITY, f64::min);
    // A power of two, which rounds nothing: squares are numbers, whatever the unit of a parameter is.
    let unit = least.log2().floor().exp2();
    let scaled = |d: &(f64, f64)| (d.0 / unit, d.1 / unit);
    let which: Vec<usize> = (0..devices.len())
        .filter(|&d| known(&devices[d]) && scaled(&devices[d]).0.abs() < FARTHEST)
        .collect();
    if which.len() < 3 {
        return Ok(None);
    }
    let all: Vec<(f64, f64)> = which.iter().map(|&d| scaled(&devices[d])).collect();
    let found = if levels.is_empty() {
        alone(&all)
    } else {
        let of = |level: &Vec<usize>| which.iter().map(|&d| level[d]).collect();
        with_levels(&all, &levels.iter().map(of).collect::<Vec<_>>())?
    };
    Ok(Some(found.times(unit)))
}

/// Devices without levels.
fn alone(all: &[(f64, f64)]) -> Shift {
    let dof = all.len() as f64 - 1.0;
    let mean = all.iter().map(|d| d.0).sum::<f64>() / all.len() as f64;
    let spread: f64 = all.iter().map(|d| (d.0 - mean).powi(2)).sum();
    // The weighted squares `Q` fall with τ²: where they are `target`, or zero. Newton's steps for
    // `1/Q`, which is nearly straight, within what is known.
    let tau2 = |target: f64| {
        let (mut low, mut high, mut tau2) = (0.0, spread / target, 0.0);
        for _ in 0..60 {
            let Weighed { q, slope, .. } = weighed(all, tau2);
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
    let (low, high) = (tau2(chi2_quantile(0.025, dof)), tau2(chi2_quantile(0.975, dof)));
    Shift {
        between: Some(between.sqrt()),
        between_interval: (high > 0.0).then(|| (low.sqrt(), Some(high.sqrt()))),
        ..mean_of(all, between)
    }
}

/// Sums of devices that differ by `τ²` beside their own errors.
struct Weighed {
    mean: f64,
    /// `Σ w`
    sum: f64,
    /// `Σ w (x - m)²`
    q: f64,
    /// `Σ w² (x - m)²`
    slope: f64,
}

fn weighed(all: &[(f64, f64)], tau2: f64) -> Weighed {
    let weights = all.iter().map(|d| (d.1 * d.1 + tau2).recip());
    let sum: f64 = weights.clone().sum();
    let mean = weights.clone().zip(all).map(|(w, d)| w * d.0).sum::<f64>() / sum;
    let squares = all.iter().map(|d| (d.0 - mean).powi(2));
    let q = weights.clone().zip(squares.clone()).map(|(w, s)| w * s).sum();
    let slope = weights.zip(squares).map(|(w, s)| w * w * s).sum();
    Weighed { mean, sum, q, slope }
}

/// The mean of what is independent, and its bound.
fn mean_of(all: &[(f64, f64)], tau2: f64) -> Shift {
    let dof = all.len() as f64 - 1.0;
    let Weighed { mean, sum, q, .. } = weighed(all, tau2);
    let variance = q.max(f64::MIN_POSITIVE) / (dof * sum);
    Shift {
        devices: all.len(),
        value: mean,
        half: Some(student_quantile(0.975, dof) * variance.sqrt()),
        between: None,
        between_interval: None,
        p_value: Some(f_tail(mean * mean / variance, 1.0, dof)),
        levels: Vec::new(),
    }
}

fn with_levels(all: &[(f64, f64)], levels: &[Vec<usize>]) -> Result<Shift, Error> {
    let precision = |d: &(f64, f64)| d.1.powi(-2);
    let information: Vec<Mat<f64>> =
        all.iter().map(|d| Mat::from_fn(1, 1, |_, _| precision(d))).collect();
    let told: Vec<Vec<f64>> = all.iter().map(|d| vec![precision(d) * d.0]).collect();
    let of = Levels::new(&information, &told, &[0], levels, 0.0)?;
    let levels: Vec<Spread> = of.spreads().into_iter().map(|level| level[0]).collect();
    let independent: Vec<(f64, f64)> = of
        .devices(&of)
        .iter()
        .filter(|(s, _)| of.nests() && s[(0, 0)] > 0.0)
        .map(|(s, b)| (b[0] / s[(0, 0)], s[(0, 0)].sqrt().recip()))
        .collect();
    let bounded = (independent.len() > 2).then(|| mean_of(&independent, of.top()[0]));
    Ok(Shift {
        devices: all.len(),
        value: of.mean().0[0],
        half: bounded.as_ref().and_then(|bounded| bounded.half),
        between: levels[0].sd,
        between_interval: levels[0].interval,
        p_value: bounded.and_then(|bounded| bounded.p_value),
        levels,
    })
}

#[cfg(test)]
mod tests {
    use super::{beyond_chance, common_shifts};

    const LEVELS: [usize; 8] = [0, 0, 1, 1, 2, 2, 3, 3];

    fn drawn(unit: f64) -> Vec<(f64, f64)> {
        let of = |u: usize| (unit * [3.0, 2.0, -4.0, -1.0, 0.5, 2.5, 7.0, 9.0][u], unit);
        (0..8).map(of).collect()
    }

    #[test]
    fn tests_share_the_level_of_all_of_them() {
        let p = [Some(0.004), None, Some(0.006), Some(f64::NAN)];
        assert_eq!(beyond_chance(&p[..2]), [true, false]);
        // Three that have a probability: a third of 1 % each.
        assert_eq!(beyond_chance(&p), [false; 4]);
        assert_eq!(beyond_chance(&p[2..3]), [true]);
    }

    #[test]
    fn parameters_are_compared_each_by_itself() {
        let (one, other) = (drawn(1.0), drawn(0.3));
        let none = vec![(f64::NAN, 1.0); 8];
        for levels in [vec![], vec![LEVELS.to_vec()]] {
            let all = [one.clone(), none.clone(), other.clone()];
            let together = common_shifts(&all, &levels).expect("alike");
            assert_eq!(together[1], None);
            for (k, own) in [(0, &one), (2, &other)] {
                let alone = common_shifts(std::slice::from_ref(own), &levels).expect("alike");
                assert_eq!(alone[0], together[k]);
            }
        }
    }

    #[test]
    fn whatever_the_unit_is_numbers_are_the_same() {
        // Powers of two round nothing. Squares of the last two have no number.
        for levels in [vec![], vec![LEVELS.to_vec()]] {
            let one = common_shifts(&[drawn(1.0)], &levels).expect("alike")[0].clone();
            let one = one.expect("eight devices");
            for unit in [2.0_f64.powi(-40), 2.0_f64.powi(600), 2.0_f64.powi(-600)] {
                let found = common_shifts(&[drawn(unit)], &levels).expect("alike")[0].clone();
                assert_eq!(found, Some(one.clone().times(unit)));
            }
        }
    }

    #[test]
    fn a_level_without_a_group_for_each_device_is_refused() {
        assert!(common_shifts(&[drawn(1.0)], &[vec![0; 7]]).is_err());
        assert!(common_shifts(&[drawn(1.0)], &[vec![0; 9]]).is_err());
    }

    #[test]
    fn devices_of_which_some_tell_next_to_nothing_are_compared() {
        let mut some = drawn(1.0);
        (0..4).for_each(|u| some[u].1 = 1e170);
        for levels in [vec![], vec![LEVELS.to_vec()]] {
            let found = common_shifts(&[some.clone()], &levels).expect("alike")[0].clone();
            let found = found.expect("eight devices");
            assert!(found.value > 0.5 && found.value < 9.0, "{found:?}");
            assert!(found.levels.iter().all(|level| level.sd.is_some_and(f64::is_finite)));
        }
    }
}

//! When the error of the platform will exceed a target, if the last calibration stays in use.
//!
//! Errors of the parameters grow from what the last result leaves open. With the derivative `J` of the
//! platform's positions at `n` poses by the reported parameters, (100),
//!
//! ```text
//! δ(t) = δ + t ρ,    (δ, ρ) ~ N((0, ρ̂), [C + 2T, K; Kᵀ, P]),    rms² = |J δ(t)|² / 3n        (147)
//! ```
//!
//! with the rates `ρ̂` of (178), their covariance `P`, and `K` that of the last result's error and the rates: a
//! result that is too high by chance has made the rate too high. The scatter `T` from session to session counts
//! twice: once for the last session, and once for the day of use. All parameters are drawn together, so that nothing
//! depends on where the zero of readings is.

use crate::numerics::order;
use faer::Mat;
use nalgebra::{DMatrix, DVector};

use crate::Error;
use crate::apply::earlier::{Applied, Reported, Under};
use crate::apply::slopes::platform_slopes;
use crate::history::rates::rates;
use crate::history::series::{Dated, Series};
use crate::mechanism::Mechanism;
use crate::numerics::draws::{Draws, square_root};
use crate::readings::Table;

/// Draws: a share of one in twenty has a standard error of 0.3 %.
const DRAWS: usize = 4000;

/// Days after which nothing is said: ten years.
const HORIZON: u32 = 3650;

/// The error of the platform to come: position, root mean square over components.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Forecast {
    /// What is too much [length unit].
    pub target: f64,
    /// Median on the day of the last result: what its uncertainty leaves [length unit].
    pub now: f64,
    /// Days until half of the draws are above the target; none: not within ten years.
    pub day: Option<u32>,
    /// Days until one in twenty is.
    pub from_day: Option<u32>,
}

/// The forecast of a device under its last result, at the poses of a table.
///
/// `last` is the last of `results` as it is applied; a parameter without a series stands still. None where there is
/// no parameter, or no pose in which its effect is known.
///
/// # Errors
///
/// As [`crate::apply::earlier::platform_poses`]; [`Error::Shape`] where the last result's covariance is of other
/// parameters.
pub fn forecast(
    mechanism: &Mechanism,
    last: &Applied,
    results: &[Dated],
    series: &[Series],
    table: Table,
    target: f64,
) -> Result<Option<Forecast>, Error> {
    let n = last.parameters.len();
    let covariance = results.last().map_or(&[][..], |dated| &dated.covariance);
    Error::same("covariance", covariance.len(), n * n)?;
    if n == 0 {
        return Ok(None);
    }
    let Some(square) = mean_square(&Under::new(mechanism, last, table, &[])?)? else {
        return Ok(None);
    };
    let (mean, root) = growing(last, covariance, results, series);
    let mut random = Draws::new(0);
    let drawn = (0..DRAWS).map(|_| {
        let both = &mean + &root * DVector::from_fn(2 * n, |_, _| random.normal());
        let (error, rate) = (both.rows(0, n), both.rows(n, n));
        let by_rate = &square * rate;
        // The mean square of a day t is a + 2 b t + c t².
        [error.dot(&(&square * error)), error.dot(&by_rate), rate.dot(&by_rate)]
    });
    let drawn: Vec<[f64; 3]> = drawn.collect();
    let mut now: Vec<f64> = drawn.iter().map(|[a, ..]| a.max(0.0).sqrt()).collect();
    order::sort(&mut now);
    let past = |share: f64| {
        let is_past = |day: u32| {
            let t = f64::from(day);
            let above = |[a, b, c]: &&[f64; 3]| a + t * (2.0 * b + t * c) > target * target;
            drawn.iter().filter(above).count() as f64 >= share * DRAWS as f64
        };
        first_day(is_past)
    };
    Ok(Some(Forecast { target, now: now[DRAWS / 2], day: past(0.5), from_day: past(0.05) }))
}

/// The mean of `(δ, ρ)` of (147), and a root of its covariance.
fn growing(
    last: &Applied,
    covariance: &[f64],
    results: &[Dated],
    series: &[Series],
) -> (DVector<f64>, DMatrix<f64>) {
    let n = last.parameters.len();
    let rates = rates(results, series);
    let place = |own: &Reported| {
        series.iter().position(|one| (&one.spec, &one.name) == (&own.spec, &own.name))
    };
    let places: Vec<Option<usize>> = last.parameters.iter().map(place).collect();
    let of = |all: &Mat<f64>| {
        DMatrix::from_fn(n, n, |a, b| match (places[a], places[b]) {
            (Some(a), Some(b)) => all[(a, b)],
            _ => 0.0,
        })
    };
    let with_rates = of(&rates.with_level);
    let mut joint = DMatrix::zeros(2 * n, 2 * n);
    let error = DMatrix::from_row_slice(n, n, covariance) + of(&rates.scatter) * 2.0;
    joint.view_mut((0, 0), (n, n)).copy_from(&error);
    joint.view_mut((0, n), (n, n)).copy_from(&with_rates);
    joint.view_mut((n, 0), (n, n)).copy_from(&with_rates.transpose());
    joint.view_mut((n, n), (n, n)).copy_from(&of(&rates.covariance));
    let rate = |k: usize| k.checked_sub(n).and_then(|k| places[k]).map_or(0.0, |k| rates.value[k]);
    (DVector::from_fn(2 * n, |k, _| rate(k)), square_root(&joint))
}

/// `JᵀJ / 3n` over the poses that have a finite `J`; none where none has.
fn mean_square(under: &Under) -> Result<Option<DMatrix<f64>>, Error> {
    let beta = under.internal(&under.values);
    let by_reported = under.by_reported(&beta);
    let all = platform_slopes(&under.model, &under.readings, &beta, &under.noise, 1)?;
    let by = all.iter().map(|slopes| slopes.by_parameter.rows(0, 3) * &by_reported);
    let finite: Vec<DMatrix<f64>> = by.filter(|by| by.iter().all(|v| v.is_finite())).collect();
    let squares = finite.iter().map(|by| by.transpose() * by);
    Ok(squares.reduce(|sum, square| sum + square).map(|sum| sum / (3.0 * finite.len() as f64)))
}

/// The first day that is past, by halves; none where the last is not.
fn first_day(is_past: impl Fn(u32) -> bool) -> Option<u32> {
    if !is_past(HORIZON) {
        return None;
    }
    let (mut low, mut high) = (0, HORIZON);
    while low < high {
        let middle = u32::midpoint(low, high);
        if is_past(middle) { high = middle } else { low = middle + 1 }
    }
    Some(low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::apply::earlier::{Reference, platform_poses};
    use crate::apply::moved::Estimate;
    use crate::design::within_limits::within_limits;
    use crate::history::series::series;

    /// The hand controller with the offset of one channel, at its own value.
    fn last(mechanism: &Mechanism, value: f64) -> Applied {
        let reported = Reported { spec: "offset@a22".into(), name: "offset".into(), value };
        let middle = mechanism.channels.iter().map(|c| c.middle()).collect();
        let reference = Reference { centre: middle, span: vec![[0.0; 2]; 9], temperature: None };
        Applied { parameters: vec![reported], reference, sigma: vec![1.0; 9], ..Applied::default() }
    }

    #[test]
    fn a_drift_that_is_known_takes_the_platform_to_the_target_on_its_day() -> Result<(), Error> {
        let rsi = Mechanism::rsi();
        let (offset, rate) = (rsi.channels[4].offset, 1e-5);
        let table = Table { values: within_limits(&rsi, 12, 1)?, ..Table::default() };
        let dated = |day: f64, sd: f64| {
            let (spec, name) = ("offset@a22".into(), "offset".into());
            let value = Some(offset + rate * day);
            let estimates = vec![Estimate { spec, name, value, sd: Some(sd) }];
            Dated { day, estimates, covariance: vec![sd * sd], ..Dated::default() }
        };
        // Witness: poses that are found again where the offset has drifted for a hundred days.
        let poses = |value| platform_poses(&rsi, &last(&rsi, value), table.clone());
        let (here, there) = (poses(offset)?, poses(offset + 100.0 * rate)?);
        let apart = |i: usize| (0..3).map(|k| (there[i][k] - here[i][k]).powi(2)).sum::<f64>();
        let sum: f64 = (0..here.len()).map(apart).sum();
        let target = (sum / (3.0 * here.len() as f64)).sqrt();
        let of = |results: &[Dated]| {
            let (series, _) = series(&rsi, results)?;
            let last = last(&rsi, offset);
            let found = forecast(&rsi, &last, results, &series, table.clone(), target)?;
            Ok::<_, Error>(found.expect("a parameter"))
        };
        let found = of(&[-20.0, -10.0, 0.0].map(|day| dated(day, 1e-12)))?;
        // A milliradian: what is not linear is a thousandth of it, a tenth of a day.
        let near = |day: Option<u32>| day.is_some_and(|day| day.abs_diff(100) <= 1);
        assert!(near(found.day) && near(found.from_day) && found.now.abs() < 1e-9, "{found:?}");
        // What the last result leaves open: the median of |z| is .6745, known to 1.2 / √4000 of it by draws.
        let open = of(&[dated(0.0, 1e-3)])?;
        assert!((open.now / (0.6745 * target) - 1.0).abs() < 0.08, "{open:?}");
        // |z| is above 1 in 32 of 100 draws: in one of twenty from the first day on, never in half.
        assert_eq!((open.from_day, open.day), (Some(0), None));
        let nothing = Applied { parameters: Vec::new(), ..last(&rsi, offset) };
        assert_eq!(forecast(&rsi, &nothing, &[], &[], table, target)?, None);
        Ok(())
    }
}

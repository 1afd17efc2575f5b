//! The rates of all parameters of a device together.
//!
//! Estimates of one result are correlated: an offset is told at a reading of zero, so that its error and that of
//! the gain of its channel are nearly opposite, and so are those of their rates. With the covariances `C_i` of the
//! results, and the jumps and the scatter that the courses (127) of single parameters have, all parameters are
//!
//! ```text
//! y_i = a + ρ (t_i - t_n) - Σ_k s_k 1(i ≤ j_k) + e_i,    e_i ~ N(0, C_i + T),    T = Σ_i l_i l_iᵀ      (178)
//! ```
//!
//! `l_i` is what the courses leave of result `i`, each parameter's scaled to `Σ_i l² = τ²`: the scatter that its
//! course has, with the correlations that the results show. Generalised least squares have the rates `ρ̂`, their
//! covariance `P`, and `K = cov(â, ρ̂)`. As `a` is the level at the last date, `K` is also the covariance of `ρ̂` and
//! the error of the last result.

use faer::Mat;

use crate::history::regression::fitted;
use crate::history::series::{Dated, Series};
use crate::numerics::symmetric::invert;

/// What (178) says of parameters, numbered as their series; zero for those without a course. Whose rate nothing tells
/// has none.
pub(super) struct Rates {
    /// `ρ̂`.
    pub(super) value: Vec<f64>,
    /// `P`.
    pub(super) covariance: Mat<f64>,
    /// `K`, a row for each level.
    pub(super) with_level: Mat<f64>,
    /// `T`.
    pub(super) scatter: Mat<f64>,
}

/// The rates of all series over the results of a device, which are in order of their dates.
pub(super) fn rates(results: &[Dated], series: &[Series]) -> Rates {
    let n = series.len();
    let with_course: Vec<usize> = (0..n).filter(|&one| series[one].course.is_some()).collect();
    let told = |one: &usize| series[*one].course.as_ref().is_some_and(|it| it.rate.is_some());
    let with_rate: Vec<usize> = with_course.iter().copied().filter(told).collect();
    let (k, columns) = (with_course.len(), columns(series, &with_course, &with_rate));
    let scatter = scatter(results, series);
    let mut normal = Mat::<f64>::zeros(columns.len(), columns.len());
    let mut rhs = Mat::<f64>::zeros(columns.len(), 1);
    let last = results.last().map_or(0.0, |dated| dated.day);
    for (i, dated) in results.iter().enumerate() {
        let (own, numbers) = known_in(i, series, &with_course);
        let stated = dated.covariance_of(&numbers);
        let both =
            Mat::from_fn(own.len(), own.len(), |a, b| stated[(a, b)] + scatter[(own[a], own[b])]);
        let x = Mat::from_fn(own.len(), columns.len(), |a, c| {
            columns[c].of(own[a], i, dated.day - last)
        });
        // From the last estimate on: a parameter that stands still has a rate of zero, not of rounding.
        let y = Mat::from_fn(own.len(), 1, |a, _| {
            dated.value(numbers[a]) - series[own[a]].last_value(results)
        });
        let weighted = x.transpose() * invert(&both).0;
        normal += &weighted * &x;
        rhs += &weighted * &y;
    }
    let covariance = invert(&normal).0;
    let found = &covariance * &rhs;
    // Levels come first, then rates.
    let level = |one: usize| with_course.binary_search(&one).ok();
    let rate = |one: usize| with_rate.binary_search(&one).ok().map(|at| k + at);
    let part = |of: &dyn Fn(usize) -> Option<usize>| {
        Mat::from_fn(n, n, |a, b| match (of(a), rate(b)) {
            (Some(a), Some(b)) => covariance[(a, b)],
            _ => 0.0,
        })
    };
    Rates {
        value: (0..n).map(|one| rate(one).map_or(0.0, |at| found[(at, 0)])).collect(),
        covariance: part(&rate),
        with_level: part(&level),
        scatter,
    }
}

/// A column of (178): part of what one series does.
struct Column {
    series: usize,
    part: Part,
}

enum Part {
    Level,
    Rate,
    /// A jump, and the result from which on its new level holds.
    Jump(usize),
}

impl Column {
    /// Its entry for a series in a result, so many days after the last.
    fn of(&self, series: usize, result: usize, days: f64) -> f64 {
        match self.part {
            _ if self.series != series => 0.0,
            Part::Level => 1.0,
            Part::Rate => days,
            Part::Jump(from) if result < from => -1.0,
            Part::Jump(_) => 0.0,
        }
    }
}

/// All levels, the rates that something tells, and the jumps of the courses.
fn columns(series: &[Series], with_course: &[usize], with_rate: &[usize]) -> Vec<Column> {
    let levels = with_course.iter().map(|&series| Column { series, part: Part::Level });
    let rates = with_rate.iter().map(|&series| Column { series, part: Part::Rate });
    let jumps = with_course.iter().flat_map(|&one| {
        let jumps = series[one].course.iter().flat_map(|course| &course.jumps);
        let from = jumps.map(move |jump| series[one].known[jump.from].0);
        from.map(move |from| Column { series: one, part: Part::Jump(from) })
    });
    levels.chain(rates).chain(jumps).collect()
}

/// The series that a result knows, and their numbers in it.
fn known_in(result: usize, series: &[Series], among: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let number = |&one: &usize| {
        let known = series[one].known.iter().find(|(at, _)| *at == result);
        known.map(|(_, number)| (one, *number))
    };
    among.iter().filter_map(number).unzip()
}

/// `T`: of parameters whose courses have scatter.
fn scatter(results: &[Dated], series: &[Series]) -> Mat<f64> {
    let left: Vec<Vec<f64>> = series.iter().map(|one| left(one, results)).collect();
    let product = |a: usize, b: usize| left[a].iter().zip(&left[b]).map(|(a, b)| a * b).sum();
    Mat::from_fn(series.len(), series.len(), product)
}

/// `l` of a parameter, by result.
fn left(one: &Series, results: &[Dated]) -> Vec<f64> {
    let mut all = vec![0.0; results.len()];
    let Some(course) = one.course.as_ref().filter(|course| course.scatter > 0.0) else {
        return all;
    };
    let own = fitted(&one.past(results), &course.shape(), course.scatter.powi(2)).left;
    let size = own.iter().map(|r| r * r).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    for ((result, _), r) in one.known.iter().zip(own) {
        all[*result] = course.scatter * r / size;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;
    use crate::apply::moved::Estimate;
    use crate::history::series::series;
    use crate::mechanism::Mechanism;
    use crate::numerics::draws::Draws;

    /// Deviations of an offset at the middle of the readings, and of the gain.
    const SD: [f64; 2] = [1.0, 0.5];

    /// Offset and gain of a channel at ten dates, readings counted from `zero`; `extra` is scatter beside the
    /// stated deviations, in each.
    fn life(zero: f64, extra: f64) -> Vec<Dated> {
        let mut random = Draws::new(7);
        let one = |i: usize| {
            let mut of = |sd: f64| sd.hypot(extra) * random.normal();
            let (middle, gain) = (of(SD[0]), of(SD[1]));
            let (offset, variances) = (middle - zero * gain, SD.map(|sd| sd * sd));
            let covariance = -zero * variances[1];
            let stated = variances[0] + zero * zero * variances[1];
            let estimate = |spec: &str, name: &str, value: f64, variance: f64| Estimate {
                spec: spec.into(),
                name: name.into(),
                value: Some(value),
                sd: Some(variance.sqrt()),
            };
            Dated {
                day: 40.0 * i as f64,
                estimates: vec![
                    estimate("offset@a11", "offset", offset, stated),
                    estimate("gain@a11", "gain", gain, variances[1]),
                ],
                covariance: vec![stated, covariance, covariance, variances[1]],
                ..Dated::default()
            }
        };
        (0..10).map(one).collect()
    }

    /// Variance of rate, covariance of rate and level, and scatter, of the offset at the middle; and its rate.
    fn at_middle(zero: f64, extra: f64) -> Result<[f64; 4], Error> {
        let results = life(zero, extra);
        let (series, _) = series(&Mechanism::rsi(), &results)?;
        let found = rates(&results, &series);
        let along =
            |m: &Mat<f64>| m[(0, 0)] + zero * (m[(0, 1)] + m[(1, 0)]) + zero * zero * m[(1, 1)];
        let of = [&found.covariance, &found.with_level, &found.scatter].map(along);
        Ok([of[0], of[1], of[2], found.value[0] + zero * found.value[1]])
    }

    #[test]
    fn rates_do_not_depend_on_where_the_zero_of_readings_is() -> Result<(), Error> {
        let at = |zero: f64| at_middle(zero, 0.0);
        let [here, near, far] = [at(0.0)?, at(4.0)?, at(4000.0)?];
        // Witness: the variance of the slope of ten values, σ²/Σ(t - t̄)², and its covariance with the value of
        // the line at the last, 180 days after their middle.
        let squares = 40.0_f64.powi(2) * 82.5;
        assert!((here[0] * squares - 1.0).abs() < 1e-9);
        assert!((here[1] * squares / 180.0 - 1.0).abs() < 1e-9);
        for (k, found) in here.iter().enumerate() {
            // Of numbers that are 4000² times as large.
            for (other, allowed) in [(near[k], 1e-10), (far[k], 1e-5)] {
                assert!((found - other).abs() <= allowed * found.abs(), "{k}: {found}, {other}");
            }
        }
        Ok(())
    }

    #[test]
    fn scatter_has_the_correlations_that_results_show() -> Result<(), Error> {
        let [here, there] = [at_middle(0.0, 20.0)?, at_middle(4.0, 20.0)?];
        // What the stated deviations are of the scatter's square, (1/20)² · 4² at most.
        assert!((here[2].sqrt() / 20.0 - 1.0).abs() < 0.5, "{here:?}");
        assert!((there[2] / here[2] - 1.0).abs() < 0.05, "{here:?}, {there:?}");
        Ok(())
    }
}

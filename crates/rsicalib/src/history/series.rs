//! Which parameters of a device have a history, and what each has done.

use faer::Mat;

use crate::Error;
use crate::apply::earlier::outlasts;
use crate::apply::moved::Estimate;
use crate::history::course::{Course, course};
use crate::history::past::Past;
use crate::mechanism::Mechanism;
use crate::model::Spec;
use crate::terms::term::Outlasts;

/// One result of a device.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dated {
    /// Date, in days.
    pub day: f64,
    /// Its parameters.
    pub estimates: Vec<Estimate>,
    /// Covariance of those that have a value, row by row; empty: their deviations are all that is known.
    pub covariance: Vec<f64>,
    /// Where something has changed since an earlier result, as it says itself.
    pub changed: Vec<Spec>,
}

impl Dated {
    /// Covariance of some parameters that have a value and a deviation, by their numbers.
    pub(super) fn covariance_of(&self, numbers: &[usize]) -> Mat<f64> {
        let with_value: Vec<usize> =
            (0..self.estimates.len()).filter(|&k| self.estimates[k].value.is_some()).collect();
        let at: Vec<usize> =
            numbers.iter().filter_map(|number| with_value.binary_search(number).ok()).collect();
        let stated = |a: usize, b: usize| {
            self.covariance.get(at[a] * with_value.len() + at[b]).copied().unwrap_or(f64::NAN)
        };
        let whole = Mat::from_fn(at.len(), at.len(), stated);
        if whole.is_all_finite() {
            return whole;
        }
        let variance = |k: usize| self.estimates[numbers[k]].sd.map_or(0.0, |sd| sd * sd);
        Mat::from_fn(at.len(), at.len(), |a, b| if a == b { variance(a) } else { 0.0 })
    }

    /// A parameter that has a value, by its number.
    pub(super) fn value(&self, number: usize) -> f64 {
        self.estimates[number].value.unwrap_or_default()
    }
}

/// One parameter of a device over time.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Series {
    /// Its term at its target.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub spec: Spec,
    /// Its name.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub name: String,
    /// The results that know it, from 0, each with the number of the parameter in it.
    pub known: Vec<(usize, usize)>,
    /// What it has done, its jumps numbered among the results that know it; none where that cannot be told.
    pub course: Option<Course>,
}

impl Series {
    /// What the results say of it.
    pub(super) fn past(&self, results: &[Dated]) -> Vec<Past> {
        let one = |&(result, number): &(usize, usize)| {
            let Dated { day, estimates, .. } = &results[result];
            let Estimate { value, sd, .. } = &estimates[number];
            Some(Past { day: *day, value: (*value)?, sd: (*sd)? })
        };
        self.known.iter().filter_map(one).collect()
    }

    /// Its value in the last result that knows it.
    pub(super) fn last_value(&self, results: &[Dated]) -> f64 {
        self.known.last().map_or(0.0, |&(result, number)| results[result].value(number))
    }
}

/// What the parameters of a device have done over its results, which are in order of their dates, by the order
/// in which they appear; and the effects that belong to single sessions.
///
/// # Errors
///
/// [`Error::Unknown`] where a result has a term that there is not.
pub fn series(mechanism: &Mechanism, results: &[Dated]) -> Result<(Vec<Series>, Vec<Spec>), Error> {
    let (mut all, mut passing) = (Vec::<Series>::new(), Vec::new());
    for (result, dated) in results.iter().enumerate() {
        for (number, Estimate { spec, name, value, sd }) in dated.estimates.iter().enumerate() {
            if outlasts(mechanism, spec)? != Outlasts::Whole {
                if !passing.contains(spec) {
                    passing.push(spec.clone());
                }
            } else if value.is_some() && sd.is_some() {
                let at = all.iter().position(|one| (&one.spec, &one.name) == (spec, name));
                let one = at.unwrap_or(all.len());
                if at.is_none() {
                    let (spec, name, known) = (spec.clone(), name.clone(), Vec::new());
                    all.push(Series { spec, name, known, course: None });
                }
                all[one].known.push((result, number));
            }
        }
    }
    let tests = all.len();
    for one in &mut all {
        let from = told(mechanism, results, &one.spec)?;
        let first = |from: usize| one.known.iter().position(|(result, _)| *result >= from);
        let told: Vec<usize> = from.into_iter().filter_map(first).collect();
        one.course = course(&one.past(results), &told, tests);
    }
    Ok((all, passing))
}

/// Results from which on a parameter has changed, as one of them says.
///
/// A result that was compared with an earlier one says what has changed since; what has happened within a
/// session (a slip) is a new level from the next result on.
fn told(mechanism: &Mechanism, results: &[Dated], spec: &Spec) -> Result<Vec<usize>, Error> {
    let mut told = Vec::new();
    for (i, Dated { estimates, changed, .. }) in results.iter().enumerate() {
        if changed.iter().any(|c| (&c.term, &c.target) == (&spec.term, &spec.target)) {
            told.push(i);
        }
        for Estimate { spec: other, .. } in estimates {
            if other.target == spec.target && outlasts(mechanism, other)? == Outlasts::Value {
                told.push(i + 1);
            }
        }
    }
    Ok(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(spec: &str, value: f64) -> Estimate {
        Estimate { spec: spec.into(), name: "offset".into(), value: Some(value), sd: Some(1.0) }
    }

    #[test]
    fn a_slip_is_a_new_level_from_the_next_result_on() -> Result<(), Error> {
        // A step of 2: of two means of four, z = 2.83, which pays where it is told and not where it is searched.
        let value = |i: usize| if i < 4 { 0.0 } else { 2.0 };
        let dated = |i: usize, also: &[&str]| {
            let more = also.iter().map(|spec| estimate(spec, 2.0));
            let estimates = std::iter::once(estimate("offset@a11", value(i))).chain(more).collect();
            Dated { day: i as f64, estimates, ..Dated::default() }
        };
        let jumps = |also: &str, at: usize| -> Result<usize, Error> {
            let also = |i| if i == at { vec![also] } else { vec![] };
            let results: Vec<Dated> = (0..8).map(|i| dated(i, &also(i))).collect();
            let (series, passing) = series(&Mechanism::rsi(), &results)?;
            assert_eq!((series.len(), series[0].known.len(), passing.len()), (1, 8, 1));
            Ok(series[0].course.as_ref().map_or(0, |course| course.jumps.len()))
        };
        assert_eq!(jumps("slip@a11:17", 3)?, 1);
        // After the step, of another channel, or a drift that has gone: none tells of it.
        assert_eq!(jumps("slip@a11:17", 4)?, 0);
        assert_eq!(jumps("slip@a12:17", 3)?, 0);
        assert_eq!(jumps("drift@a11", 3)?, 0);
        Ok(())
    }

    #[test]
    fn a_parameter_is_known_where_it_has_a_value_and_a_deviation() -> Result<(), Error> {
        let unknown = |spec: &str| Estimate { sd: None, ..estimate(spec, 1.0) };
        let result = |estimates: Vec<Estimate>| Dated { estimates, ..Dated::default() };
        let results = [
            result(vec![unknown("offset@a11"), estimate("offset@a12", 1.0)]),
            result(vec![estimate("offset@a12", 1.0), estimate("offset@a11", 1.0)]),
        ];
        let (series, passing) = series(&Mechanism::rsi(), &results)?;
        let known: Vec<_> = series.iter().map(|one| (one.spec.to_string(), &*one.known)).collect();
        assert_eq!(known[0], ("offset@a12".to_owned(), &[(0, 1), (1, 0)][..]));
        assert_eq!(known[1], ("offset@a11".to_owned(), &[(1, 1)][..]));
        assert!(passing.is_empty() && series.iter().all(|one| one.course.is_none()));
        Ok(())
    }
}

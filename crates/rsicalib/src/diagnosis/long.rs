//! The search of a long recording: by stretches, row by row where something happened, and kept
//! only as far as all rows confirm it.

use crate::numerics::order::Ends;
use faer::Mat;

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::isolation::Isolated;
use crate::diagnosis::options::{LEVEL, SearchOptions};
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::search::outcome::{FoundEffect, Searched};
use crate::diagnosis::stretches::{Stretches, bad_rows};
use crate::estimate::{Fit, Observations, fit};
use crate::model::Instance;
use crate::numerics::symmetric::invert;

/// Times that a search is repeated with rows that it did not see one by one, at the most.
const LOOKS: usize = 2;

/// A search of a session.
pub struct Search<'a> {
    /// Its state.
    pub averaged: Averaged<'a>,
    /// Where it ended.
    pub searched: Searched,
    /// What is at fault alone.
    pub isolated: Option<Isolated>,
    /// The fit of all rows of a long recording with what was found; none where nothing was, and of
    /// another session.
    pub all: Option<Fit>,
}

impl Search<'_> {
    /// The fit of all rows where the search was by stretches, else its last one.
    pub(crate) fn answer(&self) -> &Fit {
        self.all.as_ref().unwrap_or(&self.searched.current)
    }

    /// True where no more than noise is left by effects alone, all readings kept.
    pub fn keeps_all(&self) -> bool {
        let Searched { current, found, poses, .. } = &self.searched;
        let wrong = !poses.is_empty() || found.iter().any(|step| is_data(&step.scored.instance));
        let left = self.averaged.judge(current).lack_of_fit(current);
        !wrong && left.is_some_and(|p| p > LEVEL)
    }
}

/// Searches a recording of many rows by its stretches; none where there are few. `one` is the
/// search of a session of one sample for each stretch.
///
/// # Errors
///
/// As [`fit`].
pub fn search_long<'a>(
    observations: &Observations,
    clean: &Fit,
    search: &'a SearchOptions,
    one: impl Fn(&mut Averaged<'a>) -> Result<(Searched, Option<Isolated>), Error>,
) -> Result<Option<Search<'a>>, Error> {
    let mut apart = bad_rows(observations, clean);
    for look in 0.. {
        let stretches = Stretches::of(observations, &clean.noise, &apart);
        let Some(stretches) = stretches else { break };
        let mut averaged = Averaged::by_stretches(observations, stretches.clone(), clean, search);
        let (mut searched, isolated) = one(&mut averaged)?;
        let all = all_rows(observations, clean, &stretches, &searched)?;
        let mut more = stretches.closer(searched.found.iter().map(|step| &step.scored));
        if let Some(all) = &all {
            more.extend(bad_rows(observations, all));
        }
        more.retain(|row| apart.binary_search(row).is_err());
        if more.is_empty() || look == LOOKS {
            let all = match all {
                Some(all) => {
                    confirmed(observations, clean, &averaged, &stretches, all, &mut searched)?
                }
                None => None,
            };
            return Ok(Some(Search { averaged, searched, isolated, all }));
        }
        apart.extend(more);
        apart.sort_unstable();
        apart.dedup();
    }
    Ok(None)
}

/// The fit of all rows with what was found by stretches; none where nothing was.
fn all_rows(
    observations: &Observations,
    clean: &Fit,
    stretches: &Stretches,
    searched: &Searched,
) -> Result<Option<Fit>, Error> {
    if searched.found.is_empty() {
        return Ok(None);
    }
    let current = &searched.current;
    let of_all = |i: &Instance| stretches.in_all(i);
    let instances: Vec<Instance> = current.model.instances.iter().map(of_all).collect();
    let model = observations.model(instances.clone())?;
    let from = Fit { model: model.into(), ..current.with_noise_of(clean) };
    fit(observations, instances, Some(&from)).map(Some)
}

/// Drops what explains no more of all rows than is paid for it, worst first.
fn confirmed(
    observations: &Observations,
    clean: &Fit,
    averaged: &Averaged,
    stretches: &Stretches,
    mut all: Fit,
    searched: &mut Searched,
) -> Result<Option<Fit>, Error> {
    loop {
        let gain = |step: &FoundEffect| {
            rise(&all, &stretches.in_all(&step.scored.instance)) - step.scored.paid()
        };
        let gains: Vec<f64> = searched.found.iter().map(gain).collect();
        let unknown = gains.iter().position(|gain| gain.is_nan());
        let worst = unknown.or_else(|| (0..gains.len()).least_by(|&k| gains[k]));
        let Some(worst) = worst.filter(|&k| gains[k].is_nan() || gains[k] <= 0.0) else {
            return Ok(Some(all));
        };
        let gone = searched.found.remove(worst).scored.instance;
        searched.current = averaged.without(&searched.current, &[gone])?;
        searched.rivals.clear();
        match all_rows(observations, clean, stretches, searched)? {
            Some(rest) => all = rest,
            None => return Ok(None),
        }
    }
}

/// By how much χ² would rise without an effect, to second order: `pᵀ C⁻¹ p` with the covariance
/// `C` of its parameters `p`, which knows how rows resemble their neighbours.
#[must_use]
pub fn rise(fit: &Fit, instance: &Instance) -> f64 {
    let Some(k) = fit.model.instances.iter().position(|i| i == instance) else { return f64::NAN };
    let (first, width) = (fit.model.first[k], instance.width());
    let covariance = Mat::from_fn(width, width, |i, j| fit.covariance[(first + i, first + j)]);
    let (inverse, ..) = invert(&covariance);
    let p = Mat::from_fn(width, 1, |i, _| fit.beta[first + i]);
    (p.transpose() * inverse * &p)[(0, 0)]
}

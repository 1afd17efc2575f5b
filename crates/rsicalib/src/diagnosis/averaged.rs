//! A session as the search sees it: one sample for each held pose, or stretch of a long recording, with
//! its noise, and what its readings say of a fit.

use std::sync::{Mutex, PoisonError};

use crate::Error;
use crate::diagnosis::options::{LEVEL, Rule, SearchOptions};
use crate::diagnosis::price::{Data, Said, Scale};
use crate::diagnosis::score::scan;
use crate::diagnosis::score::scored::{Judge, Scored};
use crate::diagnosis::search::known::KnownScans;
use crate::diagnosis::stretches::Stretches;
use crate::estimate::noise::open;
use crate::estimate::noise::source::variance_of_readings;
use crate::estimate::on_closures::means;
use crate::estimate::{Fit, FitOptions, Noise, Observations, fit};
use crate::model::Instance;
use crate::numerics::lm;
use crate::readings::Readings;
use crate::screening::blame::Blame;
use crate::screening::excluded::{Cause, Excluded};

/// A fit of the search ends where a step lowers χ² by no more than this share: far from its noise a fit creeps
/// for hundreds of steps. Decisions turn on units of χ², and the answer is fitted to all digits.
const CREEPS: f64 = 1e-5;

/// It ends as well after a step of this share of its parameters.
const SHORT: f64 = 1e-7;

/// A session as the search sees it.
pub struct Averaged<'a> {
    /// One sample for each held pose, or stretch of a long recording.
    pub small: Observations,
    /// How to search.
    pub search: &'a SearchOptions,
    /// Weights of the samples before any pose was left out.
    pub(crate) counts: Vec<f64>,
    /// Samples of each pose.
    samples: Vec<usize>,
    /// The stretches of a long recording.
    pub(crate) stretches: Option<Stretches>,
    /// True where its noise judges what a fit leaves.
    judges: bool,
    noise_dof: f64,
    /// Its noise is declared, and nothing bears it out.
    unverified: bool,
    /// What readings say of an explanation.
    pub(crate) data: Data,
    /// Scores at fits: the same are asked for again.
    scans: Mutex<KnownScans>,
}

impl<'a> Averaged<'a> {
    /// A search of a session, in which the samples of held poses are averaged.
    pub fn new(
        observations: &Observations,
        fit: &Fit,
        search: &'a SearchOptions,
    ) -> Result<Self, Error> {
        let readings = &observations.readings;
        let averaged = match readings.held {
            true => Some(means(observations, fit)?),
            false => None,
        };
        let samples = readings.rows_of_poses().iter().map(Vec::len).collect();
        Ok(Self::of(observations, averaged, samples, fit.noise.inflation, fit, search))
    }

    /// A search of a long recording, by its stretches.
    pub fn by_stretches(
        observations: &Observations,
        stretches: Stretches,
        fit: &Fit,
        search: &'a SearchOptions,
    ) -> Self {
        let (readings, counts) = stretches.merged(observations, fit);
        let samples = counts.iter().map(|n| *n as usize).collect();
        let slow = fit.noise.slow;
        let averaged = Some((readings, counts));
        let it = Self::of(observations, averaged, samples, slow, fit, search);
        Self { stretches: Some(stretches), ..it }
    }

    /// A search of a session, or of means of its samples with the number of samples of each, whose
    /// variance is `inflation` times that of means of independent samples.
    fn of(
        observations: &Observations,
        averaged: Option<(Readings, Vec<f64>)>,
        samples: Vec<usize>,
        inflation: f64,
        fit: &Fit,
        search: &'a SearchOptions,
    ) -> Self {
        let mut small = observations.clone();
        let mut share = 1.0;
        if let Some((readings, counts)) = averaged {
            let usual = counts.iter().copied().fold(1.0, f64::max);
            small.weights = counts.iter().map(|n| (n / usual).sqrt()).collect();
            small.readings = readings.into();
            share = inflation / usual;
        }
        let Noise { sigma, play, seating, measured } =
            fit.noise.of_means(share, small.readings.held);
        let lm = lm::SolverOptions { ftol: CREEPS, xtol: SHORT, ..observations.options.lm.clone() };
        let noise = Some(sigma);
        small.judged = true;
        let measured = Some(measured);
        small.options =
            FitOptions { noise, play, seating, measured, lm, ..observations.options.clone() };
        let counts = small.weights.clone();
        let (judges, noise_dof) = (fit.noise.judges(), fit.noise.dof_of_pose());
        let scale = match (judges, fit.unverified()) {
            (false, _) => Scale::Fitted,
            (true, true) => Scale::Declared,
            (true, false) => Scale::Known(noise_dof),
        };
        Self {
            small,
            search,
            counts,
            samples,
            stretches: None,
            judges,
            noise_dof,
            unverified: fit.unverified(),
            data: Data { scale, dof: fit.dof },
            scans: Mutex::default(),
        }
    }

    pub fn judge(&self, fit: &Fit) -> Judge {
        let residual = (!self.judges).then_some([fit.total, fit.dof]);
        let left = self.unverified.then_some([fit.chi2, fit.dof]);
        Judge { noise_dof: self.noise_dof, residual, left, said: self.said(fit) }
    }

    /// Takes a declared noise for a bound, where an explanation leaves less of it than chance allows;
    /// true where that is new.
    pub fn bounded_by(&mut self, explained: &Fit) -> bool {
        let too_little = |p: f64| 1.0 - p <= LEVEL;
        let less = self.judge(explained).lack_of_fit(explained).is_some_and(too_little);
        let new = self.data.scale == Scale::Declared && less && self.search.uses(Rule::Bound);
        if new {
            self.data.scale = Scale::Bound;
        }
        new
    }

    /// Scores of what may be wrong.
    ///
    /// # Errors
    ///
    /// As [`scan::scan`].
    pub fn scan(&self, fit: &Fit) -> Result<Vec<Scored>, Error> {
        let new = || scan::scan(&self.small, fit, &self.judge(fit), self.search);
        self.scans.lock().unwrap_or_else(PoisonError::into_inner).scan(&self.small, fit, new)
    }

    /// The session with all poses.
    pub fn all(&self) -> Observations {
        Observations { weights: self.counts.clone(), ..self.small.clone() }
    }

    /// Where nothing but the fit gives the noise, it shrinks as the model grows.
    pub fn rescale(&mut self, current: &mut Fit) -> Result<(), Error> {
        if self.judges || current.dof < 1.0 {
            return Ok(());
        }
        if !self.small.options.seating.is_empty() {
            let seating = open::improved(&self.small, current).seating;
            self.small.options.seating = seating;
            *current = fit(&self.small, current.model.instances.clone(), Some(current))?;
            return Ok(());
        }
        let (residuals, dof) = (&current.residuals, current.dof);
        let scale = variance_of_readings(residuals, current.total / dof, dof).sqrt();
        if let Some(sigma) = &mut self.small.options.noise {
            sigma.iter_mut().for_each(|s| *s *= scale);
        }
        *current = fit(&self.small, current.model.instances.clone(), Some(current))?;
        Ok(())
    }

    /// The fit without some of its effects.
    pub fn without(&self, current: &Fit, gone: &[Instance]) -> Result<Fit, Error> {
        let kept = current.model.instances.iter().copied().filter(|i| !gone.contains(i));
        fit(&self.small, kept.collect(), Some(current))
    }

    /// What readings say of a fit, and of those beside it.
    pub(crate) fn said(&self, fit: &Fit) -> Said {
        let larger_noise = self.search.uses(Rule::LargerNoise);
        Said { data: self.data, chi2: fit.cost(), larger_noise }
    }

    /// What readings say of a fit.
    pub(crate) fn said_of(&self, fit: &Fit) -> f64 {
        self.data.of(fit.cost())
    }

    /// An instance of the search as one of the session.
    pub fn in_all(&self, instance: &Instance) -> Instance {
        Stretches::in_session(self.stretches.as_ref(), instance)
    }

    /// A bad reading, with the channel where it can be told, else the likeliest chain.
    pub fn bad_reading(&self, instance: &Instance, blame: Blame) -> Excluded {
        let (channel, chain) = (blame.channel, blame.chain);
        let (pose, samples) = (self.in_all(instance).place, self.samples[instance.place]);
        Excluded { channel, chain, ..Excluded::of(Some(pose), samples, Cause::Reading(blame)) }
    }

    pub fn excluded(&self, step: &Scored) -> Excluded {
        let pose = step.instance.place;
        let cause = Cause::Pose { p_value: step.p_value };
        Excluded::of(Some(pose), self.samples[pose], cause)
    }
}

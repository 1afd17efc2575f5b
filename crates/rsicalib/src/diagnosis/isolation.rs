//! Whether one channel, closure or chain is at fault alone, by whatever law.
//!
//! With `σ_c → ∞` the fit ignores `c` and uses all other equations: each pose loses as many
//! equations as `c` moves,
//!
//! ```text
//! χ²_c ~ χ²(ν - Σ_p rank A_p,c + n_c)                                      (73)
//! ```
//!
//! with `n_c` the parameters that only `c` has. Where the rest closes within its noise,
//! and nothing in it stands out, `c` is all that is wrong.

use crate::Error;
use crate::diagnosis::options::{LEVEL, SearchOptions};
use crate::diagnosis::score::scored::{self, Judge, Scored};
use crate::diagnosis::score::{places, scan};
use crate::estimate::at_fit::AtFit;
use crate::estimate::noise::source::LEAST_DOF;
use crate::estimate::{Fit, Observations, fit};
use crate::mechanism::{Mechanism, Target};
use crate::numerics::credible_set::{SURE, probabilities};
use crate::numerics::order;
use crate::numerics::symmetric::dot;
use crate::numerics::workers;

/// Standard deviation of a reading that the fit ignores, in units of its own noise.
const UNBOUNDED: f64 = 1e4;

/// Number of candidates that are refitted, smallest remaining χ² first.
const LIKELY: usize = 3;

/// By how much χ² falls, by chance, and is charged, for each equation that is given up (Akaike).
const EQUATION: f64 = 2.0;

/// What is at fault alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Isolated {
    /// A channel, a closure or a chain.
    pub target: Target,
    /// Probability of a larger χ² of the rest, (73).
    pub p_value: f64,
    /// By how much it explains more than it is charged.
    pub gain: f64,
}

/// The channel or closure, or else the chain, that is at fault alone; none where there is
/// no such one, or where nothing but the fit gives the noise.
///
/// `start` is the fit without any effect.
///
/// # Errors
///
/// As [`fit`].
pub fn isolate<'a>(
    observations: &Observations,
    start: &'a Fit,
    judge: &Judge,
    search: &SearchOptions,
) -> Result<Option<Isolated>, Error> {
    let mechanism = &observations.mechanism;
    if judge.residual.is_some() {
        return Ok(None);
    }
    let closures = mechanism.closures.iter().enumerate().filter(|(_, c)| !mechanism.is_link(c));
    let channels = (0..mechanism.channels.len()).map(Target::Channel);
    let single = channels.chain(closures.map(|(k, _)| Target::Closure(k))).collect();
    let others_close = |chain: &usize| closes_without(mechanism, *chain);
    let chains = (0..mechanism.chains.len()).filter(others_close).map(Target::Chain).collect();
    let kinds: [Vec<Target>; 2] = [single, chains];
    for kind in kinds {
        let released = workers::map(kind, |target| Released::of(observations, start, target));
        let released: Vec<Option<Released>> = released.into_iter().collect::<Result<_, _>>()?;
        let mut able: Vec<Released> = released.into_iter().flatten().collect();
        order::ascending(&mut able, |a| a.left());
        able.truncate(LIKELY);
        let alone = |mut it: Released<'a>| -> Result<_, Error> {
            let alone = it.closes(judge)? && !it.needs_more(judge, search)?;
            Ok(alone.then_some(it))
        };
        let isolated: Vec<Option<Released>> =
            workers::map(able, alone).into_iter().collect::<Result<_, _>>()?;
        let isolated: Vec<Released> = isolated.into_iter().flatten().collect();
        let scores: Vec<(f64, Target)> =
            isolated.iter().map(|it| (-it.left(), it.target)).collect();
        if let Some(&(target, sure)) = probabilities(&scores).first()
            && sure >= SURE
        {
            let it = isolated.into_iter().find(|it| it.target == target);
            return Ok(it.map(|it| it.isolated()));
        }
    }
    Ok(None)
}

/// A channel or a chain at fault, where all but its errors closes within its noise, (73).
///
/// # Errors
///
/// As [`fit`].
pub fn isolated_at(
    observations: &Observations,
    base: &Fit,
    target: Target,
    judge: &Judge,
    search: &SearchOptions,
) -> Result<Option<Isolated>, Error> {
    let Some(mut it) = Released::of(observations, base, target)? else { return Ok(None) };
    let alone = it.closes(judge)? && !it.needs_more(judge, search)?;
    Ok(alone.then(|| it.isolated()))
}

/// True where a closure of readings is left that a chain takes no part in: without such a one
/// any chain would be at fault alone, for want of others that could tell.
fn closes_without(mechanism: &Mechanism, chain: usize) -> bool {
    let carried = |name: &String| {
        let point = mechanism.points.iter().find(|p| p.name == *name);
        point.is_some_and(|p| p.chain.as_ref() == Some(&mechanism.chains[chain].name))
    };
    let mut closures = mechanism.closures.iter().filter(|c| !mechanism.is_link(c));
    closures.any(|c| !c.between.iter().any(carried))
}

/// A fit to all but one thing.
struct Released<'a> {
    start: &'a Fit,
    target: Target,
    released: Observations,
    rest: Fit,
    /// Equations between poses.
    equations: f64,
    /// How many of them are given up.
    lost: f64,
    p_value: f64,
}

impl<'a> Released<'a> {
    /// None where without it there is nothing to judge by.
    fn of(
        observations: &Observations,
        start: &'a Fit,
        target: Target,
    ) -> Result<Option<Self>, Error> {
        let released = released(observations, start, target);
        let (equations, lost) = equations(&released, start, target);
        if equations - lost < LEAST_DOF {
            return Ok(None);
        }
        let rest = fit(&released, start.model.instances.clone(), Some(start))?;
        Ok(Some(Self { start, target, released, rest, equations, lost, p_value: 0.0 }))
    }

    fn isolated(&self) -> Isolated {
        let gain = self.start.chi2 - self.left();
        Isolated { target: self.target, p_value: self.p_value, gain }
    }

    /// χ² with what is paid for it.
    fn left(&self) -> f64 {
        self.rest.chi2 + EQUATION * self.lost
    }

    /// Degrees of freedom of (73).
    fn dof(&self) -> f64 {
        let own = own(self.start, &self.released.mechanism, self.target);
        // Priors may know more of the parameters than the readings do.
        (self.rest.dof - self.lost + own).min(self.equations - self.lost)
    }

    /// Whether the rest closes within its noise, and no other reading or pose is wrong.
    fn closes(&mut self, judge: &Judge) -> Result<bool, Error> {
        let dof = self.dof();
        self.p_value = judge.too_large(self.rest.chi2, dof);
        Ok(dof >= LEAST_DOF && self.p_value > LEVEL && !self.has_wrong_readings(judge)?)
    }

    /// Whether a reading, or a pose, is wrong though this says nothing.
    fn has_wrong_readings(&self, judge: &Judge) -> Result<bool, Error> {
        let mechanism = &self.released.mechanism;
        if !self.released.readings.held {
            return Ok(false);
        }
        let scored = places::bad_readings(&AtFit::new(&self.released, &self.rest), judge)?;
        let elsewhere = |s: &&Scored| !belongs(mechanism, s.instance.target, self.target);
        Ok(scored.iter().filter(elsewhere).any(|s| s.charged() > 0.0))
    }

    /// Whether something else stands out.
    fn needs_more(&self, judge: &Judge, search: &SearchOptions) -> Result<bool, Error> {
        let mechanism = &self.released.mechanism;
        let scored = scan::scan(&self.released, &self.rest, &judge.of(&self.rest), search)?;
        let elsewhere = |s: &Scored| {
            !scored::is_data(&s.instance) && !belongs(mechanism, s.instance.target, self.target)
        };
        Ok(scored.iter().any(|s| elsewhere(s) && s.charged() > 0.0))
    }
}

/// Equations between poses, and how many of them are given up.
fn equations(observations: &Observations, start: &Fit, target: Target) -> (f64, f64) {
    let mechanism = &observations.mechanism;
    let Observations { readings, weights, .. } = observations;
    let all = start.model.told_by(readings, weights) as f64;
    let holds = |k: usize| {
        let live = (0..readings.samples).filter(|&row| weights[row] > 0.0);
        live.filter(|&row| readings.holding.holds(row, k)).count()
    };
    let lost = match target {
        Target::Closure(k) => (holds(k) * start.model.equations_of(k)) as f64,
        _ => taken_up(observations, start, &channels_of(mechanism, target)).1,
    };
    // In a recording neighbours are poses that were sampled several times.
    let between = 1.0 - start.within / all.max(1.0);
    (all * between, lost * between)
}

/// The session in which this says nothing.
fn released(observations: &Observations, base: &Fit, target: Target) -> Observations {
    let mut released = observations.clone();
    let mut sigma = base.assumed().sigma;
    for channel in channels_of(&observations.mechanism, target) {
        sigma[channel] *= UNBOUNDED;
    }
    released.options.noise = Some(sigma);
    if let Target::Closure(k) = target {
        released.mechanism.closures[k].noise = Some(UNBOUNDED * base.rms_misclosure);
    }
    released
}

/// `n_c`: what only this has, of what can be known.
fn own(base: &Fit, mechanism: &Mechanism, target: Target) -> f64 {
    let model = &base.model;
    let its = model.instances.iter().zip(&model.first);
    let its = its.filter(|(instance, _)| belongs(mechanism, instance.target, target));
    let known = its.map(|(instance, &first)| {
        base.unknowable[first..first + instance.width()].iter().filter(|u| !**u).count()
    });
    known.sum::<usize>() as f64
}

pub(crate) fn channels_of(mechanism: &Mechanism, target: Target) -> Vec<usize> {
    match target {
        Target::Channel(channel) => vec![channel],
        Target::Chain(chain) => mechanism.channels_of(chain),
        _ => Vec::new(),
    }
}

/// True where what is wrong with `target` is a fault of `of`: a channel, a closure or a chain.
#[must_use]
pub fn belongs(mechanism: &Mechanism, target: Target, of: Target) -> bool {
    match (of, target) {
        (Target::Chain(chain), Target::Row(its, _)) => its == chain,
        (Target::Chain(chain), Target::Channel(channel)) => {
            mechanism.chain_of(channel) == Some(chain)
        }
        (Target::Closure(closure), Target::Place(place)) => {
            mechanism.closures_at(place).any(|touching| touching == closure)
        }
        _ => of == target,
    }
}

/// χ² of what is left that errors of these channels, free in each pose, would take
/// up, and in how many dimensions.
#[must_use]
pub fn taken_up(observations: &Observations, fit: &Fit, channels: &[usize]) -> (f64, f64) {
    let residuals = &fit.residuals;
    let (k, c) = (residuals.equations, observations.readings.channels);
    let (mut taken, mut dimensions) = (0.0, 0.0);
    for row in (0..observations.readings.samples).filter(|&r| observations.weights[r] > 0.0) {
        let r = &residuals.whitened[row * k..(row + 1) * k];
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for &channel in channels {
            let column: Vec<f64> =
                (0..k).map(|e| residuals.by_reading[(row * k + e) * c + channel]).collect();
            let mut rest = column.clone();
            for known in &basis {
                let along = dot(known, &rest);
                rest.iter_mut().zip(known).for_each(|(r, k)| *r -= along * k);
            }
            let length = dot(&rest, &rest).sqrt();
            if length > 1e-6 * dot(&column, &column).sqrt() {
                basis.push(rest.iter().map(|v| v / length).collect());
            }
        }
        taken += basis.iter().map(|b| dot(b, r).powi(2)).sum::<f64>();
        dimensions += basis.len() as f64;
    }
    (taken, dimensions)
}

//! The moves of a search: add the best effect, drop what is no longer needed, exchange
//! some for others, and say what fits as well.

use std::cell::RefCell;
use std::slice;

use crate::Error;
use crate::diagnosis::isolation::belongs;
use crate::diagnosis::options::{LEVEL, Rule, SearchOptions};
use crate::diagnosis::price::{CHARGE, Data, Scale, room};
use crate::diagnosis::score::pairs::{self, Pair};
use crate::diagnosis::score::scored::{self, Judge, Scored, excluded_pose, one_place_each};
use crate::diagnosis::score::{candidates, scan};
use crate::diagnosis::stepwise::known::{KnownFits, KnownScans};
use crate::diagnosis::stepwise::orders::{has_order, nearest_place};
use crate::diagnosis::stretches::Stretches;
use crate::estimate::noise::open;
use crate::estimate::noise::source::variance_of_readings;
use crate::estimate::search::ratios;
use crate::estimate::{Fit, FitOptions, Observations, fit};
use crate::kinematics::elements::Weight;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::lm;
use crate::numerics::workers;
use crate::readings::Readings;
use crate::screening::blame::Blame;
use crate::screening::excluded::{Cause, Excluded};
use crate::terms::term::Acts;

/// To this fraction of its χ² a fit of the search need be at its minimum: decisions
/// turn on units of χ², and the answer is fitted to all digits.
const ENOUGH: f64 = 1e-7;

/// In place of another effect is named what fits better by this, in units of χ².
pub(crate) const BETTER: f64 = 0.5;

/// A parameter of an effect in units of its standard deviation; none where the effect
/// is not in the model, or not to be seen.
fn estimate_of(fit: &Fit, instance: &Instance) -> Option<f64> {
    let k = fit.model.instances.iter().position(|i| i == instance)?;
    let first = fit.model.first[k];
    let variance = fit.covariance[(first, first)];
    (variance > 0.0).then(|| fit.beta[first] / variance.sqrt())
}

/// False for a load of the catalogue that acts the other way: a joint cannot give against a weight,
/// and what explains the residual so is something else. The sign of a user's law is the user's.
pub(crate) fn physical(fit: &Fit, instance: &Instance) -> bool {
    !instance.term.is_load()
        || instance.term.info().law
        || estimate_of(fit, instance).is_none_or(|sure| sure > 0.0)
}

/// True where a candidate does not catch up with what another has gained: scores are first order.
fn left_behind(candidate: &Scored, gain: f64) -> bool {
    gain > candidate.charged() + room(candidate.score)
}

/// An effect changes the gain that a fit gives a channel by less than this factor.
const SWUNG: f64 = 2.0;

/// True where a channel's gain is far from what it was without an effect, or has turned round: a
/// large effect and a gain that undoes it follow any curve.
fn swung(before: &Fit, after: &Fit) -> bool {
    let (was, is) = (ratios(&before.model, &before.beta), ratios(&after.model, &after.beta));
    was.zip(is).any(|(was, is)| !(1.0 / SWUNG..SWUNG).contains(&(is / was)))
}

/// Standard deviations of a mean square by which chance makes it larger.
const BY_CHANCE: f64 = 2.0;

/// True where loops are farther from closed than before, by more than the sampling error of a root
/// mean square: an effect that makes equations weightless explains nothing.
fn opened(before: &Fit, after: &Fit) -> bool {
    let error = BY_CHANCE / (2.0 * before.dof.max(1.0)).sqrt();
    after.rms_misclosure > before.rms_misclosure * (1.0 + error)
}

/// After so many moves an order has settled, or never will.
const ORDER_MOVES: usize = 3;

/// The state of a search.
pub struct Stepwise<'a> {
    /// One sample for each held pose, or stretch of a long recording.
    pub small: Observations,
    /// The channel, closure or chain to which the search is confined.
    pub only: Option<Target>,
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
    /// Fits of the search: the same are asked for again and again.
    known: RefCell<KnownFits>,
    scans: RefCell<KnownScans>,
}

impl<'a> Stepwise<'a> {
    /// A search of a session, in which the samples of held poses are averaged.
    pub fn new(
        observations: &Observations,
        fit: &Fit,
        search: &'a SearchOptions,
    ) -> Result<Self, Error> {
        let readings = &observations.readings;
        let averaged = match readings.held {
            true => Some(readings.averaged(&observations.mechanism, &observations.weights)?),
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
        let (mut sigma, mut play) = (fit.assumed().sigma, fit.noise.play);
        let mut measured = fit.noise.measured.clone();
        if let Some((readings, counts)) = averaged {
            let usual = counts.iter().copied().fold(1.0, f64::max);
            small.weights = counts.iter().map(|n| (n / usual).sqrt()).collect();
            small.readings = readings.into();
            let share = inflation / usual;
            sigma.iter_mut().for_each(|s| *s *= share.sqrt());
            // Every row of a recording has a play of its own; the samples of a pose share one, and each
            // has measured its own length.
            if !small.readings.held {
                play *= share;
            }
            measured.iter_mut().for_each(|factor| *factor *= share);
        }
        let lm =
            lm::SolverOptions { ftol: ENOUGH, xtol: ENOUGH, ..observations.options.lm.clone() };
        let noise = Some(sigma);
        small.judged = true;
        let seating = fit.noise.seating.clone();
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
            only: None,
            search,
            counts,
            samples,
            stretches: None,
            judges,
            noise_dof,
            unverified: fit.unverified(),
            data: Data { scale, dof: fit.dof },
            known: RefCell::default(),
            scans: RefCell::default(),
        }
    }

    pub fn judge(&self, fit: &Fit) -> Judge {
        let residual = (!self.judges).then_some([fit.total, fit.dof]);
        let left = self.unverified.then_some([fit.chi2, fit.dof]);
        Judge { noise_dof: self.noise_dof, residual, left }
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

    /// Scores of what may be wrong. Where one thing is at fault alone, no single reading is,
    /// and crests of an unknown law look like jumps.
    pub fn scan(&self, fit: &Fit) -> Result<Vec<Scored>, Error> {
        let new = || scan::scan(&self.small, fit, &self.judge(fit), self.search);
        let mut scored = self.scans.borrow_mut().scan(&self.small, fit, new)?;
        scored.retain(|Scored { instance, family, .. }| {
            let sudden = scored::is_data(instance) || family.happened_once();
            self.open_to(instance) && !(sudden && self.only.is_some())
        });
        Ok(scored)
    }

    /// Scores of two effects at once that may be worth more than is needed, at each of some fits.
    pub(crate) fn pairs(&self, fits: &[(Fit, f64)]) -> Vec<Result<Vec<Pair>, Error>> {
        let named_at = |(fit, _): &(Fit, f64)| {
            let mut named = candidates::candidates(&self.small, fit, &self.search.without);
            named.retain(|i| !i.term.info().penalised && self.open_to(i));
            (named, self.judge(fit))
        };
        let named: Vec<_> = fits.iter().map(named_at).collect();
        let (small, alpha) = (&self.small, self.search.alpha);
        let score = |((fit, needed), (named, judge)): (&(Fit, f64), &(Vec<Instance>, Judge))| {
            pairs::pairs(small, fit, judge, named, Some(alpha), &|width, _| CHARGE * width, *needed)
        };
        workers::map(fits.iter().zip(&named), score)
    }

    /// Whether this may be wrong. Where a chain is at fault alone, no one channel is to blame.
    fn open_to(&self, instance: &Instance) -> bool {
        let channel = matches!(instance.target, Target::Channel(_));
        self.only.is_none_or(|only| {
            belongs(&self.small.mechanism, instance.target, only)
                && (instance.target == only || !channel)
        })
    }

    /// The session with all poses.
    pub fn all(&self) -> Observations {
        Observations { weights: self.counts.clone(), ..self.small.clone() }
    }

    /// All poses count again; gives the weights that were.
    pub fn restart(&mut self) -> Vec<f64> {
        std::mem::replace(&mut self.small.weights, self.counts.clone())
    }

    /// Anything may be wrong again.
    pub fn release(&mut self, weights: Vec<f64>) {
        self.only = None;
        self.small.weights = weights;
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

    /// Refits the best candidates; the best of them, if any is above chance and explains more
    /// than is paid for it.
    pub fn step(
        &self,
        current: &Fit,
        mut scored: Vec<Scored>,
    ) -> Result<Option<(Vec<Scored>, Fit)>, Error> {
        let yielding = self.yielding(current, &scored)?;
        scored.retain(|s| s.corrected <= self.search.alpha);
        scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        // Neighbouring orders are one candidate.
        one_place_each(&mut scored, has_order);
        let likely = scored.iter().take(self.search.refits);
        let likely = likely.filter(|s| excluded_pose(&s.instance).is_none());
        let likely = likely.filter(|s| !left_behind(s, scored[0].charged()));
        self.prepare_with(current, likely.map(|s| slice::from_ref(&s.instance)));
        let mut best: Option<(f64, Scored, Fit)> = None;
        for &candidate in scored.iter().take(self.search.refits) {
            if excluded_pose(&candidate.instance).is_some() {
                if best.is_none() && candidate.charged() > 0.0 {
                    let one = match self.search.uses(Rule::OneChannel) {
                        true => self.one_channel(current, &candidate, &scored)?,
                        false => None,
                    };
                    let (one, fit) = one.unwrap_or_else(|| (candidate, current.clone()));
                    return Ok(Some((vec![one], fit)));
                }
                continue;
            }
            if best.as_ref().is_some_and(|(gain, ..)| left_behind(&candidate, *gain)) {
                continue;
            }
            let (candidate, refit) = self.tuned(current, candidate)?;
            let gain = self.gain(current, &refit, &[candidate]);
            if gain > best.as_ref().map_or(0.0, |(g, ..)| *g) {
                best = Some((gain, candidate, refit));
            }
        }
        Ok(match (best, yielding) {
            (best, Some((gain, joints, refit)))
                if gain > best.as_ref().map_or(0.0, |(alone, ..)| *alone) =>
            {
                Some((joints, refit))
            }
            (best, _) => best.map(|(_, candidate, refit)| (vec![candidate], refit)),
        })
    }

    /// All joints that give under the links' weight, as one effect: what one joint gives
    /// is not told without what the others do. Those that do not stand out are left out,
    /// and those that would have to give against their load.
    pub(crate) fn yielding(
        &self,
        current: &Fit,
        scored: &[Scored],
    ) -> Result<Option<(f64, Vec<Scored>, Fit)>, Error> {
        let of_links = |s: &&Scored| matches!(s.instance.term.acts(), Acts::Load(Weight::Links));
        let mut joints: Vec<Scored> = scored.iter().filter(of_links).copied().collect();
        if !self.search.uses(Rule::Yielding) {
            joints.clear();
        }
        while joints.len() > 1 {
            let mut instances = current.model.instances.clone();
            instances.extend(joints.iter().map(|s| s.instance));
            let refit = match fit(&self.small, instances, Some(current)) {
                Err(Error::TooFew { .. }) => return Ok(None),
                refit => refit?,
            };
            let judge = self.judge(&refit);
            let mut weakest: Option<(f64, usize)> = None;
            for (k, joint) in joints.iter_mut().enumerate() {
                let Some(sure) = estimate_of(&refit, &joint.instance) else { return Ok(None) };
                // By how much χ² would rise without it, to first order; with its sign.
                joint.score = sure * sure.abs();
                let score = joint.score.max(0.0);
                joint.p_value = judge.without(score, joint.width).p_value(score, joint.width);
                joint.corrected = joint.p_value * joint.places;
                if weakest.is_none_or(|(score, _)| joint.score < score) {
                    weakest = Some((joint.score, k));
                }
            }
            match weakest {
                Some((_, k)) if self.fails(&joints[k]) => joints.remove(k),
                _ => {
                    let gain = self.gain(current, &refit, &joints);
                    return Ok(gain.is_finite().then_some((gain, joints, refit)));
                }
            };
        }
        Ok(None)
    }

    /// True for a joint of those that give together that is no longer needed.
    fn fails(&self, joint: &Scored) -> bool {
        match self.search.uses(Rule::Stepwise) {
            true => joint.corrected > self.search.alpha,
            false => joint.charged() <= 0.0,
        }
    }

    /// The one channel that explains as much as leaving its whole pose out does: scores are
    /// of first order, and of a reading that is far off that is not enough.
    fn one_channel(
        &self,
        current: &Fit,
        pose: &Scored,
        scored: &[Scored],
    ) -> Result<Option<(Scored, Fit)>, Error> {
        let here = |s: &&Scored| {
            scored::is_data(&s.instance)
                && excluded_pose(&s.instance).is_none()
                && s.instance.place == pose.instance.place
        };
        let mut without = self.small.clone();
        without.weights[pose.instance.place] = 0.0;
        let left = match fit(&without, current.model.instances.clone(), Some(current)) {
            Err(Error::TooFew { .. }) => return Ok(None),
            left => left?,
        };
        // Several wrong readings at once are the rarer story: chance may not tell it.
        let mut best = ((self.gain(current, &left, &[*pose]) - AS_WELL).max(0.0), None);
        for candidate in scored.iter().filter(here) {
            let refit = self.with(current, &[candidate.instance])?;
            let gain = self.gain(current, &refit, &[*candidate]);
            if gain >= best.0 {
                best = (gain, Some((*candidate, refit)));
            }
        }
        Ok(best.1)
    }

    /// The fit with more effects.
    pub(crate) fn with(&self, current: &Fit, more: &[Instance]) -> Result<Fit, Error> {
        let mut instances = current.model.instances.clone();
        instances.extend(more);
        self.known.borrow_mut().fit(&self.small, instances, current)
    }

    /// Makes fits [`with`](Self::with) these effects, which will be asked for, on all cores.
    pub(crate) fn prepare_with<'b>(
        &self,
        current: &Fit,
        more: impl Iterator<Item = &'b [Instance]>,
    ) {
        let instances = &current.model.instances;
        let wanted = more.map(|more| [instances, more].concat());
        self.known.borrow_mut().prepare(&self.small, wanted, current);
    }

    /// Makes fits [`without`](Self::without) these effects, which will be asked for, on all cores.
    pub(crate) fn prepare_without<'b>(
        &self,
        current: &Fit,
        gone: impl Iterator<Item = &'b [Instance]>,
    ) {
        let wanted = gone.map(|gone| others(current, gone));
        self.known.borrow_mut().prepare(&self.small, wanted, current);
    }

    /// The fit with one more effect. An order is moved to the place that is nearest to where the
    /// fit has tuned it.
    pub(crate) fn tuned(
        &self,
        current: &Fit,
        mut candidate: Scored,
    ) -> Result<(Scored, Fit), Error> {
        let mut refit = self.with(current, &[candidate.instance])?;
        for _ in 0..ORDER_MOVES {
            let Some(place) = nearest_place(&refit, &candidate.instance) else { break };
            candidate.instance.place = place;
            refit = self.with(current, &[candidate.instance])?;
        }
        Ok((candidate, refit))
    }

    /// The fit without some of its effects.
    pub fn without(&self, current: &Fit, gone: &[Instance]) -> Result<Fit, Error> {
        self.known.borrow_mut().fit(&self.small, others(current, gone), current)
    }

    /// By how much χ² fell, the parameters and places of what was added paid for.
    pub(crate) fn gain(&self, before: &Fit, after: &Fit, added: &[Scored]) -> f64 {
        if self.sensible(before, after) && added.iter().all(|s| physical(after, &s.instance)) {
            self.fall(before, after) - added.iter().map(Scored::paid).sum::<f64>()
        } else {
            f64::NEG_INFINITY
        }
    }

    /// By how much what the readings say fell.
    pub(crate) fn fall(&self, before: &Fit, after: &Fit) -> f64 {
        self.data.of(cost(before)) - self.data.of(cost(after))
    }

    /// What readings say of an explanation with this χ².
    pub(crate) fn data_of(&self, chi2: f64) -> f64 {
        self.data.of(chi2)
    }

    /// What readings say of a fit.
    pub(crate) fn said_of(&self, fit: &Fit) -> f64 {
        self.data.of(cost(fit))
    }

    /// True for a fit with more effects than another, in which every joint still moves, and about
    /// as much for its readings, and the loops close as well as before.
    pub(crate) fn sensible(&self, before: &Fit, after: &Fit) -> bool {
        let swung = self.search.uses(Rule::Swung) && swung(before, after);
        let opened = self.search.uses(Rule::Misclosure) && opened(before, after);
        after.plausible && after.termination.converged() && !swung && !opened
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

/// The instances of a fit but for some.
fn others(fit: &Fit, gone: &[Instance]) -> Vec<Instance> {
    fit.model.instances.iter().copied().filter(|i| !gone.contains(i)).collect()
}

/// χ² with what priors add to it.
#[must_use]
pub fn cost(fit: &Fit) -> f64 {
    let held: f64 = fit.priors.iter().map(|p| p.off(&fit.beta).powi(2)).sum();
    fit.total + held
}

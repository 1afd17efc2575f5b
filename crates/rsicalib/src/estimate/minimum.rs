//! A minimum, and the noise that it is found with: fits by (50) to (52), each with the noise that the fit before shows.

use std::borrow::Cow;
use std::f64::consts::TAU;

use crate::Error;
use crate::estimate::adjusted::Adjusted;
use crate::estimate::algebraic::Algebraic;
use crate::estimate::conclusion::{Found, conclude};
use crate::estimate::conventions::held;
use crate::estimate::doubts;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::noise::channels::{self, Length};
use crate::estimate::noise::rounding::Rounding;
use crate::estimate::noise::scatter::Groups;
use crate::estimate::noise::seating::contrasts;
use crate::estimate::noise::source::{
    NoiseEstimate, Rounded, Shown, check_declared, declared_rounded, first_noise, presumed,
    rounded, told_apart, with_lengths,
};
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::options::Method;
use crate::estimate::progress::Heard;
use crate::estimate::residuals::Residuals;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::Start;
use crate::kinematics::elements::Way;
use crate::model::{Model, Prior};
use crate::numerics::lanes::Lanes;
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::numerics::symmetric::nowhere;
use crate::terms::term::Role;

/// Largest number of fits, each with the noise of the fit before.
const ROUNDS: usize = 4;

/// A fit of a search ends where no more than this of ½χ² is to be had: decisions turn on units of χ².
const ENOUGH: f64 = 1e-5;

/// True for two noises of readings that differ by a common factor only, to 1 %.
fn proportional(a: &Noise, b: &Noise) -> bool {
    let scale = a.sigma[0] / b.sigma[0];
    let same = |x: f64, y: f64| (x - scale * y).abs() <= 0.01 * x.abs();
    a.sigma.iter().zip(&b.sigma).all(|(x, y)| same(*x, *y))
}

/// True for two noises by which the closures of a model hold alike, to 1 %.
fn seated_alike(model: &Model, a: &Noise, b: &Noise) -> bool {
    let same = |(x, y): (f64, f64)| (x - y).abs() <= 0.01 * x;
    a.by_closure(model).into_iter().zip(b.by_closure(model)).all(same)
}

/// Lengths that differ from sample to sample; `measured` are the variances of the equations that do.
fn lengths_of(model: &Model, noise: &Noise, measured: &[f64]) -> Vec<Length> {
    if measured.is_empty() {
        return Vec::new();
    }
    let drawn = |k: usize| noise.measured.get(k).is_some_and(|factor| *factor > 0.0);
    let declared = Noise { seating: Vec::new(), ..noise.clone() }.measured_lengths(model);
    let lengths = model.lengths_read().filter(|(k, e)| drawn(*k) && *e < measured.len());
    let of = |(closure, equation): (usize, usize)| {
        let (variance, declared) = (measured[equation], declared[equation]);
        Length { closure, equation, variance, declared }
    };
    lengths.map(of).collect()
}

/// True for two noises that are proportional and differ by no factor, to 1 %.
fn as_large(a: &Noise, b: &Noise) -> bool {
    (a.sigma[0] - b.sigma[0]).abs() <= 0.01 * a.sigma[0]
}

/// The noise of a fit, round by round.
struct Rounds<'a> {
    observations: &'a Observations,
    groups: Groups,
    rounding: Option<Rounding>,
    /// The noise of the next round.
    noise: Noise,
    /// The noise where channels read in steps that are unlike.
    rounded: Option<Rounded>,
    /// True for a noise that is declared, as long as nothing contradicts that.
    declared: bool,
    /// True where what is declared was held against what repeats show.
    checked: bool,
    /// Number of channels whose noise was told from that of the others.
    apart: usize,
    warnings: Vec<Suspicion>,
}

impl<'a> Rounds<'a> {
    fn new(observations: &'a Observations, model: &Model, start: &Start, guess: Noise) -> Self {
        let groups = Groups::of(&observations.readings, &observations.weights);
        let of_wiring = start.warnings.iter().filter(|w| w.of_wiring());
        let mut warnings: Vec<Suspicion> = of_wiring.cloned().collect();
        let mut rounding = None;
        if !observations.judged {
            warnings.extend(doubts::of_readings(observations));
            warnings.extend(doubts::of_closures(model));
            rounding = Rounding::of(&groups, observations, &presumed(observations));
        }
        let declared = observations.declares_noise();
        let rounded = rounding.as_ref().filter(|_| declared);
        let rounded = rounded.map(|rounding| declared_rounded(observations, rounding));
        let noise = match &rounded {
            Some(rounded) => rounded.weighed.clone(),
            // Beside an earlier fit, whose noise may not be what is declared.
            None if declared => first_noise(observations, None),
            None => guess,
        };
        let (checked, apart) = (false, 0);
        Self { observations, groups, rounding, noise, rounded, declared, checked, apart, warnings }
    }

    /// Another noise for the next round, as these residuals show it; none where that is reached, or where
    /// this round is the last.
    fn other_noise(&mut self, model: &Model, within: &Residuals, last: bool) -> Option<Noise> {
        let Self { observations, groups, noise, .. } = self;
        let judged = observations.judged;
        // What was judged by an earlier fit is not told apart again.
        let measured = if judged { Vec::new() } else { noise.measured_lengths(model) };
        let lengths = lengths_of(model, noise, &measured);
        if self.declared && !judged && !last {
            let wanted = with_lengths(observations, groups, within, noise, &lengths);
            if let Some(wanted) = wanted.filter(|wanted| !seated_alike(model, wanted, noise)) {
                return Some(wanted);
            }
        }
        if self.declared && !self.checked && !judged {
            self.checked = true;
            let rounding = self.rounding.as_ref();
            let wrong = check_declared(observations, groups, within, noise, rounding);
            if let Some((factor, by)) = wrong {
                self.declared = false;
                self.warnings.push(Suspicion::Noise { by, factor, play: within.play });
            }
        }
        if self.declared || last {
            return None;
        }
        let of_steps = |rounding| rounded(observations, groups, within, noise, rounding, &lengths);
        self.rounded = self.rounding.as_ref().and_then(of_steps);
        let (wanted, reached);
        match &self.rounded {
            Some(rounded) => {
                (wanted, self.apart) = (rounded.weighed.clone(), rounded.apart);
                reached = proportional(&wanted, noise) && as_large(&wanted, noise);
            }
            None => {
                (wanted, self.apart) = told_apart(observations, groups, within, noise, &lengths);
                reached = proportional(&wanted, noise);
            }
        }
        (!reached || !seated_alike(model, &wanted, noise)).then_some(wanted)
    }

    /// The noise that these residuals show, of a fit of so many parameters.
    fn estimate(
        &self,
        residuals: &Residuals,
        within: &Residuals,
        parameters: usize,
    ) -> NoiseEstimate {
        let shown = Shown {
            observations: self.observations,
            groups: &self.groups,
            residuals,
            within,
            used: &self.noise,
            rounded: self.rounded.as_ref(),
            declared: self.declared,
            parameters,
        };
        let estimate = shown.estimate();
        NoiseEstimate { apart: self.apart, dof: estimate.dof - self.apart as f64, ..estimate }
    }
}

/// A minimum; `holds` are no part of what is found.
pub(super) fn minimum(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    holds: &[Prior],
    start: Start,
    guess: Noise,
) -> Result<Fit, Error> {
    let all = [&priors[..], holds].concat();
    let held = held(observations, &model)?;
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let part = Part { model: &model, readings, weights };
    let judged = observations.judged;
    let mut rounds = Rounds::new(observations, &model, &start, guess);
    // What tells channels of a recording apart; no other row's derivatives are looked at.
    let kept = observations.is_long().then(|| channels::rows_looked_at(&rounds.groups));
    let mut beta = start.beta.clone();
    let earlier = start.adjusted.as_ref().and_then(|it| it.of(readings));
    // Where an earlier fit has looked for what is unknown in a pose, its places are near.
    let crosses = !judged || earlier.is_none();
    let mut adjusted = earlier.map(<[Lanes]>::to_vec);
    let mut answer = None;
    for round in 0..ROUNDS {
        observations.options.progress.step()?;
        let noise = rounds.noise.clone();
        let mut parts = vec![(part, noise.clone())];
        if let Some((model, readings)) = &held {
            parts.push((Part { model, readings, weights: None }, noise.clone()));
        }
        let problem = Implicit::new(parts, &all).from(adjusted.take());
        let problem = if judged { problem.coarse() } else { problem };
        let mut outcome =
            least(observations, (&problem, &all), part, [&beta, &start.beta], crosses)?;
        beta.clone_from(&outcome.x);
        let problem = problem.precise();
        if judged {
            // Scores subtract what the fit absorbs: its Gram matrix is that of settled readings.
            outcome.linearization = problem.linearize(&beta);
        }
        let measured = noise.measured_lengths(&model);
        let residuals = match measured.is_empty() || judged {
            true => problem.residuals_keeping(&beta, false, kept.as_deref()),
            false => problem.residuals_by_closure(&beta),
        };
        adjusted = Some(problem.into_adjusted());
        let within = match judged || !readings.held {
            true => Cow::Borrowed(&residuals),
            false => contrasts(&rounds.groups, &residuals, (&noise.sigma, &measured)),
        };
        if let Some(other) = rounds.other_noise(&model, &within, round + 1 == ROUNDS) {
            rounds.noise = other;
            continue;
        }
        let estimate = rounds.estimate(&residuals, &within, beta.len());
        let scale = estimate.weighed[0] / noise.sigma[0];
        let same_play = (estimate.weighed_play / noise.play - 1.0).abs() < 1e-3;
        let played = residuals.play;
        // Readings alone have a scale: where there is play, the noise is as it was assumed.
        answer = Some((outcome, residuals, estimate.clone(), if played { 1.0 } else { scale }));
        let sensitive = !priors.is_empty() || held.is_some() || played;
        if (scale - 1.0).abs() < 1e-3 && (same_play || !played) || !sensitive {
            break;
        }
        rounds.noise = Noise { sigma: estimate.weighed, play: estimate.weighed_play, ..noise };
    }
    let Some((outcome, residuals, noise, scale)) = answer else {
        return Err(Error::Empty("no fit".into()));
    };
    let start = Start { warnings: rounds.warnings, ..start };
    let found = Found { outcome, residuals, noise, scale, holds };
    let mut fit = conclude(observations, model, priors, found, start, &rounds.groups);
    if judged {
        fit.adjusted = adjusted.map(|it| Adjusted::new(&observations.readings, it));
    }
    Ok(fit)
}

/// The least of (50) from `beta`, or of (11) for [`Method::Algebraic`], with all on the same side as at the start.
fn least(
    observations: &Observations,
    (problem, priors): (&Implicit, &[Prior]),
    part: Part,
    [beta, start]: [&[f64]; 2],
    crosses: bool,
) -> Result<lm::Outcome, Error> {
    let (options, progress) = (&observations.options, &observations.options.progress);
    let ptol = if observations.judged { ENOUGH } else { options.lm.ptol };
    let lm = lm::SolverOptions { ptol, ..options.lm.clone() };
    let outcome = match options.method {
        Method::ImplicitLoop if observations.is_long() => {
            lm::minimize(&Heard { problem, progress }, beta, &lm)
        }
        Method::ImplicitLoop => lm::minimize(problem, beta, &lm),
        Method::Algebraic => {
            let paper = lm::minimize(&Algebraic::new(part, priors), beta, &options.lm);
            lm::Outcome { linearization: problem.linearize(&paper.x), ..paper }
        }
    };
    progress.goes_on()?;
    let outcome = match options.method {
        Method::ImplicitLoop if crosses => crossed(problem, part.model, outcome, &lm),
        _ => outcome,
    };
    let outcome = unwound(problem, part.model, outcome, &lm);
    Ok(undrifted(problem, outcome, start, &lm))
}

/// Upper limit of looks at the places. Nearly all fits need three or fewer.
const CROSSINGS: usize = 10;

/// A minimum in which nothing that is unknown in a pose has another place that closes better: by parameters as
/// drawn some are taken for the wrong one.
fn crossed(
    problem: &Implicit,
    model: &Model,
    outcome: lm::Outcome,
    options: &lm::SolverOptions,
) -> lm::Outcome {
    let mut outcome = outcome;
    for _ in 0..if model.pose_unknowns() > 0 { CROSSINGS } else { 0 } {
        if !problem.crosses(&outcome.x) {
            break;
        }
        outcome = lm::minimize(problem, &outcome.x, options);
    }
    outcome
}

/// The same minimum with joints that turn within half a turn of the middle of their limits at the mean
/// reading, of the drawing where they have none, where whole turns change nothing.
fn unwound(
    problem: &Implicit,
    model: &Model,
    outcome: lm::Outcome,
    options: &lm::SolverOptions,
) -> lm::Outcome {
    let mut back = outcome.x.clone();
    for (way, channel) in model.joints() {
        if let (Way::Turn, Some(offset)) = (way, model.column(Role::Offset, channel)) {
            let limits = model.mechanism.channels[channel].limits;
            let middle = |[low, high]: [f64; 2]| 0.5 * (low + high) - model.scales[channel].angle;
            let off = back[offset] - limits.map_or(0.0, middle);
            back[offset] -= TAU * (off / TAU).round();
        }
    }
    if back == outcome.x {
        return outcome;
    }
    let there = lm::minimize(problem, &back, options);
    if there.cost <= outcome.cost * (1.0 + 1e-6) { there } else { outcome }
}

/// The same minimum with what nothing determines where it was at the start: a direction along
/// which the cost does not change is left to rounding otherwise, and wanders.
fn undrifted(
    problem: &Implicit,
    outcome: lm::Outcome,
    start: &[f64],
    options: &lm::SolverOptions,
) -> lm::Outcome {
    let moved: Vec<f64> = outcome.x.iter().zip(start).map(|(x, start)| x - start).collect();
    let drift = nowhere(&outcome.linearization.gram(), &moved);
    if !outcome.termination.converged() || drift.iter().all(|d| *d == 0.0) {
        return outcome;
    }
    let back: Vec<f64> = outcome.x.iter().zip(&drift).map(|(x, drift)| x - drift).collect();
    let there = lm::minimize(problem, &back, options);
    // Where the direction bends another minimum may be at its end.
    if there.cost <= outcome.cost * (1.0 + 1e-6) { there } else { outcome }
}

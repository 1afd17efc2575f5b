//! The fit: estimates, covariance, lack of fit, and the reason for the end.

use std::borrow::Cow;
use std::f64::consts::TAU;

use faer::Mat;

use crate::Error;
use crate::estimate::adjusted::Adjusted;
use crate::estimate::algebraic::Algebraic;
use crate::estimate::conventions::{Conventions, Here, held};
use crate::estimate::degrees;
use crate::estimate::doubts;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::lengths;
use crate::estimate::miswired;
use crate::estimate::noise::channels::{self, Length};
use crate::estimate::noise::open;
use crate::estimate::noise::rounding::Rounding;
use crate::estimate::noise::scatter::Groups;
use crate::estimate::noise::seating::contrasts;
use crate::estimate::noise::source::{
    DOUBT, NoiseEstimate, Rounded, check_declared, declared_rounded, estimate_noise, first_noise,
    presumed, rounded, told_apart, with_lengths,
};
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::options::Method;
use crate::estimate::progress::Heard;
use crate::estimate::residuals::Residuals;
use crate::estimate::significance::LEVEL;
use crate::estimate::sized::sized;
use crate::estimate::softer::softer;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::Start;
use crate::estimate::turned::turned;
use crate::estimate::{search, start};
use crate::kinematics::elements::Way;
use crate::model::{Instance, Model, Prior};
use crate::numerics::distributions;
use crate::numerics::lanes::Lanes;
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::numerics::symmetric::{invert, nowhere};
use crate::terms::term::{Acts, Role};

/// Fits the parameters of `instances` by (50) to (52), or by (11) for
/// [`Method::Algebraic`](crate::Method::Algebraic).
///
/// The start is `from`, an earlier fit, or else the result of a search of starts.
///
/// # Errors
///
/// [`Error::TooFew`] for fewer equations than parameters, the errors of [`Model::new`], and those of
/// [`Observations::new`] for options and weights that were changed since.
pub fn fit(
    observations: &Observations,
    instances: Vec<Instance>,
    from: Option<&Fit>,
) -> Result<Fit, Error> {
    observations.check()?;
    let model = observations.model_after(from.map(|fit| &*fit.model), instances)?;
    let priors = observations.priors(&model);
    let equations = model.told_by(&observations.readings, &observations.weights);
    if equations + priors.len() < model.parameters {
        return Err(Error::TooFew {
            parameters: model.parameters,
            equations,
            poses: observations.readings.poses(),
            different: observations.readings.poses() - observations.copies.len(),
        });
    }
    // Of what was asked for; a search looks at the gains that it finds.
    if from.is_none() && search::unscaled(&model, &priors) {
        return Err(Error::option(
            "terms",
            "all gains of channels that are to be equal: gains of zero would fit any readings",
            "one gain that is known: name the others, `gain@CHANNEL`, or give one an `sd`",
        ));
    }
    let guess = first_noise(observations, from.map(Fit::assumed));
    let start = match from {
        Some(fit) => after(fit, &model),
        None => begin(observations, &model, &guess),
    };
    let found = if observations.is_long() || observations.judged {
        solve(observations, model, priors, start, guess)
    } else {
        open::fit_with_seatings(observations, &model, &start, |observations, start| {
            let noise = first_noise(observations, from.map(Fit::assumed));
            solve(observations, model.clone(), priors.clone(), start, noise)
        })
    };
    // A wrong reading may keep the loops open from every start; a later fit without it closes them.
    let found = found.map(|mut fit| {
        if from.is_some() && fit.plausible && fit.chi2 < observations.options.good_start * fit.dof {
            fit.warnings.retain(|it| !it.is_no_start());
        }
        fit
    });
    let no_scale = |fit: &Fit| fit.has_no_scale() || search::shrunk(&fit.model, &fit.beta);
    match (from, found) {
        (None, Ok(found)) if no_scale(&found) => Err(Error::option(
            "terms",
            "every length free, so that nothing says how long anything is",
            "one length that is known: name `distance` of some closures only, or give one an `sd`",
        )),
        (_, Ok(found)) if search::is_drawn_together(&found.model, &found.beta) => {
            Err(Error::option(
                "terms",
                "lengths of an arm that may all be zero, so that it touches anything",
                "one length that is known: a closure with a `value` between two points that are touched, \
                 fewer lengths among the terms, or an `sd` of them",
            ))
        }
        (_, found) => found,
    }
}

/// A start where an earlier fit ended.
fn after(fit: &Fit, model: &Model) -> Start {
    Start {
        beta: carry_over(fit, model),
        tries: fit.starts.clone(),
        warnings: fit.warnings.clone(),
        adjusted: fit.adjusted.clone(),
        stays: fit.stays.clone(),
    }
}

/// Parameters of an earlier fit for a new model; zero for parameters that the fit does not have.
#[must_use]
pub fn carry_over(fit: &Fit, model: &Model) -> Vec<f64> {
    let mut beta = model.nominal();
    for (instance, &first) in model.instances.iter().zip(&model.first) {
        if let Some(k) = fit.model.instances.iter().position(|i| i == instance) {
            let old = fit.model.first[k];
            beta[first..first + instance.width()]
                .copy_from_slice(&fit.beta[old..old + instance.width()]);
        }
    }
    let (old, new) = (fit.model.term_parameters, model.term_parameters);
    if fit.model.unknowns == model.unknowns {
        beta[new..].copy_from_slice(&fit.beta[old..]);
    }
    beta
}

/// A start by the search, or, for a mechanism with something unknown, the best anchor with that where
/// the data put it. A frame that they do not tell is lost until a fit closes the loops.
fn begin(observations: &Observations, model: &Model, noise: &Noise) -> Start {
    if model.unknowns.is_empty() && model.pose_unknowns() == 0 {
        return start::search(observations, model, noise);
    }
    let mut beta = search::anchored(observations, model, &vec![1.0; model.scales.len()]);
    let untold = model.place_unknowns(&observations.readings, &mut beta);
    let beta = sized(observations, model, noise, beta);
    let beta = turned(observations, model, noise, beta);
    let lost = |k: usize| Suspicion::Lost { name: model.unknowns[k].name.clone(), open: 0.0 };
    let warnings = untold.into_iter().map(lost).collect();
    Start { beta, warnings, ..Start::default() }
}

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

/// A fit whose joints are as soft as readings tell, (176).
fn solve(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    start: Start,
    noise: Noise,
) -> Result<Fit, Error> {
    let mut found = as_drawn(observations, model, priors, start, noise)?;
    for _ in 0..ROUNDS {
        let Some(priors) = softer(&found) else { break };
        let (model, noise) = (Model::clone(&found.model), found.assumed());
        let start = after(&found, &model);
        found = as_drawn(observations, model, priors, start, noise)?;
    }
    Ok(found)
}

/// A fit with all conventions where the drawing has them: what noise and play seem to tell of them
/// moves nothing.
fn as_drawn(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    start: Start,
    noise: Noise,
) -> Result<Fit, Error> {
    if observations.judged {
        let held = start.stays.iter().filter_map(|stays| stays.held(&model, &start.beta));
        let holds: Vec<Prior> = held.collect();
        return minimum(observations, model, priors, &holds, start, noise);
    }
    let begun = start.clone();
    let known = conventions_at_start(observations, &model, &priors, &start, &noise);
    let holds = known.holds(&model, &start.beta);
    let start = Start { beta: known.moved(&start.beta, &holds), ..start };
    let found = minimum(observations, model.clone(), priors.clone(), &holds, start, noise)?;
    if found.conventions.rows.len() <= holds.len() {
        return Ok(found);
    }
    let holds = found.conventions.holds(&model, &begun.beta);
    let start = Start { beta: found.conventions.moved(&found.beta, &holds), ..begun };
    let there = minimum(observations, model, priors, &holds, start, found.assumed())?;
    // Each convention seemed to tell one degree of freedom; where the direction bends, another
    // minimum may be at its end.
    let most = BENT * holds.len() as f64;
    let same = there.termination.converged() && there.chi2 <= found.chi2 + most;
    Ok(if same { there } else { found })
}

/// A convention that is held costs no more χ² than this: one degree of freedom, p = 0.001 of its χ².
const BENT: f64 = 10.8;

/// Conventions as far as the start shows them; of sensors alone there are none that a fit runs away
/// along.
fn conventions_at_start(
    observations: &Observations,
    model: &Model,
    priors: &[Prior],
    start: &Start,
    noise: &Noise,
) -> Conventions {
    let sensors = model.instances.iter().all(|i| matches!(i.term.acts(), Acts::Sensor(_)));
    if sensors && model.unknowns.is_empty() {
        return Conventions::default();
    }
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let part = Part { model, readings, weights };
    let gram = Implicit::new(vec![(part, noise.clone())], priors).linearize(&start.beta).gram();
    let here = Here { observations, model, priors, beta: &start.beta, noise };
    Conventions::of(here, &gram)
}

/// A minimum; `holds` are no part of what is found.
fn minimum(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    holds: &[Prior],
    start: Start,
    mut noise: Noise,
) -> Result<Fit, Error> {
    let all = [&priors[..], holds].concat();
    let held = held(observations, &model)?;
    let part = Part {
        model: &model,
        readings: &observations.readings,
        weights: Some(&observations.weights),
    };
    let mut beta = start.beta.clone();
    let groups = Groups::of(&observations.readings, &observations.weights);
    // What tells channels of a recording apart; no other row's derivatives are looked at.
    let kept = observations.is_long().then(|| channels::rows_looked_at(&groups));
    let judged = observations.judged;
    let earlier = start.adjusted.as_ref().and_then(|it| it.of(&observations.readings));
    let mut adjusted = earlier.map(<[Lanes]>::to_vec);
    let ptol = if judged { ENOUGH } else { observations.options.lm.ptol };
    let lm = lm::SolverOptions { ptol, ..observations.options.lm.clone() };
    let mut declared = observations.declares_noise();
    let mut warnings: Vec<Suspicion> =
        start.warnings.iter().filter(|w| w.of_wiring()).cloned().collect();
    if !judged {
        warnings.extend(doubts::of_readings(observations));
        warnings.extend(doubts::of_closures(&model));
    }
    if declared {
        // Beside an earlier fit, whose noise may not be what is declared.
        noise = first_noise(observations, None);
    }
    let rounding = match judged {
        true => None,
        false => Rounding::of(&groups, observations, &presumed(observations)),
    };
    let mut with_rounding = None;
    if let (Some(rounding), true) = (&rounding, declared) {
        let declared = declared_rounded(observations, rounding);
        noise = declared.weighed.clone();
        with_rounding = Some(declared);
    }
    let progress = &observations.options.progress;
    let (mut apart, mut doubted) = (0, false);
    let mut answer = None;
    for round in 0..ROUNDS {
        progress.step()?;
        let mut parts = vec![(part, noise.clone())];
        if let Some((model, readings)) = &held {
            parts.push((Part { model, readings, weights: None }, noise.clone()));
        }
        let problem = Implicit::new(parts, &all).from(adjusted.take());
        let problem = if judged { problem.coarse() } else { problem };
        let outcome = match observations.options.method {
            Method::ImplicitLoop if observations.is_long() => {
                lm::minimize(&Heard { problem: &problem, progress }, &beta, &lm)
            }
            Method::ImplicitLoop => lm::minimize(&problem, &beta, &lm),
            Method::Algebraic => {
                let paper =
                    lm::minimize(&Algebraic::new(part, &all), &beta, &observations.options.lm);
                lm::Outcome { linearization: problem.linearize(&paper.x), ..paper }
            }
        };
        progress.goes_on()?;
        let outcome = match observations.options.method {
            Method::ImplicitLoop if !judged => crossed(&problem, &model, outcome, &lm),
            _ => outcome,
        };
        let outcome = unwound(&problem, &model, outcome, &lm);
        let mut outcome = undrifted(&problem, outcome, &start.beta, &lm);
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
        let within = match judged || !observations.readings.held {
            true => Cow::Borrowed(&residuals),
            false => contrasts(&groups, &residuals, (&noise.sigma, &measured)),
        };
        // What was judged by an earlier fit is not told apart again.
        let lengths = if judged { Vec::new() } else { lengths_of(&model, &noise, &measured) };
        if declared && !judged && round + 1 < ROUNDS {
            let wanted = with_lengths(observations, &groups, &within, &noise, &lengths);
            if let Some(wanted) = wanted.filter(|wanted| !seated_alike(&model, wanted, &noise)) {
                noise = wanted;
                continue;
            }
        }
        if declared && !doubted && !judged {
            doubted = true;
            let rounding = rounding.as_ref();
            let wrong = check_declared(observations, &groups, &within, &noise, rounding);
            if let Some((factor, by)) = wrong {
                declared = false;
                warnings.push(Suspicion::Noise { by, factor, play: within.play });
            }
        }
        if !declared && round + 1 < ROUNDS {
            let of_steps =
                |rounding| rounded(observations, &groups, &within, &noise, rounding, &lengths);
            with_rounding = rounding.as_ref().and_then(of_steps);
            let (wanted, count, reached) = match &with_rounding {
                Some(Rounded { weighed, apart, .. }) => {
                    let reached = proportional(weighed, &noise) && as_large(weighed, &noise);
                    (weighed.clone(), *apart, reached)
                }
                None => {
                    let (wanted, count) =
                        told_apart(observations, &groups, &within, &noise, &lengths);
                    let reached = proportional(&wanted, &noise);
                    (wanted, count, reached)
                }
            };
            apart = count;
            if !reached || !seated_alike(&model, &wanted, &noise) {
                noise = wanted;
                continue;
            }
        }
        let rounded = with_rounding.as_ref();
        let estimate = estimate_noise(
            observations,
            &groups,
            &residuals,
            &within,
            &noise,
            rounded,
            declared,
            beta.len(),
        );
        let estimate = NoiseEstimate { apart, dof: estimate.dof - apart as f64, ..estimate };
        let scale = estimate.weighed[0] / noise.sigma[0];
        let same_play = (estimate.weighed_play / noise.play - 1.0).abs() < 1e-3;
        let played = residuals.play;
        // Readings alone have a scale: where there is play, the noise is as it was assumed.
        answer = Some((outcome, residuals, estimate.clone(), if played { 1.0 } else { scale }));
        let sensitive = !priors.is_empty() || held.is_some() || played;
        if (scale - 1.0).abs() < 1e-3 && (same_play || !played) || !sensitive {
            break;
        }
        noise = Noise { sigma: estimate.weighed, play: estimate.weighed_play, ..noise };
    }
    let Some((outcome, residuals, noise, scale)) = answer else {
        return Err(Error::Empty("no fit".into()));
    };
    let start = Start { warnings, ..start };
    let found = Found { outcome, residuals, noise, scale, holds };
    let mut fit = conclude(observations, model, priors, found, start, &groups);
    if judged {
        fit.adjusted = adjusted.map(|it| Adjusted::new(&observations.readings, it));
    } else {
        let judged = fit.dof >= 1.0 && fit.plausible && !fit.is_lost();
        let of_play = doubts::of_play(observations, &fit).filter(|_| judged);
        let chi2 = (judged && of_play.is_none()).then_some([fit.chi2, fit.dof]);
        let play = fit.model.play().iter().any(|play| *play > 0.0);
        fit.warnings.extend(doubts::of_noise(observations, &fit.noise, chi2, play));
        fit.warnings.extend(of_play);
        if judged && fit.p_value.is_none_or(|p| p > DOUBT) {
            fit.warnings.extend(doubts::of_knowledge(&fit));
        }
        fit.warnings.extend(doubts::of_lengths(observations, &fit.model, &fit.noise));
        let no_start = !fit.has_start();
        let fit_by = |other: &Observations, terms: Vec<Instance>| {
            let again = self::fit(other, terms, None)?;
            let left = if again.has_start() { again.chi2 / again.dof } else { f64::INFINITY };
            let Fit { model, beta, .. } = again;
            Ok(miswired::Again { left, model, beta })
        };
        let refit = |other: &Observations| fit_by(other, fit.model.instances.clone());
        let mut said = Vec::new();
        let noise = fit.assumed();
        let left = if no_start { f64::INFINITY } else { fit.chi2 / fit.dof };
        said.extend(miswired::stuck(observations, &noise, left, refit));
        if !fit.warnings.iter().chain(&said).any(Suspicion::of_wiring) {
            if fit.plausible {
                said.extend(degrees::of_fit(observations, &fit.model, &fit.beta));
            }
            said.extend(miswired::in_other_unit(observations, &noise, fit.chi2 / fit.dof, refit));
        }
        let wired = !fit.warnings.iter().any(|it| it.of_wiring() && !it.is_no_start());
        if wired && !said.iter().any(Suspicion::of_wiring) {
            said.extend(miswired::miswired(observations, &fit.model, &noise, left, fit_by));
            if !said.iter().any(Suspicion::of_wiring) {
                said.extend(lengths::in_other_unit(observations, &noise, left, refit));
            }
        }
        fit.warnings.extend(said);
    }
    Ok(fit)
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

/// A minimum, and what it was found with.
struct Found<'a> {
    outcome: lm::Outcome,
    residuals: Residuals,
    noise: NoiseEstimate,
    /// The estimated noise over the assumed one.
    scale: f64,
    /// What held conventions.
    holds: &'a [Prior],
}

fn conclude(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    found: Found<'_>,
    start: Start,
    groups: &Groups,
) -> Fit {
    let Found { outcome, mut residuals, noise, scale, holds } = found;
    // From units of the assumed noise to units of the estimated noise.
    for values in [&mut residuals.whitened, &mut residuals.by_reading] {
        values.iter_mut().for_each(|v| *v /= scale);
    }
    let mut gram = outcome.linearization.gram();
    for hold in holds {
        for (i, slope) in hold.slopes(&outcome.x) {
            gram[(i, i)] -= slope * slope;
        }
    }
    let n = gram.nrows();
    let gram = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (scale * scale));
    let (beta, assumed) = (&outcome.x[..], &noise.assumed());
    let here = Here { observations, model: &model, priors: &priors, beta, noise: assumed };
    let conventions = match observations.judged {
        true => Conventions::default(),
        false => Conventions::of(here, &gram),
    };
    let stays = match observations.judged {
        true => start.stays,
        false => conventions.stay(&model),
    };
    let Told { gram, inverse, unknowable, condition } = Told::of(&conventions, gram);

    let k = residuals.equations;
    let live: Vec<usize> =
        (0..observations.readings.samples).filter(|&r| observations.weights[r] > 0.0).collect();
    let of = |r: &usize| residuals.whitened[r * k..(r + 1) * k].iter().map(|v| v * v).sum::<f64>();
    let total: f64 = live.iter().map(of).sum();
    let told = model.told_by(&observations.readings, &observations.weights);
    let (mut chi2, mut dof) =
        (total, told as f64 - free_parameters(&gram, &inverse, &priors, &outcome.x));
    let mut within = 0.0;
    if noise.source.independent() {
        let scatter = groups.scatter(&residuals, 0.0);
        chi2 = (chi2 - scatter.within).max(0.0) / noise.inflation;
        within = scatter.dof;
        dof -= within;
    }
    // The Gram matrix tells nothing of a turn that play has told.
    dof -= conventions.number_of_turns() as f64;
    let p_value = (noise.judges() && dof >= 1.0 && noise.dof_of_pose() > 0.0)
        .then(|| distributions::f_tail(chi2 / dof, dof, noise.dof_of_pose()));

    let wider = widening(&noise, p_value, chi2 / dof);
    let covariance = times(&inverse, wider);
    let weights = Some(&observations.weights[..]);
    let part = Part { model: &model, readings: &observations.readings, weights };
    let rms_misclosure = part.rms_misclosure(&outcome.x);
    let plausible = !search::collapsed(&model, &outcome.x);
    let mut warnings = start.warnings;
    let closes = plausible && chi2 < observations.options.good_start * dof;
    warnings.retain(|it| !(closes && it.is_lost()));
    for warning in &mut warnings {
        if let Suspicion::Lost { open, .. } = warning {
            *open = rms_misclosure;
        }
    }
    if observations.is_long() {
        residuals.by_reading = Vec::new();
    }
    Fit {
        model: model.into(),
        beta: outcome.x,
        likeliest: None,
        priors,
        noise,
        gram,
        scale,
        conventions,
        stays,
        covariance,
        unknowable,
        chi2,
        dof,
        within,
        p_value,
        total,
        rms_misclosure,
        condition,
        termination: outcome.termination,
        iterations: outcome.iterations,
        starts: start.tries,
        residuals: residuals.into(),
        plausible,
        warnings,
        between: None,
        adjusted: None,
    }
}

/// A Gram matrix without what it seems to tell of conventions, and what it tells then.
struct Told {
    gram: Mat<f64>,
    /// With conventions where they are drawn.
    inverse: Mat<f64>,
    unknowable: Vec<bool>,
    condition: f64,
}

impl Told {
    fn of(conventions: &Conventions, gram: Mat<f64>) -> Self {
        let gram = conventions.out_of(gram);
        let (inverse, mut unknowable, condition) = invert(&gram);
        for (k, unknown) in unknowable.iter_mut().enumerate() {
            *unknown |= conventions.presumes(k);
        }
        Self { inverse: conventions.held_in(&inverse), gram, unknowable, condition }
    }
}

/// A fit of a search without what noise and play seem to tell of conventions. A search itself holds those
/// that it begins with, and looks for none: it compares fits of the same noise and play. Whoever asks how well something is
/// known asks it of this fit.
#[must_use]
pub fn with_conventions(observations: &Observations, fit: Fit) -> Fit {
    if !observations.judged {
        return fit;
    }
    let Fit { model, priors, beta, .. } = &fit;
    let here = Here { observations, model, priors, beta, noise: &fit.assumed() };
    let conventions = Conventions::of(here, &fit.gram);
    let stays = conventions.stay(model);
    let Told { gram, inverse, unknowable, condition } = Told::of(&conventions, fit.gram);
    let covariance = times(&inverse, widening(&fit.noise, fit.p_value, fit.chi2 / fit.dof));
    Fit { gram, covariance, unknowable, condition, conventions, stays, ..fit }
}

/// Directions of a fit with one more term that no reading could show, beyond those without it.
///
/// # Errors
///
/// As [`Model::new`].
pub(crate) fn conventions_of(
    observations: &Observations,
    fit: &Fit,
    term: Instance,
) -> Result<usize, Error> {
    let model = &observations.model_beside(&fit.model, &[term])?;
    let (beta, priors) = (&carry_over(fit, model)[..], &observations.priors(model)[..]);
    let Observations { readings, weights, .. } = observations;
    let (part, noise) = (Part { model, readings, weights: Some(weights) }, &fit.assumed());
    let gram = Implicit::new(vec![(part, noise.clone())], priors).linearize(beta).gram();
    let here = Here { observations, model, priors, beta, noise };
    Ok(Conventions::of(here, &gram).number().saturating_sub(fit.conventions.number()))
}

fn times(matrix: &Mat<f64>, factor: f64) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * factor)
}

/// Factor of the covariance beside the inverse of the Gram matrix: of correlated noise, and of a
/// residual above the noise, which has moved the estimates, too.
pub(crate) fn widening(noise: &NoiseEstimate, p_value: Option<f64>, per_dof: f64) -> f64 {
    let left = if p_value.is_some_and(|p| p <= LEVEL) { per_dof.max(1.0) } else { 1.0 };
    noise.slow * left
}

/// Number of parameters that the data determine: each prior takes over a part of a parameter, and
/// what nothing tells is none. `gram` is the Gram matrix with priors, `inverse` its pseudo-inverse,
/// `x` the parameters.
#[must_use]
pub fn free_parameters(gram: &Mat<f64>, inverse: &Mat<f64>, priors: &[Prior], x: &[f64]) -> f64 {
    let n = inverse.nrows();
    let own = |i: usize| (0..n).map(|j| inverse[(i, j)] * gram[(j, i)]).sum::<f64>();
    let rank: f64 = (0..n).map(own).sum();
    let held = |prior: &Prior| -> f64 {
        let slopes = prior.slopes(x);
        let pairs = slopes.iter().flat_map(|a| slopes.iter().map(move |b| (a, b)));
        pairs.map(|((i, a), (j, b))| a * inverse[(*i, *j)] * b).sum()
    };
    let rank = if rank.is_finite() { rank.round() } else { n as f64 };
    rank - priors.iter().map(held).sum::<f64>()
}

//! The fit: a start, a minimum, and what is held where readings do not tell it.

use crate::Error;
use crate::estimate::conclusion::{Told, times, widening};
use crate::estimate::conventions::{Conventions, Here, OtherConfigurations};
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::minimum::minimum;
use crate::estimate::noise::open;
use crate::estimate::noise::source::first_noise;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::placed::{carried, placed};
use crate::estimate::softer::softer;
use crate::estimate::suspected::suspect;
use crate::estimate::tried::Start;
use crate::estimate::{search, start, zeros};
use crate::model::{Instance, Model, Prior};
use crate::numerics::linearization::Problem;
use crate::numerics::random::Random;
use crate::terms::term::Acts;

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
    let from_start = |start: Start, guess: Noise| {
        if observations.is_long() || observations.judged {
            return solve(observations, model.clone(), priors.clone(), start, guess);
        }
        open::fit_with_seatings(observations, &model, &start, |observations, start| {
            let noise = first_noise(observations, from.map(Fit::assumed));
            solve(observations, model.clone(), priors.clone(), start, noise)
        })
    };
    let mut found = from_start(start, guess.clone());
    let first = found.as_mut().ok().filter(|_| from.is_none() && !observations.judged);
    let anywhere = |first: &Fit| {
        zeros::anywhere(observations, first, |beta| {
            from_start(placed(observations, &model, &guess, beta), guess.clone())
        })
    };
    if let Some(first) = first
        && let Some(other) = anywhere(first)
    {
        zeros::beside(first, other);
    }
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
    let mut beta = carried(&fit.model, &fit.beta, model);
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
    placed(
        observations,
        model,
        noise,
        search::anchored(observations, model, &vec![1.0; model.scales.len()]),
    )
}

/// Largest number of fits, each with joints as soft as the fit before tells.
const SOFTENED: usize = 4;

/// A fit whose joints are as soft as readings tell, (176).
fn solve(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    start: Start,
    noise: Noise,
) -> Result<Fit, Error> {
    let mut found = as_drawn(observations, model, priors, start, noise)?;
    for _ in 0..SOFTENED {
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
    let minimum = |model, priors, holds: &[Prior], start, noise| {
        let found = minimum(observations, model, priors, holds, start, noise)?;
        Ok::<_, Error>(match observations.judged {
            true => found,
            false => suspect(observations, found, |other, terms| fit(other, terms, None)),
        })
    };
    if observations.judged {
        let held = start.stays.iter().filter_map(|stays| stays.held(&model, &start.beta));
        let holds: Vec<Prior> = held.collect();
        return minimum(model, priors, &holds, start, noise);
    }
    let begun = start.clone();
    let known = conventions_at_start(observations, &model, &priors, &start, &noise);
    let holds = known.holds(&model, &start.beta);
    let start = Start { beta: known.moved(&start.beta, &holds), ..start };
    let found = minimum(model.clone(), priors.clone(), &holds, start, noise)?;
    if found.conventions.rows.len() <= holds.len() {
        return Ok(found);
    }
    let holds = found.conventions.holds(&model, &begun.beta);
    let start = Start { beta: found.conventions.moved(&found.beta, &holds), ..begun };
    let there = minimum(model, priors, &holds, start, found.assumed())?;
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
    let here = Here { observations, model, priors, beta: &start.beta, noise, configurations: None };
    Conventions::of(here, &gram)
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
    let here =
        Here { observations, model, priors, beta, noise: &fit.assumed(), configurations: None };
    let conventions = Conventions::of(here, &fit.gram);
    let stays = conventions.stay(model);
    let Told { gram, inverse, unknowable, condition } = Told::of(&conventions, fit.gram);
    let covariance = times(&inverse, widening(&fit.noise, fit.p_value, fit.chi2 / fit.dof));
    Fit { gram, covariance, unknowable, condition, conventions, stays, ..fit }
}

/// Random configurations by which [`conventions_of`] any term of `more` parameters at the most is told: at
/// zero no term changes one.
pub(crate) fn other_configurations(
    observations: &Observations,
    fit: &Fit,
    more: usize,
) -> Option<OtherConfigurations> {
    let (model, priors, beta) = (&*fit.model, &fit.priors[..], &fit.beta[..]);
    let here =
        Here { observations, model, priors, beta, noise: &fit.assumed(), configurations: None };
    OtherConfigurations::of(here, model.term_parameters + more, &mut Random::new(0)).ok()
}

/// Directions of a fit with one more term that no reading could show, beyond those without it; `configurations` are
/// those of [`other_configurations`], where they are made already.
///
/// # Errors
///
/// As [`Model::new`].
pub(crate) fn conventions_of(
    observations: &Observations,
    fit: &Fit,
    term: Instance,
    configurations: Option<&OtherConfigurations>,
) -> Result<usize, Error> {
    let model = &observations.model_beside(&fit.model, &[term])?;
    let (beta, priors) = (&carry_over(fit, model)[..], &observations.priors(model)[..]);
    let Observations { readings, weights, .. } = observations;
    let (part, noise) = (Part { model, readings, weights: Some(weights) }, &fit.assumed());
    let gram = Implicit::new(vec![(part, noise.clone())], priors).linearize(beta).gram();
    let here = Here { observations, model, priors, beta, noise, configurations };
    Ok(Conventions::of(here, &gram).number().saturating_sub(fit.conventions.number()))
}

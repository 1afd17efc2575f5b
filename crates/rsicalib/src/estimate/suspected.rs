//! What a fit makes one suspect: its noise, what it was told, and how its readings are wired.

use crate::Error;
use crate::estimate::fitted::Fit;
use crate::estimate::miswired::{self, Again};
use crate::estimate::noise::source::DOUBT;
use crate::estimate::observations::Observations;
use crate::estimate::shifted::shifted;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::{degrees, doubts, lengths, measured_unit, seen};
use crate::model::Instance;

/// Adds to the warnings of a fit; `again` fits other readings.
pub(super) fn suspect(
    observations: &Observations,
    mut fit: Fit,
    again: impl Fn(&Observations, Vec<Instance>) -> Result<Fit, Error>,
) -> Fit {
    let of_knowledge = of_knowledge(observations, &fit);
    fit.warnings.extend(of_knowledge);
    let of_wiring = of_wiring(observations, &fit, again);
    fit.warnings.extend(of_wiring);
    // What a mistake leaves says nothing of the noise.
    let mistaken = |it: &Suspicion| {
        it.rewired().is_some() || matches!(it, Suspicion::Degrees { of, .. } if of.is_of_readings())
    };
    if fit.warnings.iter().any(mistaken) {
        fit.warnings.retain(|it| !it.of_noise_by_the_fit());
    }
    fit
}

/// Noise, play, lengths and knowledge that the fit contradicts.
fn of_knowledge(observations: &Observations, fit: &Fit) -> Vec<Suspicion> {
    let mut said = Vec::new();
    let judged = fit.dof >= 1.0 && fit.plausible && !fit.is_lost();
    let of_play = doubts::of_play(observations, fit).filter(|_| judged);
    let chi2 = (judged && of_play.is_none()).then_some([fit.chi2, fit.dof]);
    let play = fit.model.play().iter().any(|play| *play > 0.0);
    said.extend(doubts::of_noise(observations, &fit.noise, chi2, play));
    said.extend(of_play);
    if judged && fit.p_value.is_none_or(|p| p > DOUBT) {
        said.extend(doubts::of_knowledge(fit));
    }
    said.extend(doubts::of_lengths(observations, &fit.model, &fit.noise));
    said
}

/// Channels that are stuck, exchanged or of another unit: the fit would be better otherwise.
fn of_wiring(
    observations: &Observations,
    fit: &Fit,
    again: impl Fn(&Observations, Vec<Instance>) -> Result<Fit, Error>,
) -> Vec<Suspicion> {
    let refit_by = |other: &Observations, terms: Vec<Instance>| -> Result<Again, Error> {
        let again = again(other, terms)?;
        let left = if again.has_start() { again.chi2 / again.dof } else { f64::INFINITY };
        let Fit { model, beta, .. } = again;
        Ok(Again { left, model, beta })
    };
    let refit = |other: &Observations| refit_by(other, fit.model.instances.clone());
    let noise = fit.assumed();
    let left = if fit.has_start() { fit.chi2 / fit.dof } else { f64::INFINITY };
    let mut said: Vec<Suspicion> = Vec::new();
    said.extend(measured_unit::in_other_unit(observations, &noise, left));
    if said.is_empty() {
        said.extend(miswired::stuck(observations, &noise, left, refit));
    }
    if !fit.warnings.iter().chain(&said).any(Suspicion::of_wiring) {
        if fit.plausible {
            said.extend(degrees::of_fit(observations, &fit.model, &fit.beta));
        }
        said.extend(miswired::in_other_unit(observations, &noise, fit.chi2 / fit.dof, refit));
    }
    let wired = !fit.warnings.iter().any(|it| it.of_wiring() && !it.is_no_start());
    if wired && !said.iter().any(Suspicion::of_wiring) {
        said.extend(miswired::miswired(observations, &fit.model, &noise, left, refit_by));
        if !said.iter().any(Suspicion::of_wiring) {
            said.extend(seen::miswritten(observations, &noise, left, refit));
        }
        if !said.iter().any(Suspicion::of_wiring) {
            said.extend(shifted(observations, &noise, left, refit));
        }
        if !said.iter().any(Suspicion::of_wiring) {
            said.extend(lengths::in_other_unit(observations, &noise, left, refit));
        }
    }
    said
}

//! Doubts about what a session declares: units, noise, and readings that say nothing new.

use crate::estimate::degrees;
use crate::estimate::fitted::Fit;
use crate::estimate::noise::source::{ALIKE, DOUBT, LARGER_PART, NoiseEstimate, misdeclared};
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Suspicion, Witness};
use crate::model::Model;
use crate::model::known::Declared;
use crate::numerics::distributions::normal_cdf;

/// Share of the variance of a channel's noise that rounding must have to be named: with it the
/// standard deviation is a tenth larger than without, 1 - 1/1.1².
const COARSE: f64 = 0.17;

/// What the readings themselves are doubted for.
pub(crate) fn of_readings(observations: &Observations) -> Vec<Suspicion> {
    let mut found = Vec::new();
    if !observations.copies.is_empty() {
        let of = observations.readings.poses();
        found.push(Suspicion::SameReadings { poses: observations.copies.len(), of });
    }
    found.extend(degrees::of_readings(observations));
    found
}

/// Share of a declared variance that readings must tell for what they have to be held against it.
const TOLD: f64 = 0.1;

/// What a mechanism declares as known, and readings have elsewhere: of each distance, and of each term where it is
/// farthest off. `N(0, s² - p)` is the deviation of an estimate of variance `p` from what is known to `s`, where that
/// is true.
pub(crate) fn of_knowledge(fit: &Fit) -> Vec<Suspicion> {
    let declared = fit.model.declared();
    let mut found: Vec<(f64, Declared, f64, f64)> = Vec::new();
    for (of, prior) in &declared {
        let slopes = prior.slopes(&fit.beta);
        let left: f64 = (slopes.iter())
            .flat_map(|(i, a)| slopes.iter().map(move |(j, b)| a * b * fit.covariance[(*i, *j)]))
            .sum();
        let (told, off) = (1.0 - left, prior.off(&fit.beta));
        // A distance does not change with where the whole stands.
        let lost =
            matches!(of, Declared::Term(_)) && slopes.iter().any(|(i, _)| fit.unknowable[*i]);
        if told < TOLD || lost {
            continue;
        }
        let by_chance = 2.0 * normal_cdf(-off.abs() / told.sqrt()) * declared.len() as f64;
        if by_chance > DOUBT {
            continue;
        }
        let alike = |other: &Declared| match (of, other) {
            (Declared::Term(one), Declared::Term(other)) => one.term == other.term,
            _ => of == other,
        };
        let (off, sd) = (off * prior.sd(), prior.sd());
        match found.iter_mut().find(|(_, other, ..)| alike(other)) {
            Some(worst) if worst.0 <= by_chance => {}
            Some(worst) => *worst = (by_chance, *of, off, sd),
            None => found.push((by_chance, *of, off, sd)),
        }
    }
    found.into_iter().map(|(_, of, off, sd)| Suspicion::Knowledge { of, off, sd }).collect()
}

/// What the closures of a model are doubted for.
pub(crate) fn of_closures(model: &Model) -> Vec<Suspicion> {
    let mechanism = &model.mechanism;
    let unused = |k: &usize| {
        let closure = &mechanism.closures[*k];
        !closure.kind.facts().is_vector
            && !mechanism.is_link(closure)
            && model.equations_of(*k) == 0
    };
    let closures: Vec<usize> = (0..mechanism.closures.len()).filter(unused).collect();
    let mut found = Vec::new();
    if !closures.is_empty() {
        found.push(Suspicion::Follow { closures });
    }
    let used: Vec<usize> = model.links_of_closures().into_iter().map(|(k, _)| k).collect();
    let links =
        (0..mechanism.closures.len()).filter(|&k| mechanism.is_link(&mechanism.closures[k]));
    let closures: Vec<usize> = links.filter(|k| !used.contains(k)).collect();
    if !closures.is_empty() {
        found.push(Suspicion::Unused { closures });
    }
    found
}

/// What the noise of a fit is doubted for; `chi2` with its degrees of freedom where they can judge
/// the noise, and whether some of it is play.
pub(crate) fn of_noise(
    observations: &Observations,
    noise: &NoiseEstimate,
    chi2: Option<[f64; 2]>,
    play: bool,
) -> Vec<Suspicion> {
    let mut found = Vec::new();
    let least = observations.least_noise();
    for (channel, (least, sigma)) in least.iter().zip(&noise.sigma).enumerate() {
        // Where play rules what is left, rounding matters less.
        let share = least * least / (sigma * sigma) * noise.share;
        if share > COARSE {
            let step = observations.steps[channel];
            found.push(Suspicion::Coarse { channel, step, share: share.min(1.0) });
        }
    }
    if let (true, Some([chi2, dof])) = (noise.source.is_declared(), chi2) {
        let factor = misdeclared(chi2 / dof, dof);
        found.extend(factor.map(|factor| Suspicion::Noise { by: Witness::Fit, factor, play }));
    }
    found
}

/// Declared play of which less is left than chance allows: a residual of poses that are read twice is judged by
/// it, and so is one where nothing else is declared. Of what is left, the readings make their part as they are.
pub(crate) fn of_play(observations: &Observations, fit: &Fit) -> Option<Suspicion> {
    let [readings, ratio] = [fit.noise.share, fit.chi2 / fit.dof];
    let by_chance = fit.p_value.is_none_or(|above| 1.0 - above >= DOUBT);
    // Where the noise of readings is declared, too, and used, either may be too large.
    let both = fit.noise.source.is_declared() && observations.declares_noise();
    if by_chance || both || readings >= LARGER_PART {
        return None;
    }
    let error = (2.0 / fit.dof).sqrt().min(1.0) * ratio;
    let factor = ((ratio - readings).max(error) / (1.0 - readings)).sqrt();
    let mechanism = &fit.model.mechanism;
    let plays = |k: &usize| mechanism.closures[*k].noise.is_some_and(|noise| noise > 0.0);
    let closures: Vec<usize> = (0..mechanism.closures.len()).filter(plays).collect();
    (factor < 1.0 / ALIKE && !closures.is_empty()).then_some(Suspicion::Play { closures, factor })
}

/// Lengths and points that are read with every sample, whose noise is not what they declare.
pub(crate) fn of_lengths(
    observations: &Observations,
    model: &Model,
    noise: &NoiseEstimate,
) -> Vec<Suspicion> {
    let (play, lengths) = (model.play(), model.lengths());
    let by = if observations.readings.held { Witness::Repeats } else { Witness::Neighbours };
    let of = |(closure, equation): (usize, usize)| {
        let declared = play[equation] * lengths[equation].powi(2);
        let more = noise.seating.get(closure).copied().unwrap_or(0.0);
        let factor = ((declared + more) / declared).sqrt();
        let doubted = declared > 0.0 && !(1.0 / ALIKE..ALIKE).contains(&factor);
        let declared = declared.sqrt();
        let closure = model.closures[closure].number;
        doubted.then_some(Suspicion::LengthNoise { closure, by, declared, factor })
    };
    let mut found: Vec<(usize, Suspicion)> =
        model.lengths_read().filter_map(|at| Some((at.0, of(at)?))).collect();
    // The coordinates of one point declare one noise.
    found.dedup_by_key(|(closure, _)| *closure);
    found.into_iter().map(|(_, suspicion)| suspicion).collect()
}

//! Delays of a recording whose residual resembles its neighbours.
//!
//! A motion is smooth, and so is what a delay leaves of it: each row resembles the next, as with noise that
//! varies slowly, of which few rows in a hundred say something new. Where the search takes it for that, it finds
//! nothing. But a delay goes with the motion, from row to row, as slow noise does not. So delays are looked
//! for first, all rows taken for independent, and kept as far as they explain how the residual changes from row
//! to row,
//!
//! ```text
//! e_i = r_i - ρ r_i-1,    ρ = Σ r_i r_i-1 / Σ r_i²,    T = Σ_k n_k ln(Σ e² / Σ e'²)          (167)
//! ```
//!
//! with the residual `r` of equation `k` without, and `e'` with them, both in units of one noise. Each must pay for
//! itself by (118), the one that explains most first, and in the end by its covariance, which knows how rows resemble
//! their neighbours. Slow servos, which have a delay of their own, are looked for
//! beside delays; and what depends on the direction of motion, too, since a delay that stands for it alone is not kept.
//! What else there is, is then searched for beside them.

use crate::Error;
use crate::diagnosis::long::rise;
use crate::diagnosis::options::{LEVEL, SearchOptions};
use crate::diagnosis::price::{charge, of_places};
use crate::diagnosis::search::admissible::physical;
use crate::diagnosis::search::outcome::{FoundEffect, Searched};
use crate::estimate::intervals::wider;
use crate::estimate::{Fit, Implicit, Observations, Part, fit};
use crate::model::Instance;
use crate::numerics::order::Ends;
use crate::terms;
use crate::terms::term::{Class, Placed, Term};

/// Delays that were found, slow servos among them, and the fit with them.
pub(crate) struct Delays {
    pub found: Vec<FoundEffect>,
    pub fit: Fit,
}

/// Delays beside a fit of a recording; none where its residual does not resemble its neighbours, or they
/// explain none of its changes. `search` is a search from a fit of these terms.
///
/// # Errors
///
/// As [`fit`].
pub(crate) fn delays(
    observations: &Observations,
    clean: &Fit,
    base: &[Instance],
    options: &SearchOptions,
    search: impl Fn(&Fit, &[Instance], &SearchOptions) -> Result<Searched, Error>,
) -> Result<Option<Delays>, Error> {
    // Where only the fit gives the noise, all that is left is noise to it.
    let left = clean.p_value.is_none_or(|p| p <= LEVEL);
    let slow = !observations.readings.held && clean.noise.slow > 1.0;
    if !left || !slow || !observations.readings.timed {
        return Ok(None);
    }
    let explained = Changes { observations, clean, base };
    let among = |from: &Fit, kept: &[FoundEffect], wanted: &dyn Fn(&dyn Term) -> bool| {
        let mut alone = from.clone();
        (alone.noise.correlation, alone.noise.inflation, alone.noise.slow) = (0.0, 1.0, 1.0);
        let others = terms::all(&observations.mechanism).into_iter().filter(|term| !wanted(*term));
        let others = others.map(|term| term.info().id.to_owned());
        let without = others.chain(options.without.iter().cloned()).collect();
        search(&alone, &explained.instances(kept), &SearchOptions { without, ..options.clone() })
    };
    let found = among(clean, &[], &|term| term.is_delay())?.found;
    let (kept, here) = explained.kept(Vec::new(), clean.clone(), found)?;
    if kept.is_empty() {
        return Ok(None);
    }
    // What a servo does is to a delay what its second order is to its first; and what depends on the direction,
    // or happens at once, looks like a delay until it is there.
    let sudden =
        |term: &dyn Term| term.placed() == Placed::AtPose && term.info().class != Class::Data;
    let beside = |term: &dyn Term| (term.is_of_way() && !term.is_delay()) || sudden(term);
    let found = among(&here, &kept, &beside)?.found;
    let (kept, here) = explained.kept(kept, here, found)?;
    let (mut kept, mut here) = explained.needed(kept, here)?;
    if kept.iter().any(|step| !step.scored.instance.term.is_late()) {
        kept.retain(|step| step.scored.instance.term.is_late());
        here = explained.with(&kept, None)?;
    }
    // Each refit may turn a servo round.
    while let Some(k) = kept.iter().position(|step| !physical(&here, &step.scored.instance)) {
        kept.remove(k);
        here = explained.with(&kept, None)?;
    }
    while let Some(k) = least_that_does_not_pay(&kept, &here) {
        kept.remove(k);
        here = explained.with(&kept, None)?;
    }
    for k in 0..kept.len() {
        let one = kept.remove(k);
        let without = explained.with(&kept, None)?;
        kept.insert(k, FoundEffect { without, ..one });
    }
    Ok((!kept.is_empty()).then_some(Delays { found: kept, fit: here }))
}

/// The one that is worth least beside noise that resembles its neighbours, where that is nothing: changes of slow noise
/// follow those of a motion by chance, and its rows say much less of a delay than as many others.
pub(crate) fn least_that_does_not_pay(kept: &[FoundEffect], here: &Fit) -> Option<usize> {
    // Of correlated noise alone: what else is left is searched for later.
    let of_noise = wider(here) / here.noise.slow;
    let worth = |step: &FoundEffect| paid(step, rise(here, &step.scored.instance) * of_noise);
    let each = kept.iter().map(worth).enumerate();
    each.filter(|(_, worth)| *worth <= 0.0).least_by(|a| a.1).map(|(k, _)| k)
}

/// What a score leaves once an effect is paid: above zero it pays.
fn paid(one: &FoundEffect, score: f64) -> f64 {
    score - charge(1.0, score) - of_places(one.scored.places)
}

/// Effects by how they explain what changes from row to row.
struct Changes<'a> {
    observations: &'a Observations,
    clean: &'a Fit,
    base: &'a [Instance],
}

impl Changes<'_> {
    fn instances(&self, kept: &[FoundEffect]) -> Vec<Instance> {
        self.base.iter().copied().chain(kept.iter().map(|step| step.scored.instance)).collect()
    }

    fn with(&self, kept: &[FoundEffect], one: Option<&FoundEffect>) -> Result<Fit, Error> {
        let one = one.map(|one| one.scored.instance);
        let instances = self.instances(kept).into_iter().chain(one).collect();
        fit(self.observations, instances, Some(self.clean))
    }

    /// What an effect is worth between the fit without it and the fit with it.
    fn worth(&self, one: &FoundEffect, without: &Fit, with: &Fit) -> f64 {
        let of = |fit: &Fit| changes(self.observations, fit, self.clean);
        paid(one, of(without) - of(with))
    }

    /// The effects that pay beside those that are kept. The one that explains most comes first: what several
    /// joints have is not said of each of the others.
    fn kept(
        &self,
        mut kept: Vec<FoundEffect>,
        mut here: Fit,
        mut found: Vec<FoundEffect>,
    ) -> Result<(Vec<FoundEffect>, Fit), Error> {
        while !found.is_empty() {
            let mut best: Option<(f64, usize, Fit)> = None;
            for (k, one) in found.iter().enumerate() {
                let there = self.with(&kept, Some(one))?;
                let left = self.worth(one, &here, &there);
                let better = left > best.as_ref().map_or(0.0, |best| best.0);
                if better && physical(&there, &one.scored.instance) {
                    best = Some((left, k, there));
                }
            }
            let Some((_, k, there)) = best else { break };
            kept.push(found.remove(k));
            here = there;
        }
        Ok((kept, here))
    }

    /// Those of them that still pay beside all others, the one that pays least judged first.
    fn needed(
        &self,
        mut kept: Vec<FoundEffect>,
        mut here: Fit,
    ) -> Result<(Vec<FoundEffect>, Fit), Error> {
        while kept.len() > 1 {
            let mut least: Option<(f64, usize, Fit)> = None;
            for k in 0..kept.len() {
                let one = kept.remove(k);
                let without = self.with(&kept, None)?;
                let worth = self.worth(&one, &without, &here);
                kept.insert(k, one);
                if worth <= least.as_ref().map_or(0.0, |least| least.0) {
                    least = Some((worth, k, without));
                }
            }
            let Some((_, k, without)) = least else { break };
            kept.remove(k);
            here = without;
        }
        Ok((kept, here))
    }
}

/// Rows that count and that a fit's delays put at an instant beyond an end of the recording, or in a pause: what
/// belongs to them was not read, and the line that stands in its place would be an effect of its own.
pub(crate) fn beyond(observations: &Observations, fit: &Fit) -> Vec<usize> {
    let Observations { readings, weights, .. } = observations;
    let of = |channel: usize| fit.model.late(&fit.beta, channel, 0)[1].lag;
    let ends = (0..readings.channels).map(of).fold([0.0_f64; 2], |[a, b], d| [a.min(d), b.max(d)]);
    if ends == [0.0; 2] {
        return Vec::new();
    }
    let lost = |row: &usize| {
        weights[*row] > 0.0 && ends.iter().any(|d| *d != 0.0 && !readings.goes_on(*row, *d))
    };
    (0..readings.samples).filter(lost).collect()
}

/// `Σ n_k ln Σ e²` of (167), in units of the noise of another fit.
fn changes(observations: &Observations, fit: &Fit, noise_of: &Fit) -> f64 {
    let Observations { readings, weights, .. } = observations;
    let part = Part { model: &fit.model, readings, weights: Some(weights) };
    let problem = Implicit::new(vec![(part, noise_of.assumed())], &fit.priors);
    let residuals = problem.residuals_keeping(&fit.beta, false, Some(&[]));
    let k = residuals.equations;
    let session = |row: usize| readings.session_of_pose[readings.pose[row]];
    let follows = |row: &usize| {
        weights[*row] > 0.0 && weights[row - 1] > 0.0 && session(*row) == session(row - 1)
    };
    let rows: Vec<usize> = (1..readings.samples).filter(follows).collect();
    let of = |equation: usize| {
        // Where a pose has unknown places, equations are none of one closure.
        let closure = fit.model.closure_at(equation).filter(|_| fit.model.pose_unknowns() == 0);
        let holds = |row: usize| closure.is_none_or(|c| readings.holding.holds(row, c));
        let rows: Vec<usize> =
            rows.iter().copied().filter(|&row| holds(row) && holds(row - 1)).collect();
        let r = |row: usize| residuals.whitened[row * k + equation];
        let square: f64 = rows.iter().map(|&row| r(row - 1).powi(2)).sum();
        if square <= 0.0 {
            return 0.0; // left out, or nothing is left
        }
        let rho = rows.iter().map(|&row| r(row) * r(row - 1)).sum::<f64>() / square;
        let left: f64 = rows.iter().map(|&row| (r(row) - rho * r(row - 1)).powi(2)).sum();
        rows.len() as f64 * left.max(f64::MIN_POSITIVE).ln()
    };
    (0..k).map(of).sum()
}

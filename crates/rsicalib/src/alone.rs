//! Whether one channel, closure or chain is at fault alone, by whatever law.
//!
//! What has unbounded variance says nothing, so a fit with `σ_c → ∞` is one to all that
//! is not `c`: each pose gives up as many equations as `c` moves,
//!
//! ```text
//! χ²_c ~ χ²(ν - Σ_p rank A_p,c + n_c)                                      (73)
//! ```
//!
//! with `n_c` the parameters that only `c` has. Where the rest closes within its noise,
//! and nothing in it stands out, `c` is all that is wrong.

use crate::fit::{Fit, fit};
use crate::model::{Instance, Target};
use crate::rivals::{SURE, probabilities};
use crate::scan::{self, Judge, Scored, dot};
use crate::session::Session;
use crate::trace::{LEFT, Search};
use crate::{Error, Mechanism};

/// Standard deviation of a reading that says nothing, in units of its own noise.
const UNBOUNDED: f64 = 1e4;
/// Fewer degrees of freedom than this judge nothing.
const FEW: f64 = 8.0;
/// So many are looked at, those first that leave the least: one at fault leaves least.
const LIKELY: usize = 3;
/// What was found elsewhere is not needed where chance makes as much this often.
const NEEDLESS: f64 = 1e-3;

/// What is at fault alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alone {
    /// A channel, a closure or a chain.
    pub target: Target,
    /// Probability of a larger χ² of the rest, (73).
    pub p_value: f64,
}

/// The channel or closure, or else the chain, that is at fault alone; none where there is
/// no such one, or where nothing but the fit gives the noise.
///
/// `base` is the fit without any effect, of what is not left out; `found` what the search
/// found.
///
/// # Errors
///
/// As [`fit`].
pub fn alone(
    session: &Session,
    base: &Fit,
    judge: &Judge,
    found: &[Instance],
    search: &Search,
) -> Result<Option<Alone>, Error> {
    let mechanism = &session.mechanism;
    if judge.residual_dof.is_some() {
        return Ok(None);
    }
    let channels = (0..mechanism.channels.len()).map(Target::Channel);
    let closures = (0..mechanism.closures.len()).map(Target::Closure);
    let chains = (0..mechanism.chains.len()).map(Target::Chain);
    let kinds: [Vec<Target>; 2] = [channels.chain(closures).collect(), chains.collect()];
    for kind in kinds {
        let mut able: Vec<Without> = Vec::new();
        for target in kind {
            able.extend(closes(session, base, judge, target)?);
            able.sort_by(|a, b| a.rest.chi2.total_cmp(&b.rest.chi2));
            able.truncate(LIKELY);
        }
        let mut alone = Vec::new();
        for it in able {
            if !it.needs_more(judge, found, search)? {
                alone.push((-it.rest.chi2, Alone { target: it.target, p_value: it.p_value }));
            }
        }
        if let Some(&(alone, sure)) = probabilities(&alone).first()
            && sure >= SURE
        {
            return Ok(Some(alone));
        }
    }
    Ok(None)
}

/// Of readings and poses that were found wrong, those that are so even where whatever
/// is at fault alone says nothing.
///
/// # Errors
///
/// As [`fit`].
pub fn wrong_anyway(
    session: &Session,
    base: &Fit,
    judge: &Judge,
    target: Target,
    wrong: &[Instance],
    search: &Search,
) -> Result<Vec<Scored>, Error> {
    let freed = freed(session, base, target);
    let rest = fit(&freed, base.model.instances.clone(), Some(base))?;
    let mut scored = scan::bad_readings(&freed, &rest, judge)?;
    scored.retain(|s| wrong.contains(&s.instance) && s.corrected <= search.alpha);
    Ok(scored)
}

/// A fit to all but one thing.
struct Without {
    target: Target,
    freed: Session,
    rest: Fit,
    p_value: f64,
}

impl Without {
    /// Whether something else stands out, or was found and still is needed.
    fn needs_more(
        &self,
        judge: &Judge,
        found: &[Instance],
        search: &Search,
    ) -> Result<bool, Error> {
        let mechanism = &self.freed.mechanism;
        let scored = scan::scan(&self.freed, &self.rest, judge, &search.without)?;
        let mut elsewhere =
            scored.iter().filter(|s| !belongs(mechanism, s.instance.target, self.target));
        Ok(elsewhere.any(|s| {
            let needed = found.contains(&s.instance) && s.p_value <= NEEDLESS;
            needed || s.corrected <= search.alpha
        }))
    }
}

/// The fit to the rest, where that closes within its noise by (73).
fn closes(
    session: &Session,
    base: &Fit,
    judge: &Judge,
    target: Target,
) -> Result<Option<Without>, Error> {
    let mechanism = &session.mechanism;
    let live = session.weights.iter().filter(|w| **w > 0.0).count();
    let lost = match target {
        Target::Closure(k) => (live * mechanism.closures[k].kind.equations()) as f64,
        _ => taken_up(session, base, &channels_of(mechanism, target)).1,
    };
    let freed = freed(session, base, target);
    let rest = fit(&freed, base.model.instances.clone(), Some(base))?;
    // Priors may know more of the parameters than the readings do.
    let most = (live * base.residuals.equations) as f64 - lost;
    let dof = (rest.dof - lost + own(base, mechanism, target)).min(most);
    let p_value = judge.p_value(rest.chi2, dof);
    let quiet = dof >= FEW && p_value > LEFT;
    Ok(quiet.then_some(Without { target, freed, rest, p_value }))
}

/// The session in which this says nothing.
fn freed(session: &Session, base: &Fit, target: Target) -> Session {
    let mut freed = session.clone();
    let mut sigma = base.noise.sigma.clone();
    for channel in channels_of(&session.mechanism, target) {
        sigma[channel] *= UNBOUNDED;
    }
    freed.options.noise = Some(sigma);
    if let Target::Closure(k) = target {
        freed.mechanism.closures[k].noise = Some(UNBOUNDED * base.rms_misclosure);
    }
    freed
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

fn channels_of(mechanism: &Mechanism, target: Target) -> Vec<usize> {
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
        _ => of == target,
    }
}

/// χ² of what is left that errors of these channels, free in each pose, would take
/// up, and in how many dimensions.
#[must_use]
pub fn taken_up(session: &Session, fit: &Fit, channels: &[usize]) -> (f64, f64) {
    let residuals = &fit.residuals;
    let (k, c) = (residuals.equations, session.readings.channels);
    let (mut taken, mut dimensions) = (0.0, 0.0);
    for row in (0..session.readings.samples).filter(|&r| session.weights[r] > 0.0) {
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

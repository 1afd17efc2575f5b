//! When what happened once happened, beside everything else that a fit has.
//!
//! A fit without it lets other parameters take up a part, and may place it some poses off. Neighbouring times
//! explain nearly the same: they are one place, not many.

use std::cmp::Ordering;
use std::collections::HashMap;

use crate::Error;
use crate::diagnosis::price::Said;
use crate::diagnosis::score::bodies::Bodies;
use crate::diagnosis::score::scored::{Scored, is_data};
use crate::estimate::at_fit::AtFit;
use crate::estimate::{Fit, Observations, fit};
use crate::model::Instance;
use crate::screening::steps::Fitted;
use crate::terms::term::Placed;

/// Moves at the most: after so many a time is the last, or there is none.
const MOVES: usize = 3;

/// True for what happened once, to a sensor or to a body.
#[must_use]
pub fn happened_once(instance: &Instance) -> bool {
    instance.term.placed() == Placed::AtPose && !is_data(instance)
}

/// Counts times as likely as the likeliest as one place, by the probability of all of them together:
///
/// ```text
/// places ← places / Σ exp(½ (u_t - max u)),    u = fall of data(χ²) - charge, over all times t       (172)
/// ```
///
/// so that the price of what happened once is of any time, not of one that was picked.
pub fn over_times(scored: &mut [Scored], beside: &Said) {
    let key = |s: &Scored| (s.instance.term.info().id, s.instance.target);
    let says = |s: &Scored| 0.5 * (beside.fall(s.score) - s.charge);
    let mut times: HashMap<_, Vec<f64>> = HashMap::new();
    for one in scored.iter().filter(|s| happened_once(&s.instance)) {
        times.entry(key(one)).or_default().push(says(one));
    }
    let as_one = |of: &Vec<f64>| {
        let most = of.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        of.iter().map(|one| (one - most).exp()).sum::<f64>()
    };
    let alike: HashMap<_, f64> = times.iter().map(|(key, of)| (*key, as_one(of))).collect();
    for one in scored.iter_mut().filter(|s| happened_once(&s.instance)) {
        one.places /= Some(alike[&key(one)]).filter(|times| times.is_finite()).unwrap_or(1.0);
    }
}

/// A fit with what happened once at the time that is likeliest, and what it is then.
///
/// # Errors
///
/// As [`fit`].
pub fn retimed(
    observations: &Observations,
    from: &Fit,
    mut fitted: Fit,
    mut instance: Instance,
) -> Result<(Instance, Fit), Error> {
    for _ in 0..MOVES {
        let Some(there) = likelier(observations, &fitted, &instance)? else { break };
        let others = fitted.model.instances.iter();
        let instances = others.map(|i| if *i == instance { there } else { *i }).collect();
        let moved = fit(observations, instances, Some(from))?;
        if moved.cost().partial_cmp(&fitted.cost()) != Some(Ordering::Less) {
            break;
        }
        (instance, fitted) = (there, moved);
    }
    Ok((instance, fitted))
}

/// The same at the pose from which on it is likelier to have happened, (159); none where there is none.
fn likelier(
    observations: &Observations,
    fit: &Fit,
    instance: &Instance,
) -> Result<Option<Instance>, Error> {
    let Some(k) = fit.model.instances.iter().position(|i| i == instance) else { return Ok(None) };
    let (first, width) = (fit.model.first[k], instance.width());
    let at = AtFit::new(observations, fit);
    let own = Fitted {
        values: fit.beta[first..first + width].to_vec(),
        covariance: at.inverse.submatrix(first, first, width, width).to_owned(),
        root: at.root.submatrix(first, 0, width, at.root.ncols()).to_owned(),
    };
    let bodies = Bodies::of(&at, vec![*instance])?;
    Ok(bodies.likelier(0, &own))
}

#[cfg(test)]
mod tests {
    use super::over_times;
    use crate::diagnosis::price::{Data, Family, Said, Scale};
    use crate::diagnosis::score::scored::Scored;
    use crate::mechanism::Target;
    use crate::model::Instance;
    use crate::terms::find;

    #[test]
    fn what_happened_once_is_as_likely_as_all_its_times_together() {
        let slip = find("slip").expect("a term");
        let at = |channel: usize, place: usize, score: f64| {
            let instance = Instance { term: slip, target: Target::Channel(channel), place };
            Scored::of(instance, Family::Slip, score, 1.0, 1.0, 90.0)
        };
        let mut scored = vec![at(0, 4, 31.0), at(0, 5, 30.0), at(1, 4, 12.0), at(0, 6, 22.0)];
        let (before, one) = (scored.clone(), scored[2].paid());
        let known = Data { scale: Scale::Known(f64::INFINITY), dof: 60.0 };
        over_times(&mut scored, &Said { data: known, chi2: 90.0, larger_noise: false });
        // Likelihoods of each time, the prior spread over the 90 places, added.
        let odds = |s: &Scored| (0.5 * (s.score - s.paid())).exp();
        let together: f64 = [0, 1, 3].map(|k| odds(&before[k])).iter().sum();
        assert!((odds(&scored[0]) - together).abs() < 1e-9 * together);
        assert!((scored[2].paid() - one).abs() < 1e-12);
    }
}

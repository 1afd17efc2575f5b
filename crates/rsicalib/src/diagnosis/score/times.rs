//! When what happened once happened, beside everything else that a fit has.
//!
//! A fit without it lets other parameters take up a part, and may place it some poses off.

use std::cmp::Ordering;

use crate::Error;
use crate::diagnosis::score::bodies::Bodies;
use crate::diagnosis::score::scored::is_data;
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

//! A calibration with and without readings that are wrong.
//!
//! One wrong reading must neither ruin a calibration nor vanish in silence. Where readings
//! look bad, the whole search of [`trace`] judges them beside the effects that the
//! model may lack, which would make good readings look bad; what it finds wrong is left out.

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::plausibility::absurdities;
use crate::diagnosis::score::scored;
use crate::diagnosis::sent::closing_as_sent;
use crate::diagnosis::trace::{looks_bad, trace};
use crate::estimate::{Fit, Method, Observations, fit, with_groups};
use crate::model::Instance;
use crate::screening::converter;
use crate::screening::excluded::Excluded;
use crate::screening::sound::{Kept, sound};

/// A calibration.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The session, bad readings left out.
    pub observations: Observations,
    /// The fit without them.
    pub fit: Fit,
    /// What was left out.
    pub excluded: Vec<Excluded>,
    /// The fit of all readings, where any was left out.
    pub with: Option<Fit>,
}

/// Poses of more than this are not searched for bad readings: in a long recording
/// one row has no weight, and [`trace`] finds it.
const MOST_POSES: usize = 2000;

/// Fits the terms that the options ask for, without readings that are wrong.
///
/// # Errors
///
/// As [`fit`].
pub fn calibrate(observations: &Observations) -> Result<Calibrated, Error> {
    let coded = fit(observations, observations.instances()?, None)?;
    let sent = closing_as_sent(observations, &coded);
    let observations = sent.as_ref().unwrap_or(observations);
    let all = match &sent {
        Some(sent) => fit(sent, sent.instances()?, None)?,
        None => coded,
    };
    let usable = all.converged() && all.dof >= 1.0;
    if observations.options.method == Method::Algebraic || !usable {
        return Ok(whole(observations, all));
    }
    let mut rest = observations.clone();
    let (clean, excluded) = sound(&mut rest, &all, Kept::Nothing)?;
    // Points that are touched are judged by placement.
    let searched = all.model.unknowns.is_empty() && observations.readings.poses() <= MOST_POSES;
    if searched && looks_bad(&rest, &clean)? {
        let traced = trace(observations, &SearchOptions::default())?;
        let data: Vec<Instance> =
            traced.after.model.instances.iter().copied().filter(scored::is_data).collect();
        if !traced.excluded.is_empty() {
            let mut instances = all.model.instances.clone();
            instances.extend_from_slice(&data);
            let (mut used, excluded) = (traced.observations, traced.excluded);
            // A delay is no part of this model.
            traced.unread.iter().for_each(|&row| used.weights[row] = observations.weights[row]);
            let left = fit(&used, instances, Some(&clean))?;
            return Ok(Calibrated {
                fit: with_groups(converter::seen_by(&all, left), &used),
                observations: used,
                excluded,
                with: Some(all),
            });
        }
    }
    // Of readings that are not of this mechanism none is worse than the others.
    if excluded.is_empty() || !absurdities(&rest, &clean, &[]).is_empty() {
        return Ok(whole(observations, all));
    }
    let clean = with_groups(clean, &rest);
    Ok(Calibrated { observations: rest, fit: clean, excluded, with: Some(all) })
}

fn whole(observations: &Observations, fit: Fit) -> Calibrated {
    let fit = with_groups(fit, observations);
    Calibrated { observations: observations.clone(), fit, excluded: Vec::new(), with: None }
}

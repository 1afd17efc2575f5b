//! A calibration with and without readings that are wrong.
//!
//! One wrong reading must neither ruin a calibration nor vanish in silence. Where readings
//! look bad, the whole search of [`crate::trace()`] judges them beside the effects that the
//! model may lack, which would make good readings look bad; what it finds wrong is left out.

use crate::fit::{Fit, Method, fit};
use crate::model::Instance;
use crate::scan;
use crate::session::Session;
use crate::trace::{Excluded, Search, looks_bad, trace};
use crate::{Error, bad, faults};

/// A calibration.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The session, bad readings left out.
    pub session: Session,
    /// The fit without them.
    pub fit: Fit,
    /// What was left out.
    pub excluded: Vec<Excluded>,
    /// The fit of all readings, where any was left out.
    pub with: Option<Fit>,
}

/// Poses of more than this are not searched for bad readings: in a long recording
/// one row has no weight, and [`crate::trace()`] finds it.
const MOST: usize = 2000;

/// Fits the terms that the options ask for, without readings that are wrong.
///
/// # Errors
///
/// As [`fit`].
pub fn calibrate(session: &Session) -> Result<Calibrated, Error> {
    let all = fit(session, session.instances()?, None)?;
    let sound = all.plausible && all.termination.converged() && all.dof >= 1.0;
    if session.options.method == Method::Algebraic || !sound || session.readings.poses() > MOST {
        return Ok(whole(session, all));
    }
    let mut rest = session.clone();
    let faulty = faults::faults(&session.mechanism, &session.readings);
    let mut excluded = faults::set_apart(&mut rest, &all, &faulty);
    excluded.extend(bad::samples(&mut rest, &all));
    if !all.model.unknown_names.is_empty() {
        // Points that are touched are judged by placement.
        excluded.extend(bad::placements(&mut rest, &all)?);
    } else {
        let clean = if excluded.is_empty() { all.clone() } else { again(&rest, &all, &[])? };
        if looks_bad(&rest, &clean)? {
            let traced = trace(session, &Search::default())?;
            if traced.excluded.is_empty() {
                return Ok(whole(session, all));
            }
            let data: Vec<Instance> =
                traced.after.model.instances.iter().copied().filter(scan::is_data).collect();
            let fit = again(&traced.session, &all, &data)?;
            let (session, excluded) = (traced.session, traced.excluded);
            return Ok(Calibrated { session, fit, excluded, with: Some(all) });
        }
    }
    if excluded.is_empty() {
        return Ok(whole(session, all));
    }
    let fit = again(&rest, &all, &[])?;
    Ok(Calibrated { session: rest, fit, excluded, with: Some(all) })
}

fn whole(session: &Session, fit: Fit) -> Calibrated {
    Calibrated { session: session.clone(), fit, excluded: Vec::new(), with: None }
}

/// The fit of what is left, readings that are wrong fitted apart.
fn again(session: &Session, all: &Fit, data: &[Instance]) -> Result<Fit, Error> {
    let mut instances = all.model.instances.clone();
    instances.extend_from_slice(data);
    Ok(faults::seen_by(all, fit(session, instances, Some(all))?))
}

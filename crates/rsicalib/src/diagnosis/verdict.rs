//! The verdict: one function for a calibration and for a trace.

use crate::diagnosis::localisation::Unexplained;
use crate::diagnosis::options::RESIDUAL_LEVEL;
use crate::diagnosis::trace::Traced;

pub(crate) fn verdict(traced: &Traced, left: &Unexplained) -> &'static str {
    let after = &traced.after;
    if !after.termination.converged() || !after.plausible {
        return "undetermined";
    }
    let quiet = left.p_value.is_none_or(|p| p > RESIDUAL_LEVEL) && left.target.is_none();
    match (traced.found.is_empty(), quiet) {
        (true, true) => "adequate",
        (false, true) => "explained",
        (false, false) => "partly_explained",
        (true, false) => "unexplained",
    }
}

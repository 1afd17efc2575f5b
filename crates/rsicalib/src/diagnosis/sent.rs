//! Readings on a grid that is coarse beside the noise which is known of them: codes of a sensor, or positions to which
//! a machine was sent, written as they were sent.
//!
//! No reading tells which: where a machine goes is chosen. But codes leave loops open by what rounding does to a
//! reading. Loops that close better than that, beyond chance, and sessions that are explained with the noise as it is
//! declared, have no codes.

use crate::estimate::noise::source::{DOUBT, NOISIER, presumed};
use crate::estimate::{Fit, Observations};
use crate::numerics::distributions::chi2_tail;

/// The readings as positions; none where no channel reads in steps that make its noise so many times larger. Counters
/// have codes.
pub(crate) fn as_sent(observations: &Observations) -> Option<Observations> {
    let known = presumed(observations).sigma;
    let least = observations.least_noise();
    let counts = |c: usize| observations.mechanism.channels[c].counts();
    let coarse = |c: &usize| !counts(*c) && least[*c] > NOISIER * known[*c];
    let channels: Vec<usize> = (0..known.len()).filter(coarse).collect();
    let mut sent = observations.clone();
    channels.iter().for_each(|&c| sent.steps[c] = 0.0);
    (!channels.is_empty()).then_some(sent)
}

/// True for a fit in which loops close better than the noise lets them, beyond chance.
fn closes_too_well(fit: &Fit) -> bool {
    fit.stands() && fit.dof >= 1.0 && 1.0 - chi2_tail(fit.chi2, fit.dof) < DOUBT
}

/// The readings as positions, where loops close too well for codes in the fit of what was asked for; none where they
/// do not, or have none.
pub(crate) fn closing_as_sent(observations: &Observations, coded: &Fit) -> Option<Observations> {
    as_sent(observations).filter(|_| closes_too_well(coded))
}

//! What physics admits: loads act their way, joints still move, loops close as well as before.

use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::Rule;
use crate::estimate::Fit;
use crate::estimate::search::ratios;
use crate::model::Instance;

/// A parameter of an effect in units of its standard deviation; none where the effect
/// is not in the model, or not to be seen.
pub(super) fn estimate_of(fit: &Fit, instance: &Instance) -> Option<f64> {
    let k = fit.model.instances.iter().position(|i| i == instance)?;
    let first = fit.model.first[k];
    let variance = fit.covariance[(first, first)];
    (variance > 0.0).then(|| fit.beta[first] / variance.sqrt())
}

/// False for a load of the catalogue that acts the other way: a joint cannot give against a weight,
/// and what explains the residual so is something else; nor does a servo turn a corner before its goal. The sign
/// of a user's law is the user's.
pub(crate) fn physical(fit: &Fit, instance: &Instance) -> bool {
    if instance.term.cuts_corners() {
        return !cuts_ahead(fit, instance);
    }
    !instance.term.is_load()
        || instance.term.info().law
        || estimate_of(fit, instance).is_none_or(|sure| sure > 0.0)
}

/// True where a channel would turn before its goal: the square of its time constant is below zero, by this effect
/// and those beside it, or it is not late at all.
fn cuts_ahead(fit: &Fit, instance: &Instance) -> bool {
    let model = &fit.model;
    let Some(k) = model.instances.iter().position(|i| i == instance) else { return false };
    let own = model.electronics.iter().filter(|e| e.first == model.first[k]);
    let late = |channel: usize| model.late(&fit.beta, channel, 0)[1];
    own.map(|e| late(e.channel))
        .any(|l| l.lag == 0.0 || l.square.is_some_and(|square| square < 0.0))
}

/// An effect changes the gain that a fit gives a channel by less than this factor.
const SWUNG: f64 = 2.0;

/// True where a channel's gain is far from what it was without an effect, or has turned round: a
/// large effect and a gain that undoes it follow any curve.
fn swung(before: &Fit, after: &Fit) -> bool {
    let (was, is) = (ratios(&before.model, &before.beta), ratios(&after.model, &after.beta));
    was.zip(is).any(|(was, is)| !(1.0 / SWUNG..SWUNG).contains(&(is / was)))
}

/// Standard deviations of a mean square by which chance makes it larger.
const BY_CHANCE: f64 = 2.0;

/// True where loops are farther from closed than before, by more than the sampling error of a root
/// mean square: an effect that makes equations weightless explains nothing.
fn opened(before: &Fit, after: &Fit) -> bool {
    let error = BY_CHANCE / (2.0 * before.dof.max(1.0)).sqrt();
    after.rms_misclosure > before.rms_misclosure * (1.0 + error)
}

impl Averaged<'_> {
    /// True for a fit with more effects than another, in which every joint still moves, and about
    /// as much for its readings, and the loops close as well as before.
    pub(crate) fn sensible(&self, before: &Fit, after: &Fit) -> bool {
        let swung = self.search.uses(Rule::Swung) && swung(before, after);
        let opened = self.search.uses(Rule::Misclosure) && opened(before, after);
        after.converged() && !swung && !opened
    }
}

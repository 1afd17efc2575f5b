//! A fit of a session without a mistake, beside the fit of it as it is declared.

use std::sync::Arc;

use crate::Error;
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::options::FitOptions;
use crate::mechanism::Mechanism;
use crate::model::Model;
use crate::numerics::lm::SolverOptions;
use crate::numerics::order;
use crate::readings::Table;

/// χ² must fall by this factor before a mistake is named.
pub(crate) const DECISIVE: f64 = 20.0;

/// A fit ends where steps lower χ² by less than this part of it: such fits are told apart by a factor of
/// [`DECISIVE`], of which this is a fiftieth.
pub(crate) const LITTLE: f64 = 0.02 / DECISIVE;

/// A fit of other observations.
pub(crate) struct Again {
    /// χ² per degree of freedom.
    pub(crate) left: f64,
    /// Its model.
    pub(crate) model: Arc<Model>,
    /// Its parameters.
    pub(crate) beta: Vec<f64>,
}

impl Again {
    /// A fit of other readings of a session, or of its readings by another drawing; none where there is none.
    ///
    /// Both are judged by one `noise`, that of a fit of the session, in units of the readings that are fitted.
    pub(crate) fn of(
        observations: &Observations,
        (mechanism, table): (&Mechanism, Table),
        noise: &Noise,
        refit: &impl Fn(&Observations) -> Result<Self, Error>,
    ) -> Option<Self> {
        let Noise { sigma, play, seating, measured } = noise.clone();
        let (noise, measured) = (Some(sigma), Some(measured));
        let of = observations.options.clone();
        let lm = SolverOptions { ftol: LITTLE, ..of.lm.clone() };
        let options = FitOptions { noise, play, seating, measured, lm, ..of };
        let rest = observations.rest.clone();
        let there = Observations::new(mechanism, table, rest, options).ok()?;
        let weights = observations.weights.clone();
        refit(&Observations { weights, judged: true, ..there }).ok()
    }
}

/// The fits without a mistake that leave least, by χ² per degree of freedom: the least first, and those that do not
/// leave by far more.
pub(crate) fn likeliest<T>(mut found: Vec<(f64, T)>) -> Vec<(f64, T)> {
    order::ascending(&mut found, |a| a.0);
    let least = found.first().map_or(f64::INFINITY, |(least, _)| *least);
    found.retain(|(left, _)| *left <= least * DECISIVE);
    found
}

/// The fit without a mistake that leaves least, where that is below a limit and by far less than any other leaves.
pub(crate) fn decisive<T>(found: Vec<(f64, T)>, limit: f64) -> Option<(f64, T)> {
    let mut found = likeliest(found);
    found.pop().filter(|(with, _)| found.is_empty() && *with < limit)
}

/// χ² per degree of freedom below which a loop closes with a mistake undone, where `left` is what it is as
/// declared: by far less, and no more than a start may leave that leads to a fit. None where mistakes are not
/// looked for: in a long recording, and where the loop closes as declared.
pub(crate) fn closing(observations: &Observations, left: f64) -> Option<f64> {
    (!observations.is_long() && left >= DECISIVE)
        .then(|| observations.options.good_start.min(left / DECISIVE))
}

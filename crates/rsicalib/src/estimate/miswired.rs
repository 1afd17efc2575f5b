//! Exchanged and reversed channels, where no search for a start can tell.
//!
//! A search for a start reverses gains and exchanges columns. Where gains are not asked for it cannot
//! reverse them, and a mechanism with unknown places begins without a search. There each mistake is
//! undone in the readings, and everything is fitted again.

use crate::Error;
use crate::estimate::degrees::{Again, closing};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::rewired::{DECISIVE, Rewired};
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::model::Model;
use crate::terms::term::Role;

/// The only mistake with which the loop closes, and by far not as it is declared: `left` is χ² per degree
/// of freedom by a `noise`, and `refit` a fit of other observations.
pub(crate) fn miswired(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let readings = &*observations.readings;
    let closes = |with| Closes { with, declared: left };
    let again = |Rewired { readings, observations: of }: Rewired| {
        Again::of(&of, (&of.mechanism, readings.table), noise, &refit).map(|it| it.left)
    };
    let searched = model.unknowns.is_empty() && model.pose_unknowns() == 0;
    let exchanged = (!searched).then(|| Rewired::every_exchange(observations, readings));
    let exchanged = exchanged.into_iter().flatten().filter_map(|(rewired, channels)| {
        let with = again(rewired)?;
        Some((with, Suspicion::Exchanged { channels, closes: closes(with) }))
    });
    let fixed = |c: &usize| !searched || model.column(Role::Gain, *c).is_none();
    let reversed = (0..readings.channels).filter(fixed).filter_map(|c| {
        let with = again(Rewired::mirrored(observations, readings, c)?)?;
        Some((with, Suspicion::Reversed { channels: vec![c], closes: closes(with) }))
    });
    let mut found: Vec<_> = exchanged.chain(reversed).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found = found.into_iter();
    let (with, suspicion) = found.next()?;
    let next = found.next().map_or(f64::INFINITY, |(next, _)| next);
    (with < limit.min(next / DECISIVE)).then_some(suspicion)
}

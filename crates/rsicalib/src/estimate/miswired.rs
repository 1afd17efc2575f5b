//! Exchanged and reversed channels, where no search for a start can tell.
//!
//! A search for a start reverses gains and exchanges columns. Where gains are not asked for it cannot
//! reverse them, and a mechanism with unknown places begins without a search. There each mistake is
//! undone in the readings, and everything is fitted again.

use crate::Error;
use crate::estimate::degrees::{Again, closing};
use crate::estimate::enough::enough;
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::rewired::{DECISIVE, Rewired, pairs};
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::model::{Instance, Model};
use crate::terms::term::Role;

/// A mistake at the wires.
#[derive(Clone, Copy)]
enum Mistake {
    Exchanged([usize; 2]),
    Reversed(usize),
}

impl Mistake {
    /// Exchanges where no search for a start tries them, and what no gain can reverse.
    fn every(observations: &Observations, model: &Model) -> Vec<Self> {
        let searched = model.unknowns.is_empty() && model.pose_unknowns() == 0;
        let channels = observations.readings.channels;
        let exchanged = pairs(channels).filter(|_| !searched).map(Self::Exchanged);
        let fixed = |c: &usize| !searched || model.column(Role::Gain, *c).is_none();
        exchanged.chain((0..channels).filter(fixed).map(Self::Reversed)).collect()
    }

    /// The observations without it.
    fn undone(self, observations: &Observations) -> Option<Rewired> {
        let readings = &*observations.readings;
        match self {
            Self::Exchanged(channels) => Rewired::exchanged(observations, readings, channels),
            Self::Reversed(channel) => Rewired::mirrored(observations, readings, channel),
        }
    }

    fn suspicion(self, closes: Closes) -> Suspicion {
        match self {
            Self::Exchanged(channels) => Suspicion::Exchanged { channels, closes },
            Self::Reversed(channel) => Suspicion::Reversed { channels: vec![channel], closes },
        }
    }
}

/// The only mistake with which the loop closes, and by far not as it is declared: `left` is χ² per degree
/// of freedom by a `noise`, and `refit` a fit of other observations by these terms.
///
/// All are tried on a few poses, without what the way to a pose does; the likeliest is then held against the next
/// on all.
pub(crate) fn miswired(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations, Vec<Instance>) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let likeliest = |of: &Observations, terms: &[Instance], mistakes: Vec<Mistake>| {
        let again = |mistake: Mistake| {
            let Rewired { readings, observations: of } = mistake.undone(of)?;
            let refit = |of: &Observations| refit(of, terms.to_vec());
            let again = Again::of(&of, (&of.mechanism, readings.table), noise, &refit)?;
            Some((again.left, mistake))
        };
        let mut found: Vec<_> = mistakes.into_iter().filter_map(again).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    };
    let mut mistakes = Mistake::every(observations, model);
    if let Some((few, terms)) = enough(observations, model) {
        let rough = likeliest(&few, &terms, mistakes);
        mistakes = rough.into_iter().take(2).map(|(_, mistake)| mistake).collect();
    }
    let mut found = likeliest(observations, &model.instances, mistakes).into_iter();
    let (with, mistake) = found.next()?;
    let next = found.next().map_or(f64::INFINITY, |(next, _)| next);
    let closes = Closes { with, declared: left };
    (with < limit.min(next / DECISIVE)).then(|| mistake.suspicion(closes))
}

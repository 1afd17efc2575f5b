//! Mistakes that whole fits tell: units, and wires where no search for a start can tell.
//!
//! A search for a start reverses gains and exchanges columns. Where gains are not asked for it cannot
//! reverse them, and a mechanism with unknown places begins without a search. There each mistake is
//! undone in the readings, and everything is fitted again.

use crate::Error;
use crate::estimate::enough::enough;
use crate::estimate::miswired::again::{Again, DECISIVE, closing, likeliest};
use crate::estimate::miswired::mistake::Mistake;
use crate::estimate::miswired::rewired::{Rewired, stays};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::model::{Instance, Model};
use crate::numerics::order;
use crate::numerics::order::Ends;
use crate::terms::term::Role;

/// Exchanges where no search for a start tries them, and what no gain can reverse.
fn untried(observations: &Observations, model: &Model) -> Vec<Mistake> {
    let searched = model.unknowns.is_empty() && model.pose_unknowns() == 0;
    let tried = |mistake: &Mistake| match mistake {
        Mistake::Reversed(channel) => model.column(Role::Gain, *channel).is_some(),
        _ => true,
    };
    let every = Mistake::exchanges(observations).chain(Mistake::reversals(observations));
    every.filter(|mistake| !searched || !tried(mistake)).collect()
}

/// The mistake with which the loop closes, and by far not as it is declared or with another: `left` is χ² per degree
/// of freedom by a `noise`, and `refit` a fit of other observations by these terms. Of a machine that closes in a mirror,
/// too, two reversals close the loop alike, and it is one of them.
///
/// All are tried on a few poses, without what the way to a pose does; the likeliest are then held against the next
/// on all.
pub(crate) fn miswired(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations, Vec<Instance>) -> Result<Again, Error>,
) -> Vec<Suspicion> {
    let Some(limit) = closing(observations, left) else { return Vec::new() };
    let tried = |of: &Observations, terms: &[Instance], mistakes: Vec<Mistake>| {
        let again = |mistake: Mistake| {
            let Rewired { readings, observations: of } = mistake.undone(of, &of.readings)?;
            let refit = |of: &Observations| refit(of, terms.to_vec());
            let again = Again::of(&of, (&of.mechanism, readings.table), noise, &refit)?;
            Some((again.left, mistake))
        };
        mistakes.into_iter().filter_map(again).collect::<Vec<_>>()
    };
    let mut mistakes = untried(observations, model);
    if let Some((few, terms)) = enough(observations, model) {
        let mut rough = tried(&few, &terms, mistakes);
        order::ascending(&mut rough, |a| a.0);
        let and_the_next = likeliest(rough.clone()).len() + 1;
        mistakes = rough.into_iter().take(and_the_next).map(|(_, mistake)| mistake).collect();
    }
    let found = likeliest(tried(observations, &model.instances, mistakes));
    let with = found.first().map_or(f64::INFINITY, |it| it.0);
    if found.iter().any(|(left, _)| *left >= limit) {
        return Vec::new();
    }
    let mistakes: Vec<Mistake> = found.into_iter().map(|(_, mistake)| mistake).collect();
    Mistake::either(&mistakes, Closes { with, declared: left })
}

/// Readings or offsets in the other unit, where the loop closes with it and by far not as declared:
/// `left` is χ² per degree of freedom by a `noise`, and `refit` a fit of other observations. Readings in
/// another unit have a noise in that unit.
pub(crate) fn in_other_unit(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let again = |Rewired { readings, observations: of }: Rewired, noise: &Noise| {
        Again::of(&of, (&of.mechanism, readings.table), noise, &refit)
    };
    let closes = |mistake: Mistake| {
        let other = mistake.undone(observations, &observations.readings)?;
        let mut noise = noise.clone();
        if let Mistake::Readings { channels, times } = &mistake {
            channels.iter().for_each(|&c| noise.sigma[c] *= times);
        }
        let fit = again(other.clone(), &noise)?;
        let is_evidence = match &mistake {
            Mistake::Offsets { channels, .. } => {
                stays(&fit.model, channels, [&vec![0.0; fit.beta.len()], &fit.beta])
            }
            // What moves less, or is as noisy as that, may close by chance; where no fit of such readings
            // starts, they do not.
            _ => {
                fit.left < limit
                    && mistake.by_chance(&other).all(|(chance, counts)| {
                        let by_chance = again(chance, &noise);
                        by_chance.is_none_or(|it| fit.left * DECISIVE < counts * it.left)
                    })
            }
        };
        (fit.left < limit && is_evidence).then_some((fit.left, mistake))
    };
    let units = Mistake::units(observations).chain(Mistake::offsets(observations));
    let found = units.filter_map(closes).least_by(|a| a.0);
    found.map(|(with, mistake)| mistake.suspicion(Closes { with, declared: left }))
}

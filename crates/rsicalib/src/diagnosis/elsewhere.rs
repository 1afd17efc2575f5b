//! What effects that were found do to predictions where nothing was recorded.
//!
//! To name an effect and to use it are two questions. Placements or sessions are left out in two
//! halves; of a single placement, parts of the workspace are. The closures of what is left out, with
//! the places of what is touched in it alone, say how well a fit of the rest predicts. An effect is
//! used where that is better with it than without, beside the others. Without each half the search is
//! made again: where what it finds there makes the other half worse, only effects that both find are
//! used. Parts of the workspace of a single placement cannot tell that a free shape is there at
//! another, nor effects that may stand for another one, as errors of the arm for one of the surface that it
//! touches or of the instrument that sees it, or leave something over that more of the declared noise would not explain
//! as well, or without which the session is explained as well: these are named alone.
//!
//! What happened between two sessions, or in one alone, no half can tell: it is what it was found to be, beside
//! what is judged.

use crate::diagnosis::localisation::{Residual, may_be_louder};
use crate::diagnosis::options::{Rule, SearchOptions};
use crate::diagnosis::score::scored;
use crate::diagnosis::score::times::happened_once;
use crate::diagnosis::trace::{Found, Traced, trace};
use crate::diagnosis::verdict::WORSE;
use crate::estimate::progress::Progress;
use crate::estimate::{
    Fit, Implicit, Misfit, Noise, Observations, Part, fit, groups_along, numbered_groups,
    place_untouched,
};
use crate::model::{Instance, bound_to_session};
use crate::numerics::order;
use crate::numerics::workers;
use crate::readings::{along, ascending};
use crate::terms::term::{Acts, Placed};

/// Placements or sessions are left out half by half: each search has half of the readings, and both
/// take about as long as the one of all.
const HALVES: usize = 2;

/// Parts of the workspace of a single placement. Effects are refitted without each: what a search
/// would find again there says nothing of another placement.
const PARTS: usize = 4;

/// Blocks that are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Blocks {
    /// Halves of the placements or sessions.
    Groups,
    /// Parts of the workspace: readings that are like each other.
    Workspace,
}

/// Why an effect is named, and is no part of the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum NotApplied {
    /// What was left out in turn is predicted no better with it.
    NoHelp,
    /// A law that no term has is likelier in its place, or as likely and of this session alone.
    Law,
    /// A curve without a law, at one placement.
    Shape,
    /// Something is left over, at one placement.
    Leaves,
    /// It may stand for an error of what is touched, or of the instrument, at one placement.
    MayStand,
    /// The session is explained about as well without it, at one placement.
    AsWell,
    /// It repeats, and waves of another length explain one placement or session as well.
    Order,
    /// A reason of a later version.
    #[cfg_attr(feature = "serde", serde(other))]
    Other,
}

/// Errors of closures on blocks that were left out in turn, root mean square in `unit`.
///
/// Blocks are placements or sessions, or, of a single one, parts of the workspace.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Elsewhere {
    /// What was left out.
    pub kind: Blocks,
    /// How many blocks.
    pub blocks: usize,
    /// Without any of the effects that are judged.
    pub without: f64,
    /// With what a search finds again without the block; null for parts of the workspace.
    pub again: Option<f64>,
    /// With the effects that are applied.
    pub applied: f64,
    /// Without each of `steps`, the others refitted.
    pub without_each: Vec<f64>,
    /// Unit of all of them.
    pub unit: String,
    /// With all effects that were found; null in a result of an earlier version.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub found: Option<f64>,
}

/// Of each effect that is not applied why, and errors on blocks left out of a session that was traced; none where nothing
/// was found, or where nothing that is touched is unknown and there is one session. Where what is left of the blocks
/// determines no fit there are no errors, and nothing says more of an effect than one placement does.
#[must_use]
pub fn elsewhere(
    traced: &Traced,
    search: &SearchOptions,
    residual: &Residual,
) -> Option<(Option<Elsewhere>, Vec<Option<NotApplied>>)> {
    let Traced { observations, after, found, stretches, .. } = traced;
    // Where every pose has a place of its own, poses left out say it.
    let placed = !after.model.unknowns.is_empty() && after.model.pose_unknowns() == 0;
    let grouped = placed || observations.readings.sessions > 1;
    if found.is_empty() || !grouped || stretches.is_some() {
        return None;
    }
    let (kind, blocks) = blocks(observations, after);
    let left = Left { observations, noise: traced.before.assumed(), blocks };
    let effects: Vec<Instance> = found.iter().map(|f| traced.in_all(&f.instance)).collect();
    let given: Vec<bool> = effects.iter().map(|effect| !left.tells(effect)).collect();
    if given.iter().all(|given| *given) {
        return None;
    }
    let noise = matches!(residual, Residual::Noise { .. } | Residual::Unjudged { .. });
    let understood = noise || may_be_louder(traced);
    let alone = |one: &Found| at_one_placement(traced, one, understood);
    let judged = (Judged { traced, search, left, effects, given: &given, kind }).reasons(&alone);
    let reasons = found.iter().zip(&given).map(|(one, given)| match *given || search.apply_all {
        true => None,
        false => alone(one),
    });
    Some(match judged {
        Some((errors, reasons)) => (Some(errors), reasons),
        None => (None, reasons.collect()),
    })
}

/// Effects that are judged by blocks left out.
struct Judged<'a> {
    traced: &'a Traced,
    search: &'a SearchOptions,
    left: Left<'a>,
    effects: Vec<Instance>,
    /// Which of the effects no block can tell.
    given: &'a [bool],
    kind: Blocks,
}

impl Judged<'_> {
    /// Error on the blocks with some of the effects; none where that cannot be fitted without a block.
    fn with(&self, some: &[bool]) -> Option<f64> {
        let Traced { before, after, offsets, .. } = self.traced;
        let asked = before.model.instances.iter().filter(|i| !offsets.contains(i));
        let bad = after.model.instances.iter().filter(|i| scored::is_data(i));
        let chosen = self.effects.iter().zip(some).filter(|(_, some)| **some).map(|(i, _)| i);
        let instances: Vec<Instance> = asked.chain(bad).chain(chosen).copied().collect();
        let one = |training: &Observations| fit(training, instances.clone(), Some(after)).ok();
        Some(self.left.error(one)?.0)
    }

    /// The same without one of some effects, and the others.
    fn without_one(&self, some: &[bool], k: usize) -> Option<(f64, Vec<bool>)> {
        let mut fewer = some.to_vec();
        fewer[k] = false;
        Some((self.with(&fewer)?, fewer))
    }

    /// Errors on the blocks, and why each effect is not applied; `alone` is why not by one placement.
    fn reasons(
        self,
        alone: &dyn Fn(&Found) -> Option<NotApplied>,
    ) -> Option<(Elsewhere, Vec<Option<NotApplied>>)> {
        let Self { traced, search, ref left, ref effects, given, kind } = self;
        let without = self.with(given)?;
        let again = match kind {
            Blocks::Groups => {
                Some(left.error(|training| searched(training, search, effects.len()))?)
            }
            Blocks::Workspace => None,
        };
        let not = |effect: &Instance, one: &Found| match &again {
            Some((again, found)) => {
                let finds = |fit: &Fit| fit.model.instances.contains(effect);
                (*again > WORSE * without && !found.iter().all(finds)).then_some(NotApplied::NoHelp)
            }
            None => alone(one),
        };
        let reasons = effects.iter().zip(&traced.found).zip(given);
        let mut reasons: Vec<Option<NotApplied>> = reasons
            .map(|((effect, one), given)| if *given { None } else { not(effect, one) })
            .collect();
        let all = vec![true; effects.len()];
        let each: Option<Vec<f64>> =
            (0..effects.len()).map(|k| Some(self.without_one(&all, k)?.0)).collect();
        let (each, found) = (each?, self.with(&all)?);
        if search.apply_all {
            reasons.fill(None);
        }
        let applied = self.helping(&mut reasons, &each, without)?;
        let observations = left.observations;
        let (blocks, unit) = (left.blocks.len(), observations.mechanism.length_unit.clone());
        let (again, without_each, found) = (again.map(|(again, _)| again), each, Some(found));
        Some((
            Elsewhere { kind, blocks, without, again, applied, found, without_each, unit },
            reasons,
        ))
    }

    /// Leaves out effects that do not help, the one without which most is gained first; the error with the others.
    fn helping(
        &self,
        reasons: &mut [Option<NotApplied>],
        each: &[f64],
        without: f64,
    ) -> Option<f64> {
        let Self { search, given, .. } = self;
        let mut applies: Vec<bool> = reasons.iter().map(Option::is_none).collect();
        let mut applied = self.with(&applies)?;
        let mut order: Vec<usize> =
            (0..applies.len()).filter(|k| applies[*k] && !given[*k]).collect();
        order::ascending(&mut order, |a| each[*a]);
        for k in order.into_iter().filter(|_| !search.apply_all) {
            let (error, fewer) = self.without_one(&applies, k)?;
            if error <= applied {
                (applied, applies, reasons[k]) = (error, fewer, Some(NotApplied::NoHelp));
            }
        }
        if applied >= without && !search.apply_all {
            applied = without;
            for (reason, _) in reasons.iter_mut().zip(*given).filter(|(_, given)| !**given) {
                reason.get_or_insert(NotApplied::NoHelp);
            }
        }
        Some(applied)
    }
}

/// Why nothing says that an effect which was seen at one placement alone is there at another.
fn at_one_placement(traced: &Traced, one: &Found, understood: bool) -> Option<NotApplied> {
    if !understood {
        return Some(NotApplied::Leaves);
    }
    if traced.found.iter().any(in_tie_with_surface) {
        return Some(NotApplied::MayStand);
    }
    if one.instance.term.info().penalised {
        return Some(NotApplied::Shape);
    }
    if traced.order_is_open(one) {
        return Some(NotApplied::Order);
    }
    if traced.undone(one) {
        return Some(NotApplied::Law);
    }
    traced.as_well_without(one).then_some(NotApplied::AsWell)
}

/// True for an error of the arm where one of the surface that it touches, or of the instrument that sees it, fits as
/// well.
fn in_tie_with_surface(found: &Found) -> bool {
    let of_surface = |i: &Instance| matches!(i.term.acts(), Acts::Surface(_) | Acts::Instrument(_));
    !of_surface(&found.instance) && found.also.iter().any(of_surface)
}

/// What a search finds without a block, where the session has so many effects: readings that are
/// wrong have been judged, and of more effects than one beside them nothing is asked.
fn searched(training: &Observations, search: &SearchOptions, effects: usize) -> Option<Fit> {
    let mut again = search.clone();
    again.most = again.most.min(effects + 1);
    again.off.push(Rule::JudgeAgain);
    let found = trace(&Observations { judged: false, ..training.clone() }, &again).ok()?.after;
    // As the fits that it is compared with: no size of the drawing's errors is estimated.
    Some(Fit { beta: found.likeliest.clone().unwrap_or(found.beta), likeliest: None, ..found })
}

/// A session that is fitted without each of some blocks.
struct Left<'a> {
    observations: &'a Observations,
    noise: Noise,
    /// Rows of each block.
    blocks: Vec<Vec<usize>>,
}

impl Left<'_> {
    /// True where each block leaves readings in which an effect acts; of what happened once, others too.
    fn tells(&self, effect: &Instance) -> bool {
        let Observations { readings, weights, .. } = self.observations;
        let session = |pose: usize| readings.session_of_pose.get(pose);
        let acts = |pose: usize| match effect.term.placed() {
            _ if bound_to_session(effect.term) => session(pose).is_none_or(|s| *s == effect.place),
            Placed::AtPose => pose >= effect.place,
            _ => true,
        };
        self.blocks.iter().all(|block| {
            let mut kept: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
            block.iter().for_each(|row| kept[*row] = false);
            let poses = readings.pose.iter().zip(&kept).filter(|(_, kept)| **kept);
            let acting: Vec<bool> = poses.map(|(pose, _)| acts(*pose)).collect();
            acting.contains(&true) && (!happened_once(effect) || acting.contains(&false))
        })
    }

    /// Error of the closures of the blocks, by what `chosen` gives without each; and that.
    fn error(
        &self,
        chosen: impl Fn(&Observations) -> Option<Fit> + Sync,
    ) -> Option<(f64, Vec<Fit>)> {
        let Observations { readings, weights, .. } = self.observations;
        let without = |block: &Vec<usize>| {
            let mut training = self.observations.clone();
            block.iter().for_each(|row| training.weights[*row] = 0.0);
            training.options.progress = Progress::default();
            training.judged = true;
            let mut trained = chosen(&training)?;
            place_untouched(self.observations, &mut trained, &training.weights, &self.noise);
            let part = Part { model: &trained.model, readings, weights: Some(weights) };
            let problem = Implicit::of(part, self.noise.clone());
            let mut own = vec![false; readings.samples];
            block.iter().for_each(|row| own[*row] = weights[*row] > 0.0);
            Some((problem.misfit(&trained.beta, |row| own[row]), trained))
        };
        let left: Option<Vec<_>> = workers::map(&self.blocks, without).into_iter().collect();
        let (parts, trained): (Vec<Misfit>, Vec<Fit>) = left?.into_iter().unzip();
        let sum = |of: fn(&Misfit) -> f64| parts.iter().map(of).sum::<f64>();
        let error = (sum(|part| part.square) / sum(|part| part.misclosures)).sqrt();
        error.is_finite().then_some((error, trained))
    }
}

/// Rows of the blocks, which do not depend on the order of placements, sessions or poses.
fn blocks(observations: &Observations, fitted: &Fit) -> (Blocks, Vec<Vec<usize>>) {
    let rows = 0..observations.readings.samples;
    let (kind, of_row, count) = match numbered_groups(observations, &fitted.model) {
        Some((_, of_row, _)) => {
            let order = groups_along(observations, &of_row);
            let mut half = vec![0; order.len()];
            order.iter().enumerate().for_each(|(place, group)| half[*group] = place % HALVES);
            let of_row = of_row.into_iter().map(|group| half[group]).collect();
            (Blocks::Groups, of_row, HALVES)
        }
        None => (Blocks::Workspace, along_readings(observations), PARTS),
    };
    let block = |k: usize| rows.clone().filter(|row| of_row[*row] == k).collect();
    (kind, (0..count).map(block).collect())
}

/// Block of each row along the direction in which readings vary most; rows of a pose stay together.
fn along_readings(observations: &Observations) -> Vec<usize> {
    let readings = &observations.readings;
    let n = readings.channels;
    let firsts: Vec<usize> = readings.rows_of_poses().iter().map(|rows| rows[0]).collect();
    let places = along(firsts.iter().map(|row| &readings.table.values[row * n..(row + 1) * n]));
    let order = ascending(&places);
    let mut block = vec![0; places.len()];
    for (place, pose) in order.iter().enumerate() {
        block[*pose] = place * PARTS / places.len();
    }
    readings.pose.iter().map(|pose| block[*pose]).collect()
}

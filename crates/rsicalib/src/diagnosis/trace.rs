//! Closes the loop: from the residual to the effect that the model lacks.
//!
//! ```text
//! fit → screening → means → search → fit of all samples → a law that no term has
//! ```
//!
//! Samples of a held pose are averaged for the search, whose noise is then known, and
//! so are neighbouring rows of a long recording; the answer is fitted to all of them.

use std::borrow::Cow;
use std::sync::Arc;

use crate::Error;
use crate::diagnosis::as_drawn::{likelier, without_offsets};
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::delays::{Delays, beyond, delays, least_that_does_not_pay};
use crate::diagnosis::isolation::Isolated;
use crate::diagnosis::long::{Search, rise, search_long};
use crate::diagnosis::plausibility::absurdities;
use crate::diagnosis::presumed::{is_noise, leaves_more};
use crate::diagnosis::score::places;
use crate::diagnosis::score::scored::{self, Judge, Scored};
use crate::diagnosis::score::times::{happened_once, retimed};
use crate::diagnosis::search::answers::search_effects;
use crate::diagnosis::search::orders;
use crate::diagnosis::search::outcome::{FoundEffect, Searched};
use crate::diagnosis::sent::{as_sent, closing_as_sent};
use crate::diagnosis::stretches::Stretches;
use crate::diagnosis::unknown_law::UnknownLaw;
use crate::diagnosis::verdict::Determined;
use crate::estimate::at_fit::AtFit;
use crate::estimate::directions::directions;
use crate::estimate::miswired::DECISIVE;
use crate::estimate::progress::Stage;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::{Fit, Observations, fit, with_conventions, with_groups};
use crate::mechanism::Target;
use crate::model::{Instance, Model};
use crate::numerics::credible_set::AS_WELL;
use crate::screening::converter;
use crate::screening::excluded::Excluded;
use crate::screening::sound::{Kept, sound};
use crate::terms::term::Placed;

use crate::diagnosis::options::Rule;
pub use crate::diagnosis::options::{LEVEL, SearchOptions};
pub use crate::diagnosis::search::rivals::Explanation;

/// One effect that was found.
#[derive(Debug, Clone)]
pub struct Found {
    /// The effect.
    pub instance: Instance,
    /// Probability of such a rise by chance, corrected for the places looked at.
    pub p_value: f64,
    /// By how much χ² would rise without it, all else that was found kept.
    pub rise: f64,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// The search's fit without it.
    pub without: Fit,
    /// Scores of everything without it, of each at its best place, best first.
    pub scores: Vec<Scored>,
    /// Laws of the same target that fit as well: the model with each, and its parameters.
    pub laws: Vec<(Instance, Arc<Model>, Vec<f64>)>,
}

impl Found {
    /// `judge` is that of the fit with all that was found: a score when it was found is judged beside what was
    /// still to be found, as one of two effects that only both explain is beside all that the other does.
    fn of(rise: f64, step: FoundEffect, judge: &Judge) -> Self {
        let FoundEffect { scored, also, without, scores, laws, .. } = step;
        let Scored { instance, width, places, .. } = scored;
        let of_rise = judge.without(rise, width).p_value(rise.max(0.0), width);
        let p_value = (of_rise * places).min(1.0);
        Self { instance, p_value, rise, also, without, scores, laws }
    }
}

/// What the search found.
#[derive(Debug, Clone)]
pub struct Traced {
    /// The fit of all samples, as asked for.
    pub before: Fit,
    /// The fit of all samples with what was found.
    pub after: Fit,
    /// The session, bad samples left out.
    pub observations: Observations,
    /// The search's own session: one sample for each held pose, or stretch of a long recording.
    pub small: Observations,
    /// The stretches, where it was searched by those: places in what the search found are numbers
    /// of stretches then.
    pub stretches: Option<Stretches>,
    /// The last fit of the search.
    pub last: Fit,
    /// Effects, in the order in which they were found.
    pub found: Vec<Found>,
    /// Readings that are wrong.
    pub excluded: Vec<Excluded>,
    /// The best that is left, whether or not it is above chance.
    pub left: Option<Scored>,
    /// Scores of everything that is left, of each at its best place, best first.
    pub scores: Vec<Scored>,
    /// Explanations that are nearly as good as the best, itself included; the best first.
    pub rivals: Vec<Explanation>,
    /// What is at fault isolated, where the catalogue does not explain it all.
    pub isolated: Option<Isolated>,
    /// A law that no term has, where it is about as likely as what was found, or something is left.
    pub unknown: Option<UnknownLaw>,
    /// Rows that what is late puts at an instant that was not recorded: they are left out.
    pub unread: Vec<usize>,
    /// Offsets that were asked for and stay as drawn: an error of a surface explains as much.
    pub offsets: Vec<Instance>,
    /// How scores were judged.
    pub judge: Judge,
    /// Probability of the residual by chance; none where only the fit gives the noise.
    pub p_value: Option<f64>,
    /// True where the loop closes with a mistake undone, and by far not as declared: no effect was looked for.
    pub mistaken: bool,
}

impl Traced {
    /// An instance of the search as one of the session.
    #[must_use]
    pub fn in_all(&self, instance: &Instance) -> Instance {
        Stretches::in_session(self.stretches.as_ref(), instance)
    }

    /// True for an effect that is named and not applied, since a law that no term has stands in its place.
    #[must_use]
    pub fn undone(&self, effect: &Found) -> bool {
        self.unknown.as_ref().is_some_and(|law| law.undoes(&effect.instance))
    }

    /// True for an error that repeats, and could as well with waves of another length.
    #[must_use]
    pub fn order_is_open(&self, effect: &Found) -> bool {
        orders::is_open(&self.small, &effect.without, &self.judge, &effect.instance)
    }

    /// True where an explanation by some of what was found, and without this effect, is about as likely.
    #[must_use]
    pub fn as_well_without(&self, effect: &Found) -> bool {
        let likely = self.rivals.first().map_or(0.0, |best| best.chi2) + AS_WELL;
        let others = |i: &Instance| {
            *i != effect.instance && self.found.iter().any(|found| found.instance == *i)
        };
        let fewer = |it: &Explanation| it.noise.is_none() && it.effects.iter().all(others);
        self.rivals.iter().any(|it| it.chi2 <= likely && fewer(it))
    }

    /// True where something is to be explained: effects were found, more than noise is left, or a law that
    /// no term has is likelier than chance.
    #[must_use]
    pub fn lacks_something(&self) -> bool {
        let left_over = self.p_value.is_some_and(|p| p <= LEVEL);
        left_over || !self.found.is_empty() || self.unknown.is_some()
    }

    /// The fit of what was asked for, without the readings that are wrong.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn asked(&self) -> Result<Cow<'_, Fit>, Error> {
        if self.excluded.is_empty() {
            return Ok(Cow::Borrowed(&self.before));
        }
        let asked = self.before.model.instances.clone();
        fit(&self.observations, asked, Some(&self.before)).map(Cow::Owned)
    }

    /// The session and the fit to judge and to draw by: where the search was by stretches, those of
    /// all rows.
    #[must_use]
    pub fn answer(&self) -> (&Observations, &Fit) {
        match self.stretches {
            Some(_) => (&self.observations, &self.after),
            None => (&self.small, &self.last),
        }
    }
}

/// Traces the residual of a session.
///
/// # Errors
///
/// As [`SearchOptions::check`] and [`fit`].
pub fn trace(observations: &Observations, search: &SearchOptions) -> Result<Traced, Error> {
    search.check()?;
    let coded = |_| fit(observations, observations.instances()?, None);
    let coded = as_sent(observations).map(coded).transpose()?;
    let sent = coded.and_then(|coded| closing_as_sent(observations, &coded));
    let observations = sent.as_ref().unwrap_or(observations);
    if let Some(sent) = as_sent(observations).filter(Observations::declares_noise) {
        let traced = looked_for(&sent, search)?;
        if traced.excluded.is_empty() && traced.p_value.is_some_and(|p| p > LEVEL) {
            return Ok(traced);
        }
    }
    let traced = looked_for(observations, search)?;
    if !is_undeclared_noise(&traced) {
        return Ok(traced);
    }
    looked_for(&Observations { by_fit: true, ..observations.clone() }, search)
}

/// True where nothing was found but what happened once, more is left than the noise allows that was presumed of
/// readings, and neither a law nor anything that is at fault alone explains it better than more of this noise does.
fn is_undeclared_noise(traced: &Traced) -> bool {
    let alone = traced.isolated.as_ref().is_some_and(|it| !matches!(it.target, Target::Channel(_)));
    let law = traced.unknown.as_ref().map_or(0.0, |law| -law.behind);
    let once = |found: &Found| found.instance.term.placed() == Placed::AtPose;
    let nothing = traced.found.iter().all(once) && !alone;
    nothing && leaves_more(&traced.after) && is_noise(&traced.small, &traced.last, law)
}

/// What a search finds, with the noise as it is known.
fn looked_for(observations: &Observations, search: &SearchOptions) -> Result<Traced, Error> {
    let (traced, lost) = explain(observations, search, Scope::All)?;
    let mut more = if lost { Vec::new() } else { beyond(observations, &traced.after) };
    if more.is_empty() {
        return within_reason(traced, lost, observations, search);
    }
    let (mut rest, mut unread) = (observations.clone(), Vec::new());
    for _ in 0..LATER {
        more.iter().for_each(|row| rest.weights[*row] = 0.0);
        unread.append(&mut more);
        // With what is left of short recordings nothing may be determined.
        let Ok((again, false)) = explain(&rest, search, Scope::All) else { break };
        more = beyond(&rest, &again.after);
        if more.is_empty() {
            // Where nothing is late without these rows, they stay.
            let late = !beyond(observations, &again.after).is_empty();
            return match late {
                true => within_reason(Traced { unread, ..again }, false, &rest, search),
                false => within_reason(traced, lost, observations, search),
            };
        }
    }
    within_reason(traced, lost, observations, search)
}

/// Times that a recording is searched again without rows that what is late puts beyond its ends. Each takes as
/// long as the first; a delay that is found again leaves out no more.
const LATER: usize = 3;

/// What was found, or what is left to be said of readings that are not of this mechanism.
fn within_reason(
    traced: Traced,
    lost: bool,
    observations: &Observations,
    search: &SearchOptions,
) -> Result<Traced, Error> {
    // Readings that are not of this mechanism: what seems to explain them means nothing.
    let effects: Vec<Instance> = traced.found.iter().map(|found| found.instance).collect();
    let absurd =
        |found: &[Instance]| !absurdities(&traced.observations, &traced.after, found).is_empty();
    let wanted = match lost {
        true if traced.found.is_empty() && traced.excluded.is_empty() => return Ok(traced),
        true if absurd(&effects) => Scope::Nothing,
        false if !effects.is_empty() && absurd(&[]) => Scope::Screened,
        _ => return Ok(traced),
    };
    let unread = if matches!(wanted, Scope::Nothing) { Vec::new() } else { traced.unread };
    Ok(Traced { unread, ..explain(observations, search, wanted)?.0 })
}

/// What is wanted of a session beside its fit.
#[derive(Clone, Copy, PartialEq)]
enum Scope {
    /// What is wrong with it, and effects.
    All,
    /// What is wrong whatever the model lacks.
    Screened,
    /// Nothing: of readings that are not of this mechanism none is worse than the others.
    Nothing,
}

/// True where the readings are not of this mechanism as it is declared, and are with a mistake of the wiring
/// or of a unit undone: that is said, and the search, which would take its longest, has nothing to add. Exchanged
/// followers give no absurd values, nor does a reversed sign everywhere, but every effect that is found with them is
/// false. A sign that the fit reversed with its gain is no mistake of the fit.
fn is_miswired(observations: &Observations, fit: &Fit) -> bool {
    let undone = |it: &Suspicion| it.of_wiring() && !it.is_no_start();
    let follower = |channel: &usize| observations.mechanism.leader_of(*channel).is_some();
    let exchanged_followers = |it: &Suspicion| match it {
        Suspicion::Exchanged { channels, .. } => channels.iter().flatten().all(follower),
        _ => false,
    };
    let left = fit.chi2 / fit.dof;
    let rewired = |it: &Suspicion| it.rewired().is_some_and(|it| left >= DECISIVE * it.with);
    let told = fit.warnings.iter().any(undone);
    told && (fit.warnings.iter().any(|it| exchanged_followers(it) || rewired(it))
        || !absurdities(observations, fit, &[]).is_empty())
}

/// A session as it was searched, and where the search ended.
pub(super) struct Pursued<'a> {
    pub observations: Observations,
    /// Its fit without what was found.
    pub clean: Fit,
    pub excluded: Vec<Excluded>,
    /// What was asked for, and delays.
    base: Vec<Instance>,
    late: Vec<FoundEffect>,
    pub searched: Search<'a>,
    /// True where the fit was absurd before the search began.
    pub lost: bool,
}

/// The same, or the search of the session with offsets as drawn where that is likelier; and those offsets.
fn or_as_drawn<'a>(
    pursued: Pursued<'a>,
    search: &'a SearchOptions,
) -> Result<(Pursued<'a>, Vec<Instance>), Error> {
    let Pursued { observations, clean, base, searched, .. } = &pursued;
    let told = &searched.searched.found;
    let lacking = clean.p_value.is_some_and(|p| p <= LEVEL);
    let kept = lacking.then(|| without_offsets(&observations.mechanism, base, told)).flatten();
    let Some(kept) = kept.filter(|_| searched.averaged.stretches.is_none()) else {
        return Ok((pursued, Vec::new()));
    };
    let mut as_drawn = observations.clone();
    as_drawn.leave_offsets_as_drawn(&kept);
    let plain = fit(&as_drawn, kept.clone(), None)?;
    let other = search_once(&as_drawn, &plain, &kept, search, true)?;
    let offsets: Vec<Instance> = base.iter().copied().filter(|i| !kept.contains(i)).collect();
    let (searched, chosen) = likelier(pursued.searched, other, &offsets)?;
    Ok(match chosen {
        true => (Pursued { searched, clean: plain, observations: as_drawn, ..pursued }, offsets),
        false => (Pursued { searched, ..pursued }, Vec::new()),
    })
}

/// Screens a session, and searches what is left of it.
fn pursue<'a>(
    all: &Observations,
    before: &Fit,
    search: &'a SearchOptions,
    wanted: Scope,
    kept: Kept,
) -> Result<Pursued<'a>, Error> {
    let mut base = before.model.instances.clone();
    let progress = &all.options.progress;
    progress.enter(Stage::Screening);
    let mut observations = all.clone();
    let (mut clean, mut excluded) = match wanted {
        Scope::Nothing => (before.clone(), Vec::new()),
        Scope::Screened => sound(&mut observations, before, Kept::Nothing)?,
        Scope::All => sound(&mut observations, before, kept)?,
    };
    let wanted = wanted == Scope::All;
    let mut lost = !absurdities(&observations, &clean, &[]).is_empty();
    progress.enter(Stage::Search);
    let mut late = Vec::new();
    if wanted {
        let one = |from: &Fit, base: &[Instance], options: &SearchOptions| {
            Ok(search_once(&observations, from, base, options, true)?.searched)
        };
        if let Some(Delays { found, fit }) = delays(&observations, &clean, &base, search, one)? {
            base.extend(found.iter().map(|step| step.scored.instance));
            (late, clean) = (found, fit);
        }
    }
    let mut searched = search_once(&observations, &clean, &base, search, wanted)?;
    let mut once = wanted;
    for _ in 0..if wanted && search.uses(Rule::JudgeAgain) { JUDGED_AGAIN } else { 0 } {
        once = once && searched.keeps_all();
        let Some(again) = judge_again(all, &observations, &base, &searched, once)? else { break };
        (observations, clean, excluded) = again;
        lost = !absurdities(&observations, &clean, &[]).is_empty();
        searched = search_once(&observations, &clean, &base, search, wanted)?;
    }
    // A delay that stood for what was found since is nothing beside that.
    while let Some(k) = least_that_does_not_pay(&late, searched.answer()) {
        let gone = late.remove(k).scored.instance;
        base.retain(|instance| *instance != gone);
        clean = fit(&observations, base.clone(), Some(&clean))?;
        searched = search_once(&observations, &clean, &base, search, wanted)?;
    }
    Ok(Pursued { observations, clean, excluded, base, late, searched, lost })
}

/// The search and what comes of it; and whether its fit was absurd before it began.
fn explain(
    all: &Observations,
    search: &SearchOptions,
    wanted: Scope,
) -> Result<(Traced, bool), Error> {
    let before = fit(all, all.instances()?, None)?;
    let mistaken = is_miswired(all, &before);
    let wanted = if mistaken { Scope::Nothing } else { wanted };
    let screened = pursue(all, &before, search, wanted, Kept::Once)?;
    let weighed =
        wanted == Scope::All && search.uses(Rule::KeptIn) && screened.leaves_samples_out();
    let pursued = match weighed {
        true => screened.or_whole(pursue(all, &before, search, wanted, Kept::All)?),
        false => screened,
    };
    let (pursued, offsets) = match wanted == Scope::All && search.uses(Rule::AsDrawn) {
        true => or_as_drawn(pursued, search)?,
        false => (pursued, Vec::new()),
    };
    let Pursued { mut observations, clean, mut excluded, late, searched, lost, .. } = pursued;
    all.options.progress.enter(Stage::Refit);
    let Search { averaged, searched: pursued, isolated, all: of_all } = searched;
    let Searched { current, found, poses, left, scores, mut rivals } = pursued;
    excluded.extend(poses.iter().map(|step| averaged.excluded(step)));
    let said: Vec<Scored> = found.iter().map(|step| step.scored).chain(poses).collect();
    let of_data = |step: &FoundEffect| scored::is_data(&step.scored.instance);
    let (bad, steps): (Vec<_>, Vec<_>) = found.into_iter().partition(of_data);
    let bad = bad.into_iter().map(|step| averaged.bad_reading(&step.scored.instance, step.blame));
    excluded.extend(bad);
    leave_poses_out(&mut observations, &excluded);
    let nothing = current.model.instances.len() == clean.model.instances.len();
    let after = match of_all {
        Some(of_all) => converter::seen_by(&before, of_all),
        None if nothing && excluded.is_empty() => clean.clone(),
        None => {
            let from = current.with_noise_of(&clean);
            let instances = with_data(&observations, &current.model.instances);
            converter::seen_by(&before, fit(&observations, instances, Some(&from))?)
        }
    };
    let judge = averaged.judge(&current);
    let left_over = after.p_value.is_some_and(|p| p <= LEVEL);
    let something = left_over || !steps.is_empty();
    // In a motion the noise of neighbours is alike, which a smooth law would explain.
    let poses = !observations.readings.moves();
    let unknown = match !mistaken && (!lost || !steps.is_empty()) && (something || poses) {
        true => averaged.unknown_law(&current, &said, left_over)?,
        false => None,
    };
    let Averaged { small, stretches, .. } = averaged;
    let of_all = |step: &FoundEffect| match &stretches {
        Some(stretches) => rise(&after, &stretches.in_all(&step.scored.instance)),
        None => step.without.cost() - current.cost(),
    };
    let delayed = |step: FoundEffect| Found::of(rise(&after, &step.scored.instance), step, &judge);
    let mut found: Vec<Found> = late.into_iter().map(delayed).collect();
    let delayed: Vec<Instance> = found.iter().map(|delay| delay.instance).collect();
    rivals.iter_mut().for_each(|rival| rival.effects.splice(0..0, delayed.clone()).for_each(drop));
    found.extend(steps.into_iter().map(|step| Found::of(of_all(&step), step, &judge)));
    let p_value = after.p_value;
    let after = with_groups(after, &observations);
    let traced = Traced {
        before: with_groups(before, all),
        after,
        observations,
        stretches,
        last: with_conventions(&small, current),
        small,
        found,
        excluded,
        left,
        scores,
        rivals,
        isolated,
        unknown,
        unread: Vec::new(),
        offsets,
        judge,
        p_value,
        mistaken,
    };
    Ok((traced, lost))
}

/// Takes all samples of poses that are left out as a whole from a session.
fn leave_poses_out(observations: &mut Observations, excluded: &[Excluded]) {
    for out in excluded.iter().filter(|e| e.row.is_none() && e.channel.is_none()) {
        let pose = observations.readings.pose.iter();
        let rows = observations.weights.iter_mut().zip(pose).filter(|(_, p)| Some(**p) == out.pose);
        rows.for_each(|(weight, _)| *weight = 0.0);
    }
}

/// The instances that have data left: a reading whose pose is left out keeps no parameter.
fn with_data(observations: &Observations, instances: &[Instance]) -> Vec<Instance> {
    let Observations { readings, weights, .. } = observations;
    let mut left = vec![false; readings.poses()];
    let counted = readings.pose.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
    counted.for_each(|(pose, _)| left[*pose] = true);
    let counts = |pose: usize| left[pose];
    let kept = instances.iter().filter(|i| !scored::is_data(i) || counts(i.place));
    kept.copied().collect()
}

/// True where some reading scores as bad, were the model right.
///
/// # Errors
///
/// As [`fit`].
pub fn looks_bad(observations: &Observations, full: &Fit) -> Result<bool, Error> {
    let search = SearchOptions::default();
    let mut averaged = Averaged::new(observations, full, &search)?;
    let mut small = fit(&averaged.small, full.model.instances.clone(), Some(full))?;
    averaged.rescale(&mut small)?;
    let at = AtFit::new(&averaged.small, &small);
    let scored = places::bad_readings(&at, &averaged.judge(&small))?;
    Ok(scored.iter().any(|s| s.charged() > 0.0))
}

/// Times that data are judged again beside what was found, at the most: what is left out and
/// what is found may take turns.
const JUDGED_AGAIN: usize = 3;

/// Searches a session from a fit of what was asked for.
fn search_once<'a>(
    observations: &Observations,
    clean: &Fit,
    base: &[Instance],
    search: &'a SearchOptions,
    wanted: bool,
) -> Result<Search<'a>, Error> {
    // On a base that data do not determine, nothing that is found would mean anything.
    let sure = wanted && Determined::of(clean, &directions(observations, clean)) == Determined::Yes;
    let one = |averaged: &mut Averaged<'a>| {
        let mut start = fit(&averaged.small, base.to_vec(), Some(clean))?;
        averaged.rescale(&mut start)?;
        averaged.data.dof = start.dof;
        match sure {
            true => search_effects(averaged, &start),
            false => Ok((Searched::nothing(start), None)),
        }
    };
    if let Some(long) = search_long(observations, clean, search, one)? {
        return Ok(long);
    }
    let mut averaged = Averaged::new(observations, clean, search)?;
    let (searched, isolated) = one(&mut averaged)?;
    Ok(Search { averaged, searched, isolated, all: None })
}

/// Where unknown points are touched: the session as it is judged beside the effects that were
/// found, all weights restored, with its fit and what is left out; none where nothing changes.
///
/// Before an effect is known it makes good samples look bad, and bad ones good. `once` is as in [`sound`].
fn judge_again(
    all: &Observations,
    judged: &Observations,
    base: &[Instance],
    Search { averaged, searched, .. }: &Search,
    once: bool,
) -> Result<Option<(Observations, Fit, Vec<Excluded>)>, Error> {
    let found = searched.found.iter().map(|step| averaged.in_all(&step.scored.instance));
    let effects: Vec<Instance> = found.filter(|i| !scored::is_data(i)).collect();
    if searched.current.model.unknowns.is_empty() {
        return Ok(None);
    }
    let mut again = all.clone();
    let instances = base.iter().copied().chain(effects).collect();
    let beside = in_all_samples(&again, fit(&again, instances, Some(&searched.current))?)?;
    let kept = if once { Kept::Once } else { Kept::Nothing };
    let (_, excluded) = sound(&mut again, &beside, kept)?;
    if again.weights == judged.weights {
        return Ok(None);
    }
    let clean = fit(&again, base.to_vec(), Some(&beside))?;
    Ok(Some((again, clean, excluded)))
}

/// The fit with what happened once at its likeliest time in all samples: where samples beside it were
/// left out, the search could not tell when it was.
fn in_all_samples(observations: &Observations, mut fitted: Fit) -> Result<Fit, Error> {
    for instance in fitted.model.instances.clone().into_iter().filter(happened_once) {
        let from = fitted.clone();
        (_, fitted) = retimed(observations, &from, fitted, instance)?;
    }
    Ok(fitted)
}

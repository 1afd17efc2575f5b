//! Closes the loop: from the residual to the effect that the model lacks.
//!
//! ```text
//! fit → score every candidate → refit the best → keep it → again
//! ```
//!
//! until nothing scores; after each addition a look back, at what is no longer
//! needed, and in the end at what another effect, or two others, explain better.
//! Samples of a held pose are averaged for the search, whose noise is then known;
//! the answer is fitted to all of them.

use crate::alone::{Alone, alone};
use crate::excluded::Excluded;
use crate::fit::{Fit, fit};
use crate::hunt::{FEW, Hunt, whole_pose};
use crate::leftover::doubt;
use crate::model::{Instance, Target};
use crate::rivals::{AS_WELL, Blame};
use crate::scan::{self, Family, Judge, Scored};
use crate::session::Session;
use crate::{Error, bad, damage, faults};

pub use crate::hunt::{LEFT, Search, cost};

/// One effect that was found.
#[derive(Debug, Clone)]
pub struct Found {
    /// The effect.
    pub instance: Instance,
    /// Probability of its score by chance, corrected for the places looked at.
    pub p_value: f64,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// The search's fit without it.
    pub without: Fit,
}

/// What the search found.
#[derive(Debug, Clone)]
pub struct Traced {
    /// The fit of all samples, as asked for.
    pub before: Fit,
    /// The fit of all samples with what was found.
    pub after: Fit,
    /// The session, bad samples left out.
    pub session: Session,
    /// The search's own session: one sample for each held pose.
    pub small: Session,
    /// The last fit of the search.
    pub last: Fit,
    /// Effects, in the order in which they were found.
    pub found: Vec<Found>,
    /// Readings that are wrong.
    pub excluded: Vec<Excluded>,
    /// The best that is left, whether or not it is above chance.
    pub left: Option<Scored>,
    /// What is at fault alone, where the catalogue does not explain it all.
    pub alone: Option<Alone>,
    /// How scores were judged.
    pub judge: Judge,
}

/// Traces the residual of a session.
///
/// # Errors
///
/// As [`fit`].
pub fn trace(session: &Session, search: &Search) -> Result<Traced, Error> {
    let mut session = session.clone();
    let base = session.instances()?;
    let before = fit(&session, base.clone(), None)?;
    let (clean, mut excluded) = sound(&mut session, &before)?;
    let mut hunt = Hunt::new(&session, &clean, search)?;
    let mut start = fit(&hunt.small, base, Some(&clean))?;
    hunt.rescale(&mut start)?;
    let (pursued, alone) = pursue_all(&mut hunt, &start)?;
    let Pursued { current, found, poses, wrong, left, .. } = pursued;
    excluded.extend(poses.iter().map(|step| hunt.excluded(step)));
    excluded.extend(wrong.into_iter().map(|(scored, blame)| match whole_pose(&scored.instance) {
        Some(_) => hunt.excluded(&scored),
        None => hunt.bad_reading(&scored.instance, blame),
    }));
    let mut steps = Vec::new();
    for Step { scored: Scored { instance, corrected, .. }, also, blame, without } in found {
        if scan::is_data(&instance) {
            excluded.push(hunt.bad_reading(&instance, blame));
        } else {
            steps.push(Found { instance, p_value: corrected, also, without });
        }
    }
    for pose in excluded.iter().filter(|e| e.row.is_none() && e.channel.is_none()) {
        for row in
            pose.pose.map(|p| session.readings.rows_of_poses()[p].clone()).unwrap_or_default()
        {
            session.weights[row] = 0.0;
        }
    }
    let after =
        if current.model.instances.len() == clean.model.instances.len() && excluded.is_empty() {
            clean.clone()
        } else {
            let from = expand(&clean, &current);
            faults::seen_by(&before, fit(&session, current.model.instances.clone(), Some(&from))?)
        };
    let judge = hunt.judge(&current);
    let small = hunt.small;
    let found = steps;
    Ok(Traced { before, after, session, small, last: current, found, excluded, left, alone, judge })
}

/// One effect of a search.
struct Step {
    scored: Scored,
    /// What fits as well.
    also: Vec<Instance>,
    /// Whose reading is wrong, if it is one.
    blame: Blame,
    /// The fit without it.
    without: Fit,
}

/// Where a search ended.
struct Pursued {
    current: Fit,
    found: Vec<Step>,
    /// Poses that are wrong as a whole.
    poses: Vec<Scored>,
    /// What is wrong beside what is at fault alone.
    wrong: Vec<(Scored, Blame)>,
    left: Option<Scored>,
    /// It ended because there were enough, not because nothing scored.
    more: bool,
}

impl Pursued {
    /// What is found but wrong readings.
    fn effects(&self) -> impl Iterator<Item = &Step> {
        self.found.iter().filter(|step| !scan::is_data(&step.scored.instance))
    }

    /// True where it takes jumps or wrong readings: crests of an unknown law look like them.
    fn sudden(&self) -> bool {
        let jumps = |step: &Step| matches!(step.scored.family, Family::Slip | Family::Bad);
        !self.poses.is_empty() || self.found.iter().any(jumps)
    }

    /// What is left, with what is paid for what was found.
    fn price(&self) -> f64 {
        let wrong = self.poses.iter().chain(self.wrong.iter().map(|(scored, _)| scored));
        let found = self.found.iter().map(|step| &step.scored);
        cost(&self.current) + found.chain(wrong).map(Scored::paid).sum::<f64>()
    }

    /// True where what is left is noise.
    fn quiet(&self, hunt: &Hunt) -> bool {
        hunt.judge(&self.current).lack_of_fit(&self.current).is_none_or(|p| p > LEFT)
    }

    /// True where nothing is left, and nothing that was found is in doubt.
    fn settled(&self, hunt: &Hunt) -> bool {
        let (found, rises): (Vec<_>, Vec<_>) = self
            .effects()
            .map(|step| (step.scored.instance, cost(&step.without) - cost(&self.current)))
            .unzip();
        !self.more && self.quiet(hunt) && doubt(&hunt.small.mechanism, &found, &rises).is_none()
    }
}

/// The search, and once more where one thing is at fault alone.
fn pursue_all(hunt: &mut Hunt, start: &Fit) -> Result<(Pursued, Option<Alone>), Error> {
    let most = hunt.search.most;
    // One unknown law takes many effects to make up: it is looked for before them.
    let mut open = pursue(hunt, start.clone(), most.min(FEW + 1))?;
    let mut at_fault = None;
    if !open.settled(hunt) {
        let found: Vec<Instance> = open.effects().map(|step| step.scored.instance).collect();
        at_fault = alone(&hunt.all(), start, &hunt.judge(start), &found, hunt.search)?;
    }
    let Some(it) = &at_fault else {
        if open.more {
            hunt.restart();
            open = pursue(hunt, start.clone(), most)?;
        }
        return Ok((open, None));
    };
    let chain = matches!(it.target, Target::Chain(_));
    let stays = (chain || open.effects().count() <= FEW) && open.quiet(hunt);
    let weights = hunt.restart();
    let confined = pursue_alone(hunt, start, it)?;
    // A few effects that leave nothing give way to others that do, and cost no more; none give
    // way to nothing.
    let nothing = confined.quiet(hunt) && confined.effects().count() == 0;
    let dearer = (chain || !open.sudden()) && confined.price() > open.price() + AS_WELL;
    if nothing || (stays && (dearer || !confined.settled(hunt))) {
        hunt.release(weights);
        return Ok((open, at_fault));
    }
    Ok((confined, at_fault))
}

/// The search confined to what is at fault alone, and what is wrong beside it left out.
fn pursue_alone(hunt: &mut Hunt, start: &Fit, it: &Alone) -> Result<Pursued, Error> {
    hunt.only = Some(it.target);
    let mut instances = start.model.instances.clone();
    for (scored, _) in &it.wrong {
        match whole_pose(&scored.instance) {
            Some(pose) => hunt.small.weights[pose] = 0.0,
            None => instances.push(scored.instance),
        }
    }
    let start = fit(&hunt.small, instances, Some(start))?;
    Ok(Pursued { wrong: it.wrong.clone(), ..pursue(hunt, start, hunt.search.most)? })
}

/// A search on its way.
struct Growing {
    current: Fit,
    found: Vec<Scored>,
    /// Poses that are wrong as a whole.
    poses: Vec<Scored>,
    /// The best that is left.
    left: Option<Scored>,
    /// It stands out, but there are enough.
    more: bool,
}

/// Adds effects until nothing scores, or there are so many.
fn grow(hunt: &mut Hunt, it: &mut Growing, most: usize) -> Result<(), Error> {
    let Growing { current, found, poses, left, more } = it;
    for _ in 0..=most {
        let scored = hunt.scan(current)?;
        *left = best_of(&scored);
        if found.len() + poses.len() >= most {
            *more = left.is_some_and(|left| left.corrected <= hunt.search.alpha);
            break;
        }
        let Some((steps, next)) = hunt.step(current, scored)? else { break };
        if let Some(pose) = whole_pose(&steps[0].instance) {
            hunt.small.weights[pose] = 0.0;
            poses.extend(steps);
            *current = fit(&hunt.small, current.model.instances.clone(), Some(current))?;
            hunt.rescale(current)?;
            continue;
        }
        found.extend(steps);
        *current = next;
        hunt.rescale(current)?;
        *current = hunt.look_back(current.clone(), found)?;
    }
    Ok(())
}

/// Adds effects, exchanges them for better ones, and looks back.
fn pursue(hunt: &mut Hunt, start: Fit, most: usize) -> Result<Pursued, Error> {
    let (found, poses) = (Vec::new(), Vec::new());
    let mut it = Growing { current: start, found, poses, left: None, more: false };
    grow(hunt, &mut it, most)?;
    if hunt.exchange(&mut it.current, &mut it.found)? {
        it.more = false;
        grow(hunt, &mut it, most)?;
    }
    let Growing { mut current, mut found, mut poses, left, more } = it;
    hunt.against_the_rest(&mut current, &mut found, &mut poses)?;
    // What fits as well as each effect, the others kept; and a better one, if there is.
    let mut rivals = Vec::new();
    for index in 0..found.len() {
        let (better, also, blame) = hunt.alternatives(&mut current, &mut found, index)?;
        if better {
            hunt.rescale(&mut current)?;
        }
        rivals.push((also, blame));
    }
    let mut steps = Vec::new();
    for (scored, (also, blame)) in found.into_iter().zip(rivals) {
        let without = hunt.without(&current, &[scored.instance])?;
        steps.push(Step { scored, also, blame, without });
    }
    Ok(Pursued { current, found: steps, poses, wrong: Vec::new(), left, more })
}

/// A session with one sample for each held pose, and the same fit of it.
///
/// # Errors
///
/// As [`fit`].
pub fn averaged(session: &Session, full: &Fit) -> Result<(Session, Fit), Error> {
    let search = Search::default();
    let mut hunt = Hunt::new(session, full, &search)?;
    let mut small = fit(&hunt.small, full.model.instances.clone(), Some(full))?;
    hunt.rescale(&mut small)?;
    Ok((hunt.small, small))
}

/// The fit without what is wrong whatever the model lacks, which is left out of the
/// session: faults of converters, single bad samples, placements.
///
/// # Errors
///
/// As [`fit`].
pub fn sound(session: &mut Session, before: &Fit) -> Result<(Fit, Vec<Excluded>), Error> {
    let base = &before.model.instances;
    let faults = faults::faults(&session.mechanism, &session.readings);
    let mut excluded = faults::set_apart(session, before, &faults);
    let sound = if excluded.is_empty() {
        before.clone()
    } else {
        faults::seen_by(before, fit(session, base.clone(), Some(before))?)
    };
    let faulty = excluded.len();
    excluded.extend(bad::samples(session, &sound));
    excluded.extend(damage::find(session, &sound)?);
    let clean = if excluded.len() == faulty {
        sound
    } else {
        faults::seen_by(before, fit(session, base.clone(), Some(&sound))?)
    };
    Ok((clean, excluded))
}

/// True where some reading scores as bad, were the model right.
///
/// # Errors
///
/// As [`fit`].
pub fn looks_bad(session: &Session, full: &Fit) -> Result<bool, Error> {
    let search = Search::default();
    let mut hunt = Hunt::new(session, full, &search)?;
    let mut small = fit(&hunt.small, full.model.instances.clone(), Some(full))?;
    hunt.rescale(&mut small)?;
    let scored = scan::bad_readings(&hunt.small, &small, &hunt.judge(&small))?;
    Ok(scored.iter().any(|s| s.corrected <= search.alpha))
}

/// A fit to start from: the parameters of the search, the noise of all samples.
fn expand(clean: &Fit, current: &Fit) -> Fit {
    Fit { noise: clean.noise.clone(), ..current.clone() }
}

/// The candidate least likely by chance.
fn best_of(scored: &[Scored]) -> Option<Scored> {
    scored.iter().copied().min_by(|a, b| a.corrected.total_cmp(&b.corrected))
}

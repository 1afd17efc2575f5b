//! A search: effects are added until nothing scores, exchanged for better ones, and looked back
//! at; and once more where one thing is at fault alone.

use std::sync::Arc;

use crate::Error;
use crate::diagnosis::doubt::doubt;
use crate::diagnosis::isolation::{Isolated, belongs, isolate, leave_out};
use crate::diagnosis::options::{FEW_EFFECTS, LEVEL, Rule};
use crate::diagnosis::score::scored::{self, Family, Scored, excluded_pose};
use crate::diagnosis::stepwise::alternatives::Alternatives;
use crate::diagnosis::stepwise::moves::{Stepwise, cost};
use crate::diagnosis::stepwise::rivals::Explanation;
use crate::estimate::progress::Stage;
use crate::estimate::{Fit, fit};
use crate::mechanism::Target;
use crate::model::{Instance, Model};
use crate::numerics::credible_set::AS_WELL;
use crate::screening::blame::Blame;

/// One effect of a search.
pub struct FoundEffect {
    pub scored: Scored,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// Whose reading is wrong, if it is one.
    pub blame: Blame,
    /// The fit without it.
    pub without: Fit,
    /// Scores of everything without it, best first.
    pub scores: Vec<Scored>,
    /// Laws of the same target that fit as well: the model with each, and its parameters.
    pub laws: Vec<(Instance, Arc<Model>, Vec<f64>)>,
}

/// Where a search ended.
pub struct Searched {
    pub current: Fit,
    pub found: Vec<FoundEffect>,
    /// Poses that are wrong as a whole.
    pub poses: Vec<Scored>,
    /// What is wrong beside what is at fault alone.
    pub wrong: Vec<(Scored, Blame)>,
    pub left: Option<Scored>,
    /// Scores of everything that is left, best first.
    pub scores: Vec<Scored>,
    /// Explanations that are nearly as good as the best, itself included.
    pub rivals: Vec<Explanation>,
    /// It ended because there were enough, not because nothing scored.
    pub(crate) more: bool,
}

impl Searched {
    /// A search that did not look for anything.
    pub fn nothing(start: Fit) -> Self {
        let (found, poses, wrong) = (Vec::new(), Vec::new(), Vec::new());
        let (rivals, scores) = (Vec::new(), Vec::new());
        Self { current: start, found, poses, wrong, left: None, scores, rivals, more: false }
    }

    /// What is found but wrong readings.
    fn effects(&self) -> impl Iterator<Item = &FoundEffect> {
        self.found.iter().filter(|step| !scored::is_data(&step.scored.instance))
    }

    /// True where it takes jumps or wrong readings: crests of an unknown law look like them.
    fn sudden(&self) -> bool {
        let jumps = |step: &FoundEffect| {
            let family = step.scored.family;
            family.happened_once() || family == Family::Bad
        };
        !self.poses.is_empty() || self.found.iter().any(jumps)
    }

    /// What is left, with what is paid for what was found.
    pub(crate) fn price(&self, stepwise: &Stepwise) -> f64 {
        let wrong = self.poses.iter().chain(self.wrong.iter().map(|(scored, _)| scored));
        let found = self.found.iter().map(|step| &step.scored);
        stepwise.said_of(&self.current) + found.chain(wrong).map(Scored::paid).sum::<f64>()
    }

    /// True where what is left is noise.
    pub(crate) fn quiet(&self, stepwise: &Stepwise) -> bool {
        stepwise.judge(&self.current).lack_of_fit(&self.current).is_none_or(|p| p > LEVEL)
    }

    /// True where nothing is left, and nothing that was found is in doubt.
    pub(crate) fn settled(&self, stepwise: &Stepwise) -> bool {
        let (found, rises): (Vec<_>, Vec<_>) = self
            .effects()
            .map(|step| (step.scored.instance, cost(&step.without) - cost(&self.current)))
            .unzip();
        !self.more
            && self.quiet(stepwise)
            && doubt(&stepwise.small.mechanism, &found, &rises).is_none()
    }
}

/// The search, and once more where one thing is at fault alone.
pub fn search_and_isolate(
    stepwise: &mut Stepwise,
    start: &Fit,
) -> Result<(Searched, Option<Isolated>), Error> {
    let most = stepwise.search.most;
    // One unknown law takes many effects to make up: it is looked for before them.
    let first = if stepwise.search.uses(Rule::FewFirst) { FEW_EFFECTS + 1 } else { most };
    let mut open = search_once(stepwise, start.clone(), most.min(first))?;
    let mut at_fault = None;
    if !open.settled(stepwise) && stepwise.search.uses(Rule::Isolation) {
        stepwise.small.options.progress.enter(Stage::Isolation);
        at_fault = isolate(&stepwise.all(), start, &stepwise.judge(start), stepwise.search)?;
    }
    let Some(it) = &at_fault else {
        if open.more {
            stepwise.restart();
            open = search_once(stepwise, start.clone(), most)?;
        }
        return Ok((open, None));
    };
    let chain = matches!(it.target, Target::Chain(_));
    let stays = (chain || open.effects().count() <= FEW_EFFECTS) && open.quiet(stepwise);
    let weights = stepwise.restart();
    let confined = search_confined(stepwise, start, it)?;
    // A few effects that leave nothing give way to others that do, and cost no more; none give
    // way to nothing.
    let nothing = confined.quiet(stepwise) && confined.effects().count() == 0;
    let dearer =
        (chain || !open.sudden()) && confined.price(stepwise) > open.price(stepwise) + AS_WELL;
    // A few effects that end the search, and explain more, do not give way to structure.
    let ended = !open.more && (chain || open.effects().count() <= FEW_EFFECTS);
    if ended && !confined.quiet(stepwise) && confined.price(stepwise) > open.price(stepwise) {
        stepwise.release(weights);
        // What was found there is its own.
        let mechanism = &stepwise.small.mechanism;
        let own = |step: &FoundEffect| belongs(mechanism, step.scored.instance.target, it.target);
        let own = open.effects().all(own);
        return Ok((open, at_fault.filter(|_| own)));
    }
    if nothing || (stays && (dearer || !confined.settled(stepwise))) {
        stepwise.release(weights);
        return Ok((open, at_fault));
    }
    Ok((confined, at_fault))
}

/// The search confined to what is at fault alone, and what is wrong beside it left out.
fn search_confined(stepwise: &mut Stepwise, start: &Fit, it: &Isolated) -> Result<Searched, Error> {
    stepwise.only = Some(it.target);
    let mut instances = start.model.instances.clone();
    for (scored, _) in &it.wrong {
        leave_out(scored, &mut stepwise.small, &mut instances);
    }
    let start = fit(&stepwise.small, instances, Some(start))?;
    Ok(Searched { wrong: it.wrong.clone(), ..search_once(stepwise, start, stepwise.search.most)? })
}

/// A search on its way.
struct Growing {
    current: Fit,
    found: Vec<Scored>,
    /// Poses that are wrong as a whole.
    poses: Vec<Scored>,
    /// The best that is left.
    left: Option<Scored>,
    /// Everything that is left, best first.
    scores: Vec<Scored>,
    /// It stands out, but there are enough.
    more: bool,
}

/// Adds effects until nothing scores, or there are so many.
fn grow(stepwise: &mut Stepwise, it: &mut Growing, most: usize) -> Result<(), Error> {
    let Growing { current, found, poses, left, scores, more } = it;
    for _ in 0..=most {
        let scored = stepwise.scan(current)?;
        *left = best_of(&scored);
        *scores = scored::best_places(&scored);
        if found.len() + poses.len() >= most {
            *more = left.is_some_and(|left| left.corrected <= stepwise.search.alpha);
            break;
        }
        let Some((steps, next)) = stepwise.step(current, scored)? else { break };
        if let Some(pose) = excluded_pose(&steps[0].instance) {
            stepwise.small.weights[pose] = 0.0;
            poses.extend(steps);
            *current = fit(&stepwise.small, current.model.instances.clone(), Some(current))?;
            stepwise.rescale(current)?;
            continue;
        }
        found.extend(steps);
        *current = next;
        stepwise.rescale(current)?;
    }
    Ok(())
}

/// Adds effects, exchanges them for better ones, and looks back.
fn search_once(stepwise: &mut Stepwise, start: Fit, most: usize) -> Result<Searched, Error> {
    let (found, poses, scores) = (Vec::new(), Vec::new(), Vec::new());
    let mut it = Growing { current: start, found, poses, left: None, scores, more: false };
    grow(stepwise, &mut it, most)?;
    if stepwise.exchange(&mut it.current, &mut it.found)? {
        it.more = false;
        grow(stepwise, &mut it, most)?;
    }
    let Growing { mut current, mut found, mut poses, left, scores: last, more } = it;
    stepwise.against_the_rest(&mut current, &mut found, &mut poses)?;
    // What fits as well as each effect, the others kept; and a better one, if there is.
    let mut beside = Vec::new();
    for index in 0..found.len() {
        let alternatives = stepwise.alternatives(&mut current, &mut found, index)?;
        if alternatives.better {
            stepwise.rescale(&mut current)?;
        }
        beside.push((found[index].instance, alternatives));
    }
    stepwise.keep_gains(&mut current, &mut found)?;
    beside.retain(|(instance, _)| found.iter().any(|s| s.instance == *instance));
    let near: Vec<_> = beside.iter_mut().map(|(_, a)| std::mem::take(&mut a.near)).collect();
    let rivals = stepwise.rivals(&current, &found, &near)?;
    let mut steps = Vec::new();
    for (scored, (_, Alternatives { also, blame, scores, laws, .. })) in
        found.into_iter().zip(beside)
    {
        let without = stepwise.without(&current, &[scored.instance])?;
        steps.push(FoundEffect { scored, also, blame, without, scores, laws });
    }
    let wrong = Vec::new();
    Ok(Searched { current, found: steps, poses, wrong, left, scores: last, rivals, more })
}

/// The candidate least likely by chance.
fn best_of(scored: &[Scored]) -> Option<Scored> {
    scored.iter().copied().min_by(|a, b| a.corrected.total_cmp(&b.corrected))
}

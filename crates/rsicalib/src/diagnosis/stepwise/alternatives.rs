//! What fits as well as an effect, and what fits better.

use std::slice;
use std::sync::Arc;

use crate::Error;
use crate::diagnosis::price::room;
use crate::diagnosis::score::scored::{self, Scored, excluded_pose};
use crate::diagnosis::stepwise::moves::{BETTER, Stepwise, physical};
use crate::diagnosis::stepwise::orders::one_order;
use crate::estimate::Fit;
use crate::model::{Instance, Model};
use crate::numerics::credible_set::{AS_WELL, RIVAL};
use crate::screening::blame::Blame;

/// Rivals to refit for each candidate that a step refits: scores are first order, and what fits
/// as well may be far down their list.
const RIVALS: usize = 3;

/// What may stand in place of one effect.
pub struct Alternatives {
    /// True where something fits better, which has then taken its place.
    pub better: bool,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// What is within [`RIVAL`] of the best, the best first; the effect itself is not among them.
    pub near: Vec<Scored>,
    /// Whose reading is wrong, if it is one.
    pub blame: Blame,
    /// Scores of everything without the effect, of each at its best place, best first.
    pub scores: Vec<Scored>,
    /// Laws of the same target that fit as well: the model with each, and its parameters.
    pub laws: Vec<(Instance, Arc<Model>, Vec<f64>)>,
}

impl Stepwise<'_> {
    /// What fits as well in place of one effect; what fits better takes its place.
    pub fn alternatives(
        &self,
        current: &mut Fit,
        found: &mut [Scored],
        index: usize,
    ) -> Result<Alternatives, Error> {
        let own = found[index].instance;
        let without = self.without(current, &[own])?;
        let mut scored = self.scan(&without)?;
        let scores = scored::best_places(&scored);
        let Some(mine) = score_of(own, &scored, current) else {
            let blame = Blame::among([(0.0, own.target)], &self.small.mechanism);
            let (also, near, laws) = (Vec::new(), Vec::new(), Vec::new());
            return Ok(Alternatives { better: false, also, near, blame, scores, laws });
        };
        let room = RIVAL + room(mine.score);
        let others: Vec<Instance> =
            found.iter().map(|s| s.instance).filter(|other| *other != own).collect();
        let all = scored.clone();
        scored.retain(|s| {
            s.instance != own
                && same_kind(&s.instance, &own)
                && !others.iter().any(|other| self.overlap(&s.instance, other))
                && !one_order(current, &s.instance, &own)
                && excluded_pose(&s.instance).is_none()
                && s.charged() > mine.charged() - room
        });
        scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        scored::one_place_each(&mut scored, |_| true);
        let mut rivals = Vec::new();
        let value = |fit: &Fit, s: &Scored| self.fall(&without, fit) - s.paid();
        let my_value =
            if physical(current, &own) { value(current, &mine) } else { f64::NEG_INFINITY };
        scored.truncate(RIVALS * self.search.refits);
        self.prepare_with(&without, scored.iter().map(|s| slice::from_ref(&s.instance)));
        for candidate in scored {
            let (candidate, refit) = self.tuned(&without, candidate)?;
            if self.sensible(&without, &refit) && physical(&refit, &candidate.instance) {
                rivals.push((value(&refit, &candidate), candidate, refit));
            }
        }
        rivals.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut better = false;
        let mut also: Vec<(f64, Instance)> = vec![(my_value, own)];
        if let Some((value, candidate, refit)) = rivals.first()
            && *value > my_value + BETTER
            && self.gain(&without, refit, slice::from_ref(candidate)) > 0.0
            && candidate.corrected <= self.search.alpha
        {
            found[index] = *candidate;
            *current = refit.clone();
            better = true;
        }
        also.extend(rivals.iter().map(|(value, candidate, _)| (*value, candidate.instance)));
        let named = found[index].instance;
        let blame = Blame::among(also.iter().map(|(v, i)| (*v, i.target)), &self.small.mechanism);
        let best = also.iter().map(|(value, _)| *value).fold(f64::NEG_INFINITY, f64::max);
        let as_well =
            |(value, instance): &&(f64, Instance)| *value > best - AS_WELL && *instance != named;
        let near = rivals.iter().map(|(value, candidate, _)| (*value, *candidate));
        let near = near
            .chain([(my_value, mine)])
            .filter(|(value, s)| *value > best - RIVAL && s.instance != named)
            .map(|(_, s)| s)
            .collect();
        let mut also: Vec<Instance> = also.iter().filter(as_well).map(|(_, i)| *i).collect();
        for beside in self.beside_tolerances(current, found, index, &all)? {
            if !also.contains(&beside.instance) {
                also.push(beside.instance);
            }
        }
        let beside = |(_, s, _): &(f64, Scored, Fit)| {
            s.instance.target == named.target && also.contains(&s.instance)
        };
        let laws = rivals.into_iter().filter(beside).map(|(_, s, f)| (s.instance, f.model, f.beta));
        let laws = laws.collect();
        Ok(Alternatives { better, also, near, blame, scores, laws })
    }
}

/// The score of an effect. Not every order is tried: of one between two, the score of the better.
fn score_of(own: Instance, scored: &[Scored], fit: &Fit) -> Option<Scored> {
    let itself = scored.iter().find(|s| s.instance == own).copied();
    let beside = scored.iter().filter(|s| one_order(fit, &s.instance, &own));
    let beside = beside.max_by(|a, b| a.score.total_cmp(&b.score));
    itself.or_else(|| beside.map(|s| Scored { instance: own, ..*s }))
}

/// Bad readings are rivals of bad readings of the same pose, effects of effects.
fn same_kind(a: &Instance, b: &Instance) -> bool {
    scored::is_data(a) == scored::is_data(b) && (!scored::is_data(a) || a.place == b.place)
}

//! The moves of a search: add the best effect, drop what is no longer needed, replace
//! two by one, and say what fits as well.

use crate::alone::belongs;
use crate::excluded::Excluded;
use crate::fit::{Fit, Options, fit};
use crate::model::{Instance, Target};
use crate::noise::Source;
use crate::rivals::{AS_WELL, Blame, credible};
use crate::scan::{self, CHARGE, Family, Judge, Scored};
use crate::session::Session;
use crate::terms::{Acts, Weight};
use crate::{Error, lm};

/// How to search.
#[derive(Debug, Clone)]
pub struct Search {
    /// Probability of naming anything where nothing is missing.
    pub alpha: f64,
    /// Terms that are no candidates.
    pub without: Vec<String>,
    /// Effects to add at the most.
    pub most: usize,
    /// Candidates to refit in each step.
    pub refits: usize,
}

impl Default for Search {
    fn default() -> Self {
        Self { alpha: 0.012, without: Vec::new(), most: 8, refits: 8 }
    }
}

/// Residuals above chance at this level are not explained.
pub const LEFT: f64 = 0.001;

/// To this fraction of its χ² a fit of the search need be at its minimum: decisions
/// turn on units of χ², and the answer is fitted to all digits.
const ENOUGH: f64 = 1e-7;

/// The pose of a candidate that says that the whole pose is wrong.
pub fn whole_pose(instance: &Instance) -> Option<usize> {
    (scan::is_data(instance) && instance.target == Target::All).then_some(instance.place)
}

/// A parameter of an effect in units of its standard deviation; none where the effect
/// is not in the model, or not to be seen.
fn estimate_of(fit: &Fit, instance: &Instance) -> Option<f64> {
    let k = fit.model.instances.iter().position(|i| i == instance)?;
    let first = fit.model.first[k];
    let variance = fit.covariance[(first, first)];
    (variance > 0.0).then(|| fit.beta[first] / variance.sqrt())
}

/// False for a load that lifts: a joint cannot give against it, and what explains the
/// residual so is something else.
fn physical(fit: &Fit, instance: &Instance) -> bool {
    !matches!(instance.term.acts(), Acts::Load(_))
        || estimate_of(fit, instance).is_none_or(|sure| sure > 0.0)
}

/// The state of a search.
pub struct Hunt<'a> {
    /// One sample for each held pose.
    pub small: Session,
    /// The channel, closure or chain to which the search is confined.
    pub only: Option<Target>,
    pub search: &'a Search,
    /// Weights of the samples before any pose was left out.
    counts: Vec<f64>,
    /// Samples of each pose.
    samples: Vec<usize>,
    source: Source,
    noise_dof: f64,
}

impl<'a> Hunt<'a> {
    pub fn new(session: &Session, fit: &Fit, search: &'a Search) -> Result<Self, Error> {
        let mut small = session.clone();
        let mut sigma = fit.noise.sigma.clone();
        if session.readings.held {
            let (readings, counts) =
                session.readings.averaged(&session.mechanism, &session.weights)?;
            let usual = counts.iter().copied().fold(1.0, f64::max);
            small.weights = counts.iter().map(|n| (n / usual).sqrt()).collect();
            small.readings = readings;
            sigma.iter_mut().for_each(|s| *s *= (fit.noise.inflation / usual).sqrt());
        }
        let lm = lm::Options { ftol: ENOUGH, xtol: ENOUGH, ..session.options.lm.clone() };
        let (noise, play) = (Some(sigma), fit.noise.play);
        small.options = Options { noise, play, lm, ..session.options.clone() };
        let counts = small.weights.clone();
        let samples = session.readings.rows_of_poses().iter().map(Vec::len).collect();
        let (source, noise_dof) = (fit.noise.source, fit.noise.dof);
        Ok(Self { small, only: None, search, counts, samples, source, noise_dof })
    }

    pub fn judge(&self, fit: &Fit) -> Judge {
        let residual_dof = (!self.source.independent()).then_some(fit.dof);
        Judge { noise_dof: self.noise_dof, residual_dof }
    }

    /// Scores of what may be wrong. Where one thing is at fault alone, no single reading is,
    /// crests of an unknown law look like jumps, and of a chain no one channel is to blame.
    pub fn scan(&self, fit: &Fit) -> Result<Vec<Scored>, Error> {
        let mut scored = scan::scan(&self.small, fit, &self.judge(fit), &self.search.without)?;
        if let Some(only) = self.only {
            let mechanism = &self.small.mechanism;
            let channel = |i: &Instance| matches!(i.target, Target::Channel(_));
            scored.retain(|Scored { instance, family, .. }| {
                belongs(mechanism, instance.target, only)
                    && !scan::is_data(instance)
                    && *family != Family::Slip
                    && (instance.target == only || !channel(instance))
            });
        }
        Ok(scored)
    }

    /// The session with all poses.
    pub fn all(&self) -> Session {
        Session { weights: self.counts.clone(), ..self.small.clone() }
    }

    /// All poses count again; gives the weights that were.
    pub fn restart(&mut self) -> Vec<f64> {
        std::mem::replace(&mut self.small.weights, self.counts.clone())
    }

    /// Anything may be wrong again.
    pub fn release(&mut self, weights: Vec<f64>) {
        self.only = None;
        self.small.weights = weights;
    }

    /// Where nothing but the fit gives the noise, it shrinks as the model grows.
    pub fn rescale(&mut self, current: &mut Fit) -> Result<(), Error> {
        if self.source.independent() || current.dof < 1.0 {
            return Ok(());
        }
        let scale = (current.total / current.dof).sqrt();
        if let Some(sigma) = &mut self.small.options.noise {
            sigma.iter_mut().for_each(|s| *s *= scale);
        }
        self.small.options.play *= scale * scale;
        *current = fit(&self.small, current.model.instances.clone(), Some(current))?;
        Ok(())
    }

    /// Refits the best candidates; the best of them, if any is above chance.
    pub fn step(
        &self,
        current: &Fit,
        mut scored: Vec<Scored>,
    ) -> Result<Option<(Vec<Scored>, Fit)>, Error> {
        let yielding = self.yielding(current, &scored)?;
        scored.retain(|s| s.corrected <= self.search.alpha);
        scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        let mut best: Option<(f64, Scored, Fit)> = None;
        for &candidate in scored.iter().take(self.search.refits) {
            if whole_pose(&candidate.instance).is_some() {
                if best.is_none() {
                    let one = self.one_channel(current, &candidate, &scored)?;
                    let (one, fit) = one.unwrap_or_else(|| (candidate, current.clone()));
                    return Ok(Some((vec![one], fit)));
                }
                continue;
            }
            // Scores are first order; what is this far behind does not catch up.
            let room = 4.0 + 0.25 * candidate.score;
            if best.as_ref().is_some_and(|(gain, ..)| *gain > candidate.charged() + room) {
                continue;
            }
            let refit = self.with(current, candidate.instance)?;
            let gain = self.gain(current, &refit, &candidate);
            if best.as_ref().is_none_or(|(g, ..)| gain > *g) {
                best = Some((gain, candidate, refit));
            }
        }
        Ok(match (best, yielding) {
            (best, Some((gain, joints, refit)))
                if best.as_ref().is_none_or(|(alone, ..)| gain > *alone) =>
            {
                Some((joints, refit))
            }
            (best, _) => best.map(|(_, candidate, refit)| (vec![candidate], refit)),
        })
    }

    /// All joints that give under the links' weight, as one effect: what one joint gives
    /// is not told without what the others do. Those that do not stand out are left out,
    /// and those that would have to give against their load.
    fn yielding(
        &self,
        current: &Fit,
        scored: &[Scored],
    ) -> Result<Option<(f64, Vec<Scored>, Fit)>, Error> {
        let of_links = |s: &&Scored| matches!(s.instance.term.acts(), Acts::Load(Weight::Links));
        let mut joints: Vec<Scored> = scored.iter().filter(of_links).copied().collect();
        while joints.len() > 1 {
            let mut instances = current.model.instances.clone();
            instances.extend(joints.iter().map(|s| s.instance));
            let refit = fit(&self.small, instances, Some(current))?;
            let judge = self.judge(&refit);
            let mut weakest: Option<(f64, usize)> = None;
            for (k, joint) in joints.iter_mut().enumerate() {
                let Some(sure) = estimate_of(&refit, &joint.instance) else { return Ok(None) };
                // By how much χ² would rise without it, to first order; with its sign.
                joint.score = sure * sure.abs();
                joint.p_value = judge.p_value(joint.score.max(0.0), joint.width);
                joint.corrected = joint.p_value * joint.places;
                if weakest.is_none_or(|(score, _)| joint.score < score) {
                    weakest = Some((joint.score, k));
                }
            }
            match weakest {
                Some((_, k)) if joints[k].corrected > self.search.alpha => joints.remove(k),
                _ => {
                    let width = current.dof - refit.dof;
                    let searched = 2.0 * joints[0].places.ln().max(0.0);
                    let paid = CHARGE * width + searched * joints.len() as f64;
                    return Ok(Some((cost(current) - cost(&refit) - paid, joints, refit)));
                }
            };
        }
        Ok(None)
    }

    /// The one channel that explains as much as leaving its whole pose out does: scores are
    /// of first order, and of a reading that is far off that is not enough.
    fn one_channel(
        &self,
        current: &Fit,
        pose: &Scored,
        scored: &[Scored],
    ) -> Result<Option<(Scored, Fit)>, Error> {
        let here = |s: &&Scored| {
            scan::is_data(&s.instance)
                && whole_pose(&s.instance).is_none()
                && s.instance.place == pose.instance.place
        };
        let mut without = self.small.clone();
        without.weights[pose.instance.place] = 0.0;
        let left = fit(&without, current.model.instances.clone(), Some(current))?;
        // Several wrong readings at once are the rarer story: chance may not tell it.
        let mut best = (self.gain(current, &left, pose) - AS_WELL, None);
        for candidate in scored.iter().filter(here) {
            let refit = self.with(current, candidate.instance)?;
            let gain = self.gain(current, &refit, candidate);
            if gain >= best.0 {
                best = (gain, Some((*candidate, refit)));
            }
        }
        Ok(best.1)
    }

    /// The fit with one more effect.
    fn with(&self, current: &Fit, instance: Instance) -> Result<Fit, Error> {
        let mut instances = current.model.instances.clone();
        instances.push(instance);
        fit(&self.small, instances, Some(current))
    }

    /// The fit without one of its effects.
    pub fn without(&self, current: &Fit, instance: &Instance) -> Result<Fit, Error> {
        let fewer = current.model.instances.iter().copied().filter(|i| i != instance).collect();
        fit(&self.small, fewer, Some(current))
    }

    /// By how much χ² fell, its parameters and places paid for.
    fn gain(&self, before: &Fit, after: &Fit, candidate: &Scored) -> f64 {
        let paid = candidate.score - candidate.charged();
        if after.plausible && physical(after, &candidate.instance) && after.termination.converged()
        {
            cost(before) - cost(after) - paid
        } else {
            f64::NEG_INFINITY
        }
    }

    /// Drops what is no longer needed, or is part of a free shape that was added.
    pub fn look_back(&self, current: Fit, found: &mut Vec<Scored>) -> Result<Fit, Error> {
        let mut current = current;
        let mut index = 0;
        while index + 1 < found.len() {
            let instance = found[index].instance;
            let without = self.without(&current, &instance)?;
            let lost = cost(&without) - cost(&current);
            let width = instance.width() as f64;
            let p_value = self.judge(&current).p_value(lost.max(0.0), width);
            let repeats = !instance.term.info().penalised
                && scan::has_free_shape(&current, instance.term, instance.target);
            if repeats || p_value * 1e3 > self.search.alpha * 10.0 {
                found.remove(index);
                current = without;
            } else {
                index += 1;
            }
        }
        Ok(current)
    }

    /// Drops what does not stand out against what stays unexplained.
    ///
    /// Where the catalogue lacks the effect, structure is left, and its crests look
    /// like bad readings and faint effects. Then the rest is the noise that a name
    /// must be above: scores are divided by its χ² per degree of freedom.
    pub fn against_the_rest(
        &mut self,
        current: &mut Fit,
        found: &mut Vec<Scored>,
        poses: &mut Vec<Scored>,
    ) -> Result<(), Error> {
        let judge = self.judge(current);
        if judge.lack_of_fit(current).is_none_or(|p| p > LEFT) {
            return Ok(());
        }
        let rest = current.chi2 / current.dof;
        let stands_out = |score: f64, step: &Scored| {
            judge.p_value(score / rest, step.width) * step.places <= self.search.alpha
        };
        let mut kept = Vec::new();
        for step in found.iter() {
            let without = self.without(current, &step.instance)?;
            if stands_out(cost(&without) - cost(current), step) {
                kept.push(*step);
            }
        }
        let whole: Vec<Scored> =
            poses.iter().copied().filter(|step| stands_out(step.score, step)).collect();
        if kept.len() == found.len() && whole.len() == poses.len() {
            return Ok(());
        }
        let dropped = |i: &Instance| {
            found.iter().any(|s| s.instance == *i) && !kept.iter().any(|s| s.instance == *i)
        };
        let instances = current.model.instances.iter().copied().filter(|i| !dropped(i)).collect();
        for step in poses.iter().filter(|s| !whole.contains(s)) {
            self.small.weights[step.instance.place] = self.counts[step.instance.place];
        }
        (*found, *poses) = (kept, whole);
        *current = fit(&self.small, instances, Some(current))?;
        self.rescale(current)
    }

    /// Replaces two effects by one that explains as much, its places paid for:
    /// the first of two may have been half of the truth.
    pub fn merge_pairs(&mut self, current: &mut Fit, found: &mut Vec<Scored>) -> Result<(), Error> {
        let (mut a, mut b) = (0, 1);
        while b < found.len() {
            if let Some((one, fit)) =
                self.one_for_two(current, [found[a].instance, found[b].instance])?
            {
                found.remove(b);
                found[a] = one;
                *current = fit;
                self.rescale(current)?;
                (a, b) = (0, 1);
                continue;
            }
            a += 1;
            if a == b {
                (a, b) = (0, b + 1);
            }
        }
        Ok(())
    }

    /// The one effect that does what two do, and its fit.
    fn one_for_two(
        &self,
        current: &Fit,
        pair: [Instance; 2],
    ) -> Result<Option<(Scored, Fit)>, Error> {
        let fewer: Vec<Instance> =
            current.model.instances.iter().copied().filter(|i| !pair.contains(i)).collect();
        let without = fit(&self.small, fewer, Some(current))?;
        let mut scored = self.scan(&without)?;
        let paid = |s: &Scored| s.score - s.charged();
        let price: f64 = scored.iter().filter(|s| pair.contains(&s.instance)).map(paid).sum();
        let both = cost(&without) - cost(current) - price;
        scored.retain(|s| {
            !pair.contains(&s.instance)
                && whole_pose(&s.instance).is_none()
                && s.charged() > 0.5 * both
                && s.corrected <= self.search.alpha
        });
        scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        let mut best: Option<(f64, Scored, Fit)> = None;
        for candidate in scored.into_iter().take(self.search.refits) {
            let refit = self.with(&without, candidate.instance)?;
            let gain = self.gain(&without, &refit, &candidate);
            if gain > both && best.as_ref().is_none_or(|(g, ..)| gain > *g) {
                best = Some((gain, candidate, refit));
            }
        }
        Ok(best.map(|(_, candidate, refit)| (candidate, refit)))
    }

    /// What fits as well in place of one effect; true where something fits
    /// better, which then takes its place.
    pub fn alternatives(
        &self,
        current: &mut Fit,
        found: &mut [Scored],
        index: usize,
    ) -> Result<(bool, Vec<Instance>, Blame), Error> {
        let own = found[index].instance;
        let without = self.without(current, &own)?;
        let mut scored = self.scan(&without)?;
        let Some(mine) = scored.iter().find(|s| s.instance == own).copied() else {
            return Ok((false, Vec::new(), self.blame(&[(0.0, own)])));
        };
        // Scores are first order: leave room for what refitting changes.
        let room = AS_WELL + 4.0 + 0.15 * mine.score;
        scored.retain(|s| {
            s.instance != own
                && same_kind(&s.instance, &own)
                && whole_pose(&s.instance).is_none()
                && value_of(s) > value_of(&mine) - room
        });
        scored.sort_by(|a, b| value_of(b).total_cmp(&value_of(a)));
        one_place_each(&mut scored);
        let mut rivals = Vec::new();
        let value = |fit: &Fit, s: &Scored| cost(&without) - cost(fit) - charge(s);
        let my_value = value(current, &mine);
        for candidate in scored.into_iter().take(self.search.refits + 4) {
            let refit = self.with(&without, candidate.instance)?;
            let sensible = refit.plausible && physical(&refit, &candidate.instance);
            if sensible && refit.termination.converged() {
                rivals.push((value(&refit, &candidate), candidate, refit));
            }
        }
        rivals.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut better = false;
        let mut also: Vec<(f64, Instance)> = vec![(my_value, own)];
        if let Some((value, candidate, refit)) = rivals.first()
            && *value > my_value + 0.5
            && candidate.corrected <= self.search.alpha
        {
            found[index] = *candidate;
            *current = refit.clone();
            better = true;
        }
        also.extend(rivals.iter().map(|(value, candidate, _)| (*value, candidate.instance)));
        let named = found[index].instance;
        let blame = self.blame(&also);
        let rivals: Vec<(f64, Target)> = also.iter().map(|(v, i)| (*v, i.target)).collect();
        let kept = also.iter().zip(credible(&rivals));
        let also = kept.filter(|((_, i), kept)| *kept && *i != named).map(|((_, i), _)| *i);
        Ok((better, also.collect(), blame))
    }

    /// Whose reading is wrong, of rivals `(value, effect)`.
    fn blame(&self, rivals: &[(f64, Instance)]) -> Blame {
        let of_channel = |(value, instance): &(f64, Instance)| match instance.target {
            Target::Channel(channel) => Some((*value, channel)),
            _ => None,
        };
        let channels: Vec<_> = rivals.iter().filter_map(of_channel).collect();
        Blame::of(&channels, &self.small.mechanism)
    }

    /// A bad reading, with the channel where it can be told, else the likeliest chain.
    pub fn bad_reading(&self, instance: &Instance, blame: Blame) -> Excluded {
        let samples = self.samples[instance.place];
        let Blame { channel, chain, reason } = blame;
        Excluded { channel, chain, ..Excluded::of(Some(instance.place), samples, reason) }
    }

    pub fn excluded(&self, step: &Scored) -> Excluded {
        let pose = step.instance.place;
        let reason = format!(
            "no single channel explains it (p {:.1e}): it moved while sampled, or several readings are wrong",
            step.p_value
        );
        Excluded::of(Some(pose), self.samples[pose], reason)
    }
}

/// What a candidate pays: its parameters, and the time that was searched for.
fn charge(candidate: &Scored) -> f64 {
    let time = if candidate.family == Family::Slip { CHARGE } else { 0.0 };
    CHARGE * candidate.width + time
}

fn value_of(candidate: &Scored) -> f64 {
    candidate.score - charge(candidate)
}

/// Keeps the best place of each searched term at each target; best first.
fn one_place_each(scored: &mut Vec<Scored>) {
    let mut seen: Vec<(&str, Target)> = Vec::new();
    scored.retain(|s| {
        let key = (s.instance.term.info().id, s.instance.target);
        let new = !seen.contains(&key);
        seen.push(key);
        new
    });
}

/// Bad readings are rivals of bad readings of the same pose, effects of effects.
fn same_kind(a: &Instance, b: &Instance) -> bool {
    scan::is_data(a) == scan::is_data(b) && (!scan::is_data(a) || a.place == b.place)
}

/// χ² with what priors add to it.
#[must_use]
pub fn cost(fit: &Fit) -> f64 {
    let held: f64 = fit.priors.iter().map(|p| p.off(&fit.beta).powi(2)).sum();
    fit.total + held
}

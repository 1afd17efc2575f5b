//! Starts of the fit.
//!
//! At gain zero the algebraic misclosure of any assembled pose vanishes. This trivial solution
//! attracts the solver (section IV-B of the paper). Two measures keep the search away from the
//! trivial solution. First, offsets are anchored at the one pose that is known,
//! `θ_off = θ_rest - k a_rest`, so that a wrong gain turns each joint about the rest pose and not
//! about count zero. Second, a solution in which a joint hardly moves is discarded, and the next
//! start is tried.
//!
//! The weighted χ² ranks the solutions, because χ² grows without bound as a gain goes to zero.
//! Where the first start fails, the weighted χ² also finds the gains, with offsets tied to the
//! anchor. Without a reading of the rest pose there are several anchors, which are tried in turn.
//! A mechanism may also close in another assembly: solutions beyond the joint limits come last.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector3;

use crate::estimate::algebraic::Algebraic;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::{Anchor, Observations};
use crate::kinematics::elements::Way;
use crate::mechanism::{Closure, Mechanism, Target, Value};
use crate::model::{Model, Prior};
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::numerics::thin;
use crate::readings::Readings;
use crate::terms::term::{Acts, Role, Spot};

/// Fraction of its nominal gain below which a channel has collapsed, and of its drawing a length.
const COLLAPSED: f64 = 0.05;

/// Parameters with each channel's gain at its factor times the nominal gain, and with offsets at
/// the best anchor of the observations. `factors` holds one number per channel.
#[must_use]
pub fn anchored(observations: &Observations, model: &Model, factors: &[f64]) -> Vec<f64> {
    let best = observations.anchors().into_iter().next();
    best.map_or_else(|| model.nominal(), |anchor| about(&anchor, model, factors))
}

/// The same for one anchor.
fn about(anchor: &Anchor, model: &Model, factors: &[f64]) -> Vec<f64> {
    let mut beta = model.nominal();
    for (c, &(reading, angle)) in anchor.at.iter().enumerate() {
        let scale = &model.scales[c];
        let gain = scale.gain * factors[c];
        if let Some(column) = model.column(Role::Gain, c) {
            beta[column] = gain - scale.gain;
        }
        let gain = if model.column(Role::Gain, c).is_some() { gain } else { scale.gain };
        if let Some(column) = model.column(Role::Offset, c) {
            beta[column] = angle - scale.angle - gain * (reading - scale.centre);
        }
    }
    beta
}

/// Ratio of each channel's gain to the nominal gain.
pub fn ratios(model: &Model, beta: &[f64]) -> impl Iterator<Item = f64> {
    model.scales.iter().enumerate().map(|(c, scale)| {
        let own = model.gains_of(c).map(|column| beta[column]).sum::<f64>();
        (scale.gain + own) / scale.gain
    })
}

/// True where a channel's gain has collapsed, so that its joint hardly moves.
#[must_use]
pub fn collapsed(model: &Model, beta: &[f64]) -> bool {
    ratios(model, beta).any(|ratio| ratio.abs() < COLLAPSED)
}

/// True where every closure has a length that is fitted, and all of them have collapsed: a fit to which
/// nothing says how long anything is makes the machine small, which closes any loop.
pub(crate) fn shrunk(model: &Model, beta: &[f64]) -> bool {
    let closures = &model.mechanism.closures;
    let gone = |k: usize| {
        let own = model.instances.iter().zip(&model.first).filter(|(i, _)| {
            matches!(i.term.acts(), Acts::Distance)
                && model.mechanism.has_part(i.target, Target::Closure(k))
        });
        let longer = own.map(|(_, &first)| beta[first]).reduce(|a, b| a + b);
        match (longer, &closures[k].value) {
            (Some(longer), Some(Value::Known(drawn))) => {
                (drawn + longer).abs() < COLLAPSED * drawn.abs()
            }
            _ => false,
        }
    };
    !closures.is_empty() && (0..closures.len()).all(gone)
}

/// True where the links of all chains have collapsed: an arm whose lengths are all zero touches any unknown point with
/// any readings. How far along the first axis it begins is no length of it.
pub(crate) fn is_drawn_together(model: &Model, beta: &[f64]) -> bool {
    let mechanism = &model.mechanism;
    let slides = |c: usize, r: usize| {
        let instances = model.instances.iter().zip(&model.first);
        instances.filter_map(move |(i, &first)| match i.term.acts() {
            Acts::Geometry([(Spot::Link, axis, Way::Slide)]) if i.target == Target::Row(c, r) => {
                Some((*axis, beta[first]))
            }
            _ => None,
        })
    };
    let tips = mechanism.points.iter().filter(|p| p.chain.is_some()).filter_map(|p| p.at);
    let tips: f64 = tips.map(|at| Vector3::from(at).norm()).sum();
    let (mut drawn, mut left) = (tips, tips);
    for (c, chain) in mechanism.chains.iter().enumerate() {
        for (r, row) in chain.rows.iter().enumerate() {
            let body = row.body().translation.vector;
            let mut fitted = body;
            for (axis, off) in slides(c, r) {
                let mut along = Vector3::zeros();
                along[axis as usize] = off;
                fitted += row.link() * along;
            }
            let own = |v: Vector3<f64>| if r == 0 { v.xy().norm() } else { v.norm() };
            drawn += own(body);
            left += own(fitted);
        }
    }
    left < COLLAPSED * drawn
}

/// True where the gains of channels of which `equal` closures alone tell are all fitted: with gains of zero such
/// closures hold whatever is read.
pub(crate) fn unscaled(model: &Model, priors: &[Prior]) -> bool {
    let mechanism = &model.mechanism;
    if !mechanism.closures.iter().any(Closure::is_of_channels) {
        return false;
    }
    let others = mechanism.closures.iter().any(|closure| !closure.is_of_channels());
    let known = |c: usize| {
        let of_others = others && (mechanism.moves_joint(c) || mechanism.measures(c));
        of_others || model.gains_of(c).all(|column| has_prior(priors, column))
    };
    let channels = 0..mechanism.channels.len();
    let mut told: Vec<bool> = channels.clone().map(known).collect();
    for _ in channels.clone() {
        for c in channels.clone() {
            told[c] |= mechanism.made_equal(c).into_iter().any(|other| told[other]);
        }
    }
    channels.clone().any(|c| !told[c] && !mechanism.made_equal(c).is_empty())
}

/// True for a parameter with a prior of its own.
fn has_prior(priors: &[Prior], column: usize) -> bool {
    priors.iter().any(|p| matches!(p, Prior::Parameter { column: own, .. } if *own == column))
}

/// Number of samples that the search of starts uses.
const SAMPLES: usize = 150;

/// Standard deviation of the tie of an offset to an anchor (rad): an anchor that was read, and an
/// anchor that is presumed.
const TIED: [f64; 2] = [0.02, 0.1];

/// Factor on the noise while offsets are tied, so that the ties have enough weight.
const LOOSE: f64 = 30.0;

/// The search of a start, on some of the samples.
#[derive(Debug)]
pub struct StartSearch<'a> {
    /// The observations.
    pub observations: &'a Observations,
    /// The model.
    pub model: &'a Model,
    /// The samples that the search uses.
    pub readings: Arc<Readings>,
    /// Weight of each sample.
    pub weights: Vec<f64>,
    noise: Noise,
    priors: Vec<Prior>,
    options: lm::SolverOptions,
    pub(crate) anchors: Vec<(Anchor, Option<Tied>)>,
}

/// The same model with offsets defined at the anchor, so that priors can hold them.
#[derive(Debug)]
pub(crate) struct Tied {
    model: Model,
    priors: Vec<Prior>,
}

impl Tied {
    fn new(observations: &Observations, model: &Model, anchor: &Anchor) -> Option<Self> {
        let (at, angles): (Vec<f64>, Vec<f64>) = anchor.at.iter().copied().unzip();
        let instances = model.instances.clone();
        let model = Model::about(
            Some(model),
            &observations.mechanism,
            &observations.readings,
            instances,
            &at,
        )
        .ok()?;
        let mut priors = model.priors();
        for (c, scale) in model.scales.iter().enumerate() {
            if let Some(column) = model.column(Role::Offset, c) {
                let (mean, sd) = (angles[c] - scale.angle, TIED[usize::from(!anchor.known)]);
                priors.push(Prior::Parameter { column, mean, sd });
            }
        }
        Some(Self { model, priors })
    }
}

/// Parameters of the model `from` as parameters of the model `to`, whose offsets are defined at
/// other readings.
fn moved(beta: &[f64], from: &Model, to: &Model) -> Vec<f64> {
    let mut moved = beta.to_vec();
    for (c, (a, b)) in from.scales.iter().zip(&to.scales).enumerate() {
        if let Some(offset) = to.column(Role::Offset, c) {
            let gain = a.gain + to.column(Role::Gain, c).map_or(0.0, |column| beta[column]);
            moved[offset] += a.angle - b.angle + gain * (b.centre - a.centre);
        }
    }
    moved
}

/// Solution from one start.
#[derive(Debug, Clone)]
pub struct End {
    /// The parameters.
    pub beta: Vec<f64>,
    /// `fᵀf`.
    pub cost: f64,
    /// χ² per equation at the assumed noise; infinite where a gain has collapsed.
    pub score: f64,
    /// True where a joint is beyond its limits: another assembly of the mechanism.
    pub elsewhere: bool,
}

impl End {
    /// True for χ² per equation below `limit` with every joint within its limits.
    pub(crate) fn good(&self, limit: f64) -> bool {
        self.score < limit && !self.elsewhere
    }

    /// True for the better of two ends: a good end is better than one that is not, else the lower χ²
    /// is better.
    pub(crate) fn beats(&self, other: &Self, limit: f64) -> bool {
        match (self.good(limit), other.good(limit)) {
            (true, false) => true,
            (false, true) => false,
            _ => self.score < other.score,
        }
    }
}

impl<'a> StartSearch<'a> {
    /// The search on some of the samples, spread evenly over the poses.
    #[must_use]
    pub fn new(observations: &'a Observations, model: &'a Model, noise: &Noise) -> Self {
        let all = &observations.readings;
        let rows = match all.held {
            true => spread(&all.rows_of_poses(), SAMPLES),
            false => thin::spread(all.samples, SAMPLES).collect(),
        };
        let few = || all.some(&observations.mechanism, &rows).ok();
        let (readings, weights) = match (rows.len() < all.samples).then(few).flatten() {
            Some(few) => (few.into(), rows.iter().map(|&r| observations.weights[r]).collect()),
            None => (all.clone(), observations.weights.clone()),
        };
        Self {
            observations,
            model,
            readings,
            weights,
            noise: noise.clone(),
            priors: observations.priors(model),
            options: lm::SolverOptions {
                max_iterations: 60,
                xtol: 1e-8,
                ..observations.options.lm.clone()
            },
            anchors: observations
                .anchors()
                .into_iter()
                .map(|anchor| {
                    let tied = Tied::new(observations, model, &anchor);
                    (anchor, tied)
                })
                .collect(),
        }
    }

    /// Equations of the samples that the search uses.
    pub(crate) fn equations(&self) -> f64 {
        self.model.told_by(&self.readings, &self.weights) as f64
    }

    /// A start with better gains than `factors`: the maximum-likelihood fit with offsets tied to an
    /// anchor. The weights of that fit keep the gains away from zero.
    pub(crate) fn better(
        &self,
        (anchor, tied): &(Anchor, Option<Tied>),
        factors: &[f64],
    ) -> Vec<f64> {
        let start = about(anchor, self.model, factors);
        let Some(Tied { model, priors }) = tied else { return start };
        let part = Part { model, readings: &self.readings, weights: Some(&self.weights) };
        let sigma = self.noise.sigma.iter().map(|s| LOOSE * s).collect();
        let noise = Noise { sigma, play: LOOSE * LOOSE * self.noise.play, ..self.noise.clone() };
        let options = lm::SolverOptions { xtol: 1e-4, ..self.options.clone() };
        let problem = Implicit::new(vec![(part, noise)], priors);
        let tied = lm::minimize(&problem, &moved(&start, self.model, model), &options);
        moved(&tied.x, model, self.model)
    }

    /// The algebraic fit from the parameters `start`, with these readings, and one weight per sample.
    #[must_use]
    pub fn end_with(&self, readings: &Readings, weights: &[f64], start: &[f64]) -> End {
        let part = Part { model: self.model, readings, weights: Some(weights) };
        let outcome = lm::minimize(&Algebraic::new(part, &self.priors), start, &self.options);
        let score = if collapsed(self.model, &outcome.x) {
            f64::INFINITY
        } else {
            let told = self.model.told_by(readings, weights);
            let implicit = Implicit::of(part, self.noise.clone());
            let chi2 = 2.0 * implicit.linearize(&outcome.x).cost;
            let score = chi2 / told as f64;
            if score.is_finite() { score } else { f64::INFINITY }
        };
        let mut beta = outcome.x;
        let elsewhere = self.turn_back(&mut beta);
        End { cost: 2.0 * outcome.cost, beta, score, elsewhere }
    }

    /// The maximum-likelihood fit from the parameters `start`, by way of fits (55) whose equations may
    /// err by as much as they do there, and then by a tenth of that, and so on.
    ///
    /// Equations that say almost the same, such as the six distances between four points of one
    /// plane, leave a combination that noise hardly moves: its weight is large, and its misclosure
    /// is of second order in the parameters. From a start that is not near, the fit ends anywhere.
    pub(crate) fn eased(&self, start: &[f64]) -> End {
        let part =
            Part { model: self.model, readings: &self.readings, weights: Some(&self.weights) };
        let mut slack = part.mean_squares(start);
        let mut beta = start.to_vec();
        for _ in 0..EASED {
            let problem = Implicit::new(vec![(part, self.noise.clone())], &self.priors);
            beta = lm::minimize(&problem.eased(&slack), &beta, &self.options).x;
            slack.iter_mut().for_each(|s| *s *= EASIER);
        }
        self.end_knowing(&self.readings, &self.weights, None, &beta)
    }

    /// True where gains are unknown and all of them have priors: then knowledge can judge few poses.
    pub(crate) fn knows(&self) -> bool {
        let gain = |c: usize| self.model.column(Role::Gain, c);
        let mut gains = (0..self.model.scales.len()).filter_map(gain).peekable();
        gains.peek().is_some() && gains.all(|column| has_prior(&self.priors, column))
    }

    /// Equations beside those of the readings: priors, and those of a rest pose that is held.
    pub(crate) fn knowledge(&self) -> usize {
        let held = self.observations.held.as_ref();
        self.priors.len() + held.map_or(0, |held| self.at_rest(held).map_or(0, |m| m.equations()))
    }

    fn at_rest(&self, (mechanism, readings): &(Mechanism, Readings)) -> Option<Model> {
        Model::like(self.model, mechanism, readings).ok()
    }

    /// The maximum-likelihood fit from the parameters `start`, with one weight per sample, with
    /// priors and the rest pose `held`. The score counts these among the equations.
    pub(crate) fn end_knowing(
        &self,
        readings: &Readings,
        weights: &[f64],
        held: Option<&(Mechanism, Readings)>,
        start: &[f64],
    ) -> End {
        let part = Part { model: self.model, readings, weights: Some(weights) };
        let rest = held.and_then(|held| Some((self.at_rest(held)?, &held.1)));
        let mut parts = vec![(part, self.noise.clone())];
        if let Some((model, readings)) = &rest {
            parts.push((Part { model, readings, weights: None }, self.noise.clone()));
        }
        let problem = Implicit::new(parts, &self.priors);
        let outcome = lm::minimize(&problem, start, &self.options);
        let equations = part.model.told_by(part.readings, weights) + self.knowledge();
        let chi2 = 2.0 * outcome.cost;
        let lost = collapsed(self.model, &outcome.x) || !chi2.is_finite();
        let score = if lost { f64::INFINITY } else { chi2 / equations as f64 };
        let mut beta = outcome.x;
        let elsewhere = self.turn_back(&mut beta);
        End { cost: chi2, beta, score, elsewhere }
    }

    /// Removes whole turns from the joint angles. True where a joint at its mean reading is still
    /// beyond its limits.
    fn turn_back(&self, beta: &mut [f64]) -> bool {
        let Self { observations, model, .. } = self;
        let mut elsewhere = false;
        for (c, scale) in model.scales.iter().enumerate() {
            let limits = observations.mechanism.channels[c].limits;
            let (Some([low, high]), Some(column)) = (limits, model.column(Role::Offset, c)) else {
                continue;
            };
            let gain = scale.gain + model.column(Role::Gain, c).map_or(0.0, |column| beta[column]);
            let mean = observations.readings.mean[c];
            let angle = |offset: f64| scale.angle + offset + gain * (mean - scale.centre);
            if observations.mechanism.turns(c) {
                let off = angle(beta[column]) - 0.5 * (low + high);
                beta[column] -= TAU * (off / TAU).round();
            }
            let angle = angle(beta[column]);
            elsewhere |= angle < low || angle > high;
        }
        elsewhere
    }

    /// The algebraic fit from the parameters `start`; the score of a reversed gain is infinite.
    #[must_use]
    pub fn end(&self, start: &[f64]) -> End {
        let end = self.end_with(&self.readings, &self.weights, start);
        let reversed = ratios(self.model, &end.beta).any(|ratio| ratio < 0.0);
        End { score: if reversed { f64::INFINITY } else { end.score }, ..end }
    }
}

/// Fits on the way to a start by which equations become stricter.
const EASED: usize = 4;

/// Factor on the variance that equations are allowed, from one of these fits to the next.
const EASIER: f64 = 0.01;

/// About `most` rows, spread evenly over the poses.
fn spread(poses: &[Vec<usize>], most: usize) -> Vec<usize> {
    let each = (most / poses.len().max(1)).max(1);
    let of = |rows: &Vec<usize>| {
        let step = rows.len().div_ceil(each).max(1);
        rows.iter().copied().step_by(step).collect::<Vec<_>>()
    };
    let mut rows: Vec<usize> =
        thin::spread(poses.len(), most).flat_map(|pose| of(&poses[pose])).collect();
    rows.sort_unstable();
    rows
}

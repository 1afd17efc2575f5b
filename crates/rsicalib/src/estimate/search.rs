//! Where to start, and how many times.
//!
//! At gain zero the algebraic misclosure of any assembled pose vanishes, and
//! that trivial solution attracts (section IV-B of the paper). Two things keep
//! the search away from it: offsets are anchored on the one pose that is known,
//! `θ_off = θ_rest - k a_rest`, so that a wrong gain swings each joint about the
//! rest pose and not about count zero; and a solution in which a joint hardly
//! moves any more is recognised and left for another start. Which start was right is told
//! by the weighted χ², which grows without bound as a gain goes to zero. That χ² finds
//! the gains, too, while offsets are tied to the anchor, where the first start did not.
//! Without a reading of the rest pose there are several anchors, each in turn. A mechanism
//! may close in other assemblies as well: those beyond its joint limits come last.

use std::f64::consts::TAU;

use crate::estimate::algebraic::Algebraic;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::{Anchor, Observations};
use crate::model::{Model, Prior};
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::readings::{Readings, rows_of};
use crate::terms::term::Role;

/// Fraction of its nominal gain below which a channel has collapsed.
const COLLAPSED: f64 = 0.05;

/// Parameters that give every channel `factor` times its nominal gain, about
/// the best anchor of the session.
#[must_use]
pub fn anchored(observations: &Observations, model: &Model, factors: &[f64]) -> Vec<f64> {
    let best = observations.anchors().into_iter().next();
    best.map_or_else(|| model.nominal(), |anchor| about(&anchor, model, factors))
}

/// The same about this anchor.
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

/// Ratio of every gain to its nominal value.
pub fn ratios(model: &Model, beta: &[f64]) -> impl Iterator<Item = f64> {
    model.scales.iter().enumerate().map(|(c, scale)| {
        let gain =
            model.column(Role::Gain, c).map_or(scale.gain, |column| scale.gain + beta[column]);
        gain / scale.gain
    })
}

/// True where some joint hardly moves any more.
#[must_use]
pub fn collapsed(model: &Model, beta: &[f64]) -> bool {
    ratios(model, beta).any(|ratio| ratio.abs() < COLLAPSED)
}

/// Samples that a search of starts looks at.
const SAMPLES: usize = 150;

/// How firmly offsets are tied to a reading of the rest pose, and to where the
/// nominal sensors have it [rad].
const TIED: [f64; 2] = [0.02, 0.1];

/// Noise is taken for so many times larger while offsets are tied, so that they are.
const LOOSE: f64 = 30.0;

/// Readings among which a start is sought.
#[derive(Debug)]
pub struct StartSearch<'a> {
    /// Whose start it is.
    pub observations: &'a Observations,
    /// The model.
    pub model: &'a Model,
    /// Some of its samples.
    pub readings: Readings,
    /// How much each counts.
    pub weights: Vec<f64>,
    noise: Noise,
    priors: Vec<Prior>,
    options: lm::SolverOptions,
    pub(crate) anchors: Vec<(Anchor, Option<Tied>)>,
}

/// The same model with offsets at the anchor, where they can be held while gains are sought.
#[derive(Debug)]
pub(crate) struct Tied {
    model: Model,
    priors: Vec<Prior>,
}

impl Tied {
    fn new(observations: &Observations, model: &Model, anchor: &Anchor) -> Option<Self> {
        let (at, angles): (Vec<f64>, Vec<f64>) = anchor.at.iter().copied().unzip();
        let instances = model.instances.clone();
        let model =
            Model::about(&observations.mechanism, &observations.readings, instances, &at).ok()?;
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

/// Parameters of a model in those of one that differs in where offsets are told.
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

/// Where one start led.
#[derive(Debug, Clone)]
pub struct End {
    /// The parameters.
    pub beta: Vec<f64>,
    /// `fᵀf`.
    pub cost: f64,
    /// χ² per equation at the presumed noise; infinite where a joint stopped moving.
    pub score: f64,
    /// True where some joint would move beyond its limits: another way of assembly.
    pub elsewhere: bool,
}

impl End {
    /// True where every joint keeps within its limits and χ² per equation below `limit`.
    pub(crate) fn good(&self, limit: f64) -> bool {
        self.score < limit && !self.elsewhere
    }

    /// True where it beats another end: a good one before others, then by χ².
    pub(crate) fn beats(&self, other: &Self, limit: f64) -> bool {
        match (self.good(limit), other.good(limit)) {
            (true, false) => true,
            (false, true) => false,
            _ => self.score < other.score,
        }
    }
}

impl<'a> StartSearch<'a> {
    /// Among some of a session's samples, spread evenly over its poses.
    #[must_use]
    pub fn new(observations: &'a Observations, model: &'a Model, noise: &Noise) -> Self {
        let all = &observations.readings;
        let rows = spread(&all.rows_of_poses(), SAMPLES);
        let few = || {
            Readings::beside(&observations.mechanism, rows_of(&all.table, all.channels, &rows), all)
                .ok()
        };
        let (readings, weights) = match (rows.len() < all.samples).then(few).flatten() {
            Some(few) => (few, rows.iter().map(|&r| observations.weights[r]).collect()),
            None => (all.clone(), observations.weights.clone()),
        };
        Self {
            observations,
            model,
            readings,
            weights,
            noise: noise.clone(),
            priors: model.priors(),
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

    /// A start with better gains than these: the maximum-likelihood fit while offsets are
    /// tied to an anchor. Its weights keep gains from zero, the ties from wandering.
    pub(crate) fn better(
        &self,
        (anchor, tied): &(Anchor, Option<Tied>),
        factors: &[f64],
    ) -> Vec<f64> {
        let start = about(anchor, self.model, factors);
        let Some(Tied { model, priors }) = tied else { return start };
        let part = Part { model, readings: &self.readings, weights: Some(&self.weights) };
        let sigma = self.noise.sigma.iter().map(|s| LOOSE * s).collect();
        let noise = Noise { sigma, play: LOOSE * LOOSE * self.noise.play };
        let options = lm::SolverOptions { xtol: 1e-4, ..self.options.clone() };
        let problem = Implicit::new(vec![(part, noise)], priors);
        let tied = lm::minimize(&problem, &moved(&start, self.model, model), &options);
        moved(&tied.x, model, self.model)
    }

    /// The algebraic fit from parameters `start`, with other readings or weights.
    #[must_use]
    pub fn end_with(&self, readings: &Readings, weights: &[f64], start: &[f64]) -> End {
        let part = Part { model: self.model, readings, weights: Some(weights) };
        let outcome = lm::minimize(&Algebraic::new(part, &self.priors), start, &self.options);
        let score = if collapsed(self.model, &outcome.x) {
            f64::INFINITY
        } else {
            let live = weights.iter().filter(|w| **w > 0.0).count();
            let implicit = Implicit::new(vec![(part, self.noise.clone())], &[]);
            let chi2 = 2.0 * implicit.linearize(&outcome.x).cost;
            let score = chi2 / (self.model.equations() * live) as f64;
            if score.is_finite() { score } else { f64::INFINITY }
        };
        let mut beta = outcome.x;
        let elsewhere = self.turn_back(&mut beta);
        End { cost: 2.0 * outcome.cost, beta, score, elsewhere }
    }

    /// Takes whole turns off the joint angles; true where one is beyond its limits
    /// even so, at the mean reading.
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

    /// The algebraic fit from parameters `start`; a reversed gain is no answer.
    #[must_use]
    pub fn end(&self, start: &[f64]) -> End {
        let end = self.end_with(&self.readings, &self.weights, start);
        let reversed = ratios(self.model, &end.beta).any(|ratio| ratio < 0.0);
        End { score: if reversed { f64::INFINITY } else { end.score }, ..end }
    }
}

/// About so many rows, spread evenly over the poses.
fn spread(poses: &[Vec<usize>], most: usize) -> Vec<usize> {
    let stride = poses.len().div_ceil(most).max(1);
    let each = (most / poses.len().max(1)).max(1);
    let of = |rows: &Vec<usize>| {
        let step = rows.len().div_ceil(each).max(1);
        rows.iter().copied().step_by(step).collect::<Vec<_>>()
    };
    let mut rows: Vec<usize> = poses.iter().step_by(stride).flat_map(of).collect();
    rows.sort_unstable();
    rows
}

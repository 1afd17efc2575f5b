//! Scores of what moved once: the base of a chain, the tool at its end, a distance; and sums of what happened
//! once to a sensor, for [its time](super::times).
//!
//! Each term, chain and time is one candidate of several columns: those of a body that is
//! displaced in all samples, from one pose on. Running sums score all times, (71) and (72).

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::scored::{Family, Judge, MOST_TIMES, Scored};
use crate::estimate::at_fit::AtFit;
use crate::estimate::{Fit, Implicit, Observations, Part, carry_over};
use crate::mechanism::{Mechanism, Target};
use crate::model::{Instance, Thing};
use crate::screening::steps::{Fitted, SIDE, StepScore, StepSums};
use crate::terms;
use crate::terms::targets::{searchable, targets_in};
use crate::terms::term::{Acts, Placed, Spot, Term};

/// Equations on either side of a move for each of its columns: of fewer, a few wrong readings look
/// like a move.
const EQUATIONS: usize = 3;

/// True for terms of a body that moved once.
fn moves_once(term: &dyn Term) -> bool {
    term.placed() == Placed::AtPose
        && matches!(
            term.acts(),
            Acts::Geometry(_)
                | Acts::Distance
                | Acts::Surface(_)
                | Acts::End
                | Acts::Attachment
                | Acts::Instrument(_)
        )
}

/// False where a move changes no reading, or would pass for another: a point that closes a loop is
/// no tool in a clamp, and the base of a chain that nothing ties to it moves as the one thing does that the chain touches.
fn meaningful(mechanism: &Mechanism, fit: &Fit, term: &dyn Term) -> bool {
    let unknowns = &fit.model.unknowns;
    if term.moves_tool() {
        return !unknowns.is_empty();
    }
    let stands = |thing: Thing| match thing {
        Thing::Point(p) => mechanism.points[p].chain.is_none(),
        _ => true,
    };
    let touched = unknowns.iter().filter(|unknown| stands(unknown.thing)).count();
    !term.moves_only(&[Spot::Base, Spot::Root]) || !mechanism.floats() || touched > 1
}

/// Every body that may have moved once, displaced in all samples: before the first pose.
pub struct Bodies<'a> {
    at: &'a AtFit<'a>,
    bodies: Vec<Instance>,
    /// `Z` of all of them, equation by equation.
    z: Vec<f64>,
    /// The column of each body's first parameter.
    first: Vec<usize>,
    /// Columns of all of them.
    columns: usize,
}

impl<'a> Bodies<'a> {
    /// All of a mechanism's that a search looks for.
    ///
    /// # Errors
    ///
    /// As [`Observations::model`].
    pub fn new(at: &'a AtFit<'a>, search: &SearchOptions) -> Result<Self, Error> {
        let AtFit { observations, fit, .. } = at;
        let (mechanism, readings) = (&observations.mechanism, &observations.readings);
        let tried = |term: &&&'static dyn Term| {
            moves_once(**term)
                && !search.without.iter().any(|id| id == term.info().id)
                && meaningful(mechanism, fit, **term)
                && searchable(**term, mechanism, readings).is_ok()
        };
        let all = terms::all(mechanism);
        let of = |&term: &&'static dyn Term| {
            let targets = targets_in(term, mechanism, readings).into_iter();
            targets.map(move |target| Instance { term, target, place: 0 })
        };
        Self::of(at, all.iter().filter(tried).flat_map(of).collect())
    }

    /// These bodies, wherever they moved.
    ///
    /// # Errors
    ///
    /// As [`Observations::model`].
    pub fn of(at: &'a AtFit<'a>, mut bodies: Vec<Instance>) -> Result<Self, Error> {
        let Observations { readings, weights, .. } = at.observations;
        bodies.iter_mut().for_each(|body| body.place = 0);
        if bodies.is_empty() {
            return Ok(Self { at, bodies, z: Vec::new(), first: Vec::new(), columns: 0 });
        }
        let (fit, base) = (at.fit, at.fit.model.term_parameters);
        let model = at.observations.model_beside(&fit.model, &bodies)?;
        let extra = model.term_parameters - base;
        let beta = carry_over(fit, &model);
        let part = Part { model: &model, readings, weights: Some(weights) };
        let problem =
            Implicit::of(part, fit.assumed()).from(fit.adjusted_of(readings).map(<[_]>::to_vec));
        let residuals = problem.residuals(&beta, true);
        let first = model.first[fit.model.instances.len()..].iter().map(|c| c - base).collect();
        let rows = residuals.by_parameter.chunks_exact(model.parameters);
        let z = rows.flat_map(|x| x[base..base + extra].iter().copied()).collect();
        Ok(Self { at, bodies, z, first, columns: extra })
    }

    /// The score of each of them at each of the poses that are tried.
    pub fn score(&self, judge: &Judge) -> Vec<Scored> {
        let all: Vec<_> = (0..self.bodies.len()).flat_map(|body| self.moves(body)).collect();
        let tests = all.len() as f64;
        let of = |(instance, StepScore { score, rank, .. }, told): (Instance, StepScore, f64)| {
            let width = rank as f64;
            let p_value = judge.p_value(score, width);
            let one = Scored::of(instance, Family::Moved, score, width, p_value, tests);
            one.told_in(told)
        };
        all.into_iter().map(of).collect()
    }

    /// One body's moves, each with its score and the directions that the rows tell of it.
    fn moves(&self, body: usize) -> Vec<(Instance, StepScore, f64)> {
        let Instance { term, target, .. } = self.bodies[body];
        let typical = self.at.fit.model.typical_at(term, target);
        let mut found = Vec::new();
        self.each_time(body, |instance, sums| {
            let Some(scored) = sums.score(&self.at.pull) else { return };
            let told = sums.directions(&typical, &self.at.pull, &scored);
            found.push((instance, scored, told));
        });
        found
    }

    /// The pose from which on a body is likelier to have moved than from that which the fit has, (159).
    pub(super) fn likelier(&self, body: usize, own: &Fitted) -> Option<Instance> {
        let mut best = (0.0, None);
        self.each_time(body, |instance, sums| {
            let rises = sums.in_place_of(own, &self.at.pull).unwrap_or(0.0);
            if rises < best.0 {
                best = (rises, Some(instance));
            }
        });
        best.1
    }

    /// Goes through the poses from which on a body may have moved, with the sums from there on.
    fn each_time(&self, body: usize, mut visit: impl FnMut(Instance, &StepSums)) {
        let Observations { readings, weights, .. } = self.at.observations;
        let (extra, first) = (self.bodies[body].width(), self.first[body]);
        // What moves at a closure shows in its equations alone.
        let (model, mechanism) = (&self.at.fit.model, &self.at.observations.mechanism);
        let own = mechanism.closures_of(self.bodies[body].target);
        let own: usize = own.map(|closure| model.equations_of(closure)).sum();
        let k = if own > 0 { own } else { self.at.residuals.equations };
        let poses = readings.rows_of_poses();
        let counts = |row: &&usize| weights[**row] > 0.0;
        // Poses that do not touch a place say nothing of when it moved.
        let sees = |row: usize| {
            let touches = |e: usize| {
                let z = &self.z[e * self.columns + first..][..extra];
                z.iter().any(|z| *z != 0.0)
            };
            !matches!(self.bodies[body].target, Target::Place(_))
                || self.at.equations(row).any(touches)
        };
        let live = |p: &usize| poses[*p].iter().any(|row| counts(&row) && sees(*row));
        let live: Vec<usize> = (0..poses.len()).filter(live).collect();
        let stride = live.len().div_ceil(MOST_TIMES).max(1);
        let side = SIDE.max((EQUATIONS * extra).div_ceil(k));
        let mut sums = StepSums::new(self.at.rank(), extra);
        for (order, &pose) in live.iter().enumerate().rev() {
            for e in poses[pose].iter().filter(counts).flat_map(|&row| self.at.equations(row)) {
                let z = &self.z[e * self.columns + first..][..extra];
                sums.add(self.at.q(e), z, self.at.residuals.whitened[e]);
            }
            let both_sides = order >= side && live.len() - order >= side;
            let instance = Instance { place: pose, ..self.bodies[body] };
            if both_sides && order % stride == 0 && !self.at.fit.model.instances.contains(&instance)
            {
                visit(instance, &sums);
            }
        }
    }
}

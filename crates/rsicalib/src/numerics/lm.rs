//! Levenberg-Marquardt.
//!
//! Minimises `½‖r(x)‖²`. Each iteration solves
//!
//! ```text
//! (JᵀJ + λ D²) s = -Jᵀr                                                   (31)
//! ρ = (c(x) - c(x + s)) / (½ λ ‖D s‖² - ½ gᵀs)                            (32)
//! ```
//!
//! | symbol | here | |
//! |---|---|---|
//! | c | `cost` | `½‖r‖²` |
//! | g | `gradient` | `Jᵀr` |
//! | λ | `damping` | keeps `‖D s‖` within the radius |
//! | D | `scale` | largest norm of each column of J so far, Moré (1978) |
//! | ρ | `ratio` | decrease of the cost over the decrease that the linear model predicts |
//! | Δ | `radius` | radius of the region in which the linear model is trusted, Moré (1978) |
//!
//! A problem gives its linearisation either as a triangular factor of `J`
//! ([`Factor`](crate::numerics::linearization::Curvature::Factor), for accuracy) or as `JᵀJ`
//! ([`Gram`](crate::numerics::linearization::Curvature::Gram), in
//! one pass over the data and O(n²) memory).

use crate::numerics::linearization::{Linearization, Problem};

/// Tolerances of the solver, and length of its first step.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverOptions {
    /// Stop when the cosine between residual and every column of `J` is below this.
    pub gtol: f64,
    /// Stop when `‖D s‖` is below this fraction of `‖D x‖`.
    pub xtol: f64,
    /// Stop when actual and predicted decrease are both below this fraction of the cost.
    pub ftol: f64,
    /// Stop where a full step promises to lower the cost by less than this, in units of the cost; it
    /// is not taken.
    pub ptol: f64,
    /// Longest first step, in multiples of `‖D x‖`, or of 1, the noise, where that is larger.
    pub reach: f64,
    /// Largest number of linearisations.
    pub max_iterations: usize,
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self { gtol: 1e-12, xtol: 1e-12, ftol: 1e-15, ptol: 0.0, reach: 100.0, max_iterations: 200 }
    }
}

/// Reason for the end of the iteration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Termination {
    /// The gradient vanished.
    Gradient,
    /// The step became smaller than rounding of the parameters.
    Step,
    /// The cost no longer decreases.
    Cost,
    /// No step, however short, decreases the cost: a minimum to rounding.
    Stalled,
    /// The number of linearisations reached its maximum.
    MaxIterations,
    /// The residual is not a number at the start.
    NotFinite,
}

impl Termination {
    /// True for an end at a minimum.
    #[must_use]
    pub fn converged(self) -> bool {
        !matches!(self, Self::MaxIterations | Self::NotFinite)
    }
}

/// End of the iteration.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Outcome {
    /// The parameters.
    pub x: Vec<f64>,
    /// `½‖r‖²` there.
    pub cost: f64,
    /// Number of linearisations.
    pub iterations: usize,
    /// Reason for the end.
    pub termination: Termination,
    /// The problem at `x`, or one step within the tolerance before it.
    pub linearization: Linearization,
}

/// Minimises `½‖r(x)‖²` from `start`, which holds one number per parameter of the problem.
pub fn minimize(
    problem: &(impl Problem + ?Sized),
    start: &[f64],
    options: &SolverOptions,
) -> Outcome {
    let mut x = start.to_vec();
    let mut here = problem.linearize(&x);
    let mut scale = vec![0.0; x.len()];
    let end = |x, here: Linearization, iterations, termination| Outcome {
        x,
        cost: here.cost,
        iterations,
        termination,
        linearization: here,
    };
    if !here.cost.is_finite() {
        return end(x, here, 0, Termination::NotFinite);
    }
    let mut norms = Vec::new();
    here.column_norms_in(&mut norms);
    grow(&mut scale, &norms);
    // Parameters that are smaller than the noise, of a start that is the drawing itself or an optimum, say nothing
    // of how far to step.
    let mut radius = options.reach * weighted_norm(&x, &scale).max(1.0);

    let mut spare = None;
    let mut ahead = None; // the full step from `here`, where it is known
    for iteration in 1..=options.max_iterations {
        if is_stationary(&here, &norms, options.gtol) {
            return end(x, here, iteration, Termination::Gradient);
        }
        let Some((damping, step)) = step_within(&here, &scale, radius, ahead.take()) else {
            return end(x, here, iteration, Termination::Stalled);
        };
        let length = weighted_norm(&step, &scale);
        let size = weighted_norm(&x, &scale);
        let trial = problem.moved(&x, &step);
        if damping == NEGLIGIBLE && length <= options.xtol * size {
            // So short a step changes neither cost nor derivatives: they are not computed again.
            return end(trial, here, iteration, Termination::Step);
        }
        let promised = promise(&here, &step, damping, &scale);
        if damping == NEGLIGIBLE && promised < options.ptol {
            return end(x, here, iteration, Termination::Cost);
        }
        if iteration == 1 {
            radius = radius.min(length);
        }
        let there = problem.linearize_in(&trial, spare.take());
        let gained = here.cost - there.cost;
        // Near the minimum the decrease of the cost is below its rounding; the gradient is not.
        let least = NEAR * here.cost;
        let near = damping == NEGLIGIBLE && promised <= least && gained.abs() <= least;
        let ratio = if !near {
            gained / promised // (32)
        } else {
            let next = there.damped_step(NEGLIGIBLE, &scale);
            let more = next.as_ref().map(|next| promise(&there, next, NEGLIGIBLE, &scale));
            if !more.is_some_and(|more| more < promised) {
                return end(x, here, iteration, Termination::Stalled);
            }
            ahead = next;
            1.0
        };

        let flat = gained.abs() <= options.ftol * here.cost && promised <= options.ftol * here.cost;
        if ratio > 0.25 {
            if ratio > 0.75 || damping == NEGLIGIBLE {
                radius = 2.0 * length;
            }
        } else {
            radius = shrink(&here, &step, gained) * radius.min(10.0 * length); // also for a NaN
        }
        if ratio > 1e-4 {
            x = trial;
            spare = Some(std::mem::replace(&mut here, there));
            here.column_norms_in(&mut norms);
            grow(&mut scale, &norms);
        } else {
            spare = Some(there);
        }
        if radius <= options.xtol * size {
            return end(x, here, iteration, Termination::Step);
        }
        if flat {
            return end(x, here, iteration, Termination::Cost);
        }
    }
    end(x, here, options.max_iterations, Termination::MaxIterations)
}

/// Below this fraction of the cost, rounding may hide the decrease of a full step.
const NEAR: f64 = 1e-8;

/// Norm of the gradient in unit columns.
fn steepness(here: &Linearization, scale: &[f64]) -> f64 {
    here.gradient.iter().zip(scale).map(|(g, s)| (g / s).powi(2)).sum::<f64>().sqrt()
}

/// A damping that changes no digit of a step.
const NEGLIGIBLE: f64 = f64::EPSILON * f64::EPSILON;

/// The step of (31) with `‖D s‖` equal to the radius, to 3 %; the full step where it is shorter.
///
/// `1/‖D s‖` is nearly linear in λ (Hebden), so a few secant steps find λ.
fn step_within(
    here: &Linearization,
    scale: &[f64],
    radius: f64,
    full: Option<Vec<f64>>,
) -> Option<(f64, Vec<f64>)> {
    let measured = |step: Vec<f64>| {
        let length = weighted_norm(&step, scale);
        (step, length)
    };
    let solve = |damping: f64| here.damped_step(damping, scale).map(measured);
    // The ends of the bracket: a damping with too long a step, and one with a short enough step.
    let mut low = match full.map(measured).or_else(|| solve(NEGLIGIBLE)) {
        Some((step, length)) if length <= 1.1 * radius => return Some((NEGLIGIBLE, step)),
        Some((_, length)) => (0.0, 1.0 / length),
        None => (0.0, 0.0),
    };
    let mut high = (steepness(here, scale) / radius, f64::INFINITY);
    let mut damping = (1e-3 * high.0).max(low.0);
    for _ in 0..60 {
        match solve(damping) {
            Some((step, length)) if (length / radius - 1.0).abs() < 0.03 => {
                return Some((damping, step));
            }
            Some((_, length)) if length < radius => high = (damping, 1.0 / length),
            Some((_, length)) => low = (damping, 1.0 / length),
            None => low = (damping, 0.0),
        }
        let secant = low.0 + (high.0 - low.0) * (1.0 / radius - low.1) / (high.1 - low.1);
        let floor = low.0.max(1e-3 * high.0);
        damping = if high.1.is_finite() && secant > 1.001 * floor && secant < 0.999 * high.0 {
            secant
        } else {
            (floor * high.0).sqrt()
        };
    }
    solve(high.0).map(|(step, _)| (high.0, step))
}

/// Factor on the radius after a step with too small a decrease.
fn shrink(here: &Linearization, step: &[f64], gained: f64) -> f64 {
    let slope: f64 = here.gradient.iter().zip(step).map(|(g, s)| g * s).sum();
    if gained >= 0.0 {
        0.5
    } else if -gained < 99.0 * here.cost {
        (0.5 * slope / (slope + gained)).clamp(0.1, 0.5)
    } else {
        0.1
    }
}

/// Moré's scaling: the largest norm of each column so far.
fn grow(scale: &mut [f64], norms: &[f64]) {
    for (s, norm) in scale.iter_mut().zip(norms) {
        *s = s.max(*norm);
        if *s == 0.0 {
            *s = 1.0; // a column of zeros: its parameter does not move
        }
    }
}

/// True where the residual is orthogonal to every column.
fn is_stationary(here: &Linearization, norms: &[f64], gtol: f64) -> bool {
    let norm = (2.0 * here.cost).sqrt();
    here.gradient.iter().zip(norms).all(|(g, c)| g.abs() <= gtol * norm * c)
}

/// Decrease of the linear model: the denominator of (32).
fn promise(here: &Linearization, step: &[f64], damping: f64, scale: &[f64]) -> f64 {
    let descent: f64 = here.gradient.iter().zip(step).map(|(g, s)| g * s).sum();
    0.5 * (damping * weighted_norm(step, scale).powi(2) - descent)
}

fn weighted_norm(x: &[f64], scale: &[f64]) -> f64 {
    x.iter().zip(scale).map(|(x, s)| (x * s).powi(2)).sum::<f64>().sqrt()
}

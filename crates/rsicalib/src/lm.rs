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
//! | D | `scale` | largest norm that each column of J has had, Moré (1978) |
//! | ρ | `ratio` | what was gained over what the linear model promised |
//! | Δ | `radius` | of the region in which the linear model is trusted, Moré (1978) |
//!
//! A problem gives its linearisation either as a triangular factor of `J`
//! ([`Curvature::Factor`], for accuracy) or as `JᵀJ` ([`Curvature::Gram`], in
//! one pass over the data and O(n²) memory).

use faer::linalg::solvers::{Llt, Qr, Solve};
use faer::{Mat, Side};

use crate::arrow;
use crate::lanes::dispatch;

/// A least-squares problem.
pub trait Problem {
    /// Number of parameters.
    fn parameters(&self) -> usize;

    /// Cost, gradient and curvature at `x`; a cost that is not finite where the
    /// residual is not defined.
    fn linearize(&self, x: &[f64]) -> Linearization;
}

/// A problem at one point.
#[derive(Debug, Clone)]
pub struct Linearization {
    /// `½‖r‖²`
    pub cost: f64,
    /// `Jᵀr`
    pub gradient: Vec<f64>,
    /// `JᵀJ`, in one of two forms.
    pub curvature: Curvature,
    /// Parameters after all others that meet these only within an island, which is
    /// eliminated first; of `JᵀJ` only.
    pub islands: Vec<Vec<usize>>,
}

/// `JᵀJ`, or a factor of it.
#[derive(Debug, Clone)]
pub enum Curvature {
    /// `JᵀJ`, full.
    Gram(Mat<f64>),
    /// `R` with `RᵀR = JᵀJ`, and `Qᵀr`.
    Factor(Mat<f64>, Vec<f64>),
}

impl Linearization {
    /// Norm of each column of `J`.
    #[must_use]
    pub fn column_norms(&self) -> Vec<f64> {
        let n = self.gradient.len();
        match &self.curvature {
            Curvature::Gram(h) => (0..n).map(|j| h[(j, j)].max(0.0).sqrt()).collect(),
            Curvature::Factor(r, _) => (0..n).map(|j| r.col(j).norm_l2()).collect(),
        }
    }

    /// `JᵀJ`.
    #[must_use]
    pub fn gram(&self) -> Mat<f64> {
        match &self.curvature {
            Curvature::Gram(h) => h.clone(),
            Curvature::Factor(r, _) => r.transpose() * r,
        }
    }

    /// `(JᵀJ)⁻¹`; none where it is singular to rounding.
    #[must_use]
    pub fn covariance(&self) -> Option<Mat<f64>> {
        let n = self.gradient.len();
        let norms = self.column_norms();
        let scaled = |m: &Mat<f64>| Mat::from_fn(m.nrows(), n, |i, j| m[(i, j)] / norms[j]);
        let inverse = match &self.curvature {
            Curvature::Gram(h) => {
                let unit = Mat::from_fn(n, n, |i, j| h[(i, j)] / (norms[i] * norms[j]));
                Llt::new(unit.as_ref(), Side::Lower).ok()?.solve(Mat::<f64>::identity(n, n))
            }
            Curvature::Factor(r, _) => {
                let back = scaled(r).svd().ok()?;
                let s = back.S().column_vector();
                if s[n - 1] <= s[0] * f64::EPSILON * n as f64 {
                    return None;
                }
                let v = back.V();
                Mat::from_fn(n, n, |i, j| {
                    (0..n).map(|k| v[(i, k)] * v[(j, k)] / (s[k] * s[k])).sum()
                })
            }
        };
        let inverse = Mat::from_fn(n, n, |i, j| inverse[(i, j)] / (norms[i] * norms[j]));
        (0..n).all(|j| inverse[(j, j)].is_finite()).then_some(inverse)
    }

    /// Solves (31).
    fn damped_step(&self, damping: f64, scale: &[f64]) -> Option<Vec<f64>> {
        let n = self.gradient.len();
        let step: Vec<f64> = match &self.curvature {
            Curvature::Gram(h) if !self.islands.is_empty() => {
                arrow::solve(h, &self.gradient, damping, scale, &self.islands)?
            }
            Curvature::Gram(h) => solve_damped(h, &self.gradient, damping, scale)?,
            Curvature::Factor(r, qtr) => {
                let stacked = Mat::from_fn(r.nrows() + n, n, |i, j| {
                    if i < r.nrows() {
                        r[(i, j)] / scale[j]
                    } else if i - r.nrows() == j {
                        damping.sqrt()
                    } else {
                        0.0
                    }
                });
                let rhs = Mat::from_fn(
                    r.nrows() + n,
                    1,
                    |i, _| {
                        if i < r.nrows() { -qtr[i] } else { 0.0 }
                    },
                );
                let s = solve_tall(&stacked, &rhs);
                (0..n).map(|i| s[(i, 0)] / scale[i]).collect()
            }
        };
        step.iter().all(|s| s.is_finite()).then_some(step)
    }
}

/// Solves (31) from `JᵀJ` in unit columns; none where it is not positive definite.
fn solve_damped(h: &Mat<f64>, gradient: &[f64], damping: f64, scale: &[f64]) -> Option<Vec<f64>> {
    let n = gradient.len();
    if n > SMALL {
        let unit = |i: usize, j: usize| h[(i, j)] / (scale[i] * scale[j]);
        let damped = Mat::from_fn(n, n, |i, j| unit(i, j) + if i == j { damping } else { 0.0 });
        let factor = Llt::new(damped.as_ref(), Side::Lower).ok()?;
        let s = factor.solve(Mat::from_fn(n, 1, |i, _| -gradient[i] / scale[i]));
        return Some((0..n).map(|i| s[(i, 0)] / scale[i]).collect());
    }
    // Columns of the lower triangle, the right-hand side as one more row below them.
    let rows = n + 1;
    let mut room = [0.0; (SMALL + 1) * SMALL];
    let l = &mut room[..rows * n];
    let mut s: Vec<f64> = scale.iter().map(|s| 1.0 / s).collect();
    for (j, column) in l.chunks_exact_mut(rows).enumerate() {
        let own = &h.col_as_slice(j)[j..];
        for ((value, h), inverse) in column[j..n].iter_mut().zip(own).zip(&s[j..]) {
            *value = h * inverse * s[j];
        }
        column[j] += damping;
        column[n] = -gradient[j] * s[j];
    }
    dispatch(
        #[inline(always)]
        || factor_in_place(l, n),
    )
    .then_some(())?;
    let inverse = std::mem::replace(&mut s, vec![0.0; n]);
    for j in (0..n).rev() {
        let column = &l[j * rows..(j + 1) * rows];
        let known: f64 = column[j + 1..n].iter().zip(&s[j + 1..]).map(|(l, s)| l * s).sum();
        s[j] = (column[n] - known) / column[j];
    }
    s.iter_mut().zip(&inverse).for_each(|(s, inverse)| *s *= inverse);
    Some(s)
}

/// Below this many parameters faer's general Cholesky costs more than the work.
const SMALL: usize = 24;

/// Cholesky of the columns of a lower triangle with one more row, right-looking.
#[expect(clippy::neg_cmp_op_on_partial_ord, reason = "a NaN is no pivot either")]
#[inline(always)]
fn factor_in_place(l: &mut [f64], n: usize) -> bool {
    let rows = n + 1;
    for j in 0..n {
        let (head, tail) = l.split_at_mut((j + 1) * rows);
        let column = &mut head[j * rows..];
        if !(column[j] > 0.0) {
            return false; // a NaN lands here too
        }
        let pivot = 1.0 / column[j].sqrt();
        column[j..].iter_mut().for_each(|v| *v *= pivot);
        for (k, next) in (j + 1..n).zip(tail.chunks_exact_mut(rows)) {
            let factor = column[k];
            for (a, b) in next[k..].iter_mut().zip(&column[k..]) {
                *a -= factor * b;
            }
        }
    }
    true
}

/// Least squares by Householder QR; `a` has full column rank.
fn solve_tall(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    use faer::linalg::solvers::SolveLstsq;
    Qr::new(a.as_ref()).solve_lstsq(b)
}

/// A problem given by its residuals and their Jacobian.
#[derive(Debug, Clone)]
pub struct Dense<R, J> {
    residuals: usize,
    parameters: usize,
    residual: R,
    jacobian: J,
}

impl<R, J> Dense<R, J>
where
    R: Fn(&[f64], &mut [f64]),
    J: Fn(&[f64], &mut [f64]),
{
    /// `m` residuals of `n` parameters; `jacobian` fills `m × n`, column by column.
    pub const fn new(m: usize, n: usize, residual: R, jacobian: J) -> Self {
        Self { residuals: m, parameters: n, residual, jacobian }
    }
}

impl<R, J> Problem for Dense<R, J>
where
    R: Fn(&[f64], &mut [f64]),
    J: Fn(&[f64], &mut [f64]),
{
    fn parameters(&self) -> usize {
        self.parameters
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let (m, n) = (self.residuals, self.parameters);
        let mut r = vec![0.0; m];
        (self.residual)(x, &mut r);
        let cost = 0.5 * r.iter().map(|r| r * r).sum::<f64>();
        let mut j = vec![0.0; m * n];
        (self.jacobian)(x, &mut j);
        let cost = if j.iter().all(|v| v.is_finite()) { cost } else { f64::NAN };
        let gradient: Vec<f64> = j
            .chunks_exact(m)
            .map(|column| column.iter().zip(&r).map(|(j, r)| j * r).sum())
            .collect();
        if !cost.is_finite() {
            let curvature = Curvature::Gram(Mat::zeros(n, n));
            return Linearization { cost, gradient, curvature, islands: Vec::new() };
        }
        let j = Mat::from_fn(m, n, |row, col| j[col * m + row]);
        let qr = Qr::new(j.as_ref());
        let factor = qr.thin_R().to_owned();
        let rhs = Mat::from_fn(m, 1, |i, _| r[i]);
        let qtr = qr.compute_thin_Q().transpose() * rhs;
        let qtr = (0..qtr.nrows()).map(|i| qtr[(i, 0)]).collect();
        let curvature = Curvature::Factor(factor, qtr);
        Linearization { cost, gradient, curvature, islands: Vec::new() }
    }
}

/// When to stop, and how boldly to begin.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Stop when the cosine between residual and every column of `J` is below this.
    pub gtol: f64,
    /// Stop when `‖D s‖` is below this fraction of `‖D x‖`.
    pub xtol: f64,
    /// Stop when actual and predicted decrease are both below this fraction of the cost.
    pub ftol: f64,
    /// Longest first step, in multiples of `‖D x‖`.
    pub reach: f64,
    /// Linearisations to try before giving up.
    pub max_iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { gtol: 1e-12, xtol: 1e-12, ftol: 1e-15, reach: 100.0, max_iterations: 200 }
    }
}

/// Why the search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
    /// The iterations ran out.
    MaxIterations,
    /// The residual is not a number at the start.
    NotFinite,
}

impl Termination {
    /// True where the search ended at a minimum.
    #[must_use]
    pub fn converged(self) -> bool {
        !matches!(self, Self::MaxIterations | Self::NotFinite)
    }

    /// What happened, and what to do next.
    #[must_use]
    pub fn message(self) -> &'static str {
        match self {
            Self::Gradient => "converged: the gradient vanishes",
            Self::Step => "converged: the parameters stand still",
            Self::Cost => "converged: the cost no longer decreases",
            Self::Stalled => "converged to rounding: no step decreases the cost",
            Self::MaxIterations => {
                "the iterations ran out: start nearer, or record poses that determine more"
            }
            Self::NotFinite => "the residual is not a number at the start: check the start",
        }
    }
}

/// Where the search ended.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The parameters.
    pub x: Vec<f64>,
    /// `½‖r‖²` there.
    pub cost: f64,
    /// Linearisations made.
    pub iterations: usize,
    /// Why it ended.
    pub termination: Termination,
    /// The problem there.
    pub linearization: Linearization,
}

/// Minimises `½‖r(x)‖²` from `start`.
pub fn minimize(problem: &impl Problem, start: &[f64], options: &Options) -> Outcome {
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
    grow(&mut scale, &here);
    let mut radius = options.reach * weighted_norm(&x, &scale);
    if radius == 0.0 {
        radius = options.reach;
    }

    for iteration in 1..=options.max_iterations {
        if is_stationary(&here, options.gtol) {
            return end(x, here, iteration, Termination::Gradient);
        }
        let Some((damping, step)) = step_within(&here, &scale, radius) else {
            return end(x, here, iteration, Termination::Stalled);
        };
        let length = weighted_norm(&step, &scale);
        if iteration == 1 {
            radius = radius.min(length);
        }
        let trial: Vec<f64> = x.iter().zip(&step).map(|(x, s)| x + s).collect();
        let there = problem.linearize(&trial);
        let promised = promise(&here, &step, damping, &scale);
        let gained = here.cost - there.cost;
        // Near the minimum the cost tells no step from its own rounding, but the gradient does.
        let near = damping == NEGLIGIBLE && promised.max(gained.abs()) <= NEAR * here.cost;
        let ratio = if !near {
            gained / promised // (32)
        } else if full_promise(&there, &scale) < promised {
            1.0
        } else {
            return end(x, here, iteration, Termination::Stalled);
        };

        let flat = gained.abs() <= options.ftol * here.cost && promised <= options.ftol * here.cost;
        let small = damping == NEGLIGIBLE && length <= options.xtol * weighted_norm(&x, &scale);
        if ratio > 0.25 {
            if ratio > 0.75 || damping == NEGLIGIBLE {
                radius = 2.0 * length;
            }
        } else {
            radius = shrink(&here, &step, gained) * radius.min(10.0 * length); // a NaN lands here
        }
        if ratio > 1e-4 {
            x = trial;
            here = there;
            grow(&mut scale, &here);
        }
        if small || radius <= options.xtol * weighted_norm(&x, &scale) {
            return end(x, here, iteration, Termination::Step);
        }
        if flat {
            return end(x, here, iteration, Termination::Cost);
        }
    }
    end(x, here, options.max_iterations, Termination::MaxIterations)
}

/// Below this fraction of the cost its rounding may hide what a full step gains.
const NEAR: f64 = 1e-8;

/// What the linear model promises of a full step: half the gradient's norm by `(JᵀJ)⁻¹`.
fn full_promise(here: &Linearization, scale: &[f64]) -> f64 {
    let step = here.damped_step(NEGLIGIBLE, scale);
    step.map_or(f64::NAN, |step| promise(here, &step, NEGLIGIBLE, scale))
}

/// Norm of the gradient by unit columns.
fn steepness(here: &Linearization, scale: &[f64]) -> f64 {
    here.gradient.iter().zip(scale).map(|(g, s)| (g / s).powi(2)).sum::<f64>().sqrt()
}

/// A damping that changes no digit of a step.
const NEGLIGIBLE: f64 = f64::EPSILON * f64::EPSILON;

/// The step of (31) whose `‖D s‖` is the radius, to 3 %; the full step if it is inside.
///
/// `1/‖D s‖` is nearly linear in λ (Hebden), which a few secants solve.
fn step_within(here: &Linearization, scale: &[f64], radius: f64) -> Option<(f64, Vec<f64>)> {
    let solve = |damping: f64| {
        let step = here.damped_step(damping, scale)?;
        let length = weighted_norm(&step, scale);
        Some((step, length))
    };
    // The ends of the bracket: too long a step, and one that is short enough.
    let mut low = match solve(NEGLIGIBLE) {
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

/// By how much the radius shrinks after a step that gained too little.
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

/// Moré's scaling: the largest norm that each column has had.
fn grow(scale: &mut [f64], here: &Linearization) {
    for (s, norm) in scale.iter_mut().zip(here.column_norms()) {
        *s = s.max(norm);
        if *s == 0.0 {
            *s = 1.0; // a column of zeros: its parameter does not move
        }
    }
}

/// True where the residual is orthogonal to every column.
fn is_stationary(here: &Linearization, gtol: f64) -> bool {
    let norm = (2.0 * here.cost).sqrt();
    let columns = here.column_norms();
    here.gradient.iter().zip(columns).all(|(g, c)| g.abs() <= gtol * norm * c)
}

/// Decrease of the linear model: the denominator of (32).
fn promise(here: &Linearization, step: &[f64], damping: f64, scale: &[f64]) -> f64 {
    let descent: f64 = here.gradient.iter().zip(step).map(|(g, s)| g * s).sum();
    0.5 * (damping * weighted_norm(step, scale).powi(2) - descent)
}

fn weighted_norm(x: &[f64], scale: &[f64]) -> f64 {
    x.iter().zip(scale).map(|(x, s)| (x * s).powi(2)).sum::<f64>().sqrt()
}

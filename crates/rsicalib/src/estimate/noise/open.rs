//! Closures that declare no play: what only the fit can tell of their seatings.
//!
//! A ball does not sit in a cone as exactly as an encoder reads. Where readings alone cannot explain
//! what a fit leaves, the seatings of each kind of undeclared closure have a variance `v_j` of
//! their own, by (restricted) maximum likelihood. With `D_j = L⁻¹ ∂S/∂v_j L⁻ᵀ` of a pose, its whitened
//! residual `r` and the part `H` of it that the fit absorbs,
//!
//! ```text
//! g_j = ½ Σ_p [rᵀ D_j r - tr D_j (1 - H)],    I_jk = ½ Σ_p tr D_j (1 - H) D_k (1 - H)     (68)
//! ```
//!
//! Such a variance takes up any lack of fit of its closures, so it judges nothing.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::Error;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::noise::source::Source;
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::tried::Start;
use crate::model::Model;
use crate::numerics::symmetric::inverse_root;

/// Largest number of fits, each with the variances that the one before shows: steps of [`LEAST`] reach
/// a variance that is 10¹³ times smaller than the first, a seating three million times tighter than the
/// drawing is wrong.
const ROUNDS: usize = 10;

/// A variance stands still where it is nearer to its maximum than this many of its own standard
/// deviations, of the information of (68): the two together are then 0.5 % larger than one.
const STILL: f64 = 0.1;

/// Closures are exact unless what they leave is above chance at this level.
const EXACT: f64 = 0.01;

/// Variances of the undeclared closures of a model: one for each kind, and the closures of it.
struct Kinds(Vec<Vec<usize>>);

impl Kinds {
    fn of(model: &Model) -> Self {
        let undeclared = model.undeclared();
        let mut known = Vec::new();
        let mut kinds: Vec<Vec<usize>> = Vec::new();
        for (closure, kind) in undeclared.iter().enumerate() {
            let Some(kind) = kind else { continue };
            let number = known.iter().position(|k| k == kind).unwrap_or_else(|| {
                known.push(*kind);
                kinds.push(Vec::new());
                known.len() - 1
            });
            kinds[number].push(closure);
        }
        Self(kinds)
    }

    /// The equations of each kind.
    fn equations(&self, model: &Model) -> Vec<Vec<usize>> {
        let all: Vec<_> = model.equations_by_closure().collect();
        self.0.iter().map(|kind| kind.iter().flat_map(|&k| all[k].clone()).collect()).collect()
    }

    /// One variance for each closure of the model; those of others stay.
    fn by_closure(&self, model: &Model, variances: &[f64], now: &[f64]) -> Vec<f64> {
        let mut all = now.to_vec();
        all.resize(model.equations_by_closure().count(), 0.0);
        for (kind, variance) in self.0.iter().zip(variances) {
            kind.iter().for_each(|&k| all[k] = *variance);
        }
        all
    }
}

/// A fit with exact closures where the noise of the readings explains what it leaves, and else with
/// the variances of their seatings that it shows itself. `solve` fits a session from a start.
pub(crate) fn fit_with_seatings(
    observations: &Observations,
    model: &Model,
    start: &Start,
    solve: impl Fn(&Observations, Start) -> Result<Fit, Error>,
) -> Result<Fit, Error> {
    let kinds = Kinds::of(model);
    let exact = solve(observations, start.clone())?;
    if kinds.0.is_empty() || explains(&exact) || !repeats(observations, &exact) {
        return Ok(exact);
    }
    let mut seated = observations.clone();
    let weights = Some(&observations.weights[..]);
    let part = Part { model, readings: &observations.readings, weights };
    let squares = part.mean_square_lengths(&start.beta);
    let mean = |equations: &Vec<usize>| {
        equations.iter().map(|&e| squares[e]).sum::<f64>() / equations.len().max(1) as f64
    };
    let first: Vec<f64> = kinds.equations(model).iter().map(mean).collect();
    seated.options.seating = kinds.by_closure(model, &first, &exact.noise.seating);
    let mut fit = solve(&seated, start.clone())?;
    for _ in 0..ROUNDS {
        let Improved { seating, moved } = improved(&seated, &fit);
        seated.options.seating = seating;
        fit = solve(&seated, Start { beta: fit.beta.clone(), ..start.clone() })?;
        if moved < STILL {
            break;
        }
    }
    let exact = solve(observations, Start { beta: fit.beta.clone(), ..start.clone() })?;
    Ok(if explains(&exact) { exact } else { fit })
}

/// Where readings alone explain what a fit leaves.
fn explains(fit: &Fit) -> bool {
    fit.p_value.is_some_and(|p| p >= EXACT)
}

/// Where the noise of the readings is known: without it that of the seatings cannot be told from it.
fn repeats(observations: &Observations, fit: &Fit) -> bool {
    let readings = &observations.readings;
    fit.noise.source != Source::Fit || readings.held && readings.samples > readings.poses()
}

/// What a step of scoring makes of the variances of the seatings.
pub(crate) struct Improved {
    /// One for each closure of the model.
    pub(crate) seating: Vec<f64>,
    /// The largest step, in standard deviations of its variance.
    moved: f64,
}

/// The variances of the seatings that a fit with some shows: one step of scoring by (68).
pub(crate) fn improved(observations: &Observations, fit: &Fit) -> Improved {
    let (model, readings) = (&*fit.model, &observations.readings);
    let part = Part { model, readings, weights: Some(&observations.weights) };
    let adjusted = fit.adjusted_of(readings).map(<[_]>::to_vec);
    let problem = Implicit::of(part, fit.assumed()).from(adjusted);
    let residuals = problem.residuals_by_closure(&fit.beta);
    let (root, ..) = inverse_root(&fit.gram);
    let (k, n, c) = (residuals.equations, model.parameters, root.ncols());
    let kinds = Kinds::of(model);
    let equations = kinds.equations(model);
    let count = kinds.0.len();
    let (mut gradient, mut information) = (vec![0.0; count], Mat::<f64>::zeros(count, count));
    for rows in readings.rows_of_poses() {
        let weight = |row: usize| observations.weights[row];
        let live: Vec<usize> = rows.into_iter().filter(|&row| weight(row) > 0.0).collect();
        let samples: f64 = live.iter().map(|&row| weight(row).powi(2)).sum();
        let Some(&middle) = live.get(live.len() / 2) else { continue };
        let share = |row: usize| weight(row) / samples.sqrt();
        let sum = |of: &dyn Fn(usize) -> f64| live.iter().map(|&row| share(row) * of(row)).sum();
        let r: Vec<f64> = (0..k).map(|e| sum(&|row| residuals.whitened[row * k + e])).collect();
        let x = Mat::<f64>::from_fn(k, n, |e, p| {
            sum(&|row| residuals.by_parameter[(row * k + e) * n + p])
        });
        let q = &x * &root;
        let left = Mat::from_fn(k, k, |i, j| {
            let absorbed: f64 = (0..c).map(|m| q[(i, m)] * q[(j, m)]).sum();
            f64::from(u8::from(i == j)) - absorbed
        });
        let b = |i: usize, e: usize| residuals.by_closure[(middle * k + i) * k + e];
        let by_kind: Vec<Mat<f64>> = equations
            .iter()
            .map(|own| {
                Mat::from_fn(k, k, |i, j| {
                    samples * own.iter().map(|&e| b(i, e) * b(j, e)).sum::<f64>()
                })
            })
            .collect();
        let kept: Vec<Mat<f64>> = by_kind.iter().map(|d| d * &left).collect();
        for j in 0..count {
            let square: f64 = (0..k)
                .flat_map(|a| (0..k).map(move |b| (a, b)))
                .map(|(a, b)| r[a] * by_kind[j][(a, b)] * r[b])
                .sum();
            let trace: f64 = (0..k).map(|i| kept[j][(i, i)]).sum();
            gradient[j] += 0.5 * (square - trace);
            for m in 0..count {
                let product: f64 = (0..k)
                    .flat_map(|a| (0..k).map(move |b| (a, b)))
                    .map(|(a, b)| kept[j][(a, b)] * kept[m][(b, a)])
                    .sum();
                information[(j, m)] += 0.5 * product;
            }
        }
    }
    let of = |kind: &Vec<usize>| fit.noise.seating.get(kind[0]).copied().unwrap_or(0.0);
    let now: Vec<f64> = kinds.0.iter().map(of).collect();
    let step = information.llt(Side::Lower).ok().map(|factor| {
        let step = factor.solve(&Mat::from_fn(count, 1, |i, _| gradient[i]));
        (0..count).map(|i| step[(i, 0)]).collect::<Vec<f64>>()
    });
    let next = |(now, step): (&f64, &f64)| (now + step).clamp(LEAST * now, now / LEAST);
    let Some(step) = step else {
        return Improved { seating: kinds.by_closure(model, &now, &fit.noise.seating), moved: 0.0 };
    };
    let next: Vec<f64> = now.iter().zip(&step).map(next).collect();
    let by = |j: usize| (next[j] - now[j]).abs() * information[(j, j)].sqrt();
    let moved = (0..count).map(by).fold(0.0, f64::max);
    Improved { seating: kinds.by_closure(model, &next, &fit.noise.seating), moved }
}

/// A step changes a variance by not more than this factor.
const LEAST: f64 = 0.05;

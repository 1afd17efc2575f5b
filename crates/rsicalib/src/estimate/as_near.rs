//! How far a device is from its drawing, estimated: geometry that is as near to it as it was built.
//!
//! A complete geometry has directions that a session hardly tells, and what is told of them badly is
//! wrong where nothing was recorded. Its priors are typical sizes `S`. How large the errors of this drawing
//! are is one variance component `τ²`, at most 1, beside the noise `φ`: (131), with `C` and `u` of
//! the geometry once everything else is eliminated. Estimates are then the least of
//!
//! ```text
//! χ²(β) + (φ/τ²) βᵀ S⁻¹ β                                                     (153)
//! ```
//!
//! Standard deviations stay those of typical sizes: a device whose errors are small in all directions that a
//! session tells may have a larger one in another.

use faer::Mat;

use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::intervals::{at_noise_of, is_likeliest};
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::model::Prior;
use crate::numerics::component::Contrasts;
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::numerics::symmetric::{eigenvalues, invert};

/// Estimates of the size, each where the last one leads: the geometry is not linear.
const ROUNDS: usize = 5;

/// What 40 parameters tell of their size, 1/√80: a size that is so near to the typical one is that.
const TOLD: f64 = 0.11;

/// Sizes that differ by less are the same: a tenth of what is told.
const SAME: f64 = 0.1 * TOLD;

/// A fit whose geometry is as near to the drawing as (153) has it; the fit itself where something else
/// is known of that, or where it is not complete.
pub(crate) fn as_near(observations: &Observations, fit: Fit) -> Fit {
    let drawn = fit.model.drawn();
    let known = observations.options.expected.is_some();
    if drawn.is_empty() || known || !is_likeliest(observations, &fit) {
        return fit;
    }
    let Some(beta) = nearer(observations, &fit, &drawn) else { return fit };
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let rms_misclosure = Part { model: &fit.model, readings, weights }.rms_misclosure(&beta);
    Fit { beta, rms_misclosure, likeliest: Some(fit.beta), ..fit }
}

/// (153); none where errors have their typical size, or are larger.
fn nearer(observations: &Observations, fit: &Fit, drawn: &[(usize, f64)]) -> Option<Vec<f64>> {
    let is_drawn = |prior: &Prior| match prior {
        Prior::Parameter { column, .. } => drawn.iter().any(|(own, _)| own == column),
        _ => false,
    };
    let others: Vec<Prior> = fit.priors.iter().copied().filter(|p| !is_drawn(p)).collect();
    let with = |size: f64| {
        let own = drawn.iter().map(|&(column, typical)| Prior::Parameter {
            column,
            mean: 0.0,
            sd: size * typical,
        });
        others.iter().copied().chain(own).collect::<Vec<Prior>>()
    };
    let at = |priors: &[Prior], beta: &[f64]| {
        at_noise_of(observations, fit, &fit.model, priors, |problem| problem.linearize(beta))
    };
    let first = at(&others, &fit.beta)?.cost;
    let (mut beta, mut size) = (fit.beta.clone(), 1.0_f64);
    for _ in 0..ROUNDS {
        let here = at(&others, &beta)?;
        let chi2 = fit.chi2 + 2.0 * (here.cost - first) / fit.noise.slow;
        let told = Told { gram: here.gram(), gradient: here.gradient, chi2, beta: &beta, drawn };
        let next = told.size(fit).filter(|size| *size < 1.0 - TOLD)?;
        let settled = (next / size).ln().abs() < SAME;
        size = next;
        if settled {
            break;
        }
        let options = &observations.options.lm;
        let look = |problem: &Implicit| lm::minimize(problem, &beta, options);
        let found = at_noise_of(observations, fit, &fit.model, &with(size), look)?;
        if !found.termination.converged() {
            return None;
        }
        beta = found.x;
    }
    Some(beta)
}

/// What a session tells of the geometry, at some parameters.
struct Told<'a> {
    /// Normal matrix, with the priors of everything else.
    gram: Mat<f64>,
    gradient: Vec<f64>,
    chi2: f64,
    beta: &'a [f64],
    drawn: &'a [(usize, f64)],
}

impl Told<'_> {
    /// `τ/√φ`; none where errors of typical sizes would not be seen.
    fn size(&self, fit: &Fit) -> Option<f64> {
        let Self { gram, gradient, beta, drawn, .. } = self;
        let (m, n) = (drawn.len(), gram.nrows());
        let rest: Vec<usize> = (0..n).filter(|i| drawn.iter().all(|(own, _)| own != i)).collect();
        let own = Mat::from_fn(rest.len(), rest.len(), |i, j| gram[(rest[i], rest[j])]);
        // Of everything else and of the geometry, and what is left of it: typical sizes are 1.
        let across = Mat::from_fn(rest.len(), m, |i, k| gram[(rest[i], drawn[k].0)] * drawn[k].1);
        let taken = invert(&own).0 * &across;
        let c = Mat::from_fn(m, m, |k, l| {
            let of_both: f64 = (0..rest.len()).map(|i| across[(i, k)] * taken[(i, l)]).sum();
            gram[(drawn[k].0, drawn[l].0)] * drawn[k].1 * drawn[l].1 - of_both
        });
        let slope: Vec<f64> = (0..m)
            .map(|k| {
                let of_rest: f64 =
                    rest.iter().enumerate().map(|(i, r)| taken[(i, k)] * gradient[*r]).sum();
                gradient[drawn[k].0] * drawn[k].1 - of_rest
            })
            .collect();
        let b: Vec<f64> = drawn.iter().map(|&(column, typical)| beta[column] / typical).collect();
        let cb: Vec<f64> = (0..m).map(|k| (0..m).map(|l| c[(k, l)] * b[l]).sum()).collect();
        let slow = fit.noise.slow;
        let u: Vec<f64> = (0..m).map(|k| (cb[k] - slope[k]) / slow).collect();
        let to_drawing: f64 = (0..m).map(|k| b[k] * (cb[k] - 2.0 * slope[k])).sum();
        // Of the degrees of freedom, those that the geometry has at its typical sizes are free.
        let (values, _) = eigenvalues(c.as_ref())?;
        let free: f64 = values.iter().map(|c| c.max(0.0) / (c.max(0.0) + 1.0)).sum();
        let c = Mat::from_fn(m, m, |k, l| c[(k, l)] / slow);
        let least = if fit.noise.judges() { 1.0 } else { 0.0 };
        let told = [self.chi2 + to_drawing / slow, fit.dof + free, least];
        let found = Contrasts::of(c.as_ref(), &u, told)?.component()?;
        Some((found.variance / (found.noise * slow)).sqrt())
    }
}

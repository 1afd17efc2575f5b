//! What follows from a minimum: estimates, covariance and lack of fit.

use faer::Mat;

use crate::estimate::conventions::{Conventions, Here};
use crate::estimate::fitted::Fit;
use crate::estimate::noise::scatter::Groups;
use crate::estimate::noise::source::NoiseEstimate;
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::residuals::Residuals;
use crate::estimate::search;
use crate::estimate::significance::LEVEL;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::Start;
use crate::model::{Model, Prior};
use crate::numerics::distributions;
use crate::numerics::lm;
use crate::numerics::symmetric::invert;

/// A minimum, and what it was found with.
pub(super) struct Found<'a> {
    pub(super) outcome: lm::Outcome,
    pub(super) residuals: Residuals,
    pub(super) noise: NoiseEstimate,
    /// The estimated noise over the assumed one.
    pub(super) scale: f64,
    /// What held conventions.
    pub(super) holds: &'a [Prior],
}

pub(super) fn conclude(
    observations: &Observations,
    model: Model,
    priors: Vec<Prior>,
    found: Found<'_>,
    start: Start,
    groups: &Groups,
) -> Fit {
    let Found { outcome, mut residuals, noise, scale, holds } = found;
    // From units of the assumed noise to units of the estimated noise.
    for values in [&mut residuals.whitened, &mut residuals.by_reading] {
        values.iter_mut().for_each(|v| *v /= scale);
    }
    let mut gram = outcome.linearization.gram();
    for hold in holds {
        for (i, slope) in hold.slopes(&outcome.x) {
            gram[(i, i)] -= slope * slope;
        }
    }
    let n = gram.nrows();
    let gram = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (scale * scale));
    let (beta, assumed) = (&outcome.x[..], &noise.assumed());
    let here = Here {
        observations,
        model: &model,
        priors: &priors,
        beta,
        noise: assumed,
        configurations: None,
    };
    let conventions = match observations.judged {
        true => Conventions::default(),
        false => Conventions::of(here, &gram),
    };
    let stays = match observations.judged {
        true => start.stays,
        false => conventions.stay(&model),
    };
    let Told { gram, inverse, unknowable, condition } = Told::of(&conventions, gram);

    let free = free_parameters(&gram, &inverse, &priors, &outcome.x);
    // The Gram matrix tells nothing of a turn that play has told.
    let free = free + conventions.number_of_turns() as f64;
    let told = model.told_by(&observations.readings, &observations.weights);
    let lack = LackOfFit::of(observations, groups, &residuals, &noise, told as f64 - free);
    let LackOfFit { total, chi2, dof, within, p_value } = lack;
    let wider = widening(&noise, p_value, chi2 / dof);
    let covariance = times(&inverse, wider);
    let weights = Some(&observations.weights[..]);
    let part = Part { model: &model, readings: &observations.readings, weights };
    let rms_misclosure = part.rms_misclosure(&outcome.x);
    let plausible = !search::collapsed(&model, &outcome.x);
    let mut warnings = start.warnings;
    let closes = plausible && chi2 < observations.options.good_start * dof;
    warnings.retain(|it| !(closes && it.is_lost()));
    for warning in &mut warnings {
        if let Suspicion::Lost { open, .. } = warning {
            *open = rms_misclosure;
        }
    }
    if observations.is_long() {
        residuals.by_reading = Vec::new();
    }
    Fit {
        model: model.into(),
        beta: outcome.x,
        likeliest: None,
        priors,
        noise,
        gram,
        scale,
        conventions,
        stays,
        covariance,
        unknowable,
        chi2,
        dof,
        within,
        p_value,
        total,
        rms_misclosure,
        condition,
        termination: outcome.termination,
        iterations: outcome.iterations,
        starts: start.tries,
        residuals: residuals.into(),
        plausible,
        warnings,
        between: None,
        adjusted: None,
    }
}

/// What is left of a fit.
struct LackOfFit {
    /// `rᵀr`.
    total: f64,
    /// The part that is judged, and its degrees of freedom.
    chi2: f64,
    dof: f64,
    /// Degrees of freedom of what repeats show.
    within: f64,
    /// Probability by chance; none where nothing judges it.
    p_value: Option<f64>,
}

impl LackOfFit {
    /// `dof` are the degrees of freedom of all residuals.
    fn of(
        observations: &Observations,
        groups: &Groups,
        residuals: &Residuals,
        noise: &NoiseEstimate,
        mut dof: f64,
    ) -> Self {
        let k = residuals.equations;
        let live = (0..observations.readings.samples).filter(|&r| observations.weights[r] > 0.0);
        let of =
            |r: usize| residuals.whitened[r * k..(r + 1) * k].iter().map(|v| v * v).sum::<f64>();
        let total: f64 = live.map(of).sum();
        let (mut chi2, mut within) = (total, 0.0);
        if noise.source.independent() {
            let scatter = groups.scatter(residuals, 0.0);
            // What is no number stays none.
            chi2 = (chi2 - scatter.within).clamp(0.0, f64::INFINITY) / noise.inflation;
            within = scatter.dof;
            dof -= within;
        }
        let judged = noise.judges() && dof >= 1.0 && noise.dof_of_pose() > 0.0 && !chi2.is_nan();
        let p_value = judged.then(|| distributions::f_tail(chi2 / dof, dof, noise.dof_of_pose()));
        Self { total, chi2, dof, within, p_value }
    }
}

/// A Gram matrix without what it seems to tell of conventions, and what it tells then.
pub(super) struct Told {
    pub(super) gram: Mat<f64>,
    /// With conventions where they are drawn.
    pub(super) inverse: Mat<f64>,
    pub(super) unknowable: Vec<bool>,
    pub(super) condition: f64,
}

impl Told {
    pub(super) fn of(conventions: &Conventions, gram: Mat<f64>) -> Self {
        let gram = conventions.out_of(gram);
        let (inverse, mut unknowable, condition) = invert(&gram);
        for (k, unknown) in unknowable.iter_mut().enumerate() {
            *unknown |= conventions.presumes(k);
        }
        Self { inverse: conventions.held_in(&inverse), gram, unknowable, condition }
    }
}

pub(super) fn times(matrix: &Mat<f64>, factor: f64) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * factor)
}

/// Factor of the covariance beside the inverse of the Gram matrix: of correlated noise, and of a
/// residual above the noise, which has moved the estimates, too.
pub(crate) fn widening(noise: &NoiseEstimate, p_value: Option<f64>, per_dof: f64) -> f64 {
    let left = if p_value.is_some_and(|p| p <= LEVEL) { per_dof.max(1.0) } else { 1.0 };
    noise.slow * left
}

/// Number of parameters that the data determine: each prior takes over a part of a parameter, and
/// what nothing tells is none. `gram` is the Gram matrix with priors, `inverse` its pseudo-inverse,
/// `x` the parameters.
#[must_use]
pub fn free_parameters(gram: &Mat<f64>, inverse: &Mat<f64>, priors: &[Prior], x: &[f64]) -> f64 {
    let n = inverse.nrows();
    let own = |i: usize| (0..n).map(|j| inverse[(i, j)] * gram[(j, i)]).sum::<f64>();
    let rank: f64 = (0..n).map(own).sum();
    let held = |prior: &Prior| -> f64 {
        let slopes = prior.slopes(x);
        let pairs = slopes.iter().flat_map(|a| slopes.iter().map(move |b| (a, b)));
        pairs.map(|((i, a), (j, b))| a * inverse[(*i, *j)] * b).sum()
    };
    let rank = if rank.is_finite() { rank.round() } else { n as f64 };
    rank - priors.iter().map(held).sum::<f64>()
}

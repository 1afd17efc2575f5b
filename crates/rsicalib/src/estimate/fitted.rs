//! What a fit found: estimates, covariance and lack of fit.

use std::borrow::Cow;
use std::sync::Arc;

use faer::Mat;

use crate::estimate::adjusted::Adjusted;
use crate::estimate::between::Between;
use crate::estimate::conventions::{Conventions, Stays};
use crate::estimate::noise::source::{LARGER_PART, LEAST_DOF, NOISIER, NoiseEstimate};
use crate::estimate::objective::Noise;
use crate::estimate::residuals::Residuals;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::Try;
use crate::model::{Model, Prior, add_squares};
use crate::numerics::lanes::Lanes;
use crate::numerics::lm::Termination;
use crate::numerics::symmetric::invert;
use crate::readings::Readings;
use crate::terms::term::Acts;

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model, with the order of the parameters, shared by the copies of the fit.
    pub model: Arc<Model>,
    /// Estimates of the parameters, corrections to the mechanism as drawn;
    /// [`reported`](crate::estimate::directions::reported) gives absolute offsets and gains.
    pub beta: Vec<f64>,
    /// Estimates by the priors, where those of `beta` are drawn towards the drawing: (153).
    pub likeliest: Option<Vec<f64>>,
    /// Priors of the parameters.
    pub priors: Vec<Prior>,
    /// The noise.
    pub noise: NoiseEstimate,
    /// `Xᵀ S⁻¹ X` and priors, in units of the estimated noise.
    pub gram: Mat<f64>,
    /// The estimated noise over the one that the fit was made with: `gram` is in units of the former,
    /// the part of the priors in it, too.
    pub(crate) scale: f64,
    /// What no reading could show: taken out of `gram`.
    pub(crate) conventions: Conventions,
    /// What stays while a search tries what may be added.
    pub(crate) stays: Vec<Stays>,
    /// Covariance of the parameters; a pseudo-inverse where directions are unobservable.
    pub covariance: Mat<f64>,
    /// Parameters that take part in an unobservable direction.
    pub unknowable: Vec<bool>,
    /// χ² between poses.
    pub chi2: f64,
    /// Degrees of freedom of `chi2`.
    pub dof: f64,
    /// Degrees of freedom within poses, from which the noise was estimated.
    pub within: f64,
    /// Probability of a larger χ² by chance; `None` where the noise was estimated from the fit.
    pub p_value: Option<f64>,
    /// χ² of all samples.
    pub total: f64,
    /// Root mean square error of the closures, in length units.
    pub rms_misclosure: f64,
    /// Condition number, unit columns.
    pub condition: f64,
    /// Reason for the end of the solver.
    pub termination: Termination,
    /// Number of linearisations.
    pub iterations: usize,
    /// Starts that were tried.
    pub starts: Vec<Try>,
    /// Whitened residuals and their derivatives, shared by the copies of the fit.
    pub residuals: Arc<Residuals>,
    /// True where no gain has collapsed, so that every joint moves.
    pub plausible: bool,
    /// Suspected mistakes in the wiring.
    pub warnings: Vec<Suspicion>,
    /// What changes from group to group, where that was looked for: [`with_groups`](crate::estimate::with_groups).
    pub between: Option<Arc<Between>>,
    /// Readings as a fit of a search has settled them.
    pub(crate) adjusted: Option<Adjusted>,
}

/// Part of a direction, in standard deviations, that is no rounding.
const PART: f64 = 1e-6;

impl Fit {
    /// True where the solver has converged, to parameters with which every joint moves.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.termination.converged() && self.plausible
    }

    /// χ² of all samples with what priors add to it.
    #[must_use]
    pub fn cost(&self) -> f64 {
        let held: f64 = self.priors.iter().map(|p| p.off(&self.beta).powi(2)).sum();
        self.total + held
    }

    /// True where an unknown frame was not found.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.warnings.iter().any(Suspicion::is_lost)
    }

    /// True where some start led to a fit in which every joint moves, and every frame is found.
    #[must_use]
    pub fn has_start(&self) -> bool {
        !self.warnings.iter().any(Suspicion::is_no_start)
    }

    /// True for a minimum of which it has a meaning to ask how far parameters, points and left-out poses are off.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.converged() && self.has_start()
    }

    /// The noise, as an assumption of a further fit.
    #[must_use]
    pub fn assumed(&self) -> Noise {
        self.noise.assumed()
    }

    /// True where what was unknown is found shaped as drawn with two names exchanged, and by far not as they are.
    #[must_use]
    pub(crate) fn is_unlike_drawn(&self) -> bool {
        self.warnings.iter().any(|it| matches!(it, Suspicion::Unlike { .. }))
    }

    /// These readings as the fit has settled them; none where it is no fit of a search, or of others.
    pub(crate) fn adjusted_of(&self, readings: &Readings) -> Option<&[Lanes]> {
        self.adjusted.as_ref().and_then(|adjusted| adjusted.of(readings))
    }

    /// Covariance of the parameters where another group is meant, or whatever is used elsewhere.
    #[must_use]
    pub fn elsewhere(&self) -> Cow<'_, Mat<f64>> {
        match &self.between {
            Some(between) => Cow::Owned(between.elsewhere()),
            None => Cow::Borrowed(&self.covariance),
        }
    }

    /// A fit to start from: the parameters of a search, the noise of all samples.
    pub(crate) fn with_noise_of(&self, all: &Self) -> Self {
        Self { noise: all.noise.clone(), ..self.clone() }
    }

    /// True where noise is declared, and no repeats bear it out: those of a pose share its play, and
    /// say nothing of it.
    #[must_use]
    pub fn unverified(&self) -> bool {
        let repeated = !self.noise.source.is_declared() || self.within >= LEAST_DOF;
        self.noise.judges() && !(repeated && self.noise.share >= LARGER_PART)
    }

    /// True where nothing like the noise that is declared is there: a residual many times as large as all noise
    /// there is would pass for it.
    #[must_use]
    pub fn is_loose(&self) -> bool {
        let doubted = self.warnings.iter().any(Suspicion::of_noise_that_is_too_large);
        doubted && self.chi2 * NOISIER * NOISIER < self.dof
    }

    /// True where readings contradict what is declared as known.
    #[must_use]
    pub fn contradicts_knowledge(&self) -> bool {
        self.warnings.iter().any(Suspicion::is_of_knowledge)
    }

    /// True where the length of something known takes part in a convention: then nothing says how long
    /// anything is.
    pub(crate) fn has_no_scale(&self) -> bool {
        let lengths = self.model.instances.iter().zip(&self.model.first);
        let mut lengths = lengths.filter(|(i, _)| matches!(i.term.acts(), Acts::Distance));
        lengths.any(|(_, first)| self.conventions.rows.iter().any(|row| row.1[*first].abs() > PART))
    }

    /// `(Xᵀ S⁻¹ X)⁻¹`, priors included, conventions held where they are drawn: what takes up an effect does not go
    /// along them.
    #[must_use]
    pub fn inverse(&self) -> Mat<f64> {
        self.inverse_beside(self.gram.clone())
    }

    /// The same of `Xᵀ S⁻¹ X` of another linearisation at this fit, without priors.
    pub(crate) fn inverse_of(&self, gram: Mat<f64>) -> Mat<f64> {
        self.inverse_beside(self.told_of(gram))
    }

    /// `Xᵀ S⁻¹ X` with the priors, without what it seems to tell of conventions.
    pub(crate) fn told_of(&self, mut gram: Mat<f64>) -> Mat<f64> {
        for prior in &self.priors {
            add_squares(&mut gram, &prior.slopes(&self.beta));
        }
        self.conventions.out_of(gram)
    }

    /// The inverse of a Gram matrix that has the priors and tells nothing of conventions.
    fn inverse_beside(&self, mut gram: Mat<f64>) -> Mat<f64> {
        for prior in self.stays.iter().filter_map(|stays| stays.held(&self.model, &self.beta)) {
            prior.slopes(&self.beta).iter().for_each(|(i, slope)| gram[(*i, *i)] += slope * slope);
        }
        self.conventions.held_in(&invert(&gram).0)
    }
}

//! What a fit leaves of the readings, and what it absorbs of anything else.
//!
//! With `N⁻¹ = R Rᵀ` of the fit, priors included, and `Q = X R`, (71) for further columns `Z` is
//!
//! ```text
//! M = ZᵀZ - (ZᵀQ)(QᵀZ),    u = Zᵀr - (ZᵀQ) p,    p = Qᵀr + Rᵀ ∇priors
//! ```
//!
//! `p` is 0 at the minimum.

use faer::{Mat, MatRef};

use crate::Error;
use crate::estimate::fit::carry_over;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::residuals::Residuals;
use crate::estimate::settle::Closing;
use crate::model::{Instance, Model, Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::numerics::symmetric::{dot, inverse_root};

/// A session at a fit.
pub struct AtFit<'a> {
    pub observations: &'a Observations,
    pub fit: &'a Fit,
    pub residuals: Residuals,
    /// `N⁻¹`.
    pub inverse: Mat<f64>,
    /// `R`.
    pub root: Mat<f64>,
    /// `Qᵀ`, one column for each equation of each sample.
    q: Mat<f64>,
    /// `p`
    pub pull: Vec<f64>,
    /// `â`, and `ã` of (168) where play moves joints, block by block: [`AtFit::settled`].
    adjusted: Vec<Lanes>,
    /// Derivatives of the whitened equations by what may be fitted beside it, equation by equation.
    beside: Vec<f64>,
}

impl<'a> AtFit<'a> {
    /// A session at a fit of it.
    pub fn new(observations: &'a Observations, fit: &'a Fit) -> Self {
        Self::of_model(observations, fit, &fit.model, &fit.beta)
    }

    /// The same, with the derivatives by what may be fitted beside it.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn with(
        observations: &'a Observations,
        fit: &'a Fit,
        beside: &[Instance],
    ) -> Result<Self, Error> {
        if beside.is_empty() {
            return Ok(Self::new(observations, fit));
        }
        let model = observations.model_beside(&fit.model, beside)?;
        Ok(Self::of_model(observations, fit, &model, &carry_over(fit, &model)))
    }

    /// By a model that has the terms of the fit, and perhaps more that are zero.
    fn of_model(observations: &'a Observations, fit: &'a Fit, model: &Model, beta: &[f64]) -> Self {
        let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
        let part = Part { model, readings, weights };
        let settled = fit.adjusted_of(readings);
        let problem = Implicit::of(part, fit.assumed()).from(settled.map(<[_]>::to_vec));
        let mut residuals = problem.residuals(beta, true);
        let n = fit.model.parameters;
        let count = residuals.whitened.len();
        let beside = residuals.take_parameters(fit.model.term_parameters..model.term_parameters);
        let x = MatRef::from_column_major_slice(&residuals.by_parameter, n, count);
        // Of `X` itself: that of the fit is of readings settled by a step less, and a projection takes what
        // the two differ by for what `X` leaves, as many times as large as the weakest direction is weak.
        let (root, ..) = inverse_root(&fit.told_of(x * x.transpose()));
        let q = root.transpose() * x;
        let mut slope = vec![0.0; n];
        for prior in &fit.priors {
            for (column, by) in prior.slopes(&fit.beta) {
                slope[column] += by * prior.off(&fit.beta);
            }
        }
        let mut pull: Vec<f64> =
            root.col_iter().map(|c| c.iter().zip(&slope).map(|(r, s)| r * s).sum()).collect();
        for (e, r) in residuals.whitened.iter().enumerate() {
            add_scaled(&mut pull, *r, q.col_as_slice(e));
        }
        let inverse = &root * root.transpose();
        if fit.model.unknowns.is_empty() {
            // Of a long recording they are gigabytes, and only what touches unknown points needs them.
            residuals.by_parameter = Vec::new();
        }
        let mut adjusted = problem.into_adjusted();
        if let Some(noise) = Closing::noise(&part, &fit.assumed()) {
            let mut closing = Closing::new(part.model, &noise);
            for (block, a_hat) in adjusted.chunks_exact_mut(part.stride()).enumerate() {
                let moved = closing.close(&part, block, beta, a_hat);
                a_hat.copy_from_slice(moved);
            }
        }
        Self { observations, fit, residuals, inverse, root, q, pull, adjusted, beside }
    }

    /// Readings of a block as the fit settles them, `â`, (168). The columns of terms are those of `â`:
    /// what is to be compared with them must be of `â` as well, since `a - â` follows the residual.
    pub fn settled(&self, block: usize) -> &[Lanes] {
        let channels = self.observations.readings.channels;
        &self.adjusted[block * self.fit.model.stride()..][..channels]
    }

    /// Length of a row of `Q`.
    pub fn rank(&self) -> usize {
        self.q.nrows()
    }

    /// The row of `Q` of an equation: samples in their order, equation by equation.
    pub fn q(&self, equation: usize) -> &[f64] {
        self.q.col_as_slice(equation)
    }

    /// The equations of a sample.
    pub fn equations(&self, row: usize) -> std::ops::Range<usize> {
        let k = self.residuals.equations;
        row * k..(row + 1) * k
    }

    /// Misclosure of a sample by its readings as they are, in length units.
    pub fn misclosure(&self, row: usize) -> f64 {
        let (model, readings) = (&self.fit.model, &self.observations.readings);
        let (block, lane) = readings.lane_of_rows()[row];
        let (mut ws, bare) = (Workspace::default(), Want { x: false, a: false });
        model.evaluate(readings, block, readings.raw(block), &self.fit.beta, bare, &mut ws);
        let lengths = model.lengths();
        let squares = ws.f.iter().zip(lengths).map(|(f, length)| (f.0[lane] * length).powi(2));
        squares.sum::<f64>().sqrt()
    }

    /// Derivative of a whitened equation by the reading of a channel.
    pub fn by_reading(&self, equation: usize, channel: usize) -> f64 {
        self.residuals.by_reading[equation * self.observations.readings.channels + channel]
    }

    /// Derivative of a whitened equation by parameter `k` of what may be fitted beside it.
    pub fn by_beside(&self, equation: usize, k: usize) -> f64 {
        let width = self.beside.len() / self.residuals.whitened.len().max(1);
        self.beside[equation * width + k]
    }

    /// Derivatives of a whitened equation by the parameters, its row of `X`; for a model with unknown
    /// points.
    pub fn by_parameter(&self, equation: usize) -> &[f64] {
        let n = self.fit.model.parameters;
        &self.residuals.by_parameter[equation * n..(equation + 1) * n]
    }

    /// `Q Qᵀ` of the equations of one sample: what the fit absorbs of them.
    pub fn hat(&self, row: usize) -> Mat<f64> {
        let first = self.equations(row).start;
        let k = self.residuals.equations;
        Mat::from_fn(k, k, |i, j| dot(self.q(first + i), self.q(first + j)))
    }
}

/// `sum += scale · values`
pub fn add_scaled(sum: &mut [f64], scale: f64, values: &[f64]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += scale * value);
}

/// Sums for (71) of one column: `Zᵀr`, `ZᵀZ` and `QᵀZ`.
#[derive(Clone)]
pub struct Column {
    pub zr: f64,
    pub zz: f64,
    pub zq: Vec<f64>,
}

impl Column {
    /// Of no equation, beside so many directions that the fit absorbs.
    pub fn new(rank: usize) -> Self {
        Self { zr: 0.0, zz: 0.0, zq: vec![0.0; rank] }
    }

    pub fn clear(&mut self) {
        (self.zr, self.zz) = (0.0, 0.0);
        self.zq.fill(0.0);
    }

    /// Adds the entry of one equation.
    pub fn add(&mut self, there: &AtFit, equation: usize, z: f64) {
        self.zr += z * there.residuals.whitened[equation];
        self.zz += z * z;
        add_scaled(&mut self.zq, z, there.q(equation));
    }

    /// `M`
    pub fn left(&self) -> f64 {
        self.zz - dot(&self.zq, &self.zq)
    }

    /// `T = u²/M` (72), where at least a share of the column is left.
    pub fn score(&self, pull: &[f64], share: f64) -> Option<f64> {
        let left = self.left();
        let u = self.zr - dot(&self.zq, pull);
        (left > share * self.zz).then(|| u * u / left)
    }
}

//! A session and poses not yet visited, linear at one point.
//!
//! One model holds the terms of all rivals. It is linearised once: terms that all rivals share at
//! the estimates of the best, other terms at zero.

use faer::Mat;

use crate::Error;
use crate::estimate::{Fit, Implicit, Noise, Observations, Part, carry_over};
use crate::mechanism::{Mechanism, list};
use crate::model::{Instance, Model, Unknown, parse};
use crate::readings::{Readings, Table};

/// Rows `W = L⁻¹ X` of some samples.
#[derive(Debug, Clone, Default)]
pub(crate) struct Whitened {
    /// Equations of a sample.
    pub(crate) equations: usize,
    /// Parameters.
    pub(crate) width: usize,
    /// Sample by sample, equation by equation, one entry per parameter.
    pub(crate) values: Vec<f64>,
}

impl Whitened {
    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.values.len().checked_div(self.equations * self.width).unwrap_or(0)
    }

    /// The rows of one sample.
    pub(crate) fn of(&self, sample: usize) -> &[f64] {
        let size = self.equations * self.width;
        &self.values[sample * size..(sample + 1) * size]
    }

    /// The same rows for some of the parameters.
    pub(crate) fn select(&self, columns: &[usize]) -> Self {
        let rows = self.values.chunks_exact(self.width.max(1));
        let values = rows.flat_map(|row| columns.iter().map(|&c| row[c])).collect();
        Self { equations: self.equations, width: columns.len(), values }
    }

    /// `WᵀW`.
    pub(crate) fn gram(&self) -> Mat<f64> {
        let n = self.width;
        let rows = self.values.len().checked_div(n).unwrap_or(0);
        let w = Mat::from_fn(rows, n, |i, j| self.values[i * n + j]);
        w.transpose() * &w
    }
}

/// A model of several rivals at the common point.
pub(crate) struct Linearised<'a> {
    pub(crate) session: &'a Observations,
    pub(crate) model: Model,
    pub(crate) beta: Vec<f64>,
    pub(crate) noise: Noise,
}

impl<'a> Linearised<'a> {
    /// At the estimates of the best rival, with more terms; `own` are terms that not all share.
    ///
    /// # Errors
    ///
    /// As [`Observations::model`].
    pub(crate) fn new(
        session: &'a Observations,
        best: &Fit,
        more: &[Instance],
        own: &[Instance],
    ) -> Result<Self, Error> {
        let mut instances = best.model.instances.clone();
        for instance in more {
            if !instances.contains(instance) {
                instances.push(*instance);
            }
        }
        let model = session.model(instances)?;
        let mut beta = carry_over(best, &model);
        for (instance, &first) in model.instances.iter().zip(&model.first) {
            if own.contains(instance) {
                beta[first..first + instance.width()].fill(0.0);
            }
        }
        Ok(Self { session, model, beta, noise: best.assumed() })
    }

    /// Of offsets and gains, as the mechanism of a session has them, with this noise
    /// of each channel; `readings` show which equations follow from others.
    ///
    /// # Errors
    ///
    /// As [`Model::about`].
    pub(crate) fn of_offsets_and_gains(
        session: &'a Observations,
        readings: &Readings,
        sigma: Vec<f64>,
    ) -> Result<Self, Error> {
        let mechanism = &session.mechanism;
        let instances = parse(mechanism, readings, &["offset".into(), "gain".into()])?;
        let zero = vec![0.0; mechanism.channels.len()];
        let model = Model::about(None, mechanism, readings, instances, &zero)?;
        let beta = model.nominal();
        Ok(Self { session, model, beta, noise: Noise::declared(sigma) })
    }

    /// True where all is as drawn, and a platform is carried.
    pub(crate) fn is_as_drawn(&self) -> bool {
        !self.model.mechanism.platform.is_empty()
            && self.model.unknowns.is_empty()
            && self.beta.iter().all(|change| *change == 0.0)
    }

    /// The parameters of another model of the session among those of this model.
    pub(crate) fn columns_of(&self, other: &Model) -> Vec<usize> {
        let at = |instance: &Instance| {
            let k = self.model.instances.iter().position(|i| i == instance).unwrap_or_default();
            self.model.first[k]..self.model.first[k] + instance.width()
        };
        let terms = other.instances.iter().flat_map(at);
        terms.chain(self.model.term_parameters..self.model.parameters).collect()
    }

    /// Rows of the poses of the session, and the information of the priors of a fit.
    pub(crate) fn session(&self) -> Whitened {
        let (readings, weights) = (&self.session.readings, Some(&self.session.weights[..]));
        let part = Part { model: &self.model, readings, weights };
        let same: Vec<usize> = (0..self.model.parameters).collect();
        self.whitened(part, &same)
    }

    /// Readings of candidates, beside those of the session.
    ///
    /// # Errors
    ///
    /// As [`Readings::beside`].
    pub(crate) fn readings(&self, table: &Table) -> Result<Readings, Error> {
        let session = self.session;
        Readings::beside(&session.mechanism, table.clone(), &session.readings)
    }

    /// Rows of other samples, one for each.
    ///
    /// # Errors
    ///
    /// As [`Linearised::under`].
    pub(crate) fn rows(&self, readings: &Readings) -> Result<Whitened, Error> {
        let (model, columns) = self.under(&self.session.mechanism, readings)?;
        Ok(self.whitened(Part { model: &model, readings, weights: None }, &columns))
    }

    fn whitened(&self, part: Part<'_>, columns: &[usize]) -> Whitened {
        let beta: Vec<f64> = columns.iter().map(|&c| self.beta[c]).collect();
        let problem = Implicit::of(part, self.noise.clone());
        let found = problem.residuals(&beta, true);
        let (own, width) = (columns.len(), self.model.parameters);
        let values = if columns.iter().copied().eq(0..width) {
            found.by_parameter
        } else {
            let mut values = vec![0.0; found.by_parameter.len() / own.max(1) * width];
            for (from, to) in
                found.by_parameter.chunks_exact(own).zip(values.chunks_exact_mut(width))
            {
                columns.iter().zip(from).for_each(|(&c, v)| to[c] = *v);
            }
            values
        };
        Whitened { equations: found.equations, width, values }
    }

    /// The model of other readings, and which of this model's parameters each of its own is.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] for an unknown point that the session does not touch; as [`Model::like`].
    pub(crate) fn under(
        &self,
        mechanism: &Mechanism,
        readings: &Readings,
    ) -> Result<(Model, Vec<usize>), Error> {
        let model = Model::like(&self.model, mechanism, readings)?;
        let mut columns: Vec<usize> = (0..self.model.term_parameters).collect();
        for unknown in &model.unknowns {
            // What no row of these readings touches has no derivatives: any place will do.
            let nowhere = unknown.keys.iter().any(String::is_empty);
            let same = |known: &&Unknown| {
                known.thing == unknown.thing && (nowhere || known.keys == unknown.keys)
            };
            let own = self.model.unknowns.iter().find(same).ok_or_else(|| Error::Unknown {
                kind: "point",
                found: unknown.name.clone(),
                known: list(self.model.unknowns.iter().map(|known| &known.name)),
            })?;
            let first = self.model.term_parameters + own.first;
            columns.extend(first..first + own.width);
        }
        Ok((model, columns))
    }

    /// Parameters of [`Linearised::under`].
    pub(crate) fn beta_of(&self, columns: &[usize]) -> Vec<f64> {
        columns.iter().map(|&c| self.beta[c]).collect()
    }
}

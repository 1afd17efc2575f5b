//! Priors of a session: those of its model, and what is expected in their place.

use crate::estimate::expected::Expectation;
use crate::estimate::observations::Observations;
use crate::model::{Model, Prior};

impl Observations {
    /// Priors of the parameters of a model: those of the model, and in their place what the options
    /// [expect](crate::FitOptions::expected).
    #[must_use]
    pub fn priors(&self, model: &Model) -> Vec<Prior> {
        let mut priors = model.priors();
        let Some(expected) = &self.options.expected else { return priors };
        for (instance, &first) in model.instances.iter().zip(&model.first) {
            let info = instance.term.info();
            let target = instance.target.name(&self.mechanism);
            for (k, parameter) in info.parameters.iter().enumerate() {
                let meant = |e: &&Expectation| {
                    e.spec.term == info.id
                        && e.name.as_deref().is_none_or(|own| own == parameter.name)
                        && e.spec.target.as_ref().is_none_or(|own| *own == target)
                };
                if let Some(&Expectation { mean, sd, .. }) = expected.parameters.iter().find(meant)
                {
                    let column = first + k;
                    let of = |p: &Prior| matches!(p, Prior::Parameter { column: own, .. } if *own == column);
                    priors.retain(|p| !of(p));
                    priors.push(Prior::Parameter { column, mean, sd });
                }
            }
        }
        priors
    }
}

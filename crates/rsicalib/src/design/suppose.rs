//! What an effect would do in given poses, and whether they would show it.
//!
//! An effect with parameters `p` and columns `Z` of the whitened Jacobian leaves, after the fitted
//! columns `X` have absorbed what they can, the residual
//!
//! ```text
//! r = Z p - X (XᵀX)⁻¹ XᵀZ p,    λ = |r|² = pᵀ M p                              (177)
//! ```
//!
//! with `M` of (71): the noncentrality of the score (72), and of χ². To first order in `p`.

use crate::Error;
use crate::apply::change::{PlatformRms, difference, platform};
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::{LEVEL, SearchOptions};
use crate::diagnosis::price;
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::score::projection::{project_blocks, visible};
use crate::diagnosis::score::scored::named_places;
use crate::estimate::directions::{place, unit};
use crate::estimate::{Fit, Implicit, Observations, Part, fit};
use crate::model::{Instance, Spec, instances_of};
use crate::numerics::bounds;
use crate::numerics::distributions::{chi2_beyond, chi2_quantile};
use crate::terms::term::Class;
use crate::text::quoted;

/// A parameter of an effect, and its supposed value: `curvature@a22.c2=0.02`.
#[derive(Debug, Clone, PartialEq)]
pub struct Supposed {
    /// The term at its target.
    pub spec: Spec,
    /// The parameter; none for a term that has one.
    pub parameter: Option<String>,
    /// Its value, in its unit.
    pub value: f64,
}

/// What an effect would do.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Supposition {
    /// The effects with their parameters.
    pub effects: Vec<SupposedEffect>,
    /// `λ` of (177).
    pub noncentrality: f64,
    /// Directions of the effects that these poses can show.
    pub width: usize,
    /// Probability that the score of the effect is above chance in a search among all candidates,
    /// and pays for its parameters.
    pub seen: f64,
    /// Probability that the residual as a whole is significant.
    pub noticed: f64,
    /// What it does to the platform after the other parameters have absorbed what they can.
    pub platform_rms: Option<PlatformRms>,
    /// `r` of (177), pose by pose, one entry per equation, in units of noise.
    pub residuals: Vec<Vec<f64>>,
    /// Numbers of the poses.
    pub poses: Vec<i64>,
}

/// One effect of a supposition.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SupposedEffect {
    /// Id of the term.
    pub term: String,
    /// Where its fault lies.
    pub class: Class,
    /// What it belongs to.
    pub target: String,
    /// Where a searched term acts.
    pub place: Option<String>,
    /// Its parameters.
    pub parameters: Vec<SupposedParameter>,
}

/// A parameter of a supposition.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SupposedParameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of the value.
    pub unit: String,
}

impl Supposed {
    /// Reads `curvature@a22.c2=0.02`, or `curvature@a22=0.02` of a term with one parameter.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for text of another form.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let expected = "TERM@TARGET.PARAMETER=VALUE, as in curvature@a22.c2=0.02";
        let wrong = || Error::option("term", quoted(text), expected);
        let (left, value) = text.rsplit_once('=').ok_or_else(wrong)?;
        let value = value.trim().parse::<f64>().ok().filter(|v| bounds::usable(*v));
        let value = value.ok_or_else(wrong)?;
        let left = left.trim();
        // What follows a point may be a parameter, or the joint of `each.2`.
        let named = left.rsplit_once('.').filter(|(_, name)| {
            let first = name.chars().next();
            first.is_some_and(|c| c.is_alphabetic() || c == '_')
        });
        Ok(match named {
            Some((spec, name)) => Self { spec: spec.into(), parameter: Some(name.into()), value },
            None => Self { spec: left.into(), parameter: None, value },
        })
    }
}

/// What effects would do in the poses of a session, beside what its options fit.
///
/// The session tells the noise, the poses and the calibration; what is wrong with its readings
/// does not matter to first order.
///
/// # Errors
///
/// [`Error::Unknown`] for a term, target, place or parameter that there is not,
/// [`Error::Context`] for a term that needs data which the readings do not have, and as [`fit`].
pub fn suppose(observations: &Observations, supposed: &[Supposed]) -> Result<Supposition, Error> {
    let (effects, values) = effects_of(observations, supposed)?;
    let search = SearchOptions::default();
    let mut base = observations.instances()?;
    base.retain(|i| !effects.contains(i));
    let full = fit(observations, base.clone(), None)?;
    let small = Averaged::new(observations, &full, &search)?.small;
    let last = fit(&small, base, Some(&full))?;
    // Refuses what needs data that the readings do not have.
    small.model([&last.model.instances[..], &effects].concat())?;
    let width = values.len();
    let projected = project_blocks(&small, &last, &effects, &[width])?;
    let Some(it) = projected.first() else {
        return Err(Error::Empty("no effect is supposed".into()));
    };
    let along = |i: usize| (0..width).map(|j| it.square[(i, j)] * values[j]).sum::<f64>();
    let noncentrality = (0..width).map(|i| values[i] * along(i)).sum::<f64>().max(0.0);
    let places = named_places(candidates(&small, &last, &search.without).len() as f64);
    let absorbed: Vec<f64> = (0..last.model.parameters)
        .map(|j| (0..width).map(|i| it.absorbed[(j, i)] * values[i]).sum())
        .collect();
    let with = With::new(&small, &last, &effects, &values, &absorbed)?;
    let noise = last.assumed();
    let here = platform(&small, &last.model, &last.beta, &noise);
    let there = platform(&small, &with.model, &with.beta, &noise);
    let seen = visible(it);
    // As in the search: worth its parameters and places.
    let least = price::least_of_first(seen as f64, places);
    Ok(Supposition {
        seen: if seen == 0 { 0.0 } else { chi2_beyond(least, seen as f64, noncentrality) },
        noticed: match last.dof >= 1.0 {
            true => {
                let limit = chi2_quantile(LEVEL, last.dof);
                chi2_beyond(limit, last.dof, noncentrality)
            }
            false => 0.0,
        },
        noncentrality,
        width: seen,
        platform_rms: here.zip(there).map(|(here, there)| difference(&small, &here, &there)),
        residuals: with.residuals(&small, &last, &values, &absorbed),
        poses: small.readings.labels.clone(),
        effects: described(observations, &effects, &values),
    })
}

/// The effects that are supposed, and their parameters one after the other.
fn effects_of(
    observations: &Observations,
    supposed: &[Supposed],
) -> Result<(Vec<Instance>, Vec<f64>), Error> {
    let mut effects: Vec<(Instance, Vec<f64>)> = Vec::new();
    for one in supposed {
        let Observations { mechanism, readings, .. } = observations;
        if one.spec.target.is_none() {
            let (_, targets) = one.spec.targets(mechanism)?;
            let known = targets.iter().map(|t| t.name(mechanism)).collect::<Vec<_>>().join(", ");
            return Err(Error::Unknown { kind: "target", found: String::new(), known });
        }
        let instances = instances_of(mechanism, readings, &one.spec)?;
        let Some(&instance) = instances.first() else { continue };
        crate::terms::targets::provided(instance.term, mechanism, readings)?;
        let parameters = instance.term.info().parameters;
        let known = || parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        let k = match &one.parameter {
            Some(name) => parameters.iter().position(|p| p.name == *name),
            None if parameters.len() == 1 => Some(0),
            None => None,
        };
        let k = k.ok_or_else(|| Error::Unknown {
            kind: "parameter",
            found: one.parameter.clone().unwrap_or_default(),
            known: known(),
        })?;
        match effects.iter_mut().find(|(i, _)| *i == instance) {
            Some((_, values)) => values[k] = one.value,
            None => {
                let mut values = vec![0.0; parameters.len()];
                values[k] = one.value;
                effects.push((instance, values));
            }
        }
    }
    let values = effects.iter().flat_map(|(_, values)| values.clone()).collect();
    Ok((effects.into_iter().map(|(instance, _)| instance).collect(), values))
}

/// The model with the effects in it.
struct With {
    model: crate::model::Model,
    beta: Vec<f64>,
    /// First parameter of the effects.
    first: usize,
}

impl With {
    fn new(
        small: &Observations,
        last: &Fit,
        effects: &[Instance],
        values: &[f64],
        absorbed: &[f64],
    ) -> Result<Self, Error> {
        let mut instances = last.model.instances.clone();
        instances.extend(effects);
        let model = small.model(instances)?;
        let first = last.model.term_parameters;
        let mut beta: Vec<f64> = last.beta.iter().zip(absorbed).map(|(b, a)| b - a).collect();
        beta.splice(first..first, values.iter().copied());
        Ok(Self { model, beta, first })
    }

    /// `r` of (93), pose by pose.
    fn residuals(
        &self,
        small: &Observations,
        last: &Fit,
        values: &[f64],
        absorbed: &[f64],
    ) -> Vec<Vec<f64>> {
        let mut beta = last.beta.clone();
        beta.splice(self.first..self.first, values.iter().map(|_| 0.0));
        let mut change: Vec<f64> = absorbed.iter().map(|a| -a).collect();
        change.splice(self.first..self.first, values.iter().copied());
        let part =
            Part { model: &self.model, readings: &small.readings, weights: Some(&small.weights) };
        let there = Implicit::of(part, last.assumed()).residuals(&beta, true);
        let k = there.equations;
        let moved = |row: usize, e: usize| {
            let x = &there.by_parameter[(row * k + e) * change.len()..][..change.len()];
            x.iter().zip(&change).map(|(x, c)| x * c).sum::<f64>()
        };
        let of_pose = |rows: &Vec<usize>| {
            let root = (rows.len() as f64).sqrt();
            let sum = |e: usize| rows.iter().map(|&row| moved(row, e)).sum::<f64>() / root;
            (0..k).map(sum).collect()
        };
        small.readings.rows_of_poses().iter().map(of_pose).collect()
    }
}

fn described(
    observations: &Observations,
    effects: &[Instance],
    values: &[f64],
) -> Vec<SupposedEffect> {
    let mut values = values.iter();
    let of = |instance: &Instance| {
        let info = instance.term.info();
        let parameters = info.parameters.iter().zip(values.by_ref());
        SupposedEffect {
            term: info.id.into(),
            class: info.class,
            target: instance.target.name(&observations.mechanism),
            place: place(observations, instance),
            parameters: parameters
                .map(|(p, value)| SupposedParameter {
                    name: p.name.into(),
                    value: *value,
                    unit: unit(observations, instance, p.unit),
                })
                .collect(),
        }
    };
    effects.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_supposition_is_read_as_it_is_written() {
        for (text, spec, parameter, value) in [
            ("curvature@a22.c2=0.02", "curvature@a22", Some("c2"), 0.02),
            ("sag@arm1 = -1e-3", "sag@arm1", None, -1e-3),
            ("curvature@each.2.c2=0.02", "curvature@each.2", Some("c2"), 0.02),
            ("curvature@each.2=0.02", "curvature@each.2", None, 0.02),
            ("slip@a22:17.step=1", "slip@a22:17", Some("step"), 1.0),
        ] {
            let found = Supposed::parse(text).expect(text);
            assert_eq!(found.spec.to_string(), spec);
            assert_eq!((found.parameter.as_deref(), found.value), (parameter, value));
        }
        for text in ["curvature@a22", "curvature@a22=x", "curvature@a22=inf", ""] {
            assert!(matches!(Supposed::parse(text), Err(Error::Option { .. })), "{text}");
        }
    }
}

//! Unobservable and weak directions in the space of parameters, and names of parameters.

use faer::Mat;

use crate::estimate::conventions::ANY_ANGLE;
use crate::estimate::fitted::Fit;
use crate::estimate::note::Note;
use crate::estimate::observations::Observations;
use crate::estimate::sparse::{LISTED, Row, reduced};
use crate::model::{Instance, Spec, place_name};
#[cfg(feature = "serde")]
use crate::numerics::nullable;
use crate::numerics::order;
use crate::numerics::symmetric::{RANK, Unit, is_seen};
use crate::terms::term::{Placed, Role};

/// Unobservable and weak directions in the space of parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Directions {
    /// Directions along which the readings do not change, and others would, or hardly change within a
    /// turn of a joint.
    pub unobservable: Vec<Direction>,
    /// Directions that no reading could ever show: the parameters stay as near to the drawing as
    /// they can.
    pub conventions: Vec<Direction>,
    /// Turns of frames about one line or one point, on which all lies that they see: only play tells them.
    pub turns: Vec<Direction>,
    /// Terms without which nothing would be unobservable.
    pub too_many: Vec<Spec>,
    /// Directions with a standard deviation at least a hundred times that of the best direction.
    pub weak: Vec<Direction>,
}

impl Directions {
    /// Without the unobservable directions in which parameters of these terms take part.
    ///
    /// An effect that was found is named, even where the poses do not determine all of its
    /// parameters: the calibration without the effect is determined, and so is what both predict
    /// together. A tilt of an axis may turn a body as the offset of the next joint does.
    #[must_use]
    pub fn beside(&self, observations: &Observations, found: &[Instance]) -> Self {
        let name =
            |i: &Instance| Label::of(i.term.info().id, &i.target.name(&observations.mechanism));
        let found: Vec<String> = found.iter().map(name).collect();
        let within = |label: &Label| found.contains(&label.name);
        let unobservable = self.unobservable.iter().filter(|direction| match direction {
            Direction::Absent(label) => !within(label),
            Direction::Together(moves) | Direction::Weak { moves, .. } => {
                !moves.iter().any(|moved| within(&moved.label))
            }
        });
        Self { unobservable: unobservable.cloned().collect(), ..self.clone() }
    }
}

/// A direction in the space of parameters.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Direction {
    /// One parameter that changes no reading.
    Absent(Label),
    /// Several parameters that change together without a change of the readings.
    Together(Vec<Moves>),
    /// The same, with hardly a change of the readings.
    Weak {
        /// The parameters, the one that moves most first.
        moves: Vec<Moves>,
        /// Two standard deviations of the first parameter, in its unit.
        off: f64,
    },
}

/// Share of a parameter in a direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Moves {
    /// The parameter.
    pub label: Label,
    /// Change of the parameter, in its unit, for a change of the first parameter by one unit.
    pub by: f64,
}

/// Name and unit of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// Term and target.
    pub name: String,
    /// Unit.
    pub unit: String,
}

impl Label {
    /// How a parameter of a term at a target is named.
    fn of(term: &str, target: &str) -> String {
        format!("{term} {target}")
    }
}

/// The directions that the poses cannot determine, or hardly determine.
///
/// The directions are eigenvectors of the Gram matrix with unit columns. Each is described by the
/// parameters with the largest shares, in their own units.
#[must_use]
pub fn directions(observations: &Observations, fit: &Fit) -> Directions {
    let untouched = fit.model.untouched(&observations.readings, &observations.weights);
    // No sample in use touches these points: what was left out is not to be known.
    let out = |i: usize| untouched.contains(&i);
    let kept: Vec<usize> = (0..fit.gram.nrows()).filter(|&i| !out(i)).collect();
    let names = parameter_names(observations, fit);
    let label =
        |p: &ParameterReport| Label { name: Label::of(&p.term, &p.target), unit: p.unit.clone() };
    let labels: Vec<Label> = names.iter().map(label).collect();
    let own: Vec<Label> = kept.iter().map(|&i| labels[i].clone()).collect();
    let gram = Mat::from_fn(kept.len(), kept.len(), |i, j| fit.gram[(kept[i], kept[j])]);
    let mut found = describe(&gram, &own);
    found.unobservable.clear();
    let conventions = &fit.conventions.rows;
    let norms: Vec<f64> = (0..fit.gram.nrows()).map(|i| fit.gram[(i, i)].max(0.0).sqrt()).collect();
    let length = |i: usize| if norms[i] > 0.0 { norms[i] } else { 1.0 };
    let left = left_open(&fit.conventions.told_beside(&fit.gram), &kept);
    let rows =
        left.into_iter().map(|row| row.iter().zip(0..).map(|(v, i)| v * length(i)).collect());
    let of_terms: Vec<usize> = (0..fit.model.term_parameters).collect();
    let open = reduced(rows.collect(), &of_terms, conventions);
    let held = |(pivot, row): &Row| direction(row, Some(*pivot), &labels, &length);
    [found.turns, found.conventions] =
        fit.conventions.turns_and_others().map(|rows| rows.into_iter().map(held).collect());
    found.unobservable =
        open.iter().map(|(_, row)| direction(row, None, &labels, &length)).collect();
    let lost: Vec<&str> = lost_offsets(fit).iter().map(|&i| labels[i].name.as_str()).collect();
    let is_lost = |direction: &Direction| match direction {
        Direction::Weak { moves, .. } => moves.iter().any(|m| lost.contains(&&*m.label.name)),
        _ => false,
    };
    let (lost, weak): (Vec<_>, _) = found.weak.into_iter().partition(is_lost);
    found.weak = weak;
    found.unobservable.extend(lost);
    for (pivot, _) in open.iter().filter(|(pivot, _)| *pivot < fit.model.term_parameters) {
        let spec = names[*pivot].spec();
        if !found.too_many.contains(&spec) {
            found.too_many.push(spec);
        }
    }
    found
}

/// Columns of the offsets of joints that turn, of which a fit knows no more than before.
fn lost_offsets(fit: &Fit) -> Vec<usize> {
    let offset = |c: usize| fit.model.column(Role::Offset, c);
    let turning = (0..fit.model.scales.len()).filter(|&c| fit.model.mechanism.turns(c));
    turning.filter_map(offset).filter(|&i| fit.covariance[(i, i)].sqrt() > ANY_ANGLE).collect()
}

/// A direction in words of its parameters, the one that moves most first, or the one that is held;
/// `length` is that of the column of each.
fn direction(
    row: &[f64],
    held: Option<usize>,
    labels: &[Label],
    length: &dyn Fn(usize) -> f64,
) -> Direction {
    let mut along: Vec<(usize, f64)> = row.iter().copied().enumerate().collect();
    order::descending(&mut along, |a| a.1.abs());
    let most = along[0].1.abs();
    if let Some(place) = held.and_then(|held| along.iter().position(|(i, _)| *i == held)) {
        let held = along.remove(place);
        along.insert(0, held);
    }
    let (first, largest) = along[0];
    let part = |(i, v): &(usize, f64)| Moves {
        label: labels[*i].clone(),
        by: v / length(*i) / (largest / length(first)),
    };
    let listed = |(i, v): &&(usize, f64)| *i == first || v.abs() > LISTED * most;
    let moves: Vec<Moves> = along.iter().filter(listed).take(6).map(part).collect();
    match moves.len() {
        1 => Direction::Absent(labels[first].clone()),
        _ => Direction::Together(moves),
    }
}

/// Combinations of the parameters `kept` that a Gram matrix leaves open, in the parameters' units.
fn left_open(gram: &Mat<f64>, kept: &[usize]) -> Vec<Vec<f64>> {
    let n = gram.nrows();
    let absent = kept.iter().filter(|&&p| !is_seen(gram[(p, p)]));
    let mut rows: Vec<Vec<f64>> =
        absent.map(|&p| (0..n).map(|i| f64::from(u8::from(i == p))).collect()).collect();
    let Some(unit) = Unit::among(gram.as_ref(), kept.iter().copied()) else { return rows };
    let [lost, _] = unit.lost_and_told();
    for k in lost {
        let mut row = vec![0.0; n];
        let each = unit.live.iter().zip(&unit.norms).enumerate();
        each.for_each(|(i, (&p, norm))| row[p] = unit.vectors[(i, k)] / norm);
        rows.push(row);
    }
    rows
}

/// Relative eigenvalues below this are small: unit columns.
const HARDLY: f64 = 1e-4;

/// The directions of a Gram matrix; `names` are those of its parameters.
pub(crate) fn describe(gram: &Mat<f64>, names: &[Label]) -> Directions {
    let mut out = Directions::default();
    // Where the noise is nothing, or no number, nothing is determined.
    let absent = names.iter().enumerate().filter(|(i, _)| !is_seen(gram[(*i, *i)]));
    out.unobservable.extend(absent.map(|(_, label)| Direction::Absent(label.clone())));
    // Those are said, and no direction takes part in theirs.
    let Some(Unit { live, norms, values, vectors }) = Unit::of(gram.as_ref()) else { return out };
    let largest = values.last().copied().unwrap_or_default();
    for (k, value) in values.iter().enumerate() {
        let relative = value / largest;
        if relative > HARDLY {
            break;
        }
        // Change of each parameter along this direction, per unit of data.
        let mut along: Vec<(usize, f64)> = (0..live.len()).map(|i| (i, vectors[(i, k)])).collect();
        order::descending(&mut along, |a| a.1.abs());
        let (first, largest) = along[0];
        if !largest.is_finite() {
            break;
        }
        let unit = largest / norms[first];
        let taking_part = along.iter().filter(|(_, v)| v.abs() > LISTED * largest.abs());
        let moves = taking_part
            .take(6)
            .map(|&(i, v)| Moves { label: names[live[i]].clone(), by: v / norms[i] / unit })
            .collect();
        if relative < RANK {
            out.unobservable.push(Direction::Together(moves));
        } else {
            out.weak.push(Direction::Weak { moves, off: 2.0 * unit.abs() / value.sqrt() });
        }
    }
    out.weak.truncate(5);
    out
}

/// Condition number of the whitened Jacobian with unit columns, offsets at reading zero.
#[must_use]
pub fn uncentred_condition(fit: &Fit) -> f64 {
    let n = fit.gram.nrows();
    // X_uncentred = X T: the gain column gains the centre times the offset column.
    let mut map = Mat::<f64>::identity(n, n);
    for (c, scale) in fit.model.scales.iter().enumerate() {
        if let (Some(offset), Some(gain)) =
            (fit.model.column(Role::Offset, c), fit.model.column(Role::Gain, c))
        {
            map[(offset, gain)] = scale.centre;
        }
    }
    let gram = map.transpose() * &fit.gram * &map;
    crate::numerics::symmetric::invert(&gram).2
}

/// What an earlier result says of a parameter: the value that it left behind, slips included.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Before {
    /// The earlier estimate.
    pub value: f64,
    /// Standard deviation of the difference, by both uncertainties.
    pub sd: f64,
}

/// An estimate: `interval`, or `value` ± 1.96 `sd` where there is none, covers the truth 95 times in 100.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Parameter")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct ParameterReport {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// The estimate.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub value: f64,
    /// Standard deviation; null where these poses cannot determine the parameter.
    pub sd: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// Bounds of 95 % where `value` ± 1.96 `sd` are not: few degrees of freedom of the noise, or readings
    /// that bend within it, by profile likelihood. A bound is null where the readings set none.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub interval: Option<[Option<f64>; 2]>,
    /// Standard deviation of the mean over groups, as of `between.covariance`; null where there are
    /// none.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sd_between: Option<f64>,
    /// Where a searched term acts: a pose, or another channel; `2/1` is pose 1 of session 2, where several sessions have
    /// that number.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// First and last pose at which something may have happened that has acted ever since, 95 %.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place_interval: Option<[String; 2]>,
    /// What keeps the parameter from being what its term is called.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub note: Option<String>,
    /// What an earlier result says of it, where one was given and knows it.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub earlier: Option<Before>,
}

impl ParameterReport {
    /// A parameter whose value is not known.
    #[must_use]
    pub fn named(term: &str, target: String, name: &str, unit: String) -> Self {
        Self {
            term: term.into(),
            target,
            name: name.into(),
            value: f64::NAN,
            sd: None,
            unit,
            interval: None,
            sd_between: None,
            place: None,
            place_interval: None,
            note: None,
            earlier: None,
        }
    }

    /// Its term at its place.
    #[must_use]
    pub fn spec(&self) -> Spec {
        let Self { term, target, place, .. } = self.clone();
        Spec { term, target: Some(target), place }
    }

    /// The same parameter with what must be noted of it.
    #[must_use]
    pub fn noted(mut self) -> Self {
        self.note = self.noting().map(|note| note.to_string());
        self
    }

    /// What must be noted of it.
    #[must_use]
    pub fn noting(&self) -> Option<Note> {
        Note::of(&self.term, self.value, self.sd)
    }

    /// The note as a sentence about this parameter, for a list of warnings.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        let name = format!("{} {}", self.term, self.target);
        Some(self.noting()?.sentence(&name, self.value, self.sd?, &self.unit))
    }
}

/// Values and covariance for reports: offsets at reading zero, absolute gains, and all other
/// parameters as in the model, in the order of the model.
///
/// ```text
/// θ_off = θ0 + p_off - (k0 + p_gain) a_c,    k = k0 + p_gain
/// ```
#[must_use]
pub fn reported(fit: &Fit) -> (Vec<f64>, Mat<f64>) {
    let (values, map) = as_reported(fit);
    (values, &map * &fit.covariance * map.transpose())
}

/// The same with the covariance of means over groups, which is that of another session.
pub(crate) fn reported_means(fit: &Fit) -> (Vec<f64>, Mat<f64>) {
    let (values, map) = as_reported(fit);
    let covariance = fit.between.as_ref().map_or(&fit.covariance, |between| &between.covariance);
    (values, &map * covariance * map.transpose())
}

/// Values of the parameters as they are reported, and the derivatives of these by the parameters of
/// the model.
pub(crate) fn as_reported(fit: &Fit) -> (Vec<f64>, Mat<f64>) {
    let model = &fit.model;
    let n = model.parameters;
    let mut values = fit.beta.clone();
    let mut map = Mat::<f64>::identity(n, n);
    for (c, scale) in model.scales.iter().enumerate() {
        let gain = model.column(Role::Gain, c);
        let slope = gain.map_or(0.0, |g| fit.beta[g]) + scale.gain;
        if let Some(offset) = model.column(Role::Offset, c) {
            values[offset] = fit.beta[offset] + scale.angle - slope * scale.centre;
            if let Some(gain) = gain {
                map[(offset, gain)] = -scale.centre;
            }
        }
        if let Some(gain) = gain {
            values[gain] = slope;
        }
    }
    (values, map)
}

/// Name, target and unit of every parameter, in order; values and deviations empty.
#[must_use]
pub fn parameter_names(observations: &Observations, fit: &Fit) -> Vec<ParameterReport> {
    let mechanism = &observations.mechanism;
    let mut names = Vec::new();
    for instance in &fit.model.instances {
        for parameter in instance.term.info().parameters {
            let target = instance.target.name(mechanism);
            let unit = unit(observations, instance, parameter.unit);
            let own = ParameterReport::named(instance.term.info().id, target, parameter.name, unit);
            names.push(ParameterReport { place: place(observations, instance), ..own });
        }
    }
    for unknown in &fit.model.unknowns {
        for (name, length) in unknown.thing.coordinates(mechanism) {
            let unit = if length { mechanism.length_unit.clone() } else { "rad".into() };
            let (term, target) = (unknown.thing.term(), unknown.name.clone());
            names.push(ParameterReport::named(term, target, name, unit));
        }
    }
    names
}

/// Name of an instance's place; `None` for a term without places.
#[must_use]
pub fn place(observations: &Observations, instance: &Instance) -> Option<String> {
    let bound = observations.readings.sessions > 1 && crate::model::bound_to_session(instance.term);
    (bound || instance.term.placed() != Placed::Once).then(|| {
        place_name(instance.term, &observations.mechanism, &observations.readings, instance.place)
    })
}

/// The unit of a parameter: [`Mechanism::unit_at`] of its instance.
///
/// [`Mechanism::unit_at`]: crate::mechanism::Mechanism::unit_at
#[must_use]
pub fn unit(observations: &Observations, instance: &Instance, unit: &str) -> String {
    observations.mechanism.unit_at(instance.target, unit)
}

#[cfg(test)]
mod tests {
    use super::{Direction, Label, describe};
    use faer::Mat;

    #[test]
    fn what_changes_no_reading_takes_part_in_no_other_direction() {
        let rows = [[1.0, 1.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let gram = Mat::from_fn(6, 6, |i, j| match (i, j) {
            // The last two parameters do what the first two do, and the third and fourth nothing.
            (2 | 3, _) | (_, 2 | 3) => 0.0,
            (i, j) => rows.iter().map(|r| r[i % 4] * r[j % 4]).sum::<f64>(),
        });
        let label = |name: &str| Label { name: name.into(), unit: String::new() };
        let found = describe(&gram, &["a", "b", "c", "d", "e", "f"].map(label));
        let absent = |d: &&Direction| matches!(d, Direction::Absent(_));
        assert_eq!(found.unobservable.iter().filter(absent).count(), 2);
        let together = found.unobservable.iter().filter_map(|direction| match direction {
            Direction::Together(moves) => Some(moves.len()),
            _ => None,
        });
        let together: Vec<usize> = together.collect();
        assert_eq!(together.len(), 2);
        assert!(together.iter().all(|taking_part| *taking_part >= 2));
    }
}

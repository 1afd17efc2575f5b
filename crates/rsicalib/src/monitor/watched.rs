//! A calibration as the watch needs it: the model, what it is uncertain of, what may change.

use nalgebra::{DMatrix, DVector};

use crate::apply::earlier::{Applied, Under};
use crate::mechanism::{Mechanism, Target};
use crate::model::{Spec, is_unknown_thing};
use crate::monitor::alarm::Change;
use crate::monitor::drift::Drift;
use crate::monitor::factor::{Factor, Multiplied, factors, gains};
use crate::monitor::place::Place;
use crate::monitor::score::MOST_COLUMNS;
use crate::numerics::random::Random;
use crate::readings::Table;
use crate::terms::targets::largest_effect;
use crate::terms::term::{Info, Needs, Role};
use crate::{Error, terms};

/// Rows of the table that the model is compiled for.
const ROWS: usize = 8;

/// The model under a calibration, and its columns.
pub(crate) struct Watched {
    pub(crate) under: Under,
    /// Parameters about which samples are linearised.
    pub(crate) at: Vec<f64>,
    /// Columns of the model that take part: those that are uncertain first.
    pub(crate) order: Vec<usize>,
    /// Unit of each of them.
    pub(crate) scale: Vec<f64>,
    /// Number of uncertain ones, and their covariance, row by row.
    pub(crate) uncertain: usize,
    pub(crate) prior: Vec<f64>,
    /// What may change.
    pub(crate) candidates: Vec<Candidate>,
    /// Factors of the candidates that are one.
    pub(crate) factors: Vec<Factor>,
    /// Rates of the candidates that may drift.
    pub(crate) drifts: Vec<Drift>,
    /// What may have another size in every row.
    pub(crate) places: Vec<Place>,
}

/// A change that is tested.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub(crate) spec: Spec,
    /// Positions in [`Watched::order`].
    pub(crate) columns: Vec<usize>,
    /// Name and unit of each parameter.
    pub(crate) parameters: Vec<(&'static str, String)>,
    /// Unit of each, as in [`Watched::scale`].
    pub(crate) scale: Vec<f64>,
    /// Typical size of each, in that unit.
    pub(crate) typical: Vec<f64>,
    /// Its rate among [`Watched::drifts`], if it may drift.
    pub(crate) drift: Option<usize>,
    /// True for the offset of a joint that turns.
    pub(crate) turns: bool,
}

impl Candidate {
    /// True for a change that is beyond all proportion; a joint may turn by any angle.
    pub(crate) fn is_absurd(&self, values: &DVector<f64>) -> bool {
        let times = values.iter().zip(&self.typical).map(|(value, typical)| value.abs() / typical);
        !self.turns && times.fold(0.0, f64::max) > largest_effect()
    }
}

impl Watched {
    /// As [`Watched::new`], with all that may change at work, at once or little by little.
    pub(crate) fn at_work(
        mechanism: &Mechanism,
        applied: &Applied,
        covariance: &[f64],
    ) -> Result<Self, Error> {
        let (specs, more) = (changes(mechanism), gains(mechanism));
        let own = Self::new(mechanism, applied, Some(covariance), specs, &more)?;
        Ok(own.with_factors(mechanism).with_drifts())
    }

    /// Compiles the model with the changes to test; `covariance` is that of the calibration's
    /// parameters, row by row. The model has the terms `more`, too, which are no candidates.
    pub(crate) fn new(
        mechanism: &Mechanism,
        applied: &Applied,
        covariance: Option<&[f64]>,
        specs: Vec<Spec>,
        more: &[Spec],
    ) -> Result<Self, Error> {
        refuse(mechanism)?;
        refuse_context(mechanism, applied)?;
        let terms: Vec<Spec> = specs.iter().chain(more).cloned().collect();
        let under = Under::new(mechanism, applied, spread(mechanism, applied), &terms)?;
        let internal = internal_covariance(&under, covariance)?;
        let model = &under.model;
        let mut order: Vec<usize> =
            (0..model.parameters).filter(|&p| internal[(p, p)] > 0.0).collect();
        let uncertain = order.len();
        let mut scale: Vec<f64> = order.iter().map(|&p| internal[(p, p)].sqrt()).collect();
        let prior = (0..uncertain * uncertain)
            .map(|k| (k / uncertain, k % uncertain))
            .map(|(i, j)| internal[(order[i], order[j])] / (scale[i] * scale[j]))
            .collect();
        let mut candidates = Vec::new();
        for spec in specs {
            let (term, targets) = spec.targets(mechanism)?;
            let target = targets[0];
            let k = model
                .instances
                .iter()
                .position(|i| i.term.info().id == term.info().id && i.target == target);
            let Some(first) = k.map(|k| model.first[k]) else { continue };
            let mut sizes = model.typical_at(term, target);
            if term.info().broad {
                // A link bends by as much as it is longer than drawn, whatever is moved.
                let bent = model.typical_at(terms::find("link_length")?, target)[0];
                let lengths = term.info().parameters.iter().map(|p| p.unit == "length");
                sizes.iter_mut().zip(lengths).filter(|(_, l)| *l).for_each(|(s, _)| *s = bent);
            }
            let mut columns = Vec::new();
            for (p, size) in (first..).zip(&sizes) {
                columns.push(order.iter().position(|&o| o == p).unwrap_or(order.len()));
                if !order.contains(&p) {
                    order.push(p);
                    scale.push(*size);
                }
            }
            columns.truncate(MOST_COLUMNS);
            let parameters = names(mechanism, term.info(), target);
            let units: Vec<f64> = columns.iter().map(|&z| scale[z]).collect();
            let typical = sizes.iter().zip(&units).map(|(size, unit)| size / unit).collect();
            let turns = term.role() == Role::Offset
                && matches!(target, Target::Channel(channel) if mechanism.turns(channel));
            let (scale, drift) = (units, None);
            candidates.push(Candidate { spec, columns, parameters, scale, typical, drift, turns });
        }
        if order.is_empty() {
            let (needs, why) = ("parameter that may change", "the watch tests what has changed");
            return Err(Error::missing(&mechanism.name, needs, why));
        }
        let at = under.internal(&under.values);
        let (factors, drifts, places) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { at, order, scale, uncertain, prior, candidates, factors, drifts, places, under })
    }

    /// With the factors that a converter's readings may have: each is a column behind those of the
    /// model.
    fn with_factors(mut self, mechanism: &Mechanism) -> Self {
        for Multiplied { spec, size, parts } in factors(mechanism, &self.under.model, &self.at) {
            let own = self.order.len();
            self.candidates.push(Candidate {
                spec,
                columns: vec![own],
                parameters: vec![("gain", "1".into())],
                scale: vec![size],
                typical: vec![1.0],
                drift: None,
                turns: false,
            });
            self.factors.push(Factor { own, parts });
            self.order.push(self.at.len());
            self.scale.push(size);
            self.at.push(0.0);
        }
        self
    }

    /// Lets candidates of one parameter drift: each has a column for its rate, behind those of the
    /// model.
    fn with_drifts(mut self) -> Self {
        for candidate in &mut self.candidates {
            let [base] = candidate.columns[..] else { continue };
            candidate.drift = Some(self.drifts.len());
            self.drifts.push(Drift { own: self.order.len(), base, since: None });
            self.order.push(self.at.len());
            self.scale.push(self.scale[base]);
            self.at.push(0.0);
        }
        self
    }

    /// Rate of a candidate, if it may drift.
    pub(crate) fn drift(&self, candidate: usize) -> Option<&Drift> {
        self.candidates[candidate].drift.map(|drift| &self.drifts[drift])
    }

    /// Parameters of the model in a row, from parameters and rates.
    pub(crate) fn in_row(&self, at: &[f64], row: u64) -> Vec<f64> {
        let mut own = vec![0.0; self.under.model.parameters];
        self.put_in_row(at, row, &mut own);
        own
    }

    /// As [`Watched::in_row`], without new memory.
    pub(crate) fn put_in_row(&self, at: &[f64], row: u64, out: &mut [f64]) {
        out.copy_from_slice(&at[..out.len()]);
        for factor in &self.factors {
            factor
                .parts
                .iter()
                .for_each(|(part, by)| out[*part] += by * at[self.order[factor.own]]);
        }
        for drift in &self.drifts {
            let Some(age) = drift.age(row) else { continue };
            let moved = age * at[self.order[drift.own]];
            match self.factors.iter().find(|factor| factor.own == drift.base) {
                Some(factor) => factor.parts.iter().for_each(|(part, by)| out[*part] += by * moved),
                None => out[self.order[drift.base]] += moved,
            }
        }
    }

    /// Candidates that are offsets of joints that turn.
    pub(crate) fn turning(&self) -> Vec<usize> {
        (0..self.candidates.len()).filter(|&k| self.candidates[k].turns).collect()
    }

    /// Positions of the columns that candidates have, ascending.
    pub(crate) fn tested(&self) -> Vec<usize> {
        let mut tested: Vec<usize> =
            self.candidates.iter().flat_map(|c| c.columns.clone()).collect();
        tested.sort_unstable();
        tested
    }

    /// Moves a column among the uncertain ones.
    pub(crate) fn join(&mut self, position: usize) {
        let first = self.uncertain;
        self.order.swap(position, first);
        self.scale.swap(position, first);
        let columns = self.candidates.iter_mut().flat_map(|c| &mut c.columns);
        let drifts = self.drifts.iter_mut().flat_map(|d| [&mut d.own, &mut d.base]);
        let factors = self.factors.iter_mut().map(|f| &mut f.own);
        for column in columns.chain(drifts).chain(factors) {
            *column = match *column {
                own if own == position => first,
                other if other == first => position,
                same => same,
            };
        }
        self.uncertain += 1;
    }
}

impl Candidate {
    /// Values and covariance of the parameters, in units of [`Watched::scale`], as an alarm has
    /// them: all parameters, size with standard deviation, unit of the size.
    pub(crate) fn changes(
        &self,
        values: &DVector<f64>,
        covariance: &DMatrix<f64>,
    ) -> (Vec<Change>, [f64; 2], String) {
        let scale = |i: usize| self.scale[i];
        let values = DVector::from_fn(values.len(), |i, _| values[i] * scale(i));
        let (rows, columns) = covariance.shape();
        let covariance =
            DMatrix::from_fn(rows, columns, |i, j| covariance[(i, j)] * scale(i) * scale(j));
        let own = self.parameters.iter().map(|(name, unit)| (*name, &**unit));
        displacement(own, &values, &covariance)
    }
}

/// Parameters of a change by their names and units; the length of the displacement that they are, with its standard
/// deviation, and its unit.
pub(crate) fn displacement<'a>(
    named: impl Iterator<Item = (&'a str, &'a str)>,
    values: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> (Vec<Change>, [f64; 2], String) {
    let change = |(i, (name, unit)): (usize, (&str, &str))| Change {
        name: name.into(),
        value: values[i],
        sd: covariance[(i, i)].max(0.0).sqrt(),
        unit: unit.into(),
    };
    let parameters: Vec<Change> = named.enumerate().map(change).collect();
    let unit = parameters[0].unit.clone();
    if let [only] = &*parameters {
        let size = [only.value, only.sd];
        return (parameters, size, unit);
    }
    let along: Vec<usize> = (0..parameters.len()).filter(|&i| parameters[i].unit == unit).collect();
    let size = along.iter().map(|&i| values[i].powi(2)).sum::<f64>().sqrt();
    let part = |i: usize| values[i] / size.max(f64::MIN_POSITIVE);
    let pairs = along.iter().flat_map(|&i| along.iter().map(move |&j| (i, j)));
    let variance: f64 = pairs.map(|(i, j)| part(i) * part(j) * covariance[(i, j)]).sum();
    (parameters, [size, variance.max(0.0).sqrt()], unit)
}

/// Name and unit of each parameter of a term at a target.
fn names(mechanism: &Mechanism, info: &Info, target: Target) -> Vec<(&'static str, String)> {
    let slides = matches!(target, Target::Channel(c) if mechanism.slides(c));
    let unit = |unit: &str| match unit {
        "length" => mechanism.length_unit.clone(),
        "rad" if slides => mechanism.length_unit.clone(),
        other => other.to_string(),
    };
    info.parameters.iter().map(|p| (p.name, unit(p.unit))).collect()
}

/// True where the rows of one session can be tested under the calibration of another.
pub(crate) fn tells_by_rows(mechanism: &Mechanism, applied: &Applied) -> bool {
    refuse(mechanism).is_ok() && refuse_context(mechanism, applied).is_ok()
}

/// Refuses mechanisms whose loops are not closed in every sample.
fn refuse(mechanism: &Mechanism) -> Result<(), Error> {
    let read = mechanism.value_columns().len() > mechanism.law_columns().len();
    let (needs, why) = match () {
        () if mechanism.closures.is_empty() => ("closure", "the watch tests that loops close"),
        () if !mechanism.key_columns().is_empty() => (
            "closure without unknown points or planes",
            "the watch tests that the same loops close in every sample: write what the calibration found as `at` \
             of the point, or as the plane, in place of `unknown`, and leave out closures that columns measure",
        ),
        () if read => (
            "closure of a constant value",
            "the watch tests that the same loops close in every sample: leave out closures that columns measure, \
             a tracker's points among them",
        ),
        () => return Ok(()),
    };
    Err(Error::missing(&mechanism.name, needs, why))
}

/// Refuses terms that the channels of one row do not tell.
fn refuse_context(mechanism: &Mechanism, applied: &Applied) -> Result<(), Error> {
    let known = applied.parameters.iter().map(|one| &one.spec);
    for spec in known.filter(|spec| !is_unknown_thing(&spec.term)) {
        let term = terms::find_in(mechanism, &spec.term)?;
        let of_more = |needs: &Needs| needs.of_way() || *needs == Needs::Temperature;
        let Some(needs) = term.needs().into_iter().find(of_more) else { continue };
        // A slow servo rounds corners, too, which no move of its column undoes.
        let next = match term.is_delay() {
            true => {
                "move its columns by the delay, in these readings and in those of the calibration"
            }
            false => "calibrate or trace without it",
        };
        let target = spec.target.as_ref().map_or(String::new(), |target| format!(" of {target}"));
        let found = format!("{}{target} (needs {})", spec.term, needs.words());
        let expected = format!("terms that the channels of one row tell: {next}");
        return Err(Error::option("calibration", found, expected));
    }
    Ok(())
}

/// What may change: every channel, closure and chain.
///
/// A link that bends moves all that it carries: the frame at its far end, or at the end of a
/// chain the point itself.
pub(crate) fn changes(mechanism: &Mechanism) -> Vec<Spec> {
    let spec = |term: &str, target: Target| Spec {
        term: term.into(),
        target: Some(target.name(mechanism)),
        place: None,
    };
    let mut changes: Vec<Spec> =
        (0..mechanism.channels.len()).map(|c| spec("offset", Target::Channel(c))).collect();
    for (k, closure) in mechanism.closures.iter().enumerate() {
        if closure.kind.has_value() && mechanism.is_drawn(k) {
            changes.push(spec("distance", Target::Closure(k)));
        }
    }
    for (c, chain) in mechanism.chains.iter().enumerate() {
        let sensed = chain.rows.iter().position(|r| r.channel.is_some());
        for (r, row) in chain.rows.iter().enumerate() {
            let moves = sensed.is_some_and(|first| r >= first);
            if moves && row.body().translation.vector.norm() > 0.0 {
                changes.push(spec("link_frame", Target::Row(c, r)));
            }
        }
        let off = |at: &[f64; 3]| at.iter().any(|v| *v != 0.0);
        let carried = mechanism.points.iter().filter(|p| p.chain.as_ref() == Some(&chain.name));
        if sensed.is_some() && carried.filter_map(|p| p.at).any(|at| off(&at)) {
            changes.push(spec("point_position", Target::Chain(c)));
        }
    }
    changes
}

/// Readings over what the calibration has seen, for which the model is compiled.
fn spread(mechanism: &Mechanism, applied: &Applied) -> Table {
    let mut random = Random::new(0);
    let mut values = Vec::with_capacity(ROWS * mechanism.channels.len());
    for _ in 0..ROWS {
        for (c, channel) in mechanism.channels.iter().enumerate() {
            let [mut low, mut high] = applied.reference.span.get(c).copied().unwrap_or_default();
            if high.is_nan() || high <= low {
                [low, high] = channel.range.unwrap_or([-1.0, 1.0]);
            }
            values.push(random.uniform(low, high));
        }
    }
    Table { values, time: Some((0..ROWS).map(|row| row as f64).collect()), ..Table::default() }
}

/// Covariance of the model's own parameters, which depend linearly on the reported ones.
pub(crate) fn internal_covariance(
    under: &Under,
    covariance: Option<&[f64]>,
) -> Result<DMatrix<f64>, Error> {
    let (n, p) = (under.values.len(), under.model.parameters);
    let Some(covariance) = covariance else { return Ok(DMatrix::zeros(p, p)) };
    Error::same("covariance", covariance.len(), n * n)?;
    let known = |i: usize| (0..n).all(|j| covariance[i * n + j].is_finite());
    let finite =
        |i: usize, j: usize| if known(i) && known(j) { covariance[i * n + j] } else { 0.0 };
    let here = under.internal(&under.values);
    let mut slopes = DMatrix::zeros(p, n);
    for k in 0..n {
        let step = finite(k, k).max(0.0).sqrt();
        if step > 0.0 {
            let mut moved = under.values.clone();
            moved[k] += step;
            let change = under.internal(&moved);
            (0..p).for_each(|row| slopes[(row, k)] = (change[row] - here[row]) / step);
        }
    }
    let own = DMatrix::from_fn(n, n, finite);
    Ok(&slopes * own * slopes.transpose())
}

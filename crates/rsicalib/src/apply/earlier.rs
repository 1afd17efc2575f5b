//! An earlier result, applied to readings that it has not seen.
//!
//! Of what was found in a session not all holds in another one, see [`Outlasts`]: a drift
//! is left out, and a slip has happened before the first row.

use nalgebra::DMatrix;

use crate::apply::check::{Check, compare, unturned};
use crate::apply::known::Known;
use crate::apply::poses::poses_of;
use crate::closures::kind::Part as EndOf;
use crate::error::index_of;
use crate::estimate::Noise;
use crate::estimate::Observations;
use crate::estimate::Part;
use crate::estimate::settle::settled;
use crate::mechanism::{Channel, Closure, Mechanism, Point, Target};
use crate::model::{Instance, Model, Spec, Thing, Want, Workspace, instances_of, is_unknown_thing};
use crate::numerics::lanes::Lanes;
use crate::readings::{Readings, Table, as_of};
use crate::terms::term::{Outlasts, Over, Per, Role, Term};
use crate::{Error, terms};

/// What the parameters of a result refer to, beside the mechanism.
///
/// Offsets are told apart from gains about `centre`, a free curve runs over
/// `span`, and temperatures count from `temperature`: all of the readings that
/// the result was found with. A gain turns about reading zero where no offset was fitted.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Reference {
    /// Mean reading of each channel, zero where its offset is as it was drawn.
    pub centre: Vec<f64>,
    /// Lowest and highest reading of each channel.
    pub span: Vec<[f64; 2]>,
    /// Mean temperature [°C], where it was measured.
    pub temperature: Option<f64>,
}

impl Reference {
    /// Of the readings of a fit.
    #[must_use]
    pub fn of(observations: &Observations) -> Self {
        let readings = &observations.readings;
        Self {
            centre: observations.centre.clone(),
            span: readings.span.clone(),
            temperature: readings.mean_temperature,
        }
    }
}

/// A parameter as a result reports it: offsets at reading zero, gains absolute.
#[derive(Debug, Clone, PartialEq)]
pub struct Reported {
    /// Its term at its target.
    pub spec: Spec,
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// A result, as far as it bears on other readings than its own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Applied {
    /// Its parameters; none: the mechanism as it is declared.
    pub parameters: Vec<Reported>,
    /// What they refer to.
    pub reference: Reference,
    /// Standard deviation of one reading of each channel.
    pub sigma: Vec<f64>,
    /// True where those were declared, not estimated.
    pub declared: bool,
    /// How well closures held in its session, [`NoiseEstimate::of_closures`]; one that is not among
    /// them holds as the mechanism declares.
    ///
    /// [`NoiseEstimate::of_closures`]: crate::estimate::noise::source::NoiseEstimate::of_closures
    pub closures: Vec<(String, f64)>,
    /// True for the very sessions that the result was found with: all of it acts then, where
    /// and when it did.
    #[doc(hidden)]
    pub own: bool,
}

impl Applied {
    /// The mechanism as it is declared: nothing refers to readings where nothing was found with them.
    #[must_use]
    pub fn declared(mechanism: &Mechanism) -> Self {
        let channels = &mechanism.channels;
        let (centre, span) = (vec![0.0; channels.len()], vec![[0.0; 2]; channels.len()]);
        Self {
            reference: Reference { centre, span, temperature: None },
            sigma: channels.iter().map(Channel::presumed_noise).collect(),
            ..Self::default()
        }
    }
}

/// What of a reported effect holds beyond the session in which it was found.
///
/// Unknown points do not: what a device touched is no part of it.
///
/// # Errors
///
/// [`Error::Unknown`] where there is no such term.
pub fn outlasts(mechanism: &Mechanism, spec: &Spec) -> Result<Outlasts, Error> {
    match spec.term.as_str() {
        id if is_unknown_thing(id) => Ok(Outlasts::Nothing),
        id => terms::find_in(mechanism, id).map(Term::outlasts),
    }
}

/// The terms of a result that a later session is identified with: those that outlast their
/// own as a whole, each once.
///
/// The value of a slip, which holds, is part of the offsets then.
///
/// # Errors
///
/// As [`outlasts`].
pub fn lasting<'a>(
    mechanism: &Mechanism,
    specs: impl IntoIterator<Item = &'a Spec>,
) -> Result<Vec<Spec>, Error> {
    let mut lasting: Vec<Spec> = Vec::new();
    for spec in specs {
        if outlasts(mechanism, spec)? == Outlasts::Whole && !lasting.contains(spec) {
            lasting.push(spec.clone());
        }
    }
    Ok(lasting)
}

/// The units that a parameter of a result may have: one, or that of each of its targets; none for
/// what is unknown, which does not outlast its session.
///
/// # Errors
///
/// [`Error::Unknown`] where there is no such term, target or name.
pub fn units_of(mechanism: &Mechanism, spec: &Spec, name: &str) -> Result<Vec<String>, Error> {
    if is_unknown_thing(&spec.term) {
        return Ok(Vec::new());
    }
    let (term, targets) = spec.targets(mechanism)?;
    let unit = term.info().parameters[parameter_index(term, name)?].unit;
    Ok(targets.into_iter().map(|target| mechanism.unit_at(target, unit)).collect())
}

/// The unit of a parameter that a column is called after, as `gain@a11` and `curvature@a22.c2`; none
/// where its targets have several, and where there is no such parameter.
#[must_use]
pub fn unit_of_key(mechanism: &Mechanism, key: &str) -> Option<String> {
    let id = Spec::from(key).term;
    if is_unknown_thing(&id) {
        let flat = [Thing::Plane(0), Thing::Line(0), Thing::Frame(0)];
        // Every coordinate of a point is a length.
        let own = flat.into_iter().find(|thing| thing.term() == id);
        let coordinates = own.map_or_else(Vec::new, |thing| thing.coordinates(mechanism));
        let turns = |(name, long): &(&str, bool)| !long && key.ends_with(&format!(".{name}"));
        let turned = coordinates.iter().any(turns);
        return Some(if turned { "rad".into() } else { mechanism.length_unit.clone() });
    }
    let info = terms::find_in(mechanism, &id).ok()?.info();
    // A parameter that is called as its term has no name of its own in the key.
    let suffix = |name: &str| if name == info.id { String::new() } else { format!(".{name}") };
    let named = info.parameters.iter().map(|p| (p.name, suffix(p.name)));
    let (name, long) = named
        .filter(|(_, suffix)| key.ends_with(suffix.as_str()))
        .map(|(name, suffix)| (name, suffix.len()))
        .max_by_key(|(_, long)| *long)?;
    let spec = Spec::from(&key[..key.len() - long]);
    let units = units_of(mechanism, &spec, name).ok()?;
    let first = units.first()?.clone();
    units.iter().all(|unit| *unit == first).then_some(first)
}

/// Error of a result on known poses, as [`crate::apply::check::check`] has it of a fit.
///
/// # Errors
///
/// As [`platform_poses`] and [`points`].
pub fn check(
    mechanism: &Mechanism,
    applied: &Applied,
    known: &Known,
    align: bool,
) -> Result<Check, Error> {
    let carried = known.carried(mechanism)?;
    let found = |table| match carried {
        None => platform_poses(mechanism, applied, table),
        Some(point) => {
            let mut points = points(mechanism, applied, table)?;
            Ok(points.swap_remove(point).into_iter().map(unturned).collect())
        }
    };
    compare(mechanism, known, align, found).map(|(check, _)| check)
}

/// Platform pose of every row of a table under a result.
///
/// # Errors
///
/// As [`crate::apply::poses::platform_poses`], and [`Error::Unknown`] where a parameter
/// has no such term, target or name.
pub fn platform_poses(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    if mechanism.platform.is_empty() {
        let why = "poses need the points that carry it";
        return Err(Error::missing(&mechanism.name, "platform", why));
    }
    let under = Under::new(mechanism, applied, table, &[])?;
    Ok(under.poses(&under.values))
}

/// Where the chains carry their points under a result, row by row of a table.
///
/// One entry for each point of the mechanism that a chain carries, in order; the
/// readings as they are. Nothing else of the closures is needed: the table has no
/// columns beside those of the channels.
///
/// # Errors
///
/// As [`platform_poses`]; [`Error::Missing`] where no chain carries a point.
pub fn points(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    let under = Under::open(mechanism, applied, table, &[])?;
    Ok(under.points(&under.values))
}

/// The same chains with their points, closed on nothing that readings would have to name.
///
/// # Errors
///
/// [`Error::Missing`] where no chain carries a point.
pub(crate) fn opened(mechanism: &Mechanism) -> Result<Mechanism, Error> {
    let mut points: Vec<Point> =
        mechanism.points.iter().filter(|p| p.chain.is_some()).cloned().collect();
    let Some(carried) = points.iter().find(|p| p.chain.is_some()).map(|p| p.name.clone()) else {
        let why = "there is nothing whose place could be told";
        return Err(Error::missing(&mechanism.name, "point on a chain", why));
    };
    let mut anchor = String::from("base");
    while points.iter().any(|p| p.name == anchor) {
        anchor.push('_');
    }
    points.push(Point { name: anchor.clone(), at: Some([0.0; 3]), ..Point::default() });
    // A channel that reads a length, or is like another, senses no joint: it stays at what it read.
    let senses = |closure: &&Closure| {
        closure.channel.is_some() || closure.kind.facts().between.contains(&EndOf::Channel)
    };
    let sensed = mechanism.closures.iter().filter(senses).map(|closure| {
        let between = match closure.channel {
            Some(_) => [carried.clone(), anchor.clone()],
            None => closure.between.clone(),
        };
        Closure { between, ..closure.clone() }
    });
    let closure = Closure::touch(anchor.clone(), [carried.clone(), anchor.clone()]);
    let closures = std::iter::once(closure).chain(sensed).collect();
    Ok(Mechanism {
        points,
        closures,
        planes: Vec::new(),
        lines: Vec::new(),
        frames: Vec::new(),
        platform: std::collections::BTreeMap::new(),
        rest: None,
        ..mechanism.clone()
    })
}

/// True where loops that close in every row say what its drives hold: which joints have none, or share a load.
fn loops_share_torques(mechanism: &Mechanism) -> bool {
    let closes = mechanism.key_columns().is_empty()
        && mechanism.value_columns().len() == mechanism.law_columns().len()
        && mechanism.frames.iter().all(|frame| !frame.moves())
        && mechanism.points.iter().all(|point| !mechanism.is_moving(point));
    mechanism.tells_of_drives() && closes
}

/// A model of readings, and which of its parameters are those of a result.
#[derive(Debug)]
pub(crate) struct Under {
    pub(crate) model: Model,
    pub(crate) readings: Readings,
    /// The values of the result.
    pub(crate) values: Vec<f64>,
    /// For each of them, the parameters of the model that it is; none where it does not act.
    pub(crate) columns: Vec<Vec<usize>>,
    /// Of readings and closures, as the result has them.
    pub(crate) noise: Noise,
}

impl Under {
    /// The mechanism under a result, with terms `more` that the result lacks.
    pub(crate) fn new(
        mechanism: &Mechanism,
        applied: &Applied,
        table: Table,
        more: &[Spec],
    ) -> Result<Self, Error> {
        Self::build(mechanism, applied, table, |_| true, more)
    }

    /// Its chains under a result, without what closes them, with terms `more` that the result lacks; with the loops
    /// where the torques of its drives follow from those.
    pub(crate) fn open(
        mechanism: &Mechanism,
        applied: &Applied,
        table: Table,
        more: &[Spec],
    ) -> Result<Self, Error> {
        if loops_share_torques(mechanism) {
            return Self::new(mechanism, applied, table, more);
        }
        let opened = opened(mechanism)?;
        let table = as_of(table, mechanism, &opened);
        let carries = |spec: &Spec| {
            let term = terms::find_in(mechanism, &spec.term);
            term.is_ok_and(|term| term.info().per != Per::Closure)
        };
        Self::build(&opened, applied, table, carries, more)
    }

    fn build(
        mechanism: &Mechanism,
        applied: &Applied,
        table: Table,
        wanted: impl Fn(&Spec) -> bool,
        more: &[Spec],
    ) -> Result<Self, Error> {
        let Applied { parameters, reference, sigma, own, .. } = applied;
        let channels = mechanism.channels.len();
        for (what, found) in [
            ("centre", reference.centre.len()),
            ("span", reference.span.len()),
            ("sigma", sigma.len()),
        ] {
            Error::same(what, found, channels)?;
        }
        let mut readings = Readings::new(mechanism, table)?;
        if let Some(mean) = reference.temperature {
            readings.count_temperature_from(mean);
        }
        let mut instances: Vec<Instance> = Vec::new();
        // Instances by number, and which of their parameters it is.
        let mut acting: Vec<(Vec<usize>, usize)> = Vec::new();
        for p in parameters {
            if is_unknown_thing(&p.spec.term) {
                acting.push((Vec::new(), 0));
                continue;
            }
            let found = match wanted(&p.spec) {
                true => acting_as(mechanism, &readings, &p.spec, *own)?,
                false => Vec::new(),
            };
            let k = match found.first() {
                Some(instance) => parameter_index(instance.term, &p.name)?,
                None => 0,
            };
            let mut numbers = Vec::with_capacity(found.len());
            for instance in found {
                let at = instances.iter().position(|i| *i == instance);
                numbers.push(at.unwrap_or(instances.len()));
                if at.is_none() {
                    instances.push(instance);
                }
            }
            acting.push((numbers, k));
        }
        for spec in more {
            for instance in instances_of(mechanism, &readings, spec)? {
                if !instances.contains(&instance) {
                    instances.push(instance);
                }
            }
        }
        let mut model = Model::new(mechanism, &readings, instances)?;
        for (c, (&centre, &span)) in reference.centre.iter().zip(&reference.span).enumerate() {
            let scale = &mut model.scales[c];
            let centre = mechanism.centre(c, centre);
            scale.angle += scale.gain * (centre - scale.centre);
            *scale = scale.referred_to(mechanism, c, centre, span);
        }
        let columns = acting.into_iter().zip(parameters).map(|((numbers, k), p)| {
            match is_unknown_thing(&p.spec.term) {
                true => model.column_called(&p.spec, &p.name).into_iter().collect(),
                false => numbers.into_iter().map(|i| model.first[i] + k).collect(),
            }
        });
        let columns = columns.collect();
        let values = parameters.iter().map(|p| p.value).collect();
        let noise = Noise::declared(sigma.clone()).with_closures(&model, &applied.closures);
        Ok(Self { model, readings, values, columns, noise })
    }

    /// True for a row at which a shape is beyond the readings of the result.
    pub(crate) fn beyond(&self) -> Vec<bool> {
        let Self { model, readings, .. } = self;
        let shapes = model
            .instances
            .iter()
            .filter(|i| i.term.info().penalised && i.term.over() == Some(Over::Reading));
        let mechanism = &model.mechanism;
        let channels: Vec<usize> = shapes.flat_map(|i| mechanism.channels_at(i.target)).collect();
        let beyond = |row: usize, c: usize| {
            let ([low, high], at) = (model.scales[c].span, readings.row(row)[c]);
            low < high && !(low <= at && at <= high)
        };
        (0..readings.samples).map(|row| channels.iter().any(|c| beyond(row, *c))).collect()
    }

    /// Holds shapes at the ends of the readings of the result, or lets them go on.
    pub(crate) fn hold_shapes(&mut self, held: bool) {
        self.model.scales.iter_mut().for_each(|scale| scale.held = held);
    }

    /// The model's own parameters, the inverse of [`crate::estimate::directions::reported`].
    ///
    /// What happened several times before the first row adds up; what was unknown is where it was
    /// found.
    pub(crate) fn internal(&self, values: &[f64]) -> Vec<f64> {
        let model = &self.model;
        let mut beta = model.nominal();
        for (value, columns) in values.iter().zip(&self.columns) {
            for &column in columns {
                let so_far = if column < model.term_parameters { beta[column] } else { 0.0 };
                beta[column] = so_far + value;
            }
        }
        // What the result does not have is as the mechanism declares it.
        let reported = |column: &usize| self.columns.iter().any(|own| own.contains(column));
        for (c, scale) in model.scales.iter().enumerate() {
            let gain = model.column(Role::Gain, c).filter(reported);
            let slope = gain.map_or(scale.gain, |g| beta[g]);
            if let Some(offset) = model.column(Role::Offset, c).filter(reported) {
                beta[offset] += slope * scale.centre - scale.angle;
            }
            if let Some(gain) = gain {
                beta[gain] = slope - scale.gain;
            }
        }
        beta
    }

    /// Derivatives of the model's parameters `beta` by those that the result reports: they are linear.
    pub(crate) fn by_reported(&self, beta: &[f64]) -> DMatrix<f64> {
        let mut map = DMatrix::zeros(beta.len(), self.values.len());
        for k in 0..self.values.len() {
            let mut values = self.values.clone();
            values[k] += 1.0;
            for (i, (ahead, here)) in self.internal(&values).iter().zip(beta).enumerate() {
                map[(i, k)] = ahead - here;
            }
        }
        map
    }

    /// Platform pose of every row where the result has these values.
    pub(crate) fn poses(&self, values: &[f64]) -> Vec<[f64; 6]> {
        poses_of(&self.model, &self.readings, &self.internal(values), &self.noise)
    }

    /// Place of every point that is somewhere else in each pose, row by row, where the result has
    /// these values: where the closures have it, each reading as far off as its noise allows, (59).
    pub(crate) fn moving(&self, values: &[f64]) -> Vec<Vec<[f64; 3]>> {
        self.moving_at(&self.internal(values))
    }

    /// The same with these parameters of the model.
    pub(crate) fn moving_at(&self, beta: &[f64]) -> Vec<Vec<[f64; 3]>> {
        let (model, readings) = (&self.model, &self.readings);
        let part = Part { model, readings, weights: None };
        let mut out = vec![vec![[f64::NAN; 3]; readings.samples]; model.posed.points.len()];
        for (block, meta) in readings.blocks().iter().enumerate() {
            let found = settled(&part, &self.noise, block, beta);
            let xi = &found[readings.channels..];
            let gates: Vec<Lanes> = model.gates_in(meta).collect();
            for (number, out) in out.iter_mut().enumerate() {
                let at = model.posed_point(number, xi, beta, &gates);
                for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                    out[row] = at.map(|coordinate| coordinate.0[lane]);
                }
            }
        }
        out
    }

    /// Place of every carried point in every row where the result has these values.
    pub(crate) fn points(&self, values: &[f64]) -> Vec<Vec<[f64; 3]>> {
        self.points_at(&self.internal(values))
    }

    /// The same with these parameters of the model.
    pub(crate) fn points_at(&self, beta: &[f64]) -> Vec<Vec<[f64; 3]>> {
        let (model, readings) = (&self.model, &self.readings);
        let points = &model.mechanism.points;
        let carried: Vec<usize> =
            (0..points.len()).filter(|&p| points[p].chain.is_some()).collect();
        let mut out = vec![vec![[f64::NAN; 3]; readings.samples]; carried.len()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
            let points = model.points(&ws, beta);
            for (out, &p) in out.iter_mut().zip(&carried) {
                let Some(at) = points[p] else { continue };
                for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                    out[row] = at.map(|v| v.0[lane]);
                }
            }
        }
        out
    }
}

/// As what a reported effect acts on readings: its own, or others.
fn acting_as(
    mechanism: &Mechanism,
    readings: &Readings,
    spec: &Spec,
    own: bool,
) -> Result<Vec<Instance>, Error> {
    match outlasts(mechanism, spec)? {
        Outlasts::Nothing if !own => Ok(Vec::new()),
        Outlasts::Value if !own => {
            let (term, targets) = spec.targets(mechanism)?;
            let past = |target: Target| Instance { term, target, place: 0 };
            Ok(targets.into_iter().map(past).collect())
        }
        _ => instances_of(mechanism, readings, spec),
    }
}

/// Which of a term's parameters bears a name.
pub(crate) fn parameter_index(term: &dyn Term, name: &str) -> Result<usize, Error> {
    index_of(term.info().parameters, |parameter| parameter.name, "parameter", name)
}

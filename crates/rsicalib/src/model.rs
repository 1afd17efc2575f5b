//! The model: a mechanism and its terms, from readings to misclosure.
//!
//! For one sample with readings `a` and parameters `β`,
//!
//! ```text
//! r = a + Σ δ_electronics(a)                                              (41)
//! q = k0 r + θ0 + Σ δ_sensor(r)                                           (42)
//! q' = q + Σ compliance · torque(q)                                       (43)
//! f = |p_a(q') - p_b(q')|² - d²      or      p_a - p_b                    (10)
//! ```
//!
//! with the derivatives by the chain rule,
//!
//! ```text
//! A = ∂f/∂a = G (∂q'/∂q) diag(∂q/∂r) (∂r/∂a)          G = ∂f/∂q'          (44)
//! X = ∂f/∂β                                                               (12)
//! ```
//!
//! Terms of one stage all see what enters the stage and add up, so their order
//! does not matter. Everything is computed for eight samples at a time.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::chain::{Axis, Carried, Lever, Posture, Source, Step, Way, push_place};
use crate::lanes::{Lanes, Vec3, cross, dispatch, dot, minus};
use crate::mechanism::{ClosureKind, Value};
use crate::objective::Prior;
use crate::readings::Readings;
use crate::terms::{
    self, Acts, Electronics, Needs, Per, Placed, Scale, Sensor, Site, Spot, Term, Weight,
};
use crate::{Error, Mechanism};

/// Most parameters that one term may have.
pub const MOST_PARAMETERS: usize = 16;

/// What an instance of a term belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Target {
    /// The whole mechanism.
    All,
    /// A channel.
    Channel(usize),
    /// A row of a chain, counted from 0.
    Row(usize, usize),
    /// A chain.
    Chain(usize),
    /// A closure.
    Closure(usize),
}

impl Target {
    /// As users write it: `a22`, `arm2/2`, `arm2`, `wrist1-wrist2`, `all`.
    #[must_use]
    pub fn name(self, mechanism: &Mechanism) -> String {
        match self {
            Self::All => "all".into(),
            Self::Channel(c) => mechanism.channels[c].name.clone(),
            Self::Chain(c) => mechanism.chains[c].name.clone(),
            Self::Row(c, row) => format!("{}/{}", mechanism.chains[c].name, row + 1),
            Self::Closure(c) => mechanism.closures[c].name.clone(),
        }
    }
}

/// One term at one target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// The term.
    pub term: &'static dyn Term,
    /// Where it acts.
    pub target: Target,
    /// Where a searched term acts: a pose, or another channel.
    pub place: usize,
}

impl Instance {
    /// Number of its parameters.
    #[must_use]
    pub fn width(&self) -> usize {
        self.term.info().parameters.len()
    }
}

/// Every target that a term may have in a mechanism.
#[must_use]
pub fn targets(term: &dyn Term, mechanism: &Mechanism) -> Vec<Target> {
    match term.info().per {
        Per::All => vec![Target::All],
        Per::Channel => (0..mechanism.channels.len())
            .filter(|&c| term.info().needs != Needs::Masses || carries_mass(mechanism, c))
            // Of two poses a search has places to try, unless there can be none.
            .filter(|&c| !term.places(mechanism, c, 2).is_empty())
            .map(Target::Channel)
            .collect(),
        Per::Chain => (0..mechanism.chains.len()).map(Target::Chain).collect(),
        Per::ChainOrAll => {
            let chains = (0..mechanism.chains.len()).map(Target::Chain);
            chains.chain([Target::All]).collect()
        }
        Per::Closure => (0..mechanism.closures.len())
            .filter(|&c| mechanism.closures[c].kind == ClosureKind::Distance)
            .map(Target::Closure)
            .collect(),
        Per::Row => mechanism
            .chains
            .iter()
            .enumerate()
            .flat_map(|(c, chain)| (0..chain.rows.len()).map(move |r| Target::Row(c, r)))
            .collect(),
    }
}

fn carries_mass(mechanism: &Mechanism, channel: usize) -> bool {
    let name = &mechanism.channels[channel].name;
    mechanism.chains.iter().any(|chain| {
        let joint = chain.rows.iter().position(|r| r.channel.as_ref() == Some(name));
        joint.is_some_and(|j| chain.rows[j..].iter().any(|r| r.mass.is_some()))
    })
}

/// The instances that a list of specifications asks for.
///
/// `offset` is the term at every target, `curvature@a22` at one, and
/// `crosstalk@a22:a21`, `slip@a22:17` at one place of a searched term.
///
/// # Errors
///
/// [`Error::Unknown`] with the names there are.
pub fn parse(
    mechanism: &Mechanism,
    readings: &Readings,
    specs: &[String],
) -> Result<Vec<Instance>, Error> {
    let mut instances: Vec<Instance> = Vec::new();
    for spec in specs {
        let (id, at) = spec.split_once('@').map_or((spec.as_str(), None), |(i, t)| (i, Some(t)));
        let term = terms::find(id)?;
        let (at, place) = match at.and_then(|t| t.split_once(':')) {
            Some((t, p)) => (Some(t), Some(p)),
            None => (at, None),
        };
        let all = targets(term, mechanism);
        let known = || all.iter().map(|t| t.name(mechanism)).collect::<Vec<_>>().join(", ");
        let unknown =
            |found: &str| Error::Unknown { kind: "target", found: found.into(), known: known() };
        let chosen: Vec<Target> = match at {
            None => all.clone(),
            Some(name) => {
                vec![*all.iter().find(|t| t.name(mechanism) == name).ok_or_else(|| unknown(name))?]
            }
        };
        for target in chosen {
            let channel = if let Target::Channel(c) = target { c } else { 0 };
            let places = places(term, mechanism, readings, channel);
            if place.is_none() && bound_to_session(term) {
                for &place in &places {
                    let instance = Instance { term, target, place };
                    if !instances.contains(&instance) {
                        instances.push(instance);
                    }
                }
                continue;
            }
            let place = match place {
                None => places.first().copied().unwrap_or(0),
                Some(name) => {
                    let names = places.iter().map(|&p| place_name(term, mechanism, readings, p));
                    let names: Vec<String> = names.collect();
                    let at = names.iter().position(|n| n == name);
                    places[at.ok_or_else(|| Error::Unknown {
                        kind: "place",
                        found: name.into(),
                        known: names.join(", "),
                    })?]
                }
            };
            let instance = Instance { term, target, place };
            if !instances.contains(&instance) {
                instances.push(instance);
            }
        }
    }
    Ok(instances)
}

/// True for a term that each session has anew: what drifts starts again.
#[must_use]
pub fn bound_to_session(term: &dyn Term) -> bool {
    term.info().needs == Needs::Order && term.placed() == Placed::Once
}

/// Places of a term at a target: a session, or where a searched term acts.
#[must_use]
pub fn places(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
    channel: usize,
) -> Vec<usize> {
    if bound_to_session(term) {
        (0..readings.sessions).collect()
    } else {
        term.places(mechanism, channel, readings.poses())
    }
}

/// How users call the place of a term: a pose label, a channel, or a session.
#[must_use]
pub fn place_name(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
    place: usize,
) -> String {
    match term.placed() {
        Placed::AtChannel => mechanism.channels[place].name.clone(),
        Placed::AtPose => readings.labels.get(place).map(ToString::to_string).unwrap_or_default(),
        Placed::Once if bound_to_session(term) => (place + 1).to_string(),
        Placed::Once => String::new(),
    }
}

/// One end of a closure.
#[derive(Debug, Clone, Copy)]
enum End {
    /// On a chain, in the frame at its end.
    Carried(usize, [f64; 3]),
    /// Fixed in the base.
    Fixed([f64; 3]),
    /// Unknown: index among the unknown points of the mechanism.
    Unknown(usize),
}

#[derive(Debug, Clone)]
struct CompiledClosure {
    kind: ClosureKind,
    ends: [End; 2],
    /// Known value; the mean of the column where it is one of the readings.
    value: f64,
    column: Option<usize>,
    /// Parameter of a `distance` term, if there is one.
    parameter: Option<usize>,
    /// First equation.
    equation: usize,
    /// Play, in length units.
    noise: f64,
}

#[derive(Clone, Copy)]
struct SensorAt {
    term: &'static dyn Sensor,
    channel: usize,
    place: usize,
    /// The one session in which it acts, of several.
    session: Option<usize>,
    first: usize,
    width: usize,
}

#[derive(Clone, Copy)]
struct ElectronicsAt {
    term: &'static dyn Electronics,
    /// None: every channel.
    channel: Option<usize>,
    place: usize,
    /// The one session in which it acts, of several.
    session: Option<usize>,
    first: usize,
    width: usize,
}

#[derive(Debug, Clone)]
struct LoadAt {
    whose: Weight,
    chain: usize,
    /// The joint that gives; none: every joint of the chain.
    channel: Option<usize>,
    parameter: usize,
}

/// A mechanism with terms.
#[derive(Clone)]
pub struct Model {
    /// The mechanism.
    pub mechanism: Mechanism,
    /// The terms, each at its target.
    pub instances: Vec<Instance>,
    /// First parameter of each instance.
    pub first: Vec<usize>,
    /// Parameters of the terms; those of unknown points come after.
    pub term_parameters: usize,
    /// All parameters.
    pub parameters: usize,
    /// Constants of each channel.
    pub scales: Vec<Scale>,
    /// For each unknown point and combination of keys, its number.
    unknown: Vec<Vec<usize>>,
    /// For each combination of keys, the parameters that its samples depend on.
    columns: Vec<Vec<usize>>,
    /// Names of the unknown points' instances.
    pub unknown_names: Vec<String>,
    /// What they are: a point of the mechanism, and the values of its columns.
    pub unknown_points: Vec<(usize, Vec<String>)>,
    equations: usize,
    steps: Vec<Vec<Step>>,
    closures: Vec<CompiledClosure>,
    sensors: Vec<SensorAt>,
    electronics: Vec<ElectronicsAt>,
    loads: Vec<LoadAt>,
    gravity: Vec3,
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model").field("instances", &self.instances).finish_non_exhaustive()
    }
}

/// Room for one block of samples.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// Misclosure, one per equation.
    pub f: Vec<Lanes>,
    /// `A`, equation by equation, one per channel.
    pub a: Vec<Lanes>,
    /// `X`, equation by equation, one per column of [`Model::columns`].
    pub x: Vec<Lanes>,
    /// Joint coordinates after every correction.
    pub angles: Vec<Lanes>,
    corrected: Vec<Lanes>,
    slopes: Vec<Lanes>,
    mix: Vec<Lanes>,
    partials: Vec<(usize, usize, Lanes)>,
    electric: Vec<(usize, usize, Lanes)>,
    g: Vec<Lanes>,
    turned: Vec<Lanes>,
    postures: Vec<Posture>,
    unloaded: Vec<Posture>,
    carried: Vec<Vec<Carried>>,
}

/// Which derivatives are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Want {
    /// By parameters.
    pub x: bool,
    /// By readings.
    pub a: bool,
}

impl Model {
    /// Compiles a mechanism with terms for these readings.
    ///
    /// Offsets and gains are told apart about the mean reading of each channel,
    /// which takes the condition number of the hand controller from 126 to 27;
    /// [`Model::uncentred`] gives the paper's parametrisation.
    ///
    /// # Errors
    ///
    /// [`Error::Context`] where a term needs what the readings do not have.
    pub fn new(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        let centre = readings.mean.clone();
        Self::about(mechanism, readings, instances, &centre)
    }

    /// As [`Model::new`], with offsets at reading zero as the paper has them.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn uncentred(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        Self::about(mechanism, readings, instances, &vec![0.0; mechanism.channels.len()])
    }

    /// As [`Model::new`], with offsets told at readings `centre`.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn about(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
    ) -> Result<Self, Error> {
        for instance in &instances {
            provided(instance.term, mechanism, readings)?;
        }
        Self::compile(mechanism, readings, instances, centre)
    }

    fn compile(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
    ) -> Result<Self, Error> {
        mechanism.validate()?;
        let mut first = Vec::with_capacity(instances.len());
        let mut term_parameters = 0;
        for instance in &instances {
            first.push(term_parameters);
            term_parameters += instance.width();
        }
        let scales = mechanism
            .channels
            .iter()
            .enumerate()
            .map(|(c, channel)| Scale::of(channel, centre[c], readings.span[c]))
            .collect();
        let (unknown, unknown_points) = number_unknowns(mechanism, readings);
        let columns = (0..readings.groups.len())
            .map(|group| {
                let points = unknown.iter().map(|of_group: &Vec<usize>| of_group[group]);
                let own = points.flat_map(|p| (0..3).map(move |k| term_parameters + 3 * p + k));
                (0..term_parameters).chain(own).collect()
            })
            .collect();
        let unknown_names: Vec<String> = unknown_points
            .iter()
            .map(|(point, keys)| unknown_name(mechanism, *point, keys))
            .collect();
        let gravity = mechanism
            .gravity
            .map_or(Vector3::zeros(), |g| Vector3::from(g).try_normalize(0.0).unwrap_or_default());
        let mut model = Self {
            steps: Vec::new(),
            closures: Vec::new(),
            sensors: Vec::new(),
            electronics: Vec::new(),
            loads: Vec::new(),
            parameters: term_parameters + 3 * unknown_names.len(),
            mechanism: mechanism.clone(),
            equations: mechanism.equations(),
            gravity: std::array::from_fn(|i| Lanes::splat(gravity[i])),
            instances,
            first,
            term_parameters,
            scales,
            unknown,
            columns,
            unknown_names,
            unknown_points,
        };
        model.compile_terms(readings);
        model.compile_chains()?;
        model.compile_closures(readings)?;
        Ok(model)
    }

    fn compile_terms(&mut self, readings: &Readings) {
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let (place, width) = (instance.place, instance.width());
            let session = match instance.term.placed() {
                _ if readings.sessions < 2 => None,
                _ if bound_to_session(instance.term) => Some(place),
                Placed::AtPose => readings.session_of_pose.get(place).copied(),
                _ => None,
            };
            let channel = if let Target::Channel(c) = instance.target { Some(c) } else { None };
            match instance.term.acts() {
                Acts::Sensor(term) => {
                    let channel = channel.unwrap_or_default();
                    self.sensors.push(SensorAt { term, channel, place, session, first, width });
                }
                Acts::Electronics(term) => {
                    self.electronics.push(ElectronicsAt {
                        term,
                        channel,
                        place,
                        session,
                        first,
                        width,
                    });
                }
                Acts::Load(whose) => {
                    let chains = match instance.target {
                        Target::All => (0..self.mechanism.chains.len()).collect(),
                        Target::Chain(chain) => vec![chain],
                        _ => channel.and_then(|c| self.mechanism.chain_of(c)).into_iter().collect(),
                    };
                    for chain in chains {
                        self.loads.push(LoadAt { whose, chain, channel, parameter: first });
                    }
                }
                Acts::Geometry(_) | Acts::Distance => {}
            }
        }
    }

    fn compile_chains(&mut self) -> Result<(), Error> {
        for (c, chain) in self.mechanism.chains.iter().enumerate() {
            let mut steps = Vec::new();
            self.free(&mut steps, Spot::Base, c, None);
            let root = chain.rows.iter().position(|r| r.channel.is_some());
            for (r, row) in chain.rows.iter().enumerate() {
                if Some(r) == root {
                    self.free(&mut steps, Spot::Root, c, None);
                }
                push_place(&mut steps, &Isometry3::rotation(Vector3::z() * row.theta));
                if let Some(name) = &row.channel {
                    let way = match row.joint {
                        crate::mechanism::Motion::Revolute => Way::Turn,
                        crate::mechanism::Motion::Prismatic => Way::Slide,
                    };
                    let channel = self.mechanism.channel_index(name)?;
                    steps.push(Step::Move(Axis::Z, way, Source::Channel(channel)));
                }
                if let Some(mass) = row.mass {
                    steps.push(Step::Mass(Weight::Links, row.com, mass));
                }
                self.free(&mut steps, Spot::Joint, c, Some(r));
                let body = row.body();
                push_place(
                    &mut steps,
                    &Isometry3::from_parts(body.translation, UnitQuaternion::identity()),
                );
                self.free(&mut steps, Spot::End, c, Some(r));
                push_place(
                    &mut steps,
                    &Isometry3::from_parts(Vector3::zeros().into(), body.rotation),
                );
            }
            self.free(&mut steps, Spot::Tip, c, None);
            let carried: Vec<[f64; 3]> = self
                .mechanism
                .points
                .iter()
                .filter(|p| p.chain.as_ref() == Some(&chain.name))
                .filter_map(|p| p.at)
                .collect();
            for at in &carried {
                steps.push(Step::Mass(Weight::Tip, *at, 1.0 / carried.len() as f64));
            }
            self.steps.push(steps);
        }
        Ok(())
    }

    /// The motions that geometry terms free at one spot of a chain.
    fn free(&self, steps: &mut Vec<Step>, spot: Spot, chain: usize, row: Option<usize>) {
        let here = row.map_or(Target::Chain(chain), |row| Target::Row(chain, row));
        for (instance, first) in self.instances.iter().zip(&self.first) {
            let Acts::Geometry(freedoms) = instance.term.acts() else { continue };
            if instance.target != here {
                continue;
            }
            for (k, (at, axis, way)) in freedoms.iter().enumerate() {
                if *at == spot {
                    steps.push(Step::Move(*axis, *way, Source::Parameter(first + k)));
                }
            }
        }
    }

    fn compile_closures(&mut self, readings: &Readings) -> Result<(), Error> {
        let value_columns = self.mechanism.value_columns();
        let mean = |column: usize| {
            readings.table.columns[column].iter().sum::<f64>() / readings.samples as f64
        };
        let mut equation = 0;
        for (k, closure) in self.mechanism.closures.iter().enumerate() {
            if self.mechanism.is_link(closure) {
                continue; // no sample takes part: see `links`
            }
            let ends = [self.end(&closure.between[0])?, self.end(&closure.between[1])?];
            let (value, column) = match &closure.value {
                Some(Value::Known(value)) => (*value, None),
                Some(Value::Column(name)) => {
                    let column = value_columns.iter().position(|column| column == name);
                    (column.map_or(0.0, mean), column)
                }
                None => (0.0, None),
            };
            let parameter = self
                .instances
                .iter()
                .zip(&self.first)
                .find(|(i, _)| {
                    matches!(i.term.acts(), Acts::Distance) && i.target == Target::Closure(k)
                })
                .map(|(_, first)| *first);
            let noise = closure.noise.unwrap_or(0.0);
            let kind = closure.kind;
            self.closures.push(CompiledClosure {
                kind,
                ends,
                value,
                column,
                parameter,
                equation,
                noise,
            });
            equation += kind.equations();
        }
        Ok(())
    }

    fn end(&self, name: &str) -> Result<End, Error> {
        let index = self.mechanism.point_index(name)?;
        let point = &self.mechanism.points[index];
        Ok(match (&point.chain, point.at) {
            (Some(chain), Some(at)) => End::Carried(self.mechanism.chain_index(chain)?, at),
            (None, Some(at)) => End::Fixed(at),
            _ => {
                let before = &self.mechanism.points[..index];
                End::Unknown(before.iter().filter(|p| !p.unknown.is_empty()).count())
            }
        })
    }

    /// The placement of every sample: unknown points that known distances link
    /// belong to one. None for a mechanism without unknown points.
    #[must_use]
    pub fn placements(&self, readings: &Readings) -> Option<Vec<usize>> {
        let points = self.unknown.first()?;
        let mut root: Vec<usize> = (0..self.unknown_names.len()).collect();
        for link in self.links() {
            if let Prior::Apart { points: [a, b], .. } = link {
                let [a, b] = [a, b].map(|c| root[(c - self.term_parameters) / 3]);
                root.iter_mut().filter(|r| **r == b).for_each(|r| *r = a);
            }
        }
        let mut of_row = vec![0; readings.samples];
        for block in readings.blocks() {
            for &row in &block.rows[..block.live] {
                of_row[row] = root[points[block.group]];
            }
        }
        Some(of_row)
    }

    /// Known distances between unknown points of one group, as priors.
    #[must_use]
    pub fn links(&self) -> Vec<Prior> {
        let mut links = Vec::new();
        for closure in self.mechanism.closures.iter().filter(|c| self.mechanism.is_link(c)) {
            let Some(Value::Known(value)) = closure.value else { continue };
            let sd = closure.sd.or(closure.noise).unwrap_or(1e-3 * value);
            let ends = closure.between.each_ref().map(|end| self.mechanism.unknown_end(end));
            let [Some((a, fixed_a)), Some((b, fixed_b))] = ends else { continue };
            for (i, (first, keys_a)) in self.unknown_points.iter().enumerate() {
                for (j, (second, keys_b)) in self.unknown_points.iter().enumerate() {
                    let (mine, theirs) =
                        (self.free_keys(a, keys_a, &fixed_a), self.free_keys(b, keys_b, &fixed_b));
                    if i != j && *first == a && *second == b && mine.is_some() && mine == theirs {
                        let points = [i, j].map(|k| self.term_parameters + 3 * k);
                        links.push(Prior::Apart { points, value, sd });
                    }
                }
            }
        }
        links
    }

    /// Columns and values of an unknown point that are not fixed; none where the
    /// fixed ones are not its own.
    fn free_keys<'a>(
        &'a self,
        point: usize,
        keys: &'a [String],
        fixed: &[(usize, String)],
    ) -> Option<Vec<(&'a String, &'a String)>> {
        let columns = &self.mechanism.points[point].unknown;
        if fixed.iter().any(|(k, value)| keys.get(*k) != Some(value)) {
            return None;
        }
        let free = |k: &usize| fixed.iter().all(|(f, _)| f != k);
        let mut rest: Vec<_> =
            (0..keys.len()).filter(free).map(|k| (&columns[k], &keys[k])).collect();
        rest.sort();
        Some(rest)
    }

    /// Scalar equations of one sample.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.equations
    }

    /// For each group of the readings, the parameters that the columns of its `X` stand
    /// for: those of the terms, then three for each unknown point that it touches.
    ///
    /// A sample knows no unknown point but its own, however many there are.
    #[must_use]
    pub fn columns(&self) -> &[Vec<usize>] {
        &self.columns
    }

    /// Columns of `X`, the same number for every group.
    #[must_use]
    pub fn width(&self) -> usize {
        self.term_parameters + 3 * self.unknown.len()
    }

    /// The same terms, on other closures and readings: a part that shares parameters.
    ///
    /// The readings may lack what a term needs: a rest pose has no velocity, and
    /// what acts in motion does nothing there.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn like(other: &Self, mechanism: &Mechanism, readings: &Readings) -> Result<Self, Error> {
        let centre: Vec<f64> = other.scales.iter().map(|s| s.centre).collect();
        let mut model = Self::compile(mechanism, readings, other.instances.clone(), &centre)?;
        model.scales.clone_from(&other.scales);
        Ok(model)
    }

    /// Parameter of a term of one parameter at a channel.
    #[must_use]
    pub fn column(&self, id: &str, channel: usize) -> Option<usize> {
        let at = |i: &Instance| i.target == Target::Channel(channel) && i.term.info().id == id;
        self.instances.iter().position(at).map(|k| self.first[k])
    }

    /// Puts each unknown point at the mean of where the chains touch it.
    pub fn place_unknowns(&self, readings: &Readings, beta: &mut [f64]) {
        let mut sums = vec![[0.0; 4]; self.unknown_names.len()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            self.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
            for closure in &self.closures {
                let (touching, point) = match closure.ends {
                    [End::Unknown(point), other] | [other, End::Unknown(point)] => (other, point),
                    _ => continue,
                };
                if closure.kind != ClosureKind::Touch || matches!(touching, End::Unknown(_)) {
                    continue;
                }
                let at = self.end_point(&touching, meta.group, beta, &ws.postures);
                let sum = &mut sums[self.unknown[point][meta.group]];
                for lane in 0..meta.live {
                    for axis in 0..3 {
                        sum[axis] += at[axis].0[lane];
                    }
                    sum[3] += 1.0;
                }
            }
        }
        for (k, sum) in sums.iter().enumerate().filter(|(_, s)| s[3] > 0.0) {
            for axis in 0..3 {
                beta[self.term_parameters + 3 * k + axis] = sum[axis] / sum[3];
            }
        }
    }

    /// First parameters of the unknown points that no sample in use touches.
    #[must_use]
    pub fn untouched(&self, readings: &Readings, weights: &[f64]) -> Vec<usize> {
        let mut touched = vec![false; self.unknown_names.len()];
        for block in readings.blocks() {
            if block.rows[..block.live].iter().any(|&r| weights[r] > 0.0) {
                self.unknown.iter().for_each(|of_group| touched[of_group[block.group]] = true);
            }
        }
        let left = touched.iter().enumerate().filter(|(_, touched)| !**touched);
        left.map(|(k, _)| self.term_parameters + 3 * k).collect()
    }

    /// For each equation, the columns that are not zero throughout, ascending.
    #[must_use]
    pub fn active(&self) -> Vec<Vec<usize>> {
        let mut active = Vec::with_capacity(self.equations);
        for closure in &self.closures {
            let mut columns: Vec<usize> = closure.parameter.into_iter().collect();
            for end in &closure.ends {
                match end {
                    End::Carried(chain, _) => self.columns_of_chain(*chain, &mut columns),
                    End::Unknown(point) => {
                        let first = self.term_parameters + 3 * point;
                        columns.extend(first..first + 3);
                    }
                    End::Fixed(_) => {}
                }
            }
            columns.sort_unstable();
            columns.dedup();
            active.extend(std::iter::repeat_n(columns, closure.kind.equations()));
        }
        active
    }

    fn columns_of_chain(&self, chain: usize, columns: &mut Vec<usize>) {
        let channels = self.mechanism.channels_of(chain);
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let on_chain = match instance.target {
                Target::Channel(c) => channels.contains(&c),
                Target::Chain(c) | Target::Row(c, _) => c == chain,
                Target::All => true,
                Target::Closure(_) => false,
            };
            if on_chain {
                columns.extend(first..first + instance.width());
            }
        }
    }

    /// The parameters that leave the mechanism as it is drawn.
    #[must_use]
    pub fn nominal(&self) -> Vec<f64> {
        vec![0.0; self.parameters]
    }

    /// Factor that turns the misclosure of each equation into a length.
    ///
    /// `|p_a - p_b|² - d²` is `2 d` times the error of the distance.
    #[must_use]
    pub fn lengths(&self) -> Vec<f64> {
        let mut lengths = Vec::with_capacity(self.equations);
        for closure in &self.closures {
            let scale = match closure.kind {
                ClosureKind::Distance => 1.0 / (2.0 * closure.value),
                ClosureKind::Touch => 1.0,
            };
            lengths.extend(std::iter::repeat_n(scale, closure.kind.equations()));
        }
        lengths
    }

    /// Variance of each equation that play gives it, in units of `f²`.
    #[must_use]
    pub fn play(&self) -> Vec<f64> {
        let mut play = Vec::with_capacity(self.equations);
        for closure in &self.closures {
            let scale = match closure.kind {
                ClosureKind::Distance => 2.0 * closure.value,
                ClosureKind::Touch => 1.0,
            };
            let variance = (closure.noise * scale).powi(2);
            play.extend(std::iter::repeat_n(variance, closure.kind.equations()));
        }
        play
    }

    /// Misclosure and derivatives of one block at readings `a` and parameters `beta`.
    ///
    /// Dispatched here, and nowhere further out: this is the one copy of the kernel
    /// that each width of vectors is compiled for.
    pub fn evaluate(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        dispatch(
            #[inline(always)]
            || self.evaluate_as_compiled(readings, block, a, beta, want, ws),
        );
    }

    /// [`Model::evaluate`] with the instructions that the caller is compiled for.
    #[doc(hidden)]
    #[inline(always)]
    pub fn evaluate_as_compiled(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        self.joint_angles(readings, block, a, beta, want, ws);
        if !self.loads.is_empty() {
            self.bend(beta, ws);
        }
        ws.postures.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.postures.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta);
        }
        self.close(readings, block, beta, want, ws);
        if want.x || want.a {
            self.chain_rule(beta, want, ws);
        }
    }

    /// Eqs. (41, 42): joint coordinates before load, and their derivatives.
    #[inline(always)]
    fn joint_angles(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let channels = self.scales.len();
        let meta = &readings.blocks()[block];
        let mut site = Site {
            readings: a,
            channel: 0,
            scales: &self.scales,
            time: meta.time,
            temperature: meta.temperature,
            approach: readings.approach(block),
            velocity: readings.velocity(block),
            pose: meta.pose,
            place: 0,
        };
        let mut out = [Lanes::ZERO; MOST_PARAMETERS];

        ws.corrected.clear();
        ws.corrected.extend_from_slice(a);
        ws.electric.clear();
        if !self.electronics.is_empty() {
            ws.mix.clear();
            ws.mix.resize(channels * channels, Lanes::ZERO);
        }
        for e in &self.electronics {
            let p = &beta[e.first..e.first + e.width];
            site.place = e.place;
            let affected = e.channel.map_or(0..channels, |c| c..c + 1);
            for channel in affected {
                site.channel = channel;
                let row = &mut ws.mix[channel * channels..(channel + 1) * channels];
                let correction = e.term.correction(p, &site);
                match e.session.map(|s| meta.within(s)) {
                    None => {
                        ws.corrected[channel] += correction;
                        e.term.slopes(p, &site, row);
                    }
                    Some(within) => {
                        ws.corrected[channel] += correction * within;
                        let mut slopes = vec![Lanes::ZERO; channels];
                        e.term.slopes(p, &site, &mut slopes);
                        row.iter_mut().zip(slopes).for_each(|(r, s)| *r += s * within);
                    }
                }
                if want.x {
                    e.term.partials(p, &site, &mut out[..e.width]);
                    let within = e.session.map_or(Lanes::ONE, |s| meta.within(s));
                    for (k, partial) in out[..e.width].iter().enumerate() {
                        ws.electric.push((e.first + k, channel, *partial * within));
                    }
                }
            }
        }

        ws.angles.clear();
        ws.slopes.clear();
        for (scale, reading) in self.scales.iter().zip(&ws.corrected) {
            ws.angles.push(
                (*reading - Lanes::splat(scale.centre)) * scale.gain + Lanes::splat(scale.angle),
            );
            ws.slopes.push(Lanes::splat(scale.gain));
        }
        ws.partials.clear();
        site.readings = &ws.corrected;
        for s in &self.sensors {
            let p = &beta[s.first..s.first + s.width];
            site.channel = s.channel;
            site.place = s.place;
            let within = s.session.map_or(Lanes::ONE, |s| meta.within(s));
            ws.angles[s.channel] += s.term.correction(p, &site) * within;
            if want.x || want.a {
                ws.slopes[s.channel] += s.term.slope(p, &site) * within;
            }
            if want.x {
                s.term.partials(p, &site, &mut out[..s.width]);
                for (k, partial) in out[..s.width].iter().enumerate() {
                    ws.partials.push((s.first + k, s.channel, *partial * within));
                }
            }
        }
    }

    /// Eq. (43): joints give under gravity.
    #[inline(always)]
    fn bend(&self, beta: &[f64], ws: &mut Workspace) {
        ws.unloaded.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.unloaded.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta);
        }
        // What levers carry is the same for all loads of one kind on one chain.
        ws.carried.resize_with(2 * self.steps.len(), Vec::new);
        for (k, load) in self.loads.iter().enumerate() {
            if k == 0 || self.loads[k - 1].slot() != load.slot() {
                let carried = &mut ws.carried[load.slot()];
                ws.unloaded[load.chain].carried(load.whose, carried);
            }
        }
        for load in &self.loads {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                if let Some(channel) = load.gives(lever) {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    ws.angles[channel] += torque * beta[load.parameter];
                }
            }
        }
    }

    /// Derivative of the torque of gravity about lever `j` by lever `s`.
    #[inline(always)]
    fn torque_slope(&self, levers: &[Lever], carried: &[Carried], j: usize, s: usize) -> Lanes {
        // Beyond the later of the two everything moves rigidly with the earlier.
        let (turning, moved) = match s <= j {
            true => (&levers[s], carried[j].moved_by(&levers[j])),
            false => (&levers[j], carried[s].moved_by(&levers[s])),
        };
        match turning.way {
            Way::Turn => dot(&cross(&turning.axis, &moved), &self.gravity),
            Way::Slide => Lanes::ZERO,
        }
    }

    /// Eq. (10), `G` and the columns of geometry, closures and unknown points.
    #[inline(always)]
    fn close(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let (channels, width) = (self.scales.len(), self.width());
        ws.f.clear();
        ws.f.resize(self.equations, Lanes::ZERO);
        if want.x || want.a {
            ws.g.clear();
            ws.g.resize(self.equations * channels, Lanes::ZERO);
        }
        if want.x {
            ws.x.clear();
            ws.x.resize(self.equations * width, Lanes::ZERO);
        }
        let group = readings.blocks()[block].group;
        for closure in &self.closures {
            let ends = closure.ends.map(|end| self.end_point(&end, group, beta, &ws.postures));
            let apart = minus(&ends[0], &ends[1]);
            let mut distance = closure
                .column
                .map_or(Lanes::splat(closure.value), |column| readings.columns(block)[column]);
            if let Some(parameter) = closure.parameter {
                distance += Lanes::splat(beta[parameter]);
                if want.x {
                    ws.x[closure.equation * width + parameter] = distance * -2.0;
                }
            }
            match closure.kind {
                ClosureKind::Distance => {
                    ws.f[closure.equation] = dot(&apart, &apart) - distance * distance;
                }
                ClosureKind::Touch => {
                    ws.f[closure.equation..closure.equation + 3].copy_from_slice(&apart);
                }
            }
            if !(want.x || want.a) {
                continue;
            }
            for (end, sign) in closure.ends.iter().zip([1.0, -1.0]) {
                let mut put = |source: Source, moved: &Vec3| {
                    let mut add = |row: usize, value: Lanes| match source {
                        Source::Channel(c) => {
                            ws.g[(closure.equation + row) * channels + c] += value * sign
                        }
                        Source::Parameter(p) if want.x => {
                            ws.x[(closure.equation + row) * width + p] += value * sign;
                        }
                        Source::Parameter(_) => {}
                    };
                    match closure.kind {
                        ClosureKind::Distance => add(0, dot(&apart, moved) * 2.0),
                        ClosureKind::Touch => (0..3).for_each(|row| add(row, moved[row])),
                    }
                };
                match end {
                    End::Fixed(_) => {}
                    End::Carried(chain, _) => {
                        let point = if sign > 0.0 { &ends[0] } else { &ends[1] };
                        for lever in &ws.postures[*chain].levers {
                            put(lever.source, &lever.moves(point));
                        }
                    }
                    End::Unknown(point) => {
                        let first = self.term_parameters + 3 * point;
                        for axis in 0..3 {
                            let mut unit = [Lanes::ZERO; 3];
                            unit[axis] = Lanes::ONE;
                            put(Source::Parameter(first + axis), &unit);
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn end_point(&self, end: &End, group: usize, beta: &[f64], postures: &[Posture]) -> Vec3 {
        match end {
            End::Carried(chain, at) => postures[*chain].tip.point(at),
            End::Fixed(at) => at.map(Lanes::splat),
            End::Unknown(point) => {
                let first = self.unknown_first(*point, group);
                std::array::from_fn(|axis| Lanes::splat(beta[first + axis]))
            }
        }
    }

    fn unknown_first(&self, point: usize, group: usize) -> usize {
        self.term_parameters + 3 * self.unknown[point][group]
    }

    /// Eq. (44), and the columns of `X` that act through joint coordinates.
    #[inline(always)]
    fn chain_rule(&self, beta: &[f64], want: Want, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        if !self.loads.is_empty() {
            self.bend_back(beta, want, ws);
        }
        if want.x {
            for &(column, channel, partial) in &ws.partials {
                for k in 0..self.equations {
                    ws.x[k * width + column] += ws.g[k * channels + channel] * partial;
                }
            }
            for &(column, channel, partial) in &ws.electric {
                let partial = ws.slopes[channel] * partial;
                for k in 0..self.equations {
                    ws.x[k * width + column] += ws.g[k * channels + channel] * partial;
                }
            }
        }
        if want.a {
            ws.a.clear();
            for k in 0..self.equations {
                for c in 0..channels {
                    ws.a.push(ws.g[k * channels + c] * ws.slopes[c]);
                }
            }
            if !self.electronics.is_empty() {
                for k in 0..self.equations {
                    let row = &mut ws.a[k * channels..(k + 1) * channels];
                    ws.turned.clear();
                    ws.turned.extend_from_slice(row);
                    for (turned, mix) in ws.turned.iter().zip(ws.mix.chunks_exact(channels)) {
                        for (slope, share) in row.iter_mut().zip(mix) {
                            *slope += *turned * *share;
                        }
                    }
                }
            }
        }
    }

    /// `G ← G ∂q'/∂q`, the columns of load, and what geometry does to torques.
    #[inline(always)]
    fn bend_back(&self, beta: &[f64], want: Want, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        ws.turned.clear();
        ws.turned.extend_from_slice(&ws.g);
        for load in &self.loads {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                let Some(channel) = load.gives(lever) else { continue };
                if want.x {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    for k in 0..self.equations {
                        ws.x[k * width + load.parameter] +=
                            ws.turned[k * channels + channel] * torque;
                    }
                }
                for (s, by) in posture.levers.iter().enumerate() {
                    let slope = self.torque_slope(&posture.levers, carried, j, s);
                    let slope = slope * beta[load.parameter];
                    for k in 0..self.equations {
                        let change = ws.turned[k * channels + channel] * slope;
                        match by.source {
                            Source::Channel(c) => ws.g[k * channels + c] += change,
                            Source::Parameter(p) if want.x => ws.x[k * width + p] += change,
                            Source::Parameter(_) => {}
                        }
                    }
                }
            }
        }
    }

    /// Positions of the mechanism's points in one block, by point.
    ///
    /// After [`Model::evaluate`]; unknown points have none.
    #[must_use]
    pub fn points(&self, ws: &Workspace) -> Vec<Option<Vec3>> {
        self.mechanism
            .points
            .iter()
            .map(|point| match (&point.chain, point.at) {
                (Some(chain), Some(at)) => {
                    let chain = self.mechanism.chain_index(chain).ok()?;
                    Some(ws.postures[chain].tip.point(&at))
                }
                (None, Some(at)) => Some(at.map(Lanes::splat)),
                _ => None,
            })
            .collect()
    }

    /// Levers of a chain in one block, after [`Model::evaluate`].
    #[must_use]
    pub fn levers<'a>(&self, ws: &'a Workspace, chain: usize) -> &'a [Lever] {
        &ws.postures[chain].levers
    }

    /// Slope of each joint coordinate by its reading, after [`Model::evaluate`]
    /// with derivatives: `diag(∂q/∂r)` of (44).
    #[must_use]
    pub fn slopes<'a>(&self, ws: &'a Workspace) -> &'a [Lanes] {
        &ws.slopes
    }
}

impl LoadAt {
    /// Where what the levers carry is kept.
    #[inline(always)]
    fn slot(&self) -> usize {
        2 * self.chain + self.whose as usize
    }

    /// The channel of a lever that gives under this load.
    #[inline(always)]
    fn gives(&self, lever: &Lever) -> Option<usize> {
        match lever.source {
            Source::Channel(c) if self.channel.is_none_or(|own| own == c) => Some(c),
            _ => None,
        }
    }
}

/// Refuses a term that needs what the readings or the mechanism do not have.
///
/// # Errors
///
/// [`Error::Context`].
pub fn provided(term: &dyn Term, mechanism: &Mechanism, readings: &Readings) -> Result<(), Error> {
    let info = term.info();
    let masses = || mechanism.chains.iter().any(|c| c.rows.iter().any(|r| r.mass.is_some()));
    let there = match info.needs {
        Needs::Nothing => true,
        Needs::Order => readings.timed && readings.poses() > 2,
        Needs::Temperature => readings.tempered,
        Needs::Approach => (readings.held || readings.timed) && readings.poses() > 2,
        Needs::Motion => !readings.held && readings.timed,
        Needs::Gravity => mechanism.gravity.is_some(),
        Needs::Masses => mechanism.gravity.is_some() && masses(),
    };
    if there { Ok(()) } else { Err(Error::Context { term: info.id, needs: info.needs.words() }) }
}

/// How users call an unknown point: `socket[group=front,at=socket0]`.
fn unknown_name(mechanism: &Mechanism, point: usize, keys: &[String]) -> String {
    let point = &mechanism.points[point];
    let keys: Vec<String> =
        point.unknown.iter().zip(keys).map(|(column, key)| format!("{column}={key}")).collect();
    format!("{}[{}]", point.name, keys.join(","))
}

/// An unknown point, and the keys that make it one of its own.
type Keyed = (usize, Vec<String>);

/// Numbers the unknown points: for each, the instance that a group touches, and
/// what the instances are.
fn number_unknowns(mechanism: &Mechanism, readings: &Readings) -> (Vec<Vec<usize>>, Vec<Keyed>) {
    let columns = mechanism.key_columns();
    let mut numbers = Vec::new();
    let mut points: Vec<Keyed> = Vec::new();
    for (p, point) in mechanism.points.iter().enumerate().filter(|(_, p)| !p.unknown.is_empty()) {
        let of_group = readings.groups.iter().map(|group| {
            let key = |c: &String| columns.iter().position(|k| k == c).map(|i| group[i].clone());
            let own = (p, point.unknown.iter().filter_map(key).collect::<Vec<String>>());
            points.iter().position(|known| *known == own).unwrap_or_else(|| {
                points.push(own);
                points.len() - 1
            })
        });
        numbers.push(of_group.collect());
    }
    (numbers, points)
}

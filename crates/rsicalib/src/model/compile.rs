//! A mechanism with terms is compiled for readings.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::Error;
use crate::kinematics::elements::{Element, Source, Way, Weight, push_rigid};
use crate::mechanism::{Closure, Mechanism, Target, Value};
use crate::model::compiled::{
    Added, CompiledClosure, Gate, Gating, LoadAt, Model, ShapeAt, TermAt,
};
use crate::model::drives::Drives;
use crate::model::ends::{self, Attached, End, Knock, Move, MovedEnd, Moving, Only};
use crate::model::instance::{Instance, bound_to_session};
use crate::model::law_at::LawAt;
use crate::model::numbering::{Owned, Unknown, number_unknowns};
use crate::model::specification::check_names;
use crate::model::thing::Thing;
use crate::numerics::lanes::Lanes;
use crate::readings::Readings;
use crate::terms::targets::{column_there, provided};
use crate::terms::term::{Acts, Needs, Placed, Scale, Spot};

/// The channels at the target of an instance that its term suits.
fn suited<'a>(
    mechanism: &'a Mechanism,
    instance: &'a Instance,
) -> impl Iterator<Item = usize> + 'a {
    let affected = mechanism.channels_at(instance.target).into_iter();
    affected.filter(|&c| instance.term.suits(mechanism, c))
}

impl Model {
    /// Compiles a mechanism with terms for these readings.
    ///
    /// Offsets are defined at the mean reading of each channel, which reduces the condition number
    /// of the hand controller from 126 to 27. [`Model::uncentred`] gives the paper's
    /// parametrisation, with offsets at reading zero.
    ///
    /// # Errors
    ///
    /// [`Error::Context`] for a term that needs data which the readings do not have,
    /// [`Error::Unknown`] for a target or a place that the mechanism does not have or that is not
    /// of the term's kind, [`Error::Shape`] for readings of another mechanism, and the errors of
    /// [`Mechanism::validate`].
    pub fn new(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        Self::about(None, mechanism, readings, instances, &readings.mean)
    }

    /// As [`Model::new`], with offsets at reading zero, as in the paper.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn uncentred(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        for instance in &instances {
            provided(instance.term, mechanism, readings)?;
        }
        let zero = vec![0.0; mechanism.channels.len()];
        Self::compile(mechanism, readings, instances, &zero, mechanism)
    }

    /// As [`Model::new`], with offsets at the readings `centre`, one per channel, and with the redundant
    /// equations of an `earlier` model of the mechanism left out: the same in all models of a search.
    ///
    /// # Errors
    ///
    /// As [`Model::new`], and [`Error::Shape`] unless `centre` has one reading per channel.
    pub fn about(
        earlier: Option<&Self>,
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
    ) -> Result<Self, Error> {
        for instance in &instances {
            instance.check(mechanism)?;
        }
        for instance in instances.iter().filter(|i| !i.is_past()) {
            provided(instance.term, mechanism, readings)?;
        }
        let mut model = Self::compile(mechanism, readings, instances, centre, mechanism)?;
        model.leave_out_equations(earlier, readings);
        Ok(model)
    }

    /// As [`Model::about`], with instances that were made for the mechanism: they are not checked
    /// again.
    pub(crate) fn with_candidates(
        earlier: &Self,
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
    ) -> Result<Self, Error> {
        let mut model = Self::compile_checked(mechanism, readings, instances, centre, mechanism)?;
        model.leave_out_equations(Some(earlier), readings);
        Ok(model)
    }

    /// As [`Model::new`], with the equations that nothing can violate.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub(crate) fn with_null_equations(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        Self::compile(mechanism, readings, instances, &readings.mean, mechanism)
    }

    /// The same terms and parameters with other closures and readings.
    ///
    /// The readings may lack data that a term needs: a rest pose has no velocity, so a term that
    /// acts in motion changes nothing there.
    ///
    /// # Errors
    ///
    /// As [`Model::new`].
    pub fn like(other: &Self, mechanism: &Mechanism, readings: &Readings) -> Result<Self, Error> {
        let mut model = other.with_closures_of(mechanism, readings)?;
        model.leave_out_equations(Some(other), readings);
        Ok(model)
    }

    /// As [`Model::like`], with the equations that nothing can violate.
    pub(crate) fn with_closures_of(
        &self,
        mechanism: &Mechanism,
        readings: &Readings,
    ) -> Result<Self, Error> {
        let centre: Vec<f64> = self.scales.iter().map(|s| s.centre).collect();
        let instances = self.instances.clone();
        let mut model = Self::compile(mechanism, readings, instances, &centre, &self.mechanism)?;
        model.scales.clone_from(&self.scales);
        // Tilts count from the same axes.
        for (number, unknown) in model.unknowns.iter().enumerate() {
            let same = |u: &Unknown| u.thing == unknown.thing && u.keys == unknown.keys;
            if let Some(there) = self.unknowns.iter().position(same) {
                model.axes[number] = self.axes[there];
            }
        }
        Ok(model)
    }

    /// The torque of the weights about every joint, block by block, at some `settled` readings of each:
    /// of the masses, or of the tips where there are none; zero without gravity. Joints without a drive
    /// are taken as if they had one.
    ///
    /// # Errors
    ///
    /// Those of compiling the mechanism without any term.
    pub(crate) fn torques<'a>(
        mechanism: &Mechanism,
        readings: &Readings,
        settled: impl Fn(usize) -> &'a [Lanes],
    ) -> Result<Vec<Vec<Lanes>>, Error> {
        let drawn = Self::with_null_equations(mechanism, readings, Vec::new())?;
        Ok(drawn.torques_at(readings, settled))
    }

    /// Closures beyond those of `held_by` bear no weight.
    fn compile(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
        held_by: &Mechanism,
    ) -> Result<Self, Error> {
        mechanism.check_parts()?;
        check_names(mechanism)?;
        fits(mechanism, readings, centre)?;
        Self::compile_checked(mechanism, readings, instances, centre, held_by)
    }

    fn compile_checked(
        mechanism: &Mechanism,
        readings: &Readings,
        instances: Vec<Instance>,
        centre: &[f64],
        held_by: &Mechanism,
    ) -> Result<Self, Error> {
        let mut first = Vec::with_capacity(instances.len());
        let mut term_parameters = 0;
        for instance in &instances {
            first.push(term_parameters);
            term_parameters += instance.width();
        }
        let scales = (0..mechanism.channels.len())
            .map(|c| {
                let centre = mechanism.centre(c, centre[c]);
                Scale::of(mechanism, c, centre, readings.span[c])
            })
            .collect();
        let (owned, unknowns) = number_unknowns(mechanism, readings);
        let columns = (0..readings.groups.len())
            .map(|group| {
                let things = owned.iter().map(|thing: &Owned| &unknowns[thing.numbers[group]]);
                let own = things.flat_map(|u| u.first..u.first + u.width);
                (0..term_parameters).chain(own.map(|k| term_parameters + k)).collect()
            })
            .collect();
        let gravity = mechanism
            .gravity
            .map_or(Vector3::zeros(), |g| Vector3::from(g).try_normalize(0.0).unwrap_or_default());
        let mut needs = instances.iter().flat_map(|i| i.term.needs());
        let moving = needs.any(|n| matches!(n, Needs::Approach | Needs::Motion));
        let mut model = Self {
            steps: Vec::new(),
            closures: Vec::new(),
            held: Vec::new(),
            sensors: Vec::new(),
            electronics: Vec::new(),
            gates: Vec::new(),
            loads: Vec::new(),
            drives: None,
            laws: Vec::new(),
            amounts: 0,
            torques: Vec::new(),
            moving,
            parameters: term_parameters + unknowns.iter().map(|u| u.width).sum::<usize>(),
            mechanism: mechanism.clone(),
            equations: mechanism.equations(),
            gravity: std::array::from_fn(|i| Lanes::splat(gravity[i])),
            turning: false,
            seen: Vec::new(),
            instances,
            first,
            term_parameters,
            scales,
            axes: unknowns.iter().map(|u| u.thing.leans_from(mechanism)).collect(),
            owned,
            columns,
            unknowns,
            posed: Moving::of(mechanism),
            attached: Vec::new(),
            measured_links: Vec::new(),
            knocks: Vec::new(),
        };
        for instance in &model.instances {
            column_there(instance.term, mechanism, readings)?;
        }
        model.compile_terms(readings);
        model.measure_links(readings);
        model.compile_chains()?;
        model.compile_closures(readings)?;
        model.seen = model.mean_seen(readings);
        model.face_undrawn(readings);
        model.leave_out_loose_coordinates(readings);
        model.find_patches(readings);
        if !model.loads.is_empty() || model.laws.iter().any(|law| law.term.weighs()) {
            model.drives = Self::drives(mechanism, readings, held_by)?;
        }
        model.told_torques()?;
        model.torques = model.largest_torques(readings);
        Ok(model)
    }

    fn compile_terms(&mut self, readings: &Readings) {
        for (number, (instance, &first)) in self.instances.iter().zip(&self.first).enumerate() {
            let (place, width) = (instance.place, instance.width());
            // What happened once lasts on through later sessions, as it does through later readings.
            let bound = readings.sessions > 1 && bound_to_session(instance.term);
            let session = bound.then_some(place);
            match instance.term.acts() {
                Acts::Sensor(term) => {
                    let at = |channel| TermAt { term, channel, place, session, first, width };
                    self.sensors.extend(suited(&self.mechanism, instance).map(at));
                }
                Acts::Coupled(term) => {
                    let at = LawAt::each(&self.mechanism, instance, term, first, session);
                    self.laws.extend(at);
                }
                Acts::Electronics(term) => {
                    let at = |channel| TermAt { term, channel, place, session, first, width };
                    self.electronics.extend(suited(&self.mechanism, instance).map(at));
                }
                Acts::Load(whose) => {
                    let chains = |c: &usize| self.mechanism.chain_of(*c);
                    let places: Vec<(usize, Option<usize>)> = match instance.target {
                        Target::All => {
                            (0..self.mechanism.chains.len()).map(|chain| (chain, None)).collect()
                        }
                        Target::Chain(chain) => vec![(chain, None)],
                        joints => {
                            let joints = self.mechanism.channels_at(joints);
                            joints.iter().filter_map(|c| Some((chains(c)?, Some(*c)))).collect()
                        }
                    };
                    for (chain, channel) in places {
                        self.loads.push(LoadAt { whose, chain, channel, parameter: first });
                    }
                }
                Acts::Geometry(_)
                | Acts::Distance
                | Acts::Surface(_)
                | Acts::End
                | Acts::Attachment
                | Acts::Instrument(_) => {
                    let gate = |acts| Gate { instance: number, acts };
                    if instance.term.placed() == Placed::AtPose {
                        self.gates.push(gate(Gating::Since { place }));
                    } else if instance.term.info().needs == Needs::Temperature {
                        self.gates.push(gate(Gating::Temperature));
                    }
                }
            }
        }
        self.attach();
        let channels = self.mechanism.channels.len();
        for law in &mut self.laws {
            self.amounts += law.number(channels + self.amounts);
        }
    }

    /// Sorts what moves points on the chains and the bodies that carry them, and tells those of bodies.
    fn attach(&mut self) {
        let instances = self.instances.iter().zip(&self.first).enumerate();
        let own = instances.filter_map(|(number, (instance, &first))| {
            let Target::Closure(closure) = instance.target else { return None };
            let point = self.mechanism.attachment(closure)?;
            let by = Move { first, gate: self.gate_of(number) };
            matches!(instance.term.acts(), Acts::Attachment).then_some(Attached { point, by })
        });
        let mut attached: Vec<Attached> = own.collect();
        attached.sort_by_key(|own| own.point);
        for own in &attached {
            if self.mechanism.points[own.point].chain.is_none() {
                let number = ends::number_of_moving(&self.mechanism, own.point);
                self.posed.points[number].moved_by = ends::moves_of(&attached, own.point);
            }
        }
        self.attached = attached;
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
                push_rigid(&mut steps, &Isometry3::rotation(Vector3::z() * row.theta));
                if let Some(name) = &row.channel {
                    let way = match row.joint {
                        crate::mechanism::Motion::Revolute => Way::Turn,
                        crate::mechanism::Motion::Prismatic => Way::Slide,
                    };
                    let channel = self.mechanism.channel_index(name)?;
                    steps.push(Element::joint(way, channel, row.ratio));
                }
                if let Some(mass) = row.mass {
                    steps.push(Element::Mass(Weight::Links, row.com, mass));
                }
                self.free(&mut steps, Spot::Joint, c, Some(r));
                let of_body = [
                    (Spot::Link, Some(row.link())),
                    (Spot::Side, chain.side(r)),
                    (Spot::Along, row.along()),
                ];
                for (spot, axes) in of_body {
                    let mut of_link = Vec::new();
                    self.free(&mut of_link, spot, c, Some(r));
                    let Some(axes) = axes.filter(|_| !of_link.is_empty()) else { continue };
                    let axes = Isometry3::from_parts(Vector3::zeros().into(), axes);
                    push_rigid(&mut steps, &axes);
                    steps.append(&mut of_link);
                    push_rigid(&mut steps, &axes.inverse());
                }
                let body = row.body();
                push_rigid(
                    &mut steps,
                    &Isometry3::from_parts(body.translation, UnitQuaternion::identity()),
                );
                self.free(&mut steps, Spot::End, c, Some(r));
                push_rigid(
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
                steps.push(Element::Mass(Weight::Tip, *at, 1.0 / carried.len() as f64));
            }
            self.steps.push(steps);
        }
        Ok(())
    }

    /// Appends the motions that geometry terms add at one spot of a chain.
    fn free(&self, steps: &mut Vec<Element>, spot: Spot, chain: usize, row: Option<usize>) {
        let here = row.map_or(Target::Chain(chain), |row| Target::Row(chain, row));
        let is_here = |target: Target| self.mechanism.has_part(target, here);
        for law in &self.laws {
            if let Some((axis, way)) = law.moves(spot, here) {
                steps.push(Element::Move(axis, way, Source::Law(law.to)));
            }
        }
        for (number, (instance, first)) in self.instances.iter().zip(&self.first).enumerate() {
            let Acts::Geometry(freedoms) = instance.term.acts() else { continue };
            if !is_here(instance.target) {
                continue;
            }
            let gate = self.gate_of(number);
            for (k, (at, axis, way)) in freedoms.iter().enumerate() {
                if *at == spot {
                    let source = match gate {
                        Some(gate) => Source::Gated(first + k, gate),
                        None => Source::Parameter(first + k),
                    };
                    steps.push(Element::Move(*axis, *way, source));
                }
            }
        }
    }

    /// What the motion of an instance is multiplied by in each sample, among the gates.
    fn gate_of(&self, number: usize) -> Option<usize> {
        self.gates.iter().position(|gate| gate.instance == number)
    }

    fn compile_closures(&mut self, readings: &Readings) -> Result<(), Error> {
        let value_columns = self.mechanism.value_columns();
        // Of the rows in which it was measured.
        let mean = |column: usize| {
            let column = &readings.table.columns[column];
            let known = || column.iter().filter(|v| !v.is_nan());
            known().sum::<f64>() / known().count().max(1) as f64
        };
        let mut equation = 0;
        for (k, closure) in self.mechanism.closures.iter().enumerate() {
            if self.mechanism.is_link(closure) {
                continue; // no sample takes part: see `links`
            }
            let mut ends = ends::ends(&self.mechanism, closure, &self.owned, &self.attached)?;
            let knocks = self.knocks_of(k);
            for end in &mut ends {
                if let End::Seen(.., own) = end {
                    *own = [self.knocks.len(), self.knocks.len() + knocks.len()];
                }
            }
            self.knocks.extend(knocks);
            let (on, along, offset) = self.surface(closure);
            let (value, column) = match &closure.value {
                Some(Value::Known(value)) => (*value, None),
                Some(Value::Column(name)) => {
                    let column = value_columns.iter().position(|column| column == name);
                    (column.map_or(0.0, mean), column)
                }
                None => (offset, None),
            };
            let channel = match &closure.channel {
                Some(name) => Some(self.mechanism.channel_index(name)?),
                None => None,
            };
            let added = self.added_to(k);
            let noise = closure.noise.unwrap_or(0.0);
            let kind = closure.kind;
            self.closures.push(CompiledClosure {
                kind,
                number: k,
                all: kind.equations(),
                ends,
                value,
                column,
                from: offset,
                added,
                moved: self.moved_ends(k),
                shapes: self.shapes_of(k),
                laws: self.laws.iter().filter(|law| law.of_closure(k)).map(|l| l.to).collect(),
                equation,
                along,
                channel,
                on,
                noise,
                patches: Vec::new(),
            });
            equation += kind.equations();
        }
        Ok(())
    }

    /// What terms do to the instrument that sees an end of a closure.
    fn knocks_of(&self, closure: usize) -> Vec<Knock> {
        let instances = self.instances.iter().zip(&self.first).enumerate();
        let own = instances.filter_map(|(number, (instance, &first))| {
            let Target::Closure(own) = instance.target else { return None };
            let Acts::Instrument(of) = instance.term.acts() else { return None };
            let by = || Move { first, gate: self.gate_of(number) };
            self.mechanism.seen_alike(own, closure).then(|| Knock { by: by(), of })
        });
        own.collect()
    }

    /// What terms move the standing end of a closure of the mechanism by.
    fn moved_ends(&self, closure: usize) -> Vec<MovedEnd> {
        let Some(end) = self.mechanism.standing_end(closure) else { return Vec::new() };
        let instances = self.instances.iter().zip(&self.first).enumerate();
        let moved = |(number, (instance, &first)): (usize, (&Instance, &usize))| {
            let only = self.at_closure(instance.target, closure)?;
            let by = Move { first, gate: self.gate_of(number) };
            let acts = matches!(instance.term.acts(), Acts::End);
            acts.then_some(MovedEnd { end, by, only })
        };
        instances.filter_map(moved).collect()
    }

    /// Whether a target is of a closure, and of which of its places.
    fn at_closure(&self, target: Target, closure: usize) -> Option<Option<Only>> {
        match target {
            Target::Closure(own) => (own == closure).then_some(None),
            Target::Place(name) => {
                if !self.mechanism.closures_at(name).any(|touching| touching == closure) {
                    return None;
                }
                let called = |u: &Unknown| u.name == name.text();
                let place = self.unknowns.iter().position(called);
                let place = place.unwrap_or(self.unknowns.len());
                let own = |o: &Owned| o.numbers.contains(&place);
                let thing = self.owned.iter().position(own).unwrap_or_default();
                Some(Some(Only { thing, place }))
            }
            _ => None,
        }
    }

    /// Shapes that terms give the plane or the line of a closure of the mechanism.
    fn shapes_of(&self, closure: usize) -> Vec<ShapeAt> {
        let instances = self.instances.iter().zip(&self.first).enumerate();
        let shape = |(number, (instance, &first)): (usize, (&Instance, &usize))| {
            let Acts::Surface(term) = instance.term.acts() else { return None };
            let gate = self.gate_of(number);
            let width = instance.width();
            let only = self.at_closure(instance.target, closure)?;
            Some(ShapeAt { term, first, width, gate, only })
        };
        instances.filter_map(shape).collect()
    }

    /// What terms add to the distance of a closure of the mechanism.
    fn added_to(&self, closure: usize) -> Vec<Added> {
        let own = |i: &Instance| {
            matches!(i.term.acts(), Acts::Distance)
                && self.mechanism.has_part(i.target, Target::Closure(closure))
        };
        let instances = self.instances.iter().zip(&self.first).enumerate();
        let added = instances
            .filter(|(_, (i, _))| own(i))
            .map(|(number, (_, &parameter))| Added { parameter, gate: self.gate_of(number) });
        added.collect()
    }

    /// Leaves out the equations that say nothing. What follows from what, (56), is of the mechanism:
    /// it is taken from an earlier model where there is one.
    fn leave_out_equations(&mut self, earlier: Option<&Self>, readings: &Readings) {
        self.leave_out_null_equations(readings);
        let Some(earlier) = earlier.filter(|earlier| earlier.mechanism == self.mechanism) else {
            self.leave_out_equations_that_follow(readings);
            return;
        };
        for (own, earlier) in self.closures.iter_mut().zip(&earlier.closures) {
            if earlier.equations() < own.equations() {
                own.along.clone_from(&earlier.along);
            }
        }
        self.number_equations();
    }

    /// The unknown plane or line of a closure, or the directions across what its point is on, and the
    /// offset of a known plane.
    fn surface(&self, closure: &Closure) -> (Option<usize>, Option<Vec<[f64; 3]>>, f64) {
        let touched = Thing::touched(&self.mechanism, closure);
        let unknown = |o: &Owned| Some(o.thing) == touched;
        if let Some(number) = self.owned.iter().position(unknown) {
            return (Some(number), None, 0.0);
        }
        match touched {
            Some(Thing::Plane(p)) => {
                let known = self.mechanism.planes[p].known();
                known.map_or((None, None, 0.0), |(n, offset)| (None, Some(vec![n]), offset))
            }
            Some(Thing::Line(l)) => {
                let across = self.mechanism.lines[l].across();
                (None, across.map(|across| across.to_vec()), 0.0)
            }
            _ => (None, None, 0.0),
        }
    }

    /// Refuses a load at a drive that may work against others.
    fn told_torques(&self) -> Result<(), Error> {
        let Some(drives) = &self.drives else { return Ok(()) };
        let hidden = |i: &&Instance| drives.hide(&self.mechanism, i.term, i.target);
        match self.instances.iter().find(hidden) {
            Some(i) => Err(Error::Context { term: i.term.info().id, needs: SHARES.into() }),
            None => Ok(()),
        }
    }

    /// The torques, where the mechanism says something of its drives; closures beyond those of `held_by`
    /// bear nothing.
    ///
    /// # Errors
    ///
    /// Those of compiling the mechanism without any term.
    pub(crate) fn drives(
        mechanism: &Mechanism,
        readings: &Readings,
        held_by: &Mechanism,
    ) -> Result<Option<Drives>, Error> {
        if !mechanism.tells_of_drives() {
            return Ok(None);
        }
        let drawn = Self::with_null_equations(mechanism, readings, Vec::new())?;
        let closures: Vec<&str> = held_by.closures.iter().map(|c| c.name.as_str()).collect();
        Ok(Some(drawn.drives_of_drawn(readings, &closures)))
    }
}

/// What is lacking where a loop has more drives than motions.
pub(crate) const SHARES: &str = "torque of drives that may work against each other: declare the `torque` column or \
    the `share` of each";

/// Refuses readings of another mechanism, and a `centre` without one reading per channel.
fn fits(mechanism: &Mechanism, readings: &Readings, centre: &[f64]) -> Result<(), Error> {
    let channels = mechanism.channels.len();
    Error::same("a row", readings.channels, channels)?;
    Error::same("centre", centre.len(), channels)?;
    Error::same("keys", readings.table.keys.len(), mechanism.key_columns().len())?;
    Error::same("columns", readings.table.columns.len(), mechanism.value_columns().len())
}

//! A result as a mechanism: the drawing with its parameters in it.
//!
//! Every parameter of geometry is a motion at some spot of a chain; a row is
//!
//! ```text
//! Rz(theta) · joint(q) · Tz(d) Tx(a) Rx(alpha) · T(xyz) R(rpy)
//!                      ^ Spot::Joint, Link, Side  ^ Spot::End, between translation and rotation
//! ```
//!
//! so that a row with the motions in it is again a row, and no point moves by more than rounding.
//! Each term says itself where it moves what ([`Acts::Geometry`]) and what it is to the line of
//! a channel ([`Role`]). What a mechanism has no words for is named, and not put in.

use std::fmt;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::Error;
use crate::apply::earlier::{Applied, outlasts, parameter_index};
use crate::kinematics::elements::{Axis, Way};
use crate::mechanism::{Chain, Mechanism, Row, Target, Value};
use crate::model::{Spec, UNKNOWN_THINGS, is_unknown_thing};
use crate::terms::Ratio;
use crate::terms::term::{Acts, Freedom, Needs, Outlasts, Role, Spot, Term};
use crate::text::{number, quoted};

/// A mechanism under which readings give the same points as under a result.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The mechanism, points moved in the frames at the ends of their chains.
    pub mechanism: Mechanism,
    /// The same motions of the end frames instead, as a last row: chain by chain, where there
    /// are any.
    pub tips: Vec<(String, Row)>,
    /// What was added, and what could not be put in.
    pub notes: Vec<Note>,
}

/// What a mechanism with the parameters in it does not tell by itself.
#[derive(Debug, Clone, PartialEq)]
pub enum Note {
    /// A chain has a new first row.
    NewRow {
        /// Its name.
        chain: String,
    },
    /// A distance is a column of the readings, which must be corrected there.
    Column {
        /// Name of the closure.
        closure: String,
        /// The column.
        column: String,
        /// What must be added to it, length units.
        add: f64,
    },
    /// A mechanism cannot express the term.
    NoPlace(Spec),
    /// The effect did not outlast its session.
    OfItsSession(Spec),
}

impl Note {
    /// What programs call it.
    #[must_use]
    pub fn id(&self) -> &'static str {
        match self {
            Self::NewRow { .. } => "new_row",
            Self::Column { .. } => "column",
            Self::NoPlace(_) => "no_place",
            Self::OfItsSession(_) => "of_its_session",
        }
    }

    /// The effect that it is about; none where it is about none.
    #[must_use]
    pub fn effect(&self) -> Option<&Spec> {
        match self {
            Self::NoPlace(spec) | Self::OfItsSession(spec) => Some(spec),
            Self::NewRow { .. } | Self::Column { .. } => None,
        }
    }

    /// The chain, the closure, or what the effect is of.
    #[must_use]
    pub fn target(&self) -> Option<&str> {
        match self {
            Self::NewRow { chain } => Some(chain),
            Self::Column { closure, .. } => Some(closure),
            Self::NoPlace(spec) | Self::OfItsSession(spec) => spec.target.as_deref(),
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NewRow { chain } => {
                write!(f, "chain {chain}: row 1 is new and carries the place of its base")
            }
            Self::Column { closure, column, add } => {
                let (add, column) = (number(*add), quoted(column));
                write!(f, "distance@{closure}: add {add} to column {column}")
            }
            Self::NoPlace(spec) => {
                write!(f, "{spec} has no place in a mechanism: apply it with --calibration")
            }
            Self::OfItsSession(spec) => {
                write!(f, "{spec} was found in one session and holds in no other: left out")
            }
        }
    }
}

/// One term at one target, with the values of its parameters.
struct Effect {
    spec: Spec,
    term: &'static dyn Term,
    target: Target,
    /// True for what several targets share: told beside what each has of its own, or is declared with.
    shared: bool,
    values: Vec<f64>,
}

/// Puts the parameters of a result into its mechanism.
///
/// # Errors
///
/// [`Error::Unknown`] where a parameter has no such term, target or name, [`Error::Shape`]
/// unless the result has a mean reading and a noise for every channel, and as
/// [`Mechanism::validate`].
pub fn exported(mechanism: &Mechanism, applied: &Applied) -> Result<Exported, Error> {
    let effects = effects(mechanism, applied)?;
    let mut out = with_lines(mechanism, applied, &effects)?;
    noise(&mut out, applied);
    let mut notes = Vec::new();
    let mut tips = Vec::new();
    for c in 0..out.chains.len() {
        let motions = Motions { effects: &effects, chain: c };
        if motions.into_chain(&mut out.chains[c]) {
            let chain = out.chains[c].name.clone();
            renumber(&mut out, mechanism, c);
            notes.push(Note::NewRow { chain });
        }
        let tip = motions.at(Spot::Tip, None);
        if tip != Isometry3::identity() {
            let name = out.chains[c].name.clone();
            for point in out.points.iter_mut().filter(|p| p.chain.as_ref() == Some(&name)) {
                point.at = point.at.map(|at| (tip * nalgebra::Point3::from(at)).into());
            }
            tips.push((name, with_body(&Row::default(), &tip)));
        }
    }
    for effect in &effects {
        // What several channels share is one effect of the result.
        if let Some(note) = other(effect, mechanism, &mut out)
            && !notes.contains(&note)
        {
            notes.push(note);
        }
    }
    notes.extend(with_places(applied, &mut out));
    out.validate()?;
    Ok(Exported { mechanism: out, tips, notes })
}

/// Puts points and frames that stood at one unknown place where they were found; a plane or a line has no place there.
/// Where things stood that readings tell apart is of their session.
fn with_places(applied: &Applied, out: &mut Mechanism) -> Vec<Note> {
    let mut notes: Vec<Note> = Vec::new();
    let [point, plane, line, frame] = UNKNOWN_THINGS;
    for p in applied.parameters.iter().filter(|p| is_unknown_thing(&p.spec.term)) {
        let named = |name: &String| p.spec.target.as_ref() == Some(name);
        let axis = ["x", "y", "z", "rx", "ry", "rz"].iter().position(|axis| *axis == p.name);
        let at = match &*p.spec.term {
            term if term == point => {
                let own = out.points.iter_mut().find(|own| named(&own.name));
                own.map(|own| own.at.get_or_insert_default().as_mut_slice())
            }
            term if term == frame => {
                let own = out.frames.iter_mut().find(|own| named(&own.name));
                own.map(|own| own.pose.get_or_insert_default().as_mut_slice())
            }
            _ => None,
        };
        if let (Some(at), Some(k)) = (at, axis) {
            at[k] = p.value;
        }
        let mut surfaces = out.planes.iter().map(|own| &own.name);
        let surface = match &*p.spec.term {
            term if term == plane => surfaces.any(named),
            term if term == line => out.lines.iter().any(|own| named(&own.name)),
            _ => false,
        };
        if surface && notes.iter().all(|note| note.effect() != Some(&p.spec)) {
            notes.push(Note::NoPlace(p.spec.clone()));
        }
    }
    notes
}

/// A mechanism with the gains and offsets that a result has found, slips that happened included.
///
/// # Errors
///
/// As [`exported`].
pub fn with_sensors(mechanism: &Mechanism, applied: &Applied) -> Result<Mechanism, Error> {
    let out = with_lines(mechanism, applied, &effects(mechanism, applied)?)?;
    out.validate()?;
    Ok(out)
}

/// The effects of a result, in the order of its parameters.
fn effects(mechanism: &Mechanism, applied: &Applied) -> Result<Vec<Effect>, Error> {
    let mut effects: Vec<Effect> = Vec::new();
    for p in applied.parameters.iter().filter(|p| !is_unknown_thing(&p.spec.term)) {
        let (term, targets) = p.spec.targets(mechanism)?;
        let k = parameter_index(term, &p.name)?;
        let parts = |whole: Target| {
            mechanism.parts(whole).into_iter().map(move |part| (part, whole.is_shared()))
        };
        for (target, shared) in targets.into_iter().flat_map(parts) {
            let same = |e: &&mut Effect| e.spec == p.spec && e.target == target;
            match effects.iter_mut().find(same) {
                Some(effect) => effect.values[k] = p.value,
                None => {
                    let mut values = vec![0.0; term.info().parameters.len()];
                    values[k] = p.value;
                    effects.push(Effect { spec: p.spec.clone(), term, target, shared, values });
                }
            }
        }
    }
    Ok(effects)
}

/// Gains, offsets and shifts in their channels; a gain alone turns the line about the reading
/// about which it was found.
fn with_lines(
    mechanism: &Mechanism,
    applied: &Applied,
    effects: &[Effect],
) -> Result<Mechanism, Error> {
    let channels = mechanism.channels.len();
    for (what, found) in
        [("centre", applied.reference.centre.len()), ("sigma", applied.sigma.len())]
    {
        Error::same(what, found, channels)?;
    }
    let mut out = mechanism.clone();
    for (c, channel) in out.channels.iter_mut().enumerate() {
        let found = |role: Role, shared: bool| {
            let own = move |e: &&Effect| {
                e.target == Target::Channel(c) && e.term.role() == role && e.shared == shared
            };
            effects.iter().filter(own).map(|e| e.values[0])
        };
        let centre = mechanism.centre(c, applied.reference.centre[c]);
        let gain = found(Role::Gain, false).next_back().unwrap_or(channel.gain);
        let turned = channel.offset + (channel.gain - gain) * centre;
        let offset = found(Role::Offset, false).next_back().unwrap_or(turned);
        let shift = |shared: bool| found(Role::Shift, shared).sum::<f64>();
        let (more, moved) = (found(Role::Gain, true).sum::<f64>(), found(Role::Offset, true));
        channel.gain = gain + more;
        channel.offset = offset - more * centre + moved.sum::<f64>() + shift(false) + shift(true);
    }
    Ok(out)
}

/// Noise, where a platform's pose depends on it and the mechanism would not tell it by itself.
fn noise(out: &mut Mechanism, applied: &Applied) {
    if out.platform.is_empty() {
        return;
    }
    for (channel, sigma) in out.channels.iter_mut().zip(&applied.sigma) {
        if !channel.counts() || applied.declared {
            channel.noise = Some(*sigma);
        }
    }
}

/// Puts an effect in that is neither of a channel's line nor of a chain, or says why not.
fn other(effect: &Effect, mechanism: &Mechanism, out: &mut Mechanism) -> Option<Note> {
    let spec = || effect.spec.clone();
    match (effect.term.acts(), effect.target) {
        (Acts::Geometry(_) | Acts::Distance, _)
            if effect.term.info().needs == Needs::Temperature =>
        {
            Some(Note::NoPlace(spec()))
        }
        (Acts::Geometry(_), _) => None,
        (Acts::Distance, Target::Closure(k)) => {
            let add = effect.values[0];
            let closure = out.closures[k].name.clone();
            match &mut out.closures[k].value {
                Some(Value::Known(value)) => *value += add,
                Some(Value::Column(column)) => {
                    return Some(Note::Column { closure, column: column.clone(), add });
                }
                None => {}
            }
            None
        }
        (Acts::Coupled(_), Target::Row(chain, row)) if effect.term.info().id == Ratio::INFO.id => {
            with_ratio(mechanism, out, [chain, row], effect.values[0]);
            None
        }
        _ if effect.term.role() != Role::Other => None,
        _ if outlasts(mechanism, &effect.spec) == Ok(Outlasts::Nothing) => {
            Some(Note::OfItsSession(spec()))
        }
        _ => Some(Note::NoPlace(spec())),
    }
}

/// Puts the error `δ` of a ratio `ρ` into its row. With the nominal gain `k0` and middle `m` of the
/// channel, and `q = k a + o` as it has been found,
///
/// ```text
/// ρ q + δ k0 (a - m) = (ρ + δ k0/k) q - δ (k0/k) (k m + o)
/// ```
fn with_ratio(mechanism: &Mechanism, out: &mut Mechanism, [chain, row]: [usize; 2], error: f64) {
    let name = mechanism.chains[chain].rows[row].channel.as_deref().unwrap_or_default();
    let Ok(channel) = mechanism.channel_index(name) else { return };
    let (nominal, found) = (&mechanism.channels[channel], &out.channels[channel]);
    let error = error * nominal.gain / found.gain;
    let turned = error * found.angle(nominal.middle());
    // A chain may have got a first row that its drawing has not.
    let new = out.chains[chain].rows.len() - mechanism.chains[chain].rows.len();
    let row = &mut out.chains[chain].rows[row + new];
    row.ratio = row.ratio.map(|ratio| ratio + error);
    row.theta -= turned;
}

/// What geometry moves in one chain.
#[derive(Clone, Copy)]
struct Motions<'a> {
    effects: &'a [Effect],
    chain: usize,
}

impl Motions<'_> {
    /// The motion at one spot, of the terms in their order, as the model composes it.
    fn at(self, spot: Spot, row: Option<usize>) -> Isometry3<f64> {
        let here = row.map_or(Target::Chain(self.chain), |row| Target::Row(self.chain, row));
        let mut motion = Isometry3::identity();
        for effect in self.effects.iter().filter(|e| e.target == here) {
            let Acts::Geometry(freedoms) = effect.term.acts() else { continue };
            for (freedom, value) in freedoms.iter().zip(&effect.values) {
                if freedom.0 == spot {
                    motion *= moved(freedom, *value);
                }
            }
        }
        motion
    }

    /// Puts the motions into the rows of the chain; true where that took a new first row.
    fn into_chain(self, chain: &mut Chain) -> bool {
        let still = Isometry3::identity();
        let root = chain.rows.iter().position(|row| row.channel.is_some());
        let sides: Vec<_> = (0..chain.rows.len()).map(|r| chain.side(r)).collect();
        for (r, row) in chain.rows.iter_mut().enumerate() {
            let of_body = |spot, axes| {
                let axes = Isometry3::from_parts(Translation3::identity(), axes);
                axes * self.at(spot, Some(r)) * axes.inverse()
            };
            let link = of_body(Spot::Link, row.link());
            let side = sides[r].map_or(still, |axes| of_body(Spot::Side, axes));
            let slide = self.at(Spot::Joint, Some(r)) * link * side;
            *row = with_motions(row, &slide, &self.at(Spot::End, Some(r)));
        }
        let before = self.at(Spot::Base, None);
        let turned = root.map_or(still, |_| self.at(Spot::Root, None));
        match root.unwrap_or(chain.rows.len()).checked_sub(1) {
            None if before != still || turned != still => {
                chain.rows.insert(0, with_body(&Row::default(), &(before * turned)));
                true
            }
            Some(last) => {
                if before != still {
                    chain.rows[0] = preceded(&chain.rows[0], &before);
                }
                if turned != still {
                    let body = chain.rows[last].body() * turned;
                    chain.rows[last] = with_body(&chain.rows[last], &body);
                }
                false
            }
            None => false,
        }
    }
}

/// One motion along or about an axis.
fn moved((_, axis, way): &Freedom, by: f64) -> Isometry3<f64> {
    let along = match axis {
        Axis::X => Vector3::x(),
        Axis::Y => Vector3::y(),
        Axis::Z => Vector3::z(),
    } * by;
    match way {
        Way::Slide => Isometry3::translation(along.x, along.y, along.z),
        Way::Turn => Isometry3::rotation(along),
    }
}

/// A row with a motion after its joint, and another between translation and rotation of its body.
fn with_motions(row: &Row, joint: &Isometry3<f64>, end: &Isometry3<f64>) -> Row {
    let Translation3 { vector } = joint.translation;
    // Axes of a link that turn there and back leave rounding.
    let slides = joint.rotation.angle() < 1e-12 && *end == Isometry3::identity();
    if slides && row.is_vector() {
        return Row { xyz: (Vector3::from(row.xyz) + vector).into(), ..row.clone() };
    }
    if slides && vector.y == 0.0 {
        // Still a row of Denavit and Hartenberg.
        return Row { a: row.a + vector.x, d: row.d + vector.z, ..row.clone() };
    }
    let body = row.body();
    with_body(row, &(joint * body.translation * end * body.rotation))
}

/// A fixed row with a motion before it, its centre of mass included.
fn preceded(row: &Row, motion: &Isometry3<f64>) -> Row {
    let theta = Isometry3::rotation(Vector3::z() * row.theta);
    let inside = theta.inverse() * motion * theta;
    let com = match row.mass {
        Some(_) => (inside * nalgebra::Point3::from(row.com)).into(),
        None => row.com,
    };
    let still = Isometry3::identity();
    let moved = match motion.rotation == UnitQuaternion::identity() {
        true => with_motions(row, &inside.translation.into(), &still),
        false => with_motions(row, &inside, &still),
    };
    Row { com, ..moved }
}

/// A row with another body after its joint.
fn with_body(row: &Row, body: &Isometry3<f64>) -> Row {
    let (xyz, rpy) = xyz_rpy(body);
    Row { d: 0.0, a: 0.0, alpha: 0.0, xyz, rpy, ..row.clone() }
}

/// Translation, and roll, pitch, yaw [rad].
///
/// Yaw is read first and taken off before pitch and roll are read, so that they put the motion
/// together again to rounding, also where pitch is near a right angle and yaw alone is badly
/// determined.
fn xyz_rpy(motion: &Isometry3<f64>) -> ([f64; 3], [f64; 3]) {
    let matrix = motion.rotation.to_rotation_matrix();
    let yaw = matrix[(1, 0)].atan2(matrix[(0, 0)]);
    let rest = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw) * matrix;
    let pitch = (-rest[(2, 0)]).atan2(rest[(0, 0)]);
    let roll = (-rest[(1, 2)]).atan2(rest[(1, 1)]);
    (motion.translation.into(), [roll, pitch, yaw])
}

/// Terms that the mechanism names by the rows of a chain which has a new first one.
fn renumber(out: &mut Mechanism, before: &Mechanism, chain: usize) {
    for text in &mut out.model.terms {
        let mut spec = Spec::from(text.as_str());
        if spec.target.is_none() {
            continue;
        }
        if let Ok((_, targets)) = spec.targets(before)
            && let [Target::Row(c, row)] = targets[..]
            && c == chain
        {
            spec.target = Some(Target::Row(c, row + 1).name(before));
            *text = spec.to_string();
        }
    }
}

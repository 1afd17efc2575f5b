//! Targets of a term, the data that a term needs, and the typical sizes of its parameters.

use crate::Error;
use crate::mechanism::{Chain, Mechanism, Motion, PlaceName, Row, Target, Variable, place_name};
use crate::readings::{Readings, is_absent};
use crate::terms::gain::TYPICAL_GAIN;
use crate::terms::term::{Acts, Class, Needs, Per, Placed, Role, Scale, Spot, Term};

stated! {
    /// Largest size of an effect, in its typical sizes.
    pub(crate) fn largest_effect() -> f64 = 30.0;
}

/// Every target that a term may have in a mechanism.
#[must_use]
pub fn targets(term: &dyn Term, mechanism: &Mechanism) -> Vec<Target> {
    let mut targets: Vec<Target> = match term.info().per {
        Per::All => (0..mechanism.channels.len())
            .find(|&c| term.suits(mechanism, c))
            .map(|_| Target::All)
            .into_iter()
            .collect(),
        Per::Channel => (0..mechanism.channels.len())
            .filter(|&c| term.suits(mechanism, c))
            .filter(|&c| term.info().needs != Needs::Masses || carries_mass(mechanism, c))
            .filter(|&c| !weighs(term) || is_pulled(mechanism, c))
            // A term that has no places with two poses has none at this channel.
            .filter(|&c| !term.places(mechanism, c, 2).is_empty())
            .map(Target::Channel)
            .collect(),
        Per::Chain => (0..mechanism.chains.len()).map(Target::Chain).collect(),
        Per::ChainOrAll => {
            let chains = (0..mechanism.chains.len()).map(Target::Chain);
            chains.chain([Target::All]).collect()
        }
        Per::Closure => (0..mechanism.closures.len())
            .filter(|&c| of_ends(term) || mechanism.closures[c].kind.has_value())
            .map(Target::Closure)
            .collect(),
        Per::Row => mechanism
            .chains
            .iter()
            .enumerate()
            .flat_map(|(c, chain)| (0..chain.rows.len()).map(move |r| Target::Row(c, r)))
            .collect(),
    };
    targets.retain(|target| term.suits_target(mechanism, *target));
    targets
}

/// As [`targets`], with what a surface or a standing end does told for each of its places where these
/// readings touch several: one of two tables is bent, one of three sockets was pushed.
#[must_use]
pub fn targets_in(term: &dyn Term, mechanism: &Mechanism, readings: &Readings) -> Vec<Target> {
    let mut all: Vec<Target> = Vec::new();
    for target in targets(term, mechanism) {
        let Target::Closure(closure) = target else {
            all.push(target);
            continue;
        };
        let places = match has_places(term) {
            true => touched(mechanism, readings, closure),
            false => Vec::new(),
        };
        let several = if places.len() > 1 { places } else { vec![target] };
        several.into_iter().for_each(|target| {
            if !all.contains(&target) {
                all.push(target);
            }
        });
    }
    all
}

/// True for a term that one of several unknown places may have by itself.
#[must_use]
pub fn has_places(term: &dyn Term) -> bool {
    matches!(term.acts(), Acts::Surface(_) | Acts::End)
}

/// True for a term that acts at ends of closures: those need no value.
fn of_ends(term: &dyn Term) -> bool {
    has_places(term) || matches!(term.acts(), Acts::Attachment | Acts::Instrument(_))
}

/// The unknown places that a closure touches in these readings; of a closure between two unknown
/// things, those of the first.
fn touched(mechanism: &Mechanism, readings: &Readings, closure: usize) -> Vec<Target> {
    let Some((thing, columns)) = mechanism.keyed_things(closure).into_iter().next() else {
        return Vec::new();
    };
    let all = mechanism.key_columns();
    let mut places = Vec::new();
    for group in &readings.groups {
        let key = |column: &String| all.iter().position(|c| c == column).map(|k| group[k].clone());
        let keys: Vec<String> = columns.iter().filter_map(key).collect();
        if keys.iter().any(String::is_empty) {
            continue; // nothing is touched where a key is blank
        }
        let place = Target::Place(PlaceName::of(&place_name(thing, columns, &keys)));
        if !places.contains(&place) {
            places.push(place);
        }
    }
    places
}

/// Every target that several parts share and that a term may have, with one parameter for all of them.
///
/// Rows and chains share what moves with them, distances of one make their error, joints what their sensors do where those may be of
/// one make, and how they give to their load. What each session has anew, a free shape, and the
/// line of a channel are of one channel.
#[must_use]
pub fn shared(term: &dyn Term, mechanism: &Mechanism) -> Vec<Target> {
    let info = term.info();
    let once = term.placed() == Placed::Once;
    let other = term.role() == Role::Other;
    let needs_order = term.needs().contains(&Needs::Order);
    let alone = !once || needs_order || info.penalised || term.on_request_only();
    let single = targets(term, mechanism);
    let fits = |target: &Target| match (target, info.per) {
        (Target::EachRow(..), Per::Row) => other,
        (Target::EachChain(first), Per::Chain) => {
            other && !term.moves_only(&[Spot::Base]) && carry_alike(mechanism, *first)
        }
        // A gear, or a pulley, that is another than the drawn one is so at all of them.
        (Target::EachJoint(first, _), Per::Channel) => {
            let own = other || term.role() == Role::Gain;
            let alike = carry_alike(mechanism, *first) && mechanism.one_make(*target);
            own && (info.class == Class::Load || alike)
        }
        // Rods that were cut alike are wrong alike.
        (Target::EachClosure(_), Per::Closure) => matches!(term.acts(), Acts::Distance),
        // Belts of one make may all begin elsewhere, or all stretch.
        (Target::Together(_), Per::Channel) => mechanism.one_make(*target),
        _ => false,
    };
    let there = |target: &Target| mechanism.parts(*target).iter().all(|t| single.contains(t));
    let mut all = if alone { Vec::new() } else { mechanism.shared_targets() };
    all.retain(|t| fits(t) && there(t));
    for target in term.shared_by(mechanism) {
        let parts = mechanism.parts(target);
        if there(&target) && all.iter().all(|other| mechanism.parts(*other) != parts) {
            all.push(target);
        }
    }
    all
}

/// True where the chains of a group carry points at the same places.
fn carry_alike(mechanism: &Mechanism, first: usize) -> bool {
    let points = |chain: usize| {
        let name = Some(&mechanism.chains[chain].name);
        let own = mechanism.points.iter().filter(move |p| p.chain.as_ref() == name);
        own.map(|p| p.at).collect::<Vec<_>>()
    };
    let chains = mechanism.parts(Target::EachChain(first)).into_iter();
    let chains = chains.filter_map(|t| if let Target::Chain(c) = t { Some(c) } else { None });
    let mut carried = chains.map(points);
    let first = carried.next();
    carried.all(|points| Some(points) == first)
}

/// The longest length that is drawn: of links and tools, or, without links, of what lies between the points. None where
/// all are zero, as of a machine of slides alone.
pub(crate) fn longest(mechanism: &Mechanism) -> Option<f64> {
    let rows = mechanism.chains.iter().flat_map(|c| &c.rows);
    let of_rows = rows.flat_map(|r| [r.a, r.d, r.xyz[0], r.xyz[1], r.xyz[2]]);
    let linked = !mechanism.chains.is_empty();
    let points = mechanism.points.iter().filter(|p| p.chain.is_some() || !linked);
    let lengths = of_rows.chain(points.filter_map(|p| p.at).flatten());
    lengths.map(f64::abs).reduce(f64::max).filter(|longest| *longest > 0.0)
}

/// True for a channel whose readings are numbers of a converter, and no angles or lengths.
fn counts(mechanism: &Mechanism, channel: usize) -> bool {
    mechanism
        .channels
        .get(channel)
        .is_some_and(|c| !["rad", "deg", &mechanism.length_unit].contains(&&*c.unit))
}

/// Half of how far the coordinate of a channel goes.
fn reach(mechanism: &Mechanism, scales: &[Scale], channel: usize) -> f64 {
    let own = &mechanism.channels[channel];
    let shown = scales.get(channel).map(|scale| mechanism.half_range_in(channel, scale.span));
    own.gain.abs() * shown.unwrap_or_else(|| own.half_range())
}

/// What the typical gain is to be multiplied by, which is declared of the counts of the paper's potentiometers, two per
/// cent of their own: so it is of any converter at a joint; three parts in a thousand are typical of a joint or a length that
/// is read as such, three per cent of anything else.
fn own_gain(mechanism: &Mechanism, channel: usize) -> f64 {
    let parts = match mechanism.moves_joint(channel) {
        true if counts(mechanism, channel) => 2e-2 / TYPICAL_GAIN,
        true => 3e-3 / TYPICAL_GAIN,
        false if mechanism.measures(channel) => 3e-3 / TYPICAL_GAIN,
        false => 3e-2 / TYPICAL_GAIN,
    };
    mechanism.channels.get(channel).map_or(1.0, |c| parts * c.gain.abs())
}

/// True for what a weight does by itself; a law that users write may follow more than its torque.
fn weighs(term: &dyn Term) -> bool {
    !term.info().law && matches!(term.info().needs, Needs::Gravity | Needs::Masses)
}

/// True for a joint that a weight pulls more in one pose than in another: not what measures a length without a joint, nor
/// a slide that stands the same way in all poses, on which a weight is an offset.
fn is_pulled(mechanism: &Mechanism, channel: usize) -> bool {
    let own = &mechanism.channels[channel];
    let turns = |row: &Row| row.channel.is_some() && row.joint == Motion::Revolute;
    let at = |chain: &Chain| {
        let joint = chain.rows.iter().position(|r| r.channel.as_ref() == Some(&own.name));
        joint.is_some_and(|j| chain.rows[..=j].iter().any(turns))
    };
    own.torque.is_some() || mechanism.chains.iter().any(at)
}

/// True for a joint whose torque by the weights of links is known.
fn carries_mass(mechanism: &Mechanism, channel: usize) -> bool {
    if mechanism.channels[channel].torque.is_some() {
        return true;
    }
    let name = &mechanism.channels[channel].name;
    mechanism.chains.iter().any(|chain| {
        let joint = chain.rows.iter().position(|r| r.channel.as_ref() == Some(name));
        joint.is_some_and(|j| chain.rows[j..].iter().any(|r| r.mass.is_some()))
    })
}

/// What a common reference needs.
const CONVERTER: &str = "channels that a converter reads, in counts or volts";

/// Refuses a term that needs data which the readings or the mechanism do not have.
///
/// # Errors
///
/// [`Error::Context`] with the missing data.
pub fn provided(term: &dyn Term, mechanism: &Mechanism, readings: &Readings) -> Result<(), Error> {
    let info = term.info();
    let masses = || mechanism.chains.iter().any(|c| c.rows.iter().any(|r| r.mass.is_some()));
    let torques = || mechanism.channels.iter().any(|c| c.torque.is_some());
    let there = |needs: Needs| match needs {
        Needs::Nothing => true,
        Needs::Order => readings.timed && readings.poses() > 2,
        Needs::Temperature => readings.tempered,
        Needs::Approach | Needs::Way => (readings.held || readings.timed) && readings.poses() > 2,
        Needs::Motion => !readings.held && readings.timed,
        Needs::Gravity => mechanism.gravity.is_some(),
        Needs::Masses => (mechanism.gravity.is_some() && masses()) || torques(),
    };
    let lacks = |needs: &str| Err(Error::Context { term: info.id, needs: needs.into() });
    // Masses that are drawn want a direction in which they weigh.
    if info.needs == Needs::Masses && masses() && !torques() && !there(Needs::Gravity) {
        return lacks(Needs::Gravity.words());
    }
    column_there(term, mechanism, readings)?;
    match term.needs().into_iter().find(|needs| !there(*needs)) {
        Some(missing) => lacks(missing.words()),
        None if info.per == Per::All && targets(term, mechanism).is_empty() => lacks(CONVERTER),
        None => Ok(()),
    }
}

/// Refuses a law of a column of which no row knows anything.
///
/// # Errors
///
/// [`Error::Context`] with its name.
pub(crate) fn column_there(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
) -> Result<(), Error> {
    let Acts::Coupled(law) = term.acts() else { return Ok(()) };
    let names = mechanism.value_columns();
    let known = |name: &str| {
        let own = names.iter().zip(&readings.table.columns).find(|(own, _)| *own == name);
        own.is_some_and(|(_, column)| !is_absent(column))
    };
    let absent = law.variables.iter().find_map(|variable| match variable {
        Variable::Column(name) if !known(name) => Some(name),
        _ => None,
    });
    match absent {
        Some(name) => {
            let needs = format!("column {name}, which its law follows");
            Err(Error::Context { term: term.info().id, needs })
        }
        None => Ok(()),
    }
}

/// What is lacking to search for what happened once.
const ORDER: &str = "time_s, the order of the placements";

/// As [`provided`], for a term that is searched for: what happened once has no time among
/// placements whose order nothing tells, [`Readings::ordered`].
///
/// # Errors
///
/// As [`provided`].
pub fn searchable(
    term: &dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
) -> Result<(), Error> {
    provided(term, mechanism, readings)?;
    let info = term.info();
    let once = term.placed() == Placed::AtPose && info.class != Class::Data;
    match once && !readings.ordered {
        true => Err(Error::Context { term: info.id, needs: ORDER.into() }),
        false => Ok(()),
    }
}

/// Typical size of each parameter of a term at a target, in the units of a mechanism.
///
/// A typical length is declared as a fraction of the longest link, and a typical size per torque
/// for all masses at the end of that link. An angle of a prismatic joint is a length. `scales` are those of
/// the channels in some readings; without them, none, only what is declared tells how far a channel goes.
#[must_use]
pub fn typical(
    mechanism: &Mechanism,
    scales: &[Scale],
    term: &dyn Term,
    target: Target,
) -> Vec<f64> {
    if term.info().law {
        return term.info().parameters.iter().map(|p| p.typical).collect();
    }
    let longest = longest(mechanism).unwrap_or(1.0);
    let rows = || mechanism.chains.iter().flat_map(|c| &c.rows);
    // Where no link has a mass, a torque is that of a unit weight.
    let mass = rows().filter_map(|r| r.mass).reduce(|a, b| a + b).unwrap_or(1.0);
    let slides = mechanism.slides_at(target);
    // A coordinate of no joint and no length has how far its channel goes as its size.
    let own = match target {
        Target::Channel(_) | Target::EachJoint(..) | Target::Together(_) if !slides => {
            mechanism.channels_at(target).first().copied()
        }
        _ => None,
    };
    let own = own.filter(|&c| !mechanism.moves_joint(c)).map(|c| reach(mechanism, scales, c));
    let scale = |unit: &str| match unit {
        "rad" | "rad/session" | "rad/K" if slides => longest,
        "rad" | "rad/session" | "rad/K" => own.unwrap_or(1.0),
        "length" | "length/K" => longest,
        "rad/reading" => {
            mechanism.channels_at(target).first().map_or(1.0, |c| own_gain(mechanism, *c))
        }
        "rad/length" => 1.0 / longest,
        "rad/torque" => 1.0 / (longest * mass),
        _ => 1.0,
    };
    term.info().parameters.iter().map(|p| p.typical * scale(p.unit)).collect()
}

//! What may be missing: every term at every target that mechanism and readings allow.

use std::cell::LazyCell;

use crate::Error;
use crate::estimate::{Fit, Observations};
use crate::mechanism::{Mechanism, Target};
use crate::model::{Instance, Model, SHARES, places};
use crate::terms;
use crate::terms::targets::{provided, searchable, shared, targets, targets_in};
use crate::terms::term::{Acts, Needs, Over, Per, Placed, Role, Spot, Term};

/// Named and free candidates of a search: what [`absent`] has, and the equations that the fit leaves
/// can determine.
#[must_use]
pub fn candidates(observations: &Observations, fit: &Fit, without: &[String]) -> Vec<Instance> {
    let mut all = absent(observations, fit, without);
    // Parameters of which no equation tells take none.
    let room = fit.dof + fit.within;
    all.retain(|instance| instance.width() as f64 <= room);
    all
}

/// Named and free effects that mechanism and readings allow and the fit does not have, however few equations
/// there are: what a search cannot try may be there unseen.
#[must_use]
pub fn absent(observations: &Observations, fit: &Fit, without: &[String]) -> Vec<Instance> {
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let hidden = hidden(observations);
    let mut all = Vec::new();
    for term in terms::all(mechanism) {
        let info = term.info();
        if matches!(term.placed(), Placed::AtPose | Placed::AtOrder)
            || term.on_request_only()
            || without.iter().any(|w| w == info.id)
            || provided(term, mechanism, readings).is_err()
        {
            continue;
        }
        let single = targets_in(term, mechanism, readings).into_iter();
        for target in single.chain(shared(term, mechanism)) {
            if !meaningful(observations, fit, term, target) || hidden(term, target) {
                continue;
            }
            let channel = if let Target::Channel(c) = target { c } else { 0 };
            for place in places(term, mechanism, readings, channel) {
                let instance = Instance { term, target, place };
                if !fit.model.instances.contains(&instance) {
                    all.push(instance);
                }
            }
        }
    }
    all
}

/// Terms that are no candidates of a session, and what they need, [`Error::Context`]. What acts in motion alone
/// does nothing to held poses, and a reference nothing to encoders: these are not lacking there.
#[must_use]
pub fn lacking(observations: &Observations) -> Vec<(&'static str, String)> {
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let hidden = hidden(observations);
    let lacks = |term: &&'static dyn Term| match searchable(*term, mechanism, readings) {
        Err(Error::Context { term, needs }) => Some((term, needs)),
        _ => {
            let some = targets(*term, mechanism).iter().any(|target| hidden(*term, *target));
            some.then_some((term.info().id, SHARES.into()))
        }
    };
    let acts = |term: &&&'static dyn Term| {
        let still = readings.held && term.needs().contains(&Needs::Motion);
        let nowhere = term.info().per == Per::All && targets(**term, mechanism).is_empty();
        !still && !nowhere
    };
    terms::all(mechanism).iter().filter(acts).filter_map(lacks).collect()
}

/// Through so many places a line may not go: at fewer a law of the reading, or of its way, is of its noise.
const LINE: usize = 3;

/// Standard deviations of a reading within which readings are of one place: all of a session but one in 10⁸.
const ONE_PLACE: f64 = 6.0;

/// Readings of a channel that differ by no more are of one place. A slide goes where the seating of a tip has it: how
/// well closures hold moves it as its noise does.
pub(crate) fn one_place(observations: &Observations, fit: &Fit, channel: usize) -> f64 {
    let (mechanism, sigma) = (&observations.mechanism, fit.noise.sigma[channel]);
    let seated = match mechanism.slides(channel) {
        true => play(fit) / mechanism.channels[channel].gain.abs(),
        false => 0.0,
    };
    ONE_PLACE * sigma.hypot(seated)
}

/// Largest standard deviation of a closure that holds a length [length].
fn play(fit: &Fit) -> f64 {
    let own = fit.noise.of_one_reading().by_closure(&fit.model).into_iter();
    let lengths = own.zip(&fit.model.closures).filter(|(_, c)| !c.is_of_coordinates());
    lengths.map(|(sd, _)| sd).fold(0.0, f64::max)
}

/// True where a channel has been read at places of which more than a line is told.
pub(crate) fn has_places(observations: &Observations, fit: &Fit, channel: usize) -> bool {
    places_of(observations, fit, channel, LINE) == LINE
}

/// At how many places a channel has been read, up to so many.
pub(crate) fn places_of(
    observations: &Observations,
    fit: &Fit,
    channel: usize,
    most: usize,
) -> usize {
    let Observations { readings, weights, .. } = observations;
    let near = one_place(observations, fit, channel);
    let mut known: Vec<f64> = Vec::with_capacity(most);
    for row in (0..readings.samples).filter(|&row| weights[row] > 0.0) {
        if known.len() == most {
            break;
        }
        let read = readings.row(row)[channel];
        if known.iter().all(|other| (read - other).abs() > near) {
            known.push(read);
        }
    }
    known.len()
}

/// Whether nothing tells the torque on which a term depends at a target. The torques are computed for
/// the first term that may depend on one.
fn hidden(observations: &Observations) -> impl Fn(&dyn Term, Target) -> bool {
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let drives = LazyCell::new(|| Model::drives(mechanism, readings, mechanism).ok().flatten());
    move |term, target| {
        matches!(term.acts(), Acts::Load(_) | Acts::Coupled(_))
            && drives.as_ref().is_some_and(|drives| drives.hide(mechanism, term, target))
    }
}

/// True where a chain carries points at several places: turned, they are not where any one shift
/// puts them.
fn carries_body(mechanism: &Mechanism, chain: usize) -> bool {
    let name = Some(&mechanism.chains[chain].name);
    let mut places = mechanism.points.iter().filter(|p| p.chain.as_ref() == name).map(|p| p.at);
    let first = places.next();
    places.any(|at| Some(at) != first)
}

/// False where a term would repeat another: a body that carries no joint has no axis
/// to tilt, before the first joint the base tilts, a frame that is free as a whole is
/// longer by itself, and has its tool where it is, a point that the last joint carries is the tool, where nothing is fixed to the base a single chain has none, and a
/// free shape is any shape.
fn meaningful(observations: &Observations, fit: &Fit, term: &dyn Term, target: Target) -> bool {
    let mechanism = &observations.mechanism;
    // Without a length that is known a gain of all lengths is the scale, and nothing else.
    if term.role() == Role::Gain && !mechanism.has_scale() {
        let gains = fit.model.instances.iter().filter(|i| i.term.role() == Role::Gain);
        if of_all_lengths(mechanism, gains.map(|i| i.target).chain([target])) {
            return false;
        }
    }
    // Where nothing else is known, the lengths of one make are the scale.
    if let Target::EachClosure(_) = target {
        let own: Vec<usize> = mechanism.closures_of(target).collect();
        if !mechanism.has_scale_beside(&own) {
            return false;
        }
    }
    if target.is_shared() {
        // What all parts have by themselves, they do not share beside that.
        let parts = mechanism.parts(target);
        let its = |part: &Target| {
            let mut instances = fit.model.instances.iter();
            instances.any(|i| i.target == *part && i.term.info().id == term.info().id)
        };
        let each = |part: &Target| meaningful(observations, fit, term, *part);
        return !parts.iter().all(its) && parts.iter().all(each);
    }
    if has_free_shape(fit, term, target) {
        return false;
    }
    let of_reading = term.over() == Some(Over::Reading) && term.role() == Role::Other;
    let of_side = term.needs().contains(&Needs::Approach);
    if let (true, Target::Channel(channel)) = (of_reading || of_side, target)
        && !has_places(observations, fit, channel)
    {
        return false;
    }
    // All chains of one are that chain.
    if target == Target::All && term.info().per == Per::ChainOrAll && mechanism.chains.len() == 1 {
        return false;
    }
    match target {
        Target::Row(chain, row) => {
            let rows = &mechanism.chains[chain].rows;
            let first = rows.iter().position(|r| r.channel.is_some()).unwrap_or(0);
            let last = rows.iter().rposition(|r| r.channel.is_some()).unwrap_or(0);
            let mut free = fit.model.instances.iter().filter(|i| i.term.info().broad);
            // The body after the last joint carries nothing but the tool.
            let tool = |i: &Instance| row >= last && i.target == Target::Chain(chain);
            !free.any(|i| i.target == target || tool(i))
                && (!term.moves_only(&[Spot::End])
                    || (row >= first && row < last)
                    || (row == last && carries_body(mechanism, chain)))
        }
        Target::Chain(chain) if term.moves_tool() => {
            let last = mechanism.chains[chain].rows.len().saturating_sub(1);
            let mut free = fit.model.instances.iter().filter(|i| i.term.info().broad);
            !free.any(|i| i.target == Target::Row(chain, last))
        }
        Target::Chain(_) if term.info().per == Per::ChainOrAll && mechanism.chains.len() == 1 => {
            let all = |i: &Instance| i.term.info().id == term.info().id && i.target == Target::All;
            !fit.model.instances.iter().any(all)
        }
        Target::Chain(_) => !(term.moves_only(&[Spot::Base, Spot::Root]) && mechanism.floats()),
        _ => true,
    }
}

/// True where these targets are every channel that reads a length.
fn of_all_lengths(mechanism: &Mechanism, targets: impl Iterator<Item = Target>) -> bool {
    let at: Vec<usize> = targets.flat_map(|t| mechanism.channels_at(t)).collect();
    let measuring = mechanism.measuring();
    !measuring.is_empty() && measuring.iter().all(|c| at.contains(c))
}

/// True where two effects are gains that together are the scale: either is the other and another size of the
/// whole, which no pose tells.
#[must_use]
pub(crate) fn differ_by_scale(mechanism: &Mechanism, one: &Instance, other: &Instance) -> bool {
    [one, other].iter().all(|i| i.term.role() == Role::Gain)
        && !mechanism.has_scale()
        && of_all_lengths(mechanism, [one.target, other.target].into_iter())
}

/// True where an effect bends how all lengths read: where its slope is one is how large the whole is, which no pose tells.
#[must_use]
pub(crate) fn changes_scale(mechanism: &Mechanism, one: &Instance) -> bool {
    one.term.over() == Some(Over::Reading)
        && one.term.role() == Role::Other
        && !mechanism.has_scale()
        && of_all_lengths(mechanism, std::iter::once(one.target))
}

/// True where any shape over what this term runs over is fitted to its target.
#[must_use]
pub fn has_free_shape(fit: &Fit, term: &dyn Term, target: Target) -> bool {
    let mut instances = fit.model.instances.iter();
    let free = |i: &Instance| i.target == target && i.term.info().penalised;
    term.over().is_some() && instances.any(|i| free(i) && i.term.over() == term.over())
}

//! [`Warned`]: what is suspicious, for programs and for people.

use crate::apply::check::Check;
use crate::apply::known::Known;
use crate::diagnosis::options::LEVEL;
use crate::diagnosis::plausibility::Absurdity;
use crate::diagnosis::trace::Traced;
use crate::estimate::directions::ParameterReport;
use crate::estimate::suspicion::{InDegrees, Suspicion};
use crate::estimate::{Fit, Note, Observations};
use crate::mechanism::Mechanism;
use crate::model::Instance;
use crate::model::known::Declared;
use crate::monitor::closing::OpenLoops;
use crate::report::words;
use crate::terms::term::{Needs, Placed};

/// Something suspicious about the readings, or about what is declared of them.
///
/// Programs decide by `kind` and `target`; `text` is for people, and may be worded otherwise in a later
/// version.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Warned {
    /// What it is.
    pub kind: Kind,
    /// The channels or closures, joined by `+`; null where it is about all of them.
    pub target: Option<String>,
    /// The same in words, with what to do.
    pub text: String,
}

/// Results of earlier versions have the text alone.
#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Warned {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Either)
    }
}

#[cfg(feature = "serde")]
struct Either;

#[cfg(feature = "serde")]
impl<'de> serde::de::Visitor<'de> for Either {
    type Value = Warned;

    fn expecting(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        out.write_str("a warning: kind, target and text")
    }

    fn visit_str<E>(self, text: &str) -> Result<Warned, E> {
        Ok(Warned { kind: Kind::Other, target: None, text: text.into() })
    }

    fn visit_map<A: serde::de::MapAccess<'de>>(self, entries: A) -> Result<Warned, A::Error> {
        #[derive(serde::Deserialize)]
        struct Entries {
            kind: Kind,
            target: Option<String>,
            text: String,
        }
        let from = serde::de::value::MapAccessDeserializer::new(entries);
        let Entries { kind, target, text } = serde::Deserialize::deserialize(from)?;
        Ok(Warned { kind, target, text })
    }
}

/// What a warning is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "document", schemars(rename = "WarnedKind"))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Kind {
    /// Channels read the wrong way round.
    Reversed,
    /// One of these channels reads the wrong way round, and nothing says which.
    EitherReversed,
    /// Beside such a mistake: with the zeros of these channels far from where they are declared the loop closes as well.
    Zeros,
    /// The readings of two channels are exchanged.
    Exchanged,
    /// The gap of a track lies within the range of motion.
    Gap,
    /// A channel is stuck at one reading while others move.
    Stuck,
    /// No start led to a fit in which every joint moves, or an unknown frame, `target`, was not found.
    NoStart,
    /// Poses repeat the readings of others.
    SameReadings,
    /// Distances follow from the other closures.
    Follow,
    /// Distances between points of which no readings touch both.
    Unused,
    /// What is declared as known is not what the readings have.
    Knowledge,
    /// An unknown point has an image in a mirror that fits as well.
    Mirrored,
    /// Readings look like degrees and are declared as radians.
    Degrees,
    /// Readings look like another unit, or another converter, than the one that is declared.
    Units,
    /// Points that an instrument sees fit with the other hand.
    LeftHanded,
    /// Columns beside the channels belong to the pose before, or to the next.
    Shifted,
    /// A channel reads in steps that are a good part of its noise.
    Coarse,
    /// Declared noise is not what the readings show.
    Noise,
    /// An estimate has a sign that its term cannot have.
    UnphysicalSign,
    /// A channel reads one value while others move.
    Constant,
    /// A bit of a converter keeps one value.
    StuckBit,
    /// A channel stops at one reading within its range.
    Clipped,
    /// Readings at an end of the range.
    EndOfRange,
    /// A held pose moved while it was sampled.
    MovedPose,
    /// Rows repeat an earlier row.
    StaleRows,
    /// A pose is a copy of another.
    CopiedPose,
    /// Rows without a pose repeat others within noise.
    UnlabelledRepeats,
    /// A label of what was touched that looks like another, misspelt.
    Labels,
    /// Columns that nothing uses.
    IgnoredColumns,
    /// Poses are known, and are not used here.
    UnusedPoses,
    /// Time runs backwards.
    TimeGoesBack,
    /// Readings of the rest pose are not of one pose.
    MovedRest,
    /// What the import of a log noted.
    Imported,
    /// The loops of check readings do not close as those of the session.
    OpenLoops,
    /// Numbers of the earlier result were edited.
    Edited,
    /// The mechanism is drawn otherwise than when an earlier result was made.
    Redrawn,
    /// Offsets that were asked for stay as drawn.
    AsDrawn,
    /// Rows are left out, since a delay puts them beyond the end of the recording.
    BeyondTheEnd,
    /// Known poses look like another unit, or another order.
    KnownPoses,
    /// Noise of channels that is absurd beside what they can read.
    AbsurdNoise,
    /// A misclosure that is absurd beside the lengths of the loop.
    AbsurdMisclosure,
    /// An offset that puts a joint beyond its limits in every row.
    AbsurdOffset,
    /// An effect that is absurd beside what occurs in practice.
    AbsurdEffect,
    /// A kind of a later version.
    #[cfg_attr(feature = "serde", serde(other))]
    Other,
}

/// What is suspicious: about the wiring as of the first fit, about the rest as of the last.
#[must_use]
pub fn warnings(observations: &Observations, before: &Fit, after: &Fit) -> Vec<Warned> {
    let holds = |s: &&Suspicion| s.of_wiring() && !(s.is_no_start() && after.has_start());
    let wiring = before.warnings.iter().filter(holds);
    // Loops close as radians: an encoder counts its turns.
    let closes = after.p_value.is_some_and(|p| p > LEVEL);
    let turns =
        |s: &Suspicion| matches!(s, Suspicion::Degrees { of: InDegrees::Readings, .. }) && closes;
    let rest = after.warnings.iter().filter(|s| !s.of_wiring() && !turns(s));
    wiring.chain(rest).map(|s| of_suspicion(&observations.mechanism, s)).collect()
}

/// What is suspicious of a mechanism as it is declared, without any readings.
#[must_use]
pub fn of_drawing(mechanism: &Mechanism) -> Vec<Warned> {
    let channels = mechanism.limits_as_in_degrees();
    let limits = Suspicion::Degrees { channels: channels.clone(), of: InDegrees::LimitsInDegrees };
    let found = (!channels.is_empty()).then_some(limits);
    let limits = found.iter().map(|suspicion| of_suspicion(mechanism, suspicion));
    let planes = mechanism.planes.iter().filter_map(|plane| {
        let text = words::long_normal(plane, &mechanism.length_unit)?;
        Some(Warned { kind: Kind::Other, target: Some(plane.name.clone()), text })
    });
    limits.chain(planes).collect()
}

/// What is absurd; channels of which the same is to be said are one entry.
#[must_use]
pub fn implausible(observations: &Observations, absurd: &[Absurdity]) -> Vec<Warned> {
    let mut entries: Vec<(&Absurdity, Vec<String>)> = Vec::new();
    for one in absurd {
        let target = absurd_at(observations, one);
        match entries.iter_mut().find(|(other, _)| words::are_alike(observations, one, other)) {
            Some((_, targets)) => targets.extend(target),
            None => entries.push((one, target.into_iter().collect())),
        }
    }
    let entry = |(one, targets): (&Absurdity, Vec<String>)| Warned {
        kind: match one {
            Absurdity::Noise { .. } => Kind::AbsurdNoise,
            Absurdity::Misclosure { .. } => Kind::AbsurdMisclosure,
            Absurdity::Limits { .. } => Kind::AbsurdOffset,
            Absurdity::Effect { .. } => Kind::AbsurdEffect,
        },
        text: words::absurdity(observations, one, &targets),
        target: (!targets.is_empty()).then(|| targets.join("+")),
    };
    entries.into_iter().map(entry).collect()
}

/// What an absurdity is of; none where it is of all loops.
fn absurd_at(observations: &Observations, absurdity: &Absurdity) -> Option<String> {
    let mechanism = &observations.mechanism;
    match *absurdity {
        Absurdity::Noise { channel, .. } | Absurdity::Limits { channel, .. } => {
            Some(mechanism.channels[channel].name.clone())
        }
        Absurdity::Misclosure { .. } => None,
        Absurdity::Effect { instance, .. } => Some(instance.target.name(mechanism)),
    }
}

/// That offsets stay as drawn; none where they do not.
#[must_use]
pub fn as_drawn(traced: &Traced) -> Option<Warned> {
    let mechanism = &traced.observations.mechanism;
    let drawn = traced.offsets.iter().filter(|i| !traced.after.model.instances.contains(i));
    let names: Vec<String> = drawn.map(|i| i.target.name(mechanism)).collect();
    let text = words::as_drawn(&names, [&traced.before, &traced.after]);
    let target = Some(names.join("+"));
    (!names.is_empty()).then_some(Warned { kind: Kind::AsDrawn, target, text })
}

/// That rows are left out whose later instant was not recorded; none where none is.
#[must_use]
pub fn unread(traced: &Traced) -> Option<Warned> {
    let text = words::unread(traced.unread.len());
    (!traced.unread.is_empty()).then_some(Warned { kind: Kind::BeyondTheEnd, target: None, text })
}

/// How known poses were misread; none where they were not.
#[must_use]
pub fn known_poses(observations: &Observations, check: Option<Check>) -> Option<Warned> {
    let misread = check?.misread?;
    let text = words::misread(misread, &observations.mechanism.length_unit);
    Some(Warned { kind: Kind::KnownPoses, target: None, text })
}

/// That no clock tells when known poses were read beside what happened in a session; none where one does, or nothing
/// depends on it.
#[must_use]
pub fn clocks(observations: &Observations, fit: &Fit, known: Option<&Known>) -> Option<Warned> {
    let told = observations.readings.table.has_clock_of(&known?.table);
    let depends =
        |i: &Instance| i.term.placed() == Placed::AtPose || i.term.needs().contains(&Needs::Order);
    let untold = !told && fit.model.instances.iter().any(depends);
    let text = words::clocks();
    untold.then_some(Warned { kind: Kind::TimeGoesBack, target: None, text })
}

/// That the loops of the known poses do not close as those of the session do.
#[must_use]
pub fn open_loops(mechanism: &Mechanism, found: &OpenLoops) -> Warned {
    let text = words::open_loops(mechanism, "the check readings", found, Some(false));
    Warned { kind: Kind::OpenLoops, target: None, text }
}

/// Which wires are exchanged; none where nothing says so.
#[must_use]
pub fn wires(observations: &Observations, fit: &Fit) -> Option<Warned> {
    let found = fit.warnings.iter().find(|s| s.of_wires());
    found.map(|s| of_suspicion(&observations.mechanism, s))
}

/// What must be noted of an estimate.
#[must_use]
pub fn of_parameter(parameter: &ParameterReport) -> Option<Warned> {
    let kind = match parameter.noting()? {
        Note::UnphysicalSign => Kind::UnphysicalSign,
    };
    Some(Warned { kind, target: Some(parameter.target.clone()), text: parameter.remark()? })
}

fn of_suspicion(mechanism: &Mechanism, suspicion: &Suspicion) -> Warned {
    let channel = |c: &usize| mechanism.channels[*c].name.as_str();
    let closure = |c: &usize| mechanism.closures[*c].name.as_str();
    let joined = |names: Vec<&str>| Some(names.join("+"));
    let channels = |of: &[usize]| joined(of.iter().map(channel).collect());
    let (kind, target) = match suspicion {
        Suspicion::Reversed { channels: of, .. } => (Kind::Reversed, channels(of)),
        Suspicion::EitherReversed { channels: of, .. } => (Kind::EitherReversed, channels(of)),
        Suspicion::Zeros { channels: of, .. } => (Kind::Zeros, channels(of)),
        Suspicion::Exchanged { channels: of, .. } | Suspicion::Unlike { channels: of, .. } => {
            (Kind::Exchanged, channels(&of[0]))
        }
        Suspicion::Gap { channel, .. } => (Kind::Gap, channels(&[*channel])),
        Suspicion::Stuck { channel, .. } => (Kind::Stuck, channels(&[*channel])),
        Suspicion::SameReadings { .. } => (Kind::SameReadings, None),
        Suspicion::Follow { closures } => {
            (Kind::Follow, joined(closures.iter().map(closure).collect()))
        }
        Suspicion::Unused { closures } => {
            (Kind::Unused, joined(closures.iter().map(closure).collect()))
        }
        Suspicion::Knowledge { of: Declared::Distance(k), .. } => {
            (Kind::Knowledge, joined(vec![closure(k)]))
        }
        Suspicion::Knowledge { of: Declared::Term(instance), .. } => {
            (Kind::Knowledge, Some(instance.target.name(mechanism)))
        }
        Suspicion::Degrees { channels: of, .. } => (Kind::Degrees, channels(of)),
        Suspicion::Gains { channels: of, .. } | Suspicion::MeasuredInUnit { channels: of, .. } => {
            (Kind::Units, channels(of))
        }
        Suspicion::Length { at, .. } => (Kind::Units, Some(words::length(mechanism, *at).0)),
        Suspicion::LeftHanded { point, .. } => {
            (Kind::LeftHanded, Some(mechanism.points[*point].name.clone()))
        }
        Suspicion::SeenInUnit { point, .. } => {
            (Kind::Units, Some(mechanism.points[*point].name.clone()))
        }
        Suspicion::Shifted { columns, .. } => (Kind::Shifted, Some(columns.join("+"))),
        Suspicion::Coarse { channel, .. } => (Kind::Coarse, channels(&[*channel])),
        Suspicion::Noise { .. } => (Kind::Noise, None),
        Suspicion::Play { closures, .. } => {
            (Kind::Noise, joined(closures.iter().map(closure).collect()))
        }
        Suspicion::LengthNoise { closure, .. } => {
            (Kind::Noise, Some(mechanism.closures[*closure].name.clone()))
        }
        Suspicion::Mirrored { name, .. } => (Kind::Mirrored, Some(name.clone())),
        Suspicion::NoStart { .. } => (Kind::NoStart, None),
        Suspicion::Lost { name, .. } => (Kind::NoStart, Some(name.clone())),
    };
    Warned { kind, target, text: words::suspicion(mechanism, suspicion) }
}

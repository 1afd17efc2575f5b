//! Terms: the physical effects that a model is made of.
//!
//! The paper's model is the list `[offset, gain]`; closing the loop is adding
//! to that list. A term says at which of four stages it acts, sees that stage's
//! state of one sample and its context, adds its own, and knows nothing of
//! other terms:
//!
//! ```text
//! readings → electronics → sensor → geometry and load → closure
//! ```
//!
//! A term is one file in this folder and one line in the registry at the foot
//! of this one. Its parameters are zero where the effect is absent.

use crate::kinematics::elements::{Axis, Way, Weight};
use crate::mechanism::{Channel, Mechanism};
use crate::numerics::lanes::Lanes;

/// Where the fault lies that a term describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Class {
    /// One channel.
    Sensor,
    /// All channels alike.
    Electronics,
    /// Lengths and axes.
    Geometry,
    /// What closes the loop.
    Closure,
    /// Weight and stiffness.
    Load,
    /// A reading that is wrong.
    Data,
}

/// What one instance of a term belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Per {
    /// A channel: `a22`.
    Channel,
    /// A row of a chain: `arm2/2`.
    Row,
    /// A chain: `arm2`.
    Chain,
    /// A chain, or all chains alike: `arm2`, `all`.
    ChainOrAll,
    /// A closure: `wrist1-wrist2`.
    Closure,
    /// The whole mechanism: `all`.
    All,
}

/// What a term needs of the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nothing but readings.
    Nothing,
    /// `time_s`.
    Order,
    /// A temperature that changes.
    Temperature,
    /// Held poses: the direction of approach of each.
    Approach,
    /// A recording in motion: velocities.
    Motion,
    /// The direction of gravity.
    Gravity,
    /// Link masses and the direction of gravity.
    Masses,
}

impl Needs {
    /// What is missing, in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Nothing => "readings",
            Self::Order => "time_s",
            Self::Temperature => "temperature_c that changes",
            Self::Approach => "held poses or time_s, to approach from",
            Self::Motion => "recording in motion with time_s",
            Self::Gravity => "direction of gravity in the mechanism",
            Self::Masses => "link masses in the mechanism",
        }
    }
}

/// One parameter of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its unit; `length` stands for the mechanism's unit, `reading` for the channel's.
    pub unit: &'static str,
    /// A size that occurs in practice, see [`typical`]: scale of priors and of tests.
    pub typical: f64,
}

/// Identity of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Info {
    /// What scripts call it.
    pub id: &'static str,
    /// Where the fault lies.
    pub class: Class,
    /// What an instance belongs to.
    pub per: Per,
    /// What it needs of the readings.
    pub needs: Needs,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// What it is, from its source.
    pub doc: &'static str,
    /// True for a free shape, whose parameters are held by their typical size.
    pub penalised: bool,
    /// True for a term that repeats part of others, and is held by its typical size: the whole
    /// frame of a link, identified where it is asked for and no candidate when a residual is
    /// traced; and the tool.
    pub broad: bool,
}

/// Constants of one channel that terms scale by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Reading about which offset and gain are told apart.
    pub centre: f64,
    /// Middle of the channel's range.
    pub middle: f64,
    /// Half its range, in readings.
    pub half_range: f64,
    /// Nominal gain.
    pub gain: f64,
    /// Nominal joint coordinate at the centre.
    pub angle: f64,
    /// Lowest and highest reading in these data.
    pub span: [f64; 2],
}

impl Scale {
    /// Scales of a channel whose readings spread over `span` about `centre`.
    #[must_use]
    pub fn of(channel: &Channel, centre: f64, span: [f64; 2]) -> Self {
        Self {
            centre,
            middle: channel.middle(),
            half_range: channel.half_range(),
            gain: channel.gain,
            angle: channel.angle(centre),
            span,
        }
    }
}

/// What a term sees of eight samples.
#[derive(Debug, Clone, Copy)]
pub struct Site<'a> {
    /// Readings that enter the stage, one per channel.
    pub readings: &'a [Lanes],
    /// The channel that is being corrected.
    pub channel: usize,
    /// Constants of each channel.
    pub scales: &'a [Scale],
    /// Time of each sample, 0 to 1 over its session.
    pub time: Lanes,
    /// Temperature above the mean of the session, K.
    pub temperature: Lanes,
    /// Direction from which each channel came to its reading: -1, 0, 1.
    pub approach: &'a [Lanes],
    /// Change of each reading, per second.
    pub velocity: &'a [Lanes],
    /// Number of each sample's pose.
    pub pose: Lanes,
    /// Where a searched term acts: a pose, or another channel.
    pub place: usize,
}

impl Site<'_> {
    /// Reading of the channel that is being corrected.
    #[inline(always)]
    #[must_use]
    pub fn reading(&self) -> Lanes {
        self.readings[self.channel]
    }

    /// Constants of the channel that is being corrected.
    #[inline(always)]
    #[must_use]
    pub fn scale(&self) -> &Scale {
        &self.scales[self.channel]
    }

    /// `u`: the reading from the middle of the range, in half ranges.
    #[inline(always)]
    #[must_use]
    pub fn u(&self) -> Lanes {
        let scale = self.scale();
        (self.reading() - Lanes::splat(scale.middle)) * (1.0 / scale.half_range)
    }

    /// One where the sample belongs to pose `place`, zero elsewhere.
    #[must_use]
    pub fn at_place(&self) -> Lanes {
        let place = self.place as f64;
        self.pose.map(|p| if p == place { 1.0 } else { 0.0 })
    }
}

/// A term that acts on readings: volts and counts.
pub trait Electronics: Sync {
    /// What it adds to the reading of `site.channel`.
    fn correction(&self, p: &[f64], site: &Site) -> Lanes;
    /// Derivatives of the correction by `p`.
    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
    /// Derivatives of the correction by every reading, added to `out`.
    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
}

/// A term that acts on one joint: reading to angle.
pub trait Sensor: Sync {
    /// What it adds to the joint coordinate [rad].
    fn correction(&self, p: &[f64], site: &Site) -> Lanes;
    /// Derivatives of the correction by `p`.
    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
    /// Derivative of the correction by the reading.
    fn slope(&self, p: &[f64], site: &Site) -> Lanes;
}

/// Where along a row a geometry term moves it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spot {
    /// Before the first joint of a chain, along the axes of the base.
    Base,
    /// Before the first joint of a chain, about the axes of its frame.
    Root,
    /// After the joint of a row, before its body.
    Joint,
    /// After the translation of a row's body: about the next joint's origin.
    End,
    /// At the frame at the end of a chain.
    Tip,
}

/// A motion that a geometry term frees, one per parameter.
pub type Freedom = (Spot, Axis, Way);

/// At which stage a term acts, and what it does there.
#[derive(Clone, Copy)]
pub enum Acts {
    /// On readings.
    Electronics(&'static dyn Electronics),
    /// On one joint coordinate.
    Sensor(&'static dyn Sensor),
    /// On the bodies of a chain.
    Geometry(&'static [Freedom]),
    /// On joints, by their torque.
    Load(Weight),
    /// On the value of a distance.
    Distance,
}

/// What of a term holds beyond the session in which it was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Outlasts {
    /// All of it.
    Whole,
    /// Its value, not its place: what happened in one pose has happened in all later sessions.
    Value,
    /// Nothing: another session drifts in its own way.
    Nothing,
}

/// What a parameter is to the line of its channel, `angle = gain * reading + offset`, eq. (9).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The offset itself, reported at reading zero.
    Offset,
    /// The gain itself.
    Gain,
    /// Is added to the offset where the term acts.
    Shift,
    /// None: the effect is no such line.
    Other,
}

/// One physical term of the model.
pub trait Term: Sync {
    /// Identity, parameters, units and words.
    fn info(&self) -> &'static Info;

    /// At which stage it acts.
    fn acts(&self) -> Acts;

    /// What the place of an instance is, of a term that has several at one target.
    fn placed(&self) -> Placed {
        Placed::Once
    }

    /// Whether it can act on a channel at all, whatever the readings: by what is read there, and
    /// by how the joint moves.
    fn suits(&self, _mechanism: &Mechanism, _channel: usize) -> bool {
        true
    }

    /// Those places, to be tried one by one.
    fn places(&self, _mechanism: &Mechanism, _channel: usize, _poses: usize) -> Vec<usize> {
        vec![0]
    }

    /// What its parameter is to the line of its channel.
    fn role(&self) -> Role {
        Role::Other
    }

    /// What of it holds beyond the session in which it was found.
    fn outlasts(&self) -> Outlasts {
        match (self.info().class, self.info().needs, self.placed()) {
            (Class::Data, ..) | (_, Needs::Order, Placed::Once) => Outlasts::Nothing,
            (.., Placed::AtPose) => Outlasts::Value,
            _ => Outlasts::Whole,
        }
    }
}

/// What the place of an instance is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placed {
    /// Nothing: there is one at each target.
    Once,
    /// A pose, that is searched for.
    AtPose,
    /// Another channel.
    AtChannel,
}

/// What a law runs over that gives a correction for each of its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Over {
    /// The reading of its channel; the correction is an angle.
    Reading,
    /// Time, from 0 to 1 over the session; the correction is an angle, of the converter's
    /// reference a fraction of all readings.
    Time,
}

impl dyn Term + '_ {
    /// True for a geometry term that moves nothing but what lies at these spots.
    #[must_use]
    pub fn moves_only(&self, spots: &[Spot]) -> bool {
        matches!(self.acts(), Acts::Geometry(freedoms)
            if freedoms.iter().all(|(spot, ..)| spots.contains(spot)))
    }

    /// What it is a curve over; none for a law of anything else.
    #[must_use]
    pub fn over(&self) -> Option<Over> {
        match (self.acts(), self.info().needs) {
            _ if self.placed() == Placed::AtPose => None,
            (Acts::Sensor(_), Needs::Nothing) => Some(Over::Reading),
            (Acts::Sensor(_) | Acts::Electronics(_), Needs::Order) => Some(Over::Time),
            _ => None,
        }
    }
}

impl std::fmt::Debug for dyn Term {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.info().id)
    }
}

impl PartialEq for dyn Term {
    fn eq(&self, other: &Self) -> bool {
        self.info().id == other.info().id
    }
}

/// Declares a term: its identity from its doc comment and parameters.
macro_rules! term {
    (
        $(#[doc = $doc:expr])*
        $name:ident($id:literal, $class:ident, per $per:ident, needs $needs:ident $(, $flag:ident)?) {
            $($parameter:ident: $unit:literal ~ $typical:expr),* $(,)?
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy)]
        pub struct $name;

        impl $name {
            /// Identity of the term.
            pub const INFO: $crate::terms::term::Info = $crate::terms::term::Info {
                id: $id,
                class: $crate::terms::term::Class::$class,
                per: $crate::terms::term::Per::$per,
                needs: $crate::terms::term::Needs::$needs,
                parameters: &[$($crate::terms::term::Parameter {
                    name: stringify!($parameter),
                    unit: $unit,
                    typical: $typical,
                }),*],
                doc: concat!($($doc, "\n"),*),
                penalised: false $(|| term!(@penalised $flag))?,
                broad: false $(|| term!(@broad $flag))?,
            };
        }
    };
    (@penalised penalised) => { true };
    (@penalised $other:ident) => { false };
    (@broad broad) => { true };
    (@broad $other:ident) => { false };
}

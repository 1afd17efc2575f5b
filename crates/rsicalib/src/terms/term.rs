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

use std::f64::consts::TAU;

use crate::kinematics::elements::{Axis, Way, Weight};
pub use crate::mechanism::{Class, Per};
use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::readings::course::{CourseAt, Followed, Late};
use crate::terms::coupled::Coupled;

/// Data that a term needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Needs {
    /// Nothing but readings.
    Nothing,
    /// The time of each row, `time_s`.
    Order,
    /// A temperature that changes.
    Temperature,
    /// Held poses: the direction of approach of each.
    Approach,
    /// Held poses or a recording: the way of each channel from one to the next.
    Way,
    /// A recording in motion: velocities.
    Motion,
    /// The direction of gravity.
    Gravity,
    /// Link masses and the direction of gravity.
    Masses,
}

impl Needs {
    /// True for what a pose by itself tells, whenever and however it was reached.
    #[must_use]
    pub fn of_pose(self) -> bool {
        matches!(self, Self::Nothing | Self::Gravity | Self::Masses)
    }

    /// True for what the way to a row tells, and the row by itself does not.
    #[must_use]
    pub fn of_way(self) -> bool {
        matches!(self, Self::Approach | Self::Way | Self::Motion)
    }

    /// The missing data, for messages.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Nothing => "readings",
            Self::Order => "time_s",
            Self::Temperature => "temperature_c that changes",
            Self::Approach => "held poses or time_s, to approach from",
            Self::Way => "held poses or time_s, in the order in which they were visited",
            Self::Motion => "recording in motion with time_s",
            Self::Gravity => "direction of gravity in the mechanism",
            Self::Masses => "link masses in the mechanism",
        }
    }
}

/// One parameter of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Parameter {
    /// Name of the parameter.
    pub name: &'static str,
    /// Unit; `length` stands for the mechanism's unit, `reading` for the channel's.
    pub unit: &'static str,
    /// A size that occurs in practice, the scale of priors and of tests; see
    /// [`typical`](crate::terms::targets::typical).
    pub typical: f64,
}

/// Identity of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Info {
    /// Name of the term, for scripts.
    pub id: &'static str,
    /// Kind of the fault.
    pub class: Class,
    /// Kind of target.
    pub per: Per,
    /// Data that the term needs.
    pub needs: Needs,
    /// Parameters of the term.
    pub parameters: &'static [Parameter],
    /// Description of the term, from the doc comment in its source.
    pub doc: &'static str,
    /// True for a free shape: a prior with the typical size as its standard deviation holds each
    /// parameter.
    pub penalised: bool,
    /// True for a term that contains many others. Such a term is identified on request, and is no
    /// candidate of a trace, unless it moves nothing but the tool.
    pub broad: bool,
    /// True for a law that users write. The typical sizes of its parameters are those of one
    /// mechanism, in its units.
    pub law: bool,
}

/// Constants of one channel, for the scaling of terms.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Scale {
    /// Reading at which the offset is defined, so that offset and gain are nearly independent.
    pub centre: f64,
    /// Middle of the channel's range.
    pub middle: f64,
    /// Half the range, in readings.
    pub half_range: f64,
    /// Nominal gain (rad or length per reading).
    pub gain: f64,
    /// Nominal joint coordinate at `centre` (rad or length).
    pub angle: f64,
    /// Nominal angle (rad) for one unit of reading; what has no turn goes round once over `span`.
    pub turn: f64,
    /// Lowest and highest reading in the data.
    pub span: [f64; 2],
    /// True where shapes stay beyond `span` as they are at its ends; else they go on.
    pub held: bool,
}

impl Scale {
    /// Scales of a channel of a mechanism whose readings spread over `span` about `centre`.
    #[must_use]
    pub fn of(mechanism: &Mechanism, channel: usize, centre: f64, span: [f64; 2]) -> Self {
        let (turns, round) = (mechanism.turns(channel), mechanism.goes_round(channel));
        let channel = &mechanism.channels[channel];
        let mut scale = Self {
            centre,
            middle: channel.middle(),
            half_range: channel.half_range(),
            gain: channel.gain,
            angle: channel.angle(centre),
            turn: channel.gain,
            span,
            held: true,
        };
        if channel.ends().is_none() && !turns {
            scale.unbounded();
        }
        if !round && span[1] > span[0] {
            scale.turn = TAU / (span[1] - span[0]);
        }
        scale
    }

    /// A length has no turn: without ends its range is what the readings span.
    fn unbounded(&mut self) {
        let [low, high] = self.span;
        self.middle = 0.5 * (low + high);
        self.half_range =
            (0.5 * (high - low)).max(f64::EPSILON * self.middle.abs()).max(f64::MIN_POSITIVE);
    }

    /// The same with centre and span of other readings, in which its parameters are told.
    #[must_use]
    pub fn referred_to(
        self,
        mechanism: &Mechanism,
        channel: usize,
        centre: f64,
        span: [f64; 2],
    ) -> Self {
        let own = Self::of(mechanism, channel, centre, span);
        let Self { middle, half_range, turn, .. } = own;
        Self { middle, half_range, turn, centre, span, ..self }
    }

    /// Joint coordinates of readings, as drawn.
    #[inline(always)]
    pub(crate) fn nominal(&self, reading: Lanes) -> Lanes {
        (reading - Lanes::splat(self.centre)) * self.gain + Lanes::splat(self.angle)
    }
}

/// State and context of eight samples, the input of a term.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
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
    /// Direction from which each channel came to its reading: -1, 0 or 1.
    pub approach: &'a [Lanes],
    /// Change of each reading, per second.
    pub velocity: &'a [Lanes],
    /// Where the samples are in their recording; none for poses, and where no term asks.
    pub(crate) course: Option<CourseAt<'a>>,
    /// By what the channel is late \[s\], for a term that acts on its joint.
    pub(crate) late: f64,
    /// What the samples of the channel followed, for a term that says how they do.
    pub(crate) followed: Followed,
    /// Number of each sample's pose.
    pub pose: Lanes,
    /// Place of the instance: the pose, or the other channel, where a searched term acts.
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

    /// `φ`: the nominal angle of the reading from the middle of the range (rad, or length).
    #[inline(always)]
    #[must_use]
    pub fn phi(&self) -> Lanes {
        let scale = self.scale();
        (self.reading() - Lanes::splat(scale.middle)) * scale.gain
    }

    /// `ψ`: the same as an angle (rad) also of what has no turn, which goes round once over what its readings span.
    #[inline(always)]
    #[must_use]
    pub fn psi(&self) -> Lanes {
        let scale = self.scale();
        (self.reading() - Lanes::splat(scale.middle)) * scale.turn
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
    /// Correction that the term adds to the reading of `site.channel`, in the unit of a reading.
    /// `p` holds the parameters of the term.
    fn correction(&self, p: &[f64], site: &Site) -> Lanes;
    /// Derivatives of the correction by `p`.
    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
    /// What a term says of how its channel follows: this adds up, and the correction of each is beside those
    /// before it. None for all other terms.
    #[doc(hidden)]
    fn late(&self, _p: &[f64]) -> Option<Late> {
        None
    }
    /// Derivatives of the correction by every reading, added to `out`.
    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
}

/// A term that acts on one joint: reading to angle.
pub trait Sensor: Sync {
    /// Correction that the term adds to the joint coordinate (rad, or length units). `p` holds the
    /// parameters of the term.
    fn correction(&self, p: &[f64], site: &Site) -> Lanes;
    /// Derivatives of the correction by `p`.
    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]);
    /// Derivative of the correction by the reading; zero for one that the reading does not change.
    fn slope(&self, _p: &[f64], _site: &Site) -> Lanes {
        Lanes::ZERO
    }
}

/// A term that acts on a plane or a line that points touch: its shape.
///
/// `u` and `v` are the place of the point along the plane's own axes, from the middle of all places of
/// the session to half their extent: ±1 at the edges. Of a line `u` is along it. `row` is the equation:
/// a plane has one, a line one for each of the two directions across it.
pub trait Surface: Sync {
    /// What it adds to the offset of an equation, in length units.
    fn correction(&self, p: &[f64], place: [Lanes; 2], row: usize) -> Lanes;
    /// Derivatives of the correction by `p`.
    fn partials(&self, place: [Lanes; 2], row: usize, out: &mut [Lanes]);
    /// Derivatives of the correction by `u` and `v`.
    fn slopes(&self, p: &[f64], place: [Lanes; 2], row: usize) -> [Lanes; 2];
}

/// Spot on a chain at which a geometry term moves the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spot {
    /// Before the first joint of a chain, along the axes of the base.
    Base,
    /// Before the first joint of a chain, about the axes of its frame.
    Root,
    /// After the joint of a row, before its body.
    Joint,
    /// There, too, along x and across, z, of the link as it is drawn: [`Row::link`].
    ///
    /// [`Row::link`]: crate::mechanism::Row::link
    Link,
    /// There, too, x along the common normal of two joint axes: [`Chain::side`].
    ///
    /// [`Chain::side`]: crate::mechanism::Chain::side
    Side,
    /// There, too, x leading to the next joint: [`Row::along`].
    ///
    /// [`Row::along`]: crate::mechanism::Row::along
    Along,
    /// After the translation of a row's body: about the next joint's origin.
    End,
    /// In the frame at the end of a chain.
    Tip,
}

/// A motion that a geometry term adds, one per parameter.
pub type Freedom = (Spot, Axis, Way);

/// What a term does to an instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OfInstrument {
    /// Moves it along and about its own axes: six parameters.
    Motion,
    /// Multiplies all that it reads by one and a parameter.
    Scale,
}

impl OfInstrument {
    /// Parameters of such a term.
    #[must_use]
    pub fn width(self) -> usize {
        match self {
            Self::Motion => 6,
            Self::Scale => 1,
        }
    }
}

/// Stage at which a term acts, and the action there.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub enum Acts {
    /// Corrects readings.
    Electronics(&'static dyn Electronics),
    /// Corrects one joint coordinate.
    Sensor(&'static dyn Sensor),
    /// Moves the bodies of a chain: from a pose on for a term that is placed at one, in proportion to
    /// the temperature for a term that needs one.
    Geometry(&'static [Freedom]),
    /// Moves joints in proportion to their torque.
    Load(Weight),
    /// Corrects the value of a distance, when a motion of geometry would act.
    Distance,
    /// Moves the end of a closure that stands, along the axes of the base.
    End,
    /// Moves an instrument along and about its own axes, or changes its scale.
    Instrument(OfInstrument),
    /// Moves the point of a body at which a distance ends, along the axes of the body.
    Attachment,
    /// Corrects the offsets of a plane or a line by where it is touched.
    Surface(&'static dyn Surface),
    /// Corrects joint coordinates, moves a frame, or corrects the value of a distance, by a formula
    /// of what all stages before it left.
    Coupled(&'static Coupled),
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

/// What every term declares: `term!` implements it.
pub trait Declared {
    /// Identity, parameters, units and description.
    fn info(&self) -> &'static Info;

    /// Stage at which the term acts.
    fn acts(&self) -> Acts;
}

/// One physical term of the model.
pub trait Term: Declared + Sync {
    /// Kind of place of an instance.
    fn placed(&self) -> Placed {
        Placed::Once
    }

    /// Whether it can act on a channel at all, whatever the readings: by what is read there, and
    /// by how the joint moves.
    fn suits(&self, _mechanism: &Mechanism, _channel: usize) -> bool {
        true
    }

    /// Whether it can act on a target of its kind.
    fn suits_target(&self, _mechanism: &Mechanism, _target: Target) -> bool {
        true
    }

    /// Targets that share it beside those that are drawn alike.
    fn shared_by(&self, _mechanism: &Mechanism) -> Vec<Target> {
        Vec::new()
    }

    /// All data that it needs.
    fn needs(&self) -> Vec<Needs> {
        vec![self.info().needs]
    }

    /// True for what a pose by itself tells, whenever and however it was reached.
    fn of_pose(&self) -> bool {
        self.needs().into_iter().all(Needs::of_pose)
    }

    /// The places of the term at a channel, which a search tries one by one: what happens at a pose,
    /// at every one but the first.
    fn places(&self, _mechanism: &Mechanism, _channel: usize, poses: usize) -> Vec<usize> {
        match self.placed() {
            Placed::AtPose => (1..poses).collect(),
            _ => vec![0],
        }
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

/// Kind of place of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Placed {
    /// No place: one instance at each target.
    Once,
    /// A pose, found by a search.
    AtPose,
    /// Another channel.
    AtChannel,
    /// Waves per turn, in steps of [`ORDER_STEP`], found by a search.
    AtOrder,
}

impl Placed {
    /// What a place of the term is, for messages; none for a term without places.
    #[must_use]
    pub fn words(self) -> Option<&'static str> {
        match self {
            Self::Once => None,
            Self::AtPose => Some("label of a pose"),
            Self::AtChannel => Some("name of a channel"),
            Self::AtOrder => Some("waves per turn"),
        }
    }
}

/// Step between the orders that are tried, in waves per turn. Over a turn it moves the phase by a
/// quarter of a wave, which the term's own parameter takes up.
pub const ORDER_STEP: f64 = 0.25;

/// Places of the orders that are tried: from 3 to 100 waves per turn. Fewer have terms of their
/// own.
pub const ORDERS: std::ops::RangeInclusive<usize> = 12..=400;

/// The variable of a law that is a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Over {
    /// The reading of the channel; the correction is an angle.
    Reading,
    /// Time, from 0 to 1 over the session. The correction of a sensor is an angle; the correction
    /// of the converter's reference is a fraction of all readings.
    Time,
}

impl dyn Term + '_ {
    /// True for one that depends on the way to a row.
    #[must_use]
    pub fn is_of_way(&self) -> bool {
        self.needs().into_iter().any(Needs::of_way)
    }

    /// True for a delay or a slow servo, of which no size is out of all proportion: a message takes as long as
    /// it takes.
    #[must_use]
    pub fn is_late(&self) -> bool {
        matches!(self.acts(), Acts::Electronics(term) if term.late(&[0.0]).is_some())
    }

    /// True for one that is late by degrees, and so cuts corners; a delay is late in corners, too.
    #[must_use]
    pub fn cuts_corners(&self) -> bool {
        let square = |late: Late| late.square.is_some();
        matches!(self.acts(), Acts::Electronics(term) if term.late(&[0.0]).is_some_and(square))
    }

    /// True for a delay: late, and late in corners, too.
    #[must_use]
    pub fn is_delay(&self) -> bool {
        self.is_late() && !self.cuts_corners()
    }

    /// True for what a weight does.
    #[must_use]
    pub fn is_load(&self) -> bool {
        self.info().class == Class::Load
    }

    /// True for a geometry term that moves the chain at these spots only.
    #[must_use]
    pub fn moves_only(&self, spots: &[Spot]) -> bool {
        matches!(self.acts(), Acts::Geometry(freedoms)
            if freedoms.iter().all(|(spot, ..)| spots.contains(spot)))
    }

    /// True for a term that moves nothing but the tool.
    #[must_use]
    pub fn moves_tool(&self) -> bool {
        self.moves_only(&[Spot::Tip])
    }

    /// True for a term that is too broad for a candidate. A tool sits where it does, whatever else
    /// that may stand for.
    #[must_use]
    pub fn on_request_only(&self) -> bool {
        self.info().broad && !self.moves_tool()
    }

    /// The variable of the term's curve; `None` for a term that is no curve, as a law of several variables.
    #[must_use]
    pub fn over(&self) -> Option<Over> {
        match (self.acts(), self.info().needs) {
            _ if self.placed() != Placed::Once || self.needs().len() > 1 => None,
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

/// Declares a term, with its identity from the doc comment and the parameters.
macro_rules! term {
    (
        $(#[doc = $doc:expr])*
        $name:ident($id:literal, $class:ident, per $per:ident, needs $needs:ident $(, $flag:ident)?) {
            $($parameter:ident: $unit:literal ~ $typical:expr),* $(,)?
        } acts $acts:expr
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
                law: false,
            };
        }

        impl $crate::terms::term::Declared for $name {
            fn info(&self) -> &'static $crate::terms::term::Info {
                &Self::INFO
            }

            fn acts(&self) -> $crate::terms::term::Acts {
                $acts
            }
        }
    };
    (@penalised penalised) => { true };
    (@penalised $other:ident) => { false };
    (@broad broad) => { true };
    (@broad $other:ident) => { false };
}

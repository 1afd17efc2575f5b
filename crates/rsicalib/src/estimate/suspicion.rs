//! What looks wrong with the wiring.

use crate::model::known::Declared;

/// What looks wrong with the wiring, where no start led to a good fit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Suspicion {
    /// Channels read the wrong way round.
    Reversed {
        /// The channels.
        channels: Vec<usize>,
        /// How well the loop closes with it.
        closes: Closes,
    },
    /// One of some channels reads the wrong way round. With one of them reversed, the machine is the image in a
    /// mirror of what it is with another, and the loops of both close alike.
    EitherReversed {
        /// The channels.
        channels: Vec<usize>,
        /// How well the loop closes with one of them reversed.
        closes: Closes,
    },
    /// Beside a mistake: with the zeros of encoders far from where they are declared the loop closes as well.
    Zeros {
        /// The channels.
        channels: Vec<usize>,
        /// How well the loop closes so.
        closes: Closes,
    },
    /// The readings of two channels are exchanged.
    Exchanged {
        /// The channels, two for each exchange with which the loop closes as well.
        channels: Vec<[usize; 2]>,
        /// How well the loop closes with it.
        closes: Closes,
        /// True where it closes so beside a delay of all followers.
        late: bool,
    },
    /// Anchors that are found are shaped as drawn with two of them exchanged, and by far not as they are named.
    Unlike {
        /// The channels that read the distances to these two, the likeliest first: of a rectangle, the other two
        /// exchanged are its image in a mirror.
        channels: Vec<[usize; 2]>,
        /// Root mean square by which distances between anchors differ from the drawing, length units.
        off: f64,
        /// The same with the two exchanged.
        with: f64,
    },
    /// Distances between unknown points of which no readings touch both.
    Unused {
        /// The closures.
        closures: Vec<usize>,
    },
    /// The mechanism declares as known what readings have elsewhere.
    Knowledge {
        /// What it declares.
        of: Declared,
        /// By how much the estimate is above that.
        off: f64,
        /// The standard deviation with which it is declared.
        sd: f64,
    },
    /// The gap of a potentiometer's track lies within the range of motion.
    Gap {
        /// The channel.
        channel: usize,
        /// What shows the gap.
        shown: Shown,
        /// Rows that may lie beyond the gap.
        rows: usize,
        /// Rows looked at.
        of: usize,
        /// How well the loop closes without those rows.
        closes: Closes,
    },
    /// A channel reads one value in many rows, to the last digit, while others move.
    Stuck {
        /// The channel.
        channel: usize,
        /// What it reads.
        reads: f64,
        /// The first of these rows.
        first: usize,
        /// How many they are.
        rows: usize,
        /// Rows in all.
        of: usize,
        /// Labels of the first and the last of their poses, where poses were held.
        poses: Option<[i64; 2]>,
        /// How well the loop closes without them.
        closes: Closes,
    },
    /// Poses repeat the readings of others, digit by digit.
    SameReadings {
        /// How many poses.
        poses: usize,
        /// Poses in all.
        of: usize,
    },
    /// Distances that follow from the other closures in every pose, and are not used.
    Follow {
        /// The closures.
        closures: Vec<usize>,
    },
    /// Something is off by the degrees in a radian.
    Degrees {
        /// The channels.
        channels: Vec<usize>,
        /// What is off.
        of: InDegrees,
    },
    /// Gains of all channels are fitted at one number times what is declared.
    Gains {
        /// The channels.
        channels: Vec<usize>,
        /// The number.
        times: f64,
    },
    /// Lengths that channels read in another unit than the drawing.
    MeasuredInUnit {
        /// The channels.
        channels: Vec<usize>,
        /// By what their readings are lengths of the drawing.
        times: f64,
    },
    /// A length of the drawing in another unit than the others.
    Length {
        /// Which.
        at: Measure,
        /// As it is declared.
        size: f64,
        /// The number of times that length with which the loop closes.
        times: f64,
        /// How well it closes.
        closes: Closes,
    },
    /// Points that an instrument sees fit with the other hand: two of their columns are exchanged, or one has the other
    /// sign.
    LeftHanded {
        /// The point, counted in the mechanism.
        point: usize,
        /// How well the loop closes with the image of the points in a mirror.
        closes: Closes,
    },
    /// Points that an instrument sees fit in another unit.
    SeenInUnit {
        /// The point, counted in the mechanism.
        point: usize,
        /// The number of times its coordinates with which the loop closes.
        times: f64,
        /// How well it closes.
        closes: Closes,
    },
    /// Columns beside the channels belong to the pose before, or to the next.
    Shifted {
        /// Their names.
        columns: Vec<String>,
        /// True where the loop closes with those of the next pose.
        later: bool,
        /// How well it closes.
        closes: Closes,
    },
    /// A channel reads in steps that are a good part of its noise.
    Coarse {
        /// The channel.
        channel: usize,
        /// The step, in its unit.
        step: f64,
        /// Share of the variance of its noise that is of rounding.
        share: f64,
    },
    /// Declared noise is not what the readings show.
    Noise {
        /// What shows it.
        by: Witness,
        /// By what the declared noise would have to be multiplied.
        factor: f64,
        /// True where play was declared, too, and is multiplied with it.
        play: bool,
    },
    /// Declared play is larger than what is left allows.
    Play {
        /// The closures, counted in the mechanism.
        closures: Vec<usize>,
        /// By what it would have to be multiplied.
        factor: f64,
    },
    /// The declared noise of a length or a point that is read with every sample is not what these show.
    LengthNoise {
        /// The closure, counted in the mechanism.
        closure: usize,
        /// What shows it.
        by: Witness,
        /// What is declared, length units.
        declared: f64,
        /// By what the declared noise would have to be multiplied.
        factor: f64,
    },
    /// An unknown point has an image in a mirror that fits as well.
    Mirrored {
        /// The point, counted in the mechanism.
        point: usize,
        /// What it is called, with its keys.
        name: String,
        /// Where it is by the fit.
        at: [f64; 3],
        /// Where its image is.
        image: [f64; 3],
    },
    /// No start led to a fit in which every joint moves.
    NoStart {
        /// Starts that were tried.
        tried: usize,
    },
    /// Nothing else tells where an unknown frame is, and from where it is drawn no fit closes the loops.
    Lost {
        /// The frame, with its keys.
        name: String,
        /// Root mean square of the misclosures where the fit ended.
        open: f64,
    },
}

impl Suspicion {
    /// True where wires are exchanged: of two channels, or the outer ones of one.
    #[must_use]
    pub fn of_wires(&self) -> bool {
        matches!(self, Self::Exchanged { .. } | Self::Reversed { .. } | Self::EitherReversed { .. })
    }

    /// How well the loop closes with wires, or columns of an instrument, exchanged, reversed or in another unit, where
    /// that is suspected.
    #[must_use]
    pub fn rewired(&self) -> Option<Closes> {
        match self {
            Self::Reversed { closes, .. }
            | Self::EitherReversed { closes, .. }
            | Self::Exchanged { closes, .. }
            | Self::LeftHanded { closes, .. }
            | Self::Shifted { closes, .. }
            | Self::SeenInUnit { closes, .. } => Some(*closes),
            _ => None,
        }
    }

    /// True where no start led to a fit in which every joint moves, and every frame is found.
    #[must_use]
    pub fn is_no_start(&self) -> bool {
        matches!(self, Self::NoStart { .. } | Self::Lost { .. })
    }

    /// True where what is left says that noise or play is not what is declared.
    #[must_use]
    pub fn of_noise_by_the_fit(&self) -> bool {
        matches!(self, Self::Noise { by: Witness::Fit, .. } | Self::Play { .. })
    }

    /// True where noise or play is declared larger than what is left allows.
    #[must_use]
    pub fn of_noise_that_is_too_large(&self) -> bool {
        match self {
            Self::Noise { by: Witness::Fit, factor, .. } | Self::Play { factor, .. } => {
                *factor < 1.0
            }
            _ => false,
        }
    }

    /// True where what is declared as known is not what the readings have.
    #[must_use]
    pub fn is_of_knowledge(&self) -> bool {
        matches!(self, Self::Knowledge { .. })
    }

    /// True where a frame is not found.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost { .. })
    }

    /// True where it is about the wiring, and so found at the start.
    #[must_use]
    pub fn of_wiring(&self) -> bool {
        matches!(
            self,
            Self::Reversed { .. }
                | Self::EitherReversed { .. }
                | Self::Exchanged { .. }
                | Self::Zeros { .. }
                | Self::Gap { .. }
                | Self::Stuck { .. }
                | Self::LeftHanded { .. }
                | Self::Shifted { .. }
                | Self::SeenInUnit { .. }
                | Self::MeasuredInUnit { .. }
                | Self::NoStart { .. }
                | Self::Lost { .. }
                | Self::Degrees { of: InDegrees::Loop { .. }, .. }
        )
    }
}

/// A length of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Length of a row along x.
    A {
        /// The chain.
        chain: usize,
        /// Its row.
        row: usize,
    },
    /// Offset of a row along z.
    D {
        /// The chain.
        chain: usize,
        /// Its row.
        row: usize,
    },
    /// A coordinate of the origin of a row that a URDF draws.
    Along {
        /// The chain.
        chain: usize,
        /// Its row.
        row: usize,
        /// The coordinate.
        axis: usize,
    },
    /// A coordinate of a point.
    At {
        /// The point.
        point: usize,
        /// The coordinate.
        axis: usize,
    },
    /// The distance of a closure.
    Distance {
        /// The closure.
        closure: usize,
    },
}

/// What is in degrees where radians are declared, or the other way round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InDegrees {
    /// Readings, which would be within the limits of their joints in degrees.
    Readings,
    /// Readings or declared offsets, with which the loop closes in the other unit.
    Loop {
        /// Which of them.
        what: Scaled,
        /// By what they were multiplied.
        times: f64,
        /// How well the loop closes with it.
        closes: Closes,
    },
    /// Limits of a channel in degrees, that are in radians.
    LimitsInRadians,
    /// Limits in degrees of a channel that is not.
    LimitsInDegrees,
    /// The gain, which is fitted at so many times what is declared.
    Gain,
    /// The offset, which is fitted at so many times what is declared.
    Offset,
}

impl InDegrees {
    /// True where a wrong gain would look the same.
    #[must_use]
    pub fn is_of_readings(self) -> bool {
        matches!(self, Self::Readings | Self::Loop { what: Scaled::Readings, .. })
    }
}

/// What a loop closes with, where it is in the other unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaled {
    /// The readings, or what stands for it, the gains.
    Readings,
    /// The offsets that the mechanism declares.
    Offsets,
}

/// What shows that declared noise is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Witness {
    /// The scatter of repeats, whose noise is used.
    Repeats,
    /// The scatter of neighbouring rows, whose noise is used.
    Neighbours,
    /// The residual of the fit; the declared noise is used.
    Fit,
}

/// χ² per equation with a suspected mistake taken into account, and as declared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closes {
    /// With the mistake.
    pub with: f64,
    /// As declared; infinite where no start led anywhere.
    pub declared: f64,
}

/// What shows the gap of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shown {
    /// Readings at an end of the range.
    AtEnd,
    /// Nothing between two readings.
    Jump {
        /// The lower reading.
        below: f64,
        /// The upper reading.
        above: f64,
    },
}

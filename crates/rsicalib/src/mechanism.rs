//! A mechanism as data: channels, chains, points, closures, platform, rest.
//!
//! The same value in Rust, in Python and in TOML. The RSI hand controller is
//! one of them, [`Mechanism::rsi`]; nothing else in this crate knows it.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::Error;

/// Sensed chains, and what closes them on each other.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Mechanism {
    /// What people call it.
    pub name: String,
    /// Unit of every length: `in`, `mm`, `m`.
    pub length_unit: String,
    /// Direction in which weights pull, in base coordinates.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub gravity: Option<[f64; 3]>,
    /// Sensors, in the order of the columns of readings.
    #[cfg_attr(feature = "serde", serde(rename = "channel"))]
    pub channels: Vec<Channel>,
    /// Serial chains of joints.
    #[cfg_attr(feature = "serde", serde(rename = "chain"))]
    pub chains: Vec<Chain>,
    /// Points on the chains, fixed points and unknown ones.
    #[cfg_attr(feature = "serde", serde(rename = "point"))]
    pub points: Vec<Point>,
    /// Equations that hold in every pose.
    #[cfg_attr(feature = "serde", serde(rename = "closure"))]
    pub closures: Vec<Closure>,
    /// The points that carry the platform, in the platform's frame.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "BTreeMap::is_empty"))]
    pub platform: BTreeMap<String, [f64; 3]>,
    /// A pose that is known without measuring.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub rest: Option<Rest>,
    /// What is identified unless told otherwise.
    #[cfg_attr(feature = "serde", serde(default))]
    pub model: ModelSection,
}

/// A sensor: `angle = gain * reading + offset`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Channel {
    /// Column of the readings.
    pub name: String,
    /// Unit of a reading: `count`, `rad`, `m`, ...
    pub unit: String,
    /// Lowest and highest reading, if bounded.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub range: Option<[f64; 2]>,
    /// Joint coordinate per reading: rad, or length for a prismatic joint.
    pub gain: f64,
    /// Joint coordinate at reading zero.
    pub offset: f64,
    /// Joint limits, in the joint's coordinate.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub limits: Option<[f64; 2]>,
    /// Standard deviation of one reading, in its unit, where it is known.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub noise: Option<f64>,
}

impl Channel {
    /// Variance that rounding to whole counts adds to a reading: 1/12 count².
    #[must_use]
    pub fn quantisation(&self) -> f64 {
        if self.unit == "count" { 1.0 / 12.0 } else { 0.0 }
    }

    /// Middle of the range; zero for an unbounded channel.
    #[must_use]
    pub fn middle(&self) -> f64 {
        self.range.map_or(0.0, |[low, high]| 0.5 * (low + high))
    }

    /// Half the range in readings; half a turn for an unbounded channel.
    #[must_use]
    pub fn half_range(&self) -> f64 {
        self.range.map_or(PI / self.gain.abs(), |[low, high]| 0.5 * (high - low))
    }

    /// The nominal joint coordinate at a reading, eq. (9).
    #[must_use]
    pub fn angle(&self, reading: f64) -> f64 {
        self.gain * reading + self.offset
    }
}

/// How a joint moves about or along its z axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Motion {
    /// Turns; its coordinate is an angle in radians.
    #[default]
    Revolute,
    /// Slides; its coordinate is a length.
    Prismatic,
}

/// One row of a chain: a joint, then the body that carries the next.
///
/// ```text
/// Rz(theta) · joint(q) · Tz(d) Tx(a) Rx(alpha) · T(xyz) R(rpy)
/// ```
///
/// Denavit-Hartenberg rows use the first part, URDF links the second.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Row {
    /// Name of the link, for reports.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub name: Option<String>,
    /// The channel that senses this joint; none for a fixed row.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub channel: Option<String>,
    /// How the joint moves.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub joint: Motion,
    /// Fixed angle about z, before the joint [rad].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub theta: f64,
    /// Offset along z.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub d: f64,
    /// Length along x.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub a: f64,
    /// Twist about x [rad].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub alpha: f64,
    /// A further translation, as URDF gives it.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub xyz: [f64; 3],
    /// A further rotation, roll-pitch-yaw [rad].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub rpy: [f64; 3],
    /// Mass of the body after the joint; any unit, the same for all rows.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub mass: Option<f64>,
    /// Its centre of mass, in the frame after the joint.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default"))]
    pub com: [f64; 3],
}

#[cfg(feature = "serde")]
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Row {
    /// The body after the joint, `joint_from_next`.
    #[must_use]
    pub fn body(&self) -> Isometry3<f64> {
        let dh = Isometry3::from_parts(
            Translation3::new(self.a, 0.0, self.d),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha),
        );
        let [roll, pitch, yaw] = self.rpy;
        dh * Isometry3::from_parts(
            Translation3::from(Vector3::from(self.xyz)),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }
}

/// A serial chain of rows, base first.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Chain {
    /// What reports call it.
    pub name: String,
    /// Its rows, base first.
    #[cfg_attr(feature = "serde", serde(rename = "dh"))]
    pub rows: Vec<Row>,
}

/// A point on a chain, fixed in the base, or unknown but constant.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct Point {
    /// What closures and the platform call it.
    pub name: String,
    /// The chain that carries it; none for a point fixed in the base.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub chain: Option<String>,
    /// Where it is, in the frame at the end of its chain, or in the base.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub at: Option<[f64; 3]>,
    /// Columns of the readings: one unknown point for each distinct value.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub unknown: Vec<String>,
}

/// The kind of equation that a closure is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum ClosureKind {
    /// `|a - b|² - value² = 0`, eq. (10): one equation.
    Distance,
    /// `a - b = 0`: three equations.
    Touch,
}

impl ClosureKind {
    /// Scalar equations of one closure.
    #[must_use]
    pub fn equations(self) -> usize {
        match self {
            Self::Distance => 1,
            Self::Touch => 3,
        }
    }
}

/// A known distance: a number, or a column of the readings.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(untagged))]
pub enum Value {
    /// The same in every pose.
    Known(f64),
    /// Measured: the name of a column.
    Column(String),
}

/// An equation between two points that holds in every pose.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Closure {
    /// What reports call it.
    pub name: String,
    /// Distance or touch.
    pub kind: ClosureKind,
    /// The two points.
    pub between: [String; 2],
    /// The distance, for a distance.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub value: Option<Value>,
    /// Play: standard deviation of the closure itself, per equation, in length units.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub noise: Option<f64>,
    /// How well the value is known, in length units.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sd: Option<f64>,
}

/// A platform pose that is known without measuring.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Rest {
    /// `x y z` in length units, `rx ry rz` in radians, eq. (1).
    pub pose: [f64; 6],
    /// How well each is known; none: it is where the search starts, no more.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sd: Option<f64>,
}

/// What `calibrate` identifies unless told otherwise.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default))]
pub struct ModelSection {
    /// Ids of terms.
    pub terms: Vec<String>,
    /// Prior standard deviation of each parameter of a term, in its unit.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "BTreeMap::is_empty"))]
    pub sd: BTreeMap<String, f64>,
}

impl Default for ModelSection {
    fn default() -> Self {
        Self { terms: vec!["offset".into(), "gain".into()], sd: BTreeMap::new() }
    }
}

impl Mechanism {
    /// The RSI 6-DOF hand controller (Hollerbach & Lokhorst, Table I).
    ///
    /// Lengths in inches. Nominal gain and offsets from the electrical angle
    /// of 340° over 4096 counts and the rest pose at count 2048, eq. (14).
    #[must_use]
    pub fn rsi() -> Self {
        let gain = -340.0_f64.to_radians() / 4096.0;
        let theta_0 = [PI, PI / 3.0, -PI / 3.0];
        let rest = [0.0, 0.0, -2.666, 0.0, 0.0, 0.0];
        let limits = [[-FRAC_PI_2, FRAC_PI_2], [-PI, 0.0], [-FRAC_PI_2, FRAC_PI_2]];
        let mut mechanism = Self {
            name: "rsi".into(),
            length_unit: "in".into(),
            gravity: Some([0.0, 0.0, -1.0]),
            channels: Vec::new(),
            chains: Vec::new(),
            points: Vec::new(),
            closures: Vec::new(),
            platform: BTreeMap::new(),
            rest: Some(Rest { pose: rest, sd: None }),
            model: ModelSection::default(),
        };
        let wrist = |i: usize| format!("wrist{}", i + 1);
        for (i, theta) in theta_0.into_iter().enumerate() {
            let joint = |j: usize| Some(format!("a{}{}", i + 1, j + 1));
            for (j, limits) in limits.into_iter().enumerate() {
                mechanism.channels.push(Channel {
                    name: format!("a{}{}", i + 1, j + 1),
                    unit: "count".into(),
                    range: Some([0.0, 4095.0]),
                    gain,
                    offset: 0.0,
                    limits: Some(limits),
                    noise: None,
                });
            }
            mechanism.chains.push(Chain {
                name: format!("arm{}", i + 1),
                rows: vec![
                    Row { theta, a: -4.5, alpha: FRAC_PI_2, ..Row::default() },
                    Row { channel: joint(0), a: 3.2, ..Row::default() },
                    Row { channel: joint(1), alpha: FRAC_PI_2, ..Row::default() },
                    Row { channel: joint(2), ..Row::default() },
                ],
            });
            mechanism.points.push(Point {
                name: wrist(i),
                chain: Some(format!("arm{}", i + 1)),
                at: Some([3.971, 0.0, 0.0]),
                unknown: Vec::new(),
            });
            // Wrists clockwise from above, wrist 1 at +x of the handle.
            let bearing = -2.0 * PI / 3.0 * i as f64;
            let on_handle = [1.5 * bearing.cos(), 1.5 * bearing.sin(), 0.0];
            mechanism.platform.insert(wrist(i), on_handle);
        }
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            mechanism.closures.push(Closure {
                name: format!("{}-{}", wrist(a), wrist(b)),
                kind: ClosureKind::Distance,
                between: [wrist(a), wrist(b)],
                value: Some(Value::Known(1.5 * 3.0_f64.sqrt())),
                noise: None,
                sd: None,
            });
        }
        // Eq. (14): offset = θ_rest - k · 2048.
        if let Ok(angles) = crate::rsi::inverse(&rest) {
            for (channel, angle) in mechanism.channels.iter_mut().zip(angles.iter().flatten()) {
                channel.offset = angle - gain * 2048.0;
            }
        }
        mechanism
    }

    /// Index of a channel.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn channel_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.channels, |c| &c.name, "channel", name)
    }

    /// Index of a chain. Errors as [`Mechanism::channel_index`].
    pub fn chain_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.chains, |c| &c.name, "chain", name)
    }

    /// Index of a point. Errors as [`Mechanism::channel_index`].
    pub fn point_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.points, |p| &p.name, "point", name)
    }

    /// Index of a closure. Errors as [`Mechanism::channel_index`].
    pub fn closure_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.closures, |c| &c.name, "closure", name)
    }

    /// Scalar equations that one sample gives.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.closures.iter().filter(|c| !self.is_link(c)).map(|c| c.kind.equations()).sum()
    }

    /// True for a distance between unknown points of one group, which no sample
    /// takes part in: `between = ["socket[at=socket0]", "socket[at=socket1]"]`.
    #[must_use]
    pub fn is_link(&self, closure: &Closure) -> bool {
        let named = |end: &String| self.points.iter().any(|p| p.name == *end);
        closure.between.iter().all(|end| !named(end) && end.ends_with(']'))
    }

    /// `socket[at=socket0]` as a point and the values of some of its columns.
    ///
    /// A value may hold anything: where it ends is told by the names of the columns.
    #[must_use]
    pub fn unknown_end(&self, text: &str) -> Option<(usize, Vec<(usize, String)>)> {
        let inside = |p: &Point| {
            let keys = text.strip_prefix(p.name.as_str())?.strip_prefix('[')?.strip_suffix(']')?;
            keys_of(keys, &p.unknown)
        };
        self.points.iter().enumerate().find_map(|(i, p)| Some((i, inside(p)?)))
    }

    /// Text columns of the readings that the unknown points need.
    #[must_use]
    pub fn key_columns(&self) -> Vec<String> {
        let mut columns: Vec<String> = Vec::new();
        for column in self.points.iter().flat_map(|p| &p.unknown) {
            if !columns.contains(column) {
                columns.push(column.clone());
            }
        }
        columns
    }

    /// Columns of the readings that hold measured distances.
    #[must_use]
    pub fn value_columns(&self) -> Vec<String> {
        let mut columns: Vec<String> = Vec::new();
        for closure in &self.closures {
            if let Some(Value::Column(column)) = &closure.value
                && !columns.contains(column)
            {
                columns.push(column.clone());
            }
        }
        columns
    }

    /// The same mechanism with only the closures named.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] for a name that no closure bears.
    pub fn with_closures(&self, names: &[String]) -> Result<Self, Error> {
        for name in names {
            self.closure_index(name)?;
        }
        let mut some = self.clone();
        some.closures.retain(|c| names.contains(&c.name));
        Ok(some)
    }

    /// The channels of one chain, base first.
    #[must_use]
    pub fn channels_of(&self, chain: usize) -> Vec<usize> {
        let names = self.chains[chain].rows.iter().filter_map(|r| r.channel.as_ref());
        names.filter_map(|n| self.channels.iter().position(|c| c.name == *n)).collect()
    }

    /// True where nothing ties the mechanism to its base: a single chain that touches
    /// unknown points alone. Turning the whole world changes no reading.
    #[must_use]
    pub fn floats(&self) -> bool {
        let fixed = |end: &String| {
            let mut points = self.points.iter();
            points.any(|p| p.name == *end && p.chain.is_none() && p.unknown.is_empty())
        };
        self.chains.len() == 1 && !self.closures.iter().any(|c| c.between.iter().any(fixed))
    }

    /// True for a channel whose joint slides: its coordinate is a length.
    #[must_use]
    pub fn slides(&self, channel: usize) -> bool {
        let name = &self.channels[channel].name;
        let mut rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.any(|r| r.channel.as_ref() == Some(name) && r.joint == Motion::Prismatic)
    }

    /// The chain that a channel belongs to.
    #[must_use]
    pub fn chain_of(&self, channel: usize) -> Option<usize> {
        (0..self.chains.len()).find(|&c| self.channels_of(c).contains(&channel))
    }

    /// True where a channel senses joints that turn, so that whole turns make no difference.
    #[must_use]
    pub fn turns(&self, channel: usize) -> bool {
        let name = Some(&self.channels[channel].name);
        let rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.filter(|row| row.channel.as_ref() == name).all(|row| row.joint == Motion::Revolute)
    }

    /// Checks that every name leads somewhere and every number is one.
    ///
    /// # Errors
    ///
    /// [`Error::Mechanism`] with the place, what stands there and what could.
    pub fn validate(&self) -> Result<(), Error> {
        if let Some(gravity) = &self.gravity {
            finite(gravity.iter(), || "gravity".into())?;
            if gravity.iter().all(|g| *g == 0.0) {
                return Err(refuse("gravity".into(), "[0, 0, 0]".into(), "a direction".into()));
            }
        }
        unique("channel", self.channels.iter().map(|c| &c.name))?;
        unique("chain", self.chains.iter().map(|c| &c.name))?;
        unique("point", self.points.iter().map(|p| &p.name))?;
        unique("closure", self.closures.iter().map(|c| &c.name))?;
        for channel in &self.channels {
            check_channel(channel)?;
        }
        self.check_chains()?;
        for point in &self.points {
            self.check_point(point)?;
        }
        for closure in &self.closures {
            self.check_closure(closure)?;
        }
        self.check_platform()?;
        self.check_model()
    }

    /// Terms by their ids: where they act is told by the readings, too.
    fn check_model(&self) -> Result<(), Error> {
        let ids = self.model.terms.iter().map(|spec| ("terms", spec));
        for (key, spec) in ids.chain(self.model.sd.keys().map(|id| ("sd", id))) {
            let id = spec.split('@').next().unwrap_or_default();
            if let Err(Error::Unknown { found, known, .. }) = crate::terms::find(id) {
                return Err(refuse(format!("model, {key}"), format!("term {found:?}"), known));
            }
        }
        Ok(())
    }

    fn check_chains(&self) -> Result<(), Error> {
        let mut seen: Vec<&String> = Vec::new();
        for chain in &self.chains {
            for (i, row) in chain.rows.iter().enumerate() {
                let place = || format!("chain {:?}, row {}", chain.name, i + 1);
                let numbers = [row.theta, row.d, row.a, row.alpha];
                let all = numbers.iter().chain(&row.xyz).chain(&row.rpy).chain(&row.com);
                finite(all, place)?;
                if let Some(mass) = row.mass.filter(|m| !(m.is_finite() && *m >= 0.0)) {
                    let expected = "a number of 0 or more".into();
                    return Err(refuse(place(), format!("mass {mass}"), expected));
                }
                let Some(name) = &row.channel else { continue };
                if self.channels.iter().all(|c| c.name != *name) {
                    let known = list(self.channels.iter().map(|c| &c.name));
                    return Err(refuse(place(), format!("channel {name:?}"), known));
                }
                if seen.contains(&name) {
                    let found = format!("channel {name:?} again");
                    return Err(refuse(place(), found, "each channel at one joint".into()));
                }
                seen.push(name);
            }
        }
        match self.channels.iter().find(|c| !seen.contains(&&c.name)) {
            Some(channel) => Err(refuse(
                format!("channel {:?}", channel.name),
                "no joint that it senses".into(),
                "a row of a chain that names it".into(),
            )),
            None => Ok(()),
        }
    }

    fn check_point(&self, point: &Point) -> Result<(), Error> {
        let place = || format!("point {:?}", point.name);
        if let Some(chain) = &point.chain {
            known(self.chain_index(chain), place)?;
        }
        match (&point.at, point.unknown.is_empty()) {
            (Some(at), true) => finite(at.iter(), place),
            (None, false) if point.chain.is_none() => Ok(()),
            _ => Err(refuse(
                place(),
                "neither a place nor an unknown, or both".into(),
                "`at = [x, y, z]`, or `unknown = [columns]` without a chain".into(),
            )),
        }
    }

    fn check_closure(&self, closure: &Closure) -> Result<(), Error> {
        let place = || format!("closure {:?}", closure.name);
        for noise in closure.noise.iter().chain(&closure.sd) {
            if !(noise.is_finite() && *noise >= 0.0) {
                return Err(refuse(place(), format!("{noise}"), "a length of 0 or more".into()));
            }
        }
        match (closure.kind, &closure.value) {
            (ClosureKind::Touch, None) | (ClosureKind::Distance, Some(Value::Column(_))) => {}
            (ClosureKind::Distance, Some(Value::Known(d))) if d.is_finite() && *d > 0.0 => {}
            (kind, value) => {
                let expected = "a positive `value` for a distance, none for a touch";
                return Err(refuse(place(), format!("{kind:?} with {value:?}"), expected.into()));
            }
        }
        let [a, b] = &closure.between;
        if a == b {
            return Err(refuse(place(), format!("{a:?} twice"), "two points".into()));
        }
        if self.is_link(closure) {
            return self.check_unknowns(closure);
        }
        known(self.point_index(a), place)?;
        known(self.point_index(b), place)
    }

    /// A distance between unknown points: each names a point, and columns that it has.
    fn check_unknowns(&self, closure: &Closure) -> Result<(), Error> {
        match closure.between.iter().find(|end| self.unknown_end(end).is_none()) {
            None => Ok(()),
            Some(end) => {
                let unknown = self.points.iter().filter(|p| !p.unknown.is_empty());
                let known = unknown.map(|p| format!("{}[{}=…]", p.name, p.unknown.join("=…,")));
                let known: Vec<String> = known.collect();
                let expected = match known.is_empty() {
                    true => "points of the mechanism".into(),
                    false => format!("unknown points with columns of theirs: {}", known.join(", ")),
                };
                let place = format!("closure {:?}, between", closure.name);
                Err(refuse(place, format!("{end:?}"), expected))
            }
        }
    }

    fn check_platform(&self) -> Result<(), Error> {
        for (name, at) in &self.platform {
            known(self.point_index(name), || "platform".into())?;
            finite(at.iter(), || format!("platform, {name}"))?;
        }
        if let Some(rest) = &self.rest {
            finite(rest.pose.iter(), || "rest, pose".into())?;
        }
        let rest = self.rest.iter().filter_map(|rest| Some(("rest", rest.sd?)));
        let model = self.model.sd.iter().map(|(term, sd)| (term.as_str(), *sd));
        let positive = |sd: f64| sd.is_finite() && sd > 0.0;
        if let Some((what, sd)) = rest.chain(model).find(|(_, sd)| !positive(*sd)) {
            return Err(refuse(format!("{what}, sd"), sd.to_string(), "a positive number".into()));
        }
        if self.closures.is_empty() {
            return Err(refuse("closure".into(), "none".into(), "at least one".into()));
        }
        Ok(())
    }
}

#[cfg(feature = "toml")]
impl Mechanism {
    /// Reads a mechanism from TOML text.
    ///
    /// # Errors
    ///
    /// [`Error::Toml`] with line and column, or what [`Mechanism::validate`] finds.
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let mechanism: Self =
            toml::from_str(text).map_err(|e| Error::Toml(e.to_string().trim_end().into()))?;
        mechanism.validate()?;
        Ok(mechanism)
    }

    /// Writes it as TOML text that [`Mechanism::from_toml`] reads back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}

/// `at=socket0,group=front` as the index of each column and its value.
fn keys_of(text: &str, columns: &[String]) -> Option<Vec<(usize, String)>> {
    let column_at = |i: usize| {
        let rest = text[i..].trim_start();
        let named = |c: &String| rest.strip_prefix(c.as_str())?.strip_prefix('=');
        columns.iter().enumerate().find_map(|(k, c)| Some((k, named(c)?)))
    };
    let after_commas = text.match_indices(',').map(|(i, _)| i + 1);
    let starts: Vec<usize> =
        std::iter::once(0).chain(after_commas).filter(|i| column_at(*i).is_some()).collect();
    if starts.first() != Some(&0) {
        return None;
    }
    let ends = starts.iter().skip(1).map(|i| i - 1).chain([text.len()]);
    let value = |(start, end): (&usize, usize)| {
        let (k, rest) = column_at(*start)?;
        let beyond = text.len() - end;
        Some((k, rest[..rest.len() - beyond].trim().to_string()))
    };
    starts.iter().zip(ends).map(value).collect()
}

fn refuse(place: String, found: String, expected: String) -> Error {
    Error::Mechanism { place, found, expected }
}

/// A name that leads nowhere, with the place that bears it.
fn known(found: Result<usize, Error>, place: impl Fn() -> String) -> Result<(), Error> {
    match found {
        Err(Error::Unknown { kind, found, known }) => {
            Err(refuse(place(), format!("{kind} {found:?}"), known))
        }
        other => other.map(|_| ()),
    }
}

fn list<'a>(names: impl Iterator<Item = &'a String>) -> String {
    names.map(String::as_str).collect::<Vec<_>>().join(", ")
}

fn index<T>(
    all: &[T],
    name: impl Fn(&T) -> &String,
    kind: &'static str,
    wanted: &str,
) -> Result<usize, Error> {
    all.iter().position(|t| name(t) == wanted).ok_or_else(|| Error::Unknown {
        kind,
        found: wanted.into(),
        known: list(all.iter().map(name)),
    })
}

fn unique<'a>(kind: &str, names: impl Iterator<Item = &'a String>) -> Result<(), Error> {
    let mut seen = Vec::new();
    for name in names {
        if seen.contains(&name) || name.is_empty() {
            let place = format!("{kind} {name:?}");
            return Err(refuse(place, "the name again, or none".into(), "one of its own".into()));
        }
        seen.push(name);
    }
    if seen.is_empty() {
        return Err(refuse(kind.into(), "none".into(), "at least one".into()));
    }
    Ok(())
}

fn finite<'a>(
    mut numbers: impl Iterator<Item = &'a f64>,
    place: impl Fn() -> String,
) -> Result<(), Error> {
    match numbers.find(|n| !n.is_finite()) {
        Some(n) => Err(refuse(place(), n.to_string(), "a finite number".into())),
        None => Ok(()),
    }
}

fn check_channel(channel: &Channel) -> Result<(), Error> {
    let place = || format!("channel {:?}", channel.name);
    finite([channel.gain, channel.offset].iter(), place)?;
    if channel.gain == 0.0 {
        return Err(refuse(place(), "gain 0".into(), "a gain other than zero".into()));
    }
    for [low, high] in channel.range.iter().chain(&channel.limits) {
        if !(low.is_finite() && high.is_finite() && low < high) {
            let expected = "the lower end before the upper";
            return Err(refuse(place(), format!("[{low}, {high}]"), expected.into()));
        }
    }
    match channel.noise {
        Some(n) if !(n.is_finite() && n > 0.0) => {
            Err(refuse(place(), format!("noise {n}"), "a positive number".into()))
        }
        _ => Ok(()),
    }
}

//! Laws that users write: a term in one line of the mechanism file.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use crate::Error;
use crate::numerics::bounds;
use crate::numerics::formula::{Graph, Id, Program, parse};
use crate::numerics::lanes::Lanes;
use crate::text::{quoted, word};

/// Most parameters that one term may have.
pub const MOST_PARAMETERS: usize = 64;

/// Most variables of one law: those by name, and joints.
pub const MOST_VARIABLES: usize = 16;

/// Kind of the fault that a term describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Class {
    /// One channel.
    Sensor,
    /// All channels in the same way.
    Electronics,
    /// Lengths and axes.
    Geometry,
    /// Closures.
    Closure,
    /// Weight and stiffness.
    Load,
    /// A reading that is wrong.
    Data,
}

/// Kind of target of a term.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Per {
    /// A channel: `a22`.
    Channel,
    /// A row of a chain: `arm2/2`.
    Row,
    /// A chain: `arm2`.
    Chain,
    /// A chain, or all chains with one parameter: `arm2`, `all`.
    #[cfg_attr(feature = "serde", serde(skip))]
    ChainOrAll,
    /// A closure: `wrist1-wrist2`.
    Closure,
    /// The whole mechanism: `all`.
    All,
}

/// The axis of a frame along or about which a law of geometry moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Moves {
    /// Along x.
    Tx,
    /// Along y.
    Ty,
    /// Along z.
    Tz,
    /// About x.
    Rx,
    /// About y.
    Ry,
    /// About z.
    Rz,
}

/// A term that is written as a formula.
///
/// `correction` is added to joint coordinates (rad, or length units for a prismatic joint), or to
/// the value of a distance (length units). A law of geometry has `moves` and `amount` in its place
/// (length units or rad): the frame after the joint of the row moves, or that of the chain's first
/// joint. Formulas are of the parameters and of variables (`docs/laws.md`).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "document", schemars(rename = "OwnTerm"))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Law {
    /// Name of the term, for scripts.
    pub id: String,
    /// Kind of the fault.
    pub class: Class,
    /// Kind of target: `channel`, `row`, `chain`, `closure` or `all`.
    pub per: Per,
    /// Names of the parameters, and a size of each that occurs in practice. All are zero where the
    /// effect is absent.
    pub parameters: BTreeMap<String, f64>,
    /// Correction of a joint coordinate or of a distance.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub correction: Option<String>,
    /// Axis that moves, of a law of geometry.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub moves: Option<Moves>,
    /// By how much it moves.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub amount: Option<String>,
    /// Description of the effect.
    #[cfg_attr(feature = "serde", serde(default))]
    pub doc: String,
}

/// What a formula may refer to beside its parameters. That of the joint is of the joint which is
/// corrected, of the row's joint, or of the chain's first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// `reading`: of the joint, in the channel's unit.
    Reading,
    /// `u`: the reading from the middle of its range, in half ranges; see [`Channel::ends`](crate::mechanism::Channel::ends).
    U,
    /// `phi`: the nominal angle of the reading from the middle of its range (rad, or length).
    Phi,
    /// `t`: time, 0 to 1 over the session.
    Time,
    /// `temperature`: above the mean of the session (K).
    Temperature,
    /// `direction`: from which the reading was approached, -1, 0 or 1.
    Direction,
    /// `velocity`: change of the reading, in its unit per second.
    Velocity,
    /// `theta[k]`: coordinate of joint `k` of the chain, counted from 1 (rad, or length).
    Theta(usize),
    /// `theta[NAME]`: coordinate of the channel with that name, of whatever chain or of none.
    Coordinate(&'static str),
    /// `travelled[NAME]`: path of that channel since its session began (rad, or length).
    Travelled(&'static str),
    /// `since_turn[NAME]`: how far that channel is from where it turned last, with its sign (rad, or length).
    SinceTurn(&'static str),
    /// `play[NAME, WIDTH]`: where that channel is between the sides of a play to `WIDTH` (rad, or length) on
    /// both sides, -1 to 1.
    Play(&'static str, Width),
    /// `torque[NAME]`: of the joint of that channel.
    TorqueOf(&'static str),
    /// The name of a declared column of the readings: what it says in that row.
    Column(&'static str),
    /// `length`: of the distance that a law of a closure corrects, before it does (length).
    Length,
    /// `torque`: of gravity about the joint, of the links' masses where any is declared, else of a
    /// unit weight at the points that the chain carries (length times mass, without g).
    Torque,
    /// `reach`: from the joint to the middle of the points that the chain carries (length).
    Reach,
}

/// The name before a channel and the width of a play.
const PLAY: &str = "play";

/// Width of a play, above zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Width(u64);

impl Width {
    /// None unless it is above zero.
    #[must_use]
    pub fn new(value: f64) -> Option<Self> {
        bounds::positive(value).then(|| Self(value.to_bits()))
    }

    /// The number.
    #[must_use]
    pub fn value(self) -> f64 {
        f64::from_bits(self.0)
    }
}

/// A variable of the channel with a name.
pub type OfChannel = fn(&'static str) -> Variable;

impl Variable {
    /// Names of those without an index.
    pub const NAMES: [(&'static str, Self); 10] = [
        ("reading", Self::Reading),
        ("u", Self::U),
        ("phi", Self::Phi),
        ("t", Self::Time),
        ("temperature", Self::Temperature),
        ("direction", Self::Direction),
        ("velocity", Self::Velocity),
        ("torque", Self::Torque),
        ("reach", Self::Reach),
        ("length", Self::Length),
    ];

    /// The channel that it names, where it names one.
    #[must_use]
    pub fn channel(self) -> Option<&'static str> {
        match self {
            Self::Coordinate(name) | Self::TorqueOf(name) => Some(name),
            Self::Travelled(name) | Self::SinceTurn(name) | Self::Play(name, _) => Some(name),
            _ => None,
        }
    }

    /// Names of those of a channel that stands in brackets.
    pub const OF_CHANNELS: [(&'static str, OfChannel); 4] = [
        ("theta", Self::Coordinate),
        ("torque", Self::TorqueOf),
        ("travelled", Self::Travelled),
        ("since_turn", Self::SinceTurn),
    ];

    /// True for what another channel, a column or a distance has.
    fn of_others(self) -> bool {
        self.channel().is_some() || matches!(self, Self::Column(_) | Self::Length)
    }

    /// True for what is of the joint itself, not of the session, of the chain or of another channel.
    #[must_use]
    pub fn of_joint(self) -> bool {
        !self.of_others() && !matches!(self, Self::Time | Self::Temperature | Self::Theta(_))
    }

    /// True for what depends on where the chain is.
    #[must_use]
    pub fn of_posture(self) -> bool {
        matches!(self, Self::Theta(_) | Self::Torque | Self::Reach)
    }

    /// True for what a channel does not have by itself.
    #[must_use]
    pub fn couples(self) -> bool {
        self.of_others() || self.of_posture()
    }

    /// True for what a channel has that is on no joint.
    #[must_use]
    pub fn without_joint(self) -> bool {
        !self.of_posture() && self != Self::Phi
    }

    /// True for what a closure has: it is of no joint and of no one chain.
    fn of_closure(self) -> bool {
        self.of_others() || matches!(self, Self::Time | Self::Temperature)
    }
}

/// A name that lives as long as the program, one for all that are equal.
fn lasting(name: &str) -> &'static str {
    static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = names.get(name) {
        return known;
    }
    let known: &'static str = Box::leak(name.to_string().into_boxed_str());
    names.insert(known);
    known
}

/// A formula that was read: inputs are the parameters, then the variables.
#[derive(Debug, Clone)]
pub struct Formula {
    /// Operations.
    pub graph: Graph,
    /// The result.
    pub value: Id,
    /// The variables that it refers to.
    pub variables: Vec<Variable>,
}

impl Law {
    /// The key of the formula, and its text.
    #[must_use]
    pub fn text(&self) -> (&'static str, &str) {
        match &self.amount {
            Some(amount) => ("amount", amount),
            None => ("correction", self.correction.as_deref().unwrap_or_default()),
        }
    }

    /// Reads the formula. A name that is neither a parameter nor a variable is a column, and a name
    /// in brackets is a channel: [`Law::formula_among`] says whether there are such.
    ///
    /// # Errors
    ///
    /// [`Error::Mechanism`] with the character at which it cannot be read.
    pub fn formula(&self) -> Result<Formula, Error> {
        self.read(None)
    }

    /// Reads the formula, where these are all columns and all channels that it may refer to.
    ///
    /// # Errors
    ///
    /// As [`Law::formula`].
    pub fn formula_among(&self, columns: &[&str], channels: &[&str]) -> Result<Formula, Error> {
        self.read(Some([columns, channels]))
    }

    fn read(&self, there: Option<[&[&str]; 2]>) -> Result<Formula, Error> {
        let (key, text) = self.text();
        let (mut graph, mut variables) = (Graph::default(), Vec::new());
        let is_there = |v: &Variable| match (v, there) {
            (Variable::Column(name), Some([columns, _])) => columns.contains(name),
            (of, Some([_, channels])) => of.channel().is_none_or(|name| channels.contains(&name)),
            _ => true,
        };
        let known = || self.known(there.map_or(&[], |[columns, _]| columns));
        let mut input = |name: &str, index: Option<&str>| {
            if let Some(k) = self.parameters.keys().position(|p| p == name && index.is_none()) {
                return Ok(k);
            }
            let variable = self.variable(name, index).filter(is_there).ok_or_else(known)?;
            let k = variables.iter().position(|v| *v == variable).unwrap_or_else(|| {
                variables.push(variable);
                variables.len() - 1
            });
            Ok(self.parameters.len() + k)
        };
        let value = parse(text, &mut graph, &mut input).map_err(|misread| {
            let place = format!("term {}, {key}", quoted(&self.id));
            refuse(place, format!("{misread} in {}", quoted(text)), misread.expected)
        })?;
        Ok(Formula { graph, value, variables })
    }

    /// What a name that is no parameter means, with what stands in brackets after it.
    fn variable(&self, name: &str, index: Option<&str>) -> Option<Variable> {
        let Some(index) = index else {
            let known = Variable::NAMES.iter().any(|(known, _)| *known == name);
            return match known {
                true => self.named(name),
                false => Some(Variable::Column(lasting(name))),
            };
        };
        let found = match (name, index.parse::<usize>()) {
            ("theta", Ok(k)) => (k > 0).then_some(Variable::Theta(k)),
            (PLAY, _) => index.rsplit_once(',').and_then(|(name, width)| {
                let width = Width::new(width.trim().parse().ok()?)?;
                Some(Variable::Play(lasting(name.trim_end()), width))
            }),
            (_, Ok(_)) => None,
            (name, Err(_)) => {
                let of = Variable::OF_CHANNELS.iter().find(|(known, _)| *known == name);
                of.map(|(_, variable)| variable(lasting(index)))
            }
        };
        found.filter(|v| self.may_use(*v))
    }

    /// The variable with a name of its own.
    fn named(&self, name: &str) -> Option<Variable> {
        let mut names = Variable::NAMES.iter();
        let found = names.find(|(known, _)| *known == name).map(|(_, v)| *v);
        found.filter(|v| self.may_use(*v))
    }

    fn may_use(&self, variable: Variable) -> bool {
        match self.class {
            Class::Closure => variable.of_closure(),
            _ => variable != Variable::Length,
        }
    }

    /// What a formula may refer to, with these columns.
    fn known(&self, columns: &[&str]) -> String {
        let parameters = self.parameters.keys().map(String::as_str);
        let variables = Variable::NAMES.iter().filter(|(_, v)| self.may_use(*v));
        let joints = self.may_use(Variable::Theta(1)).then_some("theta[1]");
        let all = parameters.chain(variables.map(|(name, _)| *name)).chain(joints);
        let all = all.map(str::to_owned);
        let of_channels = Variable::OF_CHANNELS.iter().map(|(name, _)| format!("{name}[CHANNEL]"));
        let play = [format!("{PLAY}[CHANNEL, WIDTH]")];
        let columns = columns.iter().map(|name| (*name).to_owned());
        all.chain(of_channels).chain(play).chain(columns).collect::<Vec<_>>().join(", ")
    }

    /// Refuses a law that cannot be used.
    ///
    /// # Errors
    ///
    /// [`Error::Mechanism`] with the entry, what was found and what was expected.
    pub fn check(&self) -> Result<(), Error> {
        let place = |key: &str| format!("term {}, {key}", quoted(&self.id));
        let named = |name: &str| {
            let letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
            !name.is_empty()
                && name.chars().all(letters)
                && !name.starts_with(|c: char| c.is_ascii_digit())
        };
        if !named(&self.id) {
            let expected = "letters, digits and _, and no digit first";
            return Err(refuse("term, id".into(), quoted(&self.id), expected.into()));
        }
        let (allowed, words): (&[Per], _) = match self.class {
            Class::Sensor | Class::Electronics | Class::Load => {
                (&[Per::Channel, Per::Chain, Per::All], "channel, chain or all")
            }
            Class::Geometry => (&[Per::Row, Per::Chain, Per::All], "row, chain or all"),
            Class::Closure => (&[Per::Closure, Per::All], "closure or all"),
            Class::Data => {
                let expected = "sensor, electronics, geometry, load or closure";
                return Err(refuse(place("class"), "\"data\"".into(), expected.into()));
            }
        };
        if !allowed.contains(&self.per) {
            let found = quoted(&word(&self.per));
            return Err(refuse(place("per"), found, words.into()));
        }
        let has = (self.correction.is_some(), self.moves.is_some(), self.amount.is_some());
        let (wanted, words) = match self.class {
            Class::Geometry => ((false, true, true), "`moves` and `amount`"),
            _ => ((true, false, false), "`correction`"),
        };
        if has != wanted {
            let there = [("correction", has.0), ("moves", has.1), ("amount", has.2)];
            let there: Vec<&str> = there.iter().filter(|k| k.1).map(|k| k.0).collect();
            let found = if there.is_empty() { "none".into() } else { there.join(", ") };
            return Err(refuse(format!("term {}", quoted(&self.id)), found, words.into()));
        }
        if !(1..=MOST_PARAMETERS).contains(&self.parameters.len()) {
            let expected = format!("1 to {MOST_PARAMETERS}");
            let found = self.parameters.len().to_string();
            return Err(refuse(place("parameters"), found, expected));
        }
        for (name, typical) in &self.parameters {
            let of_channels = Variable::OF_CHANNELS.iter().any(|(known, _)| known == name);
            let taken = self.named(name).is_some() || of_channels || name == PLAY || name == "pi";
            if !named(name) || taken {
                let expected = "a name that is no variable, of letters, digits and _";
                return Err(refuse(place("parameters"), quoted(name), expected.into()));
            }
            if !bounds::positive(*typical) {
                let found = format!("{name} = {typical}");
                return Err(refuse(place("parameters"), found, "a typical size above 0".into()));
            }
        }
        self.check_formula()
    }

    /// Refuses a formula that is not zero where all parameters are, or that some parameter does
    /// not change from there: neither could be searched for.
    fn check_formula(&self) -> Result<(), Error> {
        let Formula { mut graph, value, variables } = self.formula()?;
        let (key, text) = self.text();
        let place = format!("term {}, {key}", quoted(&self.id));
        if variables.len() > MOST_VARIABLES {
            let found = format!("{} variables", variables.len());
            return Err(refuse(place, found, format!("at most {MOST_VARIABLES}")));
        }
        let width = self.parameters.len();
        // Values at which nothing vanishes that does not always vanish.
        let input = |k: usize| Lanes(std::array::from_fn(|lane| probe(k, lane)));
        let at = |graph: &Graph, id: Id| {
            let (rest, id) = graph.at_zero(id, width);
            Program::new(&rest, &[id]).value(input)
        };
        let at_zero = at(&graph, value);
        if at_zero.0.iter().any(|v| *v != 0.0) {
            let found = format!("an effect at parameters of zero, from {}", quoted(text));
            let columns = variables.iter().filter_map(|variable| match variable {
                Variable::Column(name) => Some(quoted(name)),
                _ => None,
            });
            let columns = columns.collect::<Vec<_>>().join(", ");
            let no_parameters = match columns.is_empty() {
                true => String::new(),
                false => format!("; {columns}: no parameter, so a column of the readings"),
            };
            return Err(refuse(place, found, format!("0: no effect{no_parameters}")));
        }
        for (k, name) in self.parameters.keys().enumerate() {
            let slope = graph.derivative(value, k);
            let slope = at(&graph, slope);
            if slope.0.iter().all(|v| *v == 0.0) || slope.0.iter().any(|v| !v.is_finite()) {
                let found = format!("parameter {}, which changes nothing by itself", quoted(name));
                let expected = "parameters that act when all others are zero; write other \
                                constants as numbers";
                return Err(refuse(place, found, expected.into()));
            }
        }
        Ok(())
    }
}

/// A number between 0 and 1 for an input in a lane, each another one: multiples of roots of what is
/// no square.
fn probe(variable: usize, lane: usize) -> f64 {
    ((1 + lane) as f64 * (2.5 + variable as f64).sqrt()).fract() + 0.01
}

fn refuse(place: String, found: String, expected: String) -> Error {
    Error::Mechanism { place, found, expected }
}

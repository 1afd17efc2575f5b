//! A law that couples joints, at one place of a mechanism.

use crate::kinematics::elements::{Axis, Way, Weight};
use crate::mechanism::{Mechanism, Target, Variable};
use crate::model::drives::weight_of;
use crate::model::instance::Instance;
use crate::numerics::lanes::Lanes;
use crate::terms::coupled::Coupled;
use crate::terms::term::{Class, Spot};

/// A joint of a chain, which the joints that a channel drives are one for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Joint {
    pub(crate) chain: usize,
    /// None: a place of the chain without a sensor.
    pub(crate) channel: Option<usize>,
}

/// A law at one place.
#[derive(Clone)]
pub(crate) struct LawAt {
    pub(crate) term: &'static Coupled,
    /// Its part of the mechanism, of a target that has several.
    part: Target,
    /// The joint that it is of; its chain is that whose joints the law sees.
    pub(crate) joint: Joint,
    /// Of each variable the channel or the column that it is of, where it is of one.
    pub(crate) of: Vec<usize>,
    /// Of each variable the joint whose torque or reach it is, where it is one.
    pub(crate) hangs: Vec<Option<Joint>>,
    pub(crate) whose: Weight,
    pub(crate) session: Option<usize>,
    pub(crate) first: usize,
    /// Number of the coordinate to which it adds.
    pub(crate) to: usize,
}

impl LawAt {
    /// The law of an instance at each part of its target.
    pub(crate) fn each(
        mechanism: &Mechanism,
        instance: &Instance,
        term: &'static Coupled,
        first: usize,
        session: Option<usize>,
    ) -> Vec<Self> {
        let whose = weight_of(mechanism);
        let at = |part: Target| {
            let (chain, channel) = place(mechanism, part);
            let of: Vec<usize> =
                term.variables.iter().map(|v| number(mechanism, chain, *v)).collect();
            let to = channel.unwrap_or_default();
            let joint = Joint { chain, channel };
            let hung = |(v, of): (&Variable, &usize)| match v {
                Variable::Torque | Variable::Reach => Some(joint),
                Variable::TorqueOf(_) => {
                    mechanism.chain_of(*of).map(|chain| Joint { chain, channel: Some(*of) })
                }
                _ => None,
            };
            let hangs = term.variables.iter().zip(&of).map(hung).collect();
            Self { term, part, joint, of, hangs, whose, session, first, to }
        };
        let term = instance.term;
        let parts = parts(mechanism, instance).into_iter();
        let suited = parts.filter(|part| match part {
            Target::Channel(c) => term.suits(mechanism, *c),
            part => term.suits_target(mechanism, *part),
        });
        suited.map(at).collect()
    }

    /// The joint whose torque or reach a variable is.
    #[inline(always)]
    pub(super) fn hangs_at(&self, variable: usize) -> Joint {
        self.hangs[variable].unwrap_or(self.joint)
    }

    /// The channels that the law refers to by name.
    pub(crate) fn coordinates(&self) -> impl Iterator<Item = usize> {
        let named = self.term.variables.iter().zip(&self.of);
        named.filter(|(v, _)| matches!(v, Variable::Coordinate(_))).map(|(_, of)| *of)
    }

    /// True where it depends on how a chain hangs.
    #[inline(always)]
    pub(crate) fn sees_hang(&self, chain: usize) -> bool {
        self.hangs.iter().flatten().any(|joint| joint.chain == chain)
    }

    /// Gives the law a coordinate of its own, if it adds to no joint's; the number of them.
    pub(crate) fn number(&mut self, next: usize) -> usize {
        if matches!(self.part, Target::Channel(_)) {
            return 0;
        }
        self.to = next;
        1
    }

    /// What moves at one spot.
    pub(crate) fn moves(&self, spot: Spot, here: Target) -> Option<(Axis, Way)> {
        let spots = match self.part {
            Target::Row(..) => Spot::Joint,
            _ => Spot::Root,
        };
        self.term.moves.filter(|_| self.part == here && spot == spots)
    }

    /// True for a law of one closure.
    pub(crate) fn of_closure(&self, closure: usize) -> bool {
        self.part == Target::Closure(closure)
    }
}

/// The parts of a target that a law acts on, one by one.
fn parts(mechanism: &Mechanism, instance: &Instance) -> Vec<Target> {
    let class = instance.term.info().class;
    let chains = || (0..mechanism.chains.len()).map(Target::Chain).collect();
    let distance = |k: &usize| mechanism.closures[*k].kind.has_value();
    match (class, instance.target) {
        (Class::Closure, Target::All) => {
            let links = |k: &usize| mechanism.is_link(&mechanism.closures[*k]);
            let closures = (0..mechanism.closures.len()).filter(distance);
            closures.filter(|k| !links(k)).map(Target::Closure).collect()
        }
        (Class::Geometry, Target::All) => chains(),
        (Class::Geometry | Class::Closure, part) => mechanism.parts(part),
        (_, target) => mechanism.channels_at(target).into_iter().map(Target::Channel).collect(),
    }
}

/// The channel or the column that a variable is of, of a law that was checked.
fn number(mechanism: &Mechanism, chain: usize, variable: Variable) -> usize {
    let found = match variable {
        Variable::Theta(k) => mechanism.channels_of(chain).get(k.wrapping_sub(1)).copied(),
        Variable::Column(name) => mechanism.value_columns().iter().position(|own| own == name),
        of => of.channel().and_then(|name| mechanism.channel_index(name).ok()),
    };
    found.unwrap_or_default()
}

/// The chain of a part of the mechanism, and the joint.
fn place(mechanism: &Mechanism, part: Target) -> (usize, Option<usize>) {
    match part {
        Target::Channel(c) => (mechanism.chain_of(c).unwrap_or_default(), Some(c)),
        Target::Chain(chain) => (chain, mechanism.channels_of(chain).first().copied()),
        Target::Row(chain, row) => {
            let name = mechanism.chains[chain].rows[row].channel.as_ref();
            (chain, name.and_then(|name| mechanism.channel_index(name).ok()))
        }
        _ => (0, None),
    }
}

/// Room for the laws of one block.
#[derive(Debug, Clone, Default)]
pub struct LawRoom {
    /// What each law adds.
    pub(crate) values: Vec<Lanes>,
    /// Derivatives of laws by parameters: column, law, value.
    pub(crate) by_parameter: Vec<(usize, usize, Lanes)>,
    /// By coordinates of joints: channel, law, value.
    pub(crate) by_joint: Vec<(usize, usize, Lanes)>,
    /// By readings: channel, law, value.
    pub(crate) by_reading: Vec<(usize, usize, Lanes)>,
    /// `∂f/∂q'` of the amounts, equation by equation.
    pub(crate) h: Vec<Lanes>,
    /// `∂f/∂L`, equation by equation.
    pub(crate) pulls: Vec<Lanes>,
    /// `∂f/∂r` that does not go through joint coordinates, equation by equation.
    pub(crate) direct: Vec<Lanes>,
}

impl LawRoom {
    /// Clears the derivatives by the amounts, for so many entries.
    pub(crate) fn clear_slopes(&mut self, size: usize) {
        self.h.clear();
        self.h.resize(size, Lanes::ZERO);
    }
}

//! Whose errors a law may be: those of a channel, of a link along an axis of its frame, or of a closure's value.

use std::collections::BTreeMap;

use crate::Error;
use crate::closures::kind::Part;
use crate::mechanism::{Class, Law, Mechanism, Moves, Per, Target};
use crate::model::Instance;
use crate::terms::law::term_of;

/// Whose errors follow a law.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Whose {
    /// A channel, a row of a chain, or a closure.
    pub target: Target,
    /// The axis of the frame after the joint of a row, along which its link is drawn.
    pub moves: Option<Moves>,
}

impl Whose {
    /// A channel.
    #[must_use]
    pub fn channel(channel: usize) -> Self {
        Self { target: Target::Channel(channel), moves: None }
    }

    /// What a mechanism has beside its channels: links, each along the axes along which it is drawn, and
    /// values of closures that no channel reads.
    #[must_use]
    pub fn built(mechanism: &Mechanism) -> Vec<Self> {
        let chains = mechanism.chains.iter().enumerate();
        let links = chains.flat_map(|(c, chain)| {
            let moved = chain.rows.iter().position(|row| row.channel.is_some());
            let rows = chain.rows.iter().enumerate().skip(moved.unwrap_or(usize::MAX));
            rows.flat_map(move |(r, row)| {
                let way = row.body().translation.vector;
                let least = FLAT * way.norm();
                let axes = [(Moves::Tx, way.x), (Moves::Ty, way.y), (Moves::Tz, way.z)];
                let drawn = axes.into_iter().filter(move |(_, length)| length.abs() > least);
                drawn.map(move |(moves, _)| Self { target: Target::Row(c, r), moves: Some(moves) })
            })
        });
        let closures = mechanism.closures.iter().enumerate();
        let valued = closures.filter(|(_, closure)| {
            // What makes channels equal errs as they do.
            let of_channels = closure.kind.facts().between.contains(&Part::Channel);
            let own = closure.kind.has_value() && closure.channel.is_none() && !of_channels;
            own && !mechanism.is_link(closure)
        });
        let valued = valued.map(|(k, _)| Self { target: Target::Closure(k), moves: None });
        links.chain(valued).collect()
    }

    /// What users read: `arm/2 along x`.
    #[must_use]
    pub fn name(&self, mechanism: &Mechanism) -> String {
        let axis = match self.moves {
            Some(Moves::Tx) => " along x",
            Some(Moves::Ty) => " along y",
            Some(Moves::Tz) => " along z",
            _ => "",
        };
        self.target.name(mechanism) + axis
    }

    /// Unit of its errors.
    #[must_use]
    pub fn unit<'m>(&self, mechanism: &'m Mechanism) -> &'m str {
        match self.target {
            Target::Channel(_) => mechanism.coordinate_unit(self.target),
            _ => &mechanism.length_unit,
        }
    }

    /// What an error counted as the search does is in that unit: the gain of a channel.
    pub(super) fn gain(&self, mechanism: &Mechanism) -> f64 {
        match self.target {
            Target::Channel(c) => mechanism.channels[c].gain,
            _ => 1.0,
        }
    }

    /// A law of it as users write them.
    pub(super) fn law(&self, id: String, text: String, parameters: BTreeMap<String, f64>) -> Law {
        let (class, per) = match self.target {
            Target::Row(..) => (Class::Geometry, Per::Row),
            Target::Closure(_) => (Class::Closure, Per::Closure),
            _ => (Class::Sensor, Per::Channel),
        };
        let (correction, amount) = match self.moves {
            Some(_) => (None, Some(text)),
            None => (Some(text), None),
        };
        let (moves, doc) = (self.moves, String::new());
        Law { id, class, per, parameters, correction, moves, amount, doc }
    }

    /// An error of it that is the same in all poses, as an effect.
    pub(super) fn constant(&self) -> Result<Instance, Error> {
        let name = "error".to_owned();
        let law = self.law(CONSTANT.into(), name.clone(), BTreeMap::from([(name, TYPICAL)]));
        Ok(Instance { term: term_of(&law)?, target: self.target, place: 0 })
    }

    /// The chains whose joints it may depend on: its own, or those at the ends of a closure; none where there
    /// are none, and any may be.
    pub(super) fn chains(&self, mechanism: &Mechanism) -> Vec<usize> {
        match self.target {
            Target::Channel(c) => mechanism.chain_of(c).into_iter().collect(),
            Target::Row(chain, _) => vec![chain],
            Target::Closure(k) => {
                let names = mechanism.closures[k].between.iter();
                let points =
                    names.filter_map(|name| mechanism.points.iter().find(|p| p.name == *name));
                let chains = points.filter_map(|point| point.chain.as_ref());
                chains.filter_map(|chain| mechanism.chain_index(chain).ok()).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// A component of a link that is no more than rounding of its drawing.
const FLAT: f64 = 1e-9;

/// Id of an error that is the same in all poses: one that no file may have.
const CONSTANT: &str = "constant error";

/// Its typical size, by which nothing is decided.
const TYPICAL: f64 = 1e-3;

//! What an evaluation is asked for, and the room that it takes.

use crate::kinematics::posture::{Carried, Posture};
use crate::model::law_at::LawRoom;
use crate::numerics::lanes::Lanes;
use crate::readings::course::{Late, Moved};

/// The derivatives to compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Want {
    /// `X = ∂f/∂β`.
    pub x: bool,
    /// `A = ∂f/∂a`.
    pub a: bool,
}

/// Room for one block of samples.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// Misclosure, one per equation.
    pub f: Vec<Lanes>,
    /// `A`: equation by equation, one entry per channel.
    pub a: Vec<Lanes>,
    /// `X`: equation by equation, one entry per column of [`Model::columns`](crate::model::Model::columns).
    pub x: Vec<Lanes>,
    /// `B = ∂f/∂ξ` by what is unknown in one pose alone: equation by equation.
    pub b: Vec<Lanes>,
    /// `ξ`, where the misclosure is of.
    pub xi: Vec<Lanes>,
    /// Joint coordinates after all corrections, one per channel.
    pub angles: Vec<Lanes>,
    pub(crate) corrected: Vec<Lanes>,
    /// What late channels followed: several of their terms ask for the same.
    pub(super) moved: Vec<(usize, Late, Moved)>,
    pub(super) slopes: Vec<Lanes>,
    pub(super) mix: Vec<Lanes>,
    pub(super) partials: Vec<(usize, usize, Lanes)>,
    pub(super) electric: Vec<(usize, usize, Lanes)>,
    pub(crate) g: Vec<Lanes>,
    pub(super) turned: Vec<Lanes>,
    pub(crate) gates: Vec<Lanes>,
    pub(crate) postures: Vec<Posture>,
    pub(crate) unloaded: Vec<Posture>,
    pub(crate) carried: Vec<Vec<Carried>>,
    pub(crate) laws: LawRoom,
}

//! Starts that were tried, and the best of them.

use crate::estimate::adjusted::Adjusted;
use crate::estimate::conventions::Stays;
use crate::estimate::observations::AnchorKind;
use crate::estimate::suspicion::Suspicion;

/// Where a start begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// At an anchor as it is.
    Anchor(AnchorKind),
    /// At the maximum-likelihood fit with offsets tied to an anchor.
    Tied(AnchorKind, Gains),
}

/// Gains from which a start begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gains {
    /// The nominal gains times one factor.
    Times(f64),
    /// Each nominal gain times a factor of its own: the n-th such choice.
    Scattered(usize),
}

/// A start that was tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Try {
    /// Where the start began.
    pub from: Origin,
    /// `fᵀf` where it ended.
    pub cost: f64,
    /// χ² there by the noise that is assumed, of the samples that the search of starts uses.
    pub chi2: f64,
    /// True where a gain collapsed to zero.
    pub collapsed: bool,
}

/// Where to start, and how that was found.
#[derive(Debug, Clone, Default)]
pub struct Start {
    /// The parameters.
    pub beta: Vec<f64>,
    /// The starts that were tried.
    pub tries: Vec<Try>,
    /// What looks wrong with the wiring.
    pub warnings: Vec<Suspicion>,
    /// Readings as an earlier fit has settled them.
    pub(crate) adjusted: Option<Adjusted>,
    /// What stays while a search tries what may be added.
    pub(crate) stays: Vec<Stays>,
}

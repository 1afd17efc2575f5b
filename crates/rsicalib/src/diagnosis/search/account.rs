//! What is said of a session, as a value: effects, wrong readings, wrong poses, unknown noise.

use crate::diagnosis::score::pairs::Pair;
use crate::diagnosis::score::scored::{Scored, paid};
use crate::diagnosis::search::noise::UnknownNoise;
use crate::estimate::Fit;
use crate::model::Instance;

/// An explanation of a session with its fit and its price.
pub struct Account {
    /// Effects, wrong readings and wrong poses, in the order in which they were found.
    pub items: Vec<Scored>,
    /// Noise that nobody knows of.
    pub noise: Option<UnknownNoise>,
    /// Its fit.
    pub fit: Fit,
    /// Its price, (113).
    pub price: f64,
    /// False for what physics does not admit: it is a step on the way to others alone.
    pub admitted: bool,
    /// Everything else at its fit, likeliest first, once that was asked for.
    pub scored: Option<Vec<Scored>>,
    /// So many of these were refitted.
    pub tried: usize,
    /// Two at once at its fit were refitted.
    pub paired: bool,
    /// Moves of its own were made.
    pub moved: bool,
    /// Noise that nobody knows of was looked for beside it.
    pub noised: bool,
}

impl Account {
    pub fn of(items: Vec<Scored>, noise: Option<UnknownNoise>, fit: Fit, price: f64) -> Self {
        let (scored, tried, noised) = (None, 0, noise.is_some());
        let (admitted, paired, moved) = (true, false, false);
        Self { items, noise, fit, price, admitted, scored, tried, paired, moved, noised }
    }

    /// What one more item costs.
    pub fn paid_with(&self, item: &Scored) -> f64 {
        let more = [&self.items[..], &[*item]].concat();
        let all = |items: &[Scored]| {
            paid(items) + self.noise.map_or(0.0, |noise| noise.paid_beside(items))
        };
        all(&more) - all(&self.items)
    }

    /// True where it says the same.
    pub fn says(&self, items: &[Scored], noise: Option<&UnknownNoise>) -> bool {
        let target = |noise: &UnknownNoise| noise.target;
        self.items.len() == items.len()
            && self.noise.as_ref().map(target) == noise.map(target)
            && items.iter().all(|item| self.has(&item.instance))
    }

    /// True where an item is among those that it says.
    pub fn has(&self, instance: &Instance) -> bool {
        self.items.iter().any(|item| item.instance == *instance)
    }

    /// True where it says all that another says, and more.
    pub fn extends(&self, other: &Self) -> bool {
        let noise = other
            .noise
            .is_none_or(|noise| self.noise.is_some_and(|own| own.target == noise.target));
        let more =
            self.items.len() > other.items.len() || (self.noise.is_some() && other.noise.is_none());
        more && noise && other.items.iter().all(|item| self.has(&item.instance))
    }
}

/// What is added in one move.
pub enum More {
    /// Items.
    Items(Vec<Scored>),
    /// Noise that nobody knows of.
    Noise(UnknownNoise),
}

impl From<&Pair> for More {
    fn from(pair: &Pair) -> Self {
        Self::Items(pair.both.to_vec())
    }
}

//! The loops of a mechanism that hold at work, at places near those where they close.
//!
//! What touches something in the base is lifted off between two poses: nothing is closed there.

use nalgebra::{DMatrix, DVector};

use crate::closures::kind::Given;
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::configurations::{Configurations, Open, closes};
use crate::model::ends::End;
use crate::model::stiff::Stiff;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::Lanes;

/// Readings, and what is unknown in one pose alone, in steps of about one.
pub(super) type Place = DVector<f64>;

/// The coordinates of places.
pub(super) struct Coordinates {
    /// A step of one of each.
    pub(super) units: Vec<f64>,
    /// Lowest and highest value of each, in its steps.
    pub(super) limits: Vec<[f64; 2]>,
    /// What each may differ by at one place: whole turns of a joint without limits.
    pub(super) turns: Vec<f64>,
}

impl Coordinates {
    pub(super) fn of(configurations: &Configurations, model: &Model) -> Self {
        let units = configurations.units(model);
        Self { limits: configurations.ends(&units), turns: configurations.turns(&units), units }
    }

    pub(super) fn place(&self, values: impl Iterator<Item = f64>) -> Place {
        let at = values.zip(&self.units).map(|(value, unit)| value / unit);
        DVector::from_vec(at.collect())
    }

    /// The way to a place, without whole turns.
    pub(super) fn way(&self, from: &Place, goal: &Place) -> Place {
        DVector::from_fn(self.units.len(), |c, _| {
            let (way, turn) = (goal[c] - from[c], self.turns[c]);
            if turn > 0.0 { way - turn * (way / turn).round() } else { way }
        })
    }

    /// Values of eight lanes.
    pub(super) fn lanes(&self, at: &[Place]) -> Vec<Lanes> {
        let last = at.len() - 1;
        let value = |c: usize, lane: usize| at[lane.min(last)][c] * self.units[c];
        let lanes = |c: usize| Lanes(std::array::from_fn(|lane| value(c, lane)));
        (0..self.units.len()).map(lanes).collect()
    }

    /// True within limits, beyond which a path may begin.
    pub(super) fn within(&self, at: &Place, from: &Place) -> bool {
        let limits = self.limits.iter().zip(at.iter().zip(from));
        limits
            .into_iter()
            .all(|([low, high], (at, from))| *at >= low.min(*from) && *at <= high.max(*from))
    }
}

/// The loops at work of random configurations.
pub(super) struct Loops<'a> {
    open: &'a Open,
    pub(super) coordinates: &'a Coordinates,
    /// With those closures alone that hold at work.
    model: Model,
    /// What each equation is divided by.
    sizes: Vec<f64>,
}

impl<'a> Loops<'a> {
    pub(super) fn new(
        configurations: &Configurations,
        open: &'a Open,
        coordinates: &'a Coordinates,
    ) -> Self {
        let mut model = open.model.clone();
        model.closures.retain(holds);
        model.number_equations();
        Self { open, coordinates, sizes: configurations.sizes(&model), model }
    }

    /// At places of at most eight samples of a block.
    pub(super) fn look(&self, block: usize, at: &[Place], ws: &mut Workspace) -> Vec<Stiff> {
        let (a, open) = (self.coordinates.lanes(at), self.open);
        let want = Want { x: false, a: true };
        self.model.evaluate_at(&open.readings, block, &a, &open.beta, want, ws);
        (0..at.len()).map(|lane| self.stiff(ws, lane)).collect()
    }

    fn stiff(&self, ws: &Workspace, lane: usize) -> Stiff {
        let (units, places) = (&self.coordinates.units, ws.xi.len());
        let (m, n) = (self.sizes.len(), units.len());
        let channels = n - places;
        let f = DVector::from_fn(m, |i, _| ws.f[i].0[lane] / self.sizes[i]);
        let g = DMatrix::from_fn(m, n, |i, c| {
            let by = match c < channels {
                true => ws.a[i * channels + c],
                false => ws.b[i * places + c - channels],
            };
            by.0[lane] * units[c] / self.sizes[i]
        });
        Stiff::of(f, &g)
    }
}

/// A closure that holds at work. What touches something in the base is lifted off it, as is a chain from
/// the ball at the other end of a bar; rods, legs and belts stay.
pub(super) fn holds(closure: &CompiledClosure) -> bool {
    let base = |end: &End| matches!(end, End::Fixed(_) | End::Unknown(..));
    let carried = |end: &End| matches!(end, End::Carried(..));
    let stays = closure.kind.facts().given == Given::Value && !closure.ends.iter().any(carried);
    closes(closure) && closure.equations() > 0 && (stays || !closure.ends.iter().any(base))
}

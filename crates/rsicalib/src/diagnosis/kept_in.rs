//! Poses that do not fit their placement, against effects that explain them.
//!
//! What a model lacks shows most in the poses that differ most from the others: an eccentric encoder in those few
//! on the other side of its turn. Screening takes these for wrong, one by one, and what is left of the session is
//! sound. So where it leaves samples out the whole session is searched as well. Both explanations have their price
//! (113): of the first each pose that is left out is an item, a pose that is wrong.

use crate::diagnosis::plausibility::absurdities;
use crate::diagnosis::price::{Family, charge, less, of_places, prior};
use crate::diagnosis::score::places::wrong_readings;
use crate::diagnosis::trace::Pursued;
use crate::model::Instance;
use crate::screening::excluded::{Cause, Excluded};

impl Pursued<'_> {
    /// True where samples that do not fit their placement are left out.
    pub(super) fn leaves_samples_out(&self) -> bool {
        self.left_out().next().is_some()
    }

    fn left_out(&self) -> impl Iterator<Item = &Excluded> {
        self.excluded.iter().filter(|it| matches!(it.cause, Cause::Sample { .. }))
    }

    /// The likelier one of this explanation and that of the whole session.
    pub(super) fn or_whole(self, whole: Self) -> Self {
        let averaged = &whole.searched.averaged;
        let fit = &whole.searched.searched.current;
        let found = &whole.searched.searched.found;
        let found: Vec<Instance> = found.iter().map(|step| step.scored.instance).collect();
        let sound = !whole.lost && absurdities(&averaged.small, fit, &found).is_empty();
        let own = self.searched.searched.price(averaged) + self.paid_for_left_out(&whole);
        match sound && whole.searched.searched.price(averaged) < own {
            true => whole,
            false => self,
        }
    }

    /// What the poses cost that are left out: that each is wrong, by as much as all of them leave in the mean.
    fn paid_for_left_out(&self, whole: &Self) -> f64 {
        let small = &whole.searched.averaged.small;
        let equations = self.clean.residuals.equations;
        let poses = self.left_out().count() as f64;
        let each = less(whole.clean.cost(), self.clean.cost()) / poses;
        let rows = small.readings.samples;
        let places = wrong_readings(small, equations, rows) / prior(Family::Bad);
        poses * (charge(equations as f64, each) + of_places(places))
    }
}

//! A candidate with its score, and how scores are judged.

use crate::numerics::order;
use std::collections::HashMap;

use crate::diagnosis::price::{self, Said, prior};
use crate::estimate::Fit;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::distributions;
use crate::terms::term::Class;

pub use crate::diagnosis::price::Family;

/// A candidate with its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scored {
    /// The candidate; a whole pose is `bad_reading` at [`Target::All`].
    pub instance: Instance,
    /// Its family.
    pub family: Family,
    /// `T` of (72).
    pub score: f64,
    /// Its degrees of freedom.
    pub width: f64,
    /// Those that are paid for: what hardly shows costs nothing.
    pub told: f64,
    /// Probability of a larger score by chance, this candidate alone.
    pub p_value: f64,
    /// Places looked at in its family, over the prior of the family.
    pub places: f64,
    /// `p_value` times `places`.
    pub corrected: f64,
    /// What its parameters cost, (118); of a free shape (117).
    pub charge: f64,
}

impl Scored {
    pub(crate) fn of(
        instance: Instance,
        family: Family,
        score: f64,
        width: f64,
        p_value: f64,
        tests: f64,
    ) -> Self {
        let places = tests / prior(family);
        let (corrected, charge) = (p_value * places, price::charge(width, score));
        Self { instance, family, score, width, told: width, p_value, places, corrected, charge }
    }

    /// The same where readings tell so many directions of it.
    pub(crate) fn told_in(self, told: f64) -> Self {
        Self { told, charge: price::charge(told, self.score), ..self }
    }

    /// The same with the probability of its score.
    pub(crate) fn judged(self, judge: &Judge) -> Self {
        let p_value = judge.p_value(self.score, self.width);
        Self { p_value, corrected: p_value * self.places, ..self }
    }

    /// What its parameters and its places cost.
    #[must_use]
    pub fn paid(&self) -> f64 {
        self.charge + price::of_places(self.places)
    }

    /// What is left of the score after they are paid for.
    #[must_use]
    pub fn charged(&self) -> f64 {
        self.score - self.paid()
    }
}

/// What items cost together: each, and how many are effects.
#[must_use]
pub fn paid(items: &[Scored]) -> f64 {
    let effects = items.iter().filter(|s| !is_data(&s.instance)).count();
    items.iter().map(Scored::paid).sum::<f64>() + price::of_number(effects)
}

/// At most this many times are tried for what happened once to one part.
pub const MOST_TIMES: usize = 256;

/// The best place of each term at each target, best first.
#[must_use]
pub fn best_places(scored: &[Scored]) -> Vec<Scored> {
    let mut best: HashMap<_, (f64, usize)> = HashMap::new();
    for (k, one) in scored.iter().enumerate() {
        let here = (one.charged(), k);
        let there = best.entry((one.instance.term.info().id, one.instance.target)).or_insert(here);
        if here.0 > there.0 {
            *there = here;
        }
    }
    let mut best: Vec<(f64, usize)> = best.into_values().collect();
    best.sort_by_key(|one| one.1);
    order::descending(&mut best, |one| one.0);
    best.into_iter().map(|(_, k)| scored[k]).collect()
}

/// Of candidates in their order, keeps the first place of each of these terms at each target.
pub fn one_place_each(scored: &mut Vec<Scored>, of_these: impl Fn(&Instance) -> bool) {
    let mut seen = std::collections::HashSet::new();
    let key = |i: &Instance| (i.term.info().id, i.target);
    scored.retain(|s| !of_these(&s.instance) || seen.insert(key(&s.instance)));
}

/// How scores are judged.
#[derive(Debug, Clone, Copy)]
pub struct Judge {
    /// Degrees of freedom of the noise; infinite where it is known.
    pub noise_dof: f64,
    /// χ² of the fit and its degrees of freedom, where nothing else gives the noise.
    pub residual: Option<[f64; 2]>,
    /// The same where noise is declared and nothing bears it out.
    pub left: Option<[f64; 2]>,
    /// What readings say of the fit.
    pub said: Said,
}

impl Judge {
    /// Probability of a score of `width` degrees of freedom or more by chance.
    ///
    /// What stands out of noise that is declared, and that nothing bears out, must stand out of
    /// what it leaves as well: that noise may be too small.
    #[must_use]
    pub fn p_value(&self, score: f64, width: f64) -> f64 {
        let beside = |[chi2, dof]: [f64; 2], least: f64| {
            let free = (dof - width).max(1.0);
            let left = ((chi2 - score) / free).max(least);
            distributions::f_tail(score / width / left, width, free)
        };
        match self.residual {
            None => {
                let beside = self.left.map_or(0.0, |left| beside(left, 1.0));
                self.too_large(score, width).max(beside)
            }
            Some(residual) => beside(residual, 1e-12),
        }
    }
}

impl Judge {
    /// Probability of a fit's lack of fit by chance; none where only the fit gives
    /// the noise.
    #[must_use]
    pub fn lack_of_fit(&self, fit: &Fit) -> Option<f64> {
        (self.residual.is_none() && fit.dof >= 1.0).then(|| self.too_large(fit.chi2, fit.dof))
    }

    /// The same judge, of another fit of the same readings.
    #[must_use]
    pub fn of(self, fit: &Fit) -> Self {
        let left = self.left.map(|_| [fit.chi2, fit.dof]);
        let residual = self.residual.map(|_| [fit.total, fit.dof]);
        Self { residual, left, said: Said { chi2: fit.cost(), ..self.said }, ..self }
    }

    /// The judge of what a fit has of this score, as that of the fit without it.
    #[must_use]
    pub fn without(self, score: f64, width: f64) -> Self {
        let more = |[chi2, dof]: [f64; 2]| [chi2 + score, dof + width];
        Self { left: self.left.map(more), residual: self.residual.map(more), ..self }
    }

    /// Probability of a χ² of so many degrees of freedom, or of a larger one, by chance.
    #[must_use]
    pub fn too_large(&self, chi2: f64, dof: f64) -> f64 {
        distributions::f_tail(chi2 / dof, dof, self.noise_dof)
    }
}

/// Places of so many named candidates, over the prior of their kind.
#[must_use]
pub fn named_places(candidates: f64) -> f64 {
    candidates / prior(Family::Named)
}

/// True for terms whose class says that a reading is wrong, not the device.
#[must_use]
pub fn is_data(instance: &Instance) -> bool {
    instance.term.info().class == Class::Data
}

/// The pose of a candidate that says that the whole pose is wrong.
pub fn excluded_pose(instance: &Instance) -> Option<usize> {
    (is_data(instance) && instance.target == Target::All).then_some(instance.place)
}

//! The explanations of a session, linear at one point.

use crate::numerics::order::Ends;
use faer::Mat;

use crate::design::contest::{Contest, DECIDED, Field, Rival};
use crate::design::linearised::{Linearised, Whitened};
use crate::design::purpose::Purpose;
use crate::estimate::Fit;
use crate::numerics::order;
use crate::numerics::symmetric::Unseen;
use crate::numerics::workers;

/// An explanation of a session, as users write it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Explained {
    /// Its effects, as `curvature@a22`, beside the terms of the session.
    pub effects: Vec<String>,
    /// Penalised χ².
    pub chi2: f64,
    /// Probability among the explanations.
    pub probability: f64,
}

/// An explanation, linear at the common point.
pub(crate) struct Side<'a> {
    fit: &'a Fit,
    pub(crate) columns: Vec<usize>,
    theta: Vec<f64>,
    /// Of the session and of priors.
    pub(crate) information: Mat<f64>,
    /// Of priors.
    pub(crate) priors: Mat<f64>,
    /// What no pose could show.
    pub(crate) held: Unseen,
}

impl<'a> Side<'a> {
    pub(crate) fn of(at: &Linearised<'_>, fit: &'a Fit, old: &Whitened) -> Self {
        let columns = at.columns_of(&fit.model);
        let theta = columns.iter().zip(&fit.beta).map(|(&c, b)| b - at.beta[c]).collect();
        let n = columns.len();
        let mut priors = Mat::zeros(n, n);
        for prior in &fit.priors {
            let slopes = prior.slopes(&fit.beta);
            for &(i, a) in &slopes {
                for &(j, b) in &slopes {
                    priors[(i, j)] += a * b;
                }
            }
        }
        let held = Unseen::of(&Mat::identity(n, n));
        let information = Mat::zeros(n, n);
        let mut side = Self { fit, columns, theta, information, priors, held };
        side.information = side.told(old) + &side.priors;
        side
    }

    /// What rows tell. What noise and play seem to tell of conventions is nothing that more poses could add to;
    /// and the rows of all explanations are those at one point, at which the loops of one may stay open.
    fn told(&self, rows: &Whitened) -> Mat<f64> {
        self.fit.conventions.out_of(rows.select(&self.columns).gram())
    }

    /// Holds what neither the session nor any of these poses tells, such as the place of the whole:
    /// a plan for it would be made of rounding.
    pub(crate) fn hold(&mut self, rows: &Whitened) {
        self.held = Unseen::of(&(&self.information + self.told(rows)));
        self.information += self.held.holds.transpose() * &self.held.holds;
    }
}

pub(crate) fn contest_of(rivals: &[Explained], sides: &[Side<'_>]) -> Contest {
    let one = |(r, s): (&Explained, &Side<'_>)| Rival {
        theta: s.theta.clone(),
        information: s.information.clone(),
        probability: r.probability,
        chi2: r.chi2,
    };
    Contest::new(rivals.iter().zip(sides).map(one).collect())
}

/// Leaves of rivals that no pose tells apart the likelier one, with the probability of both: the
/// numbers of those that are left, and pairs of the merged one and the one that it is merged with.
/// All candidates are visited `now`, and `later` after a pause where time matters.
pub(crate) fn merge(
    contest: &mut Contest,
    sides: &[Side<'_>],
    now: &Whitened,
    later: Option<&Whitened>,
) -> (Vec<usize>, Vec<[usize; 2]>) {
    let mut probed = contest.clone();
    for rows in std::iter::once(now).chain(later) {
        let each: Vec<Whitened> = sides.iter().map(|s| rows.select(&s.columns)).collect();
        for k in 0..rows.len() {
            probed.visit(&of_each(&each, k));
        }
    }
    let mut rivals = contest.rivals.clone();
    let mut kept: Vec<usize> = Vec::new();
    let mut merged = Vec::new();
    for b in 0..sides.len() {
        // One may imitate the other but not the other way round: then the truth can be told. Of those that all
        // candidates together do not decide between, one is left.
        let same = |&a: &usize| probed.lambda(a, b).max(probed.lambda(b, a)) < DECIDED;
        match kept.iter().copied().find(same) {
            Some(a) => {
                rivals[a].probability += rivals[b].probability;
                merged.push([b, a]);
            }
            None => kept.push(b),
        }
    }
    *contest = Contest::new(kept.iter().map(|&k| rivals[k].clone()).collect());
    (kept, merged)
}

pub(crate) fn select(rows: &Whitened, sides: &[&Side<'_>]) -> Vec<Whitened> {
    sides.iter().map(|s| rows.select(&s.columns)).collect()
}

pub(crate) fn of_each(rows: &[Whitened], candidate: usize) -> Vec<&[f64]> {
    rows.iter().map(|r| r.of(candidate)).collect()
}

/// The pair whose `λ` grows most in what (96) weighs.
pub(crate) fn tells(gains: &[f64], kept: &[usize], contest: &Contest) -> Purpose {
    let m = kept.len();
    let weight = |ab: usize| {
        let (a, b) = (ab / m, ab % m);
        let both = contest.rivals[a].probability * contest.rivals[b].probability;
        both.sqrt() * gains[ab] * (-contest.lambda(a, b) / 8.0).exp()
    };
    let pairs = (0..m * m).filter(|ab| ab / m != ab % m);
    let best = pairs.greatest_by(|x| weight(*x)).unwrap_or_default();
    Purpose::Tells { apart: [kept[best / m], kept[best % m]], gain: gains[best] }
}

/// The candidates with the least (96), each alone.
pub(crate) fn most_telling(contest: &Contest, rows: &[Whitened], count: usize) -> Vec<usize> {
    let field = Field::new(contest, rows);
    let score = |k: usize| field.criterion(k);
    let mut scored: Vec<(f64, usize)> = workers::map(0..field.len(), |k| (score(k), k));
    order::ascending(&mut scored, |a| a.0);
    scored.into_iter().take(count).map(|(_, k)| k).collect()
}

//! Levels above what is calibrated: sessions of devices, devices of batches, tools of arms.
//!
//! | here | symbol | |
//! |---|---|---|
//! | `information`, `told` | `H_u`, `h_u` | what a unit, such as a session, tells of its parameters |
//! | `variance` | `T_l` | of the groups of level `l`, diagonal; `T₀` of the units |
//! | `inner`, `through` | `J`, `F = J R S` | of a group |
//! | `shift` | `γ` | mean of all units |
//!
//! ```text
//! β_u - β₀ = γ + Σ_l a_(l, g_l(u)) + e_u,   a_l ~ N(0, T_l),   e ~ N(0, T₀)                     (160)
//! S = Σ Λ,  s = Σ b  of the parts,   R = T^½,   J = (1 + R S R)⁻¹,   Λ = S R J R⁻¹,   b = R⁻¹ J R s  (161)
//! Q = Σ û²/τ²,   k = Σ (1 - Var u/τ²),   k₂ = k - dk/d ln τ²,   Q k/k₂ ~ χ²(k²/k₂)                (162)
//! ```
//!
//! (161) is (121) for a group with its units, or its smaller groups, as what it tells; levels that
//! nest are eliminated one after the other, and cost no more than their groups. Groups that cross,
//! such as tools that several arms carry, are solved together with `γ`. `Q = k` is (124), and the
//! restricted likelihood's maximum; the score `Q - k` has the variance `2 k₂`, from which a `τ²` is
//! within 95 % where the χ² of (162) is, the other variances at their best beside it. Of groups that
//! are known alike this is the exact interval of a variance (Satterthwaite 1946). Without levels the units
//! are the devices, and (161) is (121).

mod grouping;
mod interval;
mod likeliest;
mod solve;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use faer::Mat;

use crate::Error;
use crate::numerics::workers;
use grouping::Grouping;
use interval::interval;
pub(super) use solve::Held;
use solve::Tree;

/// A variance of so much, in units of what the best known group leaves open, is none. Of `G` groups
/// that are known alike a variance is told to `√(2/(G-1))` of this unit: fewer than two million cannot
/// tell it from none. `1 - Var u/τ²` is then this small, and still has 13 digits.
const NONE: f64 = 1e-3;

/// The square of what a class is told with is still a number, else nothing tells it.
const TOLD: f64 = 1e-154;

/// Groups of levels that cross, times parameters, that are solved together. Time grows with the cube:
/// so many take a minute and a half for a parameter (`python -m tests.levels crossed`; docs/fleet.md
/// has the figures), twice as many eight times as long.
const MOST: usize = 2000;

/// How the groups of one level differ.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Spread {
    /// Number of groups.
    pub groups: usize,
    /// Standard deviation between them, beside that of the levels below; none where it cannot be told:
    /// there is one group, the groups are those of another level, or no unit tells the parameter.
    pub sd: Option<f64>,
    /// Interval of 95 %, whose upper end is none where nothing bounds it; none where they differ by
    /// less than what is below makes them.
    pub interval: Option<(f64, Option<f64>)>,
    /// The level with the same groups, 0 the units themselves, the first level 1.
    pub same_as: Option<usize>,
}

impl Spread {
    /// The same in a unit of which one of these has so many.
    pub(super) fn times(self, unit: f64) -> Self {
        let interval = self.interval.map(|(low, high)| (low * unit, high.map(|high| high * unit)));
        Self { sd: self.sd.map(|sd| sd * unit), interval, ..self }
    }
}

/// Units with their levels, at the likeliest variances.
#[derive(Debug, Clone)]
pub(super) struct Levels {
    tree: Tree,
    /// `ln τ²` of each rank and class.
    best: Vec<f64>,
}

/// `S` and `s` of a group.
pub(super) type Sum = (Mat<f64>, Vec<f64>);

impl Levels {
    /// Of units with `H` and `h`; `levels` says for each level in which group each unit is.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for a level that does not have a group for each unit, [`Error::Option`] for more
    /// groups that cross than can be solved together.
    pub(super) fn new(
        information: &[Mat<f64>],
        told: &[Vec<f64>],
        class: &[usize],
        levels: &[Vec<usize>],
        held: f64,
    ) -> Result<Self, Error> {
        let (units, n) = (told.len(), class.len());
        for level in levels {
            Error::same("groups of a level", level.len(), units)?;
        }
        let grouping = Grouping::new(units, levels);
        let together = n * grouping.crossing();
        if together > MOST {
            let found = format!("{together} values of levels that cross");
            return Err(Error::option("levels", found, "levels that nest, or fewer groups"));
        }
        let classes = class.iter().max().map_or(0, |c| c + 1);
        // What the best known group of each rank leaves open of each class.
        let mut open = Vec::new();
        for (groups, &count) in grouping.of_unit.iter().zip(&grouping.counts) {
            let mut sums = vec![0.0; count * n];
            for (&group, h) in groups.iter().zip(information) {
                (0..n).for_each(|i| sums[group * n + i] += h[(i, i)]);
            }
            let mut largest = vec![0.0_f64; classes];
            for (i, &sum) in sums.iter().enumerate() {
                largest[class[i % n]] = largest[class[i % n]].max(sum);
            }
            open.extend(largest.iter().map(|&most| (most > TOLD).then(|| -most.ln())));
        }
        let tree = Tree {
            grouping: Arc::new(grouping),
            class: class.to_vec(),
            classes,
            held,
            information: information
                .iter()
                .flat_map(|h| (0..n * n).map(move |ij| h[(ij / n, ij % n)]))
                .collect(),
            told: told.concat(),
            least: open.iter().map(|open| open.map(|ln| ln + NONE.ln())).collect(),
        };
        let start = open.iter().map(|open| open.unwrap_or(0.0)).collect();
        let best = tree.fit(start, None).0;
        Ok(Self { tree, best })
    }

    /// The same without the units of some of the largest groups, which tell nothing.
    pub(super) fn without(&self, out: &[bool]) -> Self {
        let mut tree = self.tree.clone();
        let n = tree.class.len();
        for (unit, group) in self.largest().into_iter().enumerate().filter(|(_, g)| out[*g]) {
            debug_assert!(out[group]);
            tree.information[unit * n * n..(unit + 1) * n * n].fill(0.0);
            tree.told[unit * n..(unit + 1) * n].fill(0.0);
        }
        let best = tree.fit(self.best.clone(), None).0;
        Self { tree, best }
    }

    /// True where no levels cross: the largest groups are then independent.
    pub(super) fn nests(&self) -> bool {
        self.tree.grouping.crossed.is_empty()
    }

    /// The level of the largest groups that nest among those that were given; none for the units.
    pub(super) fn level(&self) -> Option<usize> {
        let grouping = &self.tree.grouping;
        grouping.place.iter().position(|place| *place == Some(grouping.depth() - 1))
    }

    /// In which of the largest groups that nest each unit is.
    pub(super) fn largest(&self) -> Vec<usize> {
        self.tree.grouping.of_unit[self.tree.grouping.depth() - 1].clone()
    }

    /// What each of the largest groups that nest tells at the variances of other levels of the same
    /// units.
    pub(super) fn devices(&self, at: &Self) -> Vec<Sum> {
        let n = self.tree.class.len();
        let sums = self.tree.largest(&at.best);
        let one = |(s, b): (&[f64], &[f64])| (Mat::from_fn(n, n, |i, j| s[i * n + j]), b.to_vec());
        sums.lambda.chunks(n * n).zip(sums.b.chunks(n)).map(one).collect()
    }

    /// (121) of each of the largest groups that nest, at the variances of other levels of the same units.
    pub(super) fn held(&self, at: &Self) -> Vec<Held> {
        let root = at.tree.root_of_largest(&at.best);
        self.devices(at).into_iter().map(|(s, b)| Held::of(&root, &s, b)).collect()
    }

    /// Variance of each class between the largest groups that nest.
    pub(super) fn top(&self) -> Vec<f64> {
        self.variances(self.tree.grouping.depth() - 1)
    }

    /// Variance of each class from one unit to one of other groups: of all levels together.
    pub(super) fn total(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.tree.classes];
        for rank in 0..self.tree.grouping.counts.len() {
            sums.iter_mut().zip(self.variances(rank)).for_each(|(s, v)| *s += v);
        }
        sums
    }

    fn variances(&self, rank: usize) -> Vec<f64> {
        (0..self.tree.classes).map(|c| self.variance(rank, c).unwrap_or(0.0)).collect()
    }

    /// None of a class that no unit tells.
    fn variance(&self, rank: usize, c: usize) -> Option<f64> {
        let one = rank * self.tree.classes + c;
        let least = self.tree.least[one]?;
        Some(if self.best[one] <= least { 0.0 } else { self.best[one].exp() })
    }

    /// The mean of each parameter, and its covariance.
    pub(super) fn mean(&self) -> (Vec<f64>, Mat<f64>) {
        let at = self.tree.at(&self.best);
        (at.shift, at.eliminated.covariance(self.tree.n()))
    }

    /// How the groups of each level differ, units first, and each class in it.
    pub(super) fn spreads(&self) -> Vec<Vec<Spread>> {
        let (grouping, classes) = (&self.tree.grouping, self.tree.classes);
        let all = workers::map(0..self.best.len(), |one| interval(&self.tree, &self.best, one));
        let units = ((grouping.counts[0], None), Some(0));
        let levels = grouping.given.iter().zip(&grouping.place).map(|(given, p)| (*given, *p));
        let told = |((groups, same_as), place): ((usize, Option<usize>), Option<usize>)| {
            let one = |c: usize| Spread {
                groups,
                sd: place.and_then(|rank| self.variance(rank, c)).map(f64::sqrt),
                interval: place.and_then(|rank| all[rank * classes + c]),
                same_as,
            };
            (0..classes).map(one).collect()
        };
        std::iter::once(units).chain(levels).map(told).collect()
    }
}

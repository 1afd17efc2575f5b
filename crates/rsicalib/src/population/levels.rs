//! Levels above what is calibrated: sessions of devices, devices of batches, tools of arms.
//!
//! | here | symbol | |
//! |---|---|---|
//! | `information`, `told` | `H_u`, `h_u` | what a unit, such as a session, tells of its parameters |
//! | `variance` | `T_l` | of the groups of level `l`, diagonal; `T₀` of the units |
//! | `inner`, `through`, `own` | `J`, `F`, `y` | of a group |
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
//! are known alike this is the exact interval of a variance (Satterthwaite 1946).

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

use crate::Error;
use crate::numerics::distributions::{chi2_tail, normal_quantile};
use crate::numerics::symmetric::invert;

/// Rounds of (124), at most.
const ROUNDS: usize = 500;

/// Variances change by less than this, in parts, where (124) has converged.
const CONVERGED: f64 = 1e-5;

/// A variance of so much, in units of what the best known group leaves open, is none.
const NONE: f64 = 1e-3;

/// Part by which a variance is changed for the derivative of `k`.
const STEP: f64 = 1e-3;

/// Groups of levels that cross, times parameters, that are solved together.
const MOST: usize = 2000;

/// How the groups of one level differ.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Spread {
    /// Number of groups.
    pub groups: usize,
    /// Standard deviation between them, beside that of the levels below; none where it cannot be told:
    /// there is one group, or the groups are those of another level.
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

/// Units with their levels.
pub struct Levels<'a> {
    information: &'a [Mat<f64>],
    told: &'a [Vec<f64>],
    class: &'a [usize],
    /// Precision of `γ` beforehand.
    held: f64,
    /// Numbers of groups of each level that was given, and the level that has the same ones.
    given: Vec<(usize, Option<usize>)>,
    /// Where a level that was given is among those that are told apart, units first.
    place: Vec<Option<usize>>,
    /// Groups of the parts of each level that nests in all larger ones; the first has a unit each.
    nested: Vec<Vec<usize>>,
    /// Groups of the last of these in each level that crosses, and how many there are.
    crossed: Vec<(Vec<usize>, usize)>,
    /// Least variance of each level and class.
    least: Vec<Vec<f64>>,
}

/// What one group of a nested level tells, and what is known of it.
#[derive(Default)]
struct Group {
    inner: Vec<f64>,
    through: Vec<f64>,
    own: Vec<f64>,
}

/// The state of all levels at some variances.
struct At {
    /// `Q` and `k` of each level and class.
    told: Vec<Vec<[f64; 2]>>,
    /// `γ`
    shift: Vec<f64>,
}

/// `Λ` and `b` of the groups of a level.
pub(super) type Sums = Vec<(Vec<f64>, Vec<f64>)>;

impl<'a> Levels<'a> {
    /// Of units with `H` and `h`; `levels` says for each level in which group each unit is.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for a level that does not have a group for each unit, [`Error::Option`] for more
    /// groups that cross than can be solved together.
    pub fn new(
        information: &'a [Mat<f64>],
        told: &'a [Vec<f64>],
        class: &'a [usize],
        levels: &[Vec<usize>],
        held: f64,
    ) -> Result<Self, Error> {
        let units = told.len();
        if let Some(level) = levels.iter().find(|level| level.len() != units) {
            let what = "groups of a level".into();
            return Err(Error::Shape { what, found: level.len(), expected: units });
        }
        let mut kinds: Vec<(Vec<usize>, usize)> = vec![((0..units).collect(), units)];
        let mut given = Vec::new();
        let mut place = Vec::new();
        for level in levels {
            let (groups, count) = numbered(level);
            let same = kinds.iter().position(|kind| kind.0 == groups);
            let told = count > 1 && same.is_none();
            given.push((count, same.filter(|_| count > 1)));
            place.push(told.then_some(kinds.len()));
            kinds.push((groups, count));
        }
        let of_units = kinds[0].0.clone();
        let mut order: Vec<usize> = place.iter().flatten().copied().collect();
        order.sort_by_key(|&k| std::cmp::Reverse(kinds[k].1));
        let (mut nested, mut crossed) = (vec![of_units.clone()], Vec::new());
        let mut ranks = vec![0];
        // The group of the last nested level in which each unit is.
        let mut last = of_units;
        for (n, &k) in order.iter().enumerate() {
            let larger = |&other: &usize| within(&kinds[k].0, &kinds[other].0);
            if crossed.is_empty() && order[n + 1..].iter().all(larger) {
                nested.push(above(&last, &kinds[k].0));
                last.clone_from(&kinds[k].0);
                ranks.push(k);
            } else {
                crossed.push(k);
            }
        }
        ranks.extend(&crossed);
        let together = class.len() * crossed.iter().map(|&k| kinds[k].1).sum::<usize>();
        if together > MOST {
            let found = format!("{together} values of levels that cross");
            return Err(Error::option("levels", found, "levels that nest, or fewer groups"));
        }
        let crossed: Vec<_> =
            crossed.iter().map(|&k| (above(&last, &kinds[k].0), kinds[k].1)).collect();
        let place = place.iter().map(|p| p.and_then(|k| ranks.iter().position(|&r| r == k)));
        let place = place.collect();
        let most = |k: &usize| {
            let (groups, count) = &kinds[*k];
            let mut sums = vec![vec![0.0; class.len()]; *count];
            for (&group, h) in groups.iter().zip(information) {
                (0..class.len()).for_each(|i| sums[group][i] += h[(i, i)]);
            }
            let classes = class.iter().max().map_or(0, |c| c + 1);
            let mut largest = vec![f64::MIN_POSITIVE; classes];
            for sum in &sums {
                class.iter().zip(sum).for_each(|(&c, s)| largest[c] = largest[c].max(*s));
            }
            largest.iter().map(|most| NONE / most).collect()
        };
        let least = ranks.iter().map(most).collect();
        Ok(Self { information, told, class, held, given, place, nested, crossed, least })
    }

    /// True where no levels cross: the largest groups are then independent.
    #[must_use]
    pub fn nests(&self) -> bool {
        self.crossed.is_empty()
    }

    /// The level of the largest groups that nest among those that were given; none for the units.
    pub(super) fn level(&self) -> Option<usize> {
        self.place.iter().position(|place| *place == Some(self.nested.len() - 1))
    }

    /// What each of the largest groups tells, where levels nest.
    pub(super) fn devices(&self) -> Option<Sums> {
        self.nests().then(|| self.climb(&self.fitted(), self.nested.len() - 1).0)
    }

    /// In which of the largest groups each unit is, where levels nest.
    pub(super) fn largest(&self) -> Vec<usize> {
        let mut at = self.nested[0].clone();
        for up in &self.nested[1..] {
            at.iter_mut().for_each(|group| *group = up[*group]);
        }
        at
    }

    /// Variances that are likeliest.
    fn fitted(&self) -> Vec<Vec<f64>> {
        let start = self.least.iter().map(|own| own.iter().map(|l| l / NONE).collect()).collect();
        self.fit(start, None)
    }

    fn fit(&self, mut variance: Vec<Vec<f64>>, held: Option<(usize, usize)>) -> Vec<Vec<f64>> {
        for _ in 0..ROUNDS {
            let at = self.at(&variance);
            let mut moved: f64 = 0.0;
            for (level, own) in variance.iter_mut().enumerate() {
                for (c, old) in
                    own.iter_mut().enumerate().filter(|(c, _)| held != Some((level, *c)))
                {
                    let [q, k] = at.told[level][c];
                    let next = *old * q / k.max(f64::MIN_POSITIVE);
                    let next = next.clamp(self.least[level][c], f64::MAX.sqrt());
                    moved = moved.max((next / *old).ln().abs());
                    *old = next;
                }
            }
            if moved < CONVERGED {
                break;
            }
        }
        variance
    }

    /// `S` and `s` of the groups of a level; what was eliminated below.
    fn climb(&self, variance: &[Vec<f64>], upto: usize) -> (Sums, Vec<Vec<Group>>) {
        let n = self.class.len();
        let flat = |h: &Mat<f64>| (0..n * n).map(|ij| h[(ij / n, ij % n)]).collect();
        let mut parts: Sums =
            self.information.iter().zip(self.told).map(|(h, t)| (flat(h), t.clone())).collect();
        let mut all = Vec::new();
        for (level, up) in self.nested.iter().enumerate() {
            let mut sums: Sums = Vec::new();
            for ((lambda, b), &group) in parts.iter().zip(up) {
                if sums.len() <= group {
                    sums.resize(group + 1, (vec![0.0; n * n], vec![0.0; n]));
                }
                sums[group].0.iter_mut().zip(lambda).for_each(|(s, l)| *s += l);
                sums[group].1.iter_mut().zip(b).for_each(|(s, b)| *s += b);
            }
            if level == upto {
                return (sums, all);
            }
            let root = self.root(&variance[level]);
            let groups = sums.iter_mut().map(|(s, b)| eliminate(&root, s, b)).collect();
            all.push(groups);
            parts = sums;
        }
        (parts, all)
    }

    fn root(&self, variance: &[f64]) -> Vec<f64> {
        self.class.iter().map(|&c| variance[c].sqrt()).collect()
    }

    /// All levels at some variances.
    fn at(&self, variance: &[Vec<f64>]) -> At {
        let (n, depth) = (self.class.len(), self.nested.len());
        let (tops, all) = self.climb(variance, depth);
        let mut told = vec![vec![[0.0; 2]; variance[0].len()]; variance.len()];

        // `γ` and the groups that cross.
        let starts: Vec<usize> = self
            .crossed
            .iter()
            .scan(1, |next, (_, count)| Some(std::mem::replace(next, *next + count)))
            .collect();
        let blocks = |top: usize| {
            let own = self.crossed.iter().zip(&starts).map(move |(level, s)| s + level.0[top]);
            std::iter::once(0).chain(own).collect::<Vec<_>>()
        };
        let size = n * (1 + self.crossed.iter().map(|(_, count)| count).sum::<usize>());
        let mut root = vec![1.0; size];
        for (k, (start, (_, count))) in starts.iter().zip(&self.crossed).enumerate() {
            let own = self.root(&variance[depth + k]);
            (0..n * count).for_each(|i| root[n * start + i] = own[i % n]);
        }
        let (mut gram, mut right) = (Mat::<f64>::zeros(size, size), vec![0.0; size]);
        for (top, (lambda, b)) in tops.iter().enumerate() {
            let own = blocks(top);
            for &p in &own {
                for i in 0..n {
                    right[n * p + i] += root[n * p + i] * b[i];
                    for (&o, j) in own.iter().flat_map(|o| (0..n).map(move |j| (o, j))) {
                        let by = root[n * p + i] * root[n * o + j];
                        gram[(n * p + i, n * o + j)] += by * lambda[n * i + j];
                    }
                }
            }
        }
        (0..size).for_each(|i| gram[(i, i)] += if i < n { self.held } else { 1.0 });
        let inverse =
            gram.llt(Side::Lower).map_or_else(|_| invert(&gram).0, |factor| factor.inverse());
        let of = |i: usize| (0..size).map(|j| inverse[(i, j)] * right[j]).sum::<f64>();
        let found: Vec<f64> = (0..size).map(of).collect();
        for (k, (start, (_, count))) in starts.iter().zip(&self.crossed).enumerate() {
            for i in n * start..n * (start + count) {
                let own = &mut told[depth + k][self.class[i % n]];
                own[0] += found[i].powi(2);
                own[1] += 1.0 - inverse[(i, i)];
            }
        }

        // Down again: the mean of what is above a group, and its covariance.
        let mut above: Sums = (0..tops.len())
            .map(|top| {
                let own = blocks(top);
                let at = |p: usize, i: usize| n * p + i;
                let mean =
                    |i: usize| own.iter().map(|&p| root[at(p, i)] * found[at(p, i)]).sum::<f64>();
                let both = |i: usize, j: usize| {
                    let pairs = own.iter().flat_map(|&p| own.iter().map(move |&o| (p, o)));
                    pairs
                        .map(|(p, o)| {
                            root[at(p, i)] * inverse[(at(p, i), at(o, j))] * root[at(o, j)]
                        })
                        .sum::<f64>()
                };
                let covariance = (0..n * n).map(|ij| both(ij / n, ij % n)).collect();
                (covariance, (0..n).map(mean).collect())
            })
            .collect();
        for level in (0..depth).rev() {
            let root = self.root(&variance[level]);
            for (group, (covariance, mean)) in all[level].iter().zip(&mut above) {
                let (w, spread) = group.down(&root, covariance, mean);
                for (i, &c) in self.class.iter().enumerate() {
                    told[level][c][0] += w[i].powi(2);
                    told[level][c][1] += 1.0 - spread[i];
                }
            }
            if level > 0 {
                above = self.nested[level].iter().map(|&up| above[up].clone()).collect();
            }
        }
        At { told, shift: found[..n].to_vec() }
    }

    /// Probability of a smaller `Q` of a level and class, as a normal deviate: (162).
    fn deviate(&self, variance: &[Vec<f64>], level: usize, c: usize) -> f64 {
        let changed = |by: f64| {
            let mut other = variance.to_vec();
            other[level][c] *= by;
            self.at(&other).told[level][c]
        };
        let [q, k] = changed(1.0);
        let slope = (changed(1.0 + STEP)[1] - changed(1.0 - STEP)[1]) / (2.0 * STEP);
        let k2 = (k - slope).max(f64::MIN_POSITIVE);
        let tail = chi2_tail(q * k / k2, k * k / k2);
        normal_quantile(tail.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON))
    }

    /// Mean and standard deviation of the only parameter of each of the largest groups, where levels
    /// nest.
    pub(super) fn means(&self) -> Option<Vec<(f64, f64)>> {
        let whole = self.nested.len();
        let told =
            |(lambda, b): &(Vec<f64>, Vec<f64>)| (b[0] / lambda[0], lambda[0].sqrt().recip());
        self.nests().then(|| self.climb(&self.fitted(), whole).0.iter().map(told).collect())
    }

    /// The mean of the only parameter.
    pub(super) fn mean(&self) -> f64 {
        self.at(&self.fitted()).shift[0]
    }

    /// How the groups of each level differ, units first, and each class in it.
    #[must_use]
    pub fn spreads(&self) -> Vec<Vec<Spread>> {
        let best = self.fitted();
        let classes = best[0].len();
        let units = (self.told.len(), None);
        let levels = self.given.iter().zip(&self.place).map(|(given, place)| (*given, *place));
        std::iter::once((units, Some(0)))
            .chain(levels)
            .map(|((groups, same_as), place)| {
                let one = |c: usize| match place {
                    Some(level) => {
                        let variance = best[level][c];
                        let none = variance <= self.least[level][c];
                        let sd = Some(if none { 0.0 } else { variance.sqrt() });
                        Spread { groups, sd, interval: self.interval(&best, level, c), same_as }
                    }
                    None => Spread { groups, sd: None, interval: None, same_as },
                };
                (0..classes).map(one).collect()
            })
            .collect()
    }

    fn interval(&self, best: &[Vec<f64>], level: usize, c: usize) -> Option<(f64, Option<f64>)> {
        let edge = normal_quantile(0.975);
        let least = self.least[level][c].ln();
        let mut beside = best.to_vec();
        let mut at = |ln: f64| {
            beside[level][c] = ln.exp();
            beside = self.fit(std::mem::take(&mut beside), Some((level, c)));
            self.deviate(&beside, level, c)
        };
        let first = at(least);
        if first > edge {
            return None;
        }
        // The deviate grows with the variance, from `first` on.
        let mut below = [least, first];
        let mut ends = [Some(0.0), Some(0.0)];
        for (end, to) in ends.iter_mut().zip([-edge, edge]) {
            if below[1] >= to {
                continue;
            }
            let middle = best[level][c].ln().max(below[0]);
            let mut above = [middle, at(middle)];
            while above[1] < to && above[0] < middle + FARTHEST {
                below = above;
                let next = above[0] + 1.0;
                above = [next, at(next)];
            }
            let root = (above[1] >= to).then(|| crossing(below, above, to, &mut at));
            *end = root.map(|ln| (0.5 * ln).exp());
            below = [root.unwrap_or(below[0]), to];
        }
        Some((ends[0].unwrap_or(0.0), ends[1]))
    }
}

/// Units of `ln τ²` above the best one in which an upper end is looked for: a factor of 3,000 of `τ`.
const FARTHEST: f64 = 16.0;

/// Where a function that grows from below `to` to above it passes it; to a part in 10,000 of its value.
fn crossing(mut low: [f64; 2], mut high: [f64; 2], to: f64, f: &mut dyn FnMut(f64) -> f64) -> f64 {
    for round in 0..40 {
        // A chord, and a half in turn: the function is nearly straight, or bends at one end.
        let part = (to - low[1]) / (high[1] - low[1]);
        let part = if round % 3 == 2 || !part.is_finite() { 0.5 } else { part.clamp(0.02, 0.98) };
        let x = low[0] + part * (high[0] - low[0]);
        let y = f(x);
        if (y - to).abs() < 1e-4 || high[0] - low[0] < 1e-6 {
            return x;
        }
        if y < to {
            low = [x, y];
        } else {
            high = [x, y];
        }
    }
    0.5 * (low[0] + high[0])
}

impl Group {
    /// `û` and `Var u` over their deviations, below a mean with its covariance, which become those of
    /// the sum with `u`.
    fn down(&self, root: &[f64], covariance: &mut [f64], mean: &mut [f64]) -> (Vec<f64>, Vec<f64>) {
        let n = root.len();
        let product = |a: &[f64], b: &[f64]| {
            let at = |ij: usize| (0..n).map(|k| a[ij / n * n + k] * b[k * n + ij % n]).sum();
            (0..n * n).map(at).collect::<Vec<f64>>()
        };
        let f = &self.through;
        let seen = |i: usize| (0..n).map(|j| f[i * n + j] * mean[j]).sum::<f64>();
        let w: Vec<f64> = (0..n).map(|i| self.own[i] - seen(i)).collect();
        let fp = product(f, covariance);
        let turned: Vec<f64> = (0..n * n).map(|ij| f[ij % n * n + ij / n]).collect();
        let own: Vec<f64> =
            self.inner.iter().zip(product(&fp, &turned)).map(|(j, more)| j + more).collect();
        for i in 0..n {
            mean[i] += root[i] * w[i];
            for j in 0..n {
                // With `a = R (y - F m)`, Cov(m, a) = -P Fᵀ R.
                let cross = root[i] * fp[i * n + j] + root[j] * fp[j * n + i];
                covariance[i * n + j] += root[i] * own[i * n + j] * root[j] - cross;
            }
        }
        (w, (0..n).map(|i| own[i * n + i]).collect())
    }
}

/// (161): turns `S` and `s` of a group into its `Λ` and `b`, and keeps what the way down needs.
fn eliminate(root: &[f64], sum: &mut [f64], b: &mut [f64]) -> Group {
    let n = root.len();
    let at = |i: usize, j: usize| i * n + j;
    let mut inner: Vec<f64> = (0..n * n).map(|ij| root[ij / n] * sum[ij] * root[ij % n]).collect();
    (0..n).for_each(|i| inner[at(i, i)] += 1.0);
    invert_in_place(&mut inner, n);
    // J R S and J R s
    let rows = |i: usize, right: &dyn Fn(usize) -> f64| -> f64 {
        (0..n).map(|k| inner[at(i, k)] * root[k] * right(k)).sum()
    };
    let through: Vec<f64> = (0..n * n).map(|ij| rows(ij / n, &|k| sum[at(k, ij % n)])).collect();
    let own: Vec<f64> = (0..n).map(|i| rows(i, &|k| b[k])).collect();
    // Λ = S R J R⁻¹ is the transpose of R⁻¹ J R S, and takes no difference of what is nearly the same.
    let lambda = |i: usize, j: usize| through[at(j, i)] / root[j];
    for i in 0..n {
        for j in 0..n {
            sum[at(i, j)] = 0.5 * (lambda(i, j) + lambda(j, i));
        }
        b[i] = own[i] / root[i];
    }
    Group { inner, through, own }
}

/// Inverse of a symmetric matrix of at least 1 in all directions, by Gauss and Jordan.
fn invert_in_place(a: &mut [f64], n: usize) {
    for p in 0..n {
        let pivot = a[p * n + p].recip();
        a[p * n + p] = 1.0;
        a[p * n..(p + 1) * n].iter_mut().for_each(|v| *v *= pivot);
        for i in (0..n).filter(|i| *i != p) {
            let factor = std::mem::take(&mut a[i * n + p]);
            for j in 0..n {
                a[i * n + j] -= factor * a[p * n + j];
            }
        }
    }
}

/// Groups numbered in the order in which they come, and how many there are.
fn numbered(groups: &[usize]) -> (Vec<usize>, usize) {
    let mut seen = std::collections::HashMap::new();
    let number = |group: &usize| {
        let next = seen.len();
        *seen.entry(*group).or_insert(next)
    };
    (groups.iter().map(number).collect(), seen.len())
}

/// True where each of `groups` is in one of `larger`.
fn within(groups: &[usize], larger: &[usize]) -> bool {
    let mut of = std::collections::HashMap::new();
    groups.iter().zip(larger).all(|(group, more)| of.entry(group).or_insert(more) == &more)
}

/// The group of `larger` in which each of `groups` is, by its number.
fn above(groups: &[usize], larger: &[usize]) -> Vec<usize> {
    let mut of = vec![0; groups.iter().max().map_or(0, |m| m + 1)];
    groups.iter().zip(larger).for_each(|(&group, &more)| of[group] = more);
    of
}

//! Channels that are noisier than the others, or quieter.
//!
//! The misclosure of a sample has the covariance `V = v₀ B + Σ_c v_c b_c b_cᵀ`, where `b_c`
//! is its derivative by channel `c`, `v_c` the variance of a channel that stands apart,
//! and `B` what the others give at unit scale; in a recording, where every row has its own, the play
//! of the closures adds to it as it is declared. Within a group of `n` samples it shows as products
//! `W` with `ν = n - o` degrees of freedom, so that (restricted) maximum likelihood has, for
//! `V' = ∂V/∂v`,
//!
//! ```text
//! g = ½ Σ tr V⁻¹ V'_i V⁻¹ (W - ν V),    I = ½ Σ ν tr V⁻¹ V'_i V⁻¹ V'_j     (65)
//! ```
//!
//! Channels are alike until `g² / I` says otherwise, then stand apart one by one; those in coarse
//! steps of their own stand apart from the start. So does a length that is read with every sample and
//! declares no noise: `b_c` is then the derivative by that length. A length that declares its noise has
//! what it declares until the same test says otherwise.

use crate::numerics::order::Ends;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::estimate::noise::scatter::Groups;
use crate::estimate::objective::Noise;
use crate::estimate::residuals::Residuals;
use crate::numerics::order;
use crate::numerics::{distributions, thin};

/// Probability of setting a channel apart where all are alike.
const ALPHA: f64 = 1e-3;

/// So many groups are enough to tell.
const ENOUGH_GROUPS: usize = 400;

/// One in so many groups may be strange without setting a channel apart: a bad sample
/// is not a noisy channel.
const STRANGE: usize = 10;

/// Probability that any group of sound samples is taken for a gross one.
const GROSS: f64 = 1e-4;

/// More than one in so many groups are not gross: that is how they scatter.
const MOST_GROSS: usize = 4;

/// Least part of a variance at which it is taken for none.
const LEAST: f64 = 1e-12;

/// Score, in standard deviations, that must be left without the strange groups.
const WITHOUT: f64 = 1.5;

/// What is declared or presumed of the noise, up to a common scale, and its least variances.
#[derive(Debug, Clone)]
pub struct Alike {
    /// Where no channel stands apart.
    pub noise: Noise,
    /// Variance of the rounding of each channel.
    pub floor: Vec<f64>,
    /// Channels that stand apart whatever they show.
    pub apart: Vec<bool>,
    /// Lengths and coordinates that are read with every sample.
    pub lengths: Vec<Length>,
    /// True where the noise of the channels is known: only that of the lengths is told.
    pub known: bool,
}

/// A length, or a coordinate of a point, that is read with every sample: those of one point have the same
/// noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// Number of its closure among those of samples.
    pub closure: usize,
    /// Number of its equation.
    pub equation: usize,
    /// Variance that whitens the residuals, length units squared.
    pub variance: f64,
    /// Variance that it declares, zero where it declares none.
    pub declared: f64,
}

/// Groups by which channels are told apart.
fn looked_at(groups: &Groups) -> impl Iterator<Item = &Vec<usize>> {
    let useful: Vec<_> = groups.rows.iter().filter(|rows| rows.len() > groups.order).collect();
    thin::spread(useful.len(), ENOUGH_GROUPS).map(move |group| useful[group])
}

/// The rows of these groups at which derivatives are taken, ascending.
#[must_use]
pub fn rows_looked_at(groups: &Groups) -> Vec<usize> {
    looked_at(groups).map(|rows| middle(rows)).collect()
}

fn middle(rows: &[usize]) -> usize {
    rows[rows.len() / 2]
}

/// The noise channel by channel.
#[derive(Debug, Clone)]
pub struct Told {
    /// Standard deviation of each channel, and the play as it was.
    pub noise: Noise,
    /// Variance of the channels that are alike, over that at unit scale.
    pub common: f64,
    /// How many channels stand apart.
    pub apart: usize,
}

/// The noise channel by channel; none where all are alike. `share` of the degrees of freedom are
/// independent.
#[must_use]
pub fn by_channel(
    groups: &Groups,
    residuals: &Residuals,
    used: &Noise,
    alike: &Alike,
    share: f64,
) -> Option<Told> {
    let seen = Seen::of(groups, residuals, used, alike);
    let channels = alike.noise.sigma.len();
    let mut variances = Variances::new(seen.units.len(), alike.known);
    let lengths = channels..seen.units.len();
    for c in (0..channels).filter(|&c| alike.apart[c]).chain(lengths) {
        variances.own[c] = Some(seen.unit(c));
        variances.declared[c] = c >= channels && alike.lengths[c - channels].declared > 0.0;
    }
    let open = |variances: &Variances, c: usize| {
        variances.declared[c] || (!alike.known && variances.own[c].is_none())
    };
    let count = (0..seen.units.len()).filter(|&c| open(&variances, c)).count();
    let limit = distributions::two_sided_limit(ALPHA, count.max(1));
    loop {
        variances.maximise(&seen)?;
        if !(0..seen.units.len()).any(|c| open(&variances, c)) {
            break;
        }
        let scores = seen.scores(&variances)?;
        let sure = |c: &usize| {
            let (all, rest) = scores[*c];
            (all * share.sqrt()).abs() > limit && all * rest > 0.0 && rest.abs() > WITHOUT
        };
        let found = (0..seen.units.len())
            .filter(|&c| open(&variances, c))
            .filter(sure)
            .greatest_by(|a| scores[*a].0.abs());
        match found {
            Some(c) if variances.declared[c] => variances.declared[c] = false,
            // One channel less than there are says it all.
            Some(c) if alike.known || variances.apart() + 1 < seen.units.len() => {
                variances.own[c] = Some(variances.common * seen.unit(c));
            }
            _ => break,
        }
    }
    let noise = variances.noise(alike);
    let apart = variances.own[..channels].iter().flatten().count();
    (variances.apart() > 0).then_some(Told { noise, common: variances.common, apart })
}

/// Common scale, and the variance of each channel that stands apart.
#[derive(Debug, Clone)]
struct Variances {
    common: f64,
    /// True where the common scale is known.
    known: bool,
    own: Vec<Option<f64>>,
    /// True where the own variance is what is declared, and stays.
    declared: Vec<bool>,
}

impl Variances {
    fn new(columns: usize, known: bool) -> Self {
        Self { common: 1.0, known, own: vec![None; columns], declared: vec![false; columns] }
    }

    /// True for a column whose own variance is told.
    fn is_apart(&self, column: usize) -> bool {
        self.own[column].is_some() && !self.declared[column]
    }

    fn apart(&self) -> usize {
        (0..self.own.len()).filter(|&c| self.is_apart(c)).count()
    }

    /// The columns of [`ScoreSums`] that belong to it: the scale, then channels that stand apart.
    fn columns(&self) -> Vec<usize> {
        let own = (0..self.own.len()).filter(|&c| self.is_apart(c)).map(|c| c + 1);
        std::iter::once(0).filter(|_| !self.known).chain(own).collect()
    }

    /// Maximum likelihood by scoring, no variance below its rounding.
    fn maximise(&mut self, seen: &Seen) -> Option<()> {
        for _ in 0..60 {
            let sums = seen.sums(self)?;
            let columns = self.columns();
            let step = sums.solve(&columns, |i| sums.gradient[columns[i]])?;
            let mut moved: f64 = 0.0;
            for (&column, step) in columns.iter().zip(step) {
                let (value, floor) = match column {
                    0 => (&mut self.common, seen.common_floor),
                    c => (self.own[c - 1].as_mut()?, seen.floor[c - 1]),
                };
                let next = (*value + step).clamp(0.25 * *value, 4.0 * *value).max(floor);
                moved = moved.max((next / *value - 1.0).abs());
                *value = next;
            }
            if moved < 1e-5 {
                break;
            }
        }
        self.common.is_finite().then_some(())
    }

    fn noise(&self, alike: &Alike) -> Noise {
        let unit = alike.noise.sigma.iter().map(|s| s * self.common.sqrt());
        let sigma: Vec<f64> =
            unit.zip(&self.own).map(|(s, own)| own.map_or(s, f64::sqrt)).collect();
        let Noise { play, mut seating, measured, .. } = alike.noise.clone();
        if !alike.lengths.is_empty() {
            seating.resize(measured.len(), 0.0);
        }
        alike.lengths.iter().for_each(|length| seating[length.closure] = 0.0);
        for (length, own) in alike.lengths.iter().zip(&self.own[sigma.len()..]) {
            let factor = play * measured[length.closure];
            let alike = alike.lengths.iter().filter(|other| other.closure == length.closure);
            let more = own.unwrap_or_default() - length.declared;
            seating[length.closure] += more / factor / alike.count() as f64;
        }
        Noise { sigma, play, seating, measured }
    }
}

/// One group of rows: what it scatters by, and how noise reaches it.
struct Group {
    /// `W`.
    products: Mat<f64>,
    /// `ν`.
    free: f64,
    /// `b`, equations by channels.
    columns: Mat<f64>,
    /// What the readings at the noise that whitens leave: play, or else equations that say nearly
    /// the same, (57).
    rest: Mat<f64>,
}

/// Groups without those that scatter as only bad samples do, if these are few: one bad
/// sample makes all other channels look quiet.
fn without_gross(groups: Vec<Group>) -> Vec<Group> {
    let dof = |g: &Group| g.free * g.columns.nrows() as f64;
    let size = |g: &Group| (0..g.columns.nrows()).map(|i| g.products[(i, i)]).sum::<f64>();
    let chance = GROSS / groups.len().max(1) as f64;
    // Groups are of a few sizes, and a quantile takes as long as a fit of one of them.
    let mut quantiles: Vec<(f64, f64, f64)> = Vec::new();
    for dof in groups.iter().map(dof) {
        if quantiles.iter().all(|known| known.0 != dof) {
            let of = |p| distributions::chi2_quantile(p, dof);
            quantiles.push((dof, of(0.5), of(chance)));
        }
    }
    let known =
        |g: &Group| quantiles.iter().find(|q| q.0 == dof(g)).map_or((1.0, 1.0), |q| (q.1, q.2));
    let mut sizes: Vec<f64> = groups.iter().map(|g| size(g) / known(g).0).collect();
    order::sort(&mut sizes);
    let usual = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    let sound = |g: &Group| size(g) <= usual * known(g).1;
    let gross = groups.iter().filter(|g| !sound(g)).count();
    if gross * MOST_GROSS > groups.len() {
        return groups;
    }
    groups.into_iter().filter(sound).collect()
}

/// Variance of a column that would explain all scatter by itself.
fn explaining(groups: &[Group], column: usize) -> f64 {
    let (mut scatter, mut square) = (0.0, 0.0);
    for group in groups {
        for e in 0..group.columns.nrows() {
            scatter += group.products[(e, e)];
            square += group.free * group.columns[(e, column)].powi(2);
        }
    }
    if square > 0.0 { scatter / square } else { 1.0 }
}

/// The groups that are looked at.
struct Seen {
    groups: Vec<Group>,
    /// Variance of each channel at unit scale.
    units: Vec<f64>,
    floor: Vec<f64>,
    common_floor: f64,
    /// True where the rest is play, which has its own variance.
    play: bool,
}

impl Seen {
    fn of(groups: &Groups, residuals: &Residuals, used: &Noise, alike: &Alike) -> Self {
        let k = residuals.equations;
        let (channels, lengths) = (alike.noise.sigma.len(), &alike.lengths);
        let variance = |c: usize| match c.checked_sub(channels) {
            Some(length) => lengths[length].variance,
            None => used.sigma[c].powi(2),
        };
        let of_group = |rows: &Vec<usize>| {
            let told = residuals.told(middle(rows));
            let mut left = Mat::<f64>::zeros(rows.len(), told.len());
            let mut one = Vec::with_capacity(rows.len());
            for (column, &e) in told.iter().enumerate() {
                one.clear();
                one.extend(rows.iter().map(|r| residuals.whitened[r * k + e]));
                crate::readings::context::detrend(&mut one, groups.order);
                one.iter().enumerate().for_each(|(i, value)| left[(i, column)] = *value);
            }
            let derivatives = residuals.by_reading_of(middle(rows), channels);
            let by_length = |e: usize, length: &Length| {
                residuals.by_closure[(middle(rows) * k + e) * k + length.equation]
            };
            let columns = Mat::from_fn(told.len(), channels + lengths.len(), |e, c| {
                let e = told[e];
                let length = c.checked_sub(channels).map(|l| by_length(e, &lengths[l]));
                length.unwrap_or_else(|| derivatives[e * channels + c])
            });
            let rest = Mat::from_fn(told.len(), told.len(), |i, j| {
                let read = (0..columns.ncols())
                    .map(|c| columns[(i, c)] * columns[(j, c)] * variance(c))
                    .sum::<f64>();
                f64::from(u8::from(i == j)) - read
            });
            let free = (rows.len() - groups.order) as f64;
            Group { products: left.transpose() * &left, free, columns, rest }
        };
        let looked: Vec<Group> = looked_at(groups).map(of_group).collect();
        let groups = without_gross(looked);
        let mut units: Vec<f64> = alike.noise.sigma.iter().map(|s| s * s).collect();
        let mut floor = alike.floor.clone();
        for column in channels..channels + lengths.len() {
            let declared = lengths[column - channels].declared;
            let all = if declared > 0.0 { declared } else { explaining(&groups, column) };
            units.push(all);
            floor.push(LEAST * all);
        }
        let common = (0..channels).filter(|&c| !alike.apart[c]);
        let least = common.map(|c| alike.floor[c] / units[c]);
        Self {
            groups,
            common_floor: least.fold(LEAST, f64::max),
            floor,
            units,
            play: residuals.play,
        }
    }

    fn unit(&self, channel: usize) -> f64 {
        self.units[channel]
    }

    /// Eq. (65), summed over the groups.
    fn sums(&self, at: &Variances) -> Option<ScoreSums> {
        let mut sums = ScoreSums::new(self.units.len() + 1);
        for group in &self.groups {
            sums.add(&self.of_group(group, at)?);
        }
        Some(sums)
    }

    /// Eq. (65) of one group: by the common scale, then by each channel's own variance.
    fn of_group(&self, group: &Group, at: &Variances) -> Option<ScoreSums> {
        let (k, channels) = (group.columns.nrows(), self.units.len());
        let b = &group.columns;
        let (mut scale, mut own) = (group.rest.clone(), Mat::<f64>::zeros(k, k));
        if self.play {
            std::mem::swap(&mut scale, &mut own);
        }
        for c in 0..channels {
            let (into, variance) = match at.own[c] {
                Some(variance) => (&mut own, variance),
                None => (&mut scale, self.units[c]),
            };
            for i in 0..k {
                for j in 0..k {
                    into[(i, j)] += variance * b[(i, c)] * b[(j, c)];
                }
            }
        }
        let v = &own + faer::Scale(at.common) * &scale;
        let factor = v.llt(Side::Lower).ok()?;
        let solve = |m: &Mat<f64>| factor.solve(m);
        let e = solve(b);
        let t = solve(&scale);
        let w = solve(&group.products);
        // V⁻¹ (W - ν V) V⁻¹ against each derivative.
        let excess = Mat::from_fn(k, k, |i, j| w[(i, j)] - if i == j { group.free } else { 0.0 });
        let mut out = ScoreSums::new(channels + 1);
        let product = |a: &Mat<f64>, b: &Mat<f64>| -> f64 {
            (0..k)
                .flat_map(|i| (0..k).map(move |j| (i, j)))
                .map(|(i, j)| a[(i, j)] * b[(j, i)])
                .sum()
        };
        out.gradient[0] = 0.5 * product(&excess, &t);
        out.information[(0, 0)] = 0.5 * group.free * product(&t, &t);
        let inner = b.transpose() * &e;
        // bᵀ V⁻¹ (W - ν V) V⁻¹ b, and bᵀ V⁻¹ V' V⁻¹ b.
        let across = (e.transpose() * &group.products) * &e;
        let along = (e.transpose() * &scale) * &e;
        for c in 0..channels {
            out.gradient[c + 1] = 0.5 * (across[(c, c)] - group.free * inner[(c, c)]);
            out.information[(0, c + 1)] = 0.5 * group.free * along[(c, c)];
            out.information[(c + 1, 0)] = out.information[(0, c + 1)];
            for d in 0..channels {
                out.information[(c + 1, d + 1)] = 0.5 * group.free * inner[(c, d)].powi(2);
            }
        }
        Some(out)
    }

    /// For each channel, the score of its own variance in standard deviations: of all
    /// groups, and without those that speak loudest.
    fn scores(&self, at: &Variances) -> Option<Vec<(f64, f64)>> {
        let columns = at.columns();
        let each: Vec<ScoreSums> =
            self.groups.iter().map(|g| self.of_group(g, at)).collect::<Option<_>>()?;
        let mut all = ScoreSums::new(self.units.len() + 1);
        each.iter().for_each(|sums| all.add(sums));
        let channels = 0..self.units.len();
        channels
            .map(|c| {
                let score = all.score(&columns, c + 1)?;
                let mut order: Vec<usize> = (0..each.len()).collect();
                let loud = |i: &usize| -score.signum() * each[*i].gradient[c + 1];
                order::ascending(&mut order, |a| loud(a));
                let mut rest = ScoreSums::new(self.units.len() + 1);
                for &i in &order[each.len().div_ceil(STRANGE)..] {
                    rest.add(&each[i]);
                }
                Some((score, rest.score(&columns, c + 1)?))
            })
            .collect()
    }
}

/// Gradient and information of (65): of the common scale, and of each channel.
struct ScoreSums {
    gradient: Vec<f64>,
    information: Mat<f64>,
}

impl ScoreSums {
    fn new(n: usize) -> Self {
        Self { gradient: vec![0.0; n], information: Mat::zeros(n, n) }
    }

    fn add(&mut self, other: &Self) {
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(a, b)| *a += b);
        self.information += &other.information;
    }

    /// `I⁻¹ r` over some columns.
    fn solve(&self, columns: &[usize], r: impl Fn(usize) -> f64) -> Option<Vec<f64>> {
        let n = columns.len();
        let part = Mat::from_fn(n, n, |i, j| self.information[(columns[i], columns[j])]);
        let factor = part.llt(Side::Lower).ok()?;
        let right = Mat::from_fn(n, 1, |i, _| r(i));
        let x = factor.solve(&right);
        Some((0..n).map(|i| x[(i, 0)]).collect())
    }

    /// Score of one more column, in standard deviations, what is fitted projected off.
    fn score(&self, fitted: &[usize], column: usize) -> Option<f64> {
        if fitted.contains(&column) {
            return Some(0.0);
        }
        let absorbed = self.solve(fitted, |i| self.information[(fitted[i], column)])?;
        let (mut g, mut square) = (self.gradient[column], self.information[(column, column)]);
        for (a, &i) in absorbed.iter().zip(fitted) {
            g -= a * self.gradient[i];
            square -= a * self.information[(i, column)];
        }
        Some(if square > 1e-9 * self.information[(column, column)] {
            g / square.sqrt()
        } else {
            0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that follow no rule.
    fn odd(i: usize) -> f64 {
        (((i * i + 3 * i + 1) % 17) as f64 - 8.0) / 8.0
    }

    fn seen() -> Seen {
        let group = |g: usize| {
            let scatter = Mat::from_fn(5, 2, |i, j| odd(7 * g + 2 * i + j));
            let rest = Mat::from_fn(2, 2, |i, j| if i == j { 0.3 } else { 0.0 });
            let columns = Mat::from_fn(2, 3, |i, j| odd(g + 3 * i + 5 * j));
            Group { products: scatter.transpose() * &scatter, free: 4.0, columns, rest }
        };
        let groups = (0..6).map(group).collect();
        let (units, floor) = (vec![1.0, 0.5, 2.0], vec![0.0; 3]);
        Seen { groups, units, floor, common_floor: 1e-12, play: true }
    }

    /// `-½ Σ (ν ln|V| + tr V⁻¹ W)`, two equations written out.
    fn likelihood(seen: &Seen, at: &Variances) -> f64 {
        let of = |group: &Group| {
            let v = |i: usize, j: usize| {
                let read = (0..3).map(|c| {
                    let variance = at.own[c].unwrap_or(at.common * seen.units[c]);
                    variance * group.columns[(i, c)] * group.columns[(j, c)]
                });
                group.rest[(i, j)] + read.sum::<f64>()
            };
            let (a, b, d) = (v(0, 0), v(0, 1), v(1, 1));
            let det = a * d - b * b;
            let w = &group.products;
            let trace = (d * w[(0, 0)] - 2.0 * b * w[(0, 1)] + a * w[(1, 1)]) / det;
            -0.5 * (group.free * det.ln() + trace)
        };
        seen.groups.iter().map(of).sum()
    }

    #[test]
    fn the_gradient_is_that_of_the_likelihood() {
        let seen = seen();
        let at = Variances {
            common: 0.7,
            known: false,
            own: vec![None, Some(1.3), None],
            declared: vec![false; 3],
        };
        let sums = seen.sums(&at).map(|s| s.gradient).unwrap_or_default();
        let step = 1e-5;
        let moved = |common: f64, own: f64| {
            let own = vec![None, Some(1.3 + own), None];
            likelihood(&seen, &Variances { common: 0.7 + common, own, ..at.clone() })
        };
        let by_common = (moved(step, 0.0) - moved(-step, 0.0)) / (2.0 * step);
        let by_own = (moved(0.0, step) - moved(0.0, -step)) / (2.0 * step);
        // Central differences: step² and rounding over step, both near 1e-10.
        assert!((sums[0] - by_common).abs() < 1e-7);
        assert!((sums[2] - by_own).abs() < 1e-7);
    }

    #[test]
    fn variances_end_where_the_gradient_vanishes() {
        let seen = seen();
        let mut at = Variances {
            common: 1.0,
            known: false,
            own: vec![None, Some(1.0), None],
            declared: vec![false; 3],
        };
        assert!(at.maximise(&seen).is_some());
        let sums = seen.sums(&at).map(|s| s.gradient).unwrap_or_default();
        assert!(sums[0].abs() < 1e-2 && sums[2].abs() < 1e-2, "{sums:?}");
    }
}

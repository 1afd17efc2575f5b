//! The state of all levels at some variances, and the variances that are likeliest.
//!
//! ```text
//! A_lm = û_lᵀ T_l⁻¹ û_l(û_m),   Σ_m A_lm Δτ_m²/τ_m² = (Q_l - k_l) Q_l/k_l
//! ```
//!
//! `û_l(û_m)` is what (161) makes of the deviations `û_m`, taken for readings. This is a step of
//! Newton for `k/Q = 1`: `A` is the mean of the observed and the expected information (Gilmour,
//! Thompson and Cullis 1995), and of groups that are known alike `k/Q` is straight in `τ²`. A step
//! is halved until the restricted likelihood grows; where it does not, (124) itself says where it does.

use std::sync::Arc;

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

use crate::numerics::symmetric::invert;
use crate::population::levels::grouping::Grouping;

/// Steps at most; a handful are usual.
const ROUNDS: usize = 100;

/// `ln τ²` changes by less than this where steps have converged.
const CONVERGED: f64 = 1e-6;

/// Parts of a step of Newton, and of (124), halved in turn, that are tried at most: the second is one
/// in which the likelihood grows.
const HALVES: [usize; 2] = [4, 12];

/// Twice the logarithm of the likelihood grows by this part of what its slope says, or more (Armijo 1966).
const ENOUGH: f64 = 1e-4;

/// A likelihood that is less by this is the same: an interval of 95 % is where it is less by 3.8.
const SAME: f64 = 1e-9;

/// Units with their levels, and what they tell.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    pub(super) grouping: Arc<Grouping>,
    /// The class of each parameter.
    pub(super) class: Vec<usize>,
    pub(super) classes: usize,
    /// Precision of `γ` beforehand.
    pub(super) held: f64,
    /// `H` of each unit, row by row, one unit after the other.
    pub(super) information: Vec<f64>,
    /// `h`
    pub(super) told: Vec<f64>,
    /// Least `ln τ²` of each rank and class; none of a class that no unit tells.
    pub(super) least: Vec<Option<f64>>,
}

/// All levels at some variances.
pub(super) struct At {
    /// `Q` of each rank and class.
    pub(super) q: Vec<f64>,
    /// `k`
    pub(super) k: Vec<f64>,
    /// `γ`
    pub(super) shift: Vec<f64>,
    /// `γ + Σ û` of each unit.
    means: Vec<f64>,
    /// `û/τ` of the groups of each rank.
    deviations: Vec<Vec<f64>>,
    eliminated: Eliminated,
}

/// What was eliminated, from units to `γ`.
struct Eliminated {
    /// `R` of each rank.
    roots: Vec<Vec<f64>>,
    /// `J` of the groups of each rank that nests.
    inner: Vec<Vec<f64>>,
    /// `F = J R S`
    through: Vec<Vec<f64>>,
    /// Inverse of what is solved together: `γ` and the groups that cross, these over their deviations.
    inverse: Mat<f64>,
    /// `ln det` of what was inverted, together.
    ln_det: f64,
}

/// `û/τ` of each rank, `γ`, and `γ + Σ û` of each unit.
struct Solved {
    deviations: Vec<Vec<f64>>,
    shift: Vec<f64>,
    means: Vec<f64>,
}

/// `J` and `F` of ranks, their `-ln det J`, and `S` or `Λ` of what is above.
struct Below {
    inner: Vec<Vec<f64>>,
    through: Vec<Vec<f64>>,
    ln_det: f64,
    above: Vec<f64>,
}

/// `S` and `s` of the groups of a rank, one after the other.
pub(super) struct Sums {
    pub(super) lambda: Vec<f64>,
    pub(super) b: Vec<f64>,
}

impl Tree {
    fn n(&self) -> usize {
        self.class.len()
    }

    /// `R` of each rank.
    fn roots(&self, ln: &[f64]) -> Vec<Vec<f64>> {
        let of = |own: &[f64]| self.class.iter().map(|&c| (0.5 * own[c]).exp()).collect();
        ln.chunks(self.classes.max(1)).map(of).collect()
    }

    /// `S` and `s` of the largest groups that nest.
    pub(super) fn largest(&self, ln: &[f64]) -> Sums {
        let (roots, last) = (self.roots(ln), self.grouping.depth() - 1);
        let Below { inner, above: lambda, .. } = self.eliminate(&roots, last);
        let (_, parts) = self.up(&roots, &inner, self.told.clone(), last);
        let b = summed(&parts, &self.grouping.nested[last], self.grouping.counts[last], self.n());
        Sums { lambda, b }
    }

    /// `J` and `F` of the ranks below `upto`, and `S` of that rank, or `Λ` of the last one that nests.
    fn eliminate(&self, roots: &[Vec<f64>], upto: usize) -> Below {
        let (n, grouping) = (self.n(), &self.grouping);
        let above = self.information.clone();
        let mut out = Below { inner: Vec::new(), through: Vec::new(), ln_det: 0.0, above };
        for (rank, up) in grouping.nested.iter().enumerate() {
            let mut sums = summed(&out.above, up, grouping.counts[rank], n * n);
            if rank == upto {
                out.above = sums;
                return out;
            }
            let root = &roots[rank];
            let mut inner = vec![0.0; sums.len()];
            let mut through = vec![0.0; sums.len()];
            let groups = inner.chunks_mut(n * n).zip(through.chunks_mut(n * n));
            for ((j, f), s) in groups.zip(sums.chunks_mut(n * n)) {
                out.ln_det += eliminate(root, s, j, f);
            }
            out.inner.push(inner);
            out.through.push(through);
            out.above = sums;
        }
        out
    }

    /// `J R s` of the ranks below `upto`, and what their groups tell of what is above.
    fn up(
        &self,
        roots: &[Vec<f64>],
        inner: &[Vec<f64>],
        mut parts: Vec<f64>,
        upto: usize,
    ) -> (Vec<Vec<f64>>, Vec<f64>) {
        let n = self.n();
        let mut all = Vec::with_capacity(upto);
        for (rank, up) in self.grouping.nested.iter().enumerate().take(upto) {
            let root = &roots[rank];
            let mut sums = summed(&parts, up, self.grouping.counts[rank], n);
            let mut own = vec![0.0; sums.len()];
            let groups = own.chunks_mut(n).zip(sums.chunks_mut(n));
            for ((own, s), j) in groups.zip(inner[rank].chunks(n * n)) {
                s.iter_mut().zip(root).for_each(|(s, r)| *s *= r);
                for (i, own) in own.iter_mut().enumerate() {
                    *own = dot(&j[i * n..(i + 1) * n], s);
                }
                s.iter_mut().zip(own.iter().zip(root)).for_each(|(s, (own, r))| *s = own / r);
            }
            all.push(own);
            parts = sums;
        }
        (all, parts)
    }

    /// Places of `γ` and the groups that cross, for one of the largest groups that nest.
    fn blocks(&self, top: usize, out: &mut Vec<usize>) {
        out.clear();
        out.push(0);
        let mut start = 1;
        let counts = &self.grouping.counts[self.grouping.depth()..];
        for (groups, count) in self.grouping.crossed.iter().zip(counts) {
            out.push(start + groups[top]);
            start += count;
        }
    }

    /// `R` of `γ` (1) and of the groups that cross.
    fn root_together(&self, roots: &[Vec<f64>]) -> Vec<f64> {
        let depth = self.grouping.depth();
        let mut out = vec![1.0; self.n()];
        for (root, &count) in roots[depth..].iter().zip(&self.grouping.counts[depth..]) {
            (0..count).for_each(|_| out.extend(root));
        }
        out
    }

    /// Deviations and `γ` of what units tell.
    fn solve(&self, of: &Eliminated, told: Vec<f64>) -> Solved {
        let (n, depth) = (self.n(), self.grouping.depth());
        let (own, b) = self.up(&of.roots, &of.inner, told, depth);
        let root = self.root_together(&of.roots);
        let mut right = vec![0.0; root.len()];
        let mut blocks = Vec::new();
        for (top, b) in b.chunks(n).enumerate() {
            self.blocks(top, &mut blocks);
            for &p in &blocks {
                (0..n).for_each(|i| right[n * p + i] += root[n * p + i] * b[i]);
            }
        }
        let at = |i: usize| (0..right.len()).map(|j| of.inverse[(i, j)] * right[j]).sum::<f64>();
        let found: Vec<f64> = (0..right.len()).map(at).collect();
        let mut mean = vec![0.0; b.len()];
        for (top, mean) in mean.chunks_mut(n).enumerate() {
            self.blocks(top, &mut blocks);
            for &p in &blocks {
                (0..n).for_each(|i| mean[i] += root[n * p + i] * found[n * p + i]);
            }
        }
        let mut all = own;
        for rank in (0..depth).rev() {
            let groups = all[rank].chunks_mut(n).zip(mean.chunks_mut(n));
            for ((w, mean), f) in groups.zip(of.through[rank].chunks(n * n)) {
                for (i, w) in w.iter_mut().enumerate() {
                    *w -= dot(&f[i * n..(i + 1) * n], mean);
                }
                mean.iter_mut().zip(of.roots[rank].iter().zip(w)).for_each(|(m, (r, w))| {
                    *m += r * *w;
                });
            }
            if rank > 0 {
                mean = spread(&mean, &self.grouping.nested[rank], n);
            }
        }
        let mut start = n;
        for &count in &self.grouping.counts[depth..] {
            all.push(found[start..start + n * count].to_vec());
            start += n * count;
        }
        Solved { deviations: all, shift: found[..n].to_vec(), means: mean }
    }

    /// All levels at some variances.
    pub(super) fn at(&self, ln: &[f64]) -> At {
        let (eliminated, k) = self.eliminated(ln);
        let Solved { deviations, shift, means } = self.solve(&eliminated, self.told.clone());
        let mut q = vec![0.0; k.len()];
        for (rank, all) in deviations.iter().enumerate() {
            let own = &mut q[rank * self.classes..];
            for w in all.chunks(self.n()) {
                self.class.iter().zip(w).for_each(|(&c, w)| own[c] += w * w);
            }
        }
        At { q, k, shift, means, deviations, eliminated }
    }

    /// By how much twice the logarithm of the restricted likelihood is larger than at others.
    ///
    /// It is `-ln det - Σ (h - H m)ᵀ H⁻¹ (h - H m) - Σ û²/τ²` with the means `m` of units. Differences of
    /// these are taken, not of squares, which errors of a millionth make as large as 10¹².
    fn gained(&self, at: &At, before: &At) -> f64 {
        let n = self.n();
        let own = |at: &At| {
            let held: f64 = at.shift.iter().map(|s| self.held * s * s).sum();
            at.eliminated.ln_det + at.q.iter().sum::<f64>() + held
        };
        let mut moved = vec![0.0; n];
        let mut gained = own(before) - own(at);
        let means = at.means.chunks(n).zip(before.means.chunks(n));
        let units = self.information.chunks(n * n).zip(self.told.chunks(n));
        for ((now, then), (h, told)) in means.zip(units) {
            moved.iter_mut().zip(now.iter().zip(then)).for_each(|(m, (now, then))| *m = now - then);
            for (i, h) in h.chunks(n).enumerate() {
                gained += moved[i] * (2.0 * (told[i] - dot(h, then)) - dot(h, &moved));
            }
        }
        gained
    }

    /// `k` of each rank and class at some variances.
    pub(super) fn k(&self, ln: &[f64]) -> Vec<f64> {
        self.eliminated(ln).1
    }

    fn eliminated(&self, ln: &[f64]) -> (Eliminated, Vec<f64>) {
        let (n, depth) = (self.n(), self.grouping.depth());
        let roots = self.roots(ln);
        let Below { inner, through, ln_det, above: tops } = self.eliminate(&roots, depth);
        let root = self.root_together(&roots);
        let size = root.len();
        let mut gram = Mat::<f64>::zeros(size, size);
        let mut blocks = Vec::new();
        for (top, lambda) in tops.chunks(n * n).enumerate() {
            self.blocks(top, &mut blocks);
            for (&p, &o) in blocks.iter().flat_map(|p| blocks.iter().map(move |o| (p, o))) {
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let by = root[n * p + i] * root[n * o + j];
                    gram[(n * p + i, n * o + j)] += by * lambda[n * i + j];
                }
            }
        }
        (0..size).for_each(|i| gram[(i, i)] += if i < n { self.held } else { 1.0 });
        let (inverse, own) = inverse(&gram);
        let eliminated = Eliminated { roots, inner, through, inverse, ln_det: ln_det + own };
        let k = self.determined(&eliminated, &root, tops.len() / (n * n));
        (eliminated, k)
    }

    /// `k` of each rank and class.
    fn determined(&self, of: &Eliminated, root: &[f64], tops: usize) -> Vec<f64> {
        let (n, depth) = (self.n(), self.grouping.depth());
        let mut k = vec![0.0; self.grouping.counts.len() * self.classes];
        let mut start = n;
        for (rank, count) in self.grouping.counts.iter().enumerate().skip(depth) {
            for i in start..start + n * count {
                k[rank * self.classes + self.class[i % n]] += 1.0 - of.inverse[(i, i)];
            }
            start += n * count;
        }
        // Down again: the covariance of the mean of what is above a group.
        let mut above = vec![0.0; tops * n * n];
        let mut blocks = Vec::new();
        for (top, p) in above.chunks_mut(n * n).enumerate() {
            self.blocks(top, &mut blocks);
            for (&a, &b) in blocks.iter().flat_map(|a| blocks.iter().map(move |b| (a, b))) {
                for (ij, p) in p.iter_mut().enumerate() {
                    let (i, j) = (n * a + ij / n, n * b + ij % n);
                    *p += root[i] * of.inverse[(i, j)] * root[j];
                }
            }
        }
        let (mut fp, mut own) = (vec![0.0; n * n], vec![0.0; n * n]);
        for rank in (0..depth).rev() {
            let root = &of.roots[rank];
            let sum = &mut k[rank * self.classes..(rank + 1) * self.classes];
            let known = of.inner[rank].chunks(n * n).zip(of.through[rank].chunks(n * n));
            for ((inner, f), p) in known.zip(above.chunks_mut(n * n)) {
                for ij in 0..n * n {
                    let row = &f[ij / n * n..(ij / n + 1) * n];
                    // `P` is symmetric.
                    fp[ij] = dot(row, &p[ij % n * n..(ij % n + 1) * n]);
                }
                let at = |i: usize, j: usize| {
                    inner[i * n + j] + dot(&fp[i * n..(i + 1) * n], &f[j * n..(j + 1) * n])
                };
                (0..n).for_each(|i| sum[self.class[i]] += 1.0 - at(i, i));
                if rank == 0 {
                    continue;
                }
                own.iter_mut().enumerate().for_each(|(ij, own)| *own = at(ij / n, ij % n));
                for i in 0..n {
                    for j in 0..n {
                        // With `a = R (y - F m)`, Cov(m, a) = -P Fᵀ R.
                        let cross = root[i] * fp[i * n + j] + root[j] * fp[j * n + i];
                        p[i * n + j] += root[i] * own[i * n + j] * root[j] - cross;
                    }
                }
            }
            if rank > 0 {
                above = spread(&above, &self.grouping.nested[rank], n * n);
            }
        }
        k
    }

    /// `A` of some ranks and classes.
    fn information(&self, at: &At, of: &[usize]) -> Mat<f64> {
        let n = self.n();
        let mut found = Mat::<f64>::zeros(of.len(), of.len());
        let mut deviation = vec![0.0; n];
        for (a, &one) in of.iter().enumerate() {
            let (rank, class) = (one / self.classes, one % self.classes);
            let (root, all) = (&at.eliminated.roots[rank], &at.deviations[rank]);
            let mut told = vec![0.0; self.told.len()];
            let units = told.chunks_mut(n).zip(self.information.chunks(n * n));
            for ((told, h), &group) in units.zip(&self.grouping.of_unit[rank]) {
                for (i, d) in deviation.iter_mut().enumerate() {
                    let own = self.class[i] == class;
                    *d = if own { root[i] * all[n * group + i] } else { 0.0 };
                }
                for (i, told) in told.iter_mut().enumerate() {
                    *told = dot(&h[i * n..(i + 1) * n], &deviation);
                }
            }
            let seen = self.solve(&at.eliminated, told).deviations;
            for (b, &other) in of.iter().enumerate() {
                let (rank, class) = (other / self.classes, other % self.classes);
                let pairs = at.deviations[rank].chunks(n).zip(seen[rank].chunks(n));
                let product = |(w, seen): (&[f64], &[f64])| {
                    let own = (0..n).filter(|&i| self.class[i] == class);
                    own.map(|i| w[i] * seen[i]).sum::<f64>()
                };
                let sum: f64 = pairs.map(product).sum();
                found[(a, b)] += 0.5 * sum;
                found[(b, a)] += 0.5 * sum;
            }
        }
        found
    }

    /// Steps of `ln τ²`, but for one that is held: that of Newton, and (124). The likelihood grows where
    /// the second begins.
    fn steps(&self, ln: &[f64], at: &At, held: Option<usize>) -> [Vec<f64>; 2] {
        let moves = |&one: &usize| {
            let Some(least) = self.least[one] else { return false };
            held != Some(one) && (at.q[one] > at.k[one] || ln[one] > least)
        };
        let free: Vec<usize> = (0..ln.len()).filter(moves).collect();
        let ratio = |one: usize| at.q[one] / at.k[one].max(f64::MIN_POSITIVE);
        let within = |one: usize, step: f64| {
            let least = self.least[one].unwrap_or(ln[one]);
            (ln[one] + step).max(least).min(LARGEST) - ln[one]
        };
        let (mut newton, mut simple) = (vec![0.0; ln.len()], vec![0.0; ln.len()]);
        if free.is_empty() {
            return [newton, simple];
        }
        let a = self.information(at, &free);
        let inverse = invert(&a).0;
        let right: Vec<f64> =
            free.iter().map(|&one| (at.q[one] - at.k[one]) * ratio(one)).collect();
        for (i, &one) in free.iter().enumerate() {
            let change: f64 = (0..free.len()).map(|j| inverse[(i, j)] * right[j]).sum();
            // (124) itself, where a rank shows no deviation at all.
            simple[one] = within(one, ratio(one).ln());
            let known = a[(i, i)] > 0.0 && change.is_finite();
            let step = if known { change.max(-1.0).ln_1p() } else { simple[one] };
            newton[one] = within(one, step);
        }
        [newton, simple]
    }

    /// The likeliest variances from some on, but for one that is held.
    pub(super) fn fit(&self, mut ln: Vec<f64>, held: Option<usize>) -> (Vec<f64>, At) {
        let mut at = self.at(&ln);
        for _ in 0..ROUNDS {
            let steps = self.steps(&ln, &at, held);
            let mut tries = steps.iter().zip(HALVES);
            let Some(next) = tries.find_map(|(step, halves)| self.along(&ln, &at, step, halves))
            else {
                break;
            };
            let moved = ln.iter().zip(&next.0).map(|(ln, next)| (next - ln).abs());
            let moved = moved.fold(0.0, f64::max);
            (ln, at) = next;
            if moved < CONVERGED {
                break;
            }
        }
        (ln, at)
    }

    /// Where the likelihood has grown along a step, or a step ends that changes nothing.
    fn along(&self, ln: &[f64], at: &At, step: &[f64], halves: usize) -> Option<(Vec<f64>, At)> {
        let rise = slope(at, step);
        let small = step.iter().all(|s| s.abs() < CONVERGED);
        if !small && (rise <= 0.0 || rise.is_nan()) {
            return None;
        }
        (0..halves).map(|half| 0.5_f64.powi(half as i32)).find_map(|part| {
            let next: Vec<f64> = ln.iter().zip(step).map(|(ln, s)| ln + part * s).collect();
            let found = self.at(&next);
            let enough = self.gained(&found, at) >= ENOUGH * part * rise - SAME;
            (small || enough).then_some((next, found))
        })
    }
}

/// Largest `ln τ²`: its square is still a number.
const LARGEST: f64 = 350.0;

/// Twice the slope of the restricted likelihood along a step of `ln τ²`.
fn slope(at: &At, step: &[f64]) -> f64 {
    at.q.iter().zip(&at.k).zip(step).map(|((q, k), s)| (q - k) * s).sum()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Sums of the parts of each group, `size` numbers of each.
fn summed(parts: &[f64], up: &[usize], count: usize, size: usize) -> Vec<f64> {
    let mut sums = vec![0.0; count * size];
    for (part, &group) in parts.chunks(size.max(1)).zip(up) {
        let own = &mut sums[group * size..(group + 1) * size];
        own.iter_mut().zip(part).for_each(|(s, p)| *s += p);
    }
    sums
}

/// What each part has of its group, `size` numbers of each.
fn spread(groups: &[f64], up: &[usize], size: usize) -> Vec<f64> {
    up.iter().flat_map(|&group| &groups[group * size..(group + 1) * size]).copied().collect()
}

/// Inverse and `ln det` of a matrix that holds all directions, else the pseudo-inverse, which is of a
/// mean that no unit tells, whatever the variances are.
fn inverse(a: &Mat<f64>) -> (Mat<f64>, f64) {
    let Ok(factor) = a.llt(Side::Lower) else { return (invert(a).0, 0.0) };
    let triangle = factor.L();
    let ln_det = (0..a.nrows()).map(|i| 2.0 * triangle[(i, i)].ln()).sum();
    (factor.inverse(), ln_det)
}

/// (161): turns `S` of a group into its `Λ`, with `J` and `F`; `-ln det J`.
fn eliminate(root: &[f64], sum: &mut [f64], inner: &mut [f64], through: &mut [f64]) -> f64 {
    let n = root.len();
    if n == 1 {
        inner[0] = (1.0 + root[0] * sum[0] * root[0]).recip();
        through[0] = inner[0] * root[0] * sum[0];
        sum[0] = through[0] / root[0];
        return -inner[0].ln();
    }
    let whole =
        Mat::from_fn(n, n, |i, j| root[i] * sum[i * n + j] * root[j] + f64::from(u8::from(i == j)));
    let (found, ln_det) = inverse(&whole);
    for (ij, inner) in inner.iter_mut().enumerate() {
        *inner = found[(ij / n, ij % n)];
    }
    through.fill(0.0);
    for i in 0..n {
        for (k, root) in root.iter().enumerate() {
            let by = inner[i * n + k] * root;
            let rows = through[i * n..(i + 1) * n].iter_mut().zip(&sum[k * n..(k + 1) * n]);
            rows.for_each(|(f, s)| *f += by * s);
        }
    }
    // Λ = S R J R⁻¹ is the transpose of R⁻¹ J R S, and takes no difference of what is nearly the same.
    let lambda = |i: usize, j: usize| through[j * n + i] / root[j];
    for i in 0..n {
        for j in 0..n {
            sum[i * n + j] = 0.5 * (lambda(i, j) + lambda(j, i));
        }
    }
    ln_det
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use crate::population::levels::Levels;

    /// Numbers that repeat nothing, between -1 and 1.
    fn number(k: usize) -> f64 {
        ((k * 7919 + 131) * 104_729 % 100_003) as f64 / 50_001.5 - 1.0
    }

    /// Lower triangle `L` of `a = L Lᵀ`, by plain products.
    fn triangle(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut l = vec![vec![0.0; a.len()]; a.len()];
        for i in 0..a.len() {
            for j in 0..=i {
                let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
                l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
            }
        }
        l
    }

    /// `L⁻¹ x`
    fn before(l: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = Vec::new();
        for (i, row) in l.iter().enumerate() {
            out.push((x[i] - out.iter().zip(row).map(|(o, l)| o * l).sum::<f64>()) / row[i]);
        }
        out
    }

    fn product(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    fn ln_det(l: &[Vec<f64>]) -> f64 {
        (0..l.len()).map(|i| 2.0 * l[i][i].ln()).sum()
    }

    /// Units with two parameters: `H`, and the groups of each rank with those of the units first.
    struct Units {
        information: Vec<[[f64; 2]; 2]>,
        told: Vec<[f64; 2]>,
        groups: Vec<Vec<usize>>,
        held: f64,
    }

    impl Units {
        fn new(levels: &[Vec<usize>], held: f64) -> Self {
            let units = levels[0].len();
            let h = |u: usize| {
                let (a, b, c) = (number(3 * u), number(3 * u + 1), number(3 * u + 2));
                [[1.0 + a * a + c * c, a * b + c], [a * b + c, 1.5 + b * b]]
            };
            let told = |u: usize| [3.0 * number(500 + 2 * u), 3.0 * number(501 + 2 * u)];
            let mut groups = vec![(0..units).collect()];
            groups.extend(levels.iter().cloned());
            Self {
                information: (0..units).map(h).collect(),
                told: (0..units).map(told).collect(),
                groups,
                held,
            }
        }

        fn levels(&self) -> Levels {
            let matrix = |h: &[[f64; 2]; 2]| Mat::from_fn(2, 2, |i, j| h[i][j]);
            let information: Vec<Mat<f64>> = self.information.iter().map(matrix).collect();
            let told: Vec<Vec<f64>> = self.told.iter().map(|h| h.to_vec()).collect();
            Levels::new(&information, &told, &[0, 1], &self.groups[1..], self.held).expect("alike")
        }

        /// Minus twice the logarithm of the restricted likelihood, but for a constant, by matrices of
        /// all units.
        fn cost(&self, ln: &[f64]) -> f64 {
            let size = 2 * self.told.len();
            let (mut v, mut y) = (vec![vec![0.0; size]; size], vec![0.0; size]);
            for (u, (h, told)) in self.information.iter().zip(&self.told).enumerate() {
                let det = h[0][0] * h[1][1] - h[0][1] * h[1][0];
                let inverse = [[h[1][1] / det, -h[0][1] / det], [-h[1][0] / det, h[0][0] / det]];
                for i in 0..2 {
                    v[2 * u + i][2 * u..2 * u + 2].copy_from_slice(&inverse[i]);
                    y[2 * u + i] = product(&inverse[i], told);
                }
            }
            for (rank, groups) in self.groups.iter().enumerate() {
                for (u, one) in groups.iter().enumerate() {
                    for (w, _) in groups.iter().enumerate().filter(|(_, other)| *other == one) {
                        (0..2).for_each(|i| v[2 * u + i][2 * w + i] += ln[2 * rank + i].exp());
                    }
                }
            }
            let l = triangle(&v);
            let y = before(&l, &y);
            let column = |i: usize| -> Vec<f64> {
                before(&l, &(0..size).map(|k| f64::from(u8::from(k % 2 == i))).collect::<Vec<_>>())
            };
            let x = [column(0), column(1)];
            let held = |i, j| if i == j { self.held } else { 0.0 };
            let m: Vec<Vec<f64>> = (0..2)
                .map(|i| (0..2).map(|j| product(&x[i], &x[j]) + held(i, j)).collect())
                .collect();
            let lm = triangle(&m);
            let g = before(&lm, &[product(&x[0], &y), product(&x[1], &y)]);
            ln_det(&l) + ln_det(&lm) + product(&y, &y) - product(&g, &g)
        }
    }

    fn nested() -> Vec<Vec<usize>> {
        vec![vec![0, 0, 1, 1, 1, 2, 3, 3, 4, 4], vec![0, 0, 0, 0, 0, 1, 1, 1, 2, 2]]
    }

    fn crossed() -> Vec<Vec<usize>> {
        vec![vec![0, 0, 0, 1, 1, 1, 2, 2, 2, 2], vec![0, 1, 2, 0, 1, 2, 0, 1, 2, 2]]
    }

    #[test]
    fn the_score_is_the_slope_of_the_likelihood_of_all_units() {
        for (levels, held) in [(nested(), 0.0), (nested(), 1.0), (crossed(), 0.0), (crossed(), 1.0)]
        {
            let units = Units::new(&levels, held);
            let of = units.levels();
            let ln: Vec<f64> = (0..6).map(|k| 0.8 * number(40 + k)).collect();
            let at = of.tree.at(&ln);
            for one in 0..6 {
                let beside = |by: f64| {
                    let mut other = ln.clone();
                    other[one] += by;
                    units.cost(&other)
                };
                // Central differences of 1e-4 are exact to a few 1e-8.
                let slope = (beside(1e-4) - beside(-1e-4)) / 2e-4;
                let score = at.q[one] - at.k[one];
                assert!((score + slope).abs() < 1e-6, "{one}: {score} and not {}", -slope);
            }
        }
    }

    #[test]
    fn what_is_gained_is_the_change_of_the_likelihood_of_all_units() {
        for (levels, held) in [(nested(), 0.0), (nested(), 1.0), (crossed(), 0.0), (crossed(), 1.0)]
        {
            let units = Units::new(&levels, held);
            let tree = units.levels().tree;
            let ln = |from: usize| (0..6).map(|k| 2.0 * number(from + k)).collect::<Vec<_>>();
            let (one, other) = (ln(40), ln(60));
            let gained = tree.gained(&tree.at(&one), &tree.at(&other));
            let witness = units.cost(&other) - units.cost(&one);
            assert!((gained - witness).abs() < 1e-9, "{gained} and not {witness}");
        }
    }

    #[test]
    fn nothing_beside_the_found_variances_is_likelier() {
        for levels in [nested(), crossed()] {
            let units = Units::new(&levels, 0.0);
            let of = units.levels();
            let best = units.cost(&of.best);
            for one in 0..6 {
                for by in [-0.3, -0.03, 0.03, 0.3] {
                    let mut other = of.best.clone();
                    other[one] += by;
                    let least = of.tree.least[one].expect("told");
                    assert!(
                        other[one] < least || units.cost(&other) > best - 1e-9,
                        "{one} by {by}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_likeliest_variances_are_found_from_wherever_one_begins() {
        for (levels, held) in [(nested(), 1.0), (crossed(), 1.0)] {
            let mut units = Units::new(&levels, held);
            // Parameters that are told a thousand times better together than apart.
            for h in &mut units.information {
                let (a, b) = (h[0][0], h[1][1]);
                *h = [[a * 1e6, 999.0 * a * 1e3], [999.0 * a * 1e3, a * 1e6 + b]];
            }
            units.told.iter_mut().for_each(|h| *h = [h[0] * 1e6, h[1] * 1e6]);
            let of = units.levels();
            for from in [-12.0, -3.0, 0.0, 5.0] {
                let start: Vec<f64> = (0..6).map(|k| from + number(k)).collect();
                let found = of.tree.fit(start, None).0;
                let apart = units.cost(&found) - units.cost(&of.best);
                assert!(apart.abs() < 1e-6, "from {from}: {apart}, {found:?}, {:?}", of.best);
            }
        }
    }

    /// Units with an error `s` each.
    fn alike(x: &[f64], s: f64, levels: &[Vec<usize>]) -> Levels {
        let precision = s.powi(-2);
        let information = vec![Mat::from_fn(1, 1, |_, _| precision); x.len()];
        let told: Vec<Vec<f64>> = x.iter().map(|x| vec![precision * x]).collect();
        Levels::new(&information, &told, &[0], levels, 0.0).expect("alike")
    }

    fn mean(x: &[f64]) -> f64 {
        x.iter().sum::<f64>() / x.len() as f64
    }

    fn squares(x: &[f64]) -> f64 {
        x.iter().map(|one| (one - mean(x)).powi(2)).sum()
    }

    /// Sessions, by four, of devices, by three, of batches.
    fn balanced(batch: f64, device: f64, session: f64) -> Vec<f64> {
        let at = |u: usize| {
            batch * number(700 + u / 12) + device * number(800 + u / 4) + session * number(900 + u)
        };
        (0..60).map(at).collect()
    }

    fn groups(by: usize) -> Vec<usize> {
        (0..60).map(|u| u / by).collect()
    }

    #[test]
    fn of_balanced_levels_variances_are_those_of_mean_squares() {
        let x = balanced(9.0, 4.0, 2.0);
        let means = |by: usize| -> Vec<f64> { x.chunks(by).map(mean).collect() };
        // Mean squares of sessions in devices, devices in batches, batches.
        let session = x.chunks(4).map(squares).sum::<f64>() / 45.0;
        let device = 4.0 * means(4).chunks(3).map(squares).sum::<f64>() / 10.0;
        let batch = 12.0 * squares(&means(12)) / 4.0;
        let of = alike(&x, 0.5, &[groups(4), groups(12)]);
        let witness = [session - 0.25, (device - session) / 4.0, (batch - device) / 12.0];
        assert!(witness.iter().all(|variance| *variance > 0.0), "{witness:?}");
        for (ln, witness) in of.best.iter().zip(witness) {
            // Steps end where `ln τ²` moves by less than 1e-6.
            assert!((ln - witness.ln()).abs() < 1e-5, "{} and not {witness}", ln.exp());
        }
        assert!((of.mean()[0] - mean(&x)).abs() < 1e-9);
    }

    #[test]
    fn a_level_that_shows_nothing_leaves_its_squares_to_the_others() {
        // Devices have means alike: between them there is less than sessions make.
        let mut x = balanced(0.0, 0.0, 2.0);
        for device in x.chunks_mut(4) {
            let own = mean(device);
            device.iter_mut().for_each(|x| *x -= own);
        }
        let of = alike(&x, 0.5, &[groups(4)]);
        let spreads = of.spreads();
        let session = squares(&x) / 59.0 - 0.25;
        assert_eq!(spreads[1][0].sd, Some(0.0));
        // The least that a variance is taken for, 1e-3 of an error, is beside it.
        let found = spreads[0][0].sd.expect("told").powi(2);
        assert!((found / session - 1.0).abs() < 1e-3, "{found} and not {session}");
    }
}

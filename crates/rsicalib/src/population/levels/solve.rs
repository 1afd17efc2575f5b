//! The state of all levels at some variances: (161), down and up again.

use std::sync::Arc;

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

use crate::numerics::symmetric::{dot, eigenvalues, invert};
use crate::population::levels::grouping::Grouping;

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
    pub(super) deviations: Vec<Vec<f64>>,
    pub(super) eliminated: Eliminated,
}

/// What was eliminated, from units to `γ`.
pub(super) struct Eliminated {
    /// `R` of each rank.
    pub(super) roots: Vec<Vec<f64>>,
    /// `J` of the groups of each rank that nests.
    inner: Vec<Vec<f64>>,
    /// `F = J R S`
    through: Vec<Vec<f64>>,
    /// Inverse of what is solved together: `γ` and the groups that cross, these over their deviations.
    inverse: Mat<f64>,
    /// `ln det` of what was inverted, together.
    ln_det: f64,
}

impl Eliminated {
    /// Of `γ`, of `n` parameters.
    pub(super) fn covariance(&self, n: usize) -> Mat<f64> {
        self.inverse.submatrix(0, 0, n, n).to_owned()
    }
}

/// `û/τ` of each rank, `γ`, and `γ + Σ û` of each unit.
pub(super) struct Solved {
    pub(super) deviations: Vec<Vec<f64>>,
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
    pub(super) fn n(&self) -> usize {
        self.class.len()
    }

    /// `R` of each rank.
    fn roots(&self, ln: &[f64]) -> Vec<Vec<f64>> {
        let of = |own: &[f64]| self.class.iter().map(|&c| (0.5 * own[c]).exp()).collect();
        ln.chunks(self.classes.max(1)).map(of).collect()
    }

    /// `R` of the largest groups that nest.
    pub(super) fn root_of_largest(&self, ln: &[f64]) -> Vec<f64> {
        self.roots(ln).swap_remove(self.grouping.depth() - 1)
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
    pub(super) fn solve(&self, of: &Eliminated, told: Vec<f64>) -> Solved {
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
    pub(super) fn gained(&self, at: &At, before: &At) -> f64 {
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
        let (inverse, own) = inverse(&gram).unwrap_or_else(|| {
            // A mean that nothing holds and no unit tells has the pseudo-inverse, whatever the variances are.
            if self.held > 0.0 { rounded(&gram, self.held) } else { (invert(&gram).0, 0.0) }
        });
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

/// Inverse and `ln det` of a matrix that holds all directions.
fn inverse(a: &Mat<f64>) -> Option<(Mat<f64>, f64)> {
    let factor = a.llt(Side::Lower).ok()?;
    let triangle = factor.L();
    let ln_det = (0..a.nrows()).map(|i| 2.0 * triangle[(i, i)].ln()).sum();
    Some((factor.inverse(), ln_det))
}

/// The same of a matrix none of whose eigenvalues is below `least`, but for rounding, which is more than that.
fn rounded(a: &Mat<f64>, least: f64) -> (Mat<f64>, f64) {
    let n = a.nrows();
    let Some((values, vectors)) = eigenvalues(a.as_ref()) else { return (invert(a).0, 0.0) };
    let values: Vec<f64> = values.into_iter().map(|value| value.max(least)).collect();
    let part = Mat::from_fn(n, n, |i, k| vectors[(i, k)] / values[k]);
    (part * vectors.transpose(), values.iter().map(|value| value.ln()).sum())
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
    let one = |i: usize, j: usize| f64::from(u8::from(i == j));
    let whole = Mat::from_fn(n, n, |i, j| root[i] * sum[i * n + j] * root[j] + one(i, j));
    let exact = inverse(&whole);
    let told = exact.is_some();
    let (found, ln_det) = exact.unwrap_or_else(|| rounded(&whole, 1.0));
    for (ij, inner) in inner.iter_mut().enumerate() {
        *inner = found[(ij / n, ij % n)];
    }
    if told {
        through.fill(0.0);
        for i in 0..n {
            for (k, root) in root.iter().enumerate() {
                let by = inner[i * n + k] * root;
                let rows = through[i * n..(i + 1) * n].iter_mut().zip(&sum[k * n..(k + 1) * n]);
                rows.for_each(|(f, s)| *f += by * s);
            }
        }
    } else {
        // `S` is rounded by more than `T⁻¹`: what is left of it is F = (1 - J) R⁻¹, which is never negative.
        for (ij, f) in through.iter_mut().enumerate() {
            *f = (one(ij / n, ij % n) - inner[ij]) / root[ij % n];
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

/// (121) of a group at its variances.
pub(in crate::population) struct Held {
    /// `V = R J R`
    pub(in crate::population) v: Mat<f64>,
    /// `V T⁻¹ = R J R⁻¹`
    pub(in crate::population) lent: Mat<f64>,
    /// `Λ`
    pub(in crate::population) lambda: Mat<f64>,
    /// `b`
    pub(in crate::population) b: Vec<f64>,
    /// `h`, or `s` of its parts.
    pub(in crate::population) told: Vec<f64>,
}

impl Held {
    pub(super) fn of(root: &[f64], sum: &Mat<f64>, told: Vec<f64>) -> Self {
        let n = root.len();
        let mut lambda: Vec<f64> = (0..n * n).map(|ij| sum[(ij / n, ij % n)]).collect();
        let (mut inner, mut through) = (vec![0.0; n * n], vec![0.0; n * n]);
        eliminate(root, &mut lambda, &mut inner, &mut through);
        let lent = Mat::from_fn(n, n, |i, j| root[i] * inner[i * n + j] / root[j]);
        // b = R⁻¹ J R s
        let b = (0..n).map(|i| (0..n).map(|j| lent[(j, i)] * told[j]).sum()).collect();
        let v = Mat::from_fn(n, n, |i, j| root[i] * inner[i * n + j] * root[j]);
        Self { v, lent, lambda: Mat::from_fn(n, n, |i, j| lambda[i * n + j]), b, told }
    }
}

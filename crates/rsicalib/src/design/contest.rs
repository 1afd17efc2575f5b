//! Poses that decide between explanations of a session.
//!
//! The rivals are linear models at one point: `θ` are the parameters of a rival, `N = WᵀW` its
//! information of the poses visited already, priors included, and `W = L⁻¹ X` its rows of a new pose,
//! whitened with the covariance `S = L Lᵀ` of the misclosure (51). For a true, b is refitted pose by pose:
//!
//! ```text
//! e     = W_a θ_a - W_b θ_ab                                              (93)
//! Δλ_ab = eᵀ (I + W_b N_b⁻¹ W_bᵀ)⁻¹ e                                     (94)
//! N_b ← N_b + W_bᵀ W_b,   θ_ab ← θ_ab + N_b⁻¹ W_bᵀ e                      (95)
//! ```
//!
//! with the old `N_b` in (94), the new one in (95), and `θ_ab` = `θ_b` at first. `λ_ab` is by how much
//! the χ² of b is expected to grow beyond that of a. Poses are chosen for the least
//!
//! ```text
//! J = Σ_{a≠b} ½ √(π_a π_b) exp(-λ_ab / 8)                                 (96)
//! ```
//!
//! over ordered pairs, a bound of the probability of a wrong decision. The uncertainty of `θ_a` is
//! neglected: where the effect is hardly above the noise, λ is a typical value of a wide spread. The
//! forecast of a plan (98) has it.

use faer::Mat;

use crate::design::choice::Measure;
use crate::design::linearised::Whitened;
use crate::numerics::symmetric::{Unit, dot, invert};
use crate::numerics::workers;

/// A rival is behind where its penalised χ² is larger by this: the decision of a trace.
pub(crate) use crate::numerics::credible_set::RIVAL as DECIDED;

/// A direction that the old poses do not determine is taken to be known to this fraction of what
/// they tell of the best one, in unit columns.
const FAINT: f64 = 1e-12;

/// Candidates that are brought up to date in one piece: one alone takes less time than to hand it to
/// a worker.
const TOGETHER: usize = 64;

/// One explanation, linear at the common point.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    /// Parameters, from the common point.
    pub theta: Vec<f64>,
    /// `N`, of the poses visited already and of the priors.
    pub information: Mat<f64>,
    /// Probability beforehand.
    pub probability: f64,
    /// Penalised χ² of the poses visited already.
    pub chi2: f64,
}

/// Rows `W` of one pose: equation by equation, one entry per parameter.
pub(crate) type Rows<'a> = &'a [f64];

/// What a pose changed.
#[derive(Debug, Clone)]
pub(crate) struct Change {
    /// 1 for a pose that was visited, -1 for one taken back.
    sign: f64,
    /// `C Wᵀ L⁻ᵀ` of each rival, parameter by parameter.
    roots: Vec<Vec<f64>>,
    /// Change of `θ_ab` at `a * rivals + b`.
    steps: Vec<Vec<f64>>,
}

/// The rivals after some poses.
#[derive(Debug, Clone)]
pub(crate) struct Contest {
    pub(crate) rivals: Vec<Rival>,
    /// `N_b⁻¹`, row by row.
    inverse: Vec<Vec<f64>>,
    /// `θ_ab` at `a * rivals + b`.
    theta: Vec<Vec<f64>>,
    /// `λ_ab` at `a * rivals + b`.
    lambda: Vec<f64>,
}

impl Contest {
    /// Before any new pose.
    #[must_use]
    pub fn new(rivals: Vec<Rival>) -> Self {
        let m = rivals.len();
        let inverse = rivals.iter().map(|r| flat(&inverse_of(&r.information))).collect();
        let theta = (0..m * m).map(|ab| rivals[ab % m].theta.clone()).collect();
        Self { rivals, inverse, theta, lambda: vec![0.0; m * m] }
    }

    /// `λ_ab`, for a true.
    #[must_use]
    pub fn lambda(&self, a: usize, b: usize) -> f64 {
        self.lambda[a * self.rivals.len() + b]
    }

    /// The least `λ` of an ordered pair; infinite for a single rival.
    #[must_use]
    pub fn least(&self) -> f64 {
        let m = self.rivals.len();
        let pairs = (0..m * m).filter(|ab| ab / m != ab % m);
        pairs.map(|ab| self.lambda[ab]).fold(f64::INFINITY, f64::min)
    }

    /// (96).
    #[must_use]
    pub fn criterion(&self) -> f64 {
        self.sum(|ab| self.lambda[ab])
    }

    /// (96) with one more pose, whose rows are given rival by rival.
    #[must_use]
    pub fn criterion_with(&self, rows: &[Rows<'_>]) -> f64 {
        let gains = self.gains(rows);
        self.sum(|ab| self.lambda[ab] + gains[ab])
    }

    fn sum(&self, lambda: impl Fn(usize) -> f64) -> f64 {
        let m = self.rivals.len();
        let one = |ab: usize| {
            let both = self.rivals[ab / m].probability * self.rivals[ab % m].probability;
            0.5 * both.sqrt() * (-lambda(ab) / 8.0).exp()
        };
        (0..m * m).filter(|ab| ab / m != ab % m).map(one).sum()
    }

    /// `Δλ_ab` (94) of every ordered pair; zero on the diagonal.
    #[must_use]
    pub fn gains(&self, rows: &[Rows<'_>]) -> Vec<f64> {
        let m = self.rivals.len();
        let truths: Vec<Vec<f64>> =
            rows.iter().zip(&self.rivals).map(|(w, r)| times(w, &r.theta)).collect();
        let mut gains = vec![0.0; m * m];
        for b in 0..m {
            let (_, factor) = spread(rows[b], &self.inverse[b], 1.0);
            for a in (0..m).filter(|&a| a != b) {
                let mut e = misfit(&truths[a], rows[b], &self.theta[a * m + b]);
                forward(&factor, &mut e);
                gains[a * m + b] = e.iter().map(|v| v * v).sum();
            }
        }
        gains
    }

    /// Takes one more pose, (94) and (95).
    pub fn visit(&mut self, rows: &[Rows<'_>]) -> Change {
        self.change(rows, 1.0)
    }

    /// Takes a visited pose back: (94) and (95) the other way.
    pub fn leave(&mut self, rows: &[Rows<'_>]) -> Change {
        self.change(rows, -1.0)
    }

    fn change(&mut self, rows: &[Rows<'_>], sign: f64) -> Change {
        let m = self.rivals.len();
        let truths: Vec<Vec<f64>> =
            rows.iter().zip(&self.rivals).map(|(w, r)| times(w, &r.theta)).collect();
        let mut steps = vec![Vec::new(); m * m];
        let mut roots = Vec::with_capacity(m);
        for b in 0..m {
            let n = self.rivals[b].theta.len();
            let (mut u, factor) = spread(rows[b], &self.inverse[b], sign);
            // U = C Wᵀ L⁻ᵀ, so that the new inverse is C ∓ U Uᵀ.
            let k = rows[b].len().checked_div(n).unwrap_or(0);
            for i in 0..n {
                forward(&factor, &mut u[i * k..(i + 1) * k]);
            }
            for a in (0..m).filter(|&a| a != b) {
                let mut e = misfit(&truths[a], rows[b], &self.theta[a * m + b]);
                forward(&factor, &mut e);
                self.lambda[a * m + b] += sign * e.iter().map(|v| v * v).sum::<f64>();
                // N'⁻¹ Wᵀ = C Wᵀ (I ± W C Wᵀ)⁻¹
                let step = (0..n).map(|i| sign * dot(&u[i * k..(i + 1) * k], &e));
                steps[a * m + b] = step.collect();
                let theta = self.theta[a * m + b].iter_mut();
                theta.zip(&steps[a * m + b]).for_each(|(value, step)| *value += step);
            }
            let inverse = &mut self.inverse[b];
            for i in 0..n {
                for j in 0..n {
                    inverse[i * n + j] -=
                        sign * dot(&u[i * k..(i + 1) * k], &u[j * k..(j + 1) * k]);
                }
            }
            roots.push(u);
        }
        Change { sign, roots, steps }
    }
}

/// A contest, and what each of all candidates would add to it: updated pose by pose instead of computed
/// again.
#[derive(Debug)]
pub(crate) struct Field<'a> {
    contest: Contest,
    /// Rows of each rival, candidate by candidate.
    rows: &'a [Whitened],
    /// `I + W C Wᵀ`, candidate by candidate, rival by rival.
    spreads: Vec<f64>,
    /// `e` of (93), candidate by candidate, pair by pair.
    misfits: Vec<f64>,
    m: usize,
    k: usize,
}

impl<'a> Field<'a> {
    /// Of rows for each rival, all of as many candidates and equations.
    #[must_use]
    pub(crate) fn new(contest: &Contest, rows: &'a [Whitened]) -> Self {
        let m = rows.len();
        let (count, k) = rows.first().map_or((0, 0), |r| (r.len(), r.equations));
        let mut field = Self {
            contest: contest.clone(),
            rows,
            spreads: vec![0.0; count * m * k * k],
            misfits: vec![0.0; count * m * m * k],
            m,
            k,
        };
        field.each(|candidate, spreads, misfits| {
            let of = |r: usize| rows[r].of(candidate);
            let truths: Vec<Vec<f64>> =
                (0..m).map(|a| times(of(a), &contest.rivals[a].theta)).collect();
            for b in 0..m {
                let n = rows[b].width;
                for (e, row) in of(b).chunks_exact(n.max(1)).enumerate() {
                    let line: Vec<f64> =
                        contest.inverse[b].chunks_exact(n).map(|c| dot(c, row)).collect();
                    for (f, other) in of(b).chunks_exact(n.max(1)).enumerate() {
                        let unit = if e == f { 1.0 } else { 0.0 };
                        spreads[(b * k + e) * k + f] = unit + dot(&line, other);
                    }
                }
                for a in (0..m).filter(|&a| a != b) {
                    let e = misfit(&truths[a], of(b), &contest.theta[a * m + b]);
                    misfits[(a * m + b) * k..(a * m + b + 1) * k].copy_from_slice(&e);
                }
            }
        });
        field
    }

    /// Number of candidates.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.first().map_or(0, Whitened::len)
    }

    /// The rows of one candidate, rival by rival.
    #[must_use]
    pub fn rows_of(&self, candidate: usize) -> Vec<Rows<'a>> {
        self.rows.iter().map(|r| r.of(candidate)).collect()
    }

    fn each(&mut self, visit: impl Fn(usize, &mut [f64], &mut [f64]) + Sync) {
        let (own, pairs) = (self.m * self.k * self.k, self.m * self.m * self.k);
        let (own, pairs) = (own.max(1), pairs.max(1));
        let spreads = self.spreads.chunks_mut(TOGETHER * own);
        let misfits = self.misfits.chunks_mut(TOGETHER * pairs);
        workers::map(spreads.zip(misfits).enumerate(), |(part, (spreads, misfits))| {
            let all = spreads.chunks_exact_mut(own).zip(misfits.chunks_exact_mut(pairs));
            all.enumerate().for_each(|(k, (s, e))| visit(part * TOGETHER + k, s, e));
        });
    }

    /// Brings all candidates up to date with a change of the contest.
    fn update(&mut self, change: &Change) {
        let (rows, m, k) = (self.rows, self.m, self.k);
        self.each(|candidate, spreads, misfits| {
            let mut moved = vec![0.0; k * k];
            for b in 0..m {
                let n = rows[b].width;
                let w = rows[b].of(candidate);
                let root = &change.roots[b];
                let columns = root.len().checked_div(n).unwrap_or(0);
                moved.clear();
                moved.resize(k * columns, 0.0);
                for (e, row) in w.chunks_exact(n.max(1)).enumerate() {
                    let line = &mut moved[e * columns..(e + 1) * columns];
                    for (weight, root) in row.iter().zip(root.chunks_exact(columns)) {
                        line.iter_mut().zip(root).for_each(|(l, r)| *l += weight * r);
                    }
                }
                for e in 0..k {
                    for f in 0..k {
                        let both = dot(
                            &moved[e * columns..(e + 1) * columns],
                            &moved[f * columns..(f + 1) * columns],
                        );
                        spreads[(b * k + e) * k + f] -= change.sign * both;
                    }
                }
                for a in (0..m).filter(|&a| a != b) {
                    let step = &change.steps[a * m + b];
                    let e = &mut misfits[(a * m + b) * k..(a * m + b + 1) * k];
                    for (e, row) in e.iter_mut().zip(w.chunks_exact(n.max(1))) {
                        *e -= dot(row, step);
                    }
                }
            }
        });
    }

    /// (96) with one of the candidates more.
    #[must_use]
    pub fn criterion(&self, candidate: usize) -> f64 {
        let (contest, m, k) = (&self.contest, self.m, self.k);
        let mut gains = vec![0.0; m * m];
        let mut factor_of = vec![0.0; k * k];
        let mut e = vec![0.0; k];
        for b in 0..m {
            let at = (candidate * m + b) * k * k;
            factor_of.copy_from_slice(&self.spreads[at..at + k * k]);
            factor(&mut factor_of, k);
            for a in (0..m).filter(|&a| a != b) {
                let at = (candidate * m * m + a * m + b) * k;
                e.copy_from_slice(&self.misfits[at..at + k]);
                forward(&factor_of, &mut e);
                gains[a * m + b] = dot(&e, &e);
            }
        }
        contest.sum(|ab| contest.lambda[ab] + gains[ab])
    }
}

impl Measure for Field<'_> {
    fn now(&self) -> f64 {
        logarithm(self.contest.criterion())
    }

    fn with(&self, candidate: usize) -> f64 {
        logarithm(self.criterion(candidate))
    }

    fn take(&mut self, candidate: usize) {
        let change = self.contest.visit(&self.rows_of(candidate));
        self.update(&change);
    }

    fn leave(&mut self, candidate: usize) {
        let change = self.contest.leave(&self.rows_of(candidate));
        self.update(&change);
    }
}

/// `ln` of (96).
pub(crate) fn logarithm(criterion: f64) -> f64 {
    criterion.max(1e-300).ln()
}

/// The inverse of an information matrix in which every direction has at least a trace.
///
/// The shapes of one curve differ by little over a short arc: eigenvalues of 1e-10 are real.
pub(crate) fn inverse_of(information: &Mat<f64>) -> Mat<f64> {
    let n = information.nrows();
    let Some(unit) = Unit::of(information.as_ref()) else { return invert(information).0 };
    let least = FAINT * unit.largest().max(f64::MIN_POSITIVE);
    let mut root = Mat::zeros(n, n);
    // What nothing tells is known to that fraction of its own unit.
    (0..n).for_each(|i| root[(i, i)] = least.sqrt().recip());
    for (i, (&row, norm)) in unit.live.iter().zip(&unit.norms).enumerate() {
        root[(row, row)] = 0.0;
        for (k, value) in unit.values.iter().enumerate() {
            root[(row, unit.live[k])] = unit.vectors[(i, k)] / (norm * value.max(least).sqrt());
        }
    }
    &root * root.transpose()
}

/// Row by row.
pub(crate) fn flat(m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows()).flat_map(|i| (0..m.ncols()).map(move |j| m[(i, j)])).collect()
}

/// `W θ`.
fn times(w: Rows<'_>, theta: &[f64]) -> Vec<f64> {
    w.chunks_exact(theta.len().max(1)).map(|row| dot(row, theta)).collect()
}

/// `e` of (93).
fn misfit(truth: &[f64], w: Rows<'_>, theta: &[f64]) -> Vec<f64> {
    let rows = w.chunks_exact(theta.len().max(1));
    truth.iter().zip(rows).map(|(t, row)| t - dot(row, theta)).collect()
}

/// `C Wᵀ`, parameter by parameter, and the Cholesky factor of `I ± W C Wᵀ`, row by row.
pub(crate) fn spread(w: Rows<'_>, inverse: &[f64], sign: f64) -> (Vec<f64>, Vec<f64>) {
    let n = inverse.len().isqrt();
    let k = w.len().checked_div(n).unwrap_or(0);
    let mut u = vec![0.0; n * k];
    for (i, line) in inverse.chunks_exact(n.max(1)).enumerate() {
        for (e, row) in w.chunks_exact(n.max(1)).enumerate() {
            u[i * k + e] = dot(line, row);
        }
    }
    let mut g = vec![0.0; k * k];
    for e in 0..k {
        for i in 0..n {
            let weight = sign * w[e * n + i];
            for f in 0..=e {
                g[e * k + f] += weight * u[i * k + f];
            }
        }
        g[e * k + e] += 1.0;
    }
    factor(&mut g, k);
    (u, g)
}

/// Cholesky of the lower triangle, in place.
pub(crate) fn factor(g: &mut [f64], k: usize) {
    for j in 0..k {
        for i in j..k {
            let done: f64 = (0..j).map(|l| g[i * k + l] * g[j * k + l]).sum();
            let left = g[i * k + j] - done;
            g[i * k + j] = if i == j { left.max(1e-300).sqrt() } else { left / g[j * k + j] };
        }
    }
}

/// `L⁻¹ v`, in place.
pub(crate) fn forward(l: &[f64], v: &mut [f64]) {
    let k = v.len();
    for i in 0..k {
        let done: f64 = (0..i).map(|j| l[i * k + j] * v[j]).sum();
        v[i] = (v[i] - done) / l[i * k + i];
    }
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::Solve;

    use super::*;

    /// Numbers that look like nothing: a stream that no other test uses.
    fn drawn(count: usize, seed: u64) -> Vec<f64> {
        let mut random = crate::numerics::random::Random::new(seed);
        (0..count).map(|_| random.uniform(-1.0, 1.0)).collect()
    }

    fn rival(n: usize, seed: u64, old: &Mat<f64>, probability: f64) -> Rival {
        Rival { theta: drawn(n, seed), information: old.transpose() * old, probability, chi2: 0.0 }
    }

    #[test]
    fn pose_by_pose_is_what_all_poses_give_together() {
        // λ = eᵀ (I + W N⁻¹ Wᵀ)⁻¹ e for all poses at once, by faer's dense solver.
        let (k, n, poses) = (2, 4, 3);
        let old: Vec<Mat<f64>> = (0..2)
            .map(|r| {
                let values = drawn(10 * n, 5 + r);
                Mat::from_fn(10, n, |i, j| values[i * n + j])
            })
            .collect();
        let rivals = vec![rival(n, 1, &old[0], 0.7), rival(n, 2, &old[1], 0.3)];
        let rows: Vec<Vec<f64>> = (0..2).map(|r| drawn(poses * k * n, 20 + r)).collect();
        let mut contest = Contest::new(rivals.clone());
        for p in 0..poses {
            let at = p * k * n..(p + 1) * k * n;
            let both: Vec<Rows<'_>> = rows.iter().map(|r| &r[at.clone()]).collect();
            let foreseen = contest.criterion_with(&both);
            contest.visit(&both);
            assert!((contest.criterion() - foreseen).abs() < 1e-12);
        }
        let after = contest.clone();
        let first: Vec<Rows<'_>> = rows.iter().map(|r| &r[..k * n]).collect();
        contest.leave(&first);
        contest.visit(&first);
        assert!((contest.criterion() / after.criterion() - 1.0).abs() < 1e-6);
        for (a, b) in [(0, 1), (1, 0)] {
            let whole = |r: usize| Mat::from_fn(poses * k, n, |i, j| rows[r][i * n + j]);
            let column = |r: usize| Mat::from_fn(n, 1, |i, _| rivals[r].theta[i]);
            let e = whole(a) * column(a) - whole(b) * column(b);
            let inverse = crate::numerics::symmetric::invert(&rivals[b].information).0;
            let s = whole(b) * inverse * whole(b).transpose() + Mat::<f64>::identity(6, 6);
            let Ok(factor) = s.llt(faer::Side::Lower) else { panic!("not positive") };
            let lambda = (e.transpose() * factor.solve(&e))[(0, 0)];
            assert!((contest.lambda(a, b) / lambda - 1.0).abs() < 1e-6, "{lambda}");
        }
        assert!(contest.least() <= contest.lambda(0, 1));
    }

    #[test]
    fn candidates_that_are_kept_up_to_date_are_as_computed_anew() {
        let (k, n, count) = (2, 5, 7);
        let old = Mat::from_fn(12, n, |i, j| drawn(12 * n, 3)[i * n + j]);
        let rivals = vec![rival(n, 1, &old, 0.6), rival(n, 2, &old, 0.4)];
        let whitened =
            |seed| Whitened { equations: k, width: n, values: drawn(count * k * n, seed) };
        let rows = [whitened(8), whitened(9)];
        let mut contest = Contest::new(rivals);
        let mut field = Field::new(&contest, &rows);
        for (step, candidate) in [2, 5, 2].into_iter().enumerate() {
            let own = field.rows_of(candidate);
            if step == 2 {
                contest.leave(&own);
                field.leave(candidate);
            } else {
                contest.visit(&own);
                field.take(candidate);
            }
            for other in 0..count {
                let anew = contest.criterion_with(&field.rows_of(other));
                assert!((field.criterion(other) / anew - 1.0).abs() < 1e-9);
            }
        }
        assert_eq!(field.len(), 7);
    }

    #[test]
    fn the_criterion_is_that_of_the_issue_before_any_pose() {
        // Three rivals of .5, .3, .2: Σ over ordered pairs of ½ √(π_a π_b) = √.15 + √.1 + √.06.
        let old = Mat::<f64>::identity(2, 2);
        let rivals = vec![rival(2, 1, &old, 0.5), rival(2, 2, &old, 0.3), rival(2, 3, &old, 0.2)];
        let expected = 0.15_f64.sqrt() + 0.1_f64.sqrt() + 0.06_f64.sqrt();
        assert!((Contest::new(rivals).criterion() - expected).abs() < 1e-12);
    }
}

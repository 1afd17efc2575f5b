//! Samples that resemble their neighbours: mains hum, a filter before the converter.
//!
//! Noise is modelled as a first-order autoregression with rounding on top, so that
//! samples `l ≥ 1` apart have covariance `σ² (1 - q) ρˡ`, where `q` is the share of
//! rounding, which is white. With `H` what is removed from a group of `n` samples
//! (their mean, or a line), `M = I - H`, and `C` the covariance of unit noise,
//!
//! ```text
//! s² → σ² D,     D = tr(M C) / (n - o)                                     (62)
//! P = Σ r_i r_i+1 → σ² tr(M L M C)                                         (63)
//! inflation = tr(H C) / o                                                  (64)
//! ```
//!
//! where `o` is the rank of `H` and `L` shifts by one. `P / s²` gives `ρ`, (62) how
//! much less a group scatters than its samples vary, and (64) how much more its mean
//! varies than that of independent samples.

/// What correlation does to one group of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlated {
    /// Correlation of neighbouring samples, rounding apart.
    pub rho: f64,
    /// Variance within a group, per degree of freedom, over that of a sample: `D`.
    pub shown: f64,
    /// Variance of a group's mean over that of independent samples, eq. (64).
    pub inflation: f64,
    /// The same for what varies slowly over many groups.
    pub slow: f64,
    /// Degrees of freedom, from one equation of one group, of a variance that is
    /// inflated so.
    pub dof: f64,
}

/// Groups of more samples than this are treated as if they had so many.
const LONGEST_GROUP: usize = 64;

/// From `P / s²` of the average group of `n` samples of which `order` degrees were
/// removed, with the share `q` of white rounding in `s²`.
#[must_use]
pub fn correlated(product: f64, n: usize, order: usize, q: f64) -> Correlated {
    let capped = n.min(LONGEST_GROUP);
    // Of a longer group the product per pair is what counts, without what is removed of it: of white noise -1/n for each
    // degree.
    let removed = |n: usize| order as f64 / n as f64;
    let per_pair = product / (n - 1) as f64 + removed(n) - removed(capped);
    let product = per_pair * (capped - 1) as f64;
    let (n, at) = (capped, |rho: f64| Group::new(capped, order, rho, q));
    let (mut low, mut high) = (0.0, 0.98);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if at(middle).product_over_scatter() < product { low = middle } else { high = middle }
    }
    let rho = 0.5 * (low + high);
    let (here, step) = (at(rho), 1e-4);
    let near = at(rho + step);
    // What counts is the variance of a mean, of which the data give (64) and (62) by ρ.
    let promise = |group: &Group| (group.inflation() / group.scatter).ln();
    let slope = (promise(&near) - promise(&here))
        / (near.product_over_scatter() - here.product_over_scatter());
    let long_run = 1.0 + 2.0 * (1.0 - here.q) * rho / (1.0 - rho);
    Correlated {
        rho,
        shown: here.scatter,
        inflation: here.inflation(),
        slow: if order == 1 { here.inflation() } else { long_run },
        dof: here.dof(n, slope),
    }
}

/// Expectations for one group of unit noise.
struct Group {
    order: usize,
    /// Covariance, and what is left of it on both sides, `M C` and `C`.
    covariance: Vec<f64>,
    projection: Vec<f64>,
    /// Share of rounding in the variance.
    q: f64,
    /// `D` of (62).
    scatter: f64,
    /// (63).
    product: f64,
    n: usize,
}

impl Group {
    fn new(n: usize, order: usize, rho: f64, q: f64) -> Self {
        let projection = residual_maker(n, order);
        // `q` is a share of s², which is D times the variance: found in a few turns.
        let mut share = q;
        let mut group = Self::with_share(n, order, rho, share, &projection);
        for _ in 0..3 {
            share = (q * group.scatter).min(0.95);
            group = Self::with_share(n, order, rho, share, &projection);
        }
        group
    }

    fn with_share(n: usize, order: usize, rho: f64, q: f64, projection: &[f64]) -> Self {
        let covariance: Vec<f64> = (0..n * n)
            .map(|i| match (i / n).abs_diff(i % n) {
                0 => 1.0,
                lag => (1.0 - q) * rho.powi(lag as i32),
            })
            .collect();
        let left = product(projection, &covariance, n);
        let scatter = trace(&left, n) / (n - order) as f64;
        // tr(M L M C) = tr(L M C M): the terms beside the diagonal.
        let both = product(&left, projection, n);
        let beside = (1..n).map(|i| both[i * n + i - 1]).sum();
        Self { order, covariance, projection: projection.to_vec(), q, scatter, product: beside, n }
    }

    fn product_over_scatter(&self) -> f64 {
        self.product / self.scatter
    }

    fn inflation(&self) -> f64 {
        let all = trace(&self.covariance, self.n);
        let within = self.scatter * (self.n - self.order) as f64;
        (all - within) / self.order as f64
    }

    /// `2 / var ln(s² inflation)`, to first order: `s²` and `P` are quadratic forms, and
    /// so is what they do to the logarithm, `rᵀ W r` with variance `2 tr(W C W C)`.
    fn dof(&self, n: usize, slope: f64) -> f64 {
        let free = (n - self.order) as f64;
        let on_scatter = 1.0 / self.scatter - slope * self.product / self.scatter.powi(2);
        let on_product = slope / self.scatter;
        // W = M (a I + b L) M, L symmetric.
        let inner: Vec<f64> = (0..n * n)
            .map(|i| match (i / n).abs_diff(i % n) {
                0 => on_scatter / free,
                1 => 0.5 * on_product,
                _ => 0.0,
            })
            .collect();
        let w = product(&product(&self.projection, &inner, n), &self.projection, n);
        let wc = product(&w, &self.covariance, n);
        1.0 / trace(&product(&wc, &wc, n), n)
    }
}

/// `I - H`, where `H` fits a mean (order 1) or a line (order 2) to `n` values.
fn residual_maker(n: usize, order: usize) -> Vec<f64> {
    let count = n as f64;
    let x = |i: usize| i as f64 - 0.5 * (count - 1.0);
    let moment: f64 = (0..n).map(|i| x(i).powi(2)).sum();
    (0..n * n)
        .map(|i| {
            let (row, column) = (i / n, i % n);
            let line = if order > 1 { x(row) * x(column) / moment } else { 0.0 };
            f64::from(u8::from(row == column)) - 1.0 / count - line
        })
        .collect()
}

fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for (row, out) in out.chunks_exact_mut(n).enumerate() {
        for (k, b) in b.chunks_exact(n).enumerate() {
            let factor = a[row * n + k];
            out.iter_mut().zip(b).for_each(|(o, b)| *o += factor * b);
        }
    }
    out
}

fn trace(a: &[f64], n: usize) -> f64 {
    (0..n).map(|i| a[i * n + i]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `P / s²` that independent samples would give.
    fn independent(n: usize, order: usize) -> f64 {
        Group::new(n, order, 0.0, 0.0).product_over_scatter()
    }

    #[test]
    fn independent_samples_are_not_inflated() {
        for order in [1, 2] {
            let found = correlated(independent(8, order), 8, order, 0.0);
            assert!(found.rho < 1e-9);
            assert!((found.inflation - 1.0).abs() < 1e-8);
            assert!((found.slow - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn independent_samples_of_a_long_group_are_not_taken_for_correlated() {
        // (n - 1) products of neighbours about the mean of n are -1/n each; those of 64 that stand for them -1/64.
        for (n, order) in [(65, 1), (200, 1), (1000, 1), (1000, 2)] {
            let product = -((n - 1) as f64) * order as f64 / n as f64;
            let found = correlated(product, n, order, 0.0);
            assert!(found.rho < 1e-3, "{n} {order}: {}", found.rho);
        }
    }

    #[test]
    fn a_known_correlation_is_found_through_the_loss_of_the_mean() {
        // The mean of 8 samples has V = (1 + 2 Σ (1 - l/8) 0.6^l) / 8 = 0.3848 times the
        // variance of one, and they scatter about it by 1 - V.
        let v = (1.0 + 2.0 * (1..8).map(|l| (1.0 - l as f64 / 8.0) * 0.6_f64.powi(l)).sum::<f64>())
            / 8.0;
        let product = Group::new(8, 1, 0.6, 0.0).product_over_scatter();
        let found = correlated(product, 8, 1, 0.0);
        assert!((found.rho - 0.6).abs() < 1e-9);
        assert!((found.inflation - 8.0 * v).abs() < 1e-8);
        assert!((found.shown - (1.0 - v) * 8.0 / 7.0).abs() < 1e-8);
    }

    #[test]
    fn a_mean_of_independent_samples_has_the_degrees_of_freedom_of_its_scatter() {
        let group = Group::new(8, 1, 0.0, 0.0);
        assert!((group.dof(8, 0.0) - 7.0).abs() < 1e-12);
        // Estimating the correlation, too, costs.
        assert!(correlated(independent(8, 1), 8, 1, 0.0).dof < 5.0);
    }
}

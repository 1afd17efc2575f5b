//! Tail probabilities and quantiles.

use statrs::distribution::{
    ChiSquared, ContinuousCDF, DiscreteCDF, FisherSnedecor, Normal, Poisson,
};

/// `P(χ²(dof) > x)`; one for zero degrees of freedom.
#[must_use]
pub fn chi2_tail(x: f64, dof: f64) -> f64 {
    if !x.is_finite() {
        return if x > 0.0 { 0.0 } else { 1.0 };
    }
    ChiSquared::new(dof).map_or(1.0, |d| d.sf(x.max(0.0)))
}

/// `P(F(d1, d2) > x)`, and `P(χ²(d1) > d1 x)` for infinite `d2`.
#[must_use]
pub fn f_tail(x: f64, d1: f64, d2: f64) -> f64 {
    if d2.is_infinite() || d2 > 1e7 {
        return chi2_tail(d1 * x, d1);
    }
    if !x.is_finite() {
        return if x > 0.0 { 0.0 } else { 1.0 };
    }
    FisherSnedecor::new(d1, d2).map_or(1.0, |d| d.sf(x.max(0.0)))
}

/// `x` with `P(χ²(dof) > x) = p`.
#[must_use]
pub fn chi2_quantile(p: f64, dof: f64) -> f64 {
    ChiSquared::new(dof).map_or(f64::INFINITY, |d| d.inverse_cdf(1.0 - p))
}

/// `z` with `P(N(0,1) < z) = p`.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// `P(N(0,1) < z)`.
#[must_use]
pub fn normal_cdf(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

/// `P(Poisson(mean) >= count)`.
#[must_use]
pub fn poisson_tail(count: f64, mean: f64) -> f64 {
    if count < 1.0 {
        return 1.0;
    }
    Poisson::new(mean).map_or(1.0, |d| d.sf(count as u64 - 1))
}

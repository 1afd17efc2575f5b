//! Tail probabilities and quantiles.

use statrs::distribution::{
    ChiSquared, ContinuousCDF, DiscreteCDF, FisherSnedecor, Normal, Poisson, StudentsT,
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
    if !(d1 * x).is_finite() {
        return if x > 0.0 { 0.0 } else { 1.0 };
    }
    FisherSnedecor::new(d1, d2).map_or(1.0, |d| d.sf(x.max(0.0)))
}

/// `P(χ²(dof, λ) > x)` of noncentrality `λ`: a mixture of central ones with Poisson weights.
///
/// Far out it is 0 or 1 by `P(χ² < m - 2√(v t)) ≤ e⁻ᵗ` and `P(χ² > m + 2√(v t) + 2t) ≤ e⁻ᵗ` with
/// `m = dof + λ` and `v = dof + 2λ` (Birgé 2001, lemma 8.1).
#[must_use]
pub fn chi2_beyond(x: f64, dof: f64, noncentrality: f64) -> f64 {
    const T: f64 = 80.0; // e⁻ᵗ = 2e-35
    let (mean, room) = (dof + noncentrality, 2.0 * ((dof + 2.0 * noncentrality) * T).sqrt());
    if mean.is_infinite() || x < mean - room {
        return 1.0;
    }
    if x > mean + room + 2.0 * T {
        return 0.0;
    }
    let half = 0.5 * noncentrality.max(0.0);
    // Beyond 12 standard deviations weights are below 1e-30.
    let reach = 12.0 * half.sqrt() + 30.0;
    let (low, high) = ((half - reach).max(0.0).floor(), (half + reach).ceil());
    let mut log_factorial = log_factorial(low as u64);
    let (mut sum, mut count) = (0.0, low);
    while count <= high {
        let log_weight = match half > 0.0 {
            true => count * half.ln() - half - log_factorial,
            false if count == 0.0 => 0.0,
            false => break,
        };
        sum += log_weight.exp() * chi2_tail(x, dof + 2.0 * count);
        count += 1.0;
        log_factorial += count.ln();
    }
    sum.min(1.0)
}

/// `ln n!`.
#[must_use]
pub fn log_factorial(n: u64) -> f64 {
    (1..=n).map(|k| (k as f64).ln()).sum()
}

/// `x` with `P(χ²(dof) > x) = p`, also far out in the tail; NaN where `p` is no probability.
///
/// Halved until it stands, from `P(χ² > dof + 2√(dof t) + 2t) ≤ e⁻ᵗ` (Laurent and Massart 2000, lemma 1): by `1 - p`, as
/// libraries have it, nothing is left of a small `p`.
#[must_use]
pub fn chi2_quantile(p: f64, dof: f64) -> f64 {
    if !(0.0..=1.0).contains(&p) {
        return f64::NAN;
    }
    if p == 1.0 {
        return 0.0;
    }
    let t = -p.ln();
    let (mut low, mut high) = (0.0, dof + 2.0 * (dof * t).sqrt() + 2.0 * t);
    if !high.is_finite() || ChiSquared::new(dof).is_err() {
        return f64::INFINITY;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return high;
        }
        if chi2_tail(middle, dof) > p { low = middle } else { high = middle }
    }
}

/// `z` with `P(N(0,1) < z) = p`; NaN where `p` is no probability.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    quantile(&Normal::standard(), p)
}

/// As [`two_sided_limit`], of numbers in units of a standard deviation that is known from so many degrees of freedom.
#[must_use]
pub fn student_limit(level: f64, tests: usize, dof: f64) -> f64 {
    student_quantile(1.0 - 0.5 * level / tests.max(1) as f64, dof)
}

/// `z` with `P(|N(0,1)| > z) = level` for the largest of so many tests; of one test where there are
/// none.
#[must_use]
pub fn two_sided_limit(level: f64, tests: usize) -> f64 {
    normal_quantile(1.0 - 0.5 * level / tests.max(1) as f64)
}

/// `t` with `P(Student(dof) < t) = p`; NaN where `p` is no probability or `dof` not above 0.
#[must_use]
pub fn student_quantile(p: f64, dof: f64) -> f64 {
    if dof > NORMAL {
        return normal_quantile(p);
    }
    StudentsT::new(0.0, 1.0, dof).map_or(f64::NAN, |d| quantile(&d, p))
}

/// Degrees of freedom from which Student's distribution is the normal one: their quantiles differ by
/// `(z³ + z)/(4 dof)`, less than 1e-5 of them up to six deviations.
const NORMAL: f64 = 1e6;

/// The one place that asks for a quantile: the library panics where `p` is no probability.
fn quantile(of: &impl ContinuousCDF<f64, f64>, p: f64) -> f64 {
    if (0.0..=1.0).contains(&p) { of.inverse_cdf(p) } else { f64::NAN }
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
    // The library has no Poisson distribution of mean 0, where nothing is counted.
    let none = if mean == 0.0 { 0.0 } else { 1.0 };
    Poisson::new(mean).map_or(none, |d| d.sf(count as u64 - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_probability_has_no_quantile() {
        for p in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-9, 1.0 + 1e-9] {
            assert!(normal_quantile(p).is_nan() && chi2_quantile(p, 3.0).is_nan());
        }
        assert_eq!(f_tail(f64::MAX, 9.0, 5.0), 0.0);
        assert_eq!(f_tail(f64::NAN, 9.0, 5.0), 1.0);
    }

    #[test]
    fn quantiles_of_chi_square_agree_with_scipy_far_out_too() {
        // scipy.stats.chi2.isf(p, dof), version 1.17; `1 - p` has nothing left of the first two.
        let cases = [
            (1e-200, 9.0, 959.352_963_143_349_9),
            (1e-20, 3.0, 96.239_123_938_093_81),
            (0.3, 2.5, 3.043_332_808_979_726_7),
        ];
        for (p, dof, expected) in cases {
            assert!((chi2_quantile(p, dof) / expected - 1.0).abs() < 1e-12, "{p} {dof}");
        }
        assert_eq!((chi2_quantile(0.0, 3.0), chi2_quantile(1.0, 3.0)), (f64::INFINITY, 0.0));
    }

    #[test]
    fn the_limit_of_many_tests_is_larger_and_that_of_none_is_that_of_one() {
        // scipy.stats.norm.isf(0.05 / 2) and of (0.05 / 20), version 1.17.
        assert!((two_sided_limit(0.05, 1) - 1.959_963_984_540_054).abs() < 1e-9);
        assert!((two_sided_limit(0.05, 10) - 2.807_033_768_343_811).abs() < 1e-9);
        assert_eq!(two_sided_limit(0.05, 0), two_sided_limit(0.05, 1));
    }

    #[test]
    fn noncentral_chi_square_agrees_with_scipy() {
        // scipy.stats.ncx2.sf(x, dof, nc), version 1.17.
        for (x, dof, noncentrality, expected) in CASES {
            let found = chi2_beyond(x, dof, noncentrality);
            assert!((found - expected).abs() < 1e-9, "{x} {dof} {noncentrality}: {found}");
        }
    }

    const CASES: [(f64, f64, f64, f64); 7] = [
        (20.0, 1.0, 25.0, 0.701203149232944),
        (30.0, 3.0, 60.0, 0.992285652682591),
        (180.0, 126.0, 100.0, 0.970721516745651),
        (5.0, 2.0, 0.0, 0.0820849986238988),
        (900.0, 4.0, 1000.0, 0.952686535361452),
        (1e4, 3.0, 1e30, 1.0),
        (1e30, 3.0, 1e4, 0.0),
    ];
}

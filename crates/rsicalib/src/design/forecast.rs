//! The probability that planned poses decide between explanations.
//!
//! With explanation a true, the session knows its parameters to `N_a⁻¹`. The new readings, whitened
//! and linear, are then expected to be
//!
//! ```text
//! y = W_a θ_a + L_a z,   L_a L_aᵀ = S_a = I + W_a N_a⁻¹ W_aᵀ,   z ~ N(0, I)       (98)
//! ```
//!
//! with the noise of the new poses and what the noise of the old ones has done to `θ_a`. Refitted to
//! all poses, the χ² of an explanation b grows by
//!
//! ```text
//! g_b(y) = (y - W_b θ_b)ᵀ S_b⁻¹ (y - W_b θ_b)                                  (99)
//! ```
//!
//! and a is decided for where `χ²_b + g_b(y)` is [`DECIDED`] beyond `χ²_a + g_a(y)` for all others.
//! The share of draws of `z` in which this is so is the probability: quadratic forms of one `z` have
//! no closed form together.

use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par, Side};

use crate::design::contest::{DECIDED, Rival, inverse_of};
use crate::design::linearised::Whitened;
use crate::numerics::distributions::normal_quantile;
use crate::numerics::random::Random;

/// Draws of `z`: a probability has a standard error of 1.1 % at the most.
const DRAWS: usize = 2000;

/// The stream of the draws: a forecast is the same each time.
const SEED: u64 = 98;

/// Probability that the new poses put the right explanation [`DECIDED`] ahead of every other, by the
/// probabilities of the explanations; `columns` are the parameters of each in the rows `new`.
pub(crate) fn decides(rivals: &[Rival], columns: &[&[usize]], new: &Whitened) -> f64 {
    let rows = reduced(new);
    let of = |own: &[usize]| Mat::from_fn(rows.nrows(), own.len(), |i, j| rows[(i, own[j])]);
    let sides: Vec<Predicted> =
        rivals.iter().zip(columns).map(|(rival, own)| Predicted::of(rival, &of(own))).collect();
    let z = draws(rows.nrows());
    let decided = |a: usize| {
        let noise = &sides[a].root * &z;
        let ends: Vec<Vec<f64>> = sides.iter().map(|b| b.ends(&sides[a], &noise)).collect();
        let others: Vec<&Vec<f64>> =
            (0..ends.len()).filter(|&b| b != a).map(|b| &ends[b]).collect();
        let ahead = |&draw: &usize| others.iter().all(|b| b[draw] - ends[a][draw] > DECIDED);
        (0..DRAWS).filter(ahead).count() as f64 / DRAWS as f64
    };
    let sum: f64 = rivals.iter().map(|r| r.probability).sum();
    rivals.iter().enumerate().map(|(a, r)| r.probability / sum * decided(a)).sum()
}

/// `R` of `W = Q R` where there are more equations than parameters: what no explanation reaches adds
/// the same to the χ² of all.
fn reduced(new: &Whitened) -> Mat<f64> {
    let n = new.width;
    let equations = new.len() * new.equations;
    let w = Mat::from_fn(equations, n, |i, j| new.values[i * n + j]);
    if equations > n { w.qr().thin_R().to_owned() } else { w }
}

/// What an explanation expects of the new poses.
struct Predicted {
    /// `W θ`.
    mean: Mat<f64>,
    /// `L` of (98).
    root: Mat<f64>,
    /// Penalised χ² of the session.
    chi2: f64,
}

impl Predicted {
    fn of(rival: &Rival, w: &Mat<f64>) -> Self {
        let theta = Mat::from_fn(rival.theta.len(), 1, |i, _| rival.theta[i]);
        let k = w.nrows();
        let spread =
            w * inverse_of(&rival.information) * w.transpose() + Mat::<f64>::identity(k, k);
        let root =
            spread.llt(Side::Lower).map_or_else(|_| Mat::identity(k, k), |f| f.L().to_owned());
        Self { mean: w * theta, root, chi2: rival.chi2 }
    }

    /// χ² of this explanation after the new poses, draw by draw, where another one is true.
    fn ends(&self, truth: &Self, noise: &Mat<f64>) -> Vec<f64> {
        let off = &truth.mean - &self.mean;
        let mut e = Mat::from_fn(noise.nrows(), noise.ncols(), |i, j| off[(i, 0)] + noise[(i, j)]);
        solve_lower_triangular_in_place(self.root.as_ref(), e.as_mut(), Par::Seq);
        e.col_iter().map(|column| self.chi2 + column.squared_norm_l2()).collect()
    }
}

/// Standard normal numbers, a column for each draw.
fn draws(rows: usize) -> Mat<f64> {
    let mut random = Random::new(SEED);
    // No probability of a quantile is zero or one.
    let mut normal = || normal_quantile(random.uniform(1e-15, 1.0 - 1e-15));
    Mat::from_fn(rows, DRAWS, |_, _| normal())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distributions::normal_cdf;

    /// Five standard errors of a share of the draws.
    const NEAR: f64 = 5.0 * 0.5 / 44.7;

    fn rival(theta: f64, sd: f64, probability: f64) -> Rival {
        let information = Mat::from_fn(1, 1, |_, _| 1.0 / (sd * sd));
        Rival { theta: vec![theta], information, probability, chi2: 0.0 }
    }

    /// Of two rivals that expect one reading, or several alike.
    fn of(rivals: &[Rival; 2], slope: f64, poses: usize) -> f64 {
        let new = Whitened { equations: 1, width: 1, values: vec![slope; poses] };
        decides(rivals, &[&[0], &[0]], &new)
    }

    #[test]
    fn known_parameters_leave_a_normal_distribution() {
        // (d + z)² - z² = d² + 2 d z: beyond 12 where z > (12 - d²) / (2 d).
        for apart in [2.0, 12.0_f64.sqrt(), 48.0_f64.sqrt()] {
            let known = [rival(0.0, 1e-4, 0.5), rival(apart, 1e-4, 0.5)];
            let expected = normal_cdf((apart * apart - 12.0) / (2.0 * apart));
            assert!((of(&known, 1.0, 1) - expected).abs() < NEAR, "{expected}");
        }
    }

    #[test]
    fn what_is_uncertain_of_the_truth_is_averaged_over() {
        // One truth that is known to 3 and one known to 1e-4, of which the first has all probability:
        // y = √10 z against 5, so that (√10 z - 5)² - z² > 12 where 9 z² - 10 √10 z + 13 > 0.
        let rivals = [rival(0.0, 3.0, 1.0), rival(5.0, 1e-4, 0.0)];
        let (half, root) = (5.0 * 10.0_f64.sqrt() / 9.0, (250.0 - 9.0 * 13.0_f64).sqrt() / 9.0);
        let expected = normal_cdf(half - root) + 1.0 - normal_cdf(half + root);
        assert!((of(&rivals, 1.0, 1) - expected).abs() < NEAR, "{expected}");
        // A rival that may be anything imitates the truth, with a larger spread alone: never 12 more.
        let loose = [rival(0.0, 1e-4, 1.0), rival(0.0, 1e4, 0.0)];
        assert!(of(&loose, 1.0, 1) < 0.01);
    }

    #[test]
    fn many_readings_of_one_thing_are_one_good_reading() {
        // Four readings alike are one of four times the information: twice the slope.
        let rivals = [rival(0.0, 1.0, 0.6), rival(4.0, 0.5, 0.4)];
        let (many, one) = (of(&rivals, 1.0, 4), of(&rivals, 2.0, 1));
        assert!((many - one).abs() < NEAR, "{many} {one}");
        assert!(one > 0.02 && one < 0.98);
    }
}

//! One variance component beside noise, by restricted maximum likelihood.
//!
//! With `u = Zᵀ r`, what a fit leaves of the columns `Z` of random effects, and `C = Zᵀ P Z = V c Vᵀ`,
//! what it leaves of themselves, `w = Vᵀ u` and `λ = τ²/φ`,
//!
//! ```text
//! -2 ln L = ν ln φ + (χ² - R)/φ + Σ ln(1 + λ c),    R = Σ λ w²/(1 + λ c),    φ = (χ² - R)/ν   (131)
//! ```
//!
//! for effects `N(0, τ²)` and noise of the variance `φ`, of at least what is known of it. Beforehand a
//! `τ` is as likely as what tells of it there is:
//!
//! ```text
//! p(√λ) ∝ √λ (Σ c²/(1 + λ c)²)^½                                             (171)
//! ```

use crate::numerics::order::Ends;
use faer::MatRef;

use crate::numerics::distributions::chi2_tail;
use crate::numerics::symmetric::eigenvalues;

/// A variance component: effects have the standard deviation `sd`, in units of their typical sizes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Most likely standard deviation.
    pub sd: f64,
    /// Between 2.5 and 97.5 % of it, with (171) beforehand; from 0 on where none at all is within 95 % of
    /// the likelihood.
    pub interval: [f64; 2],
    /// Probability by chance of so much, were there none.
    pub p_value: f64,
    /// Variance of the normal distribution that has the 95 % interval of one more effect, an `sd` below 1
    /// being as likely beforehand as (171) has it: few groups do not show that there is none. Of `k`
    /// equal contrasts that is Student's interval by `k` degrees of freedom.
    pub variance: f64,
    /// Variance of the noise beside it.
    pub noise: f64,
}

/// What is told of a component.
pub(crate) struct Contrasts {
    /// `c` and `w²`.
    pairs: Vec<[f64; 2]>,
    /// `χ²`
    pub(crate) chi2: f64,
    /// `ν`
    pub(crate) dof: f64,
    /// Smallest variance that the noise can have.
    pub(crate) least: f64,
}

/// Standard deviations that are tried, over the decades in which data tell something.
const TRIED: usize = 400;

/// Part of a contrast that is no rounding.
const PART: f64 = 1e-9;

/// χ² of one degree of freedom that is exceeded with 5 %.
const WITHIN: f64 = 3.841_458_820_694_124;

impl Contrasts {
    /// Of `C` and `u`; none where nothing is left of the effects.
    pub(crate) fn of(c: MatRef<'_, f64>, u: &[f64], [chi2, dof, least]: [f64; 3]) -> Option<Self> {
        let (values, vectors) = eigenvalues(c)?;
        let largest = values.last().copied().filter(|v| *v > 0.0)?;
        let along = |k: usize| u.iter().enumerate().map(|(i, u)| vectors[(i, k)] * u).sum::<f64>();
        let kept = (0..values.len()).filter(|&k| values[k] > PART * largest);
        let pairs = kept.map(|k| [values[k], along(k).powi(2)]).collect();
        (dof >= 1.0 && chi2.is_finite()).then_some(Self { pairs, chi2, dof, least })
    }

    /// `-2 ln L` and `φ` of `λ`.
    fn at(&self, lambda: f64) -> [f64; 2] {
        let (left, volume) = (self.left(lambda), self.volume(lambda));
        let noise = (left / self.dof).max(self.least).max(f64::MIN_POSITIVE);
        [self.dof * noise.ln() + left / noise + volume, noise]
    }

    /// `χ² - R` beside effects of a ratio `λ` to the noise.
    fn left(&self, lambda: f64) -> f64 {
        let taken = self.pairs.iter().map(|[c, square]| lambda * square / (1.0 + lambda * c));
        self.chi2 - taken.sum::<f64>()
    }

    /// `Σ ln(1 + λ c)`.
    fn volume(&self, lambda: f64) -> f64 {
        self.pairs.iter().map(|[c, _]| (lambda * c).ln_1p()).sum()
    }

    /// (171): how likely a ratio of standard deviations is beforehand, by Jeffreys' rule.
    fn beforehand(&self, ratio: f64) -> f64 {
        let told = self.pairs.iter().map(|[c, _]| (c / (1.0 + ratio * ratio * c)).powi(2));
        ratio * told.sum::<f64>().sqrt()
    }

    /// Ratios of standard deviations that are tried, each with the width that it stands for; none where
    /// even effects of their typical sizes would not be seen.
    fn ratios(&self) -> Option<Vec<[f64; 2]>> {
        let largest = self.pairs.iter().fold(0.0, |m: f64, [c, _]| m.max(*c));
        let first = 1e-3 / largest.sqrt();
        if self.pairs.is_empty() || first.is_nan() || first >= 1e-2 {
            return None;
        }
        let step = (1.0 / first).ln() / (TRIED - 1) as f64;
        let ratios = (0..TRIED).map(|k| first * (step * k as f64).exp());
        let all = ratios.map(|ratio| [ratio, ratio * step]);
        Some(std::iter::once([0.0, 0.5 * first]).chain(all).collect())
    }

    /// What is told of standard deviations; none where even effects of their typical sizes would not be seen.
    fn tried(&self) -> Option<Tried> {
        let one = |[ratio, width]: [f64; 2]| {
            let [cost, noise] = self.at(ratio * ratio);
            [ratio * noise.sqrt(), cost, noise, width * self.beforehand(ratio)]
        };
        let mut all: Vec<[f64; 4]> = self.ratios()?.into_iter().map(one).collect();
        let best = all.iter().copied().least_by(|a| a[1])?;
        let fall = all[0][1] - best[1];
        all.iter_mut().for_each(|t| t[3] *= (-0.5 * (t[1] - best[1])).exp());
        let sum: f64 = all.iter().map(|t| t[3]).sum();
        all.iter_mut().for_each(|t| t[3] /= sum);
        Some(Tried { all, sd: best[0], fall })
    }

    /// The component; none where even effects of their typical sizes would not be seen.
    pub(crate) fn component(&self) -> Option<Component> {
        let tried = self.tried()?;
        let mean = |of: &dyn Fn(&[f64; 4]) -> f64| tried.all.iter().map(|t| t[3] * of(t)).sum();
        let size = within(|size| mean(&|t| beyond(size, t[0])));
        Some(Component {
            sd: tried.sd,
            interval: tried.interval(),
            p_value: if tried.fall > 0.0 { 0.5 * chi2_tail(tried.fall, 1.0) } else { 1.0 },
            variance: (size / WITHIN.sqrt()).powi(2),
            noise: mean(&|t| t[2]),
        })
    }
}

/// Standard deviations that are tried.
struct Tried {
    /// Each in ascending order, its `-2 ln L` and `φ`, and how probable it and its neighbours are.
    all: Vec<[f64; 4]>,
    /// The most likely.
    sd: f64,
    /// How far `-2 ln L` falls to it from none at all.
    fall: f64,
}

impl Tried {
    fn interval(&self) -> [f64; 2] {
        let [low, high] = [0.025, 0.975].map(|p| self.quantile(p));
        [if self.fall <= WITHIN { 0.0 } else { low.min(self.sd) }, high.max(self.sd)]
    }

    /// Half of the probability of a place that is tried is below it.
    fn quantile(&self, p: f64) -> f64 {
        let (mut below, mut last) = (0.0, [0.0, 0.0]);
        for &[value, .., probability] in &self.all {
            let here = below + 0.5 * probability;
            if here >= p {
                let part = if here > last[1] { (p - last[1]) / (here - last[1]) } else { 1.0 };
                return last[0] + part * (value - last[0]);
            }
            (below, last) = (below + probability, [value, here]);
        }
        last[0]
    }
}

/// Probability that an effect of a standard deviation is larger than a size.
fn beyond(size: f64, sd: f64) -> f64 {
    if sd > 0.0 { chi2_tail((size / sd).powi(2), 1.0) } else { 0.0 }
}

/// The size that is exceeded with 5 %, of effects of at most a few times their typical size.
fn within(exceeded: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while exceeded(high) > 0.05 && high < 1e3 {
        high *= 2.0;
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if exceeded(middle) > 0.05 { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::numerics::random::Random;

    /// -2 ln of the restricted likelihood of plain matrices: `y ~ N(X β, φ I + τ² Z Zᵀ)`.
    fn plain(x: &DMatrix<f64>, z: &DMatrix<f64>, y: &DVector<f64>, [tau, noise]: [f64; 2]) -> f64 {
        let n = y.len();
        let v = DMatrix::identity(n, n) * noise + z * z.transpose() * (tau * tau);
        let inverse = v.clone().try_inverse().expect("positive");
        let normal = x.transpose() * &inverse * x;
        let solved = normal.clone().try_inverse().expect("full rank");
        let left = &inverse - &inverse * x * solved * x.transpose() * &inverse;
        v.determinant().ln() + normal.determinant().ln() + (y.transpose() * left * y)[(0, 0)]
    }

    #[test]
    fn the_likelihood_is_that_of_plain_matrices() {
        let mut random = Random::new(7);
        let (n, p, m) = (24, 3, 8);
        let x = DMatrix::from_fn(n, p, |_, _| random.uniform(-1.0, 1.0));
        // Two random effects in each of four groups.
        let z =
            DMatrix::from_fn(
                n,
                m,
                |i, k| {
                    if i / 6 == k / 2 { random.uniform(-20.0, 20.0) } else { 0.0 }
                },
            );
        let y = DVector::from_fn(n, |_, _| random.uniform(-3.0, 3.0));
        let normal = (x.transpose() * &x).try_inverse().expect("full rank");
        let hat = &x * normal * x.transpose();
        let r = &y - &hat * &y;
        let c = z.transpose() * (DMatrix::identity(n, n) - hat) * &z;
        let u = z.transpose() * &r;
        let square = faer::Mat::from_fn(m, m, |i, j| c[(i, j)]);
        let told = [r.norm_squared(), (n - p) as f64, 0.0];
        let found = Contrasts::of(square.as_ref(), u.as_slice(), told).expect("told");
        let mut differences = Vec::new();
        for ratio in [0.0, 0.01, 0.1, 0.5] {
            let [cost, noise] = found.at(ratio * ratio);
            let witness = plain(&x, &z, &y, [ratio * noise.sqrt(), noise]);
            differences.push(cost - witness);
        }
        // They differ by a constant: what X alone gives.
        assert!(differences.iter().all(|d| (d - differences[0]).abs() < 1e-9), "{differences:?}");
        let component = found.component().expect("seen");
        let [low, high] = component.interval;
        assert!(low <= component.sd && component.sd <= high);
        assert!(component.variance > component.sd * component.sd);
    }

    #[test]
    fn one_more_effect_has_students_interval() {
        // Equal contrasts, exact but for little noise: the root mean square of effects is s.
        let s: f64 = 1e-3;
        for (k, student) in [(3, 3.182_45), (4, 2.776_45), (8, 2.306_00), (20, 2.085_96)] {
            let pairs = vec![[1e12, (1e12 * s).powi(2)]; k];
            let chi2 = 1e6 + k as f64 * 1e12 * s * s;
            let told = Contrasts { pairs, chi2, dof: 1e6, least: 1.0 };
            let found = told.component().expect("seen");
            let interval = found.variance.sqrt() * WITHIN.sqrt();
            assert!((interval / (student * s) - 1.0).abs() < 0.03, "{k}: {interval}");
        }
    }

    #[test]
    fn equal_contrasts_have_the_interval_of_chi_square() {
        let s: f64 = 1e-3;
        // 2.5 and 97.5 % of χ² of k degrees of freedom, from tables.
        for (k, least, most) in
            [(2, 0.050_636, 7.377_76), (3, 0.215_795, 9.348_40), (7, 1.689_87, 16.012_8)]
        {
            let pairs = vec![[1e12, (1e12 * s).powi(2)]; k];
            let chi2 = 1e6 + k as f64 * 1e12 * s * s;
            let told = Contrasts { pairs, chi2, dof: 1e6, least: 1.0 };
            let [low, high] = told.tried().expect("seen").interval();
            let k = k as f64;
            assert!((low / s / (k / most).sqrt() - 1.0).abs() < 0.01, "{k}: {low}");
            assert!((high / s / (k / least).sqrt() - 1.0).abs() < 0.01, "{k}: {high}");
        }
    }

    #[test]
    fn unequal_contrasts_beside_noise_have_intervals_that_hold() {
        use crate::numerics::draws::Draws;
        let (mut random, trials, rest) = (Draws::new(23), 3000, 1000);
        for (count, sd) in [(4, 0.01), (28, 0.005)] {
            let mut held = 0.0;
            for _ in 0..trials {
                // From well known to hardly seen: τ²c from 100 to 0.1.
                let c = |k: usize| 10.0_f64.powf(2.0 - 3.0 * k as f64 / count as f64) / (sd * sd);
                let pairs: Vec<[f64; 2]> = (0..count)
                    .map(|k| [c(k), c(k) * (1.0 + sd * sd * c(k)) * random.normal().powi(2)])
                    .collect();
                let noise: f64 = (0..rest).map(|_| random.normal().powi(2)).sum();
                let chi2 = noise + pairs.iter().map(|[c, square]| square / c).sum::<f64>();
                let told = Contrasts { pairs, chi2, dof: (rest + count) as f64, least: 0.0 };
                let [low, high] = told.tried().expect("seen").interval();
                held += f64::from(u8::from(low <= sd && sd <= high));
            }
            let share = held / f64::from(trials);
            // Three standard errors.
            let scatter = 3.0 * (0.95 * 0.05 / f64::from(trials)).sqrt();
            assert!((share - 0.95).abs() < scatter, "{count}: {share}");
        }
    }
}

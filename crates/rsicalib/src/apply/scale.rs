//! How large errors that a result leaves are, by known poses that were not fitted.
//!
//! Where a result leaves something unexplained, nothing says that its covariance is right: a draw of its
//! errors is taken `s` times. It makes errors at the known poses, whose squares there have the sum `s² M`;
//! `Q` was seen, with noise of the variance `r` in each of `n` coordinates. Beforehand `ln s` is anything
//! above 0, all alike: what is left makes errors larger. Then
//!
//! ```text
//! p(s² M | Q) ∝ f(Q; s² M),  s ≥ 1;    w = ∫ f(Q; A) d ln A  from M on        (146)
//! ```
//!
//! is the distribution of `s` of a draw, and its weight `w` among all draws. `f` is the density of `r` times a
//! `χ²` of `n` degrees of freedom with the noncentrality `A/r`, by that of a central one with the same mean
//! and variance (Patnaik, *Biometrika* 36, 1949).

use statrs::function::gamma::ln_gamma;

use crate::numerics::draws::Draws;

/// Sizes that are tried, over so many powers of e.
const TRIED: usize = 4000;
const WIDE: f64 = 25.0;

/// Noise is at least this part of what is seen, so that what is tried is hardly coarser than the density.
const PART: f64 = 4e-4;

/// How large errors at known poses may be, noise taken out.
pub(crate) struct Sizes {
    /// Logarithm of the first that is tried, and the step from one to the next.
    first: f64,
    step: f64,
    /// How probable each and all larger ones are.
    beyond: Vec<f64>,
}

impl Sizes {
    /// Of the mean square of so many coordinates, and the same by noise.
    pub fn of(square: f64, noise: f64, coordinates: f64) -> Self {
        let noise = noise.max(PART * square).max(f64::MIN_POSITIVE);
        let sum = coordinates * square;
        let last = (4.0 * sum + 100.0 * noise).ln();
        let (first, step) = (last - WIDE, WIDE / TRIED as f64);
        let likelihood = |size: f64| {
            let mean = coordinates * noise + size;
            let variance = 2.0 * coordinates * noise * noise + 4.0 * noise * size;
            let half = mean * mean / variance;
            let part = (half * sum / mean).max(f64::MIN_POSITIVE);
            half * part.ln() - part - ln_gamma(half)
        };
        let all: Vec<f64> =
            (0..TRIED).map(|i| likelihood((first + step * i as f64).exp())).collect();
        let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut beyond: Vec<f64> = all.iter().map(|l| (l - most).exp()).collect();
        for i in (0..TRIED - 1).rev() {
            beyond[i] += beyond[i + 1];
        }
        Self { first, step, beyond }
    }

    /// `w` of a draw that makes errors of this size.
    pub fn weight(&self, made: f64) -> f64 {
        self.beyond.get(self.place(made)).copied().unwrap_or(0.0)
    }

    /// A size that is not smaller than what a draw makes.
    pub fn draw(&self, made: f64, random: &mut Draws) -> f64 {
        let left = self.weight(made) * random.uniform();
        let at = self.beyond.partition_point(|beyond| *beyond > left).max(1) - 1;
        (self.first + self.step * at as f64).exp().max(made)
    }

    /// The first that is tried of those not smaller.
    fn place(&self, made: f64) -> usize {
        ((made.ln() - self.first) / self.step).ceil().max(0.0) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::order;

    /// Sum of squares of errors at known poses: of some independent causes, each with its coordinates, and noise.
    fn sum(by: &[[f64; 6]], causes: &[f64], noise: [f64; 6]) -> f64 {
        (0..6)
            .map(|i| by.iter().zip(causes).map(|(by, cause)| by[i] * cause).sum::<f64>() + noise[i])
            .map(|error| error * error)
            .sum()
    }

    #[test]
    fn errors_elsewhere_are_within_their_quantile_as_often_as_it_says() {
        // Three causes, seen unequally well in six coordinates; elsewhere they do something else.
        let by = [
            [1.0, 0.5, -0.3, 0.2, 0.7, -0.4],
            [0.2, -0.6, 0.4, 0.5, -0.1, 0.3],
            [0.1, 0.1, 0.2, -0.2, 0.1, 0.3],
        ];
        let elsewhere = [0.8, -0.9, 0.7];
        let mut random = Draws::new(31);
        let (trials, draws) = (500, 600);
        for (s, noise) in [(5.0, 0.01), (5.0, 0.8), (2.0, 0.3)] {
            let mut held = 0.0;
            for _ in 0..trials {
                let causes = [0; 3].map(|_| s * random.normal());
                let noises = [0; 6].map(|_| noise * random.normal());
                let seen = sum(&by, &causes, noises);
                let truth = (0..3).map(|k| elsewhere[k] * causes[k]).sum::<f64>().abs();
                let sizes = Sizes::of(seen / 6.0, noise * noise, 6.0);
                let mut all: Vec<[f64; 2]> = (0..draws)
                    .map(|_| {
                        let causes = [0; 3].map(|_| random.normal());
                        let made = sum(&by, &causes, [0.0; 6]);
                        let times = (sizes.draw(made, &mut random) / made).sqrt();
                        let error = (0..3).map(|k| elsewhere[k] * causes[k]).sum::<f64>();
                        [times * error.abs(), sizes.weight(made)]
                    })
                    .collect();
                order::ascending(&mut all, |a| a[0]);
                let mut left = 0.95 * all.iter().map(|[_, weight]| weight).sum::<f64>();
                let within = all.iter().find(|[_, weight]| {
                    left -= weight;
                    left <= 0.0
                });
                held += f64::from(u8::from(within.is_some_and(|[size, _]| truth <= *size)));
            }
            let share = held / f64::from(trials);
            // Three standard errors. Where noise hides a part of what is seen, larger errors are as probable
            // as those that are hidden, and more are held.
            let scatter = 3.0 * (0.95 * 0.05 / f64::from(trials)).sqrt();
            let hidden = if noise > 0.1 { 0.03 } else { 0.0 };
            assert!(
                share > 0.95 - scatter && share < 0.95 + scatter + hidden,
                "{s} {noise}: {share}"
            );
        }
    }

    #[test]
    fn without_noise_a_draw_is_as_large_as_what_was_seen_and_never_smaller_than_it_is() {
        let (sizes, mut random) = (Sizes::of(4.0, 0.0, 30.0), Draws::new(2));
        for _ in 0..100 {
            // Noise of 2 % of the size: 0.7 % of the sum of 30 squares. Four of these.
            let size = sizes.draw(1.0, &mut random);
            assert!((size / 120.0 - 1.0).abs() < 0.03, "{size}");
        }
        assert!(sizes.weight(1.0) > 0.0 && sizes.weight(200.0) < 1e-9 * sizes.weight(1.0));
        // Noise that explains what was seen hides everything that is smaller.
        let hidden = Sizes::of(1.0, 1.0, 30.0);
        assert!(hidden.draw(1e-6, &mut random) < 40.0);
        assert!(hidden.weight(1e-6) > 2.0 * hidden.weight(1.0));
    }
}

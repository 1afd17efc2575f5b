//! Noise that nobody knows of, at a channel or at all channels of a chain.
//!
//! A coarse sensor, or one that follows no law, is no effect: errors of `v` times the variance of its
//! noise, of each pose by themselves, have the likelihood ratio (75)
//!
//! ```text
//! -2 ln L = Σ ln det(1 + v B) - rᵀ (1 - (1 + v B)⁻¹) r,    B = Σ σ_c² a_c a_cᵀ
//! ```
//!
//! pose by pose. What is found beside it stands out of that noise.

use nalgebra::{DMatrix, DVector};

use crate::diagnosis::isolation::channels_of;
use crate::diagnosis::price::{Family, item, mean, prior};
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::numerics::workers;

/// Factors of the variance that are tried, the square root of ten apart, from the noise on.
const VARIANCES: i32 = 12;

/// Noise that nobody knows of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnknownNoise {
    /// Where it is.
    pub target: Target,
    /// Its variance, over that of the noise that is known.
    pub variance: f64,
    /// What it costs: its marginal likelihood over its variance, and its places.
    pub paid: f64,
    /// By how much χ² falls beside the same parameters.
    pub fall: f64,
}

/// The likeliest such noise at each channel and chain at a fit.
pub fn unknown_noises(observations: &Observations, fit: &Fit) -> Vec<UnknownNoise> {
    let mechanism = &observations.mechanism;
    let channels = (0..mechanism.channels.len()).map(Target::Channel);
    let chains = match mechanism.chains.len() {
        0 | 1 => 0..0,
        chains => 0..chains,
    };
    let targets: Vec<Target> = channels.chain(chains.map(Target::Chain)).collect();
    let price = item(0.0, targets.len() as f64 / prior(Family::Free));
    let of = |target: Target| -> Option<UnknownNoise> {
        let poses = poses(observations, fit, &channels_of(mechanism, target));
        let each = (0..VARIANCES).filter_map(|k| {
            let variance = 10.0_f64.powf(0.5 * f64::from(k));
            let (volume, fall) = ratio(&poses, variance)?;
            Some((variance, volume, fall))
        });
        let each: Vec<(f64, f64, f64)> = each.collect();
        let all = mean(each.iter().map(|(_, volume, fall)| (volume - fall, 1.0)));
        let best = each.into_iter().min_by(|a, b| (a.1 - a.2).total_cmp(&(b.1 - b.2)));
        best.map(|(variance, _, fall)| UnknownNoise {
            target,
            variance,
            paid: price + all + fall,
            fall,
        })
    };
    workers::map(targets, of).into_iter().flatten().collect()
}

/// `Σ ln det(1 + v B)` and `Σ rᵀ (1 - (1 + v B)⁻¹) r`; none where that is no covariance.
fn ratio(poses: &[(DMatrix<f64>, DVector<f64>)], variance: f64) -> Option<(f64, f64)> {
    let (mut volume, mut fall) = (0.0, 0.0);
    for (b, r) in poses {
        let k = r.len();
        let root = (DMatrix::identity(k, k) + b * variance).cholesky()?;
        volume += root.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>();
        fall += r.norm_squared() - r.dot(&root.solve(r));
    }
    Some((volume, fall))
}

/// `B` and `r` of each sample that counts.
fn poses(
    observations: &Observations,
    fit: &Fit,
    channels: &[usize],
) -> Vec<(DMatrix<f64>, DVector<f64>)> {
    let residuals = &fit.residuals;
    let (k, n) = (residuals.equations, observations.readings.channels);
    let sigma = fit.assumed().sigma;
    let rows = (0..observations.readings.samples).filter(|&row| observations.weights[row] > 0.0);
    rows.map(|row| {
        let r = DVector::from_row_slice(&residuals.whitened[row * k..(row + 1) * k]);
        let a = DMatrix::from_fn(k, channels.len(), |e, c| {
            let channel = channels[c];
            residuals.by_reading[(row * k + e) * n + channel] * sigma[channel]
                / observations.weights[row]
        });
        (&a * a.transpose(), r)
    })
    .collect()
}

impl UnknownNoise {
    /// The session with this noise.
    pub fn in_session(&self, observations: &mut Observations, fit: &Fit) {
        let mut sigma = fit.assumed().sigma;
        for channel in channels_of(&observations.mechanism, self.target) {
            sigma[channel] *= (1.0 + self.variance).sqrt();
        }
        observations.options.noise = Some(sigma);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::ratio;

    #[test]
    fn it_is_the_density_of_the_residuals_with_more_noise_in_some_readings() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + j) as f64).sin();
        let pose = |p: usize| {
            let a = DMatrix::from_fn(3, 2, |i, j| odd(i + 3 * p, j));
            (&a * a.transpose(), DVector::from_fn(3, |i, _| 2.0 * odd(i + 3 * p, 5)))
        };
        let poses = [pose(0), pose(1)];
        let (volume, fall) = ratio(&poses, 2.5).expect("a covariance");
        // By the inverse and the determinant of the covariance of both poses at once.
        let mut cover = DMatrix::<f64>::identity(6, 6);
        let mut all = DVector::<f64>::zeros(6);
        for (p, (b, r)) in poses.iter().enumerate() {
            let mut block = cover.view_mut((3 * p, 3 * p), (3, 3));
            block += b * 2.5;
            all.rows_mut(3 * p, 3).copy_from(r);
        }
        let wanted = all.norm_squared()
            - (all.transpose() * cover.clone().try_inverse().expect("an inverse") * &all)[(0, 0)];
        assert!((fall - wanted).abs() < 1e-12 * wanted, "{fall} for {wanted}");
        let wanted = cover.determinant().ln();
        assert!((volume - wanted).abs() < 1e-12 * wanted.abs(), "{volume} for {wanted}");
    }
}

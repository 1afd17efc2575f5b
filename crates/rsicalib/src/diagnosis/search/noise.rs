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

use crate::numerics::order::Ends;
use nalgebra::{DMatrix, DVector};

use crate::diagnosis::isolation::channels_of;
use crate::diagnosis::price::{Family, Said, of_number, of_places, prior};
use crate::diagnosis::score::scored::{Scored, is_data};
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::numerics::workers;

/// Factors of the variance that are tried, the square root of ten apart, from the noise on.
const VARIANCES: i32 = 12;

/// Those factors.
fn variances() -> impl Iterator<Item = f64> {
    (0..VARIANCES).map(|k| 10.0_f64.powf(0.5 * f64::from(k)))
}

/// Noise that nobody knows of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnknownNoise {
    /// Where it is.
    pub target: Target,
    /// Its variance, over that of the noise that is known.
    pub variance: f64,
    /// What its places and its variance cost.
    pub places: f64,
    /// `Σ ln det(1 + v B)`.
    pub volume: f64,
}

/// The likeliest such noise at each channel and chain at a fit.
pub fn unknown_noises(observations: &Observations, fit: &Fit, said: &Said) -> Vec<UnknownNoise> {
    let mechanism = &observations.mechanism;
    let channels = (0..mechanism.channels.len()).map(Target::Channel);
    let chains = match mechanism.chains.len() {
        0 | 1 => 0..0,
        chains => 0..chains,
    };
    let targets: Vec<Target> = channels.chain(chains.map(Target::Chain)).collect();
    let places = targets.len() as f64 / prior(Family::Free) * f64::from(VARIANCES);
    let of = |target: Target| {
        let none = UnknownNoise { target, variance: 0.0, places: of_places(places), volume: 0.0 };
        let shown = Shown::of(observations, fit, none, *said);
        let (likeliest, fall) = shown.likeliest()?;
        (likeliest.places + likeliest.volume < fall).then_some(likeliest)
    };
    workers::map(targets, of).into_iter().flatten().collect()
}

/// What a fit shows of the noise at a target.
pub struct Shown {
    /// The noise of the fit.
    noise: UnknownNoise,
    said: Said,
    axes: Vec<Axis>,
    /// What is as large as the way of a channel is no noise.
    largest: f64,
}

impl Shown {
    /// Of a fit in a session with a noise.
    pub fn of(observations: &Observations, fit: &Fit, noise: UnknownNoise, said: Said) -> Self {
        let channels = channels_of(&observations.mechanism, noise.target);
        let axes = axes(observations, fit, &channels);
        let sigma = fit.assumed().sigma;
        let largest = channels.iter().map(|&c| {
            let [low, high] = fit.model.scales[c].span;
            (1.0 + noise.variance) * ((high - low) / sigma[c]).powi(2)
        });
        Self { noise, said, axes, largest: largest.fold(f64::INFINITY, f64::min) }
    }

    /// The noise of another variance, and by how much what readings say falls with it.
    fn of_variance(&self, variance: f64) -> Option<(UnknownNoise, f64)> {
        // The fit's residuals are in units of the noise that is there already; the other noise may be
        // `1/scale` times as large as it is known.
        let own = self.noise.variance;
        let more = |variance: f64, scale: f64| (scale * variance - own) / (1.0 + own);
        let (none, _) = ratio(&self.axes, more(0.0, 1.0))?;
        let (_, explained) = ratio(&self.axes, more(variance, 1.0))?;
        let (volume, fall) = ratio(&self.axes, more(variance, self.said.scale(explained)))?;
        let noise = UnknownNoise { variance, volume: volume - none, ..self.noise };
        Some((noise, self.said.fall(fall)))
    }

    /// The likeliest noise, and by how much what readings say falls with it.
    pub fn likeliest(&self) -> Option<(UnknownNoise, f64)> {
        let each = variances().take_while(|variance| *variance < self.largest);
        let each = each.filter_map(|variance| self.of_variance(variance));
        each.least_by(|(one, fall)| one.volume - fall)
    }

    /// The noise of the fit, with its price there.
    pub fn itself(&self) -> UnknownNoise {
        self.of_variance(self.noise.variance).map_or(self.noise, |(noise, _)| noise)
    }

    /// Noises to try next: the likeliest, and if wanted the next larger one, since what a fit has bent hides it.
    pub fn next(&self, larger_too: bool) -> Vec<UnknownNoise> {
        let likeliest = self.likeliest().filter(|(it, _)| it.variance != self.noise.variance);
        let larger = variances().find(|variance| larger_too && *variance > self.noise.variance);
        let larger = larger.filter(|variance| *variance < self.largest);
        let larger = larger.and_then(|variance| self.of_variance(variance));
        likeliest.into_iter().chain(larger).map(|(noise, _)| noise).collect()
    }
}

/// Factors of the variance of noise that are tried for [`scatter`]: of (75) only the largest matters, and
/// between two that are a factor of 1.5 apart the likelihood hardly changes.
const SCATTER: i32 = 60;

/// Twice the logarithm of how much likelier the residual becomes by (75), with the variance of these channels
/// between poses that makes the residual likeliest.
pub fn scatter(observations: &Observations, fit: &Fit, channels: &[usize]) -> f64 {
    let axes = axes(observations, fit, channels);
    let usual = axes.iter().map(|axis| axis.square).sum::<f64>() / axes.len().max(1) as f64;
    // From a hundredth of the noise on.
    let variances = (0..SCATTER).map(|k| 0.01 * 1.5_f64.powi(k) / usual);
    let each = variances.filter_map(|v| ratio(&axes, v).map(|(volume, fall)| fall - volume));
    each.fold(0.0, f64::max)
}

/// `Σ ln det(1 + v B)` and `Σ rᵀ (1 - (1 + v B)⁻¹) r`; none where that is no covariance.
fn ratio(axes: &[Axis], variance: f64) -> Option<(f64, f64)> {
    let (mut volume, mut fall) = (0.0, 0.0);
    for Axis { square, along } in axes {
        let more = variance * square;
        if more <= -1.0 {
            return None;
        }
        volume += more.ln_1p();
        fall += along * more / (1.0 + more);
    }
    Some((volume, fall))
}

/// A principal axis of `B` of a sample.
struct Axis {
    /// The eigenvalue of `B`.
    square: f64,
    /// The square of `r` along it.
    along: f64,
}

/// The axes of `B = A Aᵀ` of a sample, with `r` along them, by those of `AᵀA`.
fn axes_of(a: &DMatrix<f64>, r: &DVector<f64>) -> impl Iterator<Item = Axis> + use<> {
    let eigen = (a.transpose() * a).symmetric_eigen();
    let towards = eigen.eigenvectors.tr_mul(&(a.transpose() * r));
    let least = f64::EPSILON * eigen.eigenvalues.max();
    let each = eigen.eigenvalues.data.as_vec().clone().into_iter().enumerate();
    let seen = each.filter(move |(_, square)| *square > least);
    seen.map(move |(k, square)| Axis { square, along: towards[k].powi(2) / square })
}

/// Those of each sample that counts.
fn axes(observations: &Observations, fit: &Fit, channels: &[usize]) -> Vec<Axis> {
    let residuals = &fit.residuals;
    let (k, n) = (residuals.equations, observations.readings.channels);
    let sigma = fit.assumed().sigma;
    let rows = (0..observations.readings.samples).filter(|&row| observations.weights[row] > 0.0);
    rows.flat_map(|row| {
        let r = DVector::from_row_slice(&residuals.whitened[row * k..(row + 1) * k]);
        let a = DMatrix::from_fn(k, channels.len(), |e, c| {
            let channel = channels[c];
            residuals.by_reading[(row * k + e) * n + channel] * sigma[channel]
                / observations.weights[row]
        });
        axes_of(&a, &r)
    })
    .collect()
}

impl UnknownNoise {
    /// What it costs beside items: it is one more thing that is wrong.
    pub fn paid_beside(&self, items: &[Scored]) -> f64 {
        let effects = items.iter().filter(|item| !is_data(&item.instance)).count();
        self.places + self.volume + of_number(effects + 1) - of_number(effects)
    }

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

    use super::{Axis, axes_of, ratio};

    #[test]
    fn it_is_the_density_of_the_residuals_with_more_noise_in_some_readings() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + j) as f64).sin();
        let pose = |p: usize| {
            let a = DMatrix::from_fn(3, 2, |i, j| odd(i + 3 * p, j));
            (a, DVector::from_fn(3, |i, _| 2.0 * odd(i + 3 * p, 5)))
        };
        let poses = [pose(0), pose(1)];
        let axes: Vec<Axis> = poses.iter().flat_map(|(a, r)| axes_of(a, r)).collect();
        let (volume, fall) = ratio(&axes, 2.5).expect("a covariance");
        // By the inverse and the determinant of the covariance of both poses at once.
        let mut cover = DMatrix::<f64>::identity(6, 6);
        let mut all = DVector::<f64>::zeros(6);
        for (p, (a, r)) in poses.iter().enumerate() {
            let mut block = cover.view_mut((3 * p, 3 * p), (3, 3));
            block += a * a.transpose() * 2.5;
            all.rows_mut(3 * p, 3).copy_from(r);
        }
        let wanted = all.norm_squared()
            - (all.transpose() * cover.clone().try_inverse().expect("an inverse") * &all)[(0, 0)];
        assert!((fall - wanted).abs() < 1e-12 * wanted, "{fall} for {wanted}");
        let wanted = cover.determinant().ln();
        assert!((volume - wanted).abs() < 1e-12 * wanted.abs(), "{volume} for {wanted}");
    }
}

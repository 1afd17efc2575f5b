//! Where the noise is from, and how large it is.

use crate::estimate::implicit::Residuals;
use crate::estimate::noise::channels::{self, Alike};
use crate::estimate::noise::scatter::{Groups, Scatter};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::mechanism::Channel;

/// Where the noise is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Declared by the user or the mechanism.
    Declared,
    /// Scatter of the misclosure within held poses.
    Repeats,
    /// Scatter of the misclosure about neighbouring rows of a recording.
    Neighbours,
    /// Readings never differ within a pose: rounding alone.
    Quantisation,
    /// Nothing but the fit itself: lack of fit cannot be judged.
    Fit,
}

impl Source {
    /// True where lack of fit can be judged against it.
    #[must_use]
    pub fn independent(self) -> bool {
        self != Self::Fit
    }
}

/// Noise as it was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseEstimate {
    /// Where it is from.
    pub source: Source,
    /// Standard deviation of one reading of each channel, quantisation included.
    pub sigma: Vec<f64>,
    /// Multiplies the variance of declared play.
    pub play: f64,
    /// Degrees of freedom; infinite where it was declared.
    pub dof: f64,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Variance of a pose's mean over that of independent samples.
    pub inflation: f64,
    /// The same for the parameters: more for a recording, whose poses change slowly.
    pub slow: f64,
    /// Channels whose noise was told from that of the others.
    pub apart: usize,
}

/// Fewer degrees of freedom than this give no noise.
const LEAST_DOF: f64 = 8.0;

/// Part of the variance of rounding that may last within a pose while channels are told apart.
const COARSE: f64 = 0.05;

/// Noise of each channel, up to scale, where the data can tell channels apart, and how many.
pub(crate) fn told_apart(
    observations: &Observations,
    groups: &Groups,
    residuals: &Residuals,
    used: &Noise,
) -> (Noise, usize) {
    let alike = Alike {
        noise: first_noise(observations, None),
        floor: observations.mechanism.channels.iter().map(Channel::quantisation).collect(),
    };
    let scatter = groups.scatter(residuals, 0.0);
    // What rounding gives within a pose is no scatter of a normal distribution.
    let coarse = groups.lasting_rounding(observations) > COARSE;
    if scatter.dof < LEAST_DOF || coarse || scatter.within == 0.0 {
        return (alike.noise, 0);
    }
    let independent = (scatter.effective / scatter.dof).min(1.0);
    let found = channels::by_channel(groups, residuals, used, &alike, independent);
    found.unwrap_or((alike.noise, 0))
}

/// Noise to begin with, up to scale.
pub(crate) fn first_noise(observations: &Observations, earlier: Option<Noise>) -> Noise {
    if let (Some(sigma), play) = (&observations.options.noise, observations.options.play) {
        return Noise { sigma: sigma.clone(), play };
    }
    if let Some(noise) = earlier {
        return noise;
    }
    let channels = &observations.mechanism.channels;
    let guess = |unit: &str, gain: f64| if unit == "count" { 1.0 } else { 1e-5 / gain.abs() };
    let sigma =
        channels.iter().map(|c| c.noise.unwrap_or_else(|| guess(&c.unit, c.gain))).collect();
    Noise { sigma, play: 1.0 }
}

/// Variance of the rounding of each channel, in units of its noise.
fn roundings(observations: &Observations, used: &Noise) -> impl Iterator<Item = f64> {
    let channels = observations.mechanism.channels.iter().zip(&used.sigma);
    channels.map(|(channel, sigma)| channel.quantisation() / (sigma * sigma))
}

/// Where all closures declare their play, and readings nobody spoke of make less than
/// this share of the misclosure's variance, the noise is declared.
const MINOR: f64 = 0.5;

/// True where every closure of a sample declares its play.
fn plays(observations: &Observations) -> bool {
    let mechanism = &observations.mechanism;
    let mut closures = mechanism.closures.iter().filter(|c| !mechanism.is_link(c));
    closures.all(|c| c.noise.is_some_and(|n| n > 0.0))
}

/// Share of the misclosure's variance that is from the readings, play aside.
fn readings_share(residuals: &Residuals, noise: &Noise) -> f64 {
    let rows = residuals.by_reading.chunks_exact(noise.sigma.len());
    let count = rows.len().max(1) as f64;
    let of = |row: &[f64]| row.iter().zip(&noise.sigma).map(|(a, s)| (a * s).powi(2)).sum::<f64>();
    rows.map(of).sum::<f64>() / count
}

/// The noise that these residuals show, by the best source there is.
pub(crate) fn estimate_noise(
    observations: &Observations,
    groups: &Groups,
    residuals: &Residuals,
    used: &Noise,
    declared: bool,
    parameters: usize,
) -> NoiseEstimate {
    let rounding = roundings(observations, used).fold(f64::INFINITY, f64::min).sqrt();
    let share = roundings(observations, used).sum::<f64>() / used.sigma.len() as f64;
    let Scatter { within, dof, correlation, inflation, slow, effective, shown } =
        groups.scatter(residuals, share);
    let scaled = |s: f64, source, dof| NoiseEstimate {
        source,
        sigma: used.sigma.iter().map(|v| v * s).collect(),
        play: used.play * s * s,
        dof,
        correlation,
        inflation,
        slow,
        apart: 0,
    };
    if declared {
        return scaled(1.0, Source::Declared, f64::INFINITY);
    }
    if dof >= LEAST_DOF {
        let lasting = groups.lasting_rounding(observations) * share;
        let white = within / dof / shown;
        let variance = (white + lasting).max(rounding * rounding);
        let (source, dof) = if white < lasting || white + lasting < variance {
            (Source::Quantisation, f64::INFINITY)
        } else if observations.readings.held {
            (Source::Repeats, effective.max(1.0))
        } else {
            (Source::Neighbours, effective.max(1.0))
        };
        let estimate = scaled(variance.sqrt(), source, dof);
        // What is the same in all samples of a pose does not average out.
        let (share, n) = (lasting / variance, groups.usual());
        let inflation = inflation + share * (n - inflation);
        let slow = slow + share * (n - slow);
        return NoiseEstimate { inflation, slow, ..estimate };
    }
    if plays(observations) && readings_share(residuals, used) < MINOR {
        return scaled(1.0, Source::Declared, f64::INFINITY);
    }
    let k = residuals.equations;
    let live: Vec<usize> =
        (0..observations.readings.samples).filter(|&r| observations.weights[r] > 0.0).collect();
    let total: f64 =
        live.iter().flat_map(|r| &residuals.whitened[r * k..(r + 1) * k]).map(|r| r * r).sum();
    let free = ((live.len() * k) as f64 - parameters as f64).max(1.0);
    let s = (total / free).sqrt().max(rounding).max(f64::MIN_POSITIVE);
    scaled(s, Source::Fit, free)
}

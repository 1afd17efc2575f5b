//! Where the noise is from, and how large it is.

use crate::estimate::noise::channels::{self, Alike, Length};
use crate::estimate::noise::rounding::{Rounding, steadied};
use crate::estimate::noise::scatter::{Groups, Scatter};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::residuals::Residuals;
use crate::estimate::suspicion::Witness;
use crate::mechanism::Channel;
use crate::model::Model;
use crate::numerics::distributions;

/// Where the noise is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "document", schemars(rename = "NoiseKind"))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Source {
    /// Declared by the user or the mechanism.
    Declared,
    /// Declared of the closures, whose play is the larger part; of readings nobody spoke, and a small noise is
    /// presumed.
    Presumed,
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

    /// True where it was declared, or presumed beside what was.
    #[must_use]
    pub fn is_declared(self) -> bool {
        matches!(self, Self::Declared | Self::Presumed)
    }
}

/// Noise as it was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseEstimate {
    /// Where it is from.
    pub source: Source,
    /// Standard deviation of one reading of each channel, quantisation included.
    pub sigma: Vec<f64>,
    /// Standard deviation by which a reading of each channel is weighed: more than that of one
    /// reading where its rounding lasts over a pose, (66).
    pub weighed: Vec<f64>,
    /// Channels whose rounding lasts over a pose.
    pub lasting: Vec<bool>,
    /// True where repeats differ by the rounding of numbers alone.
    pub still: bool,
    /// Multiplies the variance of declared play.
    pub play: f64,
    /// As [`Noise::seating`]: where a closure declares nothing only the fit tells it, of a length that is
    /// read with every sample repeats do.
    pub seating: Vec<f64>,
    /// Closures whose noise is drawn for each sample, [`Noise::measured`].
    pub measured: Vec<f64>,
    /// The factor where samples are weighed as if they were independent, and the variance of a pose is
    /// then multiplied by `inflation`.
    pub weighed_play: f64,
    /// Degrees of freedom; infinite where it was declared.
    pub dof: f64,
    /// Share of the variance of a pose that is of the readings, play aside.
    pub share: f64,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Variance of a pose's mean over that of independent samples.
    pub inflation: f64,
    /// The same for the parameters: more for a recording, whose poses change slowly.
    pub slow: f64,
    /// Channels whose noise was told from that of the others.
    pub apart: usize,
}

impl NoiseEstimate {
    /// The noise by which equations are weighed.
    #[must_use]
    pub fn assumed(&self) -> Noise {
        Noise {
            sigma: self.weighed.clone(),
            play: self.weighed_play,
            seating: self.seating.clone(),
            measured: self.measured.clone(),
        }
    }

    /// Standard deviation of the loosest seating of which only the fit tells, length units.
    #[must_use]
    pub fn largest_seating(&self) -> Option<f64> {
        let largest = self.of_the_fit().fold(0.0, f64::max).sqrt();
        (largest > 0.0).then_some(largest)
    }

    /// Variances of the seatings of which only the fit tells: not those of lengths that are read with
    /// every sample.
    fn of_the_fit(&self) -> impl Iterator<Item = f64> {
        let read = |k: usize| self.measured.get(k).is_some_and(|factor| *factor > 0.0);
        self.seating
            .iter()
            .enumerate()
            .filter(move |(k, _)| !read(*k))
            .map(|(_, variance)| *variance)
    }

    /// How well each closure holds that is not exact: its name and the standard deviation, length
    /// units or as coordinates count.
    #[must_use]
    pub fn of_closures(&self, model: &Model) -> Vec<(String, f64)> {
        let names = model.mechanism.closures.iter().map(|closure| closure.name.clone());
        let own = names.zip(self.of_one_reading().by_closure(model));
        own.filter(|(_, sd)| *sd > 0.0).collect()
    }

    /// True where lack of fit can be judged against it: nothing of it is of the fit alone.
    #[must_use]
    pub fn judges(&self) -> bool {
        self.source.independent() && self.of_the_fit().all(|variance| variance == 0.0)
    }

    /// Degrees of freedom of the variance of a pose, of which repeats give that of the readings alone:
    /// by Welch and Satterthwaite.
    #[must_use]
    pub fn dof_of_pose(&self) -> f64 {
        self.dof / self.share.powi(2).max(f64::MIN_POSITIVE)
    }

    /// The noise of one reading, as it moves one sample onto the closures.
    #[must_use]
    pub fn of_one_reading(&self) -> Noise {
        let (seating, measured) = (self.seating.clone(), self.measured.clone());
        Noise { sigma: self.sigma.clone(), play: self.play, seating, measured }
    }

    /// The noise of means whose variance by readings is this share of that of a sample. The samples of a held pose have
    /// one play, and each row of a recording has its own; each sample has measured its own length.
    #[must_use]
    pub fn of_means(&self, share: f64, held: bool) -> Noise {
        let seating = self.seating.clone();
        Noise {
            sigma: self.weighed.iter().map(|s| s * share.sqrt()).collect(),
            play: if held { self.play } else { self.play * share },
            seating,
            measured: self.measured.iter().map(|factor| factor * share).collect(),
        }
    }

    /// The same where a share of the variance does not average out: it is the same in all
    /// samples of a pose, of which the usual one has `n`.
    fn with_lasting(self, share: f64, n: f64) -> Self {
        let inflation = self.inflation + share * (n - self.inflation);
        let slow = self.slow + share * (n - self.slow);
        Self { inflation, slow, ..self }
    }
}

/// Fewer degrees of freedom than this give no noise, and judge nothing: of eight, a standard deviation is known
/// to a quarter of itself, 1/√(2 · 8).
pub(crate) const LEAST_DOF: f64 = 8.0;

/// Part of the variance of rounding that may last within a pose while channels are told apart.
const COARSE: f64 = 0.05;

/// Noise of each channel, up to scale, where the data can tell channels apart, and how many.
pub(crate) fn told_apart(
    observations: &Observations,
    groups: &Groups,
    within: &Residuals,
    used: &Noise,
    lengths: &[Length],
) -> (Noise, usize) {
    let floor: Vec<f64> = observations.roundings().collect();
    let apart = vec![false; floor.len()];
    let noise = Noise { play: used.play, ..first_noise(observations, None) };
    let alike = Alike { noise, floor, apart, lengths: lengths.to_vec(), known: false };
    let scatter = groups.scatter(within, 0.0);
    // What rounding gives within a pose is no scatter of a normal distribution.
    let coarse = groups.lasting_rounding(observations) > COARSE;
    if scatter.dof < LEAST_DOF || coarse || scatter.within == 0.0 {
        return (alike.noise, 0);
    }
    let independent = (scatter.effective / scatter.dof).min(1.0);
    let found = channels::by_channel(groups, within, used, &alike, independent);
    found.map_or((alike.noise, 0), |told| (told.noise, told.apart))
}

/// The noise with that of lengths that declare none, as repeats show it beside channels whose noise is
/// known; none where there are no such lengths, or too few repeats.
pub(crate) fn with_lengths(
    observations: &Observations,
    groups: &Groups,
    within: &Residuals,
    used: &Noise,
    lengths: &[Length],
) -> Option<Noise> {
    let scatter = groups.scatter(within, 0.0);
    if lengths.is_empty() || scatter.dof < LEAST_DOF || scatter.within == 0.0 {
        return None;
    }
    let floor: Vec<f64> = observations.roundings().collect();
    let apart = vec![false; floor.len()];
    let lengths = lengths.to_vec();
    let alike = Alike { noise: used.clone(), floor, apart, lengths, known: true };
    Some(channels::by_channel(groups, within, used, &alike, 1.0)?.noise)
}

/// The noise where channels read in steps that are unlike.
#[derive(Debug, Clone)]
pub(crate) struct Rounded {
    /// Of one reading of each channel, quantisation included.
    pub one: Vec<f64>,
    /// As readings are weighed, (66).
    pub weighed: Noise,
    /// Channels whose rounding lasts over a pose.
    pub lasting: Vec<bool>,
    /// Channels whose noise was told from that of the others.
    pub apart: usize,
    /// Of the steadied residuals, where repeats gave it.
    pub scatter: Option<Scatter>,
}

/// The noise where channels read in steps that are unlike, as it is declared.
pub(crate) fn declared_rounded(observations: &Observations, rounding: &Rounding) -> Rounded {
    without_repeats(observations, rounding, first_noise(observations, None).sigma)
}

/// The noise where `one` reading of each channel has this standard deviation, and what lasts of its
/// rounding is a part of it.
fn without_repeats(observations: &Observations, rounding: &Rounding, one: Vec<f64>) -> Rounded {
    let white = |c: usize| (one[c] * one[c] - rounding.lasting[c]).max(0.0);
    let sigma = (0..one.len()).map(|c| rounding.weighed(c, white(c), 1.0)).collect();
    let lasting = (0..one.len()).map(|c| rounding.lasts(c)).collect();
    let weighed = Noise { sigma, ..first_noise(observations, None) };
    Rounded { weighed, one, lasting, apart: 0, scatter: None }
}

/// The noise where channels read in steps that are unlike, as repeats show it: coarse channels stand
/// apart, and those whose rounding lasts have the noise of the others and what rounding adds to it.
/// None where repeats are too few.
pub(crate) fn rounded(
    observations: &Observations,
    groups: &Groups,
    within: &Residuals,
    used: &Noise,
    rounding: &Rounding,
    lengths: &[Length],
) -> Option<Rounded> {
    let steady = steadied(observations, &groups.rows, within, |c| rounding.lasts(c));
    let scatter = groups.scatter(&steady, 0.0);
    if scatter.dof < LEAST_DOF {
        return None;
    }
    if rounding.all_last() {
        let one = |c: usize| (rounding.scatter(c) + rounding.lasting[c]).sqrt();
        let one = (0..rounding.lasting.len()).map(one).collect();
        return Some(without_repeats(observations, rounding, one));
    }
    if scatter.within == 0.0 {
        return None;
    }
    let mut noise = Noise { play: used.play, ..first_noise(observations, None) };
    let unit = presumed(observations).sigma;
    let mut floor: Vec<f64> = observations.roundings().collect();
    let channels = 0..unit.len();
    for c in channels.clone().filter(|&c| rounding.lasts(c)) {
        (noise.sigma[c], floor[c]) = (unit[c], 0.0);
    }
    let (apart, lengths) = (rounding.coarse.clone(), lengths.to_vec());
    let alike = Alike { noise, floor, apart, lengths, known: false };
    let independent = (scatter.effective / scatter.dof).min(1.0);
    let channels::Told { noise: found, common: scale, apart } =
        channels::by_channel(groups, &steady, used, &alike, independent)?;
    let white = |c: usize| match rounding.lasts(c) {
        true => rounding.white(c, unit[c] * unit[c] * scale / scatter.shown),
        false => found.sigma[c] * found.sigma[c] / scatter.shown,
    };
    let one = |c: usize| (white(c) + rounding.lasting[c]).sqrt();
    let weighed = |c: usize| rounding.weighed(c, white(c), scatter.inflation);
    Some(Rounded {
        one: channels.clone().map(one).collect(),
        lasting: channels.clone().map(|c| rounding.lasts(c)).collect(),
        weighed: Noise { sigma: channels.map(weighed).collect(), ..found },
        apart,
        scatter: Some(scatter),
    })
}

/// What is declared of the noise, or guessed, rounding aside.
pub(crate) fn presumed(observations: &Observations) -> Noise {
    let options = &observations.options;
    let seating = options.seating.clone();
    let measured = options.measured.clone().unwrap_or_else(|| observations.measured());
    if let Some(sigma) = &options.noise {
        return Noise { sigma: sigma.clone(), play: options.play, seating, measured };
    }
    let sigma = observations.mechanism.channels.iter().map(Channel::presumed_noise).collect();
    Noise { sigma, play: 1.0, seating, measured }
}

/// Noise to begin with, up to scale.
pub(crate) fn first_noise(observations: &Observations, earlier: Option<Noise>) -> Noise {
    let options = &observations.options;
    if options.noise.is_none()
        && let Some(noise) = earlier
    {
        let seating = options.seating.clone();
        return Noise { seating, ..noise };
    }
    let mut noise = presumed(observations);
    if options.noise.is_none() || !observations.judged {
        let least = observations.least_noise();
        noise.sigma.iter_mut().zip(least).for_each(|(sigma, least)| *sigma = sigma.max(least));
    }
    noise
}

/// Variance of the rounding of each channel, in units of its noise.
fn roundings(observations: &Observations, used: &Noise) -> impl Iterator<Item = f64> {
    observations.roundings().zip(&used.sigma).map(|(rounding, sigma)| rounding / (sigma * sigma))
}

/// Largest factor by which a noise that was declared may be too small, and by which it may be too large.
pub(crate) const NOISIER: f64 = 4.0;

/// Where all closures declare their play, and readings nobody spoke of make less than this share of the
/// misclosure's variance, the noise is declared: the play is the larger part.
pub(crate) const LARGER_PART: f64 = 0.5;

/// True where every closure of a sample declares its play.
fn plays(observations: &Observations) -> bool {
    let mechanism = &observations.mechanism;
    let mut closures = mechanism.closures.iter().filter(|c| !mechanism.is_link(c));
    let seated = observations.options.seating.iter().any(|variance| *variance > 0.0);
    closures.all(|c| match c.noise {
        Some(noise) => noise > 0.0,
        None => seated && !c.kind.has_value(),
    })
}

/// Probability of doubting noise that is declared as it is, on either side.
pub(crate) const DOUBT: f64 = 1e-3;

/// Declared noise may differ from what is seen by this factor before anything is said: a
/// session of a hundred equations is judged alike then, and people declare two digits.
pub(crate) const ALIKE: f64 = 1.1;

/// By what factor declared noise would have to change to fit a sum of squares that it makes
/// `ratio` times what is expected, of `dof` degrees of freedom; none where it may be right.
#[must_use]
pub(crate) fn misdeclared(ratio: f64, dof: f64) -> Option<f64> {
    let above = distributions::chi2_tail(ratio * dof, dof);
    let factor = ratio.sqrt();
    let sure = above < DOUBT || 1.0 - above < DOUBT;
    (sure && !(1.0 / ALIKE..ALIKE).contains(&factor)).then_some(factor)
}

/// Whether repeats, or neighbouring rows, bear out the noise that is declared: the factor by which
/// it would have to change, and what shows it. `within` is whitened by what they show.
pub(crate) fn check_declared(
    observations: &Observations,
    groups: &Groups,
    within: &Residuals,
    used: &Noise,
    rounding: Option<&Rounding>,
) -> Option<(f64, Witness)> {
    let share = roundings(observations, used).sum::<f64>() / used.sigma.len() as f64;
    let lasts = |c: usize| rounding.is_some_and(|rounding| rounding.lasts(c));
    let residuals = &steadied(observations, &groups.rows, within, lasts);
    let Scatter { within, dof, shown, effective, .. } = groups.scatter(residuals, share);
    if dof < LEAST_DOF || effective < LEAST_DOF {
        return None;
    }
    // What all samples of a pose are rounded by alike is noise, and not seen here.
    let lasting = groups.lasting_rounding(observations) * share;
    let shown = shown * rounding.map_or(1.0, |rounding| rounding.shown(residuals, used));
    let seen = within / dof / shown + lasting;
    let usual = groups.median_variance(residuals) / shown + lasting;
    if within / dof > groups.most(observations, &used.sigma) {
        return None;
    }
    let factor = misdeclared(seen, effective)?;
    // One bad sample is no noise: it is for the usual pose to say.
    if (usual > ALIKE.powi(2)) != (factor > 1.0) || (usual < ALIKE.powi(-2)) != (factor < 1.0) {
        return None;
    }
    let held = observations.readings.held;
    Some((factor, if held { Witness::Repeats } else { Witness::Neighbours }))
}

/// What shows the noise of a fit.
pub(crate) struct Shown<'a> {
    pub observations: &'a Observations,
    pub groups: &'a Groups,
    pub residuals: &'a Residuals,
    /// Residuals whitened by what repeats show.
    pub within: &'a Residuals,
    /// The noise by which they are whitened.
    pub used: &'a Noise,
    /// The noise where channels read in steps that are unlike.
    pub rounded: Option<&'a Rounded>,
    /// True for a noise that is declared.
    pub declared: bool,
    /// Number of the fit's parameters.
    pub parameters: usize,
}

impl Shown<'_> {
    /// The noise that these residuals show, by the best source there is.
    pub(crate) fn estimate(&self) -> NoiseEstimate {
        let Self { observations, groups, residuals, within, used, rounded, declared, .. } = *self;
        let rounding = roundings(observations, used).fold(f64::INFINITY, f64::min).sqrt();
        let share = roundings(observations, used).sum::<f64>() / used.sigma.len() as f64;
        let steady = rounded.and_then(|rounded| rounded.scatter);
        let scatter = steady.unwrap_or_else(|| groups.scatter(within, share));
        let seen = scatter.within / scatter.dof.max(1.0) / scatter.shown;
        let least = resolution(observations, used).max(f64::MIN_POSITIVE);
        let still = seen.sqrt() <= least;
        // Rounding has no correlation but what lasts.
        let all_rounded = !declared && rounded.is_some() && steady.is_none();
        let scatter = if still || all_rounded { scatter.alone() } else { scatter };
        let Scatter { effective, shown, dof, .. } = scatter;
        let held = observations.readings.held;
        let scaled = |s: f64, source, dof| self.scaled(s, source, dof, (&scatter, still));
        if declared {
            return scaled(1.0, Source::Declared, f64::INFINITY);
        }
        if all_rounded {
            return scaled(1.0, Source::Quantisation, f64::INFINITY);
        }
        if steady.is_some() {
            return scaled(1.0, Source::Repeats, effective.max(1.0));
        }
        let most = groups.most(observations, &used.sigma);
        let mean_square = (scatter.within / dof.max(1.0)).min(most) / shown;
        // Rows of a motion that resemble their neighbours so much that few are left of them tell no noise:
        // what is left changes more slowly than over the rows of a group, and may be no noise at all.
        let differ = if held { dof } else { dof.min(effective) };
        let told = differ >= LEAST_DOF && (!still || rounding > 0.0);
        if told {
            let lasting = groups.lasting_rounding(observations) * share;
            // In a recording every row has a play of its own, and a length that is measured has its noise.
            let white = variance_of_readings(within, mean_square, dof);
            let variance = (white + lasting).max(rounding * rounding);
            let (source, dof) = if white < lasting || white + lasting < variance {
                (Source::Quantisation, f64::INFINITY)
            } else if held {
                (Source::Repeats, effective.max(1.0))
            } else {
                (Source::Neighbours, effective.max(1.0))
            };
            let estimate = scaled(variance.sqrt(), source, dof);
            return estimate.with_lasting(lasting / variance, groups.usual());
        }
        if plays(observations) && dof >= LEAST_DOF {
            // Readings that stand still in every pose: what is left of noise is the play.
            return scaled(least, Source::Declared, f64::INFINITY);
        }
        if plays(observations) && residuals.readings_share < LARGER_PART && !observations.by_fit {
            return scaled(1.0, Source::Presumed, f64::INFINITY);
        }
        let (variance, free) = self.of_fit();
        let s = variance.sqrt().max(rounding).max(f64::MIN_POSITIVE);
        let repeats = dof + observations.doubled.len() as f64;
        if still && repeats >= LEAST_DOF && s <= least {
            // Repeats are the same numbers, and loops close as exactly as numbers are written.
            return scaled(least, Source::Quantisation, f64::INFINITY);
        }
        scaled(s, Source::Fit, free)
    }

    /// So much of the noise that is used; `still` where repeats do not differ.
    fn scaled(
        &self,
        s: f64,
        source: Source,
        dof: f64,
        (scatter, still): (&Scatter, bool),
    ) -> NoiseEstimate {
        let Scatter { correlation, inflation, slow, .. } = *scatter;
        let one = self.rounded.map_or(&self.used.sigma, |rounded| &rounded.one);
        let lasting = self.rounded.map(|rounded| rounded.lasting.clone());
        let Noise { play, measured, .. } = first_noise(self.observations, None);
        let held = self.observations.readings.held;
        NoiseEstimate {
            source,
            sigma: one.iter().map(|v| v * s).collect(),
            weighed: self.used.sigma.iter().map(|v| v * s).collect(),
            lasting: lasting.unwrap_or_else(|| vec![false; one.len()]),
            still: still && scatter.dof >= LEAST_DOF,
            play,
            seating: self.used.seating.clone(),
            measured,
            weighed_play: if held { play / inflation } else { play },
            dof,
            share: self.residuals.readings_share,
            correlation,
            inflation,
            slow,
            apart: 0,
        }
    }

    /// Variance of the readings by what the fit leaves, and degrees of freedom.
    fn of_fit(&self) -> (f64, f64) {
        let Self { observations, residuals, .. } = *self;
        let k = residuals.equations;
        let live = (0..observations.readings.samples).filter(|&r| observations.weights[r] > 0.0);
        let live: Vec<usize> = live.collect();
        let all = live.iter().flat_map(|r| &residuals.whitened[r * k..(r + 1) * k]);
        let total: f64 = all.map(|r| r * r).sum();
        let told: usize = live.iter().map(|&row| residuals.directions_of(row)).sum();
        let free = (told as f64 - self.parameters as f64).max(1.0);
        (variance_of_readings(residuals, total / free, free), free)
    }
}

/// Variance of the readings, in units of what whitens residuals, whose square is so much in the mean
/// of `dof` of them: what is declared of the closures stays.
///
/// Declared play may be as large as all there is. What the readings add to it is then not told from
/// nothing, and taken for the standard error of that mean: `√(2/dof)` of it.
pub(crate) fn variance_of_readings(residuals: &Residuals, mean_square: f64, dof: f64) -> f64 {
    let play = if residuals.play { 1.0 - residuals.readings_share } else { 0.0 };
    let error = (2.0 / dof).sqrt().min(1.0) * mean_square;
    ((mean_square - play) / (1.0 - play)).max(error)
}

/// Rounding of the readings as numbers, in units of their noise: by less they do not differ.
fn resolution(observations: &Observations, used: &Noise) -> f64 {
    let spans = observations.readings.span.iter().zip(&used.sigma);
    let of = |([low, high], sigma): (&[f64; 2], &f64)| {
        64.0 * f64::EPSILON * low.abs().max(high.abs()) / sigma
    };
    spans.map(of).fold(0.0, f64::max)
}

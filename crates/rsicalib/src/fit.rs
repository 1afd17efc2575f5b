//! The answer: estimates, covariance, lack of fit, why it stopped.

use faer::Mat;

use crate::lm::{self, Problem, Termination};
use crate::mechanism::Channel;
use crate::model::{Instance, Model};
use crate::noise::{self, Alike, Groups, Scatter, Source};
use crate::objective::{Algebraic, Implicit, Noise, Part, Prior, Residuals};
use crate::session::Session;
use crate::start::{self, Start, Try};
use crate::{Error, stats};

/// Which objective.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Maximum likelihood, noise in the readings.
    #[default]
    ImplicitLoop,
    /// The paper's least squares, noise in the misclosure.
    Algebraic,
}

/// How to fit.
#[derive(Debug, Clone)]
pub struct Options {
    /// Terms to identify; none: as the mechanism says.
    pub terms: Option<Vec<String>>,
    /// Only these closures.
    pub closures: Option<Vec<String>>,
    /// The objective.
    pub method: Method,
    /// Standard deviation of one reading of each channel, where it is known.
    pub noise: Option<Vec<f64>>,
    /// Multiplies the variance of the play that the mechanism declares.
    pub play: f64,
    /// Starts to try at the most.
    pub starts: usize,
    /// A start whose χ² per degree of freedom is below this ends the search.
    pub good_start: f64,
    /// The solver.
    pub lm: lm::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            terms: None,
            closures: None,
            method: Method::default(),
            noise: None,
            play: 1.0,
            starts: 40,
            good_start: 50.0,
            lm: lm::Options { xtol: 1e-10, ftol: 1e-12, ..lm::Options::default() },
        }
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

impl NoiseEstimate {
    /// Where it is from, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let by_channel = if self.apart > 0 { ", by channel" } else { "" };
        format!("{}{by_channel}", self.source.words())
    }
}

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model.
    pub model: Model,
    /// Its parameters.
    pub beta: Vec<f64>,
    /// What was known of them without readings.
    pub priors: Vec<Prior>,
    /// The noise.
    pub noise: NoiseEstimate,
    /// `Xᵀ S⁻¹ X` and priors, in units of the estimated noise.
    pub gram: Mat<f64>,
    /// Covariance of the parameters; pseudo-inverse where directions are unobservable.
    pub covariance: Mat<f64>,
    /// Parameters that take part in an unobservable direction.
    pub unknowable: Vec<bool>,
    /// χ² between poses.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: f64,
    /// Degrees of freedom within poses, which gave the noise.
    pub within: f64,
    /// Probability of a larger χ²; none where nothing but the fit gives the noise.
    pub p_value: Option<f64>,
    /// χ² of all samples.
    pub total: f64,
    /// Root mean square error of the closures, in length units.
    pub rms_misclosure: f64,
    /// Condition number, unit columns.
    pub condition: f64,
    /// Why the search ended.
    pub termination: Termination,
    /// Linearisations made.
    pub iterations: usize,
    /// Starts that were tried.
    pub starts: Vec<Try>,
    /// Whitened residuals and their derivatives.
    pub residuals: Residuals,
    /// Readings without their noise, row by row.
    pub adjusted: Vec<f64>,
    /// True where every joint still moves.
    pub plausible: bool,
    /// What looks wrong with the wiring.
    pub warnings: Vec<String>,
}

/// Fits these instances, from a start of their own or from an earlier fit.
///
/// # Errors
///
/// [`Error::TooFew`] where there are fewer equations than parameters.
pub fn fit(session: &Session, instances: Vec<Instance>, from: Option<&Fit>) -> Result<Fit, Error> {
    let model = Model::about(&session.mechanism, &session.readings, instances, &session.centre)?;
    let priors = session.priors(&model);
    let equations = model.equations() * session.weights.iter().filter(|w| **w > 0.0).count();
    if equations + priors.len() < model.parameters {
        return Err(Error::TooFew {
            parameters: model.parameters,
            equations,
            poses: session.readings.poses(),
        });
    }
    let guess = first_noise(session, from);
    let start = match from {
        Some(fit) => Start {
            beta: carry_over(fit, &model),
            tries: fit.starts.clone(),
            warnings: fit.warnings.clone(),
        },
        None => begin(session, &model, &guess),
    };
    solve(session, model, priors, start, guess)
}

/// The parameters of an earlier fit, where the new model has them too.
#[must_use]
pub fn carry_over(fit: &Fit, model: &Model) -> Vec<f64> {
    let mut beta = model.nominal();
    for (instance, &first) in model.instances.iter().zip(&model.first) {
        if let Some(k) = fit.model.instances.iter().position(|i| i == instance) {
            let old = fit.model.first[k];
            beta[first..first + instance.width()]
                .copy_from_slice(&fit.beta[old..old + instance.width()]);
        }
    }
    let (old, new) = (fit.model.term_parameters, model.term_parameters);
    if fit.model.unknown_names == model.unknown_names {
        beta[new..].copy_from_slice(&fit.beta[old..]);
    }
    beta
}

/// Noise to begin with, up to scale.
fn first_noise(session: &Session, from: Option<&Fit>) -> Noise {
    if let (Some(sigma), play) = (&session.options.noise, session.options.play) {
        return Noise { sigma: sigma.clone(), play };
    }
    if let Some(fit) = from {
        return fit.assumed();
    }
    let channels = &session.mechanism.channels;
    let guess = |unit: &str, gain: f64| if unit == "count" { 1.0 } else { 1e-5 / gain.abs() };
    let sigma =
        channels.iter().map(|c| c.noise.unwrap_or_else(|| guess(&c.unit, c.gain))).collect();
    Noise { sigma, play: 1.0 }
}

/// A start by the algebraic fit, unknown points by where the chains touch them.
fn begin(session: &Session, model: &Model, noise: &Noise) -> Start {
    if model.unknown_names.is_empty() {
        return start::search(session, model, noise);
    }
    let mut beta = start::anchored(session, model, &vec![1.0; model.scales.len()]);
    model.place_unknowns(&session.readings, &mut beta);
    Start { beta, ..Start::default() }
}

/// Fewer degrees of freedom than this give no noise.
const FEW: f64 = 8.0;

/// Part of the variance of rounding that may last within a pose while channels are told apart.
const COARSE: f64 = 0.05;

/// Fits at the most, each with the noise that the one before found.
const ROUNDS: usize = 4;

/// Noise of each channel, up to scale, where the data can tell channels apart, and how many.
fn told_apart(
    session: &Session,
    groups: &Groups,
    residuals: &Residuals,
    used: &Noise,
) -> (Noise, usize) {
    let alike = Alike {
        noise: first_noise(session, None),
        floor: session.mechanism.channels.iter().map(Channel::quantisation).collect(),
    };
    let scatter = groups.scatter(residuals, 0.0);
    // What rounding gives within a pose is no scatter of a normal distribution.
    let coarse = groups.lasting_rounding(session) > COARSE;
    if scatter.dof < FEW || coarse || scatter.within == 0.0 {
        return (alike.noise, 0);
    }
    let independent = (scatter.effective / scatter.dof).min(1.0);
    let found = noise::by_channel(groups, residuals, used, &alike, independent);
    found.unwrap_or((alike.noise, 0))
}

/// True where two noises differ in scale alone, as far as it matters.
fn proportional(a: &Noise, b: &Noise) -> bool {
    let scale = a.sigma[0] / b.sigma[0];
    let same = |x: f64, y: f64| (x - scale * y).abs() <= 0.01 * x.abs();
    a.sigma.iter().zip(&b.sigma).all(|(x, y)| same(*x, *y)) && same(a.play.sqrt(), b.play.sqrt())
}

fn solve(
    session: &Session,
    model: Model,
    priors: Vec<Prior>,
    start: Start,
    mut noise: Noise,
) -> Result<Fit, Error> {
    let held = match &session.held {
        Some((mechanism, readings)) => Some((Model::like(&model, mechanism, readings)?, readings)),
        None => None,
    };
    let part = Part { model: &model, readings: &session.readings, weights: Some(&session.weights) };
    let mut beta = start.beta.clone();
    let groups = Groups::of(&session.readings, &session.weights);
    let declared = session.options.noise.is_some()
        || session.mechanism.channels.iter().all(|c| c.noise.is_some());
    let mut apart = 0;
    let mut answer = None;
    for round in 0..ROUNDS {
        let mut parts = vec![(part, noise.clone())];
        if let Some((model, readings)) = &held {
            parts.push((Part { model, readings, weights: None }, noise.clone()));
        }
        let problem = Implicit::new(parts, &priors);
        let outcome = match session.options.method {
            Method::ImplicitLoop => lm::minimize(&problem, &beta, &session.options.lm),
            Method::Algebraic => {
                let paper =
                    lm::minimize(&Algebraic::new(part, &priors), &beta, &session.options.lm);
                lm::Outcome { linearization: problem.linearize(&paper.x), ..paper }
            }
        };
        beta.clone_from(&outcome.x);
        let residuals = problem.residuals(&beta, false);
        if !declared && round + 1 < ROUNDS {
            let (wanted, count) = told_apart(session, &groups, &residuals, &noise);
            apart = count;
            if !proportional(&wanted, &noise) {
                noise = wanted;
                continue;
            }
        }
        let estimate = estimate_noise(session, &groups, &residuals, &noise, declared, beta.len());
        let estimate = NoiseEstimate { apart, dof: estimate.dof - apart as f64, ..estimate };
        let scale = estimate.sigma[0] / noise.sigma[0];
        let adjusted = problem.adjusted();
        answer = Some((outcome, residuals, estimate.clone(), scale, adjusted));
        let sensitive = !priors.is_empty() || held.is_some();
        if (scale - 1.0).abs() < 1e-3 || !sensitive {
            break;
        }
        noise = Noise { sigma: estimate.sigma, play: estimate.play };
    }
    let Some((outcome, residuals, noise, scale, adjusted)) = answer else {
        return Err(Error::Empty("no fit".into()));
    };
    Ok(conclude(session, model, priors, outcome, residuals, noise, scale, adjusted, start, &groups))
}

/// Variance of the rounding of each channel, in units of its noise.
fn roundings(session: &Session, used: &Noise) -> impl Iterator<Item = f64> {
    let channels = session.mechanism.channels.iter().zip(&used.sigma);
    channels.map(|(channel, sigma)| channel.quantisation() / (sigma * sigma))
}

/// Where all closures declare their play, and readings nobody spoke of make less than
/// this share of the misclosure's variance, the noise is declared.
const MINOR: f64 = 0.5;

/// True where every closure of a sample declares its play.
fn plays(session: &Session) -> bool {
    let mechanism = &session.mechanism;
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
fn estimate_noise(
    session: &Session,
    groups: &Groups,
    residuals: &Residuals,
    used: &Noise,
    declared: bool,
    parameters: usize,
) -> NoiseEstimate {
    let rounding = roundings(session, used).fold(f64::INFINITY, f64::min).sqrt();
    let share = roundings(session, used).sum::<f64>() / used.sigma.len() as f64;
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
    if dof >= FEW {
        let lasting = groups.lasting_rounding(session) * share;
        let white = within / dof / shown;
        let variance = (white + lasting).max(rounding * rounding);
        let (source, dof) = if white < lasting || white + lasting < variance {
            (Source::Quantisation, f64::INFINITY)
        } else if session.readings.held {
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
    if plays(session) && readings_share(residuals, used) < MINOR {
        return scaled(1.0, Source::Declared, f64::INFINITY);
    }
    let k = residuals.equations;
    let live: Vec<usize> =
        (0..session.readings.samples).filter(|&r| session.weights[r] > 0.0).collect();
    let total: f64 =
        live.iter().flat_map(|r| &residuals.whitened[r * k..(r + 1) * k]).map(|r| r * r).sum();
    let free = ((live.len() * k) as f64 - parameters as f64).max(1.0);
    let s = (total / free).sqrt().max(rounding).max(f64::MIN_POSITIVE);
    scaled(s, Source::Fit, free)
}

#[expect(clippy::too_many_arguments, reason = "the last step gathers what the others made")]
fn conclude(
    session: &Session,
    model: Model,
    priors: Vec<Prior>,
    outcome: lm::Outcome,
    mut residuals: Residuals,
    noise: NoiseEstimate,
    scale: f64,
    adjusted: Vec<f64>,
    start: Start,
    groups: &Groups,
) -> Fit {
    // From the noise that the fit used to the noise that it found.
    for values in [&mut residuals.whitened, &mut residuals.by_reading] {
        values.iter_mut().for_each(|v| *v /= scale);
    }
    let gram = outcome.linearization.gram();
    let n = gram.nrows();
    let gram = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (scale * scale));

    let k = residuals.equations;
    let live: Vec<usize> =
        (0..session.readings.samples).filter(|&r| session.weights[r] > 0.0).collect();
    let of = |r: &usize| residuals.whitened[r * k..(r + 1) * k].iter().map(|v| v * v).sum::<f64>();
    let total: f64 = live.iter().map(of).sum();
    let (inverse, unknowable, condition) = invert(&gram);
    let (mut chi2, mut dof) =
        (total, (live.len() * k) as f64 - free_parameters(&inverse, &priors, &outcome.x));
    let mut within = 0.0;
    if matches!(
        noise.source,
        Source::Repeats | Source::Neighbours | Source::Quantisation | Source::Declared
    ) {
        let scatter = groups.scatter(&residuals, 0.0);
        chi2 = (chi2 - scatter.within).max(0.0) / noise.inflation;
        within = scatter.dof;
        dof -= within;
    }
    let p_value = (noise.source.independent() && dof >= 1.0)
        .then(|| stats::f_tail(chi2 / dof, dof, noise.dof));

    // What is left and is no noise of the samples moved the estimates as well.
    let left = if p_value.is_some_and(|p| p < LEFT) { (chi2 / dof).max(1.0) } else { 1.0 };
    let covariance = Mat::from_fn(n, n, |i, j| inverse[(i, j)] * noise.slow * left);
    let lengths = live.iter().flat_map(|r| &residuals.lengths[r * k..(r + 1) * k]);
    let rms_misclosure =
        (lengths.map(|l| l * l).sum::<f64>() / (live.len() * k).max(1) as f64).sqrt();
    let plausible = !start::collapsed(&model, &outcome.x);
    Fit {
        model,
        beta: outcome.x,
        priors,
        noise,
        gram,
        covariance,
        unknowable,
        chi2,
        dof,
        within,
        p_value,
        total,
        rms_misclosure,
        condition,
        termination: outcome.termination,
        iterations: outcome.iterations,
        starts: start.tries,
        residuals,
        adjusted,
        plausible,
        warnings: start.warnings,
    }
}

/// A residual that chance exceeds less often than this widens the intervals.
const LEFT: f64 = 0.01;

impl Fit {
    /// The noise that it assumed.
    #[must_use]
    pub fn assumed(&self) -> Noise {
        Noise { sigma: self.noise.sigma.clone(), play: self.noise.play }
    }

    /// `(Xᵀ S⁻¹ X)⁻¹`, priors included.
    #[must_use]
    pub fn inverse(&self) -> Mat<f64> {
        invert(&self.gram).0
    }
}

/// Parameters that the data pay for: priors take part of those they hold, of whose
/// Gram matrix, priors included, this is the inverse.
#[must_use]
pub fn free_parameters(inverse: &Mat<f64>, priors: &[Prior], x: &[f64]) -> f64 {
    let n = inverse.nrows();
    let held = |prior: &Prior| -> f64 {
        let slopes = prior.slopes(x);
        let pairs = slopes.iter().flat_map(|a| slopes.iter().map(move |b| (a, b)));
        pairs.map(|((i, a), (j, b))| a * inverse[(*i, *j)] * b).sum()
    };
    n as f64 - priors.iter().map(held).sum::<f64>()
}

/// Eigenvalues below this fraction of the largest, unit columns, are zero.
const RANK: f64 = 1e-11;

/// Pseudo-inverse of a Gram matrix, the parameters that it cannot tell apart,
/// and the condition number of its Jacobian with unit columns.
#[must_use]
pub fn invert(gram: &Mat<f64>) -> (Mat<f64>, Vec<bool>, f64) {
    let n = gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let unit = Mat::from_fn(n, n, |i, j| {
        let norm = norms[i] * norms[j];
        if norm > 0.0 { gram[(i, j)] / norm } else { 0.0 }
    });
    let mut unknowable: Vec<bool> = norms.iter().map(|v| *v == 0.0 || !v.is_finite()).collect();
    let Ok(eigen) = unit.self_adjoint_eigen(faer::Side::Lower) else {
        return (Mat::zeros(n, n), vec![true; n], f64::INFINITY);
    };
    let values = eigen.S().column_vector();
    let vectors = eigen.U();
    let largest = if n > 0 { values[n - 1] } else { 1.0 };
    let smallest = if n > 0 { values[0].max(0.0) } else { 1.0 };
    for k in 0..n {
        if values[k] < RANK * largest {
            for i in 0..n {
                unknowable[i] |= vectors[(i, k)].abs() > 1e-3;
            }
        }
    }
    let kept: Vec<usize> = (0..n).filter(|&k| values[k] >= RANK * largest).collect();
    let root = Mat::from_fn(n, kept.len(), |i, k| {
        if norms[i] > 0.0 {
            vectors[(i, kept[k])] / (norms[i] * values[kept[k]].sqrt())
        } else {
            0.0
        }
    });
    let inverse = &root * root.transpose();
    (inverse, unknowable, (largest / smallest).sqrt())
}

//! Where to start, and how many times.
//!
//! At gain zero the algebraic misclosure of any assembled pose vanishes, and
//! that trivial solution attracts (section IV-B of the paper). Two things keep
//! the search away from it: offsets are anchored on the one pose that is known,
//! `θ_off = θ_rest - k a_rest`, so that a wrong gain swings each joint about the
//! rest pose and not about count zero; and a solution in which a joint hardly
//! moves any more is recognised and left for another start.

use crate::lm::{self, Outcome};
use crate::model::Model;
use crate::objective::{Algebraic, Part};
use crate::session::Session;

/// A start that was tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Try {
    /// Where it began, in words.
    pub from: String,
    /// `fᵀf` where it ended.
    pub cost: f64,
    /// True where a gain collapsed to zero.
    pub collapsed: bool,
}

/// Fraction of its nominal gain below which a channel has collapsed.
const COLLAPSED: f64 = 0.05;

/// Common factors on the nominal gains, nearest first.
const FACTORS: [f64; 9] = [1.0, 0.75, 1.35, 0.55, 1.8, 0.4, 2.4, 0.3, 3.2];

/// Parameters that give every channel `factor` times its nominal gain, about
/// the anchor of the session.
#[must_use]
pub fn anchored(session: &Session, model: &Model, factors: &[f64]) -> Vec<f64> {
    let mut beta = model.nominal();
    let anchor = session.anchor();
    for (c, (reading, angle)) in anchor.into_iter().enumerate() {
        let scale = &model.scales[c];
        let gain = scale.gain * factors[c];
        if let Some(column) = model.column("gain", c) {
            beta[column] = gain - scale.gain;
        }
        let gain = if model.column("gain", c).is_some() { gain } else { scale.gain };
        if let Some(column) = model.column("offset", c) {
            beta[column] = angle - scale.angle - gain * (reading - scale.centre);
        }
    }
    beta
}

/// True where some joint hardly moves any more.
#[must_use]
pub fn collapsed(model: &Model, beta: &[f64]) -> bool {
    model.scales.iter().enumerate().any(|(c, scale)| {
        let gain = model.column("gain", c).map_or(scale.gain, |column| scale.gain + beta[column]);
        gain / scale.gain < COLLAPSED
    })
}

/// The algebraic fits from every start, until one is good; the best, and all.
#[must_use]
pub fn search(
    session: &Session,
    model: &Model,
    good: impl Fn(&Outcome) -> f64,
) -> (Vec<f64>, Vec<Try>) {
    let priors = session.priors(model);
    let part = Part { model, readings: &session.readings, weights: Some(&session.weights) };
    let problem = Algebraic::new(part, &priors);
    let options = lm::Options { max_iterations: 60, xtol: 1e-8, ..session.options.lm.clone() };
    let mut tries = Vec::new();
    let mut best: Option<(f64, Vec<f64>)> = None;
    let mut attempt = |name: String, start: Vec<f64>, best: &mut Option<(f64, Vec<f64>)>| {
        let outcome = lm::minimize(&problem, &start, &options);
        let collapsed = collapsed(model, &outcome.x);
        let score = if collapsed { f64::INFINITY } else { good(&outcome) };
        tries.push(Try { from: name, cost: 2.0 * outcome.cost, collapsed });
        if score.is_finite() && best.as_ref().is_none_or(|(s, _)| score < *s) {
            *best = Some((score, outcome.x));
        }
        score < session.options.good_start
    };
    let channels = model.scales.len();
    let mut starts: Vec<(String, Vec<f64>)> = Vec::new();
    let nominal = if session.rest.is_some() { "rest" } else { "nominal" };
    for factor in FACTORS {
        let name =
            if factor == 1.0 { nominal.into() } else { format!("{nominal}, gains × {factor}") };
        starts.push((name, vec![factor; channels]));
    }
    // Low-discrepancy factors between 0.3 and 3: the additive recurrence of Roberts.
    let root = generalised_golden(channels);
    for n in 1..=session.options.starts.saturating_sub(FACTORS.len()) {
        let factors = (0..channels).map(|c| {
            let alpha = root.powi(-(c as i32 + 1));
            0.3 * 10.0_f64.powf((0.5 + alpha * n as f64).fract())
        });
        starts.push((format!("{nominal}, gains scattered #{n}"), factors.collect()));
    }
    for (name, factors) in starts.into_iter().take(session.options.starts.max(1)) {
        let start = anchored(session, model, &factors);
        if attempt(name, start, &mut best) {
            break;
        }
    }
    let beta = best.map_or_else(|| anchored(session, model, &vec![1.0; channels]), |(_, x)| x);
    (beta, tries)
}

/// The root of `x^(d+1) = x + 1`.
fn generalised_golden(dimensions: usize) -> f64 {
    let mut x: f64 = 1.5;
    for _ in 0..60 {
        x = (1.0 + x).powf(1.0 / (dimensions as f64 + 1.0));
    }
    x
}

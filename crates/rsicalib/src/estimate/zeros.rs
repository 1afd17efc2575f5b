//! Zeros of encoders that are anywhere.
//!
//! An encoder that nobody has set to zero reads any angle where its joint is at the zero of the drawing, and a fit finds
//! zeros within about a right angle of where it begins. So where no start closes the loop, single joints begin
//! a quarter of a turn further, and then all of them anywhere.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::Error;
use crate::estimate::enough::enough;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::limits::beyond_limits;
use crate::estimate::miswired::{DECISIVE, LITTLE, apart, closing};
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::placed::{carried, placed};
use crate::estimate::search::{anchored, collapsed, ratios};
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::model::Model;
use crate::numerics::lm::{self, SolverOptions};
use crate::numerics::thin;
use crate::terms::term::Role;

/// Angle beyond which a zero is said to be elsewhere: nearer ones are found from where they are declared.
const ELSEWHERE: f64 = 0.5 * FRAC_PI_2;

/// Iterations from a start: one that leads anywhere needs fewer.
const ITERATIONS: usize = 60;

/// The first fit with zeros elsewhere that closes the loop with every joint within its limits, where `fit` does not. None
/// where the rest pose was read, which tells zeros, and where no offset of a joint that turns is fitted. `refit` fits from
/// such parameters.
///
/// A few poses tell from where a fit may close; what closes them by chance does not close all.
pub(super) fn anywhere(
    observations: &Observations,
    fit: &Fit,
    refit: impl Fn(Vec<f64>) -> Result<Fit, Error>,
) -> Option<Fit> {
    let left = if fit.has_start() { fit.chi2 / fit.dof } else { f64::INFINITY };
    let beyond = !observations.is_long() && any_beyond(observations, fit);
    let limit = closing(observations, left).or(beyond.then_some(DECISIVE))?;
    let told_at_rest = observations.anchors().first().is_some_and(|anchor| anchor.known);
    if observations.options.starts == 1 || told_at_rest {
        return None;
    }
    let all = || (observations.clone(), fit.model.instances.clone());
    let (few, terms) = enough(observations, &fit.model).unwrap_or_else(all);
    let few = Observations { centre: observations.centre.clone(), ..few };
    let model = few.model(terms).ok()?;
    let offset = |c: usize| model.column(Role::Offset, c).filter(|_| few.mechanism.turns(c));
    let columns: Vec<usize> = (0..model.scales.len()).filter_map(offset).collect();
    if columns.is_empty() {
        return None;
    }
    let declared = anchored(&few, &model, &vec![1.0; model.scales.len()]);
    let (noise, priors) = (fit.assumed(), few.priors(&model));
    let part = Part { model: &model, readings: &few.readings, weights: Some(&few.weights) };
    let told = model.told_by(&few.readings, &few.weights) as f64;
    let options = few.options.lm.clone();
    let options = SolverOptions { max_iterations: ITERATIONS, ftol: LITTLE, ..options };
    let closes = |turns: &Vec<f64>| {
        let mut beta = declared.clone();
        columns.iter().zip(turns).for_each(|(column, turn)| beta[*column] += turn);
        let start = placed(&few, &model, &noise, beta);
        let problem = Implicit::new(vec![(part, noise.clone())], &priors).coarse();
        let end = lm::minimize(&problem, &start.beta, &options);
        let closed = 2.0 * end.cost < limit * told && is_possible(&few, &model, &end.x);
        closed.then(|| carried(&model, &end.x, &fit.model))
    };
    let starts = starts(columns.len(), observations.options.starts);
    let fits = starts.iter().filter_map(closes).take(FITS).filter_map(|beta| refit(beta).ok());
    let within = |other: &Fit| !any_beyond(observations, other);
    fits.into_iter()
        .find(|other| other.plausible && other.chi2 < limit * other.dof && within(other))
}

/// True where a fit puts a joint beyond its limits.
fn any_beyond(observations: &Observations, fit: &Fit) -> bool {
    let beyond = |c| beyond_limits(observations, &fit.model, &fit.beta, c).is_some();
    (0..fit.model.scales.len()).any(beyond)
}

/// Largest number of fits of all poses.
const FITS: usize = 3;

/// Turns of so many joints: one joint at a time by quarters, then all of them anywhere; of the latter as many as there
/// are starts.
fn starts(joints: usize, count: usize) -> Vec<Vec<f64>> {
    let mut starts = Vec::new();
    for joint in 0..joints {
        for quarters in [2.0, 1.0, -1.0] {
            let mut turns = vec![0.0; joints];
            turns[joint] = quarters * FRAC_PI_2;
            starts.push(turns);
        }
    }
    let anywhere = thin::scattered(joints).take(count);
    starts.extend(anywhere.map(|parts| parts.into_iter().map(|part| TAU * part).collect()));
    starts
}

/// True where gains are of the sign that is declared, and no joint is beyond its limits at its mean reading, whole turns
/// aside.
fn is_possible(of: &Observations, model: &Model, beta: &[f64]) -> bool {
    let within = |c: usize| {
        let (scale, column) = (&model.scales[c], model.column(Role::Offset, c));
        let (Some([low, high]), Some(column)) = (of.mechanism.channels[c].limits, column) else {
            return true;
        };
        let gain = scale.gain + model.gains_of(c).map(|column| beta[column]).sum::<f64>();
        let angle = scale.angle + beta[column] + gain * (of.readings.mean[c] - scale.centre);
        let above = angle - low;
        let above = if of.mechanism.turns(c) { above.rem_euclid(TAU) } else { above };
        (0.0..=high - low).contains(&above)
    };
    let mut channels = 0..model.scales.len();
    !collapsed(model, beta) && ratios(model, beta).all(|r| r > 0.0) && channels.all(within)
}

/// A fit with zeros elsewhere in place of one; beside a mistake with which the loop closes, too, the readings do not say
/// which it is.
pub(super) fn beside(fit: &mut Fit, other: Fit) {
    let [declared, with] = [&*fit, &other].map(|fit| fit.chi2 / fit.dof);
    if !fit.warnings.iter().any(|it| it.of_wiring() && !it.is_no_start()) {
        *fit = other;
        return;
    }
    let offset = |c: &usize| {
        let column = other.model.column(Role::Offset, *c);
        column.is_some_and(|column| apart(other.beta[column], 0.0) > ELSEWHERE)
    };
    let channels = (0..other.model.scales.len()).filter(offset).collect();
    fit.warnings.push(Suspicion::Zeros { channels, closes: Closes { with, declared } });
}

//! Starts in order of distance from the nominal gains, until one is good.

use crate::estimate::miswired::{self, Suspected};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::search::{End, StartSearch, anchored};
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::{Gains, Origin, Start, Try};
use crate::model::Model;
use crate::numerics::thin;

/// Common factors on the nominal gains, the nearest to 1 first.
const FACTORS: [f64; 9] = [1.0, 0.75, 1.35, 0.55, 1.8, 0.4, 2.4, 0.3, 3.2];

/// The search ends after this number of further starts that end at the same best minimum, even if
/// that minimum is not good.
const AGREE: usize = 4;

/// Fits from one start after another until one is good. Returns the best solution, all starts that
/// were tried, and suspected mistakes in the wiring.
#[must_use]
pub fn search(observations: &Observations, model: &Model, noise: &Noise) -> Start {
    let search = StartSearch::new(observations, model, noise);
    let channels = model.scales.len();
    let options = &observations.options;
    let mut tries = Vec::new();
    let mut best: Option<End> = None;
    let mut agreeing = 0;
    // The first start is the anchor itself, without a tied fit: enough for a near solution.
    let near = (None, Origin::Anchor(search.anchors[0].0.kind), vec![1.0; channels]);
    let anchors = &search.anchors;
    let tied = starts(channels, anchors.len(), options.starts)
        .into_iter()
        .map(|(at, name, f)| (Some(&anchors[at]), Origin::Tied(anchors[at].0.kind, name), f));
    for (at, name, factors) in std::iter::once(near).chain(tied).take(options.starts.max(1)) {
        let start = match at {
            None => anchored(observations, model, &factors),
            Some(anchor) => search.better(anchor, &factors),
        };
        let end = search.end(&start);
        let (chi2, collapsed) = (end.score * search.equations(), end.score.is_infinite());
        tries.push(Try { from: name, cost: end.cost, chi2, collapsed });
        let before = best.as_ref().map_or(f64::INFINITY, |b| b.score);
        if end.score < 0.999 * before {
            agreeing = 0;
        } else if end.score < 1.001 * before {
            agreeing += 1;
        }
        let limit = options.good_start;
        if end.score.is_finite() && best.as_ref().is_none_or(|b| end.beats(b, limit)) {
            best = Some(end);
        }
        let good = best.as_ref().is_some_and(|b| b.good(limit));
        let enough = if best.as_ref().is_some_and(|b| b.elsewhere) { 3 * AGREE } else { AGREE };
        if good || agreeing >= enough {
            break;
        }
    }
    if let Some(strict) = best.as_ref().filter(|b| !b.good(options.good_start)) {
        let eased = search.eased(&strict.beta);
        if eased.score < strict.score && !eased.elsewhere {
            best = Some(eased);
        }
    }
    let mut warnings = Vec::new();
    // Where a mistake has been undone already, another one is not looked for beside it.
    let suspected = || suspected(&search, best.as_ref());
    if let Some(found) = (!observations.judged).then(suspected).flatten() {
        warnings.push(found.suspicion);
        warnings.extend(found.instead);
        best = found.end.or(best);
    }
    if best.is_none() && warnings.is_empty() {
        warnings.push(Suspicion::NoStart { tried: tries.len() });
    }
    let beta = best.map_or_else(|| anchored(observations, model, &vec![1.0; channels]), |b| b.beta);
    Start { beta, tries, warnings, ..Start::default() }
}

/// What looks wrong with the wiring where the best end is not good, or where it disagrees with what
/// is known of gains and the rest pose. Nothing where one start is asked for.
fn suspected(search: &StartSearch<'_>, best: Option<&End>) -> Option<Suspected> {
    let options = &search.observations.options;
    if options.starts == 1 {
        return None;
    }
    if search.knows()
        && enough(search, search.knowledge())
        && let Some(suspicion) = miswired::by_knowledge(search, best)
    {
        return Some(Suspected { suspicion, end: None, instead: Vec::new() });
    }
    let score = best.map_or(f64::INFINITY, |end| end.score);
    let doubtful = score >= options.good_start && enough(search, 0);
    if !doubtful {
        return None;
    }
    let beside_a_delay = || {
        let suspicion = miswired::by_motion(search, score)?;
        Some(Suspected { suspicion, end: None, instead: Vec::new() })
    };
    miswired::by_start(search, score).or_else(beside_a_delay)
}

/// True where poses and `known` equations beside them are half as many again as there are
/// parameters: from fewer, almost any mistake leads to a good fit. Repeats of a pose are no
/// equations of their own.
fn enough(search: &StartSearch<'_>, known: usize) -> bool {
    let StartSearch { observations, model, .. } = search;
    let Observations { readings, weights, .. } = observations;
    let mut live = vec![false; readings.poses()];
    for (&pose, weight) in readings.pose.iter().zip(weights) {
        live[pose] |= *weight > 0.0;
    }
    let poses = live.into_iter().filter(|live| *live).count();
    2 * (poses * model.equations() + known) >= 3 * model.parameters
}

/// Anchor, name and gain factors of `count` starts: the nearest factors first, anchors in turn.
fn starts(channels: usize, anchors: usize, count: usize) -> Vec<(usize, Gains, Vec<f64>)> {
    let mut starts: Vec<_> = FACTORS
        .iter()
        .flat_map(|f| (0..anchors).map(move |at| (at, f)))
        .map(|(at, f)| (at, Gains::Times(*f), vec![*f; channels]))
        .collect();
    let further = count.saturating_sub(starts.len());
    for (n, parts) in (1..=further).zip(thin::scattered(channels)) {
        let factors = parts.iter().map(|part| 0.3 * 10.0_f64.powf(*part)); // from 0.3 to 3
        starts.push((n % anchors, Gains::Scattered(n), factors.collect()));
    }
    starts
}

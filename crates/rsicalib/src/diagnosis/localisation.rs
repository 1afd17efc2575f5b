//! What is left of the residual: whether it is noise, and where it is if it is not.

use crate::diagnosis::isolation::{Isolated, taken_up};
use crate::diagnosis::options::RESIDUAL_LEVEL;
use crate::diagnosis::score::scored;
use crate::diagnosis::trace::Traced;
use crate::diagnosis::whereabouts::whereabouts;
use crate::mechanism::Target;
use crate::model::Instance;

pub use crate::diagnosis::doubt::doubt;

/// What is left.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Unexplained {
    /// Probability of the residual by chance.
    pub p_value: Option<f64>,
    /// Where the structure is.
    pub target: Option<String>,
    /// In words.
    pub text: String,
}

/// Whether what is left is noise, and if not, where it is; `rises` is by how much χ² would
/// rise without each effect found.
#[must_use]
pub fn unexplained(traced: &Traced, rises: &[f64]) -> Unexplained {
    let p_value = traced.judge.lack_of_fit(&traced.last);
    if p_value.is_some_and(|p| p <= RESIDUAL_LEVEL) {
        let (target, text) =
            traced.isolated.as_ref().map_or_else(|| locate(traced), |it| at_fault(traced, it));
        return Unexplained { p_value, target: Some(target), text };
    }
    let found: Vec<Instance> = traced.found.iter().map(|found| found.instance).collect();
    if let Some((target, text)) = doubt(&traced.small.mechanism, &found, rises) {
        let target =
            traced.isolated.as_ref().map_or(target, |it| it.target.name(&traced.small.mechanism));
        let text = format!("nothing left above the noise, but {text}");
        return Unexplained { p_value, target: Some(target), text };
    }
    let text = match p_value {
        Some(_) => format!("nothing left above the noise{}", nearest(traced)),
        None => {
            "lack of fit cannot be judged: record each pose several times, or declare the noise"
                .into()
        }
    };
    Unexplained { p_value, target: None, text }
}

/// The effect that came nearest to being named, where chance makes such a one in less
/// than half of all sessions.
fn nearest(traced: &Traced) -> String {
    let near = traced.left.filter(|s| s.corrected < 0.5 && !scored::is_data(&s.instance));
    near.map_or(String::new(), |s| {
        let (id, target) = (s.instance.term.info().id, s.instance.target);
        let target = target.name(&traced.observations.mechanism);
        format!(
            "; nearest to it is {id} of {target}, as chance makes one with p = {:.2}",
            s.corrected
        )
    })
}

/// What is at fault alone, by a law that no effect of the catalogue has.
fn at_fault(traced: &Traced, alone: &Isolated) -> (String, String) {
    let name = alone.target.name(&traced.small.mechanism);
    let places = match alone.target {
        Target::Channel(channel) => whereabouts(traced, channel),
        _ => String::new(),
    };
    let places = if places.is_empty() { places } else { format!(" ({places})") };
    let next = match alone.target {
        Target::Closure(_) => "Look for play or bending there, and record more poses.".into(),
        _ => format!(
            "Record more poses that move {name} through its range, alone, slowly, in both directions."
        ),
    };
    let text = format!(
        "errors of {name} alone explain what is left{places}: without it all else closes within its \
         noise (p = {:.2}). But no effect of the catalogue has their law. {next}",
        alone.p_value
    );
    (name, text)
}

/// Share of what a chain takes up that one of its channels must take up alone to
/// be the one at fault.
const ALONE: f64 = 0.6;

/// The same where an effect was named at another of its channels: two that are
/// wrong may be one fault of what they carry.
const ALONE_BESIDE: f64 = 0.85;

/// The channel, or the chain, whose readings could best take up what is left, pose
/// by pose: what it takes up beyond what it would take up of noise.
fn locate(traced: &Traced) -> (String, String) {
    let mechanism = &traced.small.mechanism;
    let excess = |channels: &[usize]| {
        let (taken, dimensions) = taken_up(&traced.small, &traced.last, channels);
        taken - dimensions
    };
    let best = |scores: &[f64]| (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]));
    let of_chain: Vec<Vec<usize>> =
        (0..mechanism.chains.len()).map(|c| mechanism.channels_of(c)).collect();
    let chains: Vec<f64> = of_chain.iter().map(|channels| excess(channels)).collect();
    let chain = best(&chains).unwrap_or(0);
    let channels: Vec<f64> = of_chain[chain].iter().map(|&c| excess(&[c])).collect();
    let channel = best(&channels).unwrap_or(0);
    let beside = traced.found.iter().any(|found| match found.instance.target {
        Target::Channel(c) => c != of_chain[chain][channel] && of_chain[chain].contains(&c),
        _ => false,
    });
    let needed = if beside { ALONE_BESIDE } else { ALONE };
    let alone = channels.get(channel).is_some_and(|e| *e >= needed * chains[chain]);
    let (name, what) = if alone {
        let name = &mechanism.channels[of_chain[chain][channel]].name;
        (name.clone(), format!("errors of {name}"))
    } else {
        let name = &mechanism.chains[chain].name;
        (name.clone(), format!("errors of several joints of {name}, or of its tip,"))
    };
    let everything: Vec<usize> = (0..mechanism.channels.len()).collect();
    let share = 100.0 * if alone { channels[channel] } else { chains[chain] } / excess(&everything);
    let places = of_chain[chain].get(channel).map(|&c| whereabouts(traced, c)).unwrap_or_default();
    let places = if places.is_empty() { places } else { format!(" ({places})") };
    let text = format!(
        "structure is left that no effect of the catalogue explains; {what} would take up {:.0} % of it{places}. \
         Record more poses that move {name} through its range, alone, slowly, in both directions.",
        share.clamp(0.0, 100.0)
    );
    (name, text)
}

//! What is left of the residual: whether it is noise, and where it is if it is not.

use crate::diagnosis::doubt::{Doubted, doubt};
use crate::diagnosis::isolation::{belongs, taken_up};
use crate::diagnosis::location::{Location, location};
use crate::diagnosis::options::LEVEL;
use crate::diagnosis::score::scored::{self, Scored};
use crate::diagnosis::search::noise::scatter;
use crate::diagnosis::trace::Traced;
use crate::diagnosis::unknown_law::UnknownLaw;
use crate::estimate::noise::source::{NOISIER, Source};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::{AS_WELL, SURE, probabilities};
use crate::numerics::order::Ends;
use crate::terms::term::Needs;

/// What is left of the residual.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Residual {
    /// No more than noise.
    Noise {
        /// The effect that came nearest to being named, and the probability that chance makes
        /// such a one; where that is less than half.
        nearest: Option<(Instance, f64)>,
    },
    /// Nothing but the fit gives the noise.
    Unjudged {
        /// True where there are no more equations than parameters: no noise that is known would judge them.
        nothing_left: bool,
        /// True where that is how well closures are seated: repeats of a pose do not show it.
        seatings: bool,
    },
    /// No more than noise, but the effects found may stand for another.
    Doubtful(Doubted),
    /// No more than noise, but a law that no term has explains it better than the effects found, or
    /// than none.
    UnknownLaw(UnknownLaw),
    /// More than noise: errors of one channel that follow a law which no term has, likelier than
    /// all below.
    Follows(UnknownLaw),
    /// One channel, closure or chain is at fault alone, by a law that no term has.
    Isolated {
        /// What is at fault.
        target: Target,
        /// Where its errors lie.
        location: Location,
        /// Probability that all else leaves so much by chance.
        p_value: f64,
    },
    /// More than the noise that is declared and nothing bears out, and so many times that noise,
    /// of all channels and closures alike, made it rather than errors of any one channel.
    Louder {
        /// How many times.
        factor: f64,
        /// True where repeats show the noise of the readings, and what is declared is that of the closures.
        repeats: bool,
    },
    /// More than noise.
    Structure(Structure),
}

/// Structure that no effect of the catalogue explains.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Whose errors would take it up.
    pub share: Share,
    /// How much of it, in per cent.
    pub percent: f64,
    /// Where those errors would lie.
    pub location: Location,
    /// With one equation a pose, any channel would take up all of it: the channels whose scatter
    /// between poses may have made it by (75), with their probabilities, likeliest first.
    pub likely: Vec<(usize, f64)>,
}

/// Whose errors would take up what is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// Those of one channel.
    Channel(usize),
    /// Those of several channels of a chain, or of its tip.
    Chain(usize),
}

/// Whether what is left is noise, and if not, where it is; `rises` is by how much χ² would
/// rise without each effect found.
#[must_use]
pub fn residual(traced: &Traced, rises: &[f64]) -> Residual {
    let p_value = traced.p_value;
    if p_value.is_some_and(|p| p <= LEVEL) {
        return left_over(traced);
    }
    let found: Vec<Instance> = traced.found.iter().map(|found| found.instance).collect();
    if let Some(doubted) = doubt(&traced.small.mechanism, &found, rises) {
        return Residual::Doubtful(doubted);
    }
    if let Some(law) = traced.unknown.as_ref().filter(|law| law.is_said()) {
        return Residual::UnknownLaw(law.clone());
    }
    match p_value {
        Some(_) => Residual::Noise { nearest: nearest(traced) },
        None => Residual::Unjudged {
            nothing_left: traced.after.dof < 1.0,
            seatings: traced.last.noise.largest_seating().is_some(),
        },
    }
}

/// What is left where more is left than noise: the likeliest of a law, of whatever is at fault alone, of
/// larger noise, and of scatter of a channel.
fn left_over(traced: &Traced) -> Residual {
    // A law that leaves more than noise is no account of what is left.
    let closes = |law: &&UnknownLaw| {
        traced.judge.too_large(law.left, traced.last.dof - law.told) > LEVEL && law.behind < 0.0
    };
    let law = traced.unknown.as_ref().filter(closes);
    let gain = law.map_or(0.0, |law| -law.behind);
    // Beside effects that were found, nothing is known of what the law gains over the isolated target.
    let isolated = traced.isolated.as_ref().filter(|isolated| {
        let mechanism = &traced.small.mechanism;
        let same = law.is_some_and(|law| belongs(mechanism, law.whose.target, isolated.target));
        same || !traced.found.is_empty() || isolated.gain >= gain
    });
    if let Some(isolated) = isolated {
        let location = match isolated.target {
            Target::Channel(channel) => location(traced, channel),
            _ => Location::default(),
        };
        let (target, p_value) = (isolated.target, isolated.p_value);
        return Residual::Isolated { target, location, p_value };
    }
    let (own, others) = of_channels(traced, law);
    louder(traced, own.max(others))
        .or_else(|| law.filter(|_| own > others).map(|law| Residual::Follows(law.clone())))
        .unwrap_or_else(|| Residual::Structure(locate(traced)))
}

/// How well (75) has what is left made by a law and by scatter of the channel that the law is of, which speak for
/// each other, and by scatter of any other channel.
fn of_channels(traced: &Traced, law: Option<&UnknownLaw>) -> (f64, f64) {
    let of_law = |c: &usize| law.is_some_and(|law| law.whose.target == Target::Channel(*c));
    let (own, others): (Vec<usize>, Vec<usize>) =
        (0..traced.small.mechanism.channels.len()).partition(of_law);
    let most = |of: &[usize]| of.iter().map(|&c| scatter_of(traced, c)).fold(0.0, f64::max);
    (law.map_or(0.0, |law| -law.behind).max(most(&own)), most(&others))
}

/// How well so many times the declared noise explains what is left, where nothing bears that out: twice the logarithm
/// of how much likelier what is left becomes, and how many times.
fn alike(traced: &Traced) -> Option<(f64, f64)> {
    let [chi2, dof] = traced.judge.left?;
    let scale = chi2 / dof;
    Some((chi2 - chi2 / scale - dof * scale.ln(), scale.sqrt()))
}

/// What is left as so many times the declared noise, where no channel explains it as well, by `best`.
fn louder(traced: &Traced, best: f64) -> Option<Residual> {
    let (gain, factor) = alike(traced).filter(|_| traced.found.is_empty())?;
    let repeats = traced.last.noise.source == Source::Repeats;
    (gain > best + AS_WELL).then_some(Residual::Louder { factor, repeats })
}

/// True where more of the declared noise, by no more than it may be too small, explains what is left about as well as
/// anything does.
pub(crate) fn may_be_louder(traced: &Traced) -> bool {
    let (own, others) = of_channels(traced, traced.unknown.as_ref());
    let best = traced.isolated.as_ref().map_or(0.0, |it| it.gain).max(own).max(others);
    alike(traced).is_some_and(|(gain, factor)| factor < NOISIER && gain + AS_WELL > best)
}

/// The effect that came nearest to being named, where chance makes such a one in less
/// than half of all sessions. What follows how readings change is near by their noise, which is in both.
fn nearest(traced: &Traced) -> Option<(Instance, f64)> {
    let moves = |s: &Scored| s.instance.term.needs().contains(&Needs::Motion);
    let may = |s: &Scored| s.corrected < 0.5 && !scored::is_data(&s.instance) && !moves(s);
    let near = traced.left.filter(may);
    near.map(|s| (s.instance, s.corrected))
}

/// Share of what a chain takes up that one of its channels must take up alone to
/// be the one at fault.
const ALONE: f64 = 0.6;

/// The same where an effect was named at another of its channels: two that are
/// wrong may be one fault of what they carry.
const ALONE_BESIDE: f64 = 0.85;

/// The channel, or the chain, whose readings could best take up what is left, pose
/// by pose: what it takes up beyond what it would take up of noise.
fn locate(traced: &Traced) -> Structure {
    if traced.last.residuals.equations == 1 {
        return by_variance(traced);
    }
    let mechanism = &traced.small.mechanism;
    let excess = |channels: &[usize]| {
        let (taken, dimensions) = taken_up(&traced.small, &traced.last, channels);
        taken - dimensions
    };
    let best = |scores: &[f64]| (0..scores.len()).greatest_by(|&k| scores[k]);
    let of_chain: Vec<Vec<usize>> =
        (0..mechanism.chains.len()).map(|c| mechanism.channels_of(c)).collect();
    let chains: Vec<f64> = of_chain.iter().map(|channels| excess(channels)).collect();
    let Some(chain) = best(&chains) else {
        // Without a chain, of all channels.
        let each: Vec<f64> = (0..mechanism.channels.len()).map(|c| excess(&[c])).collect();
        let channel = best(&each).unwrap_or(0);
        let everything: Vec<usize> = (0..each.len()).collect();
        let percent = (100.0 * each[channel] / excess(&everything)).clamp(0.0, 100.0);
        let (share, location) = (Share::Channel(channel), location(traced, channel));
        return Structure { share, percent, location, likely: Vec::new() };
    };
    let channels: Vec<f64> = of_chain[chain].iter().map(|&c| excess(&[c])).collect();
    let channel = best(&channels).unwrap_or(0);
    let beside = traced.found.iter().any(|found| match found.instance.target {
        Target::Channel(c) => c != of_chain[chain][channel] && of_chain[chain].contains(&c),
        _ => false,
    });
    let needed = if beside { ALONE_BESIDE } else { ALONE };
    let alone = channels.get(channel).is_some_and(|e| *e >= needed * chains[chain]);
    let everything: Vec<usize> = (0..mechanism.channels.len()).collect();
    let taken = if alone { channels[channel] } else { chains[chain] };
    let percent = (100.0 * taken / excess(&everything)).clamp(0.0, 100.0);
    let own = of_chain[chain].get(channel).copied();
    Structure {
        share: match own {
            Some(own) if alone => Share::Channel(own),
            _ => Share::Chain(chain),
        },
        percent,
        location: own.map(|c| location(traced, c)).unwrap_or_default(),
        likely: Vec::new(),
    }
}

/// The channel, or the channels, whose scatter between poses is the likeliest cause of what is
/// left, where a pose has one equation and any channel would take up all of it.
fn by_variance(traced: &Traced) -> Structure {
    let mechanism = &traced.small.mechanism;
    let channels = 0..mechanism.channels.len();
    let scores: Vec<(f64, usize)> = channels.map(|c| (scatter_of(traced, c), c)).collect();
    let likely = probabilities(&scores);
    let (first, sure) = likely.first().copied().unwrap_or((0, 0.0));
    let share = match mechanism.chain_of(first) {
        Some(chain) if sure < SURE => Share::Chain(chain),
        _ => Share::Channel(first),
    };
    let location = match share {
        Share::Channel(channel) => location(traced, channel),
        Share::Chain(_) => Location::default(),
    };
    let mut before = 0.0;
    let named = likely.iter().take_while(|(_, probability)| {
        let needed = before < SURE;
        before += probability;
        needed
    });
    Structure { share, percent: 100.0, location, likely: named.copied().collect() }
}

/// What scatter of a channel between poses explains of what is left, (75).
fn scatter_of(traced: &Traced, c: usize) -> f64 {
    scatter(&traced.small, &traced.last, &[c])
}

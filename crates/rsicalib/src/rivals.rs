//! Which of several explanations may be right.

/// Effects that fit as well as the one named: refitted χ² within this, extra
/// parameters charged.
pub const AS_WELL: f64 = 6.0;

/// Probability with which the right target must be among those named.
pub const SURE: f64 = 0.8;

/// Of rivals `(value, target)`, those that may be right: targets by falling
/// probability until they are [`SURE`] to hold the truth, in each of them what is
/// within [`AS_WELL`] of the best. A value is twice a log-likelihood, parameters
/// charged; before the data every rival was as likely as another.
#[must_use]
pub fn credible<T: PartialEq + Copy>(rivals: &[(f64, T)]) -> Vec<bool> {
    let best = rivals.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mut targets: Vec<(T, f64)> = Vec::new();
    for &(value, target) in rivals {
        let weight = (0.5 * (value - best)).exp();
        match targets.iter_mut().find(|t| t.0 == target) {
            Some(known) => known.1 = known.1.max(weight),
            None => targets.push((target, weight)),
        }
    }
    targets.sort_by(|a, b| b.1.total_cmp(&a.1));
    let all: f64 = targets.iter().map(|t| t.1).sum();
    let mut before = 0.0;
    targets.retain(|t| {
        let needed = before < SURE * all;
        before += t.1;
        needed
    });
    let kept = |target: &T| targets.iter().any(|t| t.0 == *target);
    rivals.iter().map(|(value, target)| *value > best - AS_WELL && kept(target)).collect()
}

/// A chain, and whether it is sure.
pub type Likely = (Option<usize>, bool);

/// Of rivals `(value, chain)` as in [`credible`], the chain that holds the truth with the
/// greatest probability, and whether that is [`SURE`].
#[must_use]
pub fn likeliest_chain(rivals: &[(f64, Option<usize>)]) -> Likely {
    let best = rivals.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mut chains: Vec<(Option<usize>, f64)> = Vec::new();
    for &(value, chain) in rivals {
        let weight = (0.5 * (value - best)).exp();
        match chains.iter_mut().find(|c| c.0 == chain) {
            Some(known) => known.1 += weight,
            None => chains.push((chain, weight)),
        }
    }
    let all: f64 = chains.iter().map(|c| c.1).sum();
    let likeliest = chains.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
    likeliest.map_or((None, false), |(chain, weight)| (chain, weight >= SURE * all))
}

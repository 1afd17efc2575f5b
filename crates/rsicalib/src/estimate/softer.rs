//! Joints that give more than is typical of their mechanism.
//!
//! Readings hardly tell what several joints give apart, so each is held by a typical size `S`. Where readings contradict
//! that size, `|β̂(S)| > z S` with `z` of the usual level, it is the likeliest variance of the prior in its place, which the
//! estimate itself tells,
//!
//! ```text
//! s = max(S, |β̂(s)|)                                                          (176)
//! ```
//!
//! until it stands. With the estimate `b ± σ` of the readings alone, `β̂(s) = b s² / (s² + σ²)`: that stands at
//! `s = (b + √(b² - 4σ²)) / 2` where `b > 2σ`, and falls back to `S` where readings tell less.

use crate::estimate::fitted::Fit;
use crate::estimate::significance::LEVEL;
use crate::model::Prior;
use crate::numerics::distributions::two_sided_limit;

/// Estimates that differ by less, in parts of themselves, are the same.
const SAME: f64 = 0.01;

/// The priors of a fit with (176) in the place of sizes that readings contradict; none where they stand.
pub(crate) fn softer(fit: &Fit) -> Option<Vec<Prior>> {
    let typical = fit.model.give_by_size();
    if typical.is_empty() {
        return None;
    }
    let limit = two_sided_limit(LEVEL, typical.len());
    let size = |column: usize| {
        typical.iter().find_map(|prior| match *prior {
            Prior::Parameter { column: own, sd, .. } if own == column => Some(sd),
            _ => None,
        })
    };
    let mut changed = false;
    let priors = fit.priors.iter().map(|prior| match *prior {
        Prior::Parameter { column, mean, sd } if mean == 0.0 => {
            let found = fit.beta[column].abs();
            let contradicted = |size: &f64| sd > *size || (sd == *size && found > limit * size);
            let next = size(column).filter(contradicted).map_or(sd, |size| size.max(found));
            changed |= (next - sd).abs() > SAME * sd;
            Prior::Parameter { column, mean, sd: next }
        }
        other => other,
    });
    let priors = priors.collect();
    changed.then_some(priors)
}

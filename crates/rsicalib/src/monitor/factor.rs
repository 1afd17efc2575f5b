//! What a converter reads, multiplied: the gain of one sensor, or the reference of them all.
//!
//! A reading `a` of a converter is a voltage over its reference. Where the sensor is loaded, or the
//! reference wanders, `a` becomes `a (1 + f)`, about reading zero: the gain `k` of the channel
//! is `k (1 + φ)` from then on, `1 + φ = 1 / (1 + f)`, and its offset at the reading `m` moves with
//! it. So the angle at a reading changes by
//!
//! ```text
//! Δ = φ (k (a - m) + k m)                                                (133)
//! ```
//!
//! `φ` is one column: that of the gain times `k`, and that of the offset times `k m`. A gain that is
//! free of its offset turns about any reading, fits twice as much, and says less.

use crate::mechanism::{Mechanism, Target};
use crate::model::{Model, Spec};
use crate::terms::term::Role;

/// Typical size of a gain's change: the electrical angle of a potentiometer varies by per cents.
const OWN: f64 = 0.03;

/// Typical size of a change of the reference that all channels share.
const SHARED: f64 = 0.01;

/// Term of a reference that has changed.
pub(crate) const REFERENCE: &str = "reference";

/// One factor on the gains of some channels.
#[derive(Debug, Clone)]
pub(crate) struct Factor {
    /// Column of the factor, a position in [`super::watched::Watched::order`].
    pub(crate) own: usize,
    /// Columns of the model that it moves, and by how much.
    pub(crate) parts: Vec<(usize, f64)>,
}

/// What may be multiplied: the change, its typical size, and the columns of the model that it moves.
pub(crate) struct Multiplied {
    pub(crate) spec: Spec,
    pub(crate) size: f64,
    pub(crate) parts: Vec<(usize, f64)>,
}

/// What may be multiplied: each channel that a converter reads, and all of them where there are
/// several; about the parameters `at`.
pub(crate) fn factors(mechanism: &Mechanism, model: &Model, at: &[f64]) -> Vec<Multiplied> {
    let spec = |term: &str, target: Target| Spec {
        term: term.into(),
        target: Some(target.name(mechanism)),
        place: None,
    };
    let parts = |c: usize| -> Option<Vec<(usize, f64)>> {
        let (gain, offset) = (model.column(Role::Gain, c)?, model.column(Role::Offset, c)?);
        let slope = model.scales[c].gain + at[gain];
        Some(vec![(gain, slope), (offset, slope * model.scales[c].centre)])
    };
    let own: Vec<(usize, Vec<(usize, f64)>)> =
        converted(mechanism).filter_map(|c| Some((c, parts(c)?))).collect();
    let all: Vec<(usize, f64)> = own.iter().flat_map(|(_, parts)| parts.clone()).collect();
    let several = own.len() > 1;
    let one = |(c, parts)| Multiplied { spec: spec("gain", Target::Channel(c)), size: OWN, parts };
    let mut found: Vec<Multiplied> = own.into_iter().map(one).collect();
    if several {
        found.push(Multiplied { spec: spec(REFERENCE, Target::All), size: SHARED, parts: all });
    }
    found
}

/// The gains of all channels that a converter reads.
pub(crate) fn gains(mechanism: &Mechanism) -> Vec<Spec> {
    let spec = |c| Spec {
        term: "gain".into(),
        target: Some(Target::Channel(c).name(mechanism)),
        place: None,
    };
    converted(mechanism).map(spec).collect()
}

fn converted(mechanism: &Mechanism) -> impl Iterator<Item = usize> {
    (0..mechanism.channels.len()).filter(|&c| mechanism.channels[c].is_converted())
}

//! How bad an effect could be there unseen, before and after poses that are planned.

use crate::numerics::order::Ends;
use faer::Mat;

use crate::apply::change::PlatformRms;
use crate::design::linearised::Whitened;
use crate::design::moments::Moments;
use crate::diagnosis::detectability::{Hardest, seen_at};
use crate::mechanism::Mechanism;
use crate::model::{Instance, Model};
use crate::numerics::symmetric::invert;

/// The absent effect that could harm the platform most without being seen.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct WorstHidden {
    /// Id of the term.
    pub term: String,
    /// What it would belong to.
    pub target: String,
    /// What it would do to the platform over the workspace, at the size that would be seen in four
    /// sessions of five.
    pub platform_rms: PlatformRms,
}

/// The worst effect among instances of a model beyond its first `base` instances, where these rows
/// are read; none where no effect can be seen at all.
pub(crate) fn worst_hidden(
    mechanism: &Mechanism,
    model: &Model,
    named: &[Instance],
    gram: &Mat<f64>,
    fitted: &[usize],
    moments: &Moments,
) -> Option<WorstHidden> {
    let n = fitted.len();
    // What nothing determines stays where it is: an effect of no size goes any way there.
    let (inverse, ..) = invert(&Mat::from_fn(n, n, |i, j| gram[(fitted[i], fitted[j])]));
    let seen = seen_at(named.len());
    let one = |instance: &Instance| {
        let at = model.instances.iter().position(|i| i == instance)?;
        let own: Vec<usize> = (model.first[at]..model.first[at] + instance.width()).collect();
        let d = own.len();
        let sizes = model.typical_at(instance.term, instance.target);
        let cross = Mat::from_fn(n, d, |i, j| gram[(fitted[i], own[j])] * sizes[j]);
        let absorbed = &inverse * &cross;
        let raw = Mat::from_fn(d, d, |i, j| gram[(own[i], own[j])] * sizes[i] * sizes[j]);
        let square = &raw - cross.transpose() * &absorbed;
        let whole: f64 = (0..d).map(|i| raw[(i, i)]).sum();
        let hardest = Hardest::of(&square, whole, seen)?;
        let direction = Mat::from_fn(d, 1, |i, _| hardest.direction[i] * hardest.size);
        // What it does, less what the fitted parameters absorb.
        let taken = &absorbed * &direction;
        let mut effect = Mat::<f64>::zeros(model.parameters, 1);
        (0..n).for_each(|i| effect[(fitted[i], 0)] = -taken[(i, 0)]);
        (0..d).for_each(|i| effect[(own[i], 0)] = direction[(i, 0)] * sizes[i]);
        let rms = |m: &Mat<f64>| (effect.transpose() * m * &effect)[(0, 0)].max(0.0).sqrt();
        let platform_rms = PlatformRms {
            position: rms(&moments.position),
            orientation: rms(&moments.orientation),
        };
        let term = instance.term.info().id.into();
        let target = instance.target.name(mechanism);
        Some(WorstHidden { term, target, platform_rms })
    };
    let found = named.iter().filter_map(one);
    found.greatest_by(|a| a.platform_rms.position)
}

/// `WᵀW` of rows, with what priors know of some parameters.
pub(crate) fn with_priors(rows: &Whitened, priors: &Mat<f64>, columns: &[usize]) -> Mat<f64> {
    let mut gram = rows.gram();
    for (i, &a) in columns.iter().enumerate() {
        for (j, &b) in columns.iter().enumerate() {
            gram[(a, b)] += priors[(i, j)];
        }
    }
    gram
}

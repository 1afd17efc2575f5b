//! Joints that give under the links' weight are found together.

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::Rule;
use crate::diagnosis::price::charge;
use crate::diagnosis::score::scored::Scored;
use crate::diagnosis::search::admissible::{estimate_of, physical};
use crate::estimate::{Fit, fit};
use crate::kinematics::elements::Weight;
use crate::terms::term::Acts;

impl Averaged<'_> {
    /// All joints that give under the links' weight, as one effect: what one joint gives
    /// is not told without what the others do. Those that do not stand out are left out,
    /// and those that would have to give against their load.
    pub(crate) fn yielding(
        &self,
        current: &Fit,
        scored: &[Scored],
    ) -> Result<Option<(Vec<Scored>, Fit)>, Error> {
        let of_links = |s: &&Scored| matches!(s.instance.term.acts(), Acts::Load(Weight::Links));
        let mut joints: Vec<Scored> = scored.iter().filter(of_links).copied().collect();
        if !self.search.uses(Rule::Yielding) {
            joints.clear();
        }
        while joints.len() > 1 {
            let mut instances = current.model.instances.clone();
            instances.extend(joints.iter().map(|s| s.instance));
            let refit = match fit(&self.small, instances, Some(current)) {
                Err(Error::TooFew { .. }) => return Ok(None),
                refit => refit?,
            };
            let judge = self.judge(&refit);
            let mut weakest: Option<(f64, usize)> = None;
            for (k, joint) in joints.iter_mut().enumerate() {
                let Some(sure) = estimate_of(&refit, &joint.instance) else { return Ok(None) };
                // By how much χ² would rise without it, to first order; with its sign.
                joint.score = sure * sure.abs();
                let score = joint.score.max(0.0);
                joint.p_value = judge.without(score, joint.width).p_value(score, joint.width);
                joint.corrected = joint.p_value * joint.places;
                joint.charge = charge(joint.width, score);
                if weakest.is_none_or(|(score, _)| joint.score < score) {
                    weakest = Some((joint.score, k));
                }
            }
            match weakest {
                Some((_, k)) if joints[k].charged() <= 0.0 => joints.remove(k),
                _ => {
                    let admitted = self.sensible(current, &refit)
                        && joints.iter().all(|s| physical(&refit, &s.instance));
                    return Ok(admitted.then_some((joints, refit)));
                }
            };
        }
        Ok(None)
    }
}

//! Priors of a model's parameters.

use crate::mechanism::Target;
use crate::model::compiled::Model;
use crate::model::prior::Prior;
use crate::terms::targets;
use crate::terms::term::Acts;

/// Standard deviation of the prior on the first joint's offset where that offset turns chain and
/// unknown points together (rad, or length units): the same as of the rotations of a frame.
const ROOT: f64 = 3e-3;

impl Model {
    /// Priors of the parameters: of free shapes, of standard deviations that the mechanism declares,
    /// and of known distances between unknown points.
    ///
    /// Complete geometry has directions that no reading determines: an offset turns the same bodies
    /// as the frame of its link, or as the tool. So all of its parameters have priors, offsets
    /// included. An offset that turns chain and unknown points together has the prior of a frame.
    #[must_use]
    pub fn priors(&self) -> Vec<Prior> {
        let mut priors = self.links();
        let complete = self.instances.iter().any(|i| i.term.info().broad);
        let root = self.mechanism.channels_of(0).first().copied();
        let root = root.filter(|_| self.mechanism.floats()).map(Target::Channel);
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let info = instance.term.info();
            let declared = self.mechanism.model.sd.get(info.id).copied();
            let drawing = match instance.target {
                Target::Closure(k) => self.mechanism.closures.get(k).and_then(|c| c.sd),
                _ => None,
            };
            // A term with redundant directions, or a free shape, has its typical size as prior.
            let held = info.penalised
                || info.broad
                || matches!(instance.term.acts(), Acts::Load(_))
                || (complete && info.id == "offset");
            let mut typical = targets::typical(&self.mechanism, instance.term, instance.target);
            if complete && info.id == "offset" && root == Some(instance.target) {
                typical = vec![ROOT];
            }
            for (k, typical) in typical.into_iter().enumerate() {
                if let Some(sd) = declared.or(drawing).or(held.then_some(typical)) {
                    priors.push(Prior::Parameter { column: first + k, mean: 0.0, sd });
                }
            }
        }
        priors
    }
}

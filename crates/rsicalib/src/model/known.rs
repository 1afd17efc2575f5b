//! What is known of a model's parameters without readings, as priors.

use crate::mechanism::Target;
use crate::model::compiled::Model;
use crate::model::prior::Prior;
use crate::terms::targets;
use crate::terms::term::{Acts, Role};

/// How firmly the first joint's zero is held where it turns the whole world [rad, or
/// length units]: as the rotations of a frame.
const ROOT: f64 = 3e-3;

impl Model {
    /// What is known of the parameters without readings: what holds a free
    /// shape, what the mechanism declares, how far apart unknown points are.
    ///
    /// Complete geometry has directions that no reading tells: an offset turns what
    /// the frame of its link, or the tool, turns too. All of it is held, offsets too,
    /// and one that turns the whole world as firmly as the frames.
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
                Target::Closure(k) => self.mechanism.closures[k].sd,
                _ => None,
            };
            // What has redundant directions, or a free shape, is held by its typical size.
            let held = info.penalised
                || info.broad
                || matches!(instance.term.acts(), Acts::Load(_))
                || (complete && instance.term.role() == Role::Offset);
            let mut typical = targets::typical(&self.mechanism, instance.term, instance.target);
            if complete && instance.term.role() == Role::Offset && root == Some(instance.target) {
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

//! What is known of a model's parameters without readings, as priors.

use crate::kinematics::elements::Weight;
use crate::mechanism::Target;
use crate::model::compiled::Model;
use crate::model::instance::Instance;
use crate::model::prior::Prior;
use crate::terms::targets;
use crate::terms::term::{Acts, Per, Role};

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
        let whole = |i: &Instance| i.term.info().broad && i.term.info().per == Per::Row;
        let complete = self.instances.iter().any(whole);
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
                || self.gives(instance)
                || (complete && instance.term.role() == Role::Offset);
            let mut typical = self.typical(instance);
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

    /// True for a load that is held: what joints give is hard to tell from what others give.
    fn gives(&self, instance: &Instance) -> bool {
        let links = |i: &&Instance| matches!(i.term.acts(), Acts::Load(Weight::Links));
        match instance.term.acts() {
            Acts::Load(Weight::Links) => self.instances.iter().filter(links).count() > 1,
            Acts::Load(Weight::Tip) => true,
            _ => false,
        }
    }

    /// Typical size of each parameter of an instance. What a joint gives is typical under the
    /// largest torque about that joint in these readings.
    fn typical(&self, instance: &Instance) -> Vec<f64> {
        let torque = self.largest_torque(instance).filter(|torque| *torque > 0.0);
        match (instance.term.acts(), torque) {
            (Acts::Load(Weight::Links), Some(torque)) => {
                instance.term.info().parameters.iter().map(|p| p.typical / torque).collect()
            }
            _ => targets::typical(&self.mechanism, instance.term, instance.target),
        }
    }

    fn largest_torque(&self, instance: &Instance) -> Option<f64> {
        let at = self.instances.iter().position(|i| i == instance)?;
        let own = self.loads.iter().zip(&self.torques);
        let own = own.filter(|(load, _)| load.parameter == self.first[at]);
        own.map(|(_, torque)| *torque).reduce(f64::max)
    }
}

//! Priors of a model's parameters.

use crate::kinematics::elements::Weight;
use crate::mechanism::Target;
use crate::model::compiled::Model;
use crate::model::instance::Instance;
use crate::model::prior::Prior;
use crate::terms::targets;
use crate::terms::term::{Acts, Per, Role, Term};

/// Standard deviation of the prior on the first joint's offset where that offset turns chain and
/// unknown points together (rad, or length units): the same as of the rotations of a frame.
const ROOT: f64 = 3e-3;

/// What a mechanism declares as known, with a standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Declared {
    /// The distance of a closure between unknown points.
    Distance(usize),
    /// The size of a term: what is drawn is right to so much.
    Term(Instance),
}

impl Model {
    /// Priors that the mechanism declares, each with what is declared.
    pub(crate) fn declared(&self) -> Vec<(Declared, Prior)> {
        let distances = self.links_of_closures().into_iter();
        let mut found: Vec<_> = distances.map(|(k, link)| (Declared::Distance(k), link)).collect();
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let Some(sd) = self.declared_sd(instance) else { continue };
            let columns = first..first + instance.term.info().parameters.len();
            let prior = |column| Prior::Parameter { column, mean: 0.0, sd };
            found.extend(columns.map(|column| (Declared::Term(*instance), prior(column))));
        }
        found
    }

    /// Priors of the parameters: of free shapes, of standard deviations that the mechanism declares,
    /// of known distances between unknown points, and of coordinates of unknown points that the
    /// drawing alone determines.
    ///
    /// Complete geometry has directions that no reading determines: an offset turns the same bodies
    /// as the frame of its link, or as the tool. So all of its parameters have priors, offsets
    /// included. An offset that turns chain and unknown points together has the prior of a frame.
    #[must_use]
    pub fn priors(&self) -> Vec<Prior> {
        let mut priors = self.links();
        priors.extend_from_slice(&self.held);
        let complete = self.is_complete();
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let info = instance.term.info();
            // A term with redundant directions, or a free shape, has its typical size as prior.
            let held = info.penalised
                || info.broad
                || self.gives(instance)
                || (complete && instance.term.role() == Role::Offset);
            let known = self.declared_sd(instance);
            for (k, typical) in self.size(instance).into_iter().enumerate() {
                if let Some(sd) = known.or(held.then_some(typical)) {
                    priors.push(Prior::Parameter { column: first + k, mean: 0.0, sd });
                }
            }
        }
        priors
    }

    /// Priors of the places of tools, and of what joints give, that are typical sizes: nothing else is known of
    /// those. A complete geometry is held as a whole.
    pub(crate) fn held_by_size(&self) -> Vec<Prior> {
        let complete = self.is_complete();
        let tool = |i: &Instance| !complete && i.term.moves_tool() && i.term.info().broad;
        self.typical_of(|i| tool(i) || self.gives(i))
    }

    /// Priors of what joints give that are typical sizes.
    pub(crate) fn give_by_size(&self) -> Vec<Prior> {
        self.typical_of(|i| self.gives(i))
    }

    /// Typical sizes, as priors, of such instances of which no standard deviation is declared.
    fn typical_of(&self, sized: impl Fn(&Instance) -> bool) -> Vec<Prior> {
        let free = |i: &Instance| sized(i) && self.declared_sd(i).is_none();
        let instances = self.instances.iter().zip(&self.first).filter(|(i, _)| free(i));
        let of = |(instance, &first): (&Instance, &usize)| {
            let typical = self.size(instance).into_iter().enumerate();
            let prior = move |(k, sd)| Prior::Parameter { column: first + k, mean: 0.0, sd };
            typical.map(prior).collect::<Vec<_>>()
        };
        instances.flat_map(of).collect()
    }

    /// True where the frames of all links are parameters.
    fn is_complete(&self) -> bool {
        let whole = |i: &Instance| i.term.info().broad && i.term.info().per == Per::Row;
        self.instances.iter().any(whole)
    }

    /// Typical sizes of the parameters of an instance, the offset that turns everything together as a
    /// frame.
    fn size(&self, instance: &Instance) -> Vec<f64> {
        let root = self.mechanism.channels_of(0).first().copied();
        let root = root.filter(|_| self.mechanism.floats()).map(Target::Channel);
        let turns_all = instance.term.role() == Role::Offset && root == Some(instance.target);
        if turns_all && self.is_complete() { vec![ROOT] } else { self.typical(instance) }
    }

    /// Columns of a complete geometry whose priors are typical sizes, with these: nothing else is
    /// known of how far a device is from its drawing. None where the geometry is not complete.
    pub(crate) fn drawn(&self) -> Vec<(usize, f64)> {
        let drawn = |i: &Instance| {
            let geometry = i.term.info().broad || i.term.role() == Role::Offset;
            geometry && self.declared_sd(i).is_none()
        };
        let all = self.instances.iter().zip(&self.first).filter(|(i, _)| drawn(i));
        let columns = all.flat_map(|(i, &first)| (first..).zip(self.size(i)));
        if self.is_complete() { columns.collect() } else { Vec::new() }
    }

    /// Standard deviation of every parameter of terms before there are readings: as it is declared, or
    /// its typical size.
    #[must_use]
    pub(crate) fn sd_beforehand(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.term_parameters];
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let known = self.declared_sd(instance);
            for (sd, typical) in out.iter_mut().skip(first).zip(self.typical(instance)) {
                *sd = known.unwrap_or(typical);
            }
        }
        out
    }

    /// How well the mechanism file says that the parameters of an instance are known.
    fn declared_sd(&self, instance: &Instance) -> Option<f64> {
        let known = |k: usize| self.mechanism.closures.get(k).and_then(|c| c.sd);
        let declared = self.mechanism.model.sd.get(instance.term.info().id).copied();
        declared.or_else(|| match instance.target {
            Target::Closure(k) => known(k),
            // What all share is no better known than the one that is known least.
            Target::EachClosure(_) => {
                let parts = self.mechanism.closures_of(instance.target).map(known);
                parts.reduce(|a, b| Some(a?.max(b?))).flatten()
            }
            Target::Place(place) => {
                let mut touching = self.mechanism.closures_at(place);
                touching.find_map(|k| self.mechanism.closures[k].sd)
            }
            _ => None,
        })
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

    /// Typical size of each parameter of a term at a target, [`targets::typical`], in these readings.
    pub(crate) fn typical_at(&self, term: &dyn Term, target: Target) -> Vec<f64> {
        targets::typical(&self.mechanism, &self.scales, term, target)
    }

    /// Typical size of each parameter of an instance. What a joint gives is typical under the
    /// largest torque about that joint in these readings, and at most what is typical of the
    /// mechanism: readings that hardly load a joint do not say how it gives.
    fn typical(&self, instance: &Instance) -> Vec<f64> {
        let of_mechanism = self.typical_at(instance.term, instance.target);
        let torque = self.largest_torque(instance).filter(|torque| *torque > 0.0);
        match (instance.term.acts(), torque) {
            (Acts::Load(Weight::Links), Some(torque)) => {
                let parameters = instance.term.info().parameters.iter().zip(of_mechanism);
                parameters.map(|(p, typical)| (p.typical / torque).min(typical)).collect()
            }
            _ => of_mechanism,
        }
    }

    fn largest_torque(&self, instance: &Instance) -> Option<f64> {
        let at = self.instances.iter().position(|i| i == instance)?;
        let own = self.loads.iter().zip(&self.torques);
        let own = own.filter(|(load, _)| load.parameter == self.first[at]);
        own.map(|(_, torque)| *torque).reduce(f64::max)
    }
}

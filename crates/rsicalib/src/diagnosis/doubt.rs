//! Effects that may stand for one that the catalogue lacks: several of its terms make it
//! up between them, and leave nothing. Measured: docs/decisions/0004.

use crate::kinematics::elements::Way;
use crate::mechanism::{Mechanism, Target};
use crate::model::Instance;
use crate::numerics::order::Ends;
use crate::terms::term::{Acts, Freedom, Placed, Role};

/// An effect beside others that χ² would not rise by this much without is faint.
const FAINT: f64 = 40.0;

/// An effect that is in doubt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Doubted {
    /// The effect.
    pub instance: Instance,
    /// Why.
    pub doubt: Doubt,
}

/// Why an effect is in doubt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Doubt {
    /// χ² would rise by little without the effect.
    Faint {
        /// By how much.
        rise: f64,
    },
    /// The same kind of fault was found again in one chain.
    AgainInChain(usize),
    /// The same kind of fault was found in so many chains.
    InChains(usize),
    /// Errors of one joint were found to follow two laws: the other one.
    TwoLaws(Instance),
}

impl Doubted {
    /// What the doubt is about; all of a mechanism where several chains are concerned.
    #[must_use]
    pub fn target(&self) -> Target {
        match self.doubt {
            Doubt::Faint { .. } | Doubt::TwoLaws(_) => self.instance.target,
            Doubt::AgainInChain(chain) => Target::Chain(chain),
            Doubt::InChains(_) => Target::All,
        }
    }
}

/// What is doubtful of the effects found, by how much χ² would rise without each.
#[must_use]
pub fn doubt(mechanism: &Mechanism, found: &[Instance], rises: &[f64]) -> Option<Doubted> {
    if found.len() < 2 {
        return None;
    }
    faintest(found, rises).or_else(|| repeated(mechanism, found)).or_else(|| two_laws(found))
}

/// Two laws of one joint that need no more than its pose: one law of the pose that the catalogue
/// lacks may be behind both. What time, temperature or motion do to a joint is apart, and its line
/// is beside any law.
fn two_laws(found: &[Instance]) -> Option<Doubted> {
    let of_pose = |i: &Instance| {
        let needs = i.term.of_pose();
        let law = i.term.placed() != Placed::AtPose && i.term.role() == Role::Other;
        needs && law && matches!(i.target, Target::Channel(_))
    };
    found.iter().enumerate().find_map(|(k, &instance)| {
        let mut before = found[..k].iter();
        let other = before.find(|i| of_pose(i) && i.target == instance.target)?;
        let doubt = Doubt::TwoLaws(*other);
        of_pose(&instance).then_some(Doubted { instance, doubt })
    })
}

/// The last of several terms that make up an effect is faint. But several joints give under one
/// weight, each as much as that weight bends it: none is faint beside the others.
fn faintest(found: &[Instance], rises: &[f64]) -> Option<Doubted> {
    let gives = |i: &Instance| i.term.is_load();
    let together = found.iter().filter(|i| gives(i)).count() > 1;
    let alone = found.iter().zip(rises).filter(|(i, _)| !(together && gives(i)));
    let (instance, rise) = alone.least_by(|one| *one.1)?;
    let doubt = Doubt::Faint { rise: *rise };
    (*rise < FAINT).then_some(Doubted { instance: *instance, doubt })
}

/// True for a length of one link, each of which is made by itself.
fn is_dimension(instance: &Instance) -> bool {
    let slides = |freedoms: &[Freedom]| freedoms.iter().all(|(_, _, way)| *way == Way::Slide);
    matches!(instance.target, Target::Row(..))
        && matches!(instance.term.acts(), Acts::Geometry(freedoms) if slides(freedoms))
}

/// Faults are of many kinds: the same one twice in a chain, or in three chains, has a
/// cause behind it. But joints all give, under the weight of what they carry, and of two links of a
/// chain each has its own length.
fn repeated(mechanism: &Mechanism, found: &[Instance]) -> Option<Doubted> {
    let chain_of = |instance: &Instance| match instance.target {
        _ if instance.term.is_load() => None,
        Target::Channel(channel) => mechanism.chain_of(channel),
        Target::Row(chain, _) | Target::Chain(chain) => Some(chain),
        _ => None,
    };
    found.iter().enumerate().find_map(|(k, instance)| {
        let (id, chain) = (instance.term.info().id, chain_of(instance)?);
        let again: Vec<Option<usize>> =
            found[..k].iter().filter(|i| i.term.info().id == id).map(chain_of).collect();
        let doubted = |doubt| Some(Doubted { instance: *instance, doubt });
        if again.contains(&Some(chain)) && !is_dimension(instance) {
            return doubted(Doubt::AgainInChain(chain));
        }
        if again.iter().flatten().count() > 1 {
            return doubted(Doubt::InChains(again.len() + 1));
        }
        None
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terms::find;

    fn doubts(found: &[(&str, Target, f64)]) -> Option<String> {
        let instance =
            |id: &str, target| Instance { term: find(id).expect("a term"), target, place: 0 };
        let instances: Vec<Instance> = found.iter().map(|(id, t, _)| instance(id, *t)).collect();
        let rises: Vec<f64> = found.iter().map(|f| f.2).collect();
        let mechanism = Mechanism::rsi();
        doubt(&mechanism, &instances, &rises).map(|d| d.target().name(&mechanism))
    }

    #[test]
    fn one_effect_is_not_in_doubt_and_strong_ones_of_two_kinds_are_not() {
        assert_eq!(doubts(&[("slip", Target::Channel(0), 20.0)]), None);
        let two = [("slip", Target::Channel(0), 90.0), ("drift", Target::Channel(1), 80.0)];
        assert_eq!(doubts(&two), None);
    }

    #[test]
    fn what_is_faint_beside_others_is_in_doubt() {
        let two = [("slip", Target::Channel(0), 90.0), ("drift", Target::Channel(4), 30.0)];
        assert_eq!(doubts(&two).as_deref(), Some("a22"));
    }

    #[test]
    fn the_same_twice_in_a_chain_or_in_three_chains_has_a_cause_behind_it() {
        let tilt = |chain, row| ("joint_tilt", Target::Row(chain, row), 90.0);
        assert_eq!(doubts(&[tilt(2, 1), tilt(2, 2)]).as_deref(), Some("arm3"));
        assert_eq!(doubts(&[tilt(0, 1), tilt(2, 2)]), None);
        assert_eq!(doubts(&[tilt(0, 1), tilt(1, 1), tilt(2, 2)]).as_deref(), Some("all"));
        let sag = |chain| ("sag", Target::Chain(chain), 90.0);
        assert_eq!(doubts(&[sag(0), sag(1), sag(2)]), None);
    }

    #[test]
    fn each_link_has_its_own_length() {
        let length = |chain, row| ("link_length", Target::Row(chain, row), 90.0);
        let offset = |chain, row| ("link_offset", Target::Row(chain, row), 90.0);
        assert_eq!(doubts(&[length(0, 1), length(0, 2)]), None);
        assert_eq!(doubts(&[offset(0, 1), length(1, 2), offset(0, 2)]), None);
        // Chains that are all off in the same way are off by their drawing.
        let all = [length(0, 1), length(1, 1), length(2, 1)];
        assert_eq!(doubts(&all).as_deref(), Some("all"));
    }

    #[test]
    fn two_laws_of_one_joint_may_be_one() {
        let of = |id, channel| (id, Target::Channel(channel), 90.0);
        let bent = [of("once_per_turn", 4), of("joint_compliance", 4)];
        assert_eq!(doubts(&bent).as_deref(), Some("a22"));
        assert_eq!(doubts(&[of("once_per_turn", 4), of("joint_compliance", 5)]), None);
        assert_eq!(doubts(&[of("curvature", 4), of("slip", 4)]), None);
        assert_eq!(doubts(&[of("curvature", 4), of("drift", 4)]), None);
        assert_eq!(doubts(&[of("curvature", 4), of("hysteresis", 4)]), None);
        assert_eq!(doubts(&[of("curvature", 4), of("gain", 4)]), None);
    }
}

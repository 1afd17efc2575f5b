//! Effects that may stand for one that the catalogue lacks: several of its terms make it
//! up between them, and leave nothing. Measured: docs/decisions/0004.

use crate::mechanism::{Mechanism, Target};
use crate::model::Instance;
use crate::terms::term::Acts;

/// An effect beside others that χ² would not rise by this much without is faint.
const FAINT: f64 = 40.0;

/// What is doubtful of the effects found, by how much χ² would rise without each: its
/// target, and why.
#[must_use]
pub fn doubt(mechanism: &Mechanism, found: &[Instance], rises: &[f64]) -> Option<(String, String)> {
    if found.len() < 2 {
        return None;
    }
    let (target, what) =
        faintest(mechanism, found, rises).or_else(|| repeated(mechanism, found))?;
    let text = format!(
        "{what}: together they may stand for one effect that the catalogue lacks. \
         Record more poses, and see whether all of them are found again."
    );
    Some((target, text))
}

/// The last of several terms that make up an effect is faint.
fn faintest(mechanism: &Mechanism, found: &[Instance], rises: &[f64]) -> Option<(String, String)> {
    let (instance, rise) = found.iter().zip(rises).min_by(|a, b| a.1.total_cmp(b.1))?;
    let (term, target) = (instance.term.info().id, instance.target.name(mechanism));
    (*rise < FAINT).then(|| {
        let what = format!(
            "{term} of {target} is faint beside the others (χ² would rise by {rise:.0} without it)"
        );
        (target, what)
    })
}

/// Faults are of many kinds: the same one twice in a chain, or in three chains, has a
/// cause behind it. But joints all give, under the weight of what they carry.
fn repeated(mechanism: &Mechanism, found: &[Instance]) -> Option<(String, String)> {
    let chain_of = |instance: &Instance| match instance.target {
        _ if matches!(instance.term.acts(), Acts::Load(_)) => None,
        Target::Channel(channel) => mechanism.chain_of(channel),
        Target::Row(chain, _) | Target::Chain(chain) => Some(chain),
        _ => None,
    };
    found.iter().enumerate().find_map(|(k, instance)| {
        let (id, chain) = (instance.term.info().id, chain_of(instance)?);
        let again: Vec<Option<usize>> =
            found[..k].iter().filter(|i| i.term.info().id == id).map(chain_of).collect();
        let name = &mechanism.chains[chain].name;
        if again.contains(&Some(chain)) {
            return Some((name.clone(), format!("{id} is named more than once in {name}")));
        }
        (again.iter().flatten().count() > 1)
            .then(|| ("all".into(), format!("{id} is named in {} chains", again.len() + 1)))
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
        doubt(&Mechanism::rsi(), &instances, &rises).map(|(target, _)| target)
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
}

//! Parameters beside those of an earlier result.

use crate::apply::earlier::outlasts;
use crate::estimate::significance::CLEAN;
use crate::mechanism::Mechanism;
use crate::model::Spec;
use crate::numerics::distributions::two_sided_limit;
use crate::terms;
use crate::terms::term::{Outlasts, Role};

/// A parameter of a result, with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Its term at its target.
    pub spec: Spec,
    /// Its name.
    pub name: String,
    /// Its value; none where it is not known.
    pub value: Option<f64>,
    /// Standard deviation; none where nothing determines it.
    pub sd: Option<f64>,
}

/// A parameter that two results know.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Its number in the new result.
    pub parameter: usize,
    /// Its value in the earlier result.
    pub before: f64,
    /// Its value now.
    pub after: f64,
    /// Standard deviation of the difference.
    pub sd: f64,
    /// True where it differs by more than both uncertainties allow.
    pub moved: bool,
}

/// Parameters that both `earlier` and `now` know.
///
/// The limit of what has moved is shared by all that both results have: chance makes one of them
/// differ with probability [`CLEAN`]. What is not determined is not compared, nor what belongs
/// to one session. A sensor that slipped in the earlier session has the offset that the slip left it.
#[must_use]
pub fn compared(mechanism: &Mechanism, earlier: &[Estimate], now: &[Estimate]) -> Vec<Compared> {
    let same = |new: &Estimate| {
        let known = earlier.iter().map(|old| (&old.spec, &*old.name));
        Some(parts_of(known, &new.spec, &new.name)).filter(|parts| !parts.is_empty())
    };
    let lasts = |new: &&Estimate| outlasts(mechanism, &new.spec) == Ok(Outlasts::Whole);
    let all = now.iter().enumerate().filter(|(_, new)| lasts(new));
    let pairs: Vec<(usize, Vec<usize>, &Estimate)> =
        all.filter_map(|(k, new)| Some((k, same(new)?, new))).collect();
    let limit = two_sided_limit(CLEAN, pairs.len());
    let compare = |(parameter, parts, new): (usize, Vec<usize>, &Estimate)| {
        let mut was = parts.iter().map(|&k| Some((earlier[k].value?, earlier[k].sd?)));
        let sum =
            |(all, sd): (f64, f64), one: Option<(f64, f64)>| Some((all + one?.0, sd.hypot(one?.1)));
        let (before, spread) = was.try_fold((0.0, 0.0), sum)?;
        let (after, sd) = (new.value?, spread.hypot(new.sd?));
        let moved = (after - before).abs() > limit * sd;
        Some(Compared { parameter, before, after, sd, moved })
    };
    pairs.into_iter().filter_map(compare).collect()
}

/// Which parameters of an earlier result add up to one at the end of their session: the last that is called so, and
/// for an offset what a slip shifted it by. None where the result does not know it.
pub(crate) fn parts_of<'a>(
    earlier: impl DoubleEndedIterator<Item = (&'a Spec, &'a str)> + ExactSizeIterator + Clone,
    spec: &Spec,
    name: &str,
) -> Vec<usize> {
    let mut own = earlier.clone();
    let Some(own) = own.rposition(|old| old == (spec, name)) else { return Vec::new() };
    let shifts = earlier.enumerate().filter(|(_, (old, _))| shifts(old, spec));
    std::iter::once(own).chain(shifts.map(|(k, _)| k)).collect()
}

/// True for what shifts an offset of the same channel.
fn shifts(one: &Spec, offset: &Spec) -> bool {
    let role = |spec: &Spec| terms::find(&spec.term).map_or(Role::Other, |term| term.role());
    let shifted = role(offset) == Role::Offset && role(one) == Role::Shift;
    shifted && one.target == offset.target
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(spec: &str, value: Option<f64>, sd: Option<f64>) -> Estimate {
        Estimate { spec: spec.into(), name: "offset".into(), value, sd }
    }

    #[test]
    fn what_differs_by_more_than_both_uncertainties_has_moved() {
        let old = [
            estimate("offset@a11", Some(1.0), Some(0.03)),
            estimate("offset@a12", Some(1.0), Some(0.03)),
            estimate("offset@a13", Some(1.0), None),
            estimate("offset@a14", None, Some(0.03)),
        ];
        let new = [
            estimate("offset@a12", Some(1.2), Some(0.04)),
            estimate("offset@a11", Some(1.1), Some(0.04)),
            estimate("offset@a13", Some(9.0), Some(0.04)),
            estimate("offset@a14", Some(9.0), Some(0.04)),
            estimate("offset@a15", Some(9.0), Some(0.04)),
        ];
        let all = compared(&Mechanism::rsi(), &old, &new);
        assert_eq!(all.len(), 2);
        let found: Vec<&Compared> = all.iter().filter(|one| one.moved).collect();
        // 0.2 is 4 standard deviations of 0.05, 0.1 is 2; the limit for four is 3.02.
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].parameter, found[0].before, found[0].after), (0, 1.0, 1.2));
        assert!((found[0].sd - 0.05).abs() < 1e-15);
    }

    #[test]
    fn a_slip_that_happened_is_part_of_the_offset() {
        let step = estimate("slip@a11:17", Some(0.5), Some(0.01));
        let old = [estimate("offset@a11", Some(1.0), Some(0.01)), step];
        let sound = [estimate("offset@a11", Some(1.5), Some(0.01))];
        let same = compared(&Mechanism::rsi(), &old, &sound);
        assert_eq!(same.iter().map(|c| (c.before, c.moved)).collect::<Vec<_>>(), [(1.5, false)]);
        assert!(compared(&Mechanism::rsi(), &old, &old[..1])[0].moved);
    }

    #[test]
    fn what_belongs_to_its_session_is_not_compared() {
        let of = |value: f64| {
            ["drift@a11", "slip@a11:3", "unknown_point@ball[at=1]"]
                .map(|spec| estimate(spec, Some(value), Some(0.01)))
        };
        assert_eq!(compared(&Mechanism::rsi(), &of(0.0), &of(1.0)), []);
    }
}

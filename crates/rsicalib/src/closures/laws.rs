//! Laws that every kind of closure must pass.

use crate::closures::ClosureKind;
use crate::closures::kind::{At, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// Where the ends are, the value, and how the first end moves: nothing is special about them.
const APART: [f64; 3] = [0.7, -1.1, 0.4];
const VALUE: f64 = 1.3;
const MOVED: [f64; 3] = [-0.3, 0.5, 0.9];

/// Three directions that are no axes.
const OBLIQUE: [[f64; 3]; 3] = [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]];

/// Step of a central difference. The equations are of second order, or roots of those: what it leaves
/// out is of the order of its square.
const STEP: f64 = 1e-5;

/// Rounding of an equation of the size of 1 over the step, and its square.
const TOLERANCE: f64 = 1e-9;

fn vector(of: [f64; 3]) -> Vec3 {
    of.map(Lanes::splat)
}

/// Ends that have moved by a part of `MOVED`, and a value that is larger by so much.
fn at(moved: f64, larger: f64, measured: bool, along: Option<&[[f64; 3]]>) -> At<'_> {
    let apart = std::array::from_fn(|axis| APART[axis] + moved * MOVED[axis]);
    let (apart, value) = (vector(apart), Lanes::splat(VALUE + larger));
    At { apart, value, shape: None, measured, along }
}

/// Calls a law for each equation of each kind, with a value that is known and one that is measured,
/// along the axes and along others.
fn for_each(mut law: impl FnMut(ClosureKind, usize, bool, Option<&[[f64; 3]]>)) {
    for kind in ClosureKind::ALL {
        for row in 0..kind.equations() {
            for measured in [false, true] {
                law(*kind, row, measured, None);
                law(*kind, row, measured, Some(&OBLIQUE));
            }
        }
    }
}

/// Compares a derivative with a central difference of the misclosure.
fn compare<'a>((kind, row): (ClosureKind, usize), analytic: Lanes, ends: impl Fn(f64) -> At<'a>) {
    let [ahead, behind] = [STEP, -STEP].map(|step| kind.misclosure(&ends(step), row).0[0]);
    let (analytic, difference) = (analytic.0[0], (ahead - behind) / (2.0 * STEP));
    let apart = (analytic - difference).abs();
    assert!(apart < TOLERANCE, "{kind:?}, equation {row}: {analytic} should be {difference}");
}

#[test]
fn derivatives_by_an_end_match_differences() {
    for_each(|kind, row, measured, along| {
        let here = at(0.0, 0.0, measured, along);
        let by_end = kind.by_end(&here, row, &vector(MOVED), 1.0);
        compare((kind, row), by_end, |step| at(step, 0.0, measured, along));
        let behind = kind.by_end(&here, row, &vector(MOVED), -1.0);
        assert_eq!(
            behind.0[0],
            -by_end.0[0],
            "{}: the second end counts the other way round",
            kind.facts().words
        );
    });
}

#[test]
fn derivatives_by_the_value_match_differences() {
    for_each(|kind, row, measured, along| {
        let by_value = kind.by_value(&at(0.0, 0.0, measured, along), row);
        compare((kind, row), by_value, |step| at(0.0, step, measured, along));
        assert_eq!(
            kind.has_value(),
            by_value.0[0] != 0.0,
            "{}: what is given, and the equations",
            kind.facts().words
        );
    });
}

#[test]
fn an_error_of_a_length_counts_as_it_is_said() {
    for kind in ClosureKind::ALL.iter().filter(|kind| kind.has_value()) {
        for (measured, value) in [(false, Some(VALUE)), (true, None)] {
            let by_value = kind.by_value(&at(0.0, 0.0, measured, None), 0).0[0];
            assert_eq!(kind.facts().per_length(value), by_value.abs(), "{kind:?}");
        }
    }
}

#[test]
fn kinds_say_what_they_are() {
    let words: Vec<&str> = ClosureKind::ALL.iter().map(|kind| kind.facts().words).collect();
    for (k, kind) in ClosureKind::ALL.iter().enumerate() {
        assert!(words[k].len() > 10 && !words[..k].contains(&words[k]), "{kind:?}: {}", words[k]);
        assert!((1..=3).contains(&kind.equations()), "{kind:?}");
        assert!(
            !kind.facts().is_vector || kind.equations() == 3,
            "{}: components of a vector",
            kind.facts().words
        );
        // The first end is what a chain carries, or reads: nothing else moves.
        let [first, second] = kind.facts().between;
        assert!(matches!(first, Part::Point | Part::Channel), "{kind:?}");
        assert_eq!(first == Part::Channel, second == Part::Channel, "{kind:?}");
    }
}

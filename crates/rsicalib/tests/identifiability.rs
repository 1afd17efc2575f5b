//! Counts of parameters, against the paper's and against counts by hand.

use rsicalib::design::identifiability::{Counting, Hidden, Identifiable, identifiable};
use rsicalib::mechanism::{Chain, Channel, Closure, ClosureKind, Mechanism, Point, Row, Value};
use rsicalib::{Error, readings};

fn given(terms: &[&str]) -> Counting {
    Counting::of(Some(terms.iter().map(ToString::to_string).collect()))
}

fn counts(found: &Identifiable) -> (usize, usize, usize) {
    (found.parameters, found.minimal, found.known)
}

fn channel(name: &str) -> Channel {
    Channel { name: name.into(), ..Channel::default() }
}

fn closure(kind: ClosureKind, a: &str, b: &str, value: Option<f64>) -> Closure {
    Closure {
        name: format!("{a}-{b}"),
        kind,
        between: [a.into(), b.into()],
        value: value.map(Value::Known),
        ..Closure::default()
    }
}

fn carried(name: &str, chain: &str, at: [f64; 3]) -> Point {
    Point { name: name.into(), chain: Some(chain.into()), at: Some(at), ..Point::default() }
}

fn mechanism(chains: Vec<Chain>, points: Vec<Point>, closures: Vec<Closure>) -> Mechanism {
    let names = chains.iter().flat_map(|c| &c.rows).filter_map(|r| r.channel.clone());
    Mechanism {
        name: "by hand".into(),
        length_unit: "m".into(),
        channels: names.map(|n| channel(&n)).collect(),
        chains,
        points,
        closures,
        ..Mechanism::default()
    }
}

/// An arm of so many joints, no two axes parallel.
fn arm(joints: usize) -> Chain {
    let row = |i: usize| Row {
        channel: Some(format!("q{}", i + 1)),
        a: 0.3 + 0.01 * (i % 7) as f64,
        d: 0.1 * (i % 3) as f64,
        alpha: [1.57, -1.2, 0.7][i % 3],
        ..Row::default()
    };
    Chain { name: "arm".into(), rows: (0..joints).map(row).collect() }
}

/// A bar between a ball at the tip and a ball on the table.
fn ball_bar(joints: usize, tip: [f64; 3], bar: f64) -> Mechanism {
    let ball = Point { name: "ball".into(), at: Some([0.5, 0.2, 0.1]), ..Point::default() };
    mechanism(
        vec![arm(joints)],
        vec![carried("tip", "arm", tip), ball],
        vec![closure(ClosureKind::Distance, "tip", "ball", Some(bar))],
    )
}

/// Two planar arms of two joints each whose tips touch; the second stands a fixed row away.
fn five_bar() -> Mechanism {
    let joint = |name: &str, a: f64| Row { channel: Some(name.into()), a, ..Row::default() };
    let left = Chain { name: "left".into(), rows: vec![joint("l1", 1.0), joint("l2", 1.2)] };
    let base = Row { a: 0.7, ..Row::default() };
    let right =
        Chain { name: "right".into(), rows: vec![base, joint("r1", 1.1), joint("r2", 0.9)] };
    mechanism(
        vec![left, right],
        vec![carried("a", "left", [0.0; 3]), carried("b", "right", [0.0; 3])],
        vec![closure(ClosureKind::Touch, "a", "b", None)],
    )
}

#[test]
fn of_the_57_parameters_of_the_hand_controller_50_can_be_known() {
    // The paper: nine joints of four parameters, nine points, nine gains, three distances; the
    // loops hide the place of the whole (6) and its size (1).
    let found = identifiable(&Mechanism::rsi(), Counting::Complete, 0).expect("loops that close");
    assert_eq!((found.minimal, found.known), (57, 50));
    assert_eq!(found.hidden, [Hidden::Place { motions: 6 }, Hidden::Size]);
    assert_eq!(
        found.hidden.iter().map(ToString::to_string).collect::<Vec<_>>(),
        [
            "where the whole stands in its base (6)",
            "its size: declare one length that is known (1)"
        ]
    );
}

#[test]
fn the_model_of_the_paper_can_be_known_whole() {
    let found = identifiable(&Mechanism::rsi(), Counting::Declared, 0).expect("loops that close");
    assert_eq!(counts(&found), (18, 18, 18));
    assert_eq!((found.hidden.len(), found.terms.len()), (0, 2));
    assert!(found.terms.iter().all(|t| (t.parameters, t.alone, t.beside) == (9, 9, 9)));
}

#[test]
fn a_ball_bar_hides_the_turn_about_the_ball_and_the_size() {
    // Four parameters of each joint, the point, a gain for each joint, the bar. Three turns
    // about the ball on the table and the size of the whole are not seen.
    for joints in [6, 9] {
        let bar = ball_bar(joints, [0.1, 0.05, 0.2], 0.7);
        let found = identifiable(&bar, Counting::Complete, 0).expect("loops that close");
        let minimal = 5 * joints + 3 + 1;
        assert_eq!((found.minimal, found.known), (minimal, minimal - 4));
        assert_eq!(found.hidden, [Hidden::Place { motions: 3 }, Hidden::Size]);
        let gain = found.terms.iter().find(|t| t.term == "gain").expect("a term of the model");
        assert_eq!((gain.parameters, gain.alone, gain.beside), (joints, joints, joints));
    }
}

#[test]
fn a_joint_that_turns_about_the_ball_is_not_seen() {
    // The last axis passes along (0, sin α, cos α) of the last frame.
    let alpha: f64 = 0.7;
    let mut bar = ball_bar(6, [-0.35, 0.2 * alpha.sin(), 0.2 * alpha.cos()], 0.7);
    bar.chains[0].rows[5].a = 0.35;
    bar.chains[0].rows[5].d = 0.0;
    let found = identifiable(&bar, given(&["offset"]), 0).expect("loops that close");
    assert_eq!((found.parameters, found.known), (6, 5));
}

#[test]
fn two_planar_arms_whose_tips_touch_hide_their_size_alone() {
    // Offsets and gains of four joints: all seen, for the bases are drawn.
    let found = identifiable(&five_bar(), given(&["offset", "gain"]), 0).expect("closes");
    assert_eq!(counts(&found), (8, 8, 8));
    // With the lengths of four links and of the base, the whole may grow; the whole cannot turn,
    // because nothing turns the base of the second arm about the first.
    let found = identifiable(&five_bar(), given(&["offset", "link_length"]), 0).expect("closes");
    assert_eq!(counts(&found), (9, 9, 8));
    assert_eq!(found.hidden, [Hidden::Size]);
}

#[test]
fn unknown_sockets_hide_a_turn_about_the_first_axis() {
    let socket =
        Point { name: "socket".into(), unknown: Some(vec!["at".into()]), ..Point::default() };
    let touching = mechanism(
        vec![arm(6)],
        vec![carried("tip", "arm", [0.1, 0.05, 0.2]), socket],
        vec![closure(ClosureKind::Touch, "tip", "socket", None)],
    );
    let found = identifiable(&touching, given(&["offset"]), 0).expect("loops that close");
    assert_eq!(counts(&found), (6, 6, 5));
    assert_eq!(found.hidden, [Hidden::Place { motions: 1 }]);
}

#[test]
fn the_counts_do_not_depend_on_the_seed() {
    let bar = ball_bar(6, [0.1, 0.05, 0.2], 0.7);
    let found = |seed| {
        let found = identifiable(&bar, Counting::Complete, seed).expect("loops that close");
        (counts(&found), found.terms, found.hidden)
    };
    assert!((1..6).all(|seed| found(seed) == found(0)));
}

#[test]
fn loops_that_cannot_be_closed_are_refused() {
    let far = ball_bar(6, [0.1, 0.05, 0.2], 60.0);
    let error = identifiable(&far, Counting::Declared, 0).expect_err("out of reach");
    assert!(error.to_string().contains("configurations that close"), "{error}");
}

#[test]
fn what_cannot_be_counted_is_an_error() {
    let bar = ball_bar(6, [0.1, 0.05, 0.2], 0.7);
    let refused = |m: &Mechanism, c| identifiable(m, c, 0).expect_err("refused");
    assert!(matches!(refused(&bar, given(&["no_such"])), Error::Unknown { .. }));
    let bare = mechanism(Vec::new(), Vec::new(), Vec::new());
    refused(&bare, Counting::Complete);
    let mut pointless = bar.clone();
    pointless.points.clear();
    pointless.closures.clear();
    refused(&pointless, Counting::Complete);
    let mut endless = bar.clone();
    endless.channels[0].limits = Some([f64::NEG_INFINITY, f64::NAN]);
    refused(&endless, Counting::Declared);
    // No parameters: nothing to know.
    let found = identifiable(&bar, given(&[]), 0).expect("a model without terms");
    assert_eq!((counts(&found), found.terms.len()), ((0, 0, 0), 0));
    let table = readings::Table::default();
    assert!(matches!(rsicalib::Readings::new(&bare, table), Err(Error::Mechanism { .. })));
}

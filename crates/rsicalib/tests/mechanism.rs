//! Mechanisms as data: what is refused, and the text they are written as.

use rsicalib::Error;
use rsicalib::mechanism::{Chain, ClosureKind, Mechanism, Motion, Point, Rest, Row, Target, Value};

/// The refusal of the hand controller with one thing changed.
fn refusal(change: impl FnOnce(&mut Mechanism)) -> [String; 3] {
    let mut mechanism = Mechanism::rsi();
    change(&mut mechanism);
    match mechanism.validate() {
        Err(Error::Mechanism { place, found, expected }) => [place, found, expected],
        other => panic!("should be refused with a place: {other:?}"),
    }
}

const AGAIN: &str = "each channel at one joint, or a ratio here";
const CHANNELS: &str = "a11, a12, a13, a21, a22, a23, a31, a32, a33";

#[test]
fn the_hand_controller_is_valid() {
    assert_eq!(Mechanism::rsi().validate(), Ok(()));
    let named = |n: &str| Mechanism::rsi().with_closures(&[n.to_string()]);
    assert_eq!(named("wrist2-wrist3").expect("a closure").validate(), Ok(()));
    assert!(matches!(named("wrist2"), Err(Error::Unknown { kind: "closure", .. })));
}

#[test]
fn names_are_there_and_each_is_one_things_own() {
    let own = |place: &str| [place, "the name again, or none", "one of its own"].map(String::from);
    assert_eq!(refusal(|m| m.channels[4].name = "a11".into()), own("channel \"a11\""));
    assert_eq!(refusal(|m| m.chains[1].name = "arm1".into()), own("chain \"arm1\""));
    assert_eq!(refusal(|m| m.points[1].name = "wrist1".into()), own("point \"wrist1\""));
    assert_eq!(refusal(|m| m.points[0].name = String::new()), own("point \"\""));
    let name = "wrist1-wrist2";
    assert_eq!(refusal(|m| m.closures[1].name = name.into()), own("closure \"wrist1-wrist2\""));
    let none = |place: &str| [place, "none", "at least one"].map(String::from);
    assert_eq!(refusal(|m| m.channels.clear()), none("channel"));
    assert_eq!(refusal(|m| m.closures.clear()), none("closure"));
}

#[test]
fn a_channel_has_numbers_that_can_be_used() {
    let at = |found: &str, expected: &str| ["channel \"a12\"", found, expected].map(String::from);
    assert_eq!(refusal(|m| m.channels[1].gain = f64::NAN), at("NaN", "a finite number"));
    assert_eq!(refusal(|m| m.channels[1].offset = f64::INFINITY), at("inf", "a finite number"));
    let large = "a number of at most 1e60 in size";
    assert_eq!(refusal(|m| m.channels[1].offset = -1e308), at("-1e308", large));
    assert_eq!(refusal(|m| m.channels[1].gain = 0.0), at("gain 0.0", "a gain other than zero"));
    let order = "the lower end before the upper";
    assert_eq!(refusal(|m| m.channels[1].range = Some([9.0, 1.0])), at("[9, 1]", order));
    assert_eq!(refusal(|m| m.channels[1].limits = Some([2.0, 2.0])), at("[2, 2]", order));
    let positive = "a positive number";
    assert_eq!(refusal(|m| m.channels[1].noise = Some(0.0)), at("noise 0", positive));
}

#[test]
fn a_channel_without_range_ends_at_its_limits() {
    let mut channel = Mechanism::rsi().channels[0].clone();
    (channel.gain, channel.offset, channel.limits) = (-0.5, 1.0, Some([0.0, 3.0]));
    assert_eq!((channel.middle(), channel.half_range()), (2047.5, 2047.5));
    channel.range = None;
    // 1 - r/2 is 0 at 2 and 3 at -4.
    assert_eq!(channel.ends(), Some([-4.0, 2.0]));
    assert_eq!((channel.middle(), channel.half_range()), (-1.0, 3.0));
    channel.limits = None;
    assert_eq!((channel.middle(), channel.half_range()), (0.0, 2.0 * std::f64::consts::PI));
}

#[test]
fn each_channel_senses_one_joint() {
    let at = |row: usize| format!("chain \"arm2\", row {row}");
    assert_eq!(
        refusal(|m| m.chains[1].rows[1].channel = Some("b21".into())),
        [at(2), "channel \"b21\"".into(), CHANNELS.into()]
    );
    assert_eq!(
        refusal(|m| m.chains[1].rows[2].channel = Some("a21".into())),
        [at(3), "channel \"a21\" again".into(), AGAIN.into()]
    );
    assert_eq!(
        refusal(|m| m.chains[1].rows[3].channel = None),
        [
            "channel \"a23\"",
            "no joint that it senses",
            "a row of a chain that names it, or a closure"
        ]
    );
}

#[test]
fn a_channel_drives_other_joints_of_its_chain_by_ratios() {
    let driven = |chain: usize, row: Row| {
        move |m: &mut Mechanism| {
            m.chains[chain].rows.push(Row { channel: Some("a21".into()), ..row })
        }
    };
    let back = || Row { ratio: Some(-1.0), ..Row::default() };
    let mut bars = Mechanism::rsi();
    driven(1, back())(&mut bars);
    assert_eq!(bars.validate(), Ok(()));
    assert_eq!(bars.channels_of(1), [3, 4, 5]);
    assert_eq!(bars.chain_of(3), Some(1));
    // Chains are alike where their joints are driven alike.
    let alike = |m: &Mechanism| m.parts(Target::EachChain(0)).len();
    assert_eq!([alike(&Mechanism::rsi()), alike(&bars)], [3, 2]);

    let at = |chain: usize, row: usize| format!("chain \"arm{chain}\", row {row}");
    let again = || "channel \"a21\" again".to_string();
    assert_eq!(refusal(driven(1, Row::default())), [at(2, 5), again(), AGAIN.into()]);
    for row in [back(), Row::default()] {
        let [place, found, expected] = refusal(driven(2, row));
        assert_eq!([place, found], [at(3, 5), again()]);
        assert!(expected.starts_with("all rows of a channel in one chain"), "{expected}");
    }
    let slides = Row { joint: Motion::Prismatic, ..back() };
    let expected = "joints of one channel that all turn, or all slide".to_string();
    assert_eq!(refusal(driven(1, slides)), [at(2, 5), again(), expected]);
    for (ratio, found) in [(0.0, "ratio 0.0"), (f64::NAN, "ratio NaN"), (1e300, "ratio 1e300")] {
        let of = Row { ratio: Some(ratio), ..Row::default() };
        let expected = "a number other than 0".to_string();
        assert_eq!(refusal(driven(1, of)), [at(2, 5), found.into(), expected]);
    }
    let expected = "a channel of which it is the ratio".to_string();
    assert_eq!(
        refusal(|m| m.chains[0].rows[0].ratio = Some(2.0)),
        [at(1, 1), "ratio 2.0".into(), expected]
    );
}

#[test]
fn a_row_has_numbers_that_can_be_used() {
    let at =
        |found: &str, expected: &str| ["chain \"arm1\", row 2", found, expected].map(String::from);
    type Change = fn(&mut Row);
    let changes: [Change; 7] = [
        |r| r.theta = f64::NAN,
        |r| r.d = f64::NAN,
        |r| r.a = f64::NAN,
        |r| r.alpha = f64::NAN,
        |r| r.xyz[2] = f64::NAN,
        |r| r.rpy[1] = f64::NAN,
        |r| r.com[0] = f64::NAN,
    ];
    for change in changes {
        assert_eq!(refusal(|m| change(&mut m.chains[0].rows[1])), at("NaN", "a finite number"));
    }
    let mass = |mass: f64| refusal(|m| m.chains[0].rows[1].mass = Some(mass));
    assert_eq!(mass(-1.0), at("mass -1", "a number of 0 or more"));
    assert_eq!(mass(f64::NAN), at("mass NaN", "a number of 0 or more"));
}

#[test]
fn a_point_is_known_or_unknown_but_not_both() {
    let place = "point \"wrist2\"".to_string();
    let either = [
        place.clone(),
        "neither a place nor an unknown, or both".into(),
        "`at = [x, y, z]`, or `unknown = [columns]` without a chain, or `columns`".into(),
    ];
    assert_eq!(refusal(|m| m.points[1].at = None), either);
    assert_eq!(refusal(|m| m.points[1].unknown = Some(vec!["at".into()])), either);
    let on_chain = |m: &mut Mechanism| {
        m.points[1] = Point { at: None, unknown: Some(vec!["at".into()]), ..m.points[1].clone() };
    };
    assert_eq!(refusal(on_chain), either);
    assert_eq!(
        refusal(|m| m.points[1].at = Some([0.0, f64::NAN, 0.0])),
        [place.clone(), "NaN".into(), "a finite number".into()]
    );
    assert_eq!(
        refusal(|m| m.points[1].chain = Some("arm7".into())),
        [place, "chain \"arm7\"".into(), "arm1, arm2, arm3".into()]
    );
}

#[test]
fn a_closure_joins_two_points_that_are_there() {
    let at = |found: &str, expected: &str| {
        ["closure \"wrist2-wrist3\"", found, expected].map(String::from)
    };
    let points = "wrist1, wrist2, wrist3";
    assert_eq!(
        refusal(|m| m.closures[1].between[1] = "elbow".into()),
        at("point \"elbow\"", points)
    );
    assert_eq!(
        refusal(|m| m.closures[1].between[0] = "elbow".into()),
        at("point \"elbow\"", points)
    );
    assert_eq!(
        refusal(|m| m.closures[1].between[1] = "wrist2".into()),
        at("\"wrist2\" twice", "two of them")
    );
    let value = "a positive `value` for a distance, or the `channel` that reads it; neither for \
                 any other kind, but for a plane a column of heights";
    assert_eq!(refusal(|m| m.closures[1].value = None), at("no value", value));
    for d in [0.0, -1.0, f64::NAN] {
        let found = format!("a value of {d}");
        assert_eq!(refusal(|m| m.closures[1].value = Some(Value::Known(d))), at(&found, value));
    }
    let [_, found, _] = refusal(|m| m.closures[1].kind = ClosureKind::Touch);
    assert!(found.starts_with("a value of"), "{found}");
    assert_eq!(refusal(|m| m.closures[1].noise = Some(-0.1)), at("-0.1", "a length of 0 or more"));
    assert_eq!(refusal(|m| m.closures[1].sd = Some(f64::NAN)), at("NaN", "a length of 0 or more"));
}

#[test]
fn what_is_optional_is_refused_where_it_is_wrong() {
    assert_eq!(refusal(|m| m.gravity = Some([0.0; 3])), ["gravity", "[0, 0, 0]", "a direction"]);
    assert_eq!(
        refusal(|m| m.gravity = Some([0.0, f64::NAN, 0.0])),
        ["gravity", "NaN", "a finite number"]
    );
    assert_eq!(
        refusal(|m| m.platform.extend([("hat".into(), [0.0; 3])])),
        ["platform", "point \"hat\"", "wrist1, wrist2, wrist3"]
    );
    assert_eq!(
        refusal(|m| m.platform.extend([("wrist1".into(), [f64::NAN; 3])])),
        ["platform, wrist1", "NaN", "a finite number"]
    );
    let rest = |pose, sd| refusal(|m| m.rest = Some(Rest { pose, sd }));
    assert_eq!(rest([f64::NAN; 6], None), ["rest, pose", "NaN", "a finite number"]);
    assert_eq!(rest([0.0; 6], Some(0.0)), ["rest, sd", "0", "a positive number"]);
    assert_eq!(
        refusal(|m| m.model.sd.extend([("gain".into(), -1.0)])),
        ["gain, sd", "-1", "a positive number"]
    );
}

#[cfg(feature = "toml")]
mod text {
    use super::*;

    /// The example of the documentation, with the channels and points it leaves out.
    const EXAMPLE: &str = r#"
name = "RSI 6-DOF hand controller"
length_unit = "in"
gravity = [0, 0, -1]

[[channel]]
name = "a11"
unit = "count"
range = [0, 4095]
gain = -1.448760e-3
offset = 3.387
limits = [-1.571, 1.571]

[[channel]]
name = "a12"
unit = "rad"
gain = 1.0
offset = 0.0
noise = 1e-5

[[channel]]
name = "a13"
unit = "count"
range = [0, 4095]
gain = -1.448760e-3
offset = 2.967

[[chain]]
name = "arm1"
dh = [
    {theta = 3.14159, a = -4.5, alpha = 1.5708},
    {channel = "a11", a = 3.2},
    {channel = "a12", alpha = 1.5708},
    {channel = "a13"},
]

[[point]]
name = "wrist1"
chain = "arm1"
at = [3.971, 0, 0]

[[point]]
name = "post"
at = [0, 0, -2.666]

[[point]]
name = "socket"
unknown = ["group", "at"]

[[closure]]
name = "wrist1-post"
kind = "distance"
between = ["wrist1", "post"]
value = 2.598076

[[closure]]
name = "wrist1-bar"
kind = "distance"
between = ["post", "wrist1"]
value = "bar_in"

[[closure]]
name = "wrist1-socket"
kind = "touch"
between = ["wrist1", "socket"]
noise = 1e-4

[platform]
wrist1 = [1.5, 0, 0]

[rest]
pose = [0, 0, -2.666, 0, 0, 0]
sd = 0.01

[model]
terms = ["offset", "gain"]
"#;

    #[test]
    fn the_documented_example_is_read() {
        let m = Mechanism::from_toml(EXAMPLE).expect("the example");
        assert_eq!(m.gravity, Some([0.0, 0.0, -1.0]));
        assert_eq!(m.channels[0].range, Some([0.0, 4095.0]));
        assert_eq!((m.channels[1].noise, m.channels[1].range), (Some(1e-5), None));
        assert_eq!(m.chains[0].rows[0].a, -4.5);
        assert_eq!(m.chains[0].rows[1].channel.as_deref(), Some("a11"));
        assert_eq!(m.points[0].at, Some([3.971, 0.0, 0.0]));
        assert_eq!(m.key_columns(), ["group", "at"]);
        assert_eq!(m.value_columns(), ["bar_in"]);
        assert_eq!(m.closures[0].value, Some(Value::Known(2.598_076)));
        assert_eq!(m.equations(), 5);
        assert_eq!(m.rest.as_ref().and_then(|r| r.sd), Some(0.01));
        assert_eq!(m.model.terms, ["offset", "gain"]);
        assert_eq!(Mechanism::from_toml(&m.to_toml()), Ok(m));
    }

    #[test]
    fn degrees_are_kept_in_radians_and_written_as_they_were() {
        let text = EXAMPLE.replacen("unit = \"rad\"", "unit = \"deg\"", 1);
        let text = text.replacen("offset = 0.0\n", "offset = 12.3\nlimits = [-170.0, 33.3]\n", 1);
        let kept = Mechanism::from_toml(&text).expect("a mechanism");
        let channel = kept.channels.iter().find(|c| c.unit == "deg").expect("one in degrees");
        assert_eq!(channel.offset, 12.3_f64.to_radians());
        assert_eq!(channel.limits, Some([-170.0, 33.3].map(f64::to_radians)));
        let written = kept.to_toml();
        assert!(written.contains("offset = 12.3\n") && written.contains("[-170.0, 33.3]"));
        assert_eq!(Mechanism::from_toml(&written), Ok(kept));
    }

    #[test]
    fn the_hand_controller_survives_being_written() {
        let text = Mechanism::rsi().to_toml();
        assert_eq!(Mechanism::from_toml(&text), Ok(Mechanism::rsi()), "{text}");
    }

    #[test]
    fn text_that_is_no_mechanism_is_refused_with_its_line() {
        let message = |from: &str, to: &str| {
            assert!(EXAMPLE.contains(from));
            Mechanism::from_toml(&EXAMPLE.replacen(from, to, 1)).expect_err("refused").to_string()
        };
        let text = message("gain = 1.0\n", "gain = \"one\"\n");
        assert!(text.contains("line 17") && text.contains("gain"), "{text}");
        let text = message("gain = 1.0\n", "gian = 1.0\n");
        assert!(text.contains("line 17") && text.contains("gian"), "{text}");
        let text = message("offset = 0.0\n", "");
        assert!(text.contains("missing field `offset`"), "{text}");
        let text = message("kind = \"touch\"", "kind = \"glue\"");
        assert!(text.contains("glue") && text.contains("distance"), "{text}");
        let text = message("between = [\"wrist1\", \"post\"]", "between = [\"wrist1\", \"pots\"]");
        assert_eq!(
            text,
            "mechanism, closure \"wrist1-post\": found point \"pots\" (did you mean \"post\"?); expected wrist1, post, socket"
        );
    }
}

#[test]
fn a_link_of_a_urdf_has_axes_along_and_across_it() {
    use nalgebra::Vector3;
    let row = |xyz: [f64; 3], rpy: [f64; 3]| Row { xyz, rpy, ..Row::default() };
    let axes = |row: &Row| [Vector3::x(), Vector3::z()].map(|axis| row.link() * axis);
    let close = |a: Vector3<f64>, b: Vector3<f64>| (a - b).norm() < 1e-12;
    let [along, across] = axes(&row([0.3, 0.0, 0.4], [0.0; 3]));
    assert!(close(along, Vector3::new(0.6, 0.0, 0.8)));
    assert!(close(across, Vector3::new(-0.8, 0.0, 0.6)));
    // Along its own joint axis, it moves across along the next: y of this frame.
    let [along, across] = axes(&row([0.0, 0.0, 0.4], [-std::f64::consts::FRAC_PI_2, 0.0, 0.0]));
    assert!(close(along, Vector3::z()) && close(across, Vector3::y()));
    let [along, across] = axes(&Row { a: 0.2, d: 0.1, ..Row::default() });
    assert!(close(along, Vector3::x()) && close(across, Vector3::z()));
}

#[test]
fn a_link_of_a_urdf_has_a_side_where_two_axes_meet() {
    use nalgebra::Vector3;
    use std::f64::consts::FRAC_PI_2;
    let joint = |row: Row| Row { channel: Some("q".into()), ..row };
    let side = |row: Row| {
        let rows = vec![joint(row), joint(Row::default())];
        Chain { name: "arm".into(), rows }.side(0).map(|axes| axes * Vector3::x())
    };
    let urdf = |xyz: [f64; 3], rpy: [f64; 3]| side(Row { xyz, rpy, ..Row::default() });
    let along = |way: Option<Vector3<f64>>, axis: Vector3<f64>| {
        way.is_some_and(|way| way.cross(&axis).norm() < 1e-12)
    };
    let quarter = [0.0, FRAC_PI_2, 0.0];
    // Along its own axis, along the next one, and without a length.
    for xyz in [[0.0, 0.0, 0.4], [0.4, 0.0, 0.0], [0.0; 3]] {
        assert!(along(urdf(xyz, quarter), Vector3::y()), "{xyz:?}");
    }
    // One line of two axes may come apart both ways.
    assert!(along(urdf([0.0, 0.0, 0.4], [0.0, 0.0, 0.1]), Vector3::y()));
    // The length or the offset does it already.
    assert_eq!(urdf([0.0, -0.6, 0.0], [0.0; 3]), None);
    assert_eq!(urdf([0.0, 0.4, 0.0], quarter), None);
    assert_eq!(urdf([0.0, 0.3, 0.1], [0.0; 3]), None);
    for a in [0.0, 0.2] {
        assert_eq!(side(Row { a, d: 0.1, ..Row::default() }), None);
        assert_eq!(side(Row { a, d: 0.1, alpha: 0.7, ..Row::default() }), None);
    }
    // No joint follows.
    let row = joint(Row { xyz: [0.0, 0.0, 0.4], rpy: quarter, ..Row::default() });
    assert!(Chain { name: "arm".into(), rows: vec![row] }.side(0).is_none());
}

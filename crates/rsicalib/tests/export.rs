//! A result as a mechanism, against the model that has the result's parameters.

use crate::devices::{How, Rng, hand_controller, random};
use rsicalib::Error;
use rsicalib::apply::earlier::{Applied, Reference, Reported, points};
use rsicalib::apply::export::{Exported, Note, exported, with_sensors};
use rsicalib::mechanism::{Mechanism, Row, Target, Value};
use rsicalib::model::Spec;
use rsicalib::readings::Table;
use rsicalib::terms::targets::{targets, typical};
use rsicalib::terms::term::{Class, Needs, Role, Term};
use rsicalib::terms::{ALL, find};

/// Chains of every kind: drawn as they come, with fixed first rows, with URDF rows.
fn mechanisms() -> Vec<(Mechanism, Table)> {
    let mut all = Vec::new();
    for mut device in [hand_controller(How::Held, 1), random(3, How::Held, 2)] {
        device.table.keys.clear();
        all.push((device.mechanism.clone(), device.table.clone()));
        for (k, chain) in device.mechanism.chains.iter_mut().enumerate() {
            let placed = Row {
                theta: 0.3,
                a: 0.5,
                alpha: -0.7,
                // Pitch at a right angle, where yaw and roll turn about one axis.
                rpy: [0.2, std::f64::consts::FRAC_PI_2, 0.4],
                xyz: [0.1, -0.2, 0.3],
                ..Row::default()
            };
            chain.rows.insert(k.min(chain.rows.len()), placed.clone());
            chain.rows.insert(0, Row { mass: Some(1.0), com: [0.1, 0.0, 0.2], ..placed });
        }
        all.push((device.mechanism, device.table));
    }
    all
}

/// The longest link: what a length is compared with.
fn longest(mechanism: &Mechanism) -> f64 {
    let rows = mechanism.chains.iter().flat_map(|c| &c.rows);
    let lengths = rows.flat_map(|r| [r.a, r.d].into_iter().chain(r.xyz));
    lengths.fold(0.0, |longest: f64, l| longest.max(l.abs()))
}

/// A result with every parameter of these terms, some sizes large.
fn result(mechanism: &Mechanism, terms: &[&'static dyn Term]) -> Applied {
    let mut rng = Rng::new(9);
    let mut parameters = Vec::new();
    for term in terms {
        for target in targets(*term, mechanism) {
            let sizes = typical(mechanism, &[], *term, target);
            for (p, size) in term.info().parameters.iter().zip(sizes) {
                let mut value = 10.0 * size * rng.normal();
                if let Target::Channel(c) = target {
                    let channel = &mechanism.channels[c];
                    match term.role() {
                        Role::Offset => value = channel.offset + 0.1 * rng.normal(),
                        Role::Gain => value = channel.gain * (1.0 + 0.1 * rng.normal()),
                        _ => {}
                    }
                }
                let spec = Spec {
                    term: term.info().id.into(),
                    target: Some(target.name(mechanism)),
                    place: None,
                };
                parameters.push(Reported { spec, name: p.name.into(), value });
            }
        }
    }
    let n = mechanism.channels.len();
    let reference = Reference {
        centre: mechanism.channels.iter().map(|c| c.middle() + 0.3 * c.half_range()).collect(),
        span: mechanism.channels.iter().map(|c| c.range.unwrap_or([-1.0, 1.0])).collect(),
        temperature: None,
    };
    Applied { parameters, reference, sigma: vec![1.0; n], ..Applied::default() }
}

/// The same readings under the exported mechanism and under the result: how far apart points are.
fn apart(mechanism: &Mechanism, table: &Table, applied: &Applied) -> (f64, f64) {
    let Exported { mechanism: out, .. } = exported(mechanism, applied).expect("known parameters");
    let nothing = Applied { parameters: Vec::new(), ..applied.clone() };
    let wanted = points(mechanism, applied, table.clone()).expect("points");
    let found = points(&out, &nothing, table.clone()).expect("points");
    let drawn = points(mechanism, &nothing, table.clone()).expect("points");
    let far = |a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]| {
        let pairs = a.iter().flatten().flatten().zip(b.iter().flatten().flatten());
        pairs.fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()))
    };
    (far(&found, &wanted), far(&wanted, &drawn))
}

fn same_points(terms: &[&'static dyn Term]) {
    let names: Vec<_> = terms.iter().map(|t| t.info().id).collect();
    for (mechanism, table) in mechanisms() {
        let applied = result(&mechanism, terms);
        if applied.parameters.is_empty() {
            continue; // no row moves by a ratio
        }
        let longest = longest(&mechanism);
        let (error, effect) = apart(&mechanism, &table, &applied);
        let name = &mechanism.name;
        assert!(error < 1e-12 * longest, "{names:?} on {name}: {error:e}");
        assert!(effect > 1e-4 * longest, "{names:?} on {name} does nothing: {effect:e}");
    }
}

/// Terms of geometry that do the same at every temperature.
fn geometry() -> Vec<&'static dyn Term> {
    let geometry = |t: &&dyn Term| t.info().class == Class::Geometry;
    let always = |t: &&dyn Term| t.info().needs == Needs::Nothing;
    ALL.iter().copied().filter(geometry).filter(always).collect()
}

#[test]
fn every_geometry_term_gives_the_same_points() {
    assert!(geometry().len() >= 8);
    for term in geometry() {
        same_points(&[term]);
    }
}

#[test]
fn all_of_them_together_do_in_any_order() {
    let line = [find("offset").expect("a term"), find("gain").expect("a term")];
    let all = [geometry(), line.to_vec()].concat();
    same_points(&all);
    same_points(&all.into_iter().rev().collect::<Vec<_>>());
}

#[test]
fn an_effect_that_channels_share_is_said_to_be_left_out_once() {
    let mechanism = Mechanism::rsi();
    let mut applied = result(&mechanism, &[]);
    let shared = "curvature@each.1";
    applied.parameters = vec![Reported { spec: shared.into(), name: "c2".into(), value: 1e-3 }];
    let found = exported(&mechanism, &applied).expect("known parameters");
    assert_eq!(found.notes, [Note::NoPlace(shared.into())]);
}

#[test]
fn what_all_distances_of_one_make_share_is_added_to_each() {
    let mechanism = Mechanism::rsi();
    let mut applied = result(&mechanism, &[]);
    let of = |spec: &str, value: f64| Reported { spec: spec.into(), name: "d".into(), value };
    applied.parameters = vec![of("distance@each", 0.5), of("distance@wrist2-wrist3", 0.1)];
    let found = exported(&mechanism, &applied).expect("known parameters");
    assert_eq!(found.notes, []);
    let value = |m: &Mechanism, k: usize| m.closures[k].value.as_ref().and_then(Value::known);
    for (k, longer) in [0.5, 0.6, 0.5].into_iter().enumerate() {
        let [was, is] = [&mechanism, &found.mechanism].map(|m| value(m, k).expect("a length"));
        assert!((is - was - longer).abs() < 1e-12, "{k}: {was} became {is}");
    }
}

#[test]
fn what_grows_with_the_temperature_is_left_out_and_said() {
    let mechanism = Mechanism::rsi();
    let mut applied = result(&mechanism, &[]);
    let grown = ["link_growth@arm1/2", "distance_growth@wrist1-wrist2"];
    applied.parameters =
        grown.map(|spec| Reported { spec: spec.into(), name: "rate".into(), value: 1e-3 }).to_vec();
    let found = exported(&mechanism, &applied).expect("known parameters");
    assert_eq!(found.notes, grown.map(|spec| Note::NoPlace(spec.into())));
    assert_eq!(found.mechanism.chains, mechanism.chains);
    assert_eq!(found.mechanism.closures, mechanism.closures);
}

#[test]
fn lines_of_channels_are_put_in() {
    same_points(&[find("offset").expect("a term")]);
    same_points(&[find("gain").expect("a term")]);
}

#[test]
fn a_slip_is_part_of_the_offset_and_a_drift_is_left_out() {
    let mechanism = Mechanism::rsi();
    let mut applied = result(&mechanism, &[]);
    let reported =
        |spec: &str, name: &str, value| Reported { spec: spec.into(), name: name.into(), value };
    applied.parameters = vec![
        reported("slip@a22:17", "step", 0.25),
        reported("slip@a22:21", "step", 0.5),
        reported("drift@a11", "rate", 0.1),
        reported("curvature@a12", "c2", 0.1),
        reported("distance@wrist1-wrist2", "d", 0.125),
        reported("unknown_point@ball[at=1]", "x", 0.1),
    ];
    let found = exported(&mechanism, &applied).expect("known parameters");
    let line = |m: &Mechanism| m.channels[4].offset - mechanism.channels[4].offset;
    assert_eq!(line(&found.mechanism), 0.75);
    assert_eq!(line(&with_sensors(&mechanism, &applied).expect("known parameters")), 0.75);
    assert_eq!(
        found.notes,
        [Note::OfItsSession("drift@a11".into()), Note::NoPlace("curvature@a12".into())]
    );
    let value = |m: &Mechanism| match m.closures[0].value {
        Some(Value::Known(value)) => value,
        _ => f64::NAN,
    };
    assert_eq!(value(&found.mechanism) - value(&mechanism), 0.125);
}

#[test]
fn a_new_first_row_counts_in_the_terms_of_the_mechanism() {
    let sensed = |m: &Mechanism| m.chains[0].rows[0].channel.is_some();
    let (mut mechanism, _) = mechanisms().swap_remove(2);
    while !sensed(&mechanism) {
        mechanism.chains[0].rows.remove(0);
    }
    let chain = mechanism.chains[0].name.clone();
    mechanism.model.terms = vec!["offset".into(), format!("link_length@{chain}/2")];
    let mut applied = result(&mechanism, &[]);
    applied.parameters = vec![Reported {
        spec: format!("base_bearing@{chain}").as_str().into(),
        name: "rz".into(),
        value: 0.1,
    }];
    let found = exported(&mechanism, &applied).expect("known parameters");
    assert_eq!(found.notes, [Note::NewRow { chain: chain.clone() }]);
    assert_eq!(found.mechanism.model.terms, ["offset".into(), format!("link_length@{chain}/3")]);
}

#[test]
fn what_there_is_not_is_refused_by_name() {
    let mechanism = Mechanism::rsi();
    for (spec, name) in [("curve@a22", "c2"), ("offset@b1", "offset"), ("offset@a11", "c2")] {
        let mut applied = result(&mechanism, &[]);
        applied.parameters = vec![Reported { spec: spec.into(), name: name.into(), value: 0.1 }];
        let error = exported(&mechanism, &applied);
        assert!(matches!(error, Err(Error::Unknown { .. })), "{error:?}");
    }
    let mut applied = result(&mechanism, &[]);
    applied.reference.centre.pop();
    let error = exported(&mechanism, &applied);
    assert!(matches!(error, Err(Error::Shape { found: 8, expected: 9, .. })), "{error:?}");
}

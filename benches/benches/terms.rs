//! One evaluation of the model with a term at every channel: a compiled term against the same law
//! as a formula.
#![expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]

use divan::{Bencher, black_box};
use rsicalib::mechanism::{Class, Law, Per};
use rsicalib::model::{Model, Want, Workspace, parse};
use rsicalib_benches::hand_controller;

fn main() {
    divan::main();
}

/// Compiled terms, and the same as formulas: name, parameters, formula.
const PAIRS: [(&str, &[&str], &str); 3] = [
    ("curvature", &["a"], "a*u^2"),
    ("cubic", &["a"], "a*u^3"),
    ("once_per_turn", &["a", "b"], "a*sin(phi) + b*cos(phi)"),
];

fn evaluate(bencher: Bencher, term: &str, formula: Option<(&[&str], &str)>) {
    let mut device = hand_controller(512);
    let spec = match formula {
        None => term.to_string(),
        Some((parameters, text)) => {
            device.mechanism.laws.push(Law {
                id: "own".into(),
                class: Class::Sensor,
                per: Per::Channel,
                parameters: parameters.iter().map(|p| ((*p).to_string(), 0.01)).collect(),
                correction: Some(text.into()),
                moves: None,
                amount: None,
                doc: String::new(),
            });
            "own".into()
        }
    };
    let session = device.session();
    let instances = parse(&session.mechanism, &session.readings, &[spec]).unwrap();
    let model = Model::new(&session.mechanism, &session.readings, instances).unwrap();
    let beta = vec![1e-3; model.parameters];
    let mut ws = Workspace::default();
    bencher.bench_local(|| {
        for block in 0..session.readings.blocks().len() {
            let (a, want) = (session.readings.raw(block), Want { x: true, a: true });
            model.evaluate(&session.readings, block, a, black_box(&beta), want, &mut ws);
        }
    });
}

#[divan::bench(args = 0..3)]
fn compiled(bencher: Bencher, pair: usize) {
    evaluate(bencher, PAIRS[pair].0, None);
}

/// The rival: it may take three times as long.
#[divan::bench(args = 0..3)]
fn formula(bencher: Bencher, pair: usize) {
    evaluate(bencher, PAIRS[pair].0, Some((PAIRS[pair].1, PAIRS[pair].2)));
}

//! Laws that every term must pass; `registry!` calls them for each.
//!
//! On the hand controller and on a mechanism drawn at random, held and moving,
//! with terms of every other stage switched on: the chain rule is tested
//! through all of them.

#[path = "../../tests/devices/mod.rs"]
mod devices;

use faer::{Mat, Side};

use self::devices::{Device, How, Rng, derivative, hand_controller, random};
use super::{Acts, Class, Needs, Term, find};
use crate::lm::{self, Options, Problem};
use crate::model::{self, MOST_PARAMETERS, Target, Want, Workspace, provided, targets};
use crate::objective::{Algebraic, Part, Prior};
use crate::{Instance, Mechanism, Model, Readings, Table, lanes, mechanism, rsi};

/// Identity, parameters and words are all there, and agree with what it does.
pub fn says_what_it_is(term: &dyn Term) {
    let info = term.info();
    assert_eq!(find(info.id).map(|t| t.info().id), Ok(info.id));
    let mut sentences = info.doc.lines().map(str::trim);
    let first = sentences.next().unwrap_or_default();
    assert!(first.ends_with('.') && first.len() > 20, "a sentence says what it is: {first:?}");
    assert!(sentences.any(|line| line.len() > 20), "and a paragraph what it adds, and why");
    assert!((1..=MOST_PARAMETERS).contains(&info.parameters.len()));
    for (k, p) in info.parameters.iter().enumerate() {
        assert!(p.typical.is_finite() && p.typical > 0.0, "{}", p.name);
        assert!(!p.unit.is_empty(), "{}", p.name);
        assert!(info.parameters[..k].iter().all(|other| other.name != p.name), "{}", p.name);
    }
    match term.acts() {
        Acts::Geometry(freedoms) => {
            assert_eq!(info.class, Class::Geometry);
            assert_eq!(freedoms.len(), info.parameters.len(), "one motion per parameter");
        }
        Acts::Load(_) => assert_eq!((info.class, info.parameters.len()), (Class::Load, 1)),
        Acts::Distance => assert_eq!((info.class, info.parameters.len()), (Class::Closure, 1)),
        Acts::Electronics(_) | Acts::Sensor(_) => {}
    }
}

/// At zero the model is what it would be without the term.
pub fn zero_parameters_change_nothing(term: &'static dyn Term) {
    for device in devices_for(term) {
        let readings = device.readings();
        let (others, values) = others(term, &device, &readings);
        let own = instances(term, &device.mechanism, &readings);
        let zeros = vec![0.0; own.iter().map(Instance::width).sum()];
        let (without, beta) = device.model(&readings, &others, &values);
        let (with, beta_with) =
            device.model(&readings, &[others, own].concat(), &[values, zeros].concat());
        for block in 0..readings.blocks().len() {
            let a = readings.raw(block);
            let was = evaluated(&without, &readings, block, a, &beta);
            let is = evaluated(&with, &readings, block, a, &beta_with);
            let pairs = was.f.iter().zip(&is.f).chain(was.a.iter().zip(&is.a));
            for (was, is) in pairs.flat_map(|(was, is)| was.0.iter().zip(is.0)) {
                // Placements that a motion of zero keeps apart round apart: by
                // units of 1e-16 in coordinates up to 10 in, squared.
                assert!((was - is).abs() <= 1e-12 * was.abs().max(1.0), "{was} became {is}");
            }
        }
    }
}

/// `X` of its parameters, through every stage.
pub fn partials_match_differences(term: &'static dyn Term) {
    for device in devices_for(term) {
        let readings = device.readings();
        let (mut all, mut values) = others(term, &device, &readings);
        let first = values.len();
        for instance in instances(term, &device.mechanism, &readings) {
            values.extend(sizes(&instance, &device.mechanism, &mut Rng::new(5)));
            all.push(instance);
        }
        let (model, beta) = device.model(&readings, &all, &values);
        let workspaces = every_block(&model, &readings, &beta);
        for column in first..values.len() {
            let analytic: Vec<f64> = workspaces
                .iter()
                .flat_map(|ws| ws.x.iter().skip(column).step_by(model.parameters))
                .flat_map(|lanes| lanes.0)
                .collect();
            let largest = largest(&analytic);
            // A step that moves f by 0.02 in², or twice the size of the parameter.
            let h = (0.02 / largest).min(2.0 * values[column].abs());
            let moved = |by: f64| {
                let mut beta = beta.clone();
                beta[column] += by;
                misclosure(&model, &readings, &beta, 0, 0.0)
            };
            let differences = derivative(moved, h);
            // Of angles h is near 1e-3: h⁴/480 of the fifth derivative is below
            // 1e-11 of the first, and rounding of f, 1e-14 · 100 in², over h too.
            let tolerance = 1e-8 * largest + 1e-12 / h;
            for (analytic, difference) in analytic.iter().zip(differences) {
                assert!(
                    (analytic - difference).abs() <= tolerance,
                    "{}, column {}: {analytic} should be {difference}",
                    device.mechanism.name,
                    column - first
                );
            }
        }
    }
}

/// `A`, through the term and through every stage.
pub fn reading_derivatives_match_differences(term: &'static dyn Term) {
    for device in devices_for(term) {
        let readings = device.readings();
        let (mut all, mut values) = others(term, &device, &readings);
        for instance in instances(term, &device.mechanism, &readings) {
            values.extend(sizes(&instance, &device.mechanism, &mut Rng::new(7)));
            all.push(instance);
        }
        let (model, beta) = device.model(&readings, &all, &values);
        let workspaces = every_block(&model, &readings, &beta);
        for channel in 0..readings.channels {
            let analytic: Vec<f64> = workspaces
                .iter()
                .flat_map(|ws| ws.a.iter().skip(channel).step_by(readings.channels))
                .flat_map(|lanes| lanes.0)
                .collect();
            // 1e-3 rad, for the shortest wave of a free curve 0.01 of its period.
            let h = 1e-3 / model.scales[channel].gain.abs();
            let differences = derivative(|by| misclosure(&model, &readings, &beta, channel, by), h);
            let tolerance = 1e-8 * largest(&analytic);
            for (analytic, difference) in analytic.iter().zip(differences) {
                assert!(
                    (analytic - difference).abs() <= tolerance,
                    "{}, channel {channel}: {analytic} should be {difference}",
                    device.mechanism.name
                );
            }
        }
    }
}

/// Readings that it disturbed tell its parameters, with offsets and gains free.
///
/// First everything is free: the misclosure must vanish. Where some directions
/// cannot be told apart, as many parameters as there are such directions are
/// then held at the truth, the term's own last; the others must be found.
pub fn simulated_alone_it_is_found_again(term: &'static dyn Term) {
    for device in devices_for(term) {
        for target in targets(term, &device.mechanism) {
            found_again(term, target, device.clone());
        }
    }
}

fn found_again(term: &'static dyn Term, target: Target, mut device: Device) {
    let readings = device.readings();
    let specs = ["offset".to_string(), "gain".to_string()];
    let mut all = model::parse(&device.mechanism, &readings, &specs).expect("known terms");
    let own = instance(term, target, &device.mechanism, &readings);
    if !all.contains(&own) {
        all.push(own);
    }
    let mut truth = Vec::new();
    for instance in &all {
        let size = sizes(instance, &device.mechanism, &mut Rng::new(11));
        truth.extend(size.iter().map(|s| if *instance == own { 3.0 * s } else { 0.0 }));
    }
    device.close(&all, &truth);
    let readings = device.readings();
    let (model, truth) = device.model(&readings, &all, &truth);
    let mut start = vec![0.0; model.term_parameters];
    start.extend(device.points.iter().map(|p| p + 0.01));

    let part = Part { model: &model, readings: &readings, use_row: None };
    let name = format!(
        "{}@{} on {}",
        term.info().id,
        target.name(&device.mechanism),
        model.mechanism.name
    );
    let fit = |priors: &[Prior]| {
        let problem = Algebraic::new(part, priors);
        assert!(problem.linearize(&start).cost > 1e-9, "{name}: the effect is not to be seen");
        let outcome = lm::minimize(&problem, &start, &Options::default());
        if outcome.cost > 1e-18 {
            println!("start {:e} end {:e} x {:?}\n norms {:?}\n n0 {:?} it {}", problem.linearize(&start).cost, outcome.cost, outcome.x, outcome.linearization.column_norms(), problem.linearize(&start).column_norms(), outcome.iterations);
        }
        // Readings close the loop to 1e-14 rad, or 1e-12 in² over 500 equations.
        assert!(outcome.cost < 1e-18, "{name}: left {:e}, {:?}", outcome.cost, outcome.termination);
        outcome.x
    };
    fit(&[]);

    let at = model.instances.iter().position(|i| *i == own).expect("its own instance");
    let own = model.first[at]..model.first[at] + own.width();
    let held = to_hold(&Algebraic::new(part, &[]).linearize(&truth).gram(), &own);
    let priors: Vec<Prior> =
        held.iter().map(|&column| Prior { column, mean: truth[column], sd: 1e-4 }).collect();
    let found = fit(&priors);
    for column in own {
        // The weakest direction is 3e-6 of the strongest (see `to_hold`), and
        // misclosures err by 1e-14: parameters of 1e-4 err by 1e-5 of their own.
        let (found, truth) = (found[column], truth[column]);
        assert!((found - truth).abs() <= 1e-4 * truth.abs(), "{name}: {found} should be {truth}");
    }
}

/// One parameter for each direction that the Gram matrix cannot see, those in
/// `own` only where no other takes part in it.
fn to_hold(gram: &Mat<f64>, own: &std::ops::Range<usize>) -> Vec<usize> {
    let n = gram.nrows();
    let norm = |i: usize| gram[(i, i)].sqrt().max(1e-12);
    let unit = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (norm(i) * norm(j)));
    let eigen = unit.self_adjoint_eigen(Side::Lower).expect("a finite matrix");
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    // Rounding leaves 1e-15 of a direction that is not seen at all.
    let mut null: Vec<Vec<f64>> = (0..n)
        .filter(|&k| values[k] < 1e-11)
        .map(|k| (0..n).map(|i| vectors[(i, k)]).collect())
        .collect();
    let mut held = Vec::new();
    while !null.is_empty() {
        let weight = |i: usize| null.iter().map(|v| v[i] * v[i]).sum::<f64>();
        let best = |some: &mut dyn Iterator<Item = usize>| {
            some.max_by(|&i, &j| weight(i).total_cmp(&weight(j))).unwrap_or(own.start)
        };
        let other = best(&mut (0..n).filter(|i| !own.contains(i)));
        let pivot = if weight(other) > 1e-6 { other } else { best(&mut own.clone()) };
        held.push(pivot);
        // The directions left are those that do not move the pivot.
        let leader =
            (0..null.len()).max_by(|&k, &l| null[k][pivot].abs().total_cmp(&null[l][pivot].abs()));
        let leader = null.swap_remove(leader.unwrap_or(0));
        for v in &mut null {
            let share = v[pivot] / leader[pivot];
            v.iter_mut().zip(&leader).for_each(|(v, l)| *v -= share * l);
        }
    }
    held
}

/// The devices that have what a term needs.
fn devices_for(term: &dyn Term) -> Vec<Device> {
    let how = if term.info().needs == Needs::Motion { How::Moving } else { How::Held };
    let mut devices = vec![hand_controller(how, 1), random(3, how, 2)];
    devices.retain(|d| {
        let there = provided(term, &d.mechanism, &d.readings()).is_ok();
        there && !targets(term, &d.mechanism).is_empty()
    });
    assert!(!devices.is_empty(), "no device has what {} needs", term.info().id);
    devices
}

/// A term at one target, at the middle one of its places.
fn instance(
    term: &'static dyn Term,
    target: Target,
    mechanism: &Mechanism,
    readings: &Readings,
) -> Instance {
    let channel = if let Target::Channel(c) = target { c } else { 0 };
    let places = term.places(mechanism, channel, readings.poses());
    Instance { term, target, place: places[places.len() / 2] }
}

/// A term at all its targets.
fn instances(term: &'static dyn Term, mechanism: &Mechanism, readings: &Readings) -> Vec<Instance> {
    let all = targets(term, mechanism).into_iter();
    all.map(|target| instance(term, target, mechanism, readings)).collect()
}

/// Terms of every other stage with parameters that are not zero.
fn others(
    term: &'static dyn Term,
    device: &Device,
    readings: &Readings,
) -> (Vec<Instance>, Vec<f64>) {
    const IDS: [&str; 12] = [
        "reference_temperature",
        "crosstalk",
        "offset",
        "gain",
        "curvature",
        "hysteresis",
        "link_length",
        "joint_tilt",
        "base_tilt",
        "sag",
        "joint_compliance",
        "distance",
    ];
    let (mut all, mut values) = (Vec::new(), Vec::new());
    let mut rng = Rng::new(3);
    for other in IDS.map(|id| find(id).expect("a term")) {
        if other == term || provided(other, &device.mechanism, readings).is_err() {
            continue;
        }
        for instance in instances(other, &device.mechanism, readings) {
            values.extend(sizes(&instance, &device.mechanism, &mut rng));
            all.push(instance);
        }
    }
    (all, values)
}

/// One to two typical sizes of each parameter, of either sign.
fn sizes(instance: &Instance, mechanism: &Mechanism, rng: &mut Rng) -> Vec<f64> {
    // Typical sizes are meant for 4096 counts; an encoder has other readings.
    let counts = match instance.target {
        Target::Channel(c) => mechanism.channels[c].half_range() / 2047.5,
        _ => 1.0,
    };
    let parameters = instance.term.info().parameters.iter();
    parameters
        .map(|p| {
            let scale = match p.unit {
                "reading" => counts,
                "rad/reading" => 1.0 / counts,
                _ => 1.0,
            };
            p.typical * scale * rng.uniform(1.0, 2.0) * rng.uniform(-1.0, 1.0).signum()
        })
        .collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| v.abs().max(m))
}

fn evaluated(
    model: &Model,
    readings: &Readings,
    block: usize,
    a: &[lanes::Lanes],
    beta: &[f64],
) -> Workspace {
    let mut ws = Workspace::default();
    model.evaluate(readings, block, a, beta, Want { x: true, a: true }, &mut ws);
    ws
}

fn every_block(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<Workspace> {
    let blocks = 0..readings.blocks().len();
    blocks.map(|b| evaluated(model, readings, b, readings.raw(b), beta)).collect()
}

/// The misclosure of every sample with one channel read otherwise.
fn misclosure(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    channel: usize,
    by: f64,
) -> Vec<f64> {
    let mut f = Vec::new();
    let mut ws = Workspace::default();
    for block in 0..readings.blocks().len() {
        let mut a = readings.raw(block).to_vec();
        a[channel] += lanes::Lanes::splat(by);
        model.evaluate(readings, block, &a, beta, Want { x: false, a: false }, &mut ws);
        f.extend(ws.f.iter().flat_map(|f| f.0));
    }
    f
}

//! Laws that every term must pass; `registry!` calls them for each.
//!
//! On the hand controller and on a mechanism drawn at random, held and moving,
//! with terms of every other stage switched on: the chain rule is tested
//! through all of them.

use crate::numerics::order::Ends;
use faer::{Mat, Side};

use crate::estimate::{Algebraic, Part};
use crate::mechanism::{ClosureKind, Target};
use crate::model::{self, Instance, MOST_PARAMETERS, Prior};
use crate::numerics::linearization::Problem;
use crate::numerics::lm::{self, SolverOptions};
use crate::readings::Readings;
use crate::terms::find;
use crate::terms::laws::devices::{
    Device, How, Rng, hand_controller, instance, instances, on_surface, pair, plate, random, sizes,
};
use crate::terms::laws::differences::{EVERY_STAGE, check_parameters, check_readings, evaluated};
use crate::terms::targets::{provided, shared, targets};
use crate::terms::term::{Acts, Class, Needs, Term};

#[path = "../../tests/devices/mod.rs"]
mod devices;
#[path = "../../tests/devices/differences.rs"]
mod differences;

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
        Acts::Surface(_) => assert_eq!(info.class, Class::Closure),
        Acts::Instrument(of) => {
            assert_eq!((info.class, info.parameters.len()), (Class::Closure, of.width()));
        }
        Acts::End | Acts::Attachment => {
            assert_eq!((info.class, info.parameters.len()), (Class::Closure, 3));
        }
        Acts::Distance => assert_eq!((info.class, info.parameters.len()), (Class::Closure, 1)),
        Acts::Electronics(_) | Acts::Sensor(_) | Acts::Coupled(_) => {}
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

/// `X` of its parameters, at single targets and at shared ones, through every stage.
pub fn partials_match_differences(term: &'static dyn Term) {
    for device in devices_for(term) {
        let readings = device.readings();
        let (mut all, mut values) = others(term, &device, &readings);
        let first = values.len();
        let of_all = |target| instance(term, target, &device.mechanism, &readings);
        let shared = shared(term, &device.mechanism).into_iter().map(of_all);
        for instance in instances(term, &device.mechanism, &readings).into_iter().chain(shared) {
            values.extend(sizes(&instance, &device.mechanism, &mut Rng::new(5)));
            all.push(instance);
        }
        let (model, beta) = device.model(&readings, &all, &values);
        check_parameters(&model, &readings, &beta, first..values.len());
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
        check_readings(&model, &readings, &beta);
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
            // What is elsewhere in each pose is no part of readings that are moved until the loops close: of its
            // terms tests/closures.rs has lengths in plain products, and their minimum.
            if !device.mechanism.frames.iter().any(|frame| frame.moves()) {
                found_again(term, target, device.clone());
            }
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
        // All waves of a free curve at once are already more than several sizes.
        let times = if term.info().penalised { 0.5 } else { 3.0 };
        truth.extend(size.iter().map(|s| if *instance == own { times * s } else { 0.0 }));
    }
    assert!(device.closes(&all, &truth), "every pose assembles");
    let readings = device.readings();
    let (model, truth) = device.model(&readings, &all, &truth);
    let zeros = vec![0.0; model.term_parameters];
    let start = |off: f64| -> Vec<f64> {
        zeros.iter().copied().chain(device.points.iter().map(|p| p + off)).collect()
    };

    let part = Part { model: &model, readings: &readings, weights: None };
    let name = format!(
        "{}@{} on {}",
        term.info().id,
        target.name(&device.mechanism),
        model.mechanism.name
    );
    let fit = |priors: &[Prior]| {
        let problem = Algebraic::new(part, priors);
        assert!(problem.linearize(&start(0.0)).cost > 1e-9, "{name}: its effect is not to be seen");
        let outcome = lm::minimize(&problem, &start(0.01), &SolverOptions::default());
        // Readings close the loop to 1e-14 rad, or 1e-12 in² over 500 equations.
        assert!(outcome.cost < 1e-18, "{name}: left {:e}, {:?}", outcome.cost, outcome.termination);
        outcome.x
    };
    fit(&[]);

    let at = model.instances.iter().position(|i| *i == own).expect("its own instance");
    let own = model.first[at]..model.first[at] + own.width();
    let held = to_hold(&Algebraic::new(part, &[]).linearize(&truth).gram(), &own);
    let priors: Vec<Prior> = held
        .iter()
        .map(|&column| Prior::Parameter { column, mean: truth[column], sd: 1e-4 })
        .collect();
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
            some.greatest_by(|&i| weight(i)).unwrap_or(own.start)
        };
        let other = best(&mut (0..n).filter(|i| !own.contains(i)));
        let pivot = if weight(other) > 1e-6 { other } else { best(&mut own.clone()) };
        held.push(pivot);
        // The directions left are those that do not move the pivot.
        let leader = (0..null.len()).greatest_by(|&k| null[k][pivot].abs());
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
    let mut devices = match term.acts() {
        Acts::Surface(_) => {
            [ClosureKind::Plane, ClosureKind::Line].map(|kind| on_surface(kind, how, 4)).to_vec()
        }
        _ => vec![hand_controller(how, 1), random(3, how, 2)],
    };
    let has = |d: &Device| {
        let there = provided(term, &d.mechanism, &d.readings()).is_ok();
        there && !targets(term, &d.mechanism).is_empty()
    };
    devices.retain(has);
    if devices.is_empty() {
        devices.extend(
            [pair(how, 3), plate(how, 5), devices::plate::watched_plate(how, 6)]
                .into_iter()
                .filter(has),
        );
    }
    if devices.is_empty() {
        // Not every drawing has a row that a body of `xyz` and `rpy` turns far enough.
        devices.extend((3..60).map(|seed| random(3, how, seed)).find(has));
    }
    assert!(!devices.is_empty(), "no device has what {} needs", term.info().id);
    devices
}

/// Terms of every other stage with parameters that are not zero.
fn others(
    term: &'static dyn Term,
    device: &Device,
    readings: &Readings,
) -> (Vec<Instance>, Vec<f64>) {
    let ids: Vec<&str> = EVERY_STAGE.into_iter().filter(|id| *id != term.info().id).collect();
    device.terms(readings, &ids, 3)
}

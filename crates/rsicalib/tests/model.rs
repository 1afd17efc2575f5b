//! The model: misclosure and derivatives against differences and closed forms,
//! and sums that depend on neither layout, order, threads nor instructions.

use std::array::from_fn;

use crate::devices::{Device, How, Rng, hand_controller, pair, random};
use crate::differences::{EVERY_STAGE, check_parameters, check_readings, evaluated};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rsicalib::Error;
use rsicalib::estimate::{Algebraic, Implicit, Noise, Part};
use rsicalib::mechanism::{ClosureKind, Mechanism, Motion, Row, Target, Value, hand_controller};
use rsicalib::model::{self, Model, Want, Workspace};
use rsicalib::numerics::lanes::{self, WIDTH};
use rsicalib::numerics::linearization::{Linearization, Problem};
use rsicalib::readings::{Readings, Table};

// --- misclosure ----------------------------------------------------------

#[test]
fn misclosure_agrees_with_the_closed_forms_of_the_hand_controller() {
    let mechanism = Mechanism::rsi();
    let mut rng = Rng::new(1);
    let values: Vec<f64> = (0..9 * 1000).map(|_| rng.uniform(0.0, 4095.0)).collect();
    let readings = Readings::new(&mechanism, Table { values, ..Table::default() }).expect("counts");
    let model = Model::new(&mechanism, &readings, Vec::new()).expect("no terms");
    for (block, meta) in readings.blocks().iter().enumerate() {
        let ws = evaluated(&model, &readings, block, readings.raw(block), &[]);
        for (row, lane) in meta.rows.iter().zip(0..meta.live) {
            let row = readings.row(*row);
            let at = |i: usize, j: usize| mechanism.channels[3 * i + j].angle(row[3 * i + j]);
            let r = hand_controller::wrists(&from_fn(|i| from_fn(|j| at(i, j))));
            let d = 3.0_f64.sqrt() * hand_controller::L4;
            for (k, (a, b)) in [(0, 1), (1, 2), (0, 2)].into_iter().enumerate() {
                let expected = (r[a] - r[b]).norm_squared() - d * d;
                // A few roundings of coordinates up to 12 in, squared.
                let slack = 1e-12 * (r[a] - r[b]).norm_squared().max(1.0);
                assert!((ws.f[k].0[lane] - expected).abs() < slack, "{row:?}");
            }
        }
    }
}

/// The end of a chain by products of matrices, row by row.
fn tip(mechanism: &Mechanism, chain: usize, reading: &[f64]) -> Isometry3<f64> {
    let turn = |axis: Vector3<f64>, by: f64| Isometry3::rotation(axis * by);
    let slide = |x: f64, y: f64, z: f64| Isometry3::from(Translation3::new(x, y, z));
    let mut pose = Isometry3::identity();
    for row in &mechanism.chains[chain].rows {
        pose *= turn(Vector3::z(), row.theta);
        if let Some(name) = &row.channel {
            let c = mechanism.channel_index(name).expect("a channel");
            let q = mechanism.channels[c].gain * reading[c] + mechanism.channels[c].offset;
            let q = row.ratio.unwrap_or(1.0) * q;
            pose *= match row.joint {
                Motion::Revolute => turn(Vector3::z(), q),
                Motion::Prismatic => slide(0.0, 0.0, q),
            };
        }
        pose *= slide(0.0, 0.0, row.d) * slide(row.a, 0.0, 0.0) * turn(Vector3::x(), row.alpha);
        let [roll, pitch, yaw] = row.rpy;
        pose *= slide(row.xyz[0], row.xyz[1], row.xyz[2])
            * Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            );
    }
    pose
}

#[test]
fn misclosure_agrees_with_products_of_matrices() {
    for chains in 2..=4 {
        let device = random(chains, How::Held, 30 + chains as u64);
        let mut rng = Rng::new(4);
        let mut table = device.table.clone();
        // Away from closure, where there is something to compare.
        table.values.iter_mut().for_each(|v| *v *= 1.0 + 0.05 * rng.normal());
        let readings = Readings::new(&device.mechanism, table).expect("still in range");
        let (model, beta) = device.model(&readings, &[], &[]);
        for (block, meta) in readings.blocks().iter().enumerate() {
            let ws = evaluated(&model, &readings, block, readings.raw(block), &beta);
            for (row, lane) in meta.rows.iter().zip(0..meta.live) {
                let expected = plain_misclosure(&device, &readings, *row);
                assert_eq!(expected.len(), model.equations());
                for (f, expected) in ws.f.iter().zip(expected) {
                    assert!((f.0[lane] - expected).abs() < 1e-12 * expected.abs().max(10.0));
                }
            }
        }
    }
}

fn plain_misclosure(device: &Device, readings: &Readings, row: usize) -> Vec<f64> {
    let mechanism = &device.mechanism;
    // `points` holds the sockets in the order in which the readings name them.
    let socket = readings.groups.iter().position(|g| g[0] == readings.table.keys[0][row]);
    let socket = 3 * socket.expect("a group");
    let place = |name: &str| -> Vector3<f64> {
        let point = &mechanism.points[mechanism.point_index(name).expect("a point")];
        match (&point.chain, point.at) {
            (Some(chain), Some(at)) => {
                let chain = mechanism.chain_index(chain).expect("a chain");
                (tip(mechanism, chain, readings.row(row)) * Point3::from(at)).coords
            }
            (_, Some(at)) => at.into(),
            _ => Vector3::from_column_slice(&device.points[socket..socket + 3]),
        }
    };
    let mut f = Vec::new();
    for closure in &mechanism.closures {
        let apart = place(&closure.between[0]) - place(&closure.between[1]);
        match (closure.kind, &closure.value) {
            (ClosureKind::Touch, _) => f.extend(apart.iter()),
            (_, Some(Value::Known(d))) => f.push(apart.norm_squared() - d * d),
            // A length that is read is compared as a length: its noise is the same however long it is.
            _ => f.push(apart.norm() - readings.table.columns[0][row]),
        }
    }
    f
}

// --- derivatives ---------------------------------------------------------

fn check_derivatives(device: &Device, seed: u64) {
    let readings = device.readings();
    let geometry = ["link_frame", "base_position", "point_position", "free_curve", "lag"];
    let ids = [&EVERY_STAGE[..], &geometry[..]].concat();
    let (instances, values) = device.terms(&readings, &ids, seed);
    let (model, beta) = device.model(&readings, &instances, &values);
    check_parameters(&model, &readings, &beta, 0..model.parameters);
    check_readings(&model, &readings, &beta);
}

#[test]
fn derivatives_match_differences_on_the_hand_controller() {
    check_derivatives(&hand_controller(How::Held, 3), 1);
    check_derivatives(&hand_controller(How::Moving, 4), 2);
}

#[test]
fn derivatives_match_differences_on_a_leader_and_its_follower() {
    let device = pair(How::Moving, 5);
    let readings = device.readings();
    let ids = ["offset", "gain", "lag", "servo", "drag", "hysteresis"];
    let (instances, values) = device.terms(&readings, &ids, 6);
    let (model, beta) = device.model(&readings, &instances, &values);
    check_parameters(&model, &readings, &beta, 0..model.parameters);
    check_readings(&model, &readings, &beta);
}

#[test]
fn derivatives_match_differences_on_random_mechanisms() {
    for chains in 2..=4 {
        check_derivatives(&random(chains, How::Held, 10 + chains as u64), 3);
        check_derivatives(&random(chains, How::Moving, 20 + chains as u64), 4);
    }
}

#[test]
fn columns_that_an_equation_does_not_depend_on_are_zero() {
    for device in [hand_controller(How::Held, 5), random(4, How::Held, 5)] {
        let readings = device.readings();
        let (instances, values) = device.terms(&readings, &EVERY_STAGE, 5);
        let (model, beta) = device.model(&readings, &instances, &values);
        let ws = evaluated(&model, &readings, 0, readings.raw(0), &beta);
        for (k, active) in model.active().iter().enumerate() {
            for column in (0..model.width()).filter(|c| !active.contains(c)) {
                let x = ws.x[k * model.width() + column];
                assert_eq!(x, lanes::Lanes::ZERO, "equation {k}, column {column}");
            }
        }
    }
}

#[test]
fn a_measured_distance_has_play_and_a_length_too() {
    let device = random(2, How::Held, 6);
    let readings = device.readings();
    let (model, _) = device.model(&readings, &[], &[]);
    // Of |p| - d: the error of the distance itself.
    assert!((model.lengths()[0] - 1.0).abs() < 1e-12);
    assert!((model.play()[0].sqrt() / 2e-3 - 1.0).abs() < 1e-12);
}

#[test]
fn a_target_or_place_that_is_not_there_is_named_with_those_that_are() {
    let device = hand_controller(How::Held, 7);
    let readings = device.readings();
    let parse = |spec: &str| model::parse(&device.mechanism, &readings, &[spec.to_string()]);
    let refused = |spec: &str| match parse(spec) {
        Err(Error::Unknown { kind, found, known }) => (kind, found, known),
        other => panic!("{other:?}"),
    };
    let targets = "a11, a12, a13, a21, a22, a23, a31, a32, a33, each.1, each.2, each.3".to_string();
    assert_eq!(refused("curvature@a77"), ("target", "a77".into(), targets));
    assert_eq!(refused("crosstalk@a22:a33"), ("place", "a33".into(), "a21, a23".into()));
    assert_eq!(refused("wobble").0, "term");
    for searched in ["slip@a22", "crosstalk", "n_per_turn@a11", "base_slip@arm1", "bad_reading"] {
        let Err(Error::Option { found, .. }) = parse(searched) else { panic!("{searched}") };
        assert!(found.starts_with(searched) && found.ends_with("without a place"), "{found}");
    }
    let slip = parse("slip@a22:17").expect("a pose of that label");
    assert_eq!(readings.labels[slip[0].place], 17);
    assert_eq!(parse("link_length").expect("every row").len(), 12);
}

// --- layout --------------------------------------------------------------

/// Terms that do not depend on the order of samples, nor on their mean.
const ORDERLESS: [&str; 6] = ["crosstalk", "offset", "curvature", "link_length", "sag", "distance"];

fn linearized(device: &Device, readings: &Readings) -> Linearization {
    let (instances, values) = device.terms(readings, &ORDERLESS, 8);
    let (model, beta) = device.model(readings, &instances, &values);
    Algebraic::new(Part { model: &model, readings, weights: None }, &[]).linearize(&beta)
}

/// Some rows of a device's table, in this order.
fn rows(device: &Device, rows: &[usize]) -> Readings {
    let table = &device.table;
    let channels = device.mechanism.channels.len();
    let pick = |column: &Vec<f64>| rows.iter().map(|&r| column[r]).collect();
    let values = rows.iter().flat_map(|r| table.values[r * channels..(r + 1) * channels].to_vec());
    let some = Table {
        values: values.collect(),
        pose: table.pose.as_ref().map(|p| rows.iter().map(|&r| p[r]).collect()),
        time: table.time.as_ref().map(pick),
        temperature: table.temperature.as_ref().map(pick),
        session: None,
        keys: table.keys.iter().map(|k| rows.iter().map(|&r| k[r].clone()).collect()).collect(),
        columns: table.columns.iter().map(pick).collect(),
        part: None,
    };
    Readings::new(&device.mechanism, some).expect("rows of a table that was accepted")
}

/// The same sums, up to the order in which they were added.
fn assert_same(a: &Linearization, b: &Linearization) {
    let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-12 * scale;
    assert!(close(a.cost, b.cost, a.cost));
    let (norms, gram, other) = (a.column_norms(), a.gram(), b.gram());
    for i in 0..norms.len() {
        let scale = norms[i] * (2.0 * a.cost).sqrt();
        assert!(close(a.gradient[i], b.gradient[i], scale), "gradient, {i}");
        for j in 0..norms.len() {
            assert!(close(gram[(i, j)], other[(i, j)], norms[i] * norms[j]), "gram, {i}, {j}");
        }
    }
}

#[test]
fn every_sample_is_in_one_lane_of_a_block_of_its_group() {
    let device = random(2, How::Held, 9);
    let readings = device.readings();
    let mut seen = vec![0; readings.samples];
    for (block, meta) in readings.blocks().iter().enumerate() {
        assert!((1..=WIDTH).contains(&meta.live));
        for (lane, &row) in meta.rows.iter().enumerate() {
            assert_eq!(readings.table.keys[0][row], readings.groups[meta.group][0]);
            for (c, raw) in readings.raw(block).iter().enumerate() {
                assert_eq!(raw.0[lane], readings.row(row)[c]);
            }
            assert_eq!(readings.columns(block)[0].0[lane], readings.table.columns[0][row]);
            seen[row] += usize::from(lane < meta.live);
        }
    }
    assert!(seen.iter().all(|&n| n == 1));
}

#[test]
fn padding_lanes_do_not_count() {
    // NormalEquations of the first n rows, less those of the first n - 1: one row, however
    // many lanes pad the last block.
    let device = hand_controller(How::Held, 10);
    let alone: Vec<Linearization> =
        (0..11).map(|row| linearized(&device, &rows(&device, &[row]))).collect();
    for n in 1..=11 {
        let all = linearized(&device, &rows(&device, &(0..n).collect::<Vec<_>>()));
        let cost: f64 = alone[..n].iter().map(|l| l.cost).sum();
        assert!((all.cost - cost).abs() <= 1e-12 * cost, "{n} rows");
        for (i, norm) in all.column_norms().iter().enumerate() {
            let gradient: f64 = alone[..n].iter().map(|l| l.gradient[i]).sum();
            let square: f64 = alone[..n].iter().map(|l| l.gram()[(i, i)]).sum();
            assert!((all.gradient[i] - gradient).abs() <= 1e-12 * norm * (2.0 * cost).sqrt());
            assert!((norm * norm - square).abs() <= 1e-12 * square, "{n} rows, column {i}");
        }
    }
}

#[test]
fn the_order_of_samples_and_the_mixture_of_groups_do_not_matter() {
    for device in [hand_controller(How::Held, 11), random(3, How::Held, 11)] {
        let n = device.table.time.as_ref().map_or(0, Vec::len);
        let ordered = linearized(&device, &rows(&device, &(0..n).collect::<Vec<_>>()));
        let mut shuffled: Vec<usize> = (0..n).collect();
        let mut rng = Rng::new(12);
        // The first row stays, so that the unknown points keep their numbers.
        for i in 2..n {
            shuffled.swap(i, rng.uniform(1.0, i as f64 + 1.0) as usize);
        }
        assert_same(&ordered, &linearized(&device, &rows(&device, &shuffled)));
    }
}

// --- threads and instructions --------------------------------------------

/// Many rows of a device with noise on them.
fn many(device: &Device, n: usize) -> Readings {
    let few = device.table.time.as_ref().map_or(0, Vec::len);
    let readings = rows(device, &(0..n).map(|row| row % few).collect::<Vec<_>>());
    let mut table = readings.table.clone();
    let mut rng = Rng::new(13);
    let gains = device.mechanism.channels.iter().map(|c| c.gain).cycle();
    table.values.iter_mut().zip(gains).for_each(|(v, gain)| *v += 1e-3 * rng.normal() / gain);
    Readings::new(&device.mechanism, table).expect("still in range")
}

fn bits(here: &Linearization) -> Vec<u64> {
    let (n, gram) = (here.gradient.len(), here.gram());
    let all = (0..n * n).map(|k| gram[(k / n, k % n)]).chain(here.gradient.iter().copied());
    all.chain([here.cost]).map(f64::to_bits).collect()
}

#[test]
fn sums_do_not_depend_on_the_number_of_threads() {
    let device = random(2, How::Held, 14);
    let readings = many(&device, 5_000);
    let (instances, values) = device.terms(&readings, &ORDERLESS, 15);
    let (model, beta) = device.model(&readings, &instances, &values);
    let sigma = device.mechanism.channels.iter().map(|c| 1e-3 / c.gain.abs()).collect();
    let part = Part { model: &model, readings: &readings, weights: None };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let noise = Noise::declared(Vec::clone(&sigma));
            let implicit = Implicit::new(vec![(part, noise)], &[]);
            let once = bits(&implicit.linearize(&beta));
            // Again, from where the readings now stand.
            [
                bits(&Algebraic::new(part, &[]).linearize(&beta)),
                once,
                bits(&implicit.linearize(&beta)),
            ]
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(7));
}

#[test]
fn wide_instructions_give_the_bits_of_plain_ones() {
    for device in [hand_controller(How::Moving, 16), random(3, How::Held, 16)] {
        let readings = device.readings();
        let (instances, values) = device.terms(&readings, &EVERY_STAGE, 17);
        let (model, beta) = device.model(&readings, &instances, &values);
        let want = Want { x: true, a: true };
        let (mut plain, mut wide) = (Workspace::default(), Workspace::default());
        for block in 0..readings.blocks().len() {
            let raw = readings.raw(block);
            model.evaluate_as_compiled(&readings, block, raw, &beta, want, &mut plain);
            model.evaluate(&readings, block, raw, &beta, want, &mut wide);
            assert_eq!(plain.f, wide.f);
            assert_eq!(plain.a, wide.a);
            assert_eq!(plain.x, wide.x);
            assert_eq!(plain.angles, wide.angles);
        }
    }
}

// --- targets that chains share ---------------------------------------------

#[test]
fn a_shared_parameter_moves_what_its_parts_move_together() {
    let device = hand_controller(How::Held, 4);
    let readings = device.readings();
    let mut mechanism = device.mechanism.clone();
    mechanism.gravity = Some([0.2, 0.1, -1.0]);
    let of = |specs: &[&str]| {
        let specs: Vec<String> = specs.iter().map(ToString::to_string).collect();
        let instances = model::parse(&mechanism, &readings, &specs).expect("targets");
        let model = Model::new(&mechanism, &readings, instances).expect("a model");
        let beta = vec![2e-3; model.parameters];
        (0..readings.blocks().len())
            .map(|block| evaluated(&model, &readings, block, readings.raw(block), &beta))
            .collect::<Vec<Workspace>>()
    };
    let sides = |term: &str| {
        ["wrist1-wrist2", "wrist2-wrist3", "wrist1-wrist3"].map(|side| format!("{term}@{side}"))
    };
    for (shared, parts) in [
        ("link_length@each/3", ["link_length@arm1/3", "link_length@arm2/3", "link_length@arm3/3"]),
        ("curvature@each.2", ["curvature@a12", "curvature@a22", "curvature@a32"]),
        ("joint_sag@each.2", ["joint_sag@a12", "joint_sag@a22", "joint_sag@a32"]),
        ("sag@all", ["sag@arm1", "sag@arm2", "sag@arm3"]),
        ("distance@each", sides("distance").each_ref().map(String::as_str)),
        ("distance_growth@each", sides("distance_growth").each_ref().map(String::as_str)),
    ] {
        for (one, several) in of(&[shared]).iter().zip(of(&parts)) {
            for k in 0..one.f.len() {
                for lane in 0..WIDTH {
                    let (x, f) = (one.x[k].0[lane], one.f[k].0[lane]);
                    let sum: f64 = several.x[3 * k..3 * k + 3].iter().map(|x| x.0[lane]).sum();
                    // The same sums in another order: a few roundings of squares up to 100.
                    assert!((x - sum).abs() <= 1e-11 * sum.abs().max(1.0), "{shared}: {x} {sum}");
                    assert!((f - several.f[k].0[lane]).abs() <= 1e-11, "{shared}");
                }
            }
        }
    }
}

/// What a channel that drives several joints gives under a load is the work of all of them.
#[test]
fn a_channel_of_several_joints_gives_by_the_work_of_all() {
    let device = random(3, How::Held, 4);
    let mechanism = &device.mechanism;
    let geared = mechanism.chains[0].rows.iter().position(|row| row.ratio.is_some());
    let name = mechanism.chains[0].rows[geared.expect("a row")].channel.as_ref().expect("its own");
    let channel = mechanism.channel_index(name).expect("a channel");
    let readings = device.readings();
    let (instances, values) = device.terms(&readings, &["joint_compliance"], 3);
    let only: Vec<_> = instances.iter().filter(|i| i.target == Target::Channel(channel)).collect();
    let instance = **only.first().expect("masses are declared");
    let compliance = values[0].abs();
    let (model, beta) = device.model(&readings, &[instance], &[compliance]);
    let ws = evaluated(&model, &readings, 0, readings.raw(0), &beta);
    let gravity = Vector3::from(mechanism.gravity.expect("declared")).normalize();
    // Sum of mass times height, by products of matrices, for a reading of that channel.
    let row = readings.row(readings.blocks()[0].rows[0]).to_vec();
    let work = |more: f64| -> f64 {
        let mut row = row.clone();
        row[channel] += more / mechanism.channels[channel].gain;
        let upto = |n: usize| {
            let mut part = mechanism.clone();
            part.chains[0].rows.truncate(n + 1);
            let last = &mut part.chains[0].rows[n];
            *last =
                Row { d: 0.0, a: 0.0, alpha: 0.0, xyz: [0.0; 3], rpy: [0.0; 3], ..last.clone() };
            tip(&part, 0, &row)
        };
        let rows = mechanism.chains[0].rows.iter().enumerate();
        rows.filter_map(|(n, row)| {
            let at = upto(n) * Point3::from(row.com);
            row.mass.map(|mass| mass * at.coords.dot(&gravity))
        })
        .sum()
    };
    let torque = (work(1e-5) - work(-1e-5)) / 2e-5;
    let (model, beta) = device.model(&readings, &[], &[]);
    let bare = evaluated(&model, &readings, 0, readings.raw(0), &beta);
    let given = (ws.angles[channel].0[0] - bare.angles[channel].0[0]) / compliance;
    // Central differences of 1e-5 err by the third derivative over 6e10, and rounding by 1e-11.
    assert!((given - torque).abs() < 1e-8 * torque.abs().max(1.0), "{given} for {torque}");
}

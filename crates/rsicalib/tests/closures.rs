//! Closures of every kind against plain products, and what is unknown in one pose alone against a
//! minimisation of its own.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};
use rsicalib::estimate::{FitOptions, Implicit, Noise, Observations, Part, fit};
use rsicalib::mechanism::{ClosureKind, Mechanism, Target};
use rsicalib::model::{Instance, Model, Want, Workspace, parse};
use rsicalib::numerics::linearization::Problem;
use rsicalib::readings::{Readings, Table};
use rsicalib::terms::{self, find};

use crate::devices::plate::{INSTRUMENT, lengths, watched_plate};
use crate::devices::{Device, How, Rng, derivative, instances, on_surface, plate};
use crate::differences::{check_parameters, check_readings, evaluated, placed};

/// An arm of two joints that turn about z, at height `d`, and of one that slides along it: the tip is
/// `[cos q1 + 0.7 cos(q1+q2), sin q1 + 0.7 sin(q1+q2), q3]`.
const ARM: &str = r#"
name = "arm"
length_unit = "m"
channel = [
  {name = "q1", unit = "rad", gain = 1.0, offset = 0.1},
  {name = "q2", unit = "rad", gain = 0.9, offset = 0.0},
  {name = "q3", unit = "m", gain = 1.1, offset = 0.2},
  {name = "wire", unit = "m", gain = 1.02, offset = 0.03},
  {name = "copy", unit = "rad", gain = 1.0, offset = -0.2},
]
point = [
  {name = "tip", chain = "arm", at = [0.0, 0.0, 0.0]},
  {name = "post", unknown = [], at = [0.3, -0.2, 0.9], free = ["x", "z"]},
  {name = "seen", columns = ["x", "y", "z"]},
  {name = "tracked", columns = ["x", "y", "z"], frame = "tracker"},
  {name = "scanned", columns = ["x", "y", "z"], frame = "scanner"},
]
plane = [
  {name = "bed", normal = [0.0, 3.0, 4.0], offset = 2.0},
  {name = "table", unknown = ["surface"], normal = [0.1, 0.2, 1.0]},
]
column = [{name = "x", unit = "m"}]
line = [
  {name = "edge", at = [0.5, 0.1, -0.3], direction = [1.0, 2.0, -2.0]},
  {name = "rail", unknown = ["surface"], direction = [0.3, 1.0, 0.2]},
]
frame = [
  {name = "tracker", unknown = []},
  {name = "scanner", pose = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6]},
]
closure = [
  {name = "on bed", kind = "plane", between = ["tip", "bed"]},
  {name = "on table", kind = "plane", between = ["tip", "table"], noise = 1e-3},
  {name = "on edge", kind = "line", between = ["tip", "edge"]},
  {name = "wire", kind = "distance", between = ["tip", "post"], channel = "wire"},
  {name = "tip seen", kind = "touch", between = ["tip", "seen"]},
  {name = "tip tracked", kind = "touch", between = ["tip", "tracked"]},
  {name = "tip scanned", kind = "touch", between = ["scanned", "tip"]},
  {name = "same", kind = "equal", between = ["q1", "copy"]},
  {name = "on rail", kind = "line", between = ["tip", "rail"], noise = 1e-3},
]
[[term]]
id = "stretch"
class = "closure"
per = "closure"
correction = "a*length^2 + b*x*theta[q1]"
parameters = {a = 0.01, b = 0.01}
[[chain]]
name = "arm"
dh = [{channel = "q1", a = 1.0}, {channel = "q2", a = 0.7}, {channel = "q3", joint = "prismatic"}]
"#;

const SURFACES: [&str; 2] = ["floor", "wall"];

/// Of the rail at each of them: two tilts, two offsets.
const RAILS: [[f64; 4]; 2] = [[0.2, -0.4, 0.3, -0.1], [-0.6, 0.1, -0.2, 0.5]];

/// Readings of the arm anywhere: nothing closes.
fn anywhere(mechanism: &Mechanism, rows: usize) -> Readings {
    let mut rng = Rng::new(5);
    let values = (0..rows * 5).map(|_| rng.uniform(-1.0, 1.0)).collect();
    let columns = (0..3).map(|_| (0..rows).map(|_| rng.uniform(-1.0, 1.0)).collect()).collect();
    let surfaces = (0..rows).map(|row| SURFACES[row % 3 % 2].to_owned()).collect();
    let table = Table { values, columns, keys: vec![surfaces], ..Table::default() };
    Readings::new(mechanism, table).expect("readings")
}

/// What is unknown of the arm: the post, two tables, two rails, and the tracker.
fn unknowns(model: &Model) -> Vec<f64> {
    let names: Vec<_> = model.unknowns.iter().map(|u| u.name.as_str()).collect();
    let keyed = |name: &str| SURFACES.map(|surface| format!("{name}[surface={surface}]"));
    let [tables, rails] = [keyed("table"), keyed("rail")];
    assert_eq!(names, ["post", &tables[0], &tables[1], &rails[0], &rails[1], "tracker"]);
    let mut beta = model.nominal();
    let own = [0.4, 0.8, 0.2, -0.1, 0.3, -0.3, 0.15, -0.2];
    let tracker = [0.3, 0.1, -0.4, 0.5, -0.7, 1.1];
    let first = model.term_parameters;
    beta[first..].copy_from_slice(&[&own[..], &RAILS[0], &RAILS[1], &tracker].concat());
    beta
}

fn turned(rpy: [f64; 3]) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), rpy[2])
        * Rotation3::from_axis_angle(&Vector3::y_axis(), rpy[1])
        * Rotation3::from_axis_angle(&Vector3::x_axis(), rpy[0])
}

/// Coordinates of the joints of one row, and the place of the tip.
fn tip_of(readings: &Readings, row: usize) -> ([f64; 3], Vector3<f64>) {
    let a = readings.row(row);
    let q = [a[0] + 0.1, 0.9 * a[1], 1.1 * a[2] + 0.2];
    let both = q[0] + q[1];
    let tip = Vector3::new(q[0].cos() + 0.7 * both.cos(), q[0].sin() + 0.7 * both.sin(), q[2]);
    (q, tip)
}

/// The misclosure of one row, equation by equation.
fn plain(readings: &Readings, row: usize) -> Vec<f64> {
    let a = readings.row(row);
    let (q, tip) = tip_of(readings, row);
    let mut f = vec![(3.0 * tip.y + 4.0 * tip.z - 2.0) / 5.0];
    // The table leans from its normal towards the next axes of the base, made orthogonal.
    let n = Vector3::new(0.1, 0.2, 1.0).normalize();
    let x = Vector3::x();
    let one = (x - n * n.x).normalize();
    let other = n.cross(&one);
    let [t1, t2, offset] =
        if (row % 3).is_multiple_of(2) { [0.2, -0.1, 0.3] } else { [-0.3, 0.15, -0.2] };
    f.push((n + one * t1 + other * t2).normalize().dot(&tip) - offset);
    // Across the edge: what is left of it without its part along the line, in any base.
    let along = Vector3::new(1.0, 2.0, -2.0) / 3.0;
    let off = tip - Vector3::new(0.5, 0.1, -0.3);
    f.push((off - along * along.dot(&off)).norm());
    f.push((tip - Vector3::new(0.4, -0.2, 0.8)).norm() - (1.02 * a[3] + 0.03));
    let seen = Vector3::from_fn(|k, _| readings.table.columns[k][row]);
    f.extend((tip - seen).iter());
    let tracked = turned([0.5, -0.7, 1.1]) * seen + Vector3::new(0.3, 0.1, -0.4);
    f.extend((tip - tracked).iter());
    let scanned = turned([0.4, -0.5, 0.6]) * seen + Vector3::new(0.1, -0.2, 0.3);
    f.extend((scanned - tip).iter());
    f.push(q[0] - (a[4] - 0.2));
    // The rail leans from its direction as the table from its normal; its foot is two offsets from the
    // origin, along what is left of the first of the axes across it, and across both.
    let [t1, t2, offset1, offset2] = RAILS[row % 3 % 2];
    let n = Vector3::new(0.3, 1.0, 0.2).normalize();
    let one = (Vector3::z() - n * n.z).normalize();
    let along = (n + one * t1 + n.cross(&one) * t2).normalize();
    let u = (one - along * along.dot(&one)).normalize();
    let v = along.cross(&u);
    let off = tip - (u * offset1 + v * offset2) - along * 7.0;
    f.extend([off.dot(&u), off.dot(&v)]);
    f
}

#[test]
fn every_kind_agrees_with_plain_products() {
    let mechanism = Mechanism::from_toml(ARM).expect("the arm");
    let readings = anywhere(&mechanism, 21);
    let model = Model::new(&mechanism, &readings, Vec::new()).expect("a model");
    let beta = unknowns(&model);
    for (block, meta) in readings.blocks().iter().enumerate() {
        let ws = evaluated(&model, &readings, block, readings.raw(block), &beta);
        for (lane, &row) in meta.rows[..meta.live].iter().enumerate() {
            let mut own: Vec<f64> = ws.f.iter().map(|f| f.0[lane]).collect();
            // Two equations across the line, in a base of their own.
            let across = own.remove(3).hypot(own[2]);
            own[2] = across;
            let expected = plain(&readings, row);
            assert_eq!(own.len(), expected.len());
            for (k, (own, expected)) in own.iter().zip(expected).enumerate() {
                assert!((own - expected).abs() < 1e-13, "equation {k}: {own} for {expected}");
            }
        }
    }
}

#[test]
fn derivatives_of_every_kind_agree_with_differences() {
    let mechanism = Mechanism::from_toml(ARM).expect("the arm");
    let readings = anywhere(&mechanism, 21);
    let terms = [
        "offset",
        "gain",
        "curvature",
        "link_length",
        "distance",
        "plane_bend",
        "line_bend",
        "stretch",
    ];
    let specs = terms.map(String::from);
    let mut all = parse(&mechanism, &readings, &specs).expect("terms");
    for once in ["distance_slip", "plane_slip", "line_slip", "point_slip"] {
        all.extend(instances(find(once).expect("a term"), &mechanism, &readings));
    }
    let model = Model::new(&mechanism, &readings, all).expect("a model");
    let mut beta = unknowns(&model);
    let mut rng = Rng::new(8);
    beta[..model.term_parameters].iter_mut().for_each(|p| *p = rng.uniform(0.02, 0.1));
    check_parameters(&model, &readings, &beta, 0..model.parameters);
    check_readings(&model, &readings, &beta);
}

/// Misclosures with one term more, less those without it: of each row, equation by equation.
fn change(instance: Instance, mechanism: &Mechanism, values: &[f64]) -> Vec<Vec<f64>> {
    let readings = anywhere(mechanism, 21);
    let misclosures = |own: Vec<Instance>, values: &[f64]| {
        let model = Model::new(mechanism, &readings, own).expect("a model");
        let mut beta = unknowns(&model);
        beta[..values.len()].copy_from_slice(values);
        let mut rows = vec![Vec::new(); readings.samples];
        for (block, meta) in readings.blocks().iter().enumerate() {
            let ws = evaluated(&model, &readings, block, readings.raw(block), &beta);
            for (lane, &row) in meta.rows[..meta.live].iter().enumerate() {
                rows[row] = ws.f.iter().map(|f| f.0[lane]).collect();
            }
        }
        rows
    };
    let (with, without) = (misclosures(vec![instance], values), misclosures(Vec::new(), &[]));
    let less = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
    with.iter().zip(&without).map(less).collect()
}

#[test]
fn a_point_that_moved_once_is_elsewhere_from_its_pose_on() {
    let mechanism = Mechanism::from_toml(ARM).expect("the arm");
    let term = find("point_slip").expect("the term");
    let by = [0.1, -0.2, 0.3];
    // Of these the first equation, and the sign: what is seen is the second end, or the first.
    for (name, first, sign) in
        [("tip seen", 5, -1.0), ("tip tracked", 8, -1.0), ("tip scanned", 11, 1.0)]
    {
        let closure = mechanism.closures.iter().position(|c| c.name == name).expect("a closure");
        let instance = Instance { term, target: Target::Closure(closure), place: 9 };
        for (row, changed) in change(instance, &mechanism, &by).iter().enumerate() {
            for (equation, changed) in changed.iter().enumerate() {
                let own = equation.checked_sub(first).and_then(|axis| by.get(axis));
                let expected = own.filter(|_| row >= 9).map_or(0.0, |by| sign * by);
                assert!((changed - expected).abs() < 1e-13, "{name}, {row}, {equation}: {changed}");
            }
        }
    }
}

#[test]
fn a_rail_that_sags_or_was_pushed_is_elsewhere_along_itself() {
    let mechanism = Mechanism::from_toml(ARM).expect("the arm");
    let readings = anywhere(&mechanism, 21);
    let closure = mechanism.closures.iter().position(|c| c.name == "on rail").expect("a closure");
    let along = Vector3::new(0.3, 1.0, 0.2).normalize();
    let reached: Vec<f64> =
        (0..readings.samples).map(|row| tip_of(&readings, row).1.dot(&along)).collect();
    // From the middle of all places of a rail to half their extent.
    let place = |row: usize| {
        let own = (0..readings.samples).filter(|other| other % 3 % 2 == row % 3 % 2);
        let (low, high) = own.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), other| {
            (low.min(reached[other]), high.max(reached[other]))
        });
        (2.0 * reached[row] - low - high) / (high - low)
    };
    let changed = |id: &str, values: &[f64]| {
        let term = find(id).expect("the term");
        change(Instance { term, target: Target::Closure(closure), place: 9 }, &mechanism, values)
    };
    let (bent, pushed) =
        (changed("line_bend", &[0.1, -0.2]), changed("line_slip", &[0.1, -0.2, 0.3, 0.4]));
    for row in 0..readings.samples {
        let u = place(row);
        let sag = [-0.1 * u * u, 0.2 * u * u];
        let push = [-0.1 - 0.3 * u, 0.2 - 0.4 * u].map(|by| if row < 9 { 0.0 } else { by });
        for (all, expected) in [(&bent[row], sag), (&pushed[row], push)] {
            let (others, own) = all.split_at(all.len() - 2);
            assert!(others.iter().all(|by| *by == 0.0), "{row}: {others:?}");
            let near = own.iter().zip(expected).all(|(own, by)| (own - by).abs() < 1e-13);
            assert!(near, "{row}: {own:?} for {expected:?}");
        }
    }
}

#[test]
fn a_law_of_a_length_a_column_and_a_channel_is_what_its_formula_says() {
    let mechanism = Mechanism::from_toml(ARM).expect("the arm");
    let readings = anywhere(&mechanism, 21);
    let term =
        terms::all(&mechanism).into_iter().find(|t| t.info().id == "stretch").expect("the law");
    let (wire, of_wire) = (3, 4);
    let instance = Instance { term, target: Target::Closure(wire), place: 0 };
    for (row, changed) in change(instance, &mechanism, &[0.03, -0.2]).iter().enumerate() {
        let a = readings.row(row);
        let (length, q1, x) = (1.02 * a[3] + 0.03, a[0] + 0.1, readings.table.columns[0][row]);
        let longer = 0.03 * length * length - 0.2 * x * q1;
        assert!((changed[of_wire] + longer).abs() < 1e-13, "{row}: {} {longer}", changed[of_wire]);
    }
}

#[test]
fn a_name_that_is_no_column_and_no_channel_is_refused_with_its_place() {
    for (text, words) in [
        ("a*length^2 + b*y2*theta[q1]", "character 16: \"y2\""),
        ("a*length^2 + b*x*theta[q9]", "character 18: \"theta[q9]\""),
        ("a*length^2 + b*x*theta[]", "a whole number, or a name"),
    ] {
        let refused = Mechanism::from_toml(&ARM.replace("a*length^2 + b*x*theta[q1]", text));
        let message = refused.expect_err("no such name").to_string();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn terms_of_a_known_plane_and_line_agree_with_differences() {
    for kind in [ClosureKind::Plane, ClosureKind::Line] {
        let device = on_surface(kind, How::Held, 6);
        let readings = device.readings();
        let word = if kind == ClosureKind::Plane { "plane" } else { "line" };
        let terms = [format!("{word}_bend"), format!("{word}_slip")];
        let (all, values) = device.terms(&readings, &["offset", &terms[0], &terms[1]], 4);
        let (model, beta) = device.model(&readings, &all, &values);
        check_parameters(&model, &readings, &beta, 0..model.parameters);
    }
}

// --- a body that is elsewhere in each pose -----------------------------------

#[test]
fn a_joint_of_a_plate_that_sits_elsewhere_moves_along_the_axes_of_the_plate() {
    let device = plate(How::Held, 3);
    let readings = device.readings();
    let (all, values) = device.terms(&readings, &["attachment_position"], 4);
    let (model, beta) =
        device.model(&readings, &all, &values.iter().map(|v| 10.0 * v).collect::<Vec<_>>());
    let moved: Vec<[f64; 3]> = beta.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
    assert_eq!(moved.len(), device.mechanism.closures.len());
    for (block, meta) in readings.blocks().iter().enumerate() {
        let at = placed(&model, &readings, block, &beta);
        let ws = evaluated(&model, &readings, block, &at, &beta);
        for (lane, &row) in meta.rows[..meta.live].iter().enumerate() {
            let pose = std::array::from_fn(|k| ws.xi[k].0[lane]);
            let long = lengths(&device.mechanism, &pose, &moved);
            for ((f, long), read) in ws.f.iter().zip(long).zip(legs(&device, readings.row(row))) {
                let off = f.0[lane] - (long - read);
                assert!(off.abs() < 1e-13, "{row}: {} for {}", f.0[lane], long - read);
            }
        }
    }
    check_parameters(&model, &readings, &beta, 0..model.parameters);
    check_readings(&model, &readings, &beta);
}

#[test]
fn a_joint_of_a_plate_that_was_knocked_sits_elsewhere_from_its_pose_on() {
    let device = plate(How::Held, 3);
    let readings = device.readings();
    let (place, slip) = (readings.poses() / 2, [0.02, -0.03, 0.05]);
    let (mut all, values) = device.terms(&readings, &["attachment_position"], 4);
    let knocked = 1;
    let term = find("attachment_slip").expect("the term");
    all.push(Instance { term, target: Target::Closure(knocked), place });
    let (model, beta) = device.model(&readings, &all, &[values, slip.to_vec()].concat());
    let sits: Vec<[f64; 3]> =
        beta[..beta.len() - 3].chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let at = placed(&model, &readings, block, &beta);
        let ws = evaluated(&model, &readings, block, &at, &beta);
        for (lane, &row) in meta.rows[..meta.live].iter().enumerate() {
            let mut moved = sits.clone();
            if readings.pose[row] >= place {
                moved[knocked].iter_mut().zip(slip).for_each(|(at, by)| *at += by);
            }
            let pose = std::array::from_fn(|k| ws.xi[k].0[lane]);
            let long = lengths(&device.mechanism, &pose, &moved);
            for ((f, long), read) in ws.f.iter().zip(long).zip(legs(&device, readings.row(row))) {
                let off = f.0[lane] - (long - read);
                assert!(off.abs() < 1e-13, "{row}: {} for {}", f.0[lane], long - read);
            }
        }
    }
    check_parameters(&model, &readings, &beta, 0..model.parameters);
    check_readings(&model, &readings, &beta);
}

/// What the channels of a plate read, as lengths.
fn legs(device: &Device, row: &[f64]) -> Vec<f64> {
    device.mechanism.channels.iter().zip(row).map(|(c, read)| c.gain * read + c.offset).collect()
}

/// The least half sum of squares of what legs miss their readings by, over all poses of the plate, by
/// Gauss-Newton in plain products.
fn nearest_plate(device: &Device, row: &[f64], moved: &[[f64; 3]], sigma: f64) -> f64 {
    let (mechanism, read) = (&device.mechanism, legs(device, row));
    let mut pose = mechanism.frames[0].pose.expect("drawn");
    let missed = |pose: &[f64; 6]| {
        let long = lengths(mechanism, pose, moved);
        DVector::from_fn(read.len(), |k, _| (long[k] - read[k]) / sigma)
    };
    for _ in 0..12 {
        let slope = DMatrix::from_columns(&std::array::from_fn::<_, 6, _>(|k| {
            let along = |by: f64| {
                let mut pose = pose;
                pose[k] += by;
                missed(&pose).as_slice().to_vec()
            };
            DVector::from_vec(derivative(along, 1e-3))
        }));
        let normal = slope.transpose() * &slope;
        let step =
            normal.lu().solve(&(slope.transpose() * missed(&pose))).expect("six coordinates");
        pose.iter_mut().zip(step.iter()).for_each(|(own, step)| *own -= step);
    }
    0.5 * missed(&pose).norm_squared()
}

#[test]
fn the_slope_by_a_joint_of_a_plate_is_exact_where_its_poses_have_settled() {
    let mut device = plate(How::Held, 3);
    let (counts, mut rng) = (1.0, Rng::new(8));
    device.table.values.iter_mut().for_each(|read| *read += counts * rng.normal());
    let sigma = counts * device.mechanism.channels[0].gain;
    let readings = device.readings();
    let (all, values) = device.terms(&readings, &["attachment_position"], 4);
    let (model, beta) = device.model(&readings, &all, &values);
    let part = Part { model: &model, readings: &readings, weights: None };
    let noise = Noise::declared(vec![counts; readings.channels]);
    let found = Implicit::new(vec![(part, noise)], &[]).linearize(&beta);
    let cost = |beta: &[f64]| -> f64 {
        let moved: Vec<[f64; 3]> = beta.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
        let rows = 0..readings.samples;
        rows.map(|r| nearest_plate(&device, readings.row(r), &moved, sigma)).sum()
    };
    let plain = cost(&beta);
    // Both stand still to 1e-6 of their deviation, where the cost is flat.
    assert!((found.cost - plain).abs() < 1e-9 * plain, "{} for {plain}", found.cost);
    let k = 4;
    let along = |by: f64| {
        let mut beta = beta.clone();
        beta[k] += by;
        vec![cost(&beta)]
    };
    let difference = derivative(along, 1e-3)[0];
    let off = (found.gradient[k] - difference).abs();
    assert!(off < 1e-7 * difference.abs(), "{} {difference}", found.gradient[k]);
}

#[test]
fn an_instrument_that_was_knocked_and_reads_long_sees_marks_elsewhere() {
    let device = watched_plate(How::Held, 3);
    let readings = device.readings();
    let term = find("frame_slip").expect("the term");
    let look = device.mechanism.closures.iter().position(|c| c.name == "look0").expect("a look");
    let own = |place| Instance { term, target: Target::Closure(look), place };
    // Two knocks, one after the other.
    let knocks =
        [(9, [0.02, -0.03, 0.01, 4e-3, -3e-3, 5e-3]), (15, [0.01, 0.015, -0.02, 0.1, 0.2, -0.1])];
    let scale = find("instrument_scale").expect("the term");
    let scale = Instance { term: scale, target: Target::Closure(look), place: 0 };
    let instances = knocks.map(|(place, _)| own(place));
    let long = 0.013;
    let (model, beta) = device.model(
        &readings,
        &[&instances[..], &[scale]].concat(),
        &[&knocks.map(|(_, by)| by).concat()[..], &[long]].concat(),
    );
    let stands = Vector3::from_row_slice(&INSTRUMENT[..3]);
    let legs = device.mechanism.channels.len();
    let about = |pose: &[f64; 6]| turned([pose[3], pose[4], pose[5]]);
    for (block, meta) in readings.blocks().iter().enumerate() {
        let at = placed(&model, &readings, block, &beta);
        let ws = evaluated(&model, &readings, block, &at, &beta);
        for (lane, &row) in meta.rows[..meta.live].iter().enumerate() {
            let pose: [f64; 6] = std::array::from_fn(|k| ws.xi[k].0[lane]);
            for (k, mark) in (0..3).map(|k| (k, format!("mark{k}"))) {
                let mut points = device.mechanism.points.iter();
                let mark = points.find(|p| p.name == mark).and_then(|p| p.at).expect("drawn");
                let there =
                    about(&pose) * Vector3::from(mark) + Vector3::from_row_slice(&pose[..3]);
                let read = Vector3::from_fn(|axis, _| readings.table.columns[3 * k + axis][row]);
                let after = knocks.iter().filter(|(place, _)| readings.pose[row] >= *place);
                let moved = after.fold(read * (1.0 + long), |sum, (_, by)| {
                    sum + about(by) * read - read + Vector3::from_row_slice(&by[..3])
                });
                let seen = about(&INSTRUMENT) * moved + stands;
                for axis in 0..3 {
                    let off = ws.f[legs + 3 * k + axis].0[lane] - (there - seen)[axis];
                    assert!(off.abs() < 1e-12, "row {row}, mark {k}, {axis}: {off}");
                }
            }
        }
    }
    check_parameters(&model, &readings, &beta, 0..model.parameters);
}

// --- what is unknown in one pose alone -------------------------------------

const BELTS: &str = r#"
name = "sled"
length_unit = "mm"
channel = [
  {name = "tl", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.4},
  {name = "tr", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.6},
  {name = "bl", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.4},
  {name = "br", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.4},
]
point = [
  {name = "sled", unknown = ["pose"], at = [1500.0, 1000.0, 0.0], free = ["x", "y"]},
  {name = "top left", unknown = [], at = [0.0, 2000.0, 100.0], free = ["x", "y"]},
  {name = "top right", unknown = [], at = [3000.0, 2000.0, 56.0], free = ["x", "y"]},
  {name = "bottom left", at = [0.0, 0.0, 34.0]},
  {name = "bottom right", unknown = [], at = [3000.0, 0.0, 78.0], free = ["x"]},
]
closure = [
  {name = "belt tl", kind = "distance", between = ["sled", "top left"], channel = "tl", noise = 0.8},
  {name = "belt tr", kind = "distance", between = ["sled", "top right"], channel = "tr", noise = 0.8},
  {name = "belt bl", kind = "distance", between = ["sled", "bottom left"], channel = "bl", noise = 0.8},
  {name = "belt br", kind = "distance", between = ["sled", "bottom right"], channel = "br", noise = 1.6},
]
[model]
terms = []
"#;

/// Variances of the four belts: their readings' and their own.
const VARIANCES: [f64; 4] = [0.16 + 0.64, 0.36 + 0.64, 0.16 + 0.64, 0.16 + 2.56];

/// Where the anchors are, and the sled in its poses.
fn frame(size: f64) -> ([Vector3<f64>; 4], Vec<Vector3<f64>>) {
    let anchors = [
        Vector3::new(-12.0, 2010.0, 100.0),
        Vector3::new(2990.0, 2025.0, 56.0),
        Vector3::new(0.0, 0.0, 34.0),
        Vector3::new(3015.0, 0.0, 78.0),
    ];
    let anchors = anchors.map(|a| Vector3::new(a.x * size, a.y * size, a.z));
    let grid = |n: usize, count: usize| (n as f64 + 0.5) / count as f64;
    let place = |k: usize| {
        Vector3::new(600.0 + 1800.0 * grid(k % 6, 6), 500.0 + 1000.0 * grid(k / 6, 4), 0.0)
    };
    (anchors, (0..24).map(|k| place(k) * size).collect())
}

/// Readings of the belts of a frame, with so many standard deviations of noise.
fn belts(mechanism: &Mechanism, size: f64, noise: f64) -> Readings {
    let (anchors, places) = frame(size);
    let mut rng = Rng::new(11);
    let mut values = Vec::new();
    for place in &places {
        for (anchor, variance) in anchors.iter().zip(VARIANCES) {
            values.push((place - anchor).norm() + noise * variance.sqrt() * rng.normal());
        }
    }
    let pose = Some((1..=places.len() as i64).collect());
    Readings::new(mechanism, Table { values, pose, ..Table::default() }).expect("readings")
}

fn noise() -> Noise {
    Noise::declared(vec![0.4, 0.6, 0.4, 0.4])
}

/// The parameters: four coordinates of the upper anchors and one of the lower right.
fn anchors_of(beta: &[f64]) -> [Vector3<f64>; 4] {
    [
        Vector3::new(beta[0], beta[1], 100.0),
        Vector3::new(beta[2], beta[3], 56.0),
        Vector3::new(0.0, 0.0, 34.0),
        Vector3::new(beta[4], 0.0, 78.0),
    ]
}

/// The place of the sled and the least half sum of squares, by Gauss-Newton in plain products.
fn nearest(row: &[f64], anchors: &[Vector3<f64>; 4], variances: &[f64; 4]) -> (Vector3<f64>, f64) {
    let mut at = Vector3::new(1500.0, 1000.0, 0.0);
    let residual = |at: &Vector3<f64>| {
        DVector::from_fn(4, |k, _| ((at - anchors[k]).norm() - row[k]) / variances[k].sqrt())
    };
    for _ in 0..40 {
        let slope = DMatrix::from_fn(4, 2, |k, axis| {
            let off = at - anchors[k];
            off[axis] / off.norm() / variances[k].sqrt()
        });
        let normal = slope.transpose() * &slope;
        let step = normal.lu().solve(&(slope.transpose() * residual(&at))).expect("two directions");
        at -= Vector3::new(step[0], step[1], 0.0);
    }
    (at, 0.5 * residual(&at).norm_squared())
}

fn belt_model() -> (Mechanism, Readings, Model) {
    let mechanism = Mechanism::from_toml(BELTS).expect("belts");
    let readings = belts(&mechanism, 1.0, 4.0);
    let model = Model::new(&mechanism, &readings, Vec::new()).expect("a model");
    (mechanism, readings, model)
}

const ANCHORS: [f64; 5] = [-30.0, 1990.0, 3020.0, 2040.0, 2980.0];

#[test]
fn the_cost_is_the_least_over_the_places_of_every_pose() {
    let (_, readings, model) = belt_model();
    assert_eq!((model.rows(), model.equations(), model.pose_unknowns()), (4, 2, 2));
    let part = Part { model: &model, readings: &readings, weights: None };
    let implicit = Implicit::new(vec![(part, noise())], &[]);
    let found = implicit.linearize(&ANCHORS);
    let anchors = anchors_of(&ANCHORS);
    let rows = 0..readings.samples;
    let plain: f64 = rows.map(|r| nearest(readings.row(r), &anchors, &VARIANCES).1).sum();
    // Both places stand still to 1e-6 of their deviation, where the cost is flat.
    assert!((found.cost - plain).abs() < 1e-9 * plain, "{} for {plain}", found.cost);
    // The residuals make up that cost, two for each sample.
    let left = implicit.residuals(&ANCHORS, true);
    assert_eq!((left.equations, left.whitened.len()), (2, 2 * readings.samples));
    let half: f64 = left.whitened.iter().map(|r| 0.5 * r * r).sum();
    assert!((half - plain).abs() < 1e-9 * plain);
}

#[test]
fn the_gradient_is_exact_where_the_places_have_settled() {
    let (_, readings, model) = belt_model();
    let part = Part { model: &model, readings: &readings, weights: None };
    let implicit = Implicit::new(vec![(part, noise())], &[]);
    let found = implicit.linearize(&ANCHORS);
    let cost = |beta: &[f64]| -> f64 {
        let anchors = anchors_of(beta);
        (0..readings.samples).map(|r| nearest(readings.row(r), &anchors, &VARIANCES).1).sum()
    };
    for k in 0..5 {
        let along = |by: f64| {
            let mut beta = ANCHORS;
            beta[k] += by;
            vec![cost(&beta)]
        };
        let difference = derivative(along, 0.1)[0];
        // Rounding of a cost of 1e4 over 0.1: 1e-10 of it.
        let off = (found.gradient[k] - difference).abs();
        assert!(off < 1e-7 * difference.abs().max(1.0), "{k}: {} {difference}", found.gradient[k]);
    }
}

#[test]
fn a_belt_machine_starts_from_a_drawing_of_twice_its_size() {
    let mechanism = Mechanism::from_toml(BELTS).expect("belts");
    for size in [0.5, 1.0, 1.6] {
        let readings = belts(&mechanism, size, 1.0);
        let options = FitOptions { terms: Some(Vec::new()), ..FitOptions::default() };
        let all =
            Observations::new(&mechanism, readings.table.clone(), None, options).expect("all");
        let found = fit(&all, Vec::new(), None).expect("a fit");
        let (anchors, _) = frame(size);
        let truth = [anchors[0].x, anchors[0].y, anchors[1].x, anchors[1].y, anchors[3].x];
        for (k, (own, truth)) in found.beta.iter().zip(truth).enumerate() {
            let sd = found.covariance[(k, k)].sqrt();
            // Five of these in three sessions: beyond 4.5 in one of a hundred thousand.
            assert!((own - truth).abs() < 4.5 * sd, "{size}, {k}: {own} for {truth}, sd {sd}");
        }
        assert!(found.dof == 2.0 * 24.0 - 5.0 && found.chi2 < 90.0, "{} {}", found.chi2, found.dof);
    }
}

#[test]
fn of_two_mirror_places_the_one_near_where_it_is_looked_for_is_taken() {
    for (y, expected) in [("300.0", 800.0), ("3700.0", 3200.0)] {
        let text = BELTS.replace("at = [1500.0, 1000.0, 0.0]", &format!("at = [1500.0, {y}, 0.0]"));
        // Two belts alone, to anchors at one height.
        let mut mechanism = Mechanism::from_toml(&text).expect("belts");
        mechanism.closures.truncate(2);
        mechanism.channels.truncate(2);
        let long = |z: f64| (1500.0_f64.powi(2) + 1200.0_f64.powi(2) + z * z).sqrt();
        let table = Table { values: vec![long(100.0), long(56.0)], ..Table::default() };
        let readings = Readings::new(&mechanism, table).expect("one row");
        let model = Model::new(&mechanism, &readings, Vec::new()).expect("a model");
        let mut ws = Workspace::default();
        let bare = Want { x: false, a: false };
        model.evaluate(&readings, 0, readings.raw(0), &model.nominal(), bare, &mut ws);
        assert!((ws.xi[1].0[0] - expected).abs() < 1e-6, "{} for {expected}", ws.xi[1].0[0]);
        assert_eq!(model.equations(), 0);
    }
}

#[test]
fn a_direction_that_no_closure_tells_takes_no_equation() {
    // On the line between its two anchors a sled may move across without a change of any length.
    let mut mechanism = Mechanism::from_toml(BELTS).expect("belts");
    mechanism.closures.truncate(2);
    mechanism.channels.truncate(2);
    for point in &mut mechanism.points {
        let at = point.at.expect("all are drawn");
        point.at = Some([at[0], 2000.0, 0.0]);
    }
    let table = Table { values: vec![1200.0, 1800.0, 700.0, 2300.0], ..Table::default() };
    let readings = Readings::new(&mechanism, table).expect("two rows");
    let model = Model::new(&mechanism, &readings, Vec::new()).expect("a model");
    assert_eq!((model.rows(), model.pose_unknowns(), model.equations()), (2, 1, 1));
}

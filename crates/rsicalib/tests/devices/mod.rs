//! Devices to test on: the hand controller, and mechanisms drawn at random.
//!
//! Shared by `tests/*.rs` and by the laws of the terms, which is why names come
//! from `super`: whoever includes this file says whether that is the crate or
//! its user.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};
use rsicalib::mechanism::{
    Chain, Channel, Closure, ClosureKind, Frame, Line, Mechanism, Motion, Plane, Point, Row,
    Target, Value, hand_controller,
};
use rsicalib::model::{Instance, Model, Want, Workspace};
use rsicalib::numerics::lanes::{Lanes, WIDTH};
use rsicalib::readings::{Readings, Table};
use rsicalib::terms::term::Term;
use rsicalib::terms::{self, targets};

pub use plate::plate;
pub use rng::Rng;

pub mod plate;
mod rng;

/// How the readings were taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// Held poses in any order, each sampled twice.
    Held,
    /// One recording of a smooth motion.
    Moving,
}

/// A mechanism, and readings that close its loops as it is drawn.
#[derive(Debug, Clone)]
pub struct Device {
    /// The mechanism.
    pub mechanism: Mechanism,
    /// Readings, with time and temperature.
    pub table: Table,
    /// Where its unknown points are.
    pub points: Vec<f64>,
}

impl Device {
    /// The readings, checked.
    pub fn readings(&self) -> Readings {
        Readings::new(&self.mechanism, self.table.clone()).expect("the table fits the mechanism")
    }

    /// The model of some terms, and all its parameters: theirs, and the points.
    pub fn model(
        &self,
        readings: &Readings,
        instances: &[Instance],
        terms: &[f64],
    ) -> (Model, Vec<f64>) {
        let model = Model::new(&self.mechanism, readings, instances.to_vec()).expect("provided");
        let beta = [terms, &self.points].concat();
        assert_eq!(beta.len(), model.parameters);
        (model, beta)
    }

    /// Terms at all their targets, where they can be, with one to two typical
    /// sizes of each parameter.
    pub fn terms(&self, readings: &Readings, ids: &[&str], seed: u64) -> (Vec<Instance>, Vec<f64>) {
        let (mut all, mut values) = (Vec::new(), Vec::new());
        let mut rng = Rng::new(seed);
        for term in ids.iter().map(|id| terms::find(id).expect("a term")) {
            if targets::provided(term, &self.mechanism, readings).is_ok() {
                for instance in instances(term, &self.mechanism, readings) {
                    values.extend(sizes(&instance, &self.mechanism, &mut rng));
                    all.push(instance);
                }
            }
        }
        (all, values)
    }

    /// Moves the readings until they close the loops under some terms.
    ///
    /// Velocities, directions and spans follow the readings, so this repeats
    /// until both stand still. A row between two directions of approach never
    /// does, nor one at which a load changes its side: it is moved away. False
    /// where some pose cannot be assembled.
    #[must_use]
    pub fn closes(&mut self, instances: &[Instance], terms: &[f64]) -> bool {
        let gains: Vec<f64> = self.mechanism.channels.iter().map(|c| c.gain).collect();
        for round in 1..=60 {
            // A drawing may close beyond the range of a channel.
            let Ok(readings) = Readings::new(&self.mechanism, self.table.clone()) else {
                return false;
            };
            let (model, beta) = self.model(&readings, instances, terms);
            let Some((values, open)) = assemble(&model, &readings, &beta) else { return false };
            if open.contains(&true) && (instances.is_empty() || round == 20) {
                return false;
            }
            let rows = values.chunks_exact(gains.len()).zip(&open);
            let mut settled = true;
            for (old, (new, open)) in self.table.values.chunks_exact_mut(gains.len()).zip(rows) {
                let pairs = old.iter().zip(new).zip(&gains);
                let step = pairs.fold(0.0, |m: f64, ((a, b), k)| ((a - b) * k).abs().max(m));
                settled &= step < 1e-12 && !open;
                let nudge = if *open || (round % 10 == 0 && step > 1e-5) { 0.02 } else { 0.0 };
                for (old, (new, k)) in old.iter_mut().zip(new.iter().zip(&gains)) {
                    *old = new + nudge / k;
                }
            }
            if settled {
                return true;
            }
        }
        false
    }
}

/// Readings nearest to those given that close the loops, by Newton's method, and which rows still
/// do not: out of reach, or between two sides. None where a pose is stretched.
fn assemble(model: &Model, readings: &Readings, beta: &[f64]) -> Option<(Vec<f64>, Vec<bool>)> {
    let (k, c) = (model.equations(), readings.channels);
    let mut values = readings.table.values.clone();
    let mut open = vec![false; readings.samples];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let mut a: Vec<Lanes> = readings.raw(block).to_vec();
        let mut longest = [f64::INFINITY; WIDTH];
        for _ in 0..60 {
            model.evaluate(readings, block, &a, beta, Want { x: false, a: true }, &mut ws);
            for (lane, longest) in longest.iter_mut().enumerate() {
                // One radian of each joint, in readings, as its unit.
                let unit = |j: usize| 1.0 / model.scales[j].gain;
                let f = DVector::from_fn(k, |i, _| ws.f[i].0[lane]);
                let g = DMatrix::from_fn(k, c, |i, j| ws.a[i * c + j].0[lane] * unit(j));
                let lambda = (&g * g.transpose()).cholesky()?.solve(&f);
                let step = g.transpose() * lambda;
                let short = (0.2 / step.amax()).min(1.0);
                *longest = step.amax();
                for j in 0..c {
                    a[j].0[lane] -= step[j] * unit(j) * short;
                }
            }
            if longest.iter().all(|step| *step < 1e-14) {
                break;
            }
        }
        if longest.iter().any(|step| step.is_nan()) {
            return None;
        }
        for (row, lane) in meta.rows.iter().zip(0..meta.live) {
            for j in 0..c {
                values[row * c + j] = a[j].0[lane];
            }
            open[*row] = longest[lane] >= 1e-11;
        }
    }
    Some((values, open))
}

/// Rows of every device: not a whole number of blocks.
const ROWS: usize = 116;

/// A table of the joint coordinates that `at` gives for each row, with context.
fn table(mechanism: &Mechanism, how: How, mut at: impl FnMut(usize) -> Vec<f64>) -> Table {
    let mut values = Vec::new();
    for row in 0..ROWS {
        let q = at(row);
        values.extend(mechanism.channels.iter().zip(q).map(|(c, q)| (q - c.offset) / c.gain));
    }
    let clock = (0..ROWS).map(|row| 0.02 * row as f64 + 1e-4 * (row % 3) as f64);
    let mut rng = Rng::new(1);
    let mut warm = |row: usize| 21.0 + 2.0 * (row as f64 * 0.071).sin() + 0.05 * rng.normal();
    Table {
        values,
        pose: (how == How::Held).then(|| (0..ROWS).map(|row| 10 + row as i64 / 2).collect()),
        time: Some(clock.collect()),
        temperature: Some((0..ROWS).map(&mut warm).collect()),
        ..Table::default()
    }
}

/// `n` numbers in -1 … 1: drawn anew for each held pose, or smooth in time.
fn wander(rng: &mut Rng, how: How, n: usize) -> impl FnMut(usize) -> Vec<f64> + use<> {
    let pace: Vec<[f64; 2]> =
        (0..n).map(|_| [rng.uniform(0.05, 0.11), rng.uniform(-PI, PI)]).collect();
    let mut rng = Rng::new(rng.uniform(0.0, 1e9) as u64);
    move |row| match how {
        How::Held => (0..n).map(|_| rng.uniform(-1.0, 1.0)).collect(),
        How::Moving => pace.iter().map(|[w, phase]| (w * row as f64 + phase).sin()).collect(),
    }
}

/// The hand controller, moved about within ±2 in and ±0.45 rad.
pub fn hand_controller(how: How, seed: u64) -> Device {
    let mechanism = Mechanism::rsi();
    let mut wander = wander(&mut Rng::new(seed), how, 6);
    // A recording may not skip what is out of reach, so it keeps to the middle.
    let reach = if how == How::Held { 1.0 } else { 0.7 };
    let table = table(&mechanism, how, |row| {
        loop {
            let w = wander(row).into_iter().map(|w| w * reach).collect::<Vec<_>>();
            let [x, y, z] = [2.0 * w[0], 2.0 * w[1], -2.9 + 1.6 * w[2]];
            let pose = [x, y, z, 0.45 * w[3], 0.45 * w[4], 0.45 * w[5]];
            if let Ok(angles) = hand_controller::inverse(&pose) {
                return angles.concat();
            }
            assert!(how == How::Held, "the recording leaves the workspace: {pose:?}");
        }
    });
    Device { mechanism, table, points: Vec::new() }
}

/// A leader and its follower, each with two joints, as parts of their ranges.
pub fn pair(how: How, seed: u64) -> Device {
    let channel = |name: &str| Channel {
        name: name.into(),
        unit: "part".into(),
        range: Some([-1.0, 1.0]),
        gain: 1.0,
        offset: 0.0,
        limits: None,
        ..Mechanism::rsi().channels[0].clone()
    };
    let equal = |name: &str, between: [&str; 2]| Closure {
        name: name.into(),
        kind: ClosureKind::Equal,
        between: between.map(Into::into),
        value: None,
        ..Mechanism::rsi().closures[0].clone()
    };
    let mechanism = Mechanism {
        channels: ["l1", "f1", "l2", "f2"].map(channel).to_vec(),
        closures: vec![equal("one", ["l1", "f1"]), equal("two", ["l2", "f2"])],
        ..empty("pair".into())
    };
    let mut wander = wander(&mut Rng::new(seed), how, 2);
    let table = table(&mechanism, how, |row| {
        let w = wander(row);
        [w[0], w[0], w[1], w[1]].map(|w| 0.6 * w).to_vec()
    });
    Device { mechanism, table, points: Vec::new() }
}

/// A mechanism of 2 to 4 chains: turning and sliding joints, one that another channel turns as
/// well, channels in counts and in radians, masses, distances known and measured, and two unknown points
/// that the last chain touches.
pub fn random(chains: usize, how: How, seed: u64) -> Device {
    first_of(seed, |seed| drawn(chains, how, seed))
}

/// Some drawings cannot be assembled in every pose: drawn again.
fn first_of(seed: u64, drawn: impl Fn(u64) -> Option<Device>) -> Device {
    (0..20).find_map(|n| drawn(seed + 1000 * n)).expect("one of 20 assembles")
}

/// A mechanism of nothing.
fn empty(name: String) -> Mechanism {
    Mechanism {
        name,
        gravity: Some([0.3, -0.2, -0.9]),
        platform: Default::default(),
        rest: None,
        workspace: None,
        channels: Vec::new(),
        chains: Vec::new(),
        points: Vec::new(),
        closures: Vec::new(),
        ..Mechanism::rsi()
    }
}

fn drawn(chains: usize, how: How, seed: u64) -> Option<Device> {
    let mut rng = Rng::new(seed);
    let mut mechanism = empty(format!("random {seed}"));
    let mut centre = Vec::new();
    for k in 0..chains {
        let joints = if k + 1 == chains { 6 } else { 4 };
        let chain = random_chain(&mut rng, &mut mechanism, k, joints, &mut centre);
        mechanism.chains.push(chain);
        mechanism.points.push(point(&mut rng, &format!("tip{k}"), Some(k)));
    }
    mechanism.points.push(point(&mut rng, "side", Some(0)));
    mechanism.points.push(point(&mut rng, "post", None));
    let socket =
        Point { name: "socket".into(), unknown: Some(vec!["at".into()]), ..Point::default() };
    mechanism.points.push(socket);

    let distance = |a: &str, b: &str| Closure {
        name: format!("{a}-{b}"),
        kind: ClosureKind::Distance,
        between: [a.into(), b.into()],
        value: Some(Value::Known(1.0)),
        noise: Some(2e-3),
        ..Closure::default()
    };
    for k in 1..chains {
        mechanism.closures.push(distance(&format!("tip{}", k - 1), &format!("tip{k}")));
    }
    mechanism.closures.push(distance("post", "side"));
    let last = format!("tip{}", chains - 1);
    let touch = Closure { kind: ClosureKind::Touch, value: None, ..distance(&last, "socket") };
    mechanism.closures.push(touch);

    // Distances and unknown points as they are in the middle of the readings.
    let middle = places(&mechanism, &centre);
    let aside: Vec<f64> = centre.iter().map(|q| q + rng.uniform(-0.3, 0.3)).collect();
    let tip = chains - 1;
    let points = [middle[tip], places(&mechanism, &aside)[tip]].concat();
    for closure in 0..chains {
        let ends = mechanism.closures[closure].between.clone();
        let [a, b] = ends.map(|name| middle[mechanism.point_index(&name).expect("a point")]);
        let value = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        mechanism.closures[closure].value = Some(Value::Known(value));
    }

    let mut wander = wander(&mut rng, how, centre.len());
    let mut table = table(&mechanism, how, |row| {
        centre.iter().zip(wander(row)).map(|(q, w)| q + 0.35 * w).collect()
    });
    table.keys = vec![(0..ROWS).map(|row| format!("socket{}", row / 4 % 2)).collect()];
    if let Some(Value::Known(value)) = mechanism.closures[0].value {
        mechanism.closures[0].value = Some(Value::Column("bar".into()));
        table.columns = vec![(0..ROWS).map(|r| value * (1.0 + 0.02 * (r as f64).sin())).collect()];
    }
    let mut device = Device { mechanism, table, points };
    device.closes(&[], &[]).then_some(device)
}

/// An arm of six joints whose tip is on a plane or a line that is known, and a bar's length from a post.
pub fn on_surface(kind: ClosureKind, how: How, seed: u64) -> Device {
    first_of(seed, |seed| drawn_on_surface(kind, how, seed))
}

fn drawn_on_surface(kind: ClosureKind, how: How, seed: u64) -> Option<Device> {
    let mut rng = Rng::new(seed);
    let mut mechanism = empty(format!("on a {kind:?} {seed}"));
    let mut centre = Vec::new();
    let chain = random_chain(&mut rng, &mut mechanism, 0, 6, &mut centre);
    mechanism.chains.push(chain);
    for (name, chain) in [("tip", Some(0)), ("side", Some(0)), ("post", None)] {
        mechanism.points.push(point(&mut rng, name, chain));
    }
    let faces: [f64; 3] = std::array::from_fn(|_| rng.uniform(-1.0, 1.0));
    let name = String::from("table");
    if kind == ClosureKind::Line {
        let (at, direction) = (Some([0.0; 3]), Some(faces));
        mechanism.lines.push(Line { name, at, direction, ..Line::default() });
    } else {
        let (normal, offset) = (Some(faces), Some(0.0));
        mechanism.planes.push(Plane { name, normal, offset, ..Plane::default() });
    }
    let closed = |name: &str, kind: ClosureKind, between: [&str; 2]| Closure {
        name: name.into(),
        kind,
        between: between.map(String::from),
        value: (kind == ClosureKind::Distance).then_some(Value::Known(1.0)),
        noise: Some(2e-3),
        ..Closure::default()
    };
    mechanism.closures = vec![
        closed("on table", kind, ["tip", "table"]),
        closed("bar", ClosureKind::Distance, ["side", "post"]),
    ];
    // The surface and the bar as they are in the middle of the readings.
    let middle = places(&mechanism, &centre);
    let [tip, side, post] = [middle[0], middle[1], middle[2]];
    let long = faces.iter().map(|n| n * n).sum::<f64>().sqrt();
    let offset = (0..3).map(|i| faces[i] * tip[i]).sum::<f64>() / long;
    mechanism.planes.iter_mut().for_each(|plane| plane.offset = Some(offset));
    mechanism.lines.iter_mut().for_each(|line| line.at = Some(tip));
    let bar = (0..3).map(|i| (side[i] - post[i]).powi(2)).sum::<f64>().sqrt();
    mechanism.closures[1].value = Some(Value::Known(bar));

    let mut wander = wander(&mut rng, how, centre.len());
    let table = table(&mechanism, how, |row| {
        centre.iter().zip(wander(row)).map(|(q, w)| q + 0.35 * w).collect()
    });
    let mut device = Device { mechanism, table, points: Vec::new() };
    device.closes(&[], &[]).then_some(device)
}

fn random_chain(
    rng: &mut Rng,
    mechanism: &mut Mechanism,
    k: usize,
    joints: usize,
    centre: &mut Vec<f64>,
) -> Chain {
    let bearing = 2.0 * PI * k as f64 / 3.0 + rng.uniform(-0.3, 0.3);
    let foot =
        Row { theta: bearing, a: 3.0, d: rng.uniform(-0.5, 0.5), alpha: 0.6, ..Row::default() };
    let mut rows = vec![foot];
    for j in 0..joints {
        let slides = j == 2 && k.is_multiple_of(2);
        let encoder = j == 1;
        let name = format!("q{}{}", k + 1, j + 1);
        let q = if slides { rng.uniform(0.5, 1.0) } else { rng.uniform(-1.0, 1.0) };
        let gain = match (slides, encoder) {
            (true, _) => 6e-4,
            (_, true) => 1.0,
            _ => rng.uniform(1.2e-3, 1.6e-3) * if j % 2 == 0 { -1.0 } else { 1.0 },
        };
        mechanism.channels.push(Channel {
            name: name.clone(),
            unit: if encoder { "rad" } else { "count" }.into(),
            range: (!encoder).then_some([0.0, 4095.0]),
            gain,
            offset: if encoder { 0.1 } else { q - gain * 2048.0 },
            ..Channel::default()
        });
        centre.push(q);
        rows.push(Row {
            channel: Some(name),
            joint: if slides { Motion::Prismatic } else { Motion::Revolute },
            theta: rng.uniform(-0.5, 0.5),
            d: rng.uniform(-0.4, 0.4),
            a: rng.uniform(0.8, 1.6),
            alpha: rng.uniform(0.4, 1.5) * if j % 2 == 0 { 1.0 } else { -1.0 },
            xyz: std::array::from_fn(|_| if j == 1 { rng.uniform(-0.2, 0.2) } else { 0.0 }),
            rpy: std::array::from_fn(|_| if j == 1 { rng.uniform(-0.5, 0.5) } else { 0.0 }),
            mass: (j != 1).then(|| rng.uniform(0.5, 2.0)),
            com: std::array::from_fn(|_| rng.uniform(-0.5, 0.5)),
            ..Row::default()
        });
    }
    if k == 0 {
        rows.push(geared(&rows[1]));
    }
    Chain { name: format!("chain{}", k + 1), rows }
}

/// A row that bars turn back as another row of its chain turns.
fn geared(other: &Row) -> Row {
    Row { ratio: Some(-0.6), a: 0.7, alpha: 0.3, com: [0.2, -0.1, 0.0], ..other.clone() }
}

fn point(rng: &mut Rng, name: &str, chain: Option<usize>) -> Point {
    Point {
        name: name.into(),
        chain: chain.map(|k| format!("chain{}", k + 1)),
        at: Some(std::array::from_fn(|_| rng.uniform(-1.0, 1.0))),
        ..Point::default()
    }
}

/// Where the known points are, for joint coordinates.
fn places(mechanism: &Mechanism, q: &[f64]) -> Vec<[f64; 3]> {
    let values = mechanism.channels.iter().zip(q).map(|(c, q)| (q - c.offset) / c.gain).collect();
    let keys = vec![vec![String::new()]; mechanism.key_columns().len()];
    let table = Table { values, keys, ..Table::default() };
    let readings = Readings::new(mechanism, table).expect("one row");
    let model = Model::new(mechanism, &readings, Vec::new()).expect("no terms");
    let mut ws = Workspace::default();
    let bare = Want { x: false, a: false };
    model.evaluate(&readings, 0, readings.raw(0), &[0.0; 3], bare, &mut ws);
    let points = model.points(&ws, &[0.0; 3]).into_iter();
    points.map(|p| p.map_or([0.0; 3], |p| p.map(|x| x.0[0]))).collect()
}

/// A term at one target, at the middle one of its places.
pub fn instance(
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
pub fn instances(
    term: &'static dyn Term,
    mechanism: &Mechanism,
    readings: &Readings,
) -> Vec<Instance> {
    let all = targets::targets(term, mechanism).into_iter();
    all.map(|target| instance(term, target, mechanism, readings)).collect()
}

/// One to two typical sizes of each parameter, of either sign.
pub fn sizes(instance: &Instance, mechanism: &Mechanism, rng: &mut Rng) -> Vec<f64> {
    // Typical sizes are meant for 4096 counts; an encoder has other readings. A typical gain is of its readings.
    let counts = match instance.target {
        Target::Channel(c) => mechanism.channels[c].half_range() / 2047.5,
        _ => 1.0,
    };
    let reads_angles = match instance.target {
        Target::Channel(c) => mechanism.channels[c].unit == "rad",
        _ => false,
    };
    let parameters = instance.term.info().parameters.iter();
    let typical = targets::typical(mechanism, &[], instance.term, instance.target);
    parameters
        .zip(typical)
        .map(|(p, typical)| {
            let scale = match p.unit {
                "reading" => counts,
                "rad/reading" if !reads_angles => 1.0 / counts,
                // Rows are 20 ms apart: a slower servo has no readings that the rows about each tell.
                "s^2" => 0.01,
                _ => 1.0,
            };
            typical * scale * rng.uniform(1.0, 2.0) * rng.uniform(-1.0, 1.0).signum()
        })
        .collect()
}

/// Derivative of a vector at zero, by differences.
///
/// Richardson's extrapolation of central differences of step `h` and `h/2`,
/// which errs by `h⁴ f⁽⁵⁾/480` and the rounding of `f` over `h`.
pub fn derivative(mut f: impl FnMut(f64) -> Vec<f64>, h: f64) -> Vec<f64> {
    let mut central = |h: f64| -> Vec<f64> {
        f(h).iter().zip(f(-h)).map(|(plus, minus)| (plus - minus) / (2.0 * h)).collect()
    };
    let (wide, narrow) = (central(h), central(0.5 * h));
    narrow.iter().zip(wide).map(|(n, w)| (4.0 * n - w) / 3.0).collect()
}

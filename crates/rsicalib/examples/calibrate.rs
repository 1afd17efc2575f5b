//! Calibrates a planar four-bar linkage: `cargo run --example calibrate`.
//!
//! A crank of 1 m and a rocker of 2 m turn about two posts that are 3 m apart. A rod of
//! 2.5 m joins their ends, so one equation holds in every pose, eq. (10). Each joint has an
//! encoder; the offsets and the gains of both encoders are unknown. The readings are
//! simulated here, so the estimates can be compared with the truth.

use std::f64::consts::{PI, TAU};

use rsicalib::mechanism::{Chain, Channel, Closure, ClosureKind, Mechanism, Point, Row, Value};
use rsicalib::{Error, FitOptions, Observations, Table, Verdict, calibrate};

const CRANK: f64 = 1.0;
const ROCKER: f64 = 2.0;
const ROD: f64 = 2.5;
const POSTS: f64 = 3.0;

/// Standard deviation of one reading [rad].
const NOISE: f64 = 1e-4;

/// The linkage as drawn: both encoders read the joint angle itself.
fn linkage() -> Mechanism {
    let channel =
        |name: &str| Channel { name: name.into(), noise: Some(NOISE), ..Channel::default() };
    // A fixed row leads from the base to the post; the next row is the joint.
    let chain = |name: &str, post: f64| Chain {
        name: name.into(),
        rows: vec![
            Row { a: post, ..Row::default() },
            Row { channel: Some(name.into()), ..Row::default() },
        ],
    };
    let end = |name: &str, length: f64| Point {
        name: format!("end of {name}"),
        chain: Some(name.into()),
        at: Some([length, 0.0, 0.0]),
        ..Point::default()
    };
    Mechanism {
        name: "four-bar linkage".into(),
        length_unit: "m".into(),
        channels: vec![channel("crank"), channel("rocker")],
        chains: vec![chain("crank", 0.0), chain("rocker", POSTS)],
        points: vec![end("crank", CRANK), end("rocker", ROCKER)],
        closures: vec![Closure {
            name: "rod".into(),
            kind: ClosureKind::Distance,
            between: ["end of crank".into(), "end of rocker".into()],
            value: Some(Value::Known(ROD)),
            ..Closure::default()
        }],
        ..Mechanism::default() // identifies offset and gain of every channel
    }
}

/// The angle of the rocker that closes the loop at an angle of the crank [rad].
fn rocker(crank: f64) -> f64 {
    let (along, up) = (POSTS - CRANK * crank.cos(), CRANK * crank.sin());
    let apart = along.hypot(up);
    let cosine = (apart * apart + ROCKER * ROCKER - ROD * ROD) / (2.0 * apart * ROCKER);
    PI - up.atan2(along) - cosine.acos()
}

/// Numbers between -1 and 1 that are spread evenly: multiples of a root, without the integers.
fn spread(n: usize, prime: f64) -> f64 {
    2.0 * (n as f64 * prime.sqrt()).fract() - 1.0
}

fn main() -> Result<(), Error> {
    // Offset [rad] and gain of each encoder, as they are and not as drawn.
    let truth = [(0.05, 1.01), (-0.03, 0.98)];
    let mut values = Vec::new();
    for n in 0..60 {
        let crank = TAU * n as f64 / 60.0;
        for (c, angle) in [crank, rocker(crank)].into_iter().enumerate() {
            let (offset, gain) = truth[c];
            // Evenly spread errors of this width have the standard deviation NOISE.
            let error = NOISE * 3.0_f64.sqrt() * spread(n + 1, [2.0, 3.0][c]);
            values.push((angle - offset) / gain + error);
        }
    }
    let table = Table { values, pose: Some((0..60).collect()), ..Table::default() };
    let observations = Observations::new(&linkage(), table, None, FitOptions::default())?;
    let report = calibrate(&observations)?;

    let (chi2, dof) = (report.fit.chi2.unwrap_or(f64::NAN), report.fit.dof.unwrap_or(0.0));
    println!("{:?}: χ² {chi2:.1} for {dof} degrees", report.verdict);
    for p in &report.estimates.parameters {
        let sd = p.sd.unwrap_or(f64::INFINITY);
        println!("{:6} of {:6} {:9.5} ± {sd:.5} {}", p.term, p.target, p.value, p.unit);
    }
    assert_eq!(report.verdict, Verdict::Adequate);
    Ok(())
}

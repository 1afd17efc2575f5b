//! Finds an effect that the model lacks: `cargo run --example trace`.
//!
//! The sensor of one joint of the RSI hand controller has a parabolic error. A calibration
//! of offsets and gains leaves a residual above the noise; the search names the effect
//! behind that residual, the channel, and how large the effect is. The readings are
//! simulated here, by the closed forms of the paper.

use rsicalib::mechanism::hand_controller::inverse;
use rsicalib::{
    Error, FitOptions, Mechanism, Observations, SearchOptions, Table, Verdict, calibrate, trace,
};

/// Poses that are held, one after the other; those out of reach are left out.
const POSES: usize = 60;

/// The parabolic error at both ends of the range of channel `a22` [rad].
const ERROR: f64 = 0.2;

/// Numbers between -1 and 1 that are spread evenly: multiples of a root, without the integers.
fn spread(n: usize, prime: f64) -> f64 {
    2.0 * (n as f64 * prime.sqrt()).fract() - 1.0
}

/// Readings in whole counts, row by row, one row per pose and one column per channel.
fn counts(mechanism: &Mechanism) -> Vec<f64> {
    let mut values = Vec::new();
    for n in 1..=POSES {
        let [x, y, z, rx, ry, rz] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0].map(|p| spread(n, p));
        let pose = [1.5 * x, 1.5 * y, 1.3 * z - 2.9, 0.4 * rx, 0.4 * ry, 0.4 * rz];
        let Ok(angles) = inverse(&pose) else { continue };
        for (channel, angle) in mechanism.channels.iter().zip(angles.concat()) {
            let count = (angle - channel.offset) / channel.gain; // (9)
            let u = (count - channel.middle()) / channel.half_range();
            let error = if channel.name == "a22" { ERROR * u * u / channel.gain } else { 0.0 };
            values.push((count - error).round());
        }
    }
    values
}

fn main() -> Result<(), Error> {
    let mechanism = Mechanism::rsi();
    let values = counts(&mechanism);
    let poses = (values.len() / mechanism.channels.len()) as i64;
    let table = Table { values, pose: Some((1..=poses).collect()), ..Table::default() };
    // The only noise is rounding to whole counts: a variance of 1/12 count².
    let noise = mechanism.channels.iter().map(|c| c.quantisation().sqrt()).collect();
    let options = FitOptions { noise: Some(noise), ..FitOptions::default() };
    let observations = Observations::new(&mechanism, table, None, options)?;

    let calibration = calibrate(&observations)?;
    println!("offsets and gains alone: {:?}", calibration.verdict);
    let trace = trace(&observations, &SearchOptions::default())?;
    println!("after the search: {:?}", trace.verdict);
    for step in &trace.steps {
        println!(
            "{} of {}: p {:.1e}, χ² rises by {:.0} without the effect",
            step.term,
            step.target,
            step.p_value,
            step.chi2_rise.unwrap_or(f64::NAN)
        );
        for p in &step.parameters {
            println!("    {} = {:.4} ± {:.4} {}", p.name, p.value, p.sd.unwrap_or(0.0), p.unit);
        }
    }
    assert_eq!(calibration.verdict, Verdict::Unexplained);
    assert_eq!(trace.verdict, Verdict::Explained);
    Ok(())
}

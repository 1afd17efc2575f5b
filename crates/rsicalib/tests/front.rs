//! From a table to a trace, to poses, to a watch, to an update and to a history, with the names at the
//! root alone.

use rsicalib::mechanism::hand_controller::inverse;
use rsicalib::{
    Applied, Error, FitOptions, Mechanism, Monitor, MonitorOptions, Observations, Past,
    SearchOptions, Table, Trace, Verdict, calibrate, course, platform_poses, trace, update,
};

/// Poses within reach, by multiples of roots without their integers, from the `first` on.
fn poses(first: u32, count: u32) -> Vec<[f64; 6]> {
    let pose = |n: u32| {
        let spread = |prime: f64| 2.0 * (f64::from(n) * prime.sqrt()).fract() - 1.0;
        let [x, y, z, rx, ry, rz] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0].map(spread);
        [1.5 * x, 1.5 * y, 1.3 * z - 2.9, 0.4 * rx, 0.4 * ry, 0.4 * rz]
    };
    (first..first + count).map(pose).filter(|pose| inverse(pose).is_ok()).collect()
}

/// Whole counts of a device whose sensor `a22` has a parabolic error, by the paper's closed forms.
fn counts(mechanism: &Mechanism, poses: &[[f64; 6]]) -> Result<Vec<f64>, Error> {
    let mut values = Vec::new();
    for pose in poses {
        for (channel, angle) in mechanism.channels.iter().zip(inverse(pose)?.concat()) {
            let u = (angle - channel.angle(channel.middle())) / 3.0;
            let error = if channel.name == "a22" { 0.2 * u * u } else { 0.0 };
            values.push(((angle - error - channel.offset) / channel.gain).round());
        }
    }
    Ok(values)
}

fn table(values: Vec<f64>) -> Table {
    let pose = Some((0..values.len() as i64 / 9).collect());
    Table { values, pose, ..Table::default() }
}

/// Rows with the sensor of `a13` turned by so many counts.
fn turned(mut values: Vec<f64>, counts: f64) -> Vec<f64> {
    values.chunks_exact_mut(9).for_each(|row| row[2] += counts);
    values
}

/// A session of 60 poses, with the sensor of `a13` turned since the last one.
fn session(mechanism: &Mechanism, first: u32, counts_of_a13: f64) -> Result<Observations, Error> {
    let values = turned(counts(mechanism, &poses(first, 60))?, counts_of_a13);
    let options = FitOptions { noise: Some(vec![0.29; 9]), ..FitOptions::default() }; // rounding
    Observations::new(mechanism, table(values), None, options)
}

fn traced(observations: &Observations) -> Result<Trace, Error> {
    trace(observations, &SearchOptions::default())
}

#[test]
fn from_a_table_to_a_trace_to_poses_to_a_watch() -> Result<(), Error> {
    let mechanism = Mechanism::rsi();
    let observations = session(&mechanism, 1, 0.0)?;
    assert_eq!(calibrate(&observations)?.verdict, Verdict::Unexplained);
    let traced = traced(&observations)?;
    assert_eq!(traced.verdict, Verdict::Explained);

    // Poses that no fit has seen: rounding moves the handle by some thousandths of an inch.
    let elsewhere = poses(1000, 200);
    let later = counts(&mechanism, &elsewhere)?;
    let found = platform_poses(&mechanism, &Applied::from(&traced), table(later.clone()))?;
    for (found, pose) in found.iter().zip(&elsewhere) {
        assert!((0..3).all(|i| (found[i] - pose[i]).abs() < 0.02), "{found:?} at {pose:?}");
    }

    // At work: nothing as long as it stands, then a sensor that has turned by 30 counts.
    let mut monitor = Monitor::of(&mechanism, &traced, &MonitorOptions::default())?;
    assert_eq!(monitor.update_all(&later, None)?, []);
    let alarms = monitor.update_all(&turned(later, 30.0), None)?;
    assert_eq!(alarms.first().map(|alarm| alarm.spec.to_string()), Some("offset@a13".into()));
    Ok(())
}

#[test]
fn from_an_earlier_result_to_an_update() -> Result<(), Error> {
    let mechanism = Mechanism::rsi();
    let earlier = traced(&session(&mechanism, 1, 0.0)?)?;
    let (_, same) = update(&session(&mechanism, 200, 0.0)?, &earlier)?;
    assert!(same.changes.is_empty() && !same.worth, "{}", same.text);
    let (_, moved) = update(&session(&mechanism, 200, 10.0)?, &earlier)?;
    let changed = &moved.changes[0];
    assert_eq!((&*changed.term, &*changed.target), ("offset", "a13"), "{}", moved.text);
    assert!(moved.worth, "{}", moved.text);
    Ok(())
}

#[test]
fn from_results_of_years_to_what_a_parameter_has_done() -> Result<(), Error> {
    let mechanism = Mechanism::rsi();
    let mut offsets = Vec::new(); // of a13, in four sessions a year apart
    for (year, counts) in [0.0, 0.0, 30.0, 30.0].into_iter().enumerate() {
        let result = calibrate(&session(&mechanism, 1 + 100 * year as u32, counts)?)?;
        let all = &result.estimates.parameters;
        let offset = all.iter().find(|p| (&*p.term, &*p.target) == ("offset", "a13"));
        offsets.extend(offset.and_then(|offset| Past::of(365.0 * year as f64, offset)));
    }
    // One parameter is looked at, and no result has told of a change.
    let course = course(&offsets, &[], 1).expect("four dates");
    assert_eq!(course.jumps.iter().map(|jump| jump.from).collect::<Vec<_>>(), [2]);
    Ok(())
}

//! From a table to a trace, to poses and to a watch, with the names at the root alone.

use rsicalib::mechanism::hand_controller::inverse;
use rsicalib::{
    Applied, Error, FitOptions, Mechanism, Monitor, MonitorOptions, Observations, SearchOptions,
    Table, Verdict, calibrate, platform_poses, trace,
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

#[test]
fn from_a_table_to_a_trace_to_poses_to_a_watch() -> Result<(), Error> {
    let mechanism = Mechanism::rsi();
    let (visited, elsewhere) = (poses(1, 60), poses(1000, 200));
    let options = FitOptions { noise: Some(vec![0.29; 9]), ..FitOptions::default() }; // rounding
    let session = table(counts(&mechanism, &visited)?);
    let observations = Observations::new(&mechanism, session, None, options)?;
    assert_eq!(calibrate(&observations)?.verdict, Verdict::Unexplained);
    let traced = trace(&observations, &SearchOptions::default())?;
    assert_eq!(traced.verdict, Verdict::Explained);

    // Poses that no fit has seen: rounding moves the handle by some thousandths of an inch.
    let applied = Applied::from(&traced);
    let later = counts(&mechanism, &elsewhere)?;
    let found = platform_poses(&mechanism, &applied, table(later.clone()))?;
    for (found, pose) in found.iter().zip(&elsewhere) {
        assert!((0..3).all(|i| (found[i] - pose[i]).abs() < 0.02), "{found:?} at {pose:?}");
    }

    // At work: nothing as long as it stands, then a sensor that has turned by 30 counts.
    let covariance = traced.estimates.covariance.concat();
    let watch = MonitorOptions::default();
    let mut monitor = Monitor::new(&mechanism, &applied, &covariance, &watch)?;
    assert_eq!(monitor.update_all(&later, None)?, []);
    let mut turned = later;
    turned.chunks_exact_mut(9).for_each(|row| row[2] += 30.0);
    let alarms = monitor.update_all(&turned, None)?;
    assert_eq!(alarms.first().map(|alarm| alarm.spec.to_string()), Some("offset@a13".into()));
    Ok(())
}

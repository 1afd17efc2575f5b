//! The main path on the hand controller: observations, fit, calibration, trace, verdict.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::devices::{Device, How, Rng, hand_controller};
use rsicalib::diagnosis::options::SearchOptions;
use rsicalib::diagnosis::verdict::Verdict;
use rsicalib::estimate::directions::reported;
use rsicalib::estimate::progress::Progress;
use rsicalib::model::parse;
use rsicalib::report::device::{self, DeviceOptions};
use rsicalib::report::{calibrated, traced};
use rsicalib::{Error, FitOptions, Observations, fit};

/// Standard deviation of one reading [count], declared.
const NOISE: f64 = 0.5;

/// Offsets and gains that are not as drawn, and `curvature` at the ends of a22's range [rad].
fn simulated(curvature: f64) -> (Device, Vec<f64>) {
    let mut device = hand_controller(How::Held, 11);
    // Every row of this device is a pose of its own.
    device.table.pose = Some((0..device.readings().samples as i64).collect());
    let readings = device.readings();
    let specs = ["offset", "gain", "curvature@a22"].map(String::from);
    let instances = parse(&device.mechanism, &readings, &specs).expect("terms");
    let pattern = |c: usize, pace: f64| (pace * c as f64).sin();
    let mut truth: Vec<f64> = (0..9).map(|c| 0.02 * pattern(c, 1.3)).collect();
    truth.extend((0..9).map(|c| 1e-5 * pattern(c, 2.1)));
    truth.push(curvature);
    assert!(device.closes(&instances, &truth), "a pose is out of reach");
    let mut rng = Rng::new(5);
    device.table.values.iter_mut().for_each(|a| *a += NOISE * rng.normal());
    (device, truth)
}

fn observations(device: &Device) -> Observations {
    let options = FitOptions { noise: Some(vec![NOISE; 9]), ..FitOptions::default() };
    Observations::new(&device.mechanism, device.table.clone(), None, options).expect("readings")
}

#[test]
fn a_fit_finds_the_gains_within_its_own_standard_deviations() {
    let (device, truth) = simulated(0.0);
    let observations = observations(&device);
    let instances = observations.instances().expect("offset and gain");
    let fit = fit(&observations, instances, None).expect("enough poses");
    assert!(fit.termination.converged() && fit.plausible);
    let (values, covariance) = reported(&fit);
    for c in 0..9 {
        let gain = device.mechanism.channels[c].gain + truth[9 + c];
        let sd = covariance[(9 + c, 9 + c)].sqrt();
        // Nine normal deviations: one beyond 4.5 in 16,000 fits.
        assert!((values[9 + c] - gain).abs() < 4.5 * sd, "gain {c}: {} ± {sd}", values[9 + c]);
    }
}

#[test]
fn sound_readings_are_adequate_for_both_verbs() {
    let observations = observations(&simulated(0.0).0);
    let (calibration, _) = calibrated::report(&observations, None).expect("a calibration");
    assert_eq!(calibration.verdict, Verdict::Adequate);
    let trace = traced::report(&observations, &SearchOptions::default(), None).expect("a trace");
    assert_eq!(trace.verdict, Verdict::Adequate);
    assert!(trace.steps.is_empty());
}

#[test]
fn a_bent_sensor_is_unexplained_before_the_trace_and_explained_after_it() {
    let curvature = 0.15;
    let observations = observations(&simulated(curvature).0);
    let (calibration, _) = calibrated::report(&observations, None).expect("a calibration");
    assert_eq!(calibration.verdict, Verdict::Unexplained);
    let trace = traced::report(&observations, &SearchOptions::default(), None).expect("a trace");
    assert_eq!(trace.verdict, Verdict::Explained);
    assert_eq!(trace.steps.len(), 1);
    let step = &trace.steps[0];
    assert_eq!(step.target, "a22");
    let named = step.term == "curvature";
    assert!(named || step.also_fits.iter().any(|p| p.term == "curvature"), "{step:?}");
    if named {
        let found = &step.parameters[0];
        let sd = found.sd.expect("determined");
        assert!((found.value - curvature).abs() < 5.0 * sd, "{} ± {sd}", found.value);
    }
}

#[test]
fn a_device_whose_trace_is_ended_has_its_calibration() {
    // The listener is called so often at most; how often it was.
    let report = |most: usize, trace: Option<SearchOptions>| {
        let mut observations = observations(&simulated(0.15).0);
        let calls = Arc::new(AtomicUsize::new(0));
        let heard = Arc::clone(&calls);
        observations.options.progress =
            Progress::heard_by(move |_, _| match heard.fetch_add(1, Ordering::Relaxed) < most {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            });
        let found = device::report(&observations, &DeviceOptions { trace, held_out: false });
        (found, calls.load(Ordering::Relaxed))
    };
    let search = || Some(SearchOptions::default());
    let (alone, calls) = report(usize::MAX, None);
    let alone = alone.expect("a calibration");
    assert!(!alone.ended && alone.verdict == Verdict::Unexplained);
    let whole = report(usize::MAX, search()).0.expect("a trace");
    assert!(!whole.ended && whole.verdict == Verdict::Explained && whole.steps.len() == 1);
    let ended = report(calls + 1, search()).0.expect("a calibration");
    assert!(ended.ended);
    assert_eq!((ended.verdict, ended.fit.chi2), (alone.verdict, alone.fit.chi2));
    assert_eq!(ended.parameters, alone.parameters);
    assert!(matches!(report(calls - 1, search()).0, Err(Error::Ended)));
}

#[test]
fn a_fit_of_a_search_ends_within_a_thousandth_of_a_unit_of_the_minimum() {
    let mut observations = observations(&simulated(0.15).0);
    let base = observations.instances().expect("offset and gain");
    let exact = fit(&observations, base.clone(), None).expect("enough poses");
    let specs = ["offset", "gain", "curvature@a22"].map(String::from);
    let more = parse(&observations.mechanism, &observations.readings, &specs).expect("terms");
    let exact_more = fit(&observations, more.clone(), Some(&exact)).expect("enough poses");
    // As a search has it: the noise is judged, and each fit starts where another ended.
    observations.judged = true;
    let coarse = fit(&observations, base.clone(), Some(&exact)).expect("enough poses");
    let coarse_more = fit(&observations, more, Some(&coarse)).expect("enough poses");
    let back = fit(&observations, base, Some(&coarse_more)).expect("enough poses");
    assert!(exact.total - exact_more.total > 20.0, "nothing to see");
    // A promise of 1e-5 of the cost, half of χ², is not looked for; (52) has converged in the end.
    for (coarse, exact) in [(&coarse, &exact), (&coarse_more, &exact_more), (&back, &exact)] {
        let off = coarse.total - exact.total;
        assert!(off.abs() < 1e-3, "{} for {}", coarse.total, exact.total);
    }
}

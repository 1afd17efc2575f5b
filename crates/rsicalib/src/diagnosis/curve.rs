//! An effect as a curve with its uncertainty: over the reading, or over time.

use crate::estimate::Fit;
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::lanes::Lanes;
use crate::readings::course::Followed;
use crate::terms::term::{Acts, Over, Scale, Site};

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// What it runs over.
    pub over: Over,
    /// Unit of the corrections: of the joint's coordinate, or 1 for a fraction of all readings.
    pub unit: String,
    /// Where, correction, standard deviation.
    pub points: Vec<[f64; 3]>,
}

/// Points of a curve.
const POINTS: usize = 33;

/// The curve that an instance is, of which `first` is the first parameter; none where its
/// parameters say it all.
#[must_use]
pub fn curve(fit: &Fit, instance: &Instance, first: usize) -> Option<Curve> {
    let scales: &[Scale] = &fit.model.scales;
    let mechanism = &fit.model.mechanism;
    let channel = match (instance.term.acts(), instance.target) {
        // Sensors of one make have one curve; others have none in common.
        (Acts::Sensor(_), Target::Channel(_) | Target::EachJoint(..) | Target::Together(_)) => {
            mechanism.channels_at(instance.target).first().copied()?
        }
        (Acts::Sensor(_), _) => return None,
        (_, Target::Channel(channel)) => channel,
        _ => 0,
    };
    // What is straight over time its rate says.
    let over = instance.term.over()?;
    if over == Over::Time && !instance.term.info().penalised {
        return None;
    }
    let p = &fit.beta[first..first + instance.width()];
    let still = vec![Lanes::ZERO; scales.len()];
    let at = |share: f64| {
        let [low, high] = scales[channel].span;
        let reading = low + (high - low) * share;
        // Of a fraction of all readings, what it is of one.
        let (x, readings, time) = match over {
            Over::Reading => (reading, reading, 0.0),
            Over::Time => (share, 1.0, share),
        };
        let readings = vec![Lanes::splat(readings); scales.len()];
        let site = Site {
            readings: &readings,
            channel,
            scales,
            time: Lanes::splat(time),
            temperature: Lanes::ZERO,
            approach: &still,
            velocity: &still,
            course: None,
            late: 0.0,
            followed: Followed::default(),
            pose: Lanes::ZERO,
            place: instance.place,
        };
        let mut slopes = vec![Lanes::ZERO; p.len()];
        let correction = match instance.term.acts() {
            Acts::Sensor(term) => {
                term.partials(p, &site, &mut slopes);
                term.correction(p, &site)
            }
            Acts::Electronics(term) => {
                term.partials(p, &site, &mut slopes);
                term.correction(p, &site)
            }
            _ => return None,
        };
        let slopes: Vec<f64> = slopes.iter().map(|s| s.0[0]).collect();
        Some([x, correction.0[0], deviation(fit, first, &slopes)])
    };
    let points = (0..POINTS).map(|i| at(i as f64 / (POINTS - 1) as f64));
    let unit = match instance.term.acts() {
        Acts::Sensor(_) => mechanism.coordinate_unit(instance.target).into(),
        _ => "1".into(),
    };
    Some(Curve { over, unit, points: points.collect::<Option<_>>()? })
}

/// Standard deviation of what has these derivatives by the parameters from `first` on.
fn deviation(fit: &Fit, first: usize, slopes: &[f64]) -> f64 {
    let covariance = |i: usize, j: usize| fit.covariance[(first + i, first + j)];
    let terms = slopes
        .iter()
        .enumerate()
        .flat_map(|(i, a)| slopes.iter().enumerate().map(move |(j, b)| a * b * covariance(i, j)));
    terms.sum::<f64>().max(0.0).sqrt()
}

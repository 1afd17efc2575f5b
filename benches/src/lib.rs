//! What every bench starts from: the hand controller in poses by hand.

use rsicalib::apply::earlier::{Applied, Reference, Reported};
use rsicalib::estimate::Observations;
use rsicalib::mechanism::{Chain, Channel, Closure, Mechanism, Point, Row, hand_controller};
use rsicalib::model::Spec;
use rsicalib::monitor::{Monitor, MonitorOptions};
use rsicalib::readings::Table;

/// A device, its readings and its true parameters.
#[derive(Debug, Clone)]
pub struct Device {
    /// The hand controller.
    pub mechanism: Mechanism,
    /// Counts, pose by pose, rounded as a converter rounds them.
    pub counts: Vec<f64>,
    /// True offsets (rad).
    pub offsets: Vec<f64>,
    /// True gains [rad/count].
    pub gains: Vec<f64>,
}

impl Device {
    /// Nominal offsets and gains.
    #[must_use]
    pub fn nominal(&self) -> (Vec<f64>, Vec<f64>) {
        let channels = &self.mechanism.channels;
        (channels.iter().map(|c| c.offset).collect(), channels.iter().map(|c| c.gain).collect())
    }

    /// The readings as a session, one sample for each pose.
    ///
    /// # Panics
    ///
    /// If the readings do not fit the mechanism: a mistake in this file.
    #[must_use]
    #[expect(clippy::expect_used, reason = "a bench stops at a mistake")]
    pub fn session(&self) -> Observations {
        let table = Table { values: self.counts.clone(), ..Table::default() };
        Observations::new(&self.mechanism, table, None, rsicalib::FitOptions::default())
            .expect("readings")
    }
}

/// Uniform numbers in (-1, 1): a linear congruential generator, the same everywhere.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// The hand controller in `poses` poses within ±2 in, z -5 … -1, ±25°.
#[must_use]
pub fn hand_controller(poses: usize) -> Device {
    let mut random = Uniform(19_931_102);
    let mechanism = Mechanism::rsi();
    let gains: Vec<f64> =
        mechanism.channels.iter().map(|c| c.gain * (1.0 + 0.02 * random.next())).collect();
    let offsets: Vec<f64> =
        mechanism.channels.iter().map(|c| c.offset + 0.04 * random.next()).collect();
    let mut counts = Vec::with_capacity(9 * poses);
    while counts.len() < 9 * poses {
        let mut u = || random.next();
        let pose = [2.0 * u(), 2.0 * u(), -3.0 + 2.0 * u(), 0.44 * u(), 0.44 * u(), 0.44 * u()];
        let Ok(angles) = hand_controller::inverse(&pose) else { continue };
        let row: Vec<f64> = angles
            .iter()
            .flatten()
            .enumerate()
            .map(|(c, angle)| ((angle - offsets[c]) / gains[c]).round())
            .collect();
        if row.iter().all(|a| (0.0..=4095.0).contains(a)) {
            counts.extend(row);
        }
    }
    Device { mechanism, counts, offsets, gains }
}

/// A session of an arm of so many joints, no two axes parallel, whose tip touches a socket: readings
/// between -1 and 1 rad, which do not close.
///
/// # Panics
///
/// If the readings do not fit the mechanism: a mistake in this file.
#[must_use]
#[expect(clippy::expect_used, reason = "a bench stops at a mistake")]
pub fn arm(joints: usize, poses: usize) -> Observations {
    let names: Vec<String> = (1..=joints).map(|k| format!("q{k}")).collect();
    let row = |(k, name): (usize, &String)| Row {
        channel: Some(name.clone()),
        a: 0.3 + 0.01 * k as f64,
        d: 0.1 * (k % 3) as f64,
        alpha: [1.57, -1.2, 0.7][k % 3],
        ..Row::default()
    };
    let channel = |name: &String| Channel {
        name: name.clone(),
        range: Some([-2.0, 2.0]),
        noise: Some(1e-4),
        ..Channel::default()
    };
    let point = |name: &str, chain: Option<&str>| Point {
        name: name.into(),
        chain: chain.map(Into::into),
        at: Some([0.1, 0.2, 0.3]),
        ..Point::default()
    };
    let mechanism = Mechanism {
        name: "arm".into(),
        length_unit: "m".into(),
        channels: names.iter().map(channel).collect(),
        chains: vec![Chain {
            name: "arm".into(),
            rows: names.iter().enumerate().map(row).collect(),
        }],
        points: vec![point("tip", Some("arm")), point("socket", None)],
        closures: vec![Closure::touch("tip-socket", ["tip".into(), "socket".into()])],
        ..Mechanism::default()
    };
    let mut random = Uniform(7);
    let values = (0..joints * poses).map(|_| random.next()).collect();
    let terms = Some(vec!["offset".into(), "gain".into()]);
    let options = rsicalib::FitOptions { terms, ..rsicalib::FitOptions::default() };
    Observations::new(&mechanism, Table { values, ..Table::default() }, None, options)
        .expect("readings")
}

/// Standard deviations of an offset (rad) and of a gain (a share of it) in a calibration.
const KNOWN: [f64; 2] = [1e-3, 1e-3];

/// A watch over the hand controller, and rows of a device that is as it was calibrated, with noise
/// of one count.
///
/// # Panics
///
/// If the calibration does not fit the mechanism: a mistake in this file.
#[must_use]
#[expect(clippy::expect_used, reason = "a bench stops at a mistake")]
pub fn watched(rows: usize) -> (Monitor, Vec<Vec<f64>>) {
    let Device { mechanism, counts, offsets, gains } = hand_controller(rows);
    let (mut parameters, mut sd) = (Vec::new(), Vec::new());
    for (c, channel) in mechanism.channels.iter().enumerate() {
        for (id, value, known) in
            [("offset", offsets[c], KNOWN[0]), ("gain", gains[c], KNOWN[1] * gains[c])]
        {
            let target = Some(channel.name.clone());
            let spec = Spec { term: id.into(), target, place: None };
            parameters.push(Reported { spec, name: id.into(), value });
            sd.push(known);
        }
    }
    let n = sd.len();
    let covariance: Vec<f64> =
        (0..n * n).map(|k| if k / n == k % n { sd[k / n].powi(2) } else { 0.0 }).collect();
    let reference = Reference {
        centre: mechanism.channels.iter().map(|c| c.middle()).collect(),
        span: mechanism.channels.iter().filter_map(|c| c.range).collect(),
        temperature: None,
    };
    let sigma = vec![1.0; mechanism.channels.len()];
    let applied = Applied { parameters, reference, sigma, ..Applied::default() };
    let monitor = Monitor::new(&mechanism, &applied, &covariance, &MonitorOptions::default());
    let mut random = Uniform(20_261_122);
    // Three uniforms in (-1, 1) have variance one.
    let mut noise = || random.next() + random.next() + random.next();
    let row = |row: &[f64]| row.iter().map(|count| (count + noise()).round()).collect();
    (monitor.expect("a calibration"), counts.chunks_exact(9).map(row).collect())
}

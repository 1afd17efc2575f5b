//! The variables of a session on which an error may depend.

use crate::Error;
use crate::estimate::Observations;
use crate::estimate::at_fit::AtFit;
use crate::model::Model;

/// What an error may depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The reading of a channel.
    Theta(usize),
    /// The direction from which a channel came.
    Direction(usize),
    /// The path that a channel has travelled since the session began.
    Travelled(usize),
    /// The torque of the weights about a joint.
    Torque(usize),
    /// A measured length.
    Column(usize),
    /// Time.
    Time,
    /// Temperature.
    Temperature,
}

impl Quantity {
    /// What users read.
    #[must_use]
    pub fn name(self, observations: &Observations) -> String {
        let channels = &observations.mechanism.channels;
        let of = |what: &str, c: usize| format!("{what}[{}]", channels[c].name);
        match self {
            Self::Theta(c) => of("theta", c),
            Self::Direction(c) => of("direction", c),
            Self::Travelled(c) => of("travelled", c),
            Self::Torque(c) => of("torque", c),
            Self::Column(k) => observations.mechanism.value_columns().swap_remove(k),
            Self::Time => "time".into(),
            Self::Temperature => "temperature".into(),
        }
    }

    /// The channel that it belongs to.
    #[must_use]
    pub fn channel(self) -> Option<usize> {
        match self {
            Self::Theta(c) | Self::Direction(c) | Self::Travelled(c) | Self::Torque(c) => Some(c),
            Self::Column(_) | Self::Time | Self::Temperature => None,
        }
    }
}

/// A variable in every sample that counts, from -1 to 1.
#[derive(Debug, Clone)]
pub struct Variable {
    /// What it is.
    pub quantity: Quantity,
    /// Its values, sample by sample.
    pub values: Vec<f64>,
}

/// Values that are the same to so much of their range, from -1 to 1, are one.
pub const SAME: f64 = 1e-6;

/// Those that a session has at a fit, in the samples `rows`; what does not change is none. Readings
/// and torques are of readings as the fit settles them.
///
/// # Errors
///
/// Those of compiling the mechanism without any term.
pub fn variables(at: &AtFit, rows: &[usize]) -> Result<Vec<Variable>, Error> {
    let observations = at.observations;
    let readings = &observations.readings;
    let lanes = readings.lane_of_rows();
    let settled = |block: usize| at.settled(block);
    let torques = Model::torques(&observations.mechanism, readings, settled)?;
    let torque = |block: usize, lane: usize, c: usize| torques[block][c].0[lane];
    let in_lane = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        rows.iter().map(|&row| of(lanes[row].0, lanes[row].1)).collect()
    };
    let mut all: Vec<Variable> = Vec::new();
    let mut add = |quantity, values: Vec<f64>| {
        let Some(values) = scaled(values) else { return };
        let same = |v: &Variable| {
            let apart =
                |sign: f64| v.values.iter().zip(&values).all(|(a, b)| (a - sign * b).abs() < SAME);
            apart(1.0) || apart(-1.0)
        };
        if !all.iter().any(same) {
            all.push(Variable { quantity, values });
        }
    };
    for c in 0..readings.channels {
        add(Quantity::Theta(c), in_lane(&|block, lane| settled(block)[c].0[lane]));
    }
    add(Quantity::Time, in_lane(&|block, lane| readings.blocks()[block].time.0[lane]));
    if readings.tempered {
        let of = |block: usize, lane: usize| readings.blocks()[block].temperature.0[lane];
        add(Quantity::Temperature, in_lane(&of));
    }
    for c in 0..readings.channels {
        add(Quantity::Torque(c), in_lane(&|block, lane| torque(block, lane, c)));
        add(Quantity::Travelled(c), travelled(observations, rows, c));
        add(Quantity::Direction(c), in_lane(&|block, lane| readings.approach(block)[c].0[lane]));
    }
    for k in 0..readings.table.columns.len() {
        add(Quantity::Column(k), in_lane(&|block, lane| readings.columns(block)[k].0[lane]));
    }
    Ok(all)
}

/// From -1 to 1; none where it does not change.
fn scaled(values: Vec<f64>) -> Option<Vec<f64>> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let changes = half.is_finite() && half > SAME * middle.abs().max(SAME);
    changes.then(|| values.into_iter().map(|v| (v - middle) / half).collect())
}

/// Sum of the changes of a channel's reading, from sample to sample of a session.
fn travelled(observations: &Observations, rows: &[usize], channel: usize) -> Vec<f64> {
    let readings = &observations.readings;
    let session = |row: usize| readings.session_of_pose.get(readings.pose[row]).copied();
    let mut way = vec![0.0; readings.samples];
    for row in 1..readings.samples {
        let step = (readings.row(row)[channel] - readings.row(row - 1)[channel]).abs();
        way[row] = if session(row) == session(row - 1) { way[row - 1] + step } else { 0.0 };
    }
    rows.iter().map(|&row| way[row]).collect()
}

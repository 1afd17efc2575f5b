//! Effects of one channel, or of all channels alike, as laws of one variable.
//!
//! With the final residual `r` of a sample and its derivative `s` by the correction, both whitened,
//! the residual asks for `-s·r / s·s` on top of the law, with standard deviation `1 / |s|`: a
//! component-plus-residual plot, on the scale of the correction.

use crate::Error;
use crate::diagnosis::trace::Found;
use crate::estimate::angles::Angles;
use crate::estimate::{Fit, Observations, fit};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::order;
use crate::report::evidence::shapes::{Alternative, Law};
use crate::report::evidence::thinned::{grouped, some};
use crate::report::trace_report::Place;
use crate::terms::term::{Acts, Needs, Placed};

/// Alternatives that are fitted again and drawn.
const MOST_ALTERNATIVES: usize = 3;

/// A session of more samples is not fitted again for alternatives.
const MOST_SAMPLES: usize = 5000;

/// Corrections of a sample whose derivative is this fraction of the largest are no measurement.
const BLIND: f64 = 0.02;

/// The law of an effect; none where it is not one of one variable.
///
/// # Errors
///
/// As [`fit`].
pub fn law(observations: &Observations, found: &Found, last: &Fit) -> Result<Option<Law>, Error> {
    let instance = &found.instance;
    let Some(acts) = Correction::of(observations, instance, last) else { return Ok(None) };
    let Variable { over, of_reading, unit, values: variable } =
        variable(observations, instance, &acts);
    let live: Vec<usize> = (0..observations.readings.samples)
        .filter(|&row| observations.weights[row] > 0.0 && variable[row].is_finite())
        .collect();
    let mut asked = acts.dots(&live, &variable, last);
    order::ascending(&mut asked, |a| a.1[0]);
    let (groups, per_dot) = grouped(&asked);
    let dots = groups.map(weighted).collect();
    let poses = if per_dot == 1 { asked.iter().map(|dot| dot.0).collect() } else { Vec::new() };
    let mut order = live;
    order::ascending(&mut order, |a| variable[*a]);
    let line = |value: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
        some(order.iter().map(|&row| [variable[row], value(row)]).collect())
    };
    let mut alternatives = Vec::new();
    for other in found.also.iter().filter(|i| i.target == instance.target) {
        if alternatives.len() == MOST_ALTERNATIVES {
            break;
        }
        let there = if observations.readings.samples <= MOST_SAMPLES {
            let mut instances = found.without.model.instances.clone();
            instances.push(*other);
            let refit = fit(observations, instances, Some(&found.without))?;
            Angles::of(&observations.readings, &refit.model, &refit.beta)
        } else {
            // As the search fitted it, beside the others of that time.
            let Some((_, model, beta)) = found.laws.iter().find(|(i, ..)| i == other) else {
                continue;
            };
            Angles::of(&observations.readings, model, beta)
        };
        let value = |row: usize| acts.law[row] + acts.apart(row, &there);
        let effect = Place::of(observations, other);
        alternatives.push(Alternative { effect, line: line(&value) });
    }
    let correction_unit = acts.unit(observations);
    let line = line(&|row| acts.law[row]);
    Ok(Some(Law {
        over,
        of_reading,
        unit,
        correction_unit,
        dots,
        per_dot,
        poses,
        line,
        alternatives,
    }))
}

/// Mean of dots by their precision.
fn weighted(group: &[(usize, [f64; 3])]) -> [f64; 3] {
    let total: f64 = group.iter().map(|(_, dot)| dot[2].powi(-2)).sum();
    let part = |dot: &[f64; 3], i: usize| dot[i] * dot[2].powi(-2);
    let mean = |i: usize| group.iter().map(|(_, dot)| part(dot, i)).sum::<f64>() / total;
    [mean(0), mean(1), total.sqrt().recip()]
}

/// The correction of an effect, sample by sample.
struct Correction {
    /// The channel; none: a fraction of all readings.
    channel: Option<usize>,
    /// The correction that the law gives each sample.
    law: Vec<f64>,
    angles: Angles,
    /// The readings, row by row, one per channel.
    values: Vec<f64>,
    channels: usize,
}

impl Correction {
    fn of(observations: &Observations, instance: &Instance, last: &Fit) -> Option<Self> {
        let at = last.model.instances.iter().position(|i| i == instance)?;
        let first = last.model.first[at];
        let mut absent = last.beta.clone();
        absent[first..first + instance.width()].fill(0.0);
        let angles = Angles::of(&observations.readings, &last.model, &last.beta);
        let without = Angles::of(&observations.readings, &last.model, &absent);
        let (channels, samples) = (observations.readings.channels, observations.readings.samples);
        let values = observations.readings.table.values.clone();
        let change = |row: usize, c: usize| angles.at(row, c) - without.at(row, c);
        let (channel, law) = match (instance.target, instance.term.acts()) {
            (
                Target::Channel(c),
                Acts::Sensor(_) | Acts::Electronics(_) | Acts::Load(_) | Acts::Coupled(_),
            ) => (Some(c), (0..samples).map(|row| change(row, c)).collect()),
            (Target::All, Acts::Electronics(_)) => {
                let fraction = |row: usize| {
                    let by = |c: usize| change(row, c) / angles.slope(row, c);
                    fraction(&values[row * channels..(row + 1) * channels], by)
                };
                (None, (0..samples).map(fraction).collect::<Option<_>>()?)
            }
            _ => return None,
        };
        Some(Self { channel, law, angles, values, channels })
    }

    /// Derivative of one residual by the correction.
    fn slope(&self, row: usize, by_reading: &[f64]) -> f64 {
        match self.channel {
            Some(c) => by_reading[c] / self.angles.slope(row, c),
            None => {
                let readings = &self.values[row * self.channels..(row + 1) * self.channels];
                by_reading.iter().zip(readings).map(|(a, reading)| a * reading).sum()
            }
        }
    }

    /// Row by row the variable, the correction that a sample asks for, and its standard deviation.
    fn dots(&self, live: &[usize], variable: &[f64], last: &Fit) -> Vec<(usize, [f64; 3])> {
        let (k, c) = (last.residuals.equations, self.channels);
        let of = |&row: &usize| {
            let (mut rs, mut ss) = (0.0, 0.0);
            for e in row * k..(row + 1) * k {
                let s = self.slope(row, &last.residuals.by_reading[e * c..(e + 1) * c]);
                rs += s * last.residuals.whitened[e];
                ss += s * s;
            }
            (row, rs, ss)
        };
        let sums: Vec<(usize, f64, f64)> = live.iter().map(of).collect();
        let most = sums.iter().map(|sum| sum.2).fold(0.0, f64::max);
        let seen = sums.into_iter().filter(|(.., ss)| *ss > most * BLIND * BLIND);
        let asks = |row: usize, rs: f64, ss: f64| self.law[row] - rs / ss;
        seen.map(|(row, rs, ss)| (row, [variable[row], asks(row, rs, ss), ss.sqrt().recip()]))
            .collect()
    }

    /// How the whole correction of a sample differs under another fit.
    fn apart(&self, row: usize, other: &Angles) -> f64 {
        let change = |c: usize| other.at(row, c) - self.angles.at(row, c);
        match self.channel {
            Some(c) => change(c),
            None => {
                let readings = &self.values[row * self.channels..(row + 1) * self.channels];
                let shifts = (0..self.channels).map(|c| change(c) / self.angles.slope(row, c));
                let total: f64 = shifts.zip(readings).map(|(shift, a)| shift * a).sum();
                total / readings.iter().map(|a| a * a).sum::<f64>()
            }
        }
    }

    fn unit(&self, observations: &Observations) -> String {
        match self.channel {
            Some(c) => observations.mechanism.coordinate_unit(Target::Channel(c)).into(),
            None => "1".into(),
        }
    }
}

/// The one fraction of all readings by which they change; none where they do not change alike.
fn fraction(readings: &[f64], change: impl Fn(usize) -> f64) -> Option<f64> {
    let (mut along, mut square, mut total) = (0.0, 0.0, 0.0);
    for (c, a) in readings.iter().enumerate() {
        along += change(c) * a;
        square += a * a;
        total += change(c).powi(2);
    }
    let fraction = along / square;
    // Alike to 1 %, as near as the curves of other terms allow.
    let alike = total - fraction * along <= 1e-4 * total;
    (alike && fraction.is_finite()).then_some(fraction)
}

/// The variable of a law.
struct Variable {
    over: String,
    /// True for the reading of the channel that is corrected.
    of_reading: bool,
    unit: String,
    values: Vec<f64>,
}

impl Variable {
    fn of(over: impl Into<String>, unit: impl Into<String>, values: Vec<f64>) -> Self {
        Self { over: over.into(), of_reading: false, unit: unit.into(), values }
    }
}

fn variable(observations: &Observations, instance: &Instance, acts: &Correction) -> Variable {
    let (readings, mechanism) = (&observations.readings, &observations.mechanism);
    let rows = 0..readings.samples;
    let of_channel = |c: usize| {
        let name = &mechanism.channels[c];
        let values = rows.clone().map(|row| readings.row(row)[c]).collect();
        Variable::of(format!("reading of {}", name.name), &name.unit, values)
    };
    let time = || match &readings.table.time {
        Some(time) => Variable::of("time", "s", time.clone()),
        None => {
            let pose = rows.clone().map(|row| readings.pose[row] as f64 + 1.0).collect();
            Variable::of("pose, in the order of the readings", "", pose)
        }
    };
    let channel = acts.channel.unwrap_or(0);
    let by_block = |value: &dyn Fn(usize, usize) -> f64| {
        let mut values = vec![f64::NAN; readings.samples];
        for (block, meta) in readings.blocks().iter().enumerate() {
            for lane in 0..meta.live {
                values[meta.rows[lane]] = value(block, lane);
            }
        }
        values
    };
    let info = instance.term.info();
    match (instance.term.placed(), info.needs, instance.term.acts()) {
        (Placed::AtPose, ..) | (_, Needs::Order | Needs::Way, _) => time(),
        (Placed::AtChannel, ..) => of_channel(instance.place),
        (_, Needs::Temperature, _) => {
            let values = readings.table.temperature.clone().unwrap_or_default();
            Variable::of("temperature", "°C", values)
        }
        (_, Needs::Approach, _) => {
            let values = by_block(&|block, lane| readings.approach(block)[channel].0[lane]);
            let name = &mechanism.channels[channel].name;
            Variable::of(format!("direction from which {name} came"), "", values)
        }
        (_, Needs::Motion, _) => {
            let values = by_block(&|block, lane| readings.velocity(block)[channel].0[lane]);
            let unit = &mechanism.channels[channel];
            Variable::of(format!("velocity of {}", unit.name), format!("{}/s", unit.unit), values)
        }
        (.., Acts::Load(_)) => {
            let torque = largest_as_one(&acts.law);
            let name = &mechanism.channels[channel].name;
            Variable::of(format!("torque at {name}, of the largest"), "", torque)
        }
        _ if acts.channel.is_some() => Variable { of_reading: true, ..of_channel(channel) },
        _ => time(),
    }
}

/// What a joint gives is its torque times one compliance, eq. (43): the torque in units of the
/// largest.
fn largest_as_one(law: &[f64]) -> Vec<f64> {
    let largest =
        law.iter().copied().fold(0.0, |most: f64, v| if v.abs() > most.abs() { v } else { most });
    law.iter().map(|v| v / largest.abs()).collect()
}

//! The variables of a session on which an error may depend.

use crate::Error;
use crate::diagnosis::score::candidates::{has_places, one_place};
use crate::estimate::Observations;
use crate::estimate::at_fit::AtFit;
use crate::model::Model;
use crate::readings::context::standstills;
use crate::readings::way::Way;

/// What an error may depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The reading of a channel.
    Theta(usize),
    /// The direction from which a channel came.
    Direction(usize),
    /// The path that a channel has travelled since the session began.
    Travelled(usize),
    /// How far a channel is from where it turned last.
    SinceTurn(usize),
    /// Plays of a channel, of several widths.
    Play(usize),
    /// The velocity of a channel.
    Velocity(usize),
    /// Time since a channel moved last.
    SinceMove(usize),
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
            Self::SinceTurn(c) => of("since_turn", c),
            Self::Play(c) => of("play", c),
            Self::Velocity(c) => of("velocity", c),
            Self::SinceMove(c) => of("since_move", c),
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
            Self::Theta(c) | Self::Torque(c) => Some(c),
            Self::Column(_) | Self::Time | Self::Temperature => None,
            Self::Direction(c) | Self::Travelled(c) | Self::SinceTurn(c) => Some(c),
            Self::Play(c) | Self::Velocity(c) | Self::SinceMove(c) => Some(c),
        }
    }

    /// True for what is of the way to a pose, and not of the pose.
    #[must_use]
    pub fn of_way(self) -> bool {
        self.channel().is_some() && !matches!(self, Self::Theta(_) | Self::Torque(_))
    }

    /// True for what is counted from the beginning of a session.
    #[must_use]
    pub fn begins_anew(self) -> bool {
        matches!(self, Self::Time | Self::Travelled(_))
    }
}

/// A variable in every sample that counts, and functions of it.
#[derive(Debug, Clone)]
pub struct Variable {
    /// What it is.
    pub quantity: Quantity,
    /// Its values, sample by sample, from -1 to 1; of plays, those of the widest.
    pub values: Vec<f64>,
    /// Functions of it, of rising degree, each about 1 in size.
    pub functions: Vec<Function>,
}

/// A function of a variable.
#[derive(Debug, Clone)]
pub struct Function {
    /// Its degree: that of a play is 1.
    pub degree: usize,
    /// Its values, sample by sample.
    pub values: Vec<f64>,
}

stated! {
    /// Highest degree of a function of one variable.
    pub fn degree() -> usize = 8;
}

/// Values that are the same to so much of their range, from -1 to 1, are one.
const SAME: f64 = 1e-6;

impl Variable {
    /// Of these values, with polynomials of it; none where they do not change.
    pub fn of(quantity: Quantity, values: Vec<f64>) -> Option<Self> {
        Self::apart(quantity, values, 0.0)
    }

    /// The same of values that noise makes differ by so much.
    pub fn apart(quantity: Quantity, values: Vec<f64>, noise: f64) -> Option<Self> {
        let (values, half) = scaled(values)?;
        let same = SAME.max(noise / half);
        let polynomials: Vec<Vec<f64>> = values.iter().map(|&x| legendre(x, degree())).collect();
        let one = |degree: usize| {
            let values = polynomials.iter().map(|p| p[degree]).collect();
            Function { degree, values }
        };
        let functions: Vec<Function> = (1..=different(&values, degree(), same)).map(one).collect();
        (!functions.is_empty()).then_some(Self { quantity, values, functions })
    }

    /// Of plays, the widest first; none where no two of them are different.
    pub fn of_plays(quantity: Quantity, plays: Vec<Vec<f64>>) -> Option<Self> {
        let mut functions: Vec<Function> = Vec::with_capacity(plays.len());
        for values in plays {
            if different(&values, 1, SAME) > 0
                && !functions.iter().any(|f| same(&f.values, &values))
            {
                functions.push(Function { degree: 1, values });
            }
        }
        let values = functions.first()?.values.clone();
        (functions.len() > 1).then_some(Self { quantity, values, functions })
    }
}

/// True for values that are the same, or the same with the other sign.
fn same(a: &[f64], b: &[f64]) -> bool {
    let apart = |sign: f64| a.iter().zip(b).all(|(a, b)| (a - sign * b).abs() < SAME);
    apart(1.0) || apart(-1.0)
}

/// Those that a session has at a fit, in the samples `rows`; what does not change is none, nor what is not
/// finite in a sample: a fit that closes nothing settles readings nowhere. Readings, torques and the ways of
/// channels are of readings as the fit settles them.
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
    let mut add = |variable: Option<Variable>| {
        let new = variable.filter(|v| !all.iter().any(|other| same(&other.values, &v.values)));
        all.extend(new);
    };
    let thetas: Vec<Vec<f64>> =
        (0..readings.channels).map(|c| in_lane(&|block, lane| settled(block)[c].0[lane])).collect();
    let time = in_lane(&|block, lane| readings.blocks()[block].time.0[lane]);
    let noise = |c: usize| {
        one_place(observations, at.fit, c) * observations.mechanism.channels[c].gain.abs()
    };
    for (c, theta) in thetas.iter().enumerate() {
        add(Variable::apart(Quantity::Theta(c), theta.clone(), noise(c)));
    }
    add(Variable::of(Quantity::Time, time.clone()));
    if readings.tempered {
        let of = |block: usize, lane: usize| readings.blocks()[block].temperature.0[lane];
        add(Variable::of(Quantity::Temperature, in_lane(&of)));
    }
    let session = |row: usize| readings.session_of_pose.get(readings.pose[row]).copied();
    let begins: Vec<bool> =
        (0..rows.len()).map(|p| p == 0 || session(rows[p]) != session(rows[p - 1])).collect();
    let still = standstills(&observations.mechanism, &readings.span);
    let moves = readings.moves();
    for (c, theta) in thetas.iter().enumerate().filter(|(_, theta)| finite(theta)) {
        // Of a channel that stands still its noise goes a way, too.
        let way = Way { readings: theta, begins: &begins, still: still[c].max(noise(c)) };
        add(Variable::of(Quantity::Torque(c), in_lane(&|block, lane| torque(block, lane, c))));
        add(Variable::of(Quantity::Travelled(c), way.travelled()));
        // From which side a channel came that stands at few places is as its noise has it.
        if has_places(observations, at.fit, c) {
            let side = |block: usize, lane: usize| readings.approach(block)[c].0[lane];
            add(Variable::of(Quantity::Direction(c), in_lane(&side)));
            add(Variable::of_plays(Quantity::Play(c), way.plays()));
            add(Variable::of(Quantity::SinceTurn(c), way.since_turn()));
        }
        add(Variable::of(Quantity::SinceMove(c), way.since_move(&time)));
        if moves {
            let of = |block: usize, lane: usize| readings.velocity(block)[c].0[lane];
            add(Variable::of(Quantity::Velocity(c), in_lane(&of)));
        }
    }
    // Where an instrument sees a point is what is to be explained.
    let seen = observations.mechanism.instrument_columns();
    let columns = observations.mechanism.value_columns().into_iter().enumerate();
    for (k, _) in columns.filter(|(_, name)| !seen.contains(name)) {
        let of = |block: usize, lane: usize| readings.columns(block)[k].0[lane];
        add(Variable::of(Quantity::Column(k), in_lane(&of)));
    }
    Ok(all)
}

fn finite(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// From -1 to 1, and half of the range; none where it does not change, or is not finite.
fn scaled(values: Vec<f64>) -> Option<(Vec<f64>, f64)> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let changes = finite(&values) && half > SAME * middle.abs().max(SAME);
    changes.then(|| (values.into_iter().map(|v| (v - middle) / half).collect(), half))
}

/// How many values that differ by more than `same` a variable has beside its first, up to `most`: so many polynomials
/// of it are different.
fn different(values: &[f64], most: usize, same: f64) -> usize {
    let mut known: Vec<f64> = Vec::with_capacity(most + 1);
    for &value in values {
        if known.len() > most {
            break;
        }
        if known.iter().all(|other| (value - other).abs() > same) {
            known.push(value);
        }
    }
    known.len().saturating_sub(1).min(most)
}

/// Legendre's polynomials up to a degree, each with a mean square of 1 over -1 to 1.
fn legendre(x: f64, most: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for n in 1..most {
        let k = n as f64;
        p.push(((2.0 * k + 1.0) * x * p[n] - k * p[n - 1]) / (k + 1.0));
    }
    p.truncate(most + 1);
    p.iter().enumerate().map(|(n, p)| p * (2.0 * n as f64 + 1.0).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::legendre;

    #[test]
    fn polynomials_are_orthonormal() {
        let n = 20_000;
        let points = (0..n).map(|k| (f64::from(k) + 0.5) * 2.0 / f64::from(n) - 1.0);
        let rows: Vec<Vec<f64>> = points.map(|x| legendre(x, 8)).collect();
        for i in 0..=8 {
            for j in 0..=i {
                let mean = rows.iter().map(|p| p[i] * p[j]).sum::<f64>() / f64::from(n);
                let wanted = if i == j { 1.0 } else { 0.0 };
                // The midpoint rule errs by the second power of its step.
                assert!((mean - wanted).abs() < 1e-5, "{mean} of {i} and {j}");
            }
        }
    }
}

//! Poses that a mechanism can take under an estimate, with the readings to expect.
//!
//! Poses of the hand controller have closed forms, (6) to (8); the sensors of the estimate are then
//! inverted. Of any other mechanism, random configurations are closed under the estimate.

use crate::Error;
use crate::apply::poses::poses_of;
use crate::design::linearised::Linearised;
use crate::design::plan::{MARGIN, Within};
use crate::design::reach::has_closed_form;
use crate::design::tour::tour;
use crate::mechanism::{Channel, Mechanism, hand_controller};
use crate::model::configurations::Configurations;
use crate::model::{Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::{Readings, Table};

/// Share of a channel's limits that a pose keeps from each end: a hand misses the pose. Effects of a
/// sensor differ most at the ends of what it goes through, so that more costs information.
const FROM_LIMITS: f64 = 0.02;

/// Share of a channel's range that a pose keeps from each end, where the channel does not count.
const FROM_RANGE: f64 = 0.005;

/// A pose is struck off with all poses within this share of what the channels go through.
const NEAR: f64 = 0.05;

/// Candidates for the next poses.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reachable {
    /// Platform poses; empty without a platform.
    pub(crate) poses: Vec<[f64; 6]>,
    /// Readings, keys of unknown points and measured distances.
    pub(crate) table: Table,
    pub(crate) channels: usize,
    /// Lowest and highest reading of each channel.
    pub(crate) span: Vec<[f64; 2]>,
}

impl Reachable {
    /// Number of candidates.
    pub(crate) fn len(&self) -> usize {
        self.table.values.len().checked_div(self.channels).unwrap_or(0)
    }

    /// Readings of one candidate.
    pub(crate) fn row(&self, candidate: usize) -> &[f64] {
        &self.table.values[candidate * self.channels..(candidate + 1) * self.channels]
    }

    /// Distance of two rows of readings: root mean square of shares of what each channel goes
    /// through.
    pub(crate) fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        let shares = a.iter().zip(b).zip(&self.span).map(|((a, b), [low, high])| {
            let span = high - low;
            if span > 0.0 { ((a - b) / span).powi(2) } else { 0.0 }
        });
        (shares.sum::<f64>() / self.channels as f64).sqrt()
    }

    /// Candidates in an order in which the next is never far, and the length of the way.
    pub(crate) fn tour(&self, chosen: Vec<usize>, start: &[f64]) -> (Vec<usize>, f64) {
        tour(chosen, start, |k| self.row(k), |a, b| self.distance(a, b))
    }

    /// Some of the candidates, in this order.
    pub(crate) fn some(&self, chosen: &[usize]) -> Self {
        let table = Table {
            pose: Some((1..=chosen.len() as i64).collect()),
            ..self.table.alone(self.channels, chosen)
        };
        let poses = match self.poses.is_empty() {
            true => Vec::new(),
            false => chosen.iter().map(|&k| self.poses[k]).collect(),
        };
        Self { poses, table, channels: self.channels, span: self.span.clone() }
    }

    /// Without candidates near poses that were struck off, whose readings are given row by row.
    fn without(self, off: &[f64]) -> Self {
        let far = |k: &usize| {
            off.chunks_exact(self.channels).all(|row| self.distance(self.row(*k), row) > NEAR)
        };
        let kept: Vec<usize> = (0..self.len()).filter(far).collect();
        self.some(&kept)
    }
}

/// Candidates within a box, joint limits and ranges, each with a margin.
///
/// # Errors
///
/// [`Error::Option`] where hardly any pose is left; as [`Linearised::under`].
pub(crate) fn reachable(
    at: &Linearised<'_>,
    session: &Readings,
    within: Option<Within>,
    count: usize,
    off: &[f64],
    random: &mut Random,
) -> Result<Reachable, Error> {
    let found = match within.filter(|_| has_closed_form(&at.model.mechanism)) {
        Some(within) => by_closed_form(at, session, drawn(&within, count, random))?,
        None => by_closing(at, session, within, count, random)?,
    };
    let mut found = with_margins(at, found);
    let channels = found.channels;
    let column = |c: usize| found.table.values.iter().skip(c).step_by(channels).copied();
    found.span = (0..channels)
        .map(|c| column(c).fold([f64::MAX, f64::MIN], |[l, h], v| [l.min(v), h.max(v)]))
        .collect();
    let found = found.without(off);
    if found.len() < 20 {
        let found = format!("{} poses within reach, joint limits and ranges", found.len());
        let expected = "a box that the mechanism can reach, with poses that are not struck off";
        return Err(Error::option("within", found, expected));
    }
    Ok(found)
}

/// These poses again and others around each, within so large a share of the box to each side; none
/// without a closed form.
///
/// # Errors
///
/// As [`Linearised::under`].
pub(crate) fn around(
    at: &Linearised<'_>,
    session: &Readings,
    within: Option<Within>,
    poses: &Reachable,
    (share, each): (f64, usize),
    off: &[f64],
    random: &mut Random,
) -> Result<Option<Reachable>, Error> {
    let Some(within) = within.filter(|_| has_closed_form(&at.model.mechanism)) else {
        return Ok(None);
    };
    let mut drawn = poses.poses.clone();
    for pose in &poses.poses {
        for _ in 0..each {
            drawn.push(std::array::from_fn(|i| {
                let [low, high] = within[i];
                let step = share * (high - low) * random.uniform(-1.0, 1.0);
                (pose[i] + step).clamp(low, high)
            }));
        }
    }
    let mut found = with_margins(at, by_closed_form(at, session, drawn)?);
    found.span.clone_from(&poses.span);
    Ok(Some(found.without(off)))
}

/// Those that keep the margins of every channel.
fn with_margins(at: &Linearised<'_>, found: Reachable) -> Reachable {
    let mechanism = &at.model.mechanism;
    let inside = |k: &usize| {
        let row = found.row(*k);
        mechanism.channels.iter().zip(row).enumerate().all(|(c, (channel, reading))| {
            let scale = &at.model.scales[c];
            let angle = scale.angle + scale.gain * (reading - scale.centre);
            keeps(channel, *reading, angle)
        })
    };
    let kept: Vec<usize> = (0..found.len()).filter(inside).collect();
    found.some(&kept)
}

/// True where a reading keeps the margins of its channel.
fn keeps(channel: &Channel, reading: f64, angle: f64) -> bool {
    let between = |value: f64, [low, high]: [f64; 2], margin: f64| {
        value >= low + margin && value <= high - margin
    };
    let margin =
        |[low, high]: [f64; 2]| if channel.counts() { MARGIN } else { FROM_RANGE * (high - low) };
    reading.is_finite()
        && channel.range.is_none_or(|range| between(reading, range, margin(range)))
        && channel.limits.is_none_or(|l| between(angle, l, FROM_LIMITS * (l[1] - l[0])))
}

/// Half of the poses from the inside of the box, half from its faces: the best are extreme ones.
fn drawn(within: &Within, count: usize, random: &mut Random) -> Vec<[f64; 6]> {
    (0..count)
        .map(|k| {
            within.map(|[low, high]| {
                let inside = random.uniform(low, high);
                let end = if random.coin() { low } else { high };
                if k >= count / 2 && random.coin() { end } else { inside }
            })
        })
        .collect()
}

/// Those of the poses that are in reach, with the readings to expect.
fn by_closed_form(
    at: &Linearised<'_>,
    session: &Readings,
    drawn: Vec<[f64; 6]>,
) -> Result<Reachable, Error> {
    let mechanism = &at.model.mechanism;
    let channels = mechanism.channels.len();
    let (mut poses, mut angles) = (Vec::new(), Vec::new());
    for pose in drawn {
        if let Ok(found) = hand_controller::inverse(&pose) {
            poses.push(pose);
            angles.push(found.concat());
        }
    }
    let free = |c: &Channel| Channel { range: None, limits: None, ..c.clone() };
    let bare =
        Mechanism { channels: mechanism.channels.iter().map(free).collect(), ..mechanism.clone() };
    let first = |angles: &Vec<f64>| -> Vec<f64> {
        let scales = at.model.scales.iter().zip(angles);
        scales.map(|(s, angle)| s.centre + (angle - s.angle) / s.gain).collect()
    };
    let values = angles.iter().flat_map(first).collect();
    let table = Table {
        values,
        pose: Some((1..=poses.len() as i64).collect()),
        ..still(session, poses.len())
    };
    if poses.is_empty() {
        return Ok(Reachable { channels, span: vec![[0.0; 2]; channels], ..Reachable::default() });
    }
    let readings = Readings::beside(&bare, table, session)?;
    let (model, columns) = at.under(&bare, &readings)?;
    let beta = at.beta_of(&columns);
    let blocks: Vec<Vec<Lanes>> = workers::map(0..readings.blocks().len(), |block| {
        let rows = &readings.blocks()[block].rows;
        let mut ws = Workspace::default();
        let mut a = readings.raw(block).to_vec();
        for _ in 0..INVERSIONS {
            model.evaluate(&readings, block, &a, &beta, Want { x: false, a: false }, &mut ws);
            for (c, reading) in a.iter_mut().enumerate() {
                let wanted = Lanes(rows.map(|row| angles[row][c]));
                *reading += (wanted - ws.angles[c]) * (1.0 / model.scales[c].gain);
            }
        }
        a
    });
    let mut table = readings.table.clone();
    for (block, a) in readings.blocks().iter().zip(&blocks) {
        for (lane, &row) in block.rows.iter().enumerate().take(block.live.min(WIDTH)) {
            for (c, reading) in a.iter().enumerate() {
                table.values[row * channels + c] = reading.0[lane];
            }
        }
    }
    Ok(Reachable { poses, table, channels, span: vec![[0.0; 2]; channels] })
}

/// Steps by which sensors are inverted: their corrections change little with the reading.
const INVERSIONS: usize = 4;

/// Random configurations, closed under the estimate, for each combination of keys in the session.
fn by_closing(
    at: &Linearised<'_>,
    session: &Readings,
    within: Option<Within>,
    count: usize,
    random: &mut Random,
) -> Result<Reachable, Error> {
    let mechanism = &at.model.mechanism;
    let channels = mechanism.channels.len();
    let visited = (session, &at.session.weights[..]);
    let configurations = Configurations::of_keys(mechanism, session.groups.clone())
        .within_shown(&at.model, visited, &at.beta);
    let each = count.div_ceil(session.groups.len().max(1));
    let under = |readings: &Readings| {
        let (model, columns) = at.under(configurations.mechanism(), readings)?;
        let beta = at.beta_of(&columns);
        Ok((model, beta))
    };
    let readings = configurations.closed_by(each, random, &under)?;
    let rows = readings.samples;
    let table = Table { pose: Some((1..=rows as i64).collect()), ..readings.table.clone() };
    let poses = if mechanism.platform.is_empty() {
        Vec::new()
    } else {
        let (model, beta) = under(&readings)?;
        poses_of(&model, &readings, &beta, &at.noise)
    };
    let found = Reachable {
        poses,
        table: Table { ..with_still(table, session, rows) },
        channels,
        span: vec![[0.0; 2]; channels],
    };
    let Some(within) = within.filter(|_| !found.poses.is_empty()) else { return Ok(found) };
    let inside = |k: &usize| {
        found.poses[*k].iter().zip(&within).all(|(v, [low, high])| v >= low && v <= high)
    };
    let kept: Vec<usize> = (0..rows).filter(inside).collect();
    Ok(found.some(&kept))
}

/// A table of so many rows that are read after a session: its last temperature and session.
fn still(session: &Readings, rows: usize) -> Table {
    with_still(Table::default(), session, rows)
}

fn with_still(table: Table, session: &Readings, rows: usize) -> Table {
    let last = |column: &Option<Vec<f64>>| {
        column.as_ref().and_then(|c| c.last()).map(|value| vec![*value; rows])
    };
    Table {
        temperature: last(&session.table.temperature),
        session: (session.sessions > 1).then(|| vec![session.sessions - 1; rows]),
        ..table
    }
}

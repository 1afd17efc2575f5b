//! Poses that a mechanism can take under an estimate, with the readings to expect.
//!
//! In a box, the joints of a pose are computed as drawn, of the hand controller by (6) to (8); the sensors of the
//! estimate are then inverted. Where the estimate differs from the drawing, and nothing computes its joints, loops are
//! closed on the way to there. Without a box random configurations are closed under the estimate.

use crate::numerics::order::Ends;
use nalgebra::Vector3;

use crate::Error;
use crate::apply::poses::poses_of;
use crate::design::linearised::Linearised;
use crate::design::reach::{has_closed_form, inverse};
use crate::mechanism::{Channel, Mechanism};
use crate::model::assembly::{inverse_from, placed};
use crate::model::been::Been;
use crate::model::configurations::{Configurations, Under};
use crate::model::{Model, Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::{Readings, Table};
use crate::text::listed_numbers;

/// A box of poses: lowest and highest x, y, z (length unit), rx, ry, rz (rad).
pub type Within = [[f64; 2]; 6];

/// Readings that a pose keeps from the ends of the range: offsets are not known beforehand.
pub const MARGIN: f64 = 20.0;

/// Share of a channel's range that a pose keeps from each end, where the channel does not count.
const FROM_RANGE: f64 = 0.005;

/// A pose is struck off with all poses within this share of what the channels go through.
const NEAR: f64 = 0.05;

/// Configurations among which the one as drawn is looked for.
const DRAWN: usize = 64;

/// Where fewer than one of so many candidates is in the box by itself, goals in the box are drawn. Stated: the search of
/// their joints takes most of a plan's time, and few candidates make a worse plan.
const FEW: usize = 4;

/// Fewest candidates of a plan.
const FEWEST: usize = 20;

/// Upper limit of poses, candidates and starts.
const MOST: usize = 1_000_000;

/// Refuses numbers of poses, candidates and starts that cannot be used.
pub(crate) fn check_counts(counts: &[(&'static str, usize)]) -> Result<(), Error> {
    match counts.iter().find(|(_, value)| !(1..=MOST).contains(value)) {
        Some((name, value)) => {
            Err(Error::option(name, value, format!("at least 1 and at most {MOST}")))
        }
        None => Ok(()),
    }
}

/// The box of a workspace, given or the mechanism's own.
///
/// # Errors
///
/// [`Error::Option`] for a mechanism whose workspace is not known, and for ends that are not
/// numbers or not in order.
pub fn workspace(mechanism: &Mechanism, within: Option<Within>) -> Result<Within, Error> {
    let known = within.or_else(|| mechanism.workspace.map(|w| w.bounds()));
    let expected = "lowest and highest x, y, z, rx, ry, rz";
    let Some(within) = known else {
        let found = format!("no workspace of '{}'", mechanism.name);
        return Err(Error::option("within", found, expected));
    };
    let ordered = |[low, high]: &[f64; 2]| low.is_finite() && high.is_finite() && low <= high;
    if !within.iter().all(ordered) {
        let expected = "six pairs of numbers, the lower end first";
        return Err(Error::option("within", listed_numbers(within.as_flattened()), expected));
    }
    Ok(within)
}

/// Candidates for the poses of a plan.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    /// Platform poses; empty without a platform.
    pub(crate) poses: Vec<[f64; 6]>,
    /// Readings, keys of unknown points and measured distances.
    pub(crate) table: Table,
    pub(crate) channels: usize,
    /// Lowest and highest reading of each channel.
    pub(crate) span: Vec<[f64; 2]>,
}

impl Candidates {
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

    /// An order in which the next of some candidates is never far, the nearest each time; and the
    /// length of the way from where it begins.
    pub(crate) fn tour(&self, mut left: Vec<usize>, from: &[f64]) -> (Vec<usize>, f64) {
        let (mut here, mut way) = (from, 0.0);
        let mut tour = Vec::with_capacity(left.len());
        left.sort_unstable(); // of two that are as near, the earlier candidate
        while !left.is_empty() {
            let far = |i: usize| self.distance(here, self.row(left[i]));
            let next = (1..left.len()).fold(0, |best, i| if far(i) < far(best) { i } else { best });
            way += far(next);
            let next = left.remove(next);
            here = self.row(next);
            tour.push(next);
        }
        (tour, way)
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

    /// Those for which this holds.
    fn that(&self, holds: impl Fn(usize) -> bool) -> Self {
        self.some(&(0..self.len()).filter(|&k| holds(k)).collect::<Vec<_>>())
    }

    /// Lowest and highest reading of each channel.
    fn spanned(&self) -> Vec<[f64; 2]> {
        let column = |c: usize| self.table.values.iter().skip(c).step_by(self.channels).copied();
        let span = |c| column(c).fold([f64::MAX, f64::MIN], |[l, h], v| [l.min(v), h.max(v)]);
        (0..self.channels).map(span).collect()
    }
}

/// Where candidates are drawn.
#[derive(Clone, Copy)]
pub(crate) struct Space<'a> {
    pub(crate) at: &'a Linearised<'a>,
    /// The box; joint limits where none is known.
    pub(crate) within: Option<Within>,
    /// Readings of poses that are struck off, row by row.
    pub(crate) off: &'a [f64],
    /// Share of a channel's limits that a pose keeps from each end.
    pub(crate) from_limits: f64,
}

impl Space<'_> {
    /// Candidates within the box, joint limits and ranges, each with a margin.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] where hardly any pose is left; as [`Linearised::under`].
    pub(crate) fn draw(&self, count: usize, random: &mut Random) -> Result<Candidates, Error> {
        let found = match self.of_poses() {
            Some(within) => self.at_poses(drawn(&within, count, random))?,
            None => match self.within.filter(|_| !self.mechanism().platform.is_empty()) {
                Some(within) => self.on_the_way(&within, count, random)?,
                None => self.by_closing(count, random)?,
            },
        };
        let mut found = self.with_margins(&found);
        found.span = found.spanned();
        let found = self.not_off(&found);
        if found.len() < FEWEST {
            let found = format!("{} poses within reach, joint limits and ranges", found.len());
            let expected = match self.off.is_empty() {
                true => "a box that the mechanism can reach",
                false => "a box that the mechanism can reach, with poses that are not struck off",
            };
            return Err(Error::option("within", found, expected));
        }
        Ok(found)
    }

    /// These poses again and others around each, within so large a share of the box to each side; none
    /// where the joints of a pose are not computed.
    ///
    /// # Errors
    ///
    /// As [`Linearised::under`].
    pub(crate) fn around(
        &self,
        poses: &Candidates,
        (share, each): (f64, usize),
        random: &mut Random,
    ) -> Result<Option<Candidates>, Error> {
        let Some(within) = self.of_poses() else { return Ok(None) };
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
        let mut found = self.with_margins(&self.at_poses(drawn)?);
        found.span.clone_from(&poses.span);
        Ok(Some(self.not_off(&found)))
    }

    /// The box, where the joints of a pose are computed.
    fn of_poses(&self) -> Option<Within> {
        let model = &self.at.model;
        self.within.filter(|_| has_closed_form(&model.mechanism) || self.at.is_as_drawn())
    }

    /// Those that keep the margins of every channel.
    fn with_margins(&self, found: &Candidates) -> Candidates {
        let model = &self.at.model;
        found.that(|k| {
            let channels = model.mechanism.channels.iter().zip(&model.scales);
            found.row(k).iter().zip(channels).all(|(reading, (channel, scale))| {
                let angle = scale.angle + scale.gain * (reading - scale.centre);
                self.keeps(channel, *reading, angle)
            })
        })
    }

    /// True where a reading keeps the margins of its channel.
    fn keeps(&self, channel: &Channel, reading: f64, angle: f64) -> bool {
        let between = |value: f64, [low, high]: [f64; 2], margin: f64| {
            value >= low + margin && value <= high - margin
        };
        let margin = |[low, high]: [f64; 2]| {
            if channel.counts() { MARGIN } else { FROM_RANGE * (high - low) }
        };
        reading.is_finite()
            && channel.range.is_none_or(|range| between(reading, range, margin(range)))
            && channel.limits.is_none_or(|l| between(angle, l, self.from_limits * (l[1] - l[0])))
    }

    /// Without candidates near poses that were struck off.
    fn not_off(&self, found: &Candidates) -> Candidates {
        let off = self.off.chunks_exact(found.channels);
        match off.len() {
            0 => found.clone(),
            _ => found.that(|k| off.clone().all(|row| found.distance(found.row(k), row) > NEAR)),
        }
    }

    /// Those of the poses that are in reach, with the readings to expect.
    fn at_poses(&self, drawn: Vec<[f64; 6]>) -> Result<Candidates, Error> {
        // Of several ways to hold a pose, the one in which the session was.
        self.reached(drawn, inverse(self.mechanism(), Some(self.middle())))
    }

    /// Joint coordinates at the mean readings of the session.
    fn middle(&self) -> Vec<f64> {
        let mean = self.at.model.scales.iter().zip(&self.at.session.readings.mean);
        mean.map(|(scale, mean)| scale.angle + scale.gain * (mean - scale.centre)).collect()
    }

    /// The same of those that this reaches.
    fn reached(
        &self,
        drawn: Vec<[f64; 6]>,
        inverse: impl Fn(&[f64; 6]) -> Result<Vec<f64>, Error> + Sync,
    ) -> Result<Candidates, Error> {
        let channels = self.mechanism().channels.len();
        let joints = workers::map(&drawn, |pose| match inverse(pose) {
            Ok(angles) => Ok(Some(angles)),
            Err(Error::OutOfReach { .. }) => Ok(None),
            Err(other) => Err(other),
        });
        let joints: Vec<_> = joints.into_iter().collect::<Result<_, _>>()?;
        let reached = drawn.into_iter().zip(joints).filter_map(|(pose, own)| Some((pose, own?)));
        let (poses, angles): (Vec<_>, Vec<_>) = reached.unzip();
        let span = vec![[0.0; 2]; channels];
        if poses.is_empty() {
            return Ok(Candidates { channels, span, ..Candidates::default() });
        }
        let mut table = self.still(Table::default(), poses.len());
        table.values = self.readings_of(&angles)?;
        Ok(Candidates { poses, table, channels, span })
    }

    /// Readings at which the sensors have these joint coordinates.
    fn readings_of(&self, angles: &[Vec<f64>]) -> Result<Vec<f64>, Error> {
        let at = self.at;
        let channels = at.model.mechanism.channels.len();
        let free = |c: &Channel| Channel { range: None, limits: None, ..c.clone() };
        let bare = Mechanism {
            channels: at.model.mechanism.channels.iter().map(free).collect(),
            ..at.model.mechanism.clone()
        };
        let first = |angles: &Vec<f64>| -> Vec<f64> {
            let scales = at.model.scales.iter().zip(angles);
            scales.map(|(s, angle)| s.centre + (angle - s.angle) / s.gain).collect()
        };
        let mut table = self.still(Table::default(), angles.len());
        table.values = angles.iter().flat_map(first).collect();
        let readings = Readings::beside(&bare, table, &at.session.readings)?;
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
        let mut values = readings.table.values.clone();
        for (block, a) in readings.blocks().iter().zip(&blocks) {
            for (lane, &row) in block.rows.iter().enumerate().take(block.live.min(WIDTH)) {
                for (c, reading) in a.iter().enumerate() {
                    values[row * channels + c] = reading.0[lane];
                }
            }
        }
        Ok(values)
    }

    fn mechanism(&self) -> &Mechanism {
        &self.at.model.mechanism
    }

    /// Random configurations, closed under the estimate, for each combination of keys in the session.
    fn by_closing(&self, count: usize, random: &mut Random) -> Result<Candidates, Error> {
        let configurations = self.configurations();
        let each = count.div_ceil(configurations.combinations().max(1));
        let under = |readings: &Readings| self.under(&configurations, readings);
        let readings = match &mut self.been(&configurations, &under)? {
            None => configurations.closed_by(each, random, &under)?,
            Some(been) => {
                let mut draw = |keys: &[usize], random: &mut _| been.draw(keys, random, &under);
                configurations.closed_of(each, random, 1, &mut draw)?
            }
        };
        self.closed(&readings, &under)
    }

    /// Configurations on the way to random poses of a box, closed under the estimate: those that arrive in it.
    fn on_the_way(
        &self,
        within: &Within,
        count: usize,
        random: &mut Random,
    ) -> Result<Candidates, Error> {
        let configurations = self.configurations();
        let under = |readings: &Readings| self.under(&configurations, readings);
        let all = configurations.combinations().max(1);
        let inside = |found: Candidates| {
            found.that(|k| {
                let mut ends = found.poses[k].iter().zip(within);
                ends.all(|(v, [low, high])| v >= low && v <= high)
            })
        };
        // What needs no goal needs no search of its joints either.
        let anywhere = inside(self.by_closing(count, random)?);
        if anywhere.len() >= count.div_ceil(FEW) {
            return Ok(anywhere);
        }
        let found = match &mut self.been(&configurations, &under)? {
            None => return Ok(anywhere),
            Some(been) => {
                let near = |pose: &[f64; 6]| inverse_from(self.mechanism(), pose, self.middle());
                let goals = self.reached(drawn(within, count, random), near)?;
                let keys: Vec<usize> = (0..goals.len()).map(|k| k % all).collect();
                let drawn = been.draw_to((&keys, &goals.table.values), random, &under)?;
                let mut closed = vec![Vec::new(); all];
                for (key, drawn) in keys.into_iter().zip(drawn) {
                    closed[key].extend(drawn);
                }
                if closed.iter().all(Vec::is_empty) {
                    let channels = goals.channels;
                    let span = vec![[0.0; 2]; channels];
                    return Ok(Candidates { channels, span, ..Candidates::default() });
                }
                self.closed(&configurations.readings_of(&closed)?, &under)?
            }
        };
        Ok(inside(found))
    }

    /// Of each combination of keys in the session.
    fn configurations(&self) -> Configurations {
        let (at, session) = (self.at, &self.at.session.readings);
        let made = Configurations::of_keys(self.mechanism(), session.groups.clone());
        made.within_shown(&at.model, (session, &at.session.weights), &at.beta)
    }

    /// The model of the estimate, of other readings, and its parameters.
    fn under(
        &self,
        configurations: &Configurations,
        readings: &Readings,
    ) -> Result<(Model, Vec<f64>), Error> {
        let (model, columns) = self.at.under(configurations.mechanism(), readings)?;
        let beta = self.at.beta_of(&columns);
        Ok((model, beta))
    }

    /// Candidates of closed configurations.
    fn closed(&self, readings: &Readings, under: &Under<'_>) -> Result<Candidates, Error> {
        let poses = match self.mechanism().platform.is_empty() {
            true => Vec::new(),
            false => {
                let (model, beta) = under(readings)?;
                poses_of(&model, readings, &beta, &self.at.noise)
            }
        };
        let channels = readings.channels;
        let table = self.still(readings.table.clone(), readings.samples);
        Ok(Candidates { poses, table, channels, span: vec![[0.0; 2]; channels] })
    }

    /// Where the mechanism has been: in the poses of the session or, before one, as it is drawn. None where all
    /// configurations are as good: nothing closes a loop but what is touched.
    fn been<'a>(
        &self,
        configurations: &'a Configurations,
        under: &Under<'_>,
    ) -> Result<Option<Been<'a>>, Error> {
        let (at, session) = (self.at, self.at.session);
        let mechanism = &at.model.mechanism;
        if session.weights.iter().any(|weight| *weight > 0.0) {
            let been = (&at.model, &*session.readings, &at.beta[..]);
            return Ok(Been::new(configurations, been, &session.weights));
        }
        if mechanism.platform.is_empty() {
            return Ok(None);
        }
        let drawn = configurations.closed_by(DRAWN, &mut Random::new(0), under)?;
        let (model, beta) = under(&drawn)?;
        let poses = poses_of(&model, &drawn, &beta, &at.noise);
        let off: Vec<f64> = poses.iter().map(|pose| from_drawn(mechanism, pose)).collect();
        let nearest = (0..off.len()).least_by(|&a| off[a]);
        let weights: Vec<f64> =
            (0..off.len()).map(|row| f64::from(u8::from(Some(row) == nearest))).collect();
        Ok(Been::new(configurations, (&model, &drawn, &beta), &weights))
    }

    /// A table of so many poses that are read after a session: with its last temperature and session.
    fn still(&self, table: Table, rows: usize) -> Table {
        let session = &self.at.session.readings;
        let last = |column: &Option<Vec<f64>>| {
            column.as_ref().and_then(|c| c.last()).map(|value| vec![*value; rows])
        };
        Table {
            pose: Some((1..=rows as i64).collect()),
            temperature: last(&session.table.temperature),
            session: (session.sessions > 1).then(|| vec![session.sessions - 1; rows]),
            ..table
        }
    }
}

/// How far a pose is from the one at rest, square of the distances of its points; without one, from a
/// pose that is turned as the platform is drawn.
fn from_drawn(mechanism: &Mechanism, pose: &[f64; 6]) -> f64 {
    let rest = mechanism.rest.as_ref().map(|rest| rest.pose);
    let there = placed(mechanism, &rest.unwrap_or_default());
    let ways = placed(mechanism, pose).into_iter().zip(there).map(|((_, a), (_, b))| a - b);
    let ways: Vec<Vector3<f64>> = ways.collect();
    let moved = match rest {
        Some(_) => Vector3::zeros(),
        None => ways.iter().sum::<Vector3<f64>>() / ways.len() as f64,
    };
    ways.iter().map(|way| (way - moved).norm_squared()).sum()
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

/// Steps by which sensors are inverted: their corrections change little with the reading.
const INVERSIONS: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_comes_next_and_the_way_is_what_was_gone() {
        let table = Table { values: vec![5.0, 1.0, -2.0, 1.5], ..Table::default() };
        let found = Candidates { poses: vec![], table, channels: 1, span: vec![[0.0, 1.0]] };
        let (order, way) = found.tour(vec![3, 0, 2, 1], &[0.0]);
        // 0 → 1 → 1.5 → 5, which is as near as -2 and the earlier candidate → -2.
        assert_eq!(order, [1, 3, 0, 2]);
        assert_eq!(way, 1.0 + 0.5 + 3.5 + 7.0);
    }
}

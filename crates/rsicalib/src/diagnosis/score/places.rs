//! Scores of wrong readings and of slips: thousands, of one column each, by running sums over poses.

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, MOST_TIMES, Scored};
use crate::estimate::Observations;
use crate::estimate::at_fit::{AtFit, Column};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::order::Ends;
use crate::numerics::symmetric::{SEEN, left_out};
use crate::numerics::workers;
use crate::terms::find;
use crate::terms::targets::searchable;

/// Poses on either side of a slip that must see it: more than two, and so at least three. Two that
/// are off alike are two wrong readings.
pub const POSES_EACH_SIDE: f64 = 2.5;

/// A pose sees a slip that changes its χ² by this much, two standard deviations; one that changes it
/// by less counts in part.
const SEES: f64 = 4.0;

/// True where enough poses see a slip, which changes χ² of each by these, times `by`.
fn seen(each: &[f64], by: f64) -> bool {
    let mut poses = 0.0;
    each.iter().any(|own| {
        poses += (own * by / SEES).min(1.0);
        poses >= POSES_EACH_SIDE
    })
}

/// Of more poses than this, several channels are worked on at once.
const MANY: usize = 1000;

/// A slip of a channel at one time: the sums over all poses from there on.
#[derive(Clone)]
struct Time {
    /// Place among the poses that count.
    order: usize,
    column: Column,
}

/// Scores of one degree of freedom below this are never named, at however few times.
const SURPRISE: f64 = 4.0;

/// Scores bad readings and bad poses alone.
///
/// # Errors
///
/// As [`score`].
pub fn bad_readings(at: &AtFit, judge: &Judge) -> Result<Vec<Scored>, Error> {
    score(at, judge, &["slip".to_owned()])
}

/// Scores bad readings, bad poses and slips by running sums over poses.
///
/// # Errors
///
/// [`Error::Unknown`] where the catalogue lacks one of their terms.
pub fn score(at: &AtFit, judge: &Judge, without: &[String]) -> Result<Vec<Scored>, Error> {
    let poses = Poses::new(at, judge);
    let Observations { mechanism, readings, .. } = at.observations;
    let allowed = |id: &str| !without.iter().any(|w| w == id);
    let (slip, bad) = (find("slip")?, find("bad_reading")?);
    let slips = allowed("slip") && searchable(slip, mechanism, readings).is_ok();
    let together = if slips { slip.shared_by(mechanism) } else { Vec::new() };
    let number = readings.channels + together.len();
    let of_target = |k: usize| {
        let target = if k < readings.channels {
            Target::Channel(k)
        } else {
            together[k - readings.channels]
        };
        let mut scored = Vec::new();
        if allowed("bad_reading") && !target.is_shared() {
            scored = poses.bad_of(Instance { term: bad, target, place: 0 });
        }
        if slips {
            scored.extend(poses.slips_of(Instance { term: slip, target, place: 0 }, number));
        }
        scored
    };
    let parts: Vec<Vec<Scored>> = match poses.live.len() > MANY {
        true => workers::map(0..number, of_target),
        false => (0..number).map(of_target).collect(),
    };
    let mut scored = parts.concat();
    if allowed("bad_reading") && readings.held {
        scored.extend(poses.bad_poses(Instance { term: bad, target: Target::All, place: 0 }));
    }
    Ok(scored)
}

/// The poses that count, at a fit.
struct Poses<'a> {
    at: &'a AtFit<'a>,
    judge: &'a Judge,
    /// The poses that count, from 0.
    live: Vec<usize>,
    /// Their rows that count.
    rows: Vec<Vec<usize>>,
    /// The number of all their rows.
    samples: Vec<usize>,
}

/// Places that a wrong reading may have in so many rows: each channel, and the whole row. One equation does not tell
/// whose reading it is.
pub(crate) fn wrong_readings(observations: &Observations, equations: usize, rows: usize) -> f64 {
    let kinds = if equations == 1 { 1 } else { observations.readings.channels + 1 };
    (rows * kinds) as f64
}

impl<'a> Poses<'a> {
    fn new(at: &'a AtFit<'a>, judge: &'a Judge) -> Self {
        let Observations { readings, weights, .. } = at.observations;
        let (mut live, mut rows, mut samples) = (Vec::new(), Vec::new(), Vec::new());
        for (pose, all) in readings.rows_of_poses().into_iter().enumerate() {
            let total = all.len();
            let counted: Vec<usize> = all.into_iter().filter(|&r| weights[r] > 0.0).collect();
            if !counted.is_empty() {
                live.push(pose);
                samples.push(total);
                rows.push(counted);
            }
        }
        Self { at, judge, live, rows, samples }
    }

    /// A candidate that is not [judged](Self::judged) yet; none where it is fitted.
    fn scored(&self, instance: Instance, family: Family, tests: f64, score: f64) -> Option<Scored> {
        let new = !self.at.fit.model.instances.contains(&instance);
        new.then(|| Scored::of(instance, family, score, 1.0, 1.0, tests))
    }

    /// The same with the probabilities of what could be named, and of the best: that of any other is
    /// not looked at, and takes longer than its score.
    fn judged(&self, mut scored: Vec<Scored>) -> Vec<Scored> {
        let best = scored.iter().map(|s| s.score).fold(f64::NEG_INFINITY, f64::max);
        for one in scored.iter_mut().filter(|s| s.score > SURPRISE || s.score == best) {
            *one = one.judged(self.judge);
        }
        scored
    }

    /// Adds the entries of a column in one pose: of a channel, or of several of one make.
    fn add(&self, column: &mut Column, channels: &[usize], order: usize) {
        for equation in self.rows[order].iter().flat_map(|&row| self.at.equations(row)) {
            let by = channels.iter().map(|&channel| self.at.by_reading(equation, channel));
            column.add(self.at, equation, by.sum());
        }
    }

    /// Number of tests for bad readings: of stretches, those of all rows of the recording, which
    /// were looked through for rows that stand apart.
    fn tests_bad(&self) -> f64 {
        let merged = self.at.observations.readings.merged.as_ref();
        let rows = merged.map_or(self.live.len(), |merged| merged.rows);
        wrong_readings(self.at.observations, self.at.residuals.equations, rows)
    }

    /// Scores of wrong readings of one channel. A recording has millions: of those that nobody
    /// could name, which would cost time and memory, it keeps the best.
    fn bad_of(&self, of: Instance) -> Vec<Scored> {
        let channels = self.at.observations.mechanism.channels_at(of.target);
        let held = self.at.observations.readings.held;
        let tests = self.tests_bad();
        let (mut scored, mut column) = (Vec::new(), Column::new(self.at.rank()));
        let mut dull: Option<(f64, Instance)> = None;
        for (order, &place) in self.live.iter().enumerate().rev() {
            column.clear();
            self.add(&mut column, &channels, order);
            let Some(score) = column.score(&self.at.pull, SEEN) else { continue };
            let instance = Instance { place, ..of };
            if held || score > SURPRISE {
                scored.extend(self.scored(instance, Family::Bad, tests, score));
            } else if dull.is_none_or(|(best, _)| score > best) {
                dull = Some((score, instance));
            }
        }
        let best = dull.and_then(|(score, i)| self.scored(i, Family::Bad, tests, score));
        scored.extend(best);
        self.judged(scored)
    }

    /// Scores of poses that are wrong as a whole.
    fn bad_poses(&self, of: Instance) -> Vec<Scored> {
        let mut scored = Vec::new();
        for (order, &place) in self.live.iter().enumerate() {
            if self.samples[order] > 1 {
                continue; // repeats: a pose is judged where it is averaged
            }
            let row = self.rows[order][0];
            let r = &self.at.residuals.whitened[self.at.equations(row)];
            let Some((score, width)) = left_out(&self.at.hat(row), r) else { continue };
            let p_value = self.judge.p_value(score, width);
            let (instance, tests) = (Instance { place, ..of }, self.tests_bad());
            scored.push(Scored::of(instance, Family::Bad, score, width, p_value, tests));
        }
        scored
    }

    /// The sums from one pose later on, with this pose; what this pose adds to `ZᵀZ`.
    fn earlier(&self, time: &mut Time, channels: &[usize], order: usize) -> f64 {
        let zz = time.column.zz;
        self.add(&mut time.column, channels, order);
        time.order = order;
        time.column.zz - zz
    }

    /// Scores of slips of one of `number` targets: at [`MOST_TIMES`] times at the most, and then at every one about
    /// the best.
    fn slips_of(&self, of: Instance, number: usize) -> Vec<Scored> {
        let channels = self.at.observations.mechanism.channels_at(of.target);
        let stride = self.live.len().div_ceil(MOST_TIMES).max(1);
        let end = Time { order: self.live.len(), column: Column::new(self.at.rank()) };
        let (mut after, mut times) = (end.clone(), Vec::new());
        let mut each = vec![0.0; self.live.len()];
        for order in (0..self.live.len()).rev() {
            each[order] = self.earlier(&mut after, &channels, order);
            if order > 0 && order % stride == 0 {
                times.push(after.clone());
            }
        }
        // No three poses see a slip so near an end.
        times.retain(|time| time.order.min(self.live.len() - time.order) as f64 > POSES_EACH_SIDE);
        let score = |time: &Time| {
            let score = time.column.score(&self.at.pull, SEEN)?;
            let (before, after) = each.split_at(time.order);
            let squared = score / time.column.left();
            (seen(before, squared) && seen(after, squared)).then_some(score)
        };
        let score_of = |time: &Time| score(time).unwrap_or(0.0);
        let best = (0..times.len()).greatest_by(|i| score_of(&times[*i])).filter(|_| stride > 1);
        if let Some(best) = best {
            // Every time between the neighbours of the best, from the sums of the later one.
            let mut time = best.checked_sub(1).map_or(&end, |later| &times[later]).clone();
            let first = times.get(best + 1).map_or(0, |earlier| earlier.order);
            for order in (first + 1..time.order).rev() {
                self.earlier(&mut time, &channels, order);
                if score_of(&time) > score_of(&times[best]) {
                    times[best] = time.clone();
                }
            }
        }
        // It pays for every target and time at which it could have been. Rows that tell no time are
        // not known to be in its order, pose by pose: each may be a time of its own.
        let readings = &self.at.observations.readings;
        let tried = if readings.timed { times.len() * stride } else { readings.taken };
        let tests = (number * tried) as f64;
        let scored = |time: &Time| {
            let instance = Instance { place: self.live[time.order], ..of };
            let score = score(time)?;
            self.scored(instance, Family::Slip, tests, score)
        };
        self.judged(times.iter().filter_map(scored).collect())
    }
}

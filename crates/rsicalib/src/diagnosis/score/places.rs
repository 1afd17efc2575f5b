//! Scores of wrong readings and of slips: thousands, of one column each, by running sums over poses.

use faer::Mat;
use rayon::prelude::*;

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part, Residuals};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::distributions;
use crate::numerics::symmetric::{SEEN, dot, left_out};
use crate::terms::find;

/// At most this many times are tried for a slip of one channel, and then every one about the best.
const MOST_TIMES: usize = 256;

/// Poses on either side of a slip that must see it, each by its share of what they see: more than
/// two, and so at least three. Two that are off alike are two wrong readings.
const SIDE: f64 = 2.5;

/// So many poses as see all alike see as much as these, which see so much each (Kish).
#[derive(Clone, Copy, Default)]
struct Seen {
    sum: f64,
    squares: f64,
}

impl Seen {
    fn add(&mut self, information: f64) {
        self.sum += information;
        self.squares += information * information;
    }

    fn without(self, other: Self) -> Self {
        Self { sum: self.sum - other.sum, squares: self.squares - other.squares }
    }

    fn poses(self) -> f64 {
        self.sum * self.sum / self.squares.max(f64::MIN_POSITIVE)
    }
}

/// Of more poses than this, several are worked on at once.
const MANY: usize = 1000;

/// What the fit absorbs of any column of one pose, `X (XᵀX)⁻¹ Xᵀ` there, pose by pose.
struct Hats {
    /// Where each pose's matrix starts, and where the last one ends.
    starts: Vec<usize>,
    /// The matrices, row by row.
    entries: Vec<f64>,
}

impl Hats {
    fn new(residuals: &Residuals, rows: &[Vec<usize>], inverse: &[f64], n: usize) -> Self {
        let k = residuals.equations;
        let mut starts = vec![0];
        for rows in rows {
            starts.push(starts[starts.len() - 1] + (rows.len() * k).pow(2));
        }
        let x = |row: usize, e: usize| &residuals.by_parameter[(row * k + e) * n..][..n];
        let of_poses = |poses: &[Vec<usize>]| {
            let mut entries = Vec::new();
            let (mut columns, mut absorbed) = (Vec::new(), vec![0.0; n]);
            for rows in poses {
                columns.clear();
                columns.extend(rows.iter().flat_map(|&row| (0..k).map(move |e| x(row, e))));
                for left in &columns {
                    // (XᵀX)⁻¹ times a row of X, column by column.
                    absorbed.fill(0.0);
                    for (value, column) in left.iter().zip(inverse.chunks_exact(n.max(1))) {
                        absorbed.iter_mut().zip(column).for_each(|(sum, v)| *sum += value * v);
                    }
                    entries.extend(columns.iter().map(|right| dot(&absorbed, right)));
                }
            }
            entries
        };
        let entries = match rows.len() > MANY {
            true => rows.par_chunks(MANY).map(of_poses).collect::<Vec<_>>().concat(),
            false => of_poses(rows),
        };
        Self { starts, entries }
    }

    fn part(&self, order: usize) -> &[f64] {
        &self.entries[self.starts[order]..self.starts[order + 1]]
    }

    /// `zᵀ H z`
    fn form(&self, order: usize, z: &[f64]) -> f64 {
        let rows = self.part(order).chunks_exact(z.len().max(1));
        rows.zip(z).map(|(row, value)| value * dot(row, z)).sum()
    }

    fn of(&self, order: usize) -> Mat<f64> {
        let part = self.part(order);
        let m = part.len().isqrt();
        Mat::from_fn(m, m, |i, j| part[i * m + j])
    }
}

/// One candidate of one column: `Zᵀr`, `ZᵀZ`, `ZᵀX`, and `ZᵀX (XᵀX)⁻¹`.
#[derive(Clone)]
struct Column {
    r: f64,
    zz: f64,
    zx: Vec<f64>,
    absorbed: Vec<f64>,
}

impl Column {
    fn new(n: usize) -> Self {
        Self { r: 0.0, zz: 0.0, zx: vec![0.0; n], absorbed: Vec::new() }
    }

    fn projected(mut self, inverse: &[f64]) -> Self {
        let along = |row: &[f64]| dot(row, &self.zx);
        self.absorbed = inverse.chunks_exact(self.zx.len().max(1)).map(along).collect();
        self
    }

    /// `M` of (71).
    fn left(&self) -> f64 {
        self.zz - dot(&self.zx, &self.absorbed)
    }

    /// `T` of (72); none where nothing of the column is left.
    fn score(&self) -> Option<f64> {
        let left = self.left();
        (left > SEEN * self.zz).then(|| self.r * self.r / left)
    }
}

/// A slip of a channel at one time: the sums over all poses from there on.
#[derive(Clone)]
struct Time {
    /// Place among the poses that count.
    order: usize,
    /// What those poses see of it.
    seen: Seen,
    column: Column,
}

/// Angles between the projected columns of a slip at one time and at the next.
///
/// The later column is part of the earlier one, so `ZᵢᵀZⱼ` is its own square.
fn turns(times: &[Time]) -> Vec<f64> {
    let angle = |later: &Column, earlier: &Column| {
        let shared = later.zz - dot(&later.zx, &earlier.absorbed);
        let cosine = shared / (later.left() * earlier.left()).max(f64::MIN_POSITIVE).sqrt();
        cosine.clamp(-1.0, 1.0).acos()
    };
    times.windows(2).map(|pair| angle(&pair[0].column, &pair[1].column)).collect()
}

/// Scores of one degree of freedom below this are never named, at however few times.
const SURPRISE: f64 = 4.0;

/// Number of independent tests that tests one after another amount to, at a score:
/// neighbours score alike. Efron's length heuristic (Biometrika 84, 1997).
///
/// `stride` steps lie within each turn. Each pose adds to the sums something new, so the squares of
/// the steps' own turns add up to the square of the whole.
fn declumped(turns: &[f64], stride: usize, score: f64) -> f64 {
    let steps = stride as f64;
    let half = 0.5 * score.max(0.0).sqrt() / steps.sqrt();
    let new = |turn: &f64| steps * (2.0 * distributions::normal_cdf(half * turn) - 1.0);
    1.0 + turns.iter().map(new).sum::<f64>()
}

/// Scores bad readings and bad poses alone.
///
/// # Errors
///
/// As [`Model::new`].
pub fn bad_readings(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
) -> Result<Vec<Scored>, Error> {
    let (inverse, ..) = crate::numerics::symmetric::invert(&fit.gram);
    score(observations, fit, judge, &inverse, &["slip".to_owned()])
}

/// Scores bad readings, bad poses and slips by running sums over poses.
pub fn score(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    inverse: &Mat<f64>,
    without: &[String],
) -> Result<Vec<Scored>, Error> {
    let poses = Poses::new(observations, fit, judge, inverse);
    let readings = &observations.readings;
    let allowed = |id: &str| !without.iter().any(|w| w == id);
    let (slip, bad) = (find("slip")?, find("bad_reading")?);
    let slips = allowed("slip")
        && crate::terms::targets::provided(slip, &observations.mechanism, readings).is_ok();
    let of_channel = |channel: usize| {
        let target = Target::Channel(channel);
        let mut scored = Vec::new();
        if allowed("bad_reading") {
            scored = poses.bad_of(channel, Instance { term: bad, target, place: 0 });
        }
        if slips {
            scored.extend(poses.slips_of(channel, Instance { term: slip, target, place: 0 }));
        }
        scored
    };
    let channels = 0..readings.channels;
    let parts: Vec<Vec<Scored>> = match poses.live.len() > MANY {
        true => channels.into_par_iter().map(of_channel).collect(),
        false => channels.map(of_channel).collect(),
    };
    let mut scored = parts.concat();
    if allowed("bad_reading") && readings.held {
        scored.extend(poses.bad_poses(Instance { term: bad, target: Target::All, place: 0 }));
    }
    Ok(scored)
}

/// The poses that count, and what a fit leaves there.
struct Poses<'a> {
    observations: &'a Observations,
    fit: &'a Fit,
    judge: &'a Judge,
    residuals: Residuals,
    /// The poses that count, from 0.
    live: Vec<usize>,
    /// Their rows that count.
    rows: Vec<Vec<usize>>,
    /// The number of all their rows.
    samples: Vec<usize>,
    /// `(XᵀX)⁻¹`, row by row.
    inverse: Vec<f64>,
    hats: Hats,
}

impl<'a> Poses<'a> {
    fn new(
        observations: &'a Observations,
        fit: &'a Fit,
        judge: &'a Judge,
        inverse: &Mat<f64>,
    ) -> Self {
        let (readings, weights) = (&observations.readings, &observations.weights);
        let part = Part { model: &fit.model, readings, weights: Some(weights) };
        let residuals = Implicit::new(vec![(part, fit.assumed())], &[]).residuals(&fit.beta, true);
        let n = fit.model.parameters;
        let inverse: Vec<f64> = (0..n * n).map(|i| inverse[(i / n, i % n)]).collect();
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
        let hats = Hats::new(&residuals, &rows, &inverse, n);
        Self { observations, fit, judge, residuals, live, rows, samples, inverse, hats }
    }

    fn scored(&self, instance: Instance, family: Family, tests: f64, score: f64) -> Option<Scored> {
        let new = !self.fit.model.instances.contains(&instance);
        new.then(|| {
            let p_value = self.judge.p_value(score, 1.0);
            Scored::of(instance, family, score, 1.0, p_value, tests)
        })
    }

    /// A column of a channel in one pose: its entries, and their product with the residual.
    fn column(&self, channel: usize, order: usize, z: &mut Vec<f64>) -> f64 {
        let (k, c) = (self.residuals.equations, self.observations.readings.channels);
        z.clear();
        let mut r = 0.0;
        for row in &self.rows[order] {
            for e in row * k..(row + 1) * k {
                let value = self.residuals.by_reading[e * c + channel];
                z.push(value);
                r += value * self.residuals.whitened[e];
            }
        }
        r
    }

    /// Number of tests for bad readings.
    fn tests_bad(&self) -> f64 {
        (self.live.len() * (self.observations.readings.channels + 1)) as f64
    }

    /// Scores of wrong readings of one channel. A recording has millions: of those that nobody
    /// could name, which would cost time and memory, it keeps the best.
    fn bad_of(&self, channel: usize, of: Instance) -> Vec<Scored> {
        let held = self.observations.readings.held;
        let tests = self.tests_bad();
        let (mut scored, mut z) = (Vec::new(), Vec::new());
        let mut dull: Option<(f64, Instance)> = None;
        for (order, &place) in self.live.iter().enumerate().rev() {
            let r = self.column(channel, order, &mut z);
            let zz = dot(&z, &z);
            let left = zz - self.hats.form(order, &z);
            let Some(score) = (left > SEEN * zz).then(|| r * r / left) else { continue };
            let instance = Instance { place, ..of };
            if held || score > SURPRISE {
                scored.extend(self.scored(instance, Family::Bad, tests, score));
            } else if dull.is_none_or(|(best, _)| score > best) {
                dull = Some((score, instance));
            }
        }
        let best = dull.and_then(|(score, i)| self.scored(i, Family::Bad, tests, score));
        scored.extend(best);
        scored
    }

    /// Scores of poses that are wrong as a whole.
    fn bad_poses(&self, of: Instance) -> Vec<Scored> {
        let k = self.residuals.equations;
        let mut scored = Vec::new();
        for (order, &place) in self.live.iter().enumerate() {
            if self.samples[order] > 1 {
                continue; // repeats: a pose is judged where it is averaged
            }
            let row = self.rows[order][0];
            let r = &self.residuals.whitened[row * k..(row + 1) * k];
            let Some((score, width)) = left_out(&self.hats.of(order), r) else { continue };
            let p_value = self.judge.p_value(score, width);
            let (instance, tests) = (Instance { place, ..of }, self.tests_bad());
            scored.push(Scored::of(instance, Family::Bad, score, width, p_value, tests));
        }
        scored
    }

    /// The sums from one pose later on, with this pose.
    fn add(&self, time: &mut Time, channel: usize, order: usize, z: &mut Vec<f64>) {
        let (k, n) = (self.residuals.equations, self.fit.model.parameters);
        let Time { seen, column, .. } = time;
        column.r += self.column(channel, order, z);
        let zz = dot(z, z);
        column.zz += zz;
        for (e, z) in z.iter().enumerate() {
            let first = (self.rows[order][e / k] * k + e % k) * n;
            let x = &self.residuals.by_parameter[first..first + n];
            column.zx.iter_mut().zip(x).for_each(|(s, x)| *s += z * x);
        }
        seen.add(zz);
        time.order = order;
    }

    /// Scores of slips of one channel: at some times, and at every one about the best of them.
    fn slips_of(&self, channel: usize, of: Instance) -> Vec<Scored> {
        let (n, mut z) = (self.fit.model.parameters, Vec::new());
        let stride = self.live.len().div_ceil(MOST_TIMES).max(1);
        let end = Time { order: self.live.len(), seen: Seen::default(), column: Column::new(n) };
        let (mut after, mut times) = (end.clone(), Vec::new());
        for order in (0..self.live.len()).rev() {
            self.add(&mut after, channel, order, &mut z);
            if order > 0 && order % stride == 0 {
                times.push(after.clone());
            }
        }
        let all = after.seen;
        let both_sides = |later: &Seen| later.poses().min(all.without(*later).poses()) >= SIDE;
        times.retain(|time| both_sides(&time.seen));
        for time in &mut times {
            time.column = time.column.clone().projected(&self.inverse);
        }
        let turns = turns(&times);
        let score_of = |time: &Time| time.column.score().unwrap_or(0.0);
        let best = (0..times.len())
            .max_by(|i, j| score_of(&times[*i]).total_cmp(&score_of(&times[*j])))
            .filter(|_| stride > 1);
        if let Some(best) = best {
            // Every time between the neighbours of the best, from the sums of the later one.
            let mut time = best.checked_sub(1).map_or(&end, |later| &times[later]).clone();
            let first = times.get(best + 1).map_or(0, |earlier| earlier.order);
            for order in (first + 1..time.order).rev() {
                self.add(&mut time, channel, order, &mut z);
                let column = time.column.clone().projected(&self.inverse);
                let found = Time { column, ..time.clone() };
                if both_sides(&found.seen) && score_of(&found) > score_of(&times[best]) {
                    times[best] = found;
                }
            }
        }
        let most = (times.len() * stride) as f64;
        let tests = |score: f64| match score > SURPRISE {
            // What is no surprise at one time is none at many: only surprises are paid for.
            true => declumped(&turns, stride, score).min(most),
            false => most,
        };
        let channels = self.observations.readings.channels as f64;
        times
            .iter()
            .filter_map(|time| {
                let instance = Instance { place: self.live[time.order], ..of };
                let score = time.column.score()?;
                self.scored(instance, Family::Slip, channels * tests(score), score)
            })
            .collect()
    }
}

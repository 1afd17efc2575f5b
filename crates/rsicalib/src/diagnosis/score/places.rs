//! Scores of wrong readings and of slips: thousands, of one column each, by running sums over poses.

use faer::Mat;

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::distributions;
use crate::numerics::symmetric::{SEEN, dot, form, left_out};
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
    let (readings, n, c) =
        (&observations.readings, fit.model.parameters, observations.readings.channels);
    let part = Part { model: &fit.model, readings, weights: Some(&observations.weights) };
    let residuals = Implicit::new(vec![(part, fit.assumed())], &[]).residuals(&fit.beta, true);
    let k = residuals.equations;
    let allowed = |id: &str| !without.iter().any(|w| w == id);
    let (slip, bad) = (find("slip")?, find("bad_reading")?);
    let has = |instance: &Instance| fit.model.instances.contains(instance);
    let rows = readings.rows_of_poses();
    let live: Vec<usize> = (0..rows.len())
        .filter(|&p| rows[p].iter().any(|&r| observations.weights[r] > 0.0))
        .collect();
    let mut scored = Vec::new();
    let flat: Vec<f64> = (0..n * n).map(|i| inverse[(i / n, i % n)]).collect();
    let mut keep = |instance: Instance, family, places: f64, score: Option<f64>| {
        if let Some(score) = score.filter(|_| !has(&instance)) {
            let p_value = judge.p_value(score, 1.0);
            scored.push(Scored::of(instance, family, score, 1.0, p_value, places));
        }
    };
    let tests_bad = (live.len() * (c + 1)) as f64;
    let stride = live.len().div_ceil(MOST_TIMES).max(1);
    let slips = allowed("slip")
        && crate::terms::targets::provided(slip, &observations.mechanism, readings).is_ok();
    let live_rows: Vec<Vec<usize>> = live
        .iter()
        .map(|&p| rows[p].iter().copied().filter(|&r| observations.weights[r] > 0.0).collect())
        .collect();
    let fitted = |rows: &[usize]| {
        Mat::from_fn(rows.len() * k, n, |e, j| {
            residuals.by_parameter[(rows[e / k] * k + e % k) * n + j]
        })
    };
    // What the fit absorbs of any column of one pose: X (XᵀX)⁻¹ Xᵀ there.
    let hats: Vec<Mat<f64>> = live_rows
        .iter()
        .map(|rows| {
            let x = fitted(rows);
            &x * (inverse * x.transpose())
        })
        .collect();
    for channel in 0..c {
        let target = Target::Channel(channel);
        // A column of this channel in one pose: its entries, and their product with the residual.
        let alone = |order: usize| {
            let (mut z, mut r) = (Vec::with_capacity(k), 0.0);
            for &row in &live_rows[order] {
                for e in 0..k {
                    let value = residuals.by_reading[(row * k + e) * c + channel];
                    z.push(value);
                    r += value * residuals.whitened[row * k + e];
                }
            }
            (z, r)
        };
        let add = |time: &mut Time, order: usize, z: &[f64], r: f64| {
            let Time { seen, column, .. } = time;
            let zz = dot(z, z);
            column.r += r;
            column.zz += zz;
            for (e, z) in z.iter().enumerate() {
                let first = (live_rows[order][e / k] * k + e % k) * n;
                let x = &residuals.by_parameter[first..first + n];
                column.zx.iter_mut().zip(x).for_each(|(s, x)| *s += z * x);
            }
            seen.add(zz);
            time.order = order;
        };
        let end = Time { order: live.len(), seen: Seen::default(), column: Column::new(n) };
        let (mut after, mut times) = (end.clone(), Vec::new());
        for (order, &pose) in live.iter().enumerate().rev() {
            let (z, r) = alone(order);
            if allowed("bad_reading") {
                let instance = Instance { term: bad, target, place: pose };
                let zz = dot(&z, &z);
                let left = zz - form(&hats[order], &z);
                let score = (left > SEEN * zz).then(|| r * r / left);
                keep(instance, Family::Bad, tests_bad, score);
            }
            if !slips {
                continue;
            }
            add(&mut after, order, &z, r);
            if order > 0 && order % stride == 0 {
                times.push(after.clone());
            }
        }
        let all = after.seen;
        let both_sides = |later: &Seen| later.poses().min(all.without(*later).poses()) >= SIDE;
        times.retain(|time| both_sides(&time.seen));
        for time in &mut times {
            time.column = time.column.clone().projected(&flat);
        }
        let turns = turns(&times);
        let score_of = |time: &Time| time.column.score().unwrap_or(0.0);
        let best =
            (0..times.len()).max_by(|i, j| score_of(&times[*i]).total_cmp(&score_of(&times[*j])));
        if let Some(best) = best.filter(|_| stride > 1) {
            // Every time between the neighbours of the best, from the sums of the later one.
            let mut time = best.checked_sub(1).map_or(&end, |later| &times[later]).clone();
            let first = times.get(best + 1).map_or(0, |earlier| earlier.order);
            for order in (first + 1..time.order).rev() {
                let (z, r) = alone(order);
                add(&mut time, order, &z, r);
                let column = time.column.clone().projected(&flat);
                let found = Time { column, ..time.clone() };
                if both_sides(&found.seen) && score_of(&found) > score_of(&times[best]) {
                    times[best] = found;
                }
            }
        }
        for time in &times {
            let instance = Instance { term: slip, target, place: live[time.order] };
            let score = time.column.score();
            // What is no surprise at one time is none at many: only surprises are paid for.
            let rare = score.filter(|score| *score > SURPRISE);
            let most = (times.len() * stride) as f64;
            let tried = rare.map_or(most, |score| declumped(&turns, stride, score).min(most));
            keep(instance, Family::Slip, c as f64 * tried, score);
        }
    }
    if allowed("bad_reading") && readings.held {
        for (order, &pose) in live.iter().enumerate() {
            let row = rows[pose][0];
            if rows[pose].len() > 1 {
                continue; // repeats: a pose is judged where it is averaged
            }
            let r = &residuals.whitened[row * k..(row + 1) * k];
            let Some((score, width)) = left_out(&hats[order], r) else { continue };
            let p_value = judge.p_value(score, width);
            let instance = Instance { term: bad, target: Target::All, place: pose };
            scored.push(Scored::of(instance, Family::Bad, score, width, p_value, tests_bad));
        }
    }
    Ok(scored)
}

//! The course of a channel through a recording: what it would have read at another instant.
//!
//! About each row `j`, at time `t_j`, the least-squares polynomial of fourth degree of the rows up to `n`
//! before and after it is `P_j`. Between two rows the course blends theirs,
//!
//! ```text
//! s(t) = (1 - w) P_j(t) + w P_j+1(t),    w = f² (3 - 2f),   f = (t - t_j) / (t_j+1 - t_j)   (165)
//! ```
//!
//! and goes on as a line beyond a pause or an end of the session: nothing tells what was read there.
//! `n` is the reach, of those up to [`FARTHEST`], by which a row is best predicted from its neighbours by
//! a *parabola*: as far as noise asks for, and no farther than motion allows. A parabola of that
//! reach errs by as much as its noise, alike in all rows of a bend; their delay would err by that. The
//! polynomials of fourth degree err by a small part of it.
//!
//! The noise of what a reading becomes is that of all rows that it is made of. With unit noise of each row
//! and the weights `c(t)` of the course,
//!
//! ```text
//! a_j(lag) = a_j + s(t_j + lag) - s(t_j),    V = Σ_k (δ_jk + c_k(t_j + lag) - c_k(t_j))²    (164)
//! ```

use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;

use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::median::median;
use crate::readings::table::Table;

/// Rows to either side of a polynomial at the most.
const FARTHEST: usize = 8;

/// Rows of a polynomial at the most.
const MOST: usize = 2 * FARTHEST + 1;

/// Reach at the least: five rows, of which a parabola does not pass through each.
const NEAREST: usize = 2;

/// Coefficients of a course's polynomials, and of those by which reaches are compared.
const QUARTIC: usize = 5;
const PARABOLA: usize = 3;

const ZERO: [f64; QUARTIC] = [0.0; QUARTIC];

/// Rows of a recording whose polynomials are kept: a bound on memory, 6 MB for each reach.
const KEPT: usize = 8192;

stated! {
    /// A pause of so many usual times between rows is no part of a course.
    pub(crate) fn pause() -> f64 = 4.0;
}

/// Rows at which reaches are compared: the error of each comparison is one part in sixty.
const COMPARED: usize = 4096;

/// Courses of the channels of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Courses {
    /// First row of the run without a pause in which each row is, and the row after its last.
    run: Vec<[u32; 2]>,
    /// Reach of the polynomials of each channel.
    reach: Vec<usize>,
    /// Polynomials about each row by their reach: instants alone tell them.
    locals: [OnceLock<Vec<Local>>; FARTHEST + 1],
}

/// The courses about the eight samples of a block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CourseAt<'a> {
    pub(super) table: &'a Table,
    /// Found when first asked for.
    pub(super) courses: &'a OnceLock<Courses>,
    pub(super) channels: usize,
    /// Rows of the recording at which the samples were taken.
    pub(super) rows: [usize; WIDTH],
    /// True where the samples stand for many rows each.
    pub(super) of_many: bool,
}

/// What eight samples become at another instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moved {
    /// By how much a channel reads more there, and its velocity.
    pub change: Lanes,
    pub velocity: Lanes,
    /// Standard deviation there of readings of unit noise, (164), and its derivative by the instant.
    pub spread: Lanes,
    pub spreads: Lanes,
    /// What was read in these rows.
    pub raw: Lanes,
}

impl CourseAt<'_> {
    /// The samples of a channel `later` seconds after each.
    pub fn moved(&self, channel: usize, later: f64) -> Moved {
        let courses = self.courses.get_or_init(|| Courses::of(self.table, self.channels));
        let zero = Lanes::ZERO;
        let mut all =
            Moved { change: zero, velocity: zero, spread: zero, spreads: zero, raw: zero };
        let mut last = [0.0; 4];
        for (lane, &row) in self.rows.iter().enumerate() {
            if lane == 0 || row != self.rows[lane - 1] {
                last = courses.moved(self.table, row, channel, later);
                // What is read in a stretch is the mean of many rows, of which noise from row to row is no part.
                if self.of_many {
                    (last[2], last[3]) = (1.0, 0.0);
                }
            }
            let to = [&mut all.change, &mut all.velocity, &mut all.spread, &mut all.spreads];
            to.into_iter().zip(last).for_each(|(to, value)| to.0[lane] = value);
            all.raw.0[lane] = self.table.values[row * self.channels + channel];
        }
        all
    }
}

impl Courses {
    /// Of a table with a time column.
    pub fn of(table: &Table, channels: usize) -> Self {
        let run = runs(table);
        let locals = [const { OnceLock::new() }; FARTHEST + 1];
        let mut courses = Self { run, reach: vec![FARTHEST; channels], locals };
        courses.reach = (0..channels).map(|c| courses.best_reach(table, c)).collect();
        courses
    }

    /// True where rows of the same run were read before and after an instant.
    pub fn has(&self, table: &Table, row: usize, later: f64) -> bool {
        let Some(time) = &table.time else { return false };
        let [start, end] = self.run[row].map(|row| row as usize);
        (time[start]..=time[end - 1]).contains(&(time[row] + later))
    }

    /// Change, velocity, and the spread of (164) with its derivative.
    fn moved(&self, table: &Table, row: usize, channel: usize, later: f64) -> [f64; 4] {
        let Some(time) = &table.time else { return [0.0, 0.0, 1.0, 0.0] };
        let reach = self.reach[channel];
        let own = self.local(time, row, reach);
        let [here, speed] = own.basis(0.0);
        let sum = |mut of_own: Weights, others: Weights| {
            let still = later == 0.0;
            let (value, slope) = if still { (ZERO, speed) } else { (here.map(|v| -v), ZERO) };
            of_own.add(&own, value, slope);
            let value = |row: usize| table.values[row * self.reach.len() + channel];
            of_own.with(&others, row, value)
        };
        if later == 0.0 {
            return sum(Weights::from(own.first), Weights::from(row));
        }
        let [start, end] = self.run[row].map(|row| row as usize);
        let at = time[row] + later;
        let after = start + time[start..end].partition_point(|t| *t <= at);
        if after == start || after == end {
            let edge = if after == start { start } else { end - 1 };
            let (last, line) =
                (self.local(time, edge, reach), self.about(time, edge, reach, PARABOLA));
            let ([value, _], [_, slope]) = (last.basis(0.0), line.basis(0.0));
            let mut others = Weights::from(last.first);
            others.add(&last, value, ZERO);
            others.add(&line, slope.map(|s| s * (at - time[edge])), slope);
            return sum(Weights::from(own.first), others);
        }
        let (before, next) = (self.local(time, after - 1, reach), self.local(time, after, reach));
        let step = time[after] - time[after - 1];
        let f = (at - time[after - 1]) / step;
        let (w, rise) = (f * f * (3.0 - 2.0 * f), 6.0 * f * (1.0 - f) / step);
        let mut others = Weights::from(before.first);
        for (local, share, rise) in [(before, 1.0 - w, -rise), (next, w, rise)] {
            let [value, slope] = local.basis(at - local.origin);
            let slope = std::array::from_fn(|k| share * slope[k] + rise * value[k]);
            others.add(&local, value.map(|v| share * v), slope);
        }
        sum(Weights::from(own.first), others)
    }

    /// The polynomials of fourth degree about a row; those of a recording that is not long are kept.
    fn local(&self, time: &[f64], row: usize, reach: usize) -> Cow<'_, Local> {
        let of = |row| self.about(time, row, reach, QUARTIC);
        if time.len() > KEPT {
            return Cow::Owned(of(row));
        }
        let all = self.locals[reach].get_or_init(|| (0..time.len()).map(of).collect());
        Cow::Borrowed(&all[row])
    }

    /// Rows about one by which its polynomial is told.
    fn about(&self, time: &[f64], row: usize, reach: usize, terms: usize) -> Local {
        let [start, end] = self.run[row].map(|row| row as usize);
        let (first, end) = (row.saturating_sub(reach).max(start), (row + reach + 1).min(end));
        Local::through(time, first..end, time[row], terms)
    }

    /// The reach whose parabolas, each without its own row, predict the rows best.
    fn best_reach(&self, table: &Table, channel: usize) -> usize {
        let Some(time) = &table.time else { return FARTHEST };
        let inner = |row: &usize| {
            let [start, end] = self.run[*row].map(|row| row as usize);
            row - start >= FARTHEST && end - row > FARTHEST
        };
        let rows: Vec<usize> = (0..self.run.len()).filter(inner).collect();
        let apart = rows.len().div_ceil(COMPARED).max(1);
        let value = |row: usize| table.values[row * self.reach.len() + channel];
        let error = |reach: usize| -> f64 {
            let of_row = |&row: &usize| {
                let local = self.about(time, row, reach, PARABOLA);
                let mut weights = Weights::from(local.first);
                weights.add(&local, local.basis(0.0)[0], ZERO);
                // Weights sum to one.
                let off: f64 = weights.rows().map(|(k, [w, _])| w * (value(row) - value(k))).sum();
                (off / (1.0 - weights.at(row)[0])).powi(2)
            };
            rows.iter().step_by(apart).map(of_row).sum()
        };
        // The longest of those that are alike, as of a channel that stands still.
        let best = (NEAREST..=FARTHEST).rev().map(|reach| (error(reach), reach));
        best.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(FARTHEST, |(_, reach)| reach)
    }
}

/// Least-squares polynomials about an instant, by polynomials `p` that are orthogonal over the rows:
/// `p_k+1 = (t - a_k) p_k - b_k p_k-1`.
#[derive(Debug, Clone, Copy)]
struct Local {
    first: usize,
    end: usize,
    origin: f64,
    a: [f64; QUARTIC],
    b: [f64; QUARTIC],
    /// Polynomials that these rows tell.
    told: usize,
    /// `p_k / Σ p_k²` at each row.
    at_rows: [[f64; QUARTIC]; MOST],
}

impl Local {
    fn through(time: &[f64], rows: Range<usize>, origin: f64, terms: usize) -> Self {
        let zero = [0.0; QUARTIC];
        let (first, end, told) = (rows.start, rows.end, terms.min(rows.len()));
        let (mut a, mut b, mut squares) = (zero, zero, zero);
        let mut p = [zero; MOST];
        let rows = &time[rows];
        p.iter_mut().for_each(|p| p[0] = 1.0);
        for k in 0..told {
            let [mut square, mut moment] = [0.0; 2];
            for (t, p) in rows.iter().zip(&p) {
                let own = p[k] * p[k];
                (square, moment) = (square + own, moment + (t - origin) * own);
            }
            (squares[k], a[k]) = (square, moment / square);
            b[k] = if k > 0 { square / squares[k - 1] } else { 0.0 };
            if k + 1 < told {
                for (t, p) in rows.iter().zip(&mut p) {
                    let before = if k > 0 { p[k - 1] } else { 0.0 };
                    p[k + 1] = (t - origin - a[k]) * p[k] - b[k] * before;
                }
            }
        }
        for p in &mut p {
            p.iter_mut().zip(&squares[..told]).for_each(|(p, square)| *p /= square);
        }
        Self { first, end, origin, a, b, told, at_rows: p }
    }

    /// The polynomials and their slopes at an instant after the origin.
    fn basis(&self, t: f64) -> [[f64; QUARTIC]; 2] {
        let (mut p, mut d) = ([0.0; QUARTIC], [0.0; QUARTIC]);
        p[0] = 1.0;
        for k in 1..self.told {
            let (u, b) = (t - self.a[k - 1], self.b[k - 1]);
            let [before, slope] = if k > 1 { [p[k - 2], d[k - 2]] } else { [0.0; 2] };
            p[k] = u * p[k - 1] - b * before;
            d[k] = u * d[k - 1] + p[k - 1] - b * slope;
        }
        [p, d]
    }
}

/// Weights of neighbouring rows in a value, and in its derivative by the instant.
#[derive(Debug, Clone, Copy)]
struct Weights {
    first: usize,
    end: usize,
    of: [[f64; 2]; 2 * MOST + 1],
}

impl Weights {
    /// None, of rows from `first` on.
    const fn from(first: usize) -> Self {
        Self { first, end: first, of: [[0.0; 2]; 2 * MOST + 1] }
    }

    /// Adds a polynomial, given by values and slopes of its `p`.
    fn add(&mut self, local: &Local, value: [f64; QUARTIC], slope: [f64; QUARTIC]) {
        self.end = self.end.max(local.end);
        let at = local.first - self.first;
        for (to, p) in self.of[at..].iter_mut().zip(&local.at_rows[..local.end - local.first]) {
            for k in 0..QUARTIC {
                to[0] += value[k] * p[k];
                to[1] += slope[k] * p[k];
            }
        }
    }

    fn rows(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        (self.first..self.end).zip(self.of)
    }

    /// Weights of a row; zero for one that has none.
    fn at(&self, row: usize) -> [f64; 2] {
        if (self.first..self.end).contains(&row) { self.of[row - self.first] } else { [0.0; 2] }
    }

    /// The change since `row` that has these weights and those of others, its derivative, and what both make of
    /// the noise of that row: (164), and its derivative.
    fn with(&self, others: &Self, row: usize, value: impl Fn(usize) -> f64) -> [f64; 4] {
        let both = self.rows().map(|(k, [w, s])| {
            let [more, steeper] = others.at(k);
            (k, [w + more, s + steeper])
        });
        let alone = others.rows().filter(|(k, _)| !(self.first..self.end).contains(k));
        let [mut change, mut velocity, mut square, mut half] = [0.0; 4];
        for (k, [weight, slope]) in both.chain(alone) {
            // Weights sum to zero: what all rows have in common would only round.
            let apart = value(k) - value(row);
            (change, velocity) = (change + weight * apart, velocity + slope * apart);
            let whole = weight + f64::from(u8::from(k == row));
            (square, half) = (square + whole * whole, half + whole * slope);
        }
        let spread = square.sqrt();
        [change, velocity, spread, half / spread]
    }
}

/// The run of each row: rows of one session whose times ascend without a pause.
fn runs(table: &Table) -> Vec<[u32; 2]> {
    let Some(time) = &table.time else { return Vec::new() };
    let steps = |row: usize| {
        let step = time[row] - time[row - 1];
        (step > 0.0 && table.session_of(row) == table.session_of(row - 1)).then_some(step)
    };
    let mut all_steps: Vec<Vec<f64>> = Vec::new();
    for row in 1..time.len() {
        let session = table.session_of(row);
        all_steps.resize_with(all_steps.len().max(session + 1), Vec::new);
        all_steps[session].extend(steps(row));
    }
    let usual: Vec<f64> = all_steps.into_iter().map(median).collect();
    let mut all = vec![[0, 0]; time.len()];
    let mut start = 0;
    for row in 1..=time.len() {
        let goes_on = row < time.len()
            && steps(row).is_some_and(|step| step <= pause() * usual[table.session_of(row)]);
        if !goes_on {
            all[start..row].fill([start as u32, row as u32]);
            start = row;
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Instants a tenth of a second apart but for a pause of a second after the fortieth, of a motion
    /// `f`.
    fn table(f: impl Fn(f64) -> f64) -> Table {
        let time: Vec<f64> =
            (0..80_u32).map(|k| 0.1 * f64::from(k) + if k < 40 { 0.0 } else { 1.0 }).collect();
        Table { values: time.iter().map(|t| f(*t)).collect(), time: Some(time), ..Table::default() }
    }

    #[test]
    fn a_polynomial_of_fourth_degree_is_its_own_course() {
        let motion = |t: f64| 3.0 - 2.0 * t + 0.5 * t * t - 0.1 * t.powi(3) + 0.02 * t.powi(4);
        let speed = |t: f64| -2.0 + t - 0.3 * t * t + 0.08 * t.powi(3);
        let table = table(motion);
        let courses = Courses::of(&table, 1);
        for (row, later) in [(10, 0.234), (10, -0.71), (50, 1.5), (60, -0.05)] {
            let t = table.time.as_ref().expect("times")[row];
            let [change, slope, ..] = courses.moved(&table, row, 0, later);
            assert!((change - (motion(t + later) - motion(t))).abs() < 1e-9, "{row} {later}");
            assert!((slope - speed(t + later)).abs() < 1e-8, "{row} {later}");
        }
    }

    #[test]
    fn beyond_a_pause_or_an_end_a_course_is_a_line() {
        let motion = |t: f64| t * t;
        let table = table(motion);
        let courses = Courses::of(&table, 1);
        // Row 39, at 3.9 s, is the last before the pause; the line there has the slope 7.8.
        let [change, slope, ..] = courses.moved(&table, 38, 0, 0.5);
        assert!((slope - 7.8).abs() < 1e-9);
        assert!((change - (3.9 * 3.9 + 7.8 * 0.4 - 3.8 * 3.8)).abs() < 1e-9);
        let [change, ..] = courses.moved(&table, 0, 0, -2.0);
        assert!(change.abs() < 1e-9, "at rest at the beginning: {change}");
    }

    #[test]
    fn fast_motion_has_short_polynomials_and_noise_long_ones() {
        let fast = table(|t| (9.0 * t).sin());
        assert_eq!(Courses::of(&fast, 1).reach, [NEAREST]);
        // A slow motion with steps of a coarse encoder.
        let coarse = table(|t| (7.3 * t).round());
        assert!(Courses::of(&coarse, 1).reach[0] >= 6);
    }

    #[test]
    fn velocity_and_spread_have_their_derivatives() {
        let table = table(|t| (3.0 * t).sin() + 0.1 * (17.0 * t).cos());
        let courses = Courses::of(&table, 1);
        for later in [-0.33, -0.1, 1e-6, 0.05, 0.1, 0.17, 0.9, 3.0] {
            let at = |later: f64| courses.moved(&table, 20, 0, later);
            let step = 1e-6;
            let (above, below) = (at(later + step), at(later - step));
            for (k, slope) in [(0, at(later)[1]), (2, at(later)[3])] {
                let difference = (above[k] - below[k]) / (2.0 * step);
                assert!((difference - slope).abs() < 1e-4, "{later} {k}");
            }
        }
    }

    #[test]
    fn the_spread_is_that_of_a_reading_whose_rows_each_have_unit_noise() {
        // The change is linear in what was read: its weights are what it makes of one row alone.
        let still = table(|_| 0.0);
        let rough = Courses { reach: vec![5], ..Courses::of(&still, 1) };
        for (row, later) in [(20, 0.14), (20, 0.0), (20, 2.0), (33, 0.72), (2, -0.4)] {
            let weight = |k: usize| {
                let mut one = Table { values: vec![0.0; 80], ..still.clone() };
                one.values[k] = 1.0;
                one.values[row] + rough.moved(&one, row, 0, later)[0]
            };
            let variance: f64 = (0..80).map(|k| weight(k).powi(2)).sum();
            let spread = rough.moved(&still, row, 0, later)[2];
            assert!((spread - variance.sqrt()).abs() < 1e-9, "{row} {later}: {spread}");
        }
    }
}

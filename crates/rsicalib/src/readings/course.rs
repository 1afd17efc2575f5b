//! The course of a channel through a recording: what it would have read at another instant.
//!
//! About each row `j`, at time `t_j`, the least-squares parabola of the rows up to `n` before and
//! after it is `P_j`. Between two rows the course blends theirs,
//!
//! ```text
//! s(t) = (1 - w) P_j(t) + w P_j+1(t),    w = f² (3 - 2f),   f = (t - t_j) / (t_j+1 - t_j)   (165)
//! ```
//!
//! and goes on as the line of its first or last row beyond a pause or an end of the session: nothing
//! tells what was read there. `n` is the reach, of those up to [`FARTHEST`], by which a row is best
//! predicted from its neighbours: as far as noise asks for, and no farther than motion allows.

use std::sync::OnceLock;

use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::median::median;
use crate::readings::table::Table;

/// Rows to either side of a parabola at the most.
const FARTHEST: usize = 8;

/// And at the least: five rows, of which a parabola does not pass through each.
const NEAREST: usize = 2;

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
    /// Reach of the parabolas of each channel.
    reach: Vec<usize>,
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
}

impl CourseAt<'_> {
    /// By how much a channel reads more `later` seconds after each sample, and its velocity there.
    pub fn change(&self, channel: usize, later: f64) -> [Lanes; 2] {
        let courses = self.courses.get_or_init(|| Courses::of(self.table, self.channels));
        let mut found = [Lanes::ZERO; 2];
        for (lane, &row) in self.rows.iter().enumerate() {
            if lane > 0 && row == self.rows[lane - 1] {
                (found[0].0[lane], found[1].0[lane]) = (found[0].0[lane - 1], found[1].0[lane - 1]);
                continue;
            }
            let [change, slope] = courses.change(self.table, row, channel, later);
            (found[0].0[lane], found[1].0[lane]) = (change, slope);
        }
        found
    }
}

impl Courses {
    /// Of a table with a time column.
    pub fn of(table: &Table, channels: usize) -> Self {
        let run = runs(table);
        let mut courses = Self { run, reach: vec![FARTHEST; channels] };
        courses.reach = (0..channels).map(|c| courses.best_reach(table, c)).collect();
        courses
    }

    /// True where rows of the same run were read before and after an instant.
    pub fn has(&self, table: &Table, row: usize, later: f64) -> bool {
        let Some(time) = &table.time else { return false };
        let [start, end] = self.run[row].map(|row| row as usize);
        (time[start]..=time[end - 1]).contains(&(time[row] + later))
    }

    fn change(&self, table: &Table, row: usize, channel: usize, later: f64) -> [f64; 2] {
        let Some(time) = &table.time else { return [0.0; 2] };
        let own = self.parabola(table, time, row, channel, self.reach[channel]);
        if later == 0.0 {
            return [0.0, own.slope];
        }
        let [start, end] = self.run[row].map(|row| row as usize);
        let at = time[row] + later;
        let after = start + time[start..end].partition_point(|t| *t <= at);
        let about = |row| self.parabola(table, time, row, channel, self.reach[channel]);
        if after == start || after == end {
            let edge = if after == start { start } else { end - 1 };
            let last = if edge == row { own } else { about(edge) };
            return [last.value + last.slope * (at - time[edge]) - own.value, last.slope];
        }
        let (before, next) = (about(after - 1), about(after));
        let step = time[after] - time[after - 1];
        let (since, until) = (at - time[after - 1], at - time[after]);
        let f = since / step;
        let (w, rise) = (f * f * (3.0 - 2.0 * f), 6.0 * f * (1.0 - f) / step);
        let (p, q) = (before.at(since), next.at(until));
        let slope = before.slope_at(since) * (1.0 - w) + next.slope_at(until) * w + rise * (q - p);
        [p * (1.0 - w) + q * w - own.value, slope]
    }

    fn parabola(
        &self,
        table: &Table,
        time: &[f64],
        row: usize,
        channel: usize,
        reach: usize,
    ) -> Parabola {
        let [start, end] = self.run[row].map(|row| row as usize);
        let rows = row.saturating_sub(reach).max(start)..(row + reach + 1).min(end);
        let channels = self.reach.len();
        Parabola::through(rows.map(|r| [time[r] - time[row], table.values[r * channels + channel]]))
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
        let channels = self.reach.len();
        let error = |reach: usize| -> f64 {
            let of_row = |&row: &usize| {
                let p = self.parabola(table, time, row, channel, reach);
                ((table.values[row * channels + channel] - p.value) / (1.0 - p.own)).powi(2)
            };
            rows.iter().step_by(apart).map(of_row).sum()
        };
        // The longest of those that are alike, as of a channel that stands still.
        let best = (NEAREST..=FARTHEST).rev().map(|reach| (error(reach), reach));
        best.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(FARTHEST, |(_, reach)| reach)
    }
}

/// A parabola about an instant: `value + slope t + bend t²`.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    value: f64,
    slope: f64,
    bend: f64,
    /// Weight in `value` of what was read at the instant itself.
    own: f64,
}

impl Parabola {
    /// The least-squares parabola through instants and values; a line through two, a constant through one.
    ///
    /// By the polynomials `1`, `u = t - m` and `q = u² - (s₃/s₂) u - s₂/n`, orthogonal over the instants.
    fn through(points: impl Iterator<Item = [f64; 2]> + Clone) -> Self {
        let sum = |f: &dyn Fn([f64; 2]) -> f64| points.clone().map(f).sum::<f64>();
        let n = sum(&|_| 1.0);
        let (m, mean) = (sum(&|[t, _]| t) / n, sum(&|[_, y]| y) / n);
        let s2 = sum(&|[t, _]| (t - m).powi(2));
        if s2 <= 0.0 {
            return Self { value: mean, slope: 0.0, bend: 0.0, own: 1.0 / n };
        }
        let skew = sum(&|[t, _]| (t - m).powi(3)) / s2;
        let q = |t: f64| (t - m).powi(2) - skew * (t - m) - s2 / n;
        let line = sum(&|[t, y]| (t - m) * y) / s2;
        let sq = sum(&|[t, _]| q(t).powi(2));
        // Three instants and more; the square of what two leave is rounding.
        let bend = if n > 2.5 && sq > 0.0 { sum(&|[t, y]| q(t) * y) / sq } else { 0.0 };
        let curved = if n > 2.5 && sq > 0.0 { q(0.0).powi(2) / sq } else { 0.0 };
        Self {
            value: mean - line * m + bend * q(0.0),
            slope: line - bend * (2.0 * m + skew),
            bend,
            own: 1.0 / n + m * m / s2 + curved,
        }
    }

    fn at(&self, t: f64) -> f64 {
        self.value + (self.slope + self.bend * t) * t
    }

    fn slope_at(&self, t: f64) -> f64 {
        self.slope + 2.0 * self.bend * t
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
    fn a_parabola_is_its_own_course() {
        let motion = |t: f64| 3.0 - 2.0 * t + 0.5 * t * t;
        let table = table(motion);
        let courses = Courses::of(&table, 1);
        for (row, later) in [(10, 0.234), (10, -0.71), (50, 1.5), (60, -0.05)] {
            let t = table.time.as_ref().expect("times")[row];
            let [change, slope] = courses.change(&table, row, 0, later);
            assert!((change - (motion(t + later) - motion(t))).abs() < 1e-9, "{row} {later}");
            assert!((slope - (t + later - 2.0)).abs() < 1e-9, "{row} {later}");
        }
    }

    #[test]
    fn beyond_a_pause_or_an_end_a_course_is_a_line() {
        let motion = |t: f64| t * t;
        let table = table(motion);
        let courses = Courses::of(&table, 1);
        // Row 39, at 3.9 s, is the last before the pause; the line there has the slope 7.8.
        let [change, slope] = courses.change(&table, 38, 0, 0.5);
        assert!((slope - 7.8).abs() < 1e-9);
        assert!((change - (3.9 * 3.9 + 7.8 * 0.4 - 3.8 * 3.8)).abs() < 1e-9);
        let [change, _] = courses.change(&table, 0, 0, -2.0);
        assert!(change.abs() < 1e-9, "at rest at the beginning: {change}");
    }

    #[test]
    fn fast_motion_has_short_parabolas_and_noise_long_ones() {
        let fast = table(|t| (9.0 * t).sin());
        assert_eq!(Courses::of(&fast, 1).reach, [NEAREST]);
        // A slow motion with steps of a coarse encoder.
        let coarse = table(|t| (7.3 * t).round());
        assert!(Courses::of(&coarse, 1).reach[0] >= 6);
    }

    #[test]
    fn the_velocity_is_the_slope_of_the_change() {
        let table = table(|t| (3.0 * t).sin() + 0.1 * (17.0 * t).cos());
        let courses = Courses::of(&table, 1);
        for later in [-0.33, -0.1, 1e-6, 0.05, 0.1, 0.17, 0.9] {
            let at = |later: f64| courses.change(&table, 20, 0, later);
            let step = 1e-6;
            let difference = (at(later + step)[0] - at(later - step)[0]) / (2.0 * step);
            assert!((difference - at(later)[1]).abs() < 1e-4, "{later}");
        }
    }
}

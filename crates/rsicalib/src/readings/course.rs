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
//!
//! The mean of a stretch of `n` rows becomes what its middle row becomes. It has a part `1/n` of each of them,
//! in place of `δ`, and in units of its own noise `n` times that sum.
//!
//! What follows its goal by degrees, with the time constant `T`, is where `y + T y'` is its goal. In a steady
//! motion it is late by `T`. Of what is late by `lag` in all, the goal is `y(t + lag - T) + T y'(t + lag - T)`,
//! and that is beside (164)
//!
//! ```text
//! E(t + lag),   E(t) = P(t - T) + T P'(t - T) - P(t),   ∂E/∂T² = -½ P''(t - T)              (157)
//! ```
//!
//! blended as (165). `P` is of the reach, up to [`FARTHEST`], by which *polynomials of fourth degree* predict the rows
//! best: what `E` errs by where they err is a small part of it, and what noise makes of `P''` is not. `E` begins as the
//! square of `T`, and of `-T²` it is the opposite.

use crate::numerics::order::Ends;
use std::iter::zip;
use std::ops::Range;
use std::sync::OnceLock;

use crate::numerics::lanes::{Lanes, WIDTH, dispatch};
use crate::numerics::median::median;
use crate::readings::context::direction;
use crate::readings::table::Table;

/// Rows to either side of a polynomial at the most.
const FARTHEST: usize = 8;

/// Rows of a polynomial at the most.
const MOST: usize = 2 * FARTHEST + 1;

/// Rows of a polynomial in whole vectors.
const ROWS: usize = MOST.next_multiple_of(WIDTH);

/// Rows of two polynomials that are neighbours, in whole vectors.
const SPAN: usize = 2 * ROWS;

/// Standard deviations by which a velocity is beyond noise.
const SURE: f64 = 3.0;

/// Coefficients of a course's polynomials, and of those by which reaches are compared.
const QUARTIC: usize = 5;
const PARABOLA: usize = 3;

const ZERO: [f64; QUARTIC] = [0.0; QUARTIC];

/// Rows of a recording whose polynomials are kept: a bound on memory, 6 MB for each reach.
const KEPT: usize = 40_000;

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
    /// Reach of the polynomials of each channel, and of those that have accelerations.
    reach: Vec<usize>,
    bent: Vec<usize>,
    /// By what parabolas without a row are off there, root mean square: the noise of each channel.
    noise: Vec<f64>,
    /// In which direction each channel moves in each row, and from which side it came there, told when first
    /// asked for.
    ways: Vec<OnceLock<Ways>>,
    /// Polynomials about each row by their reach: instants alone tell them.
    locals: [OnceLock<Vec<Local>>; FARTHEST + 1],
}

/// Directions of a channel in all rows, and the sides from which it came there: at rest, that of its last motion.
#[derive(Debug, Clone)]
struct Ways {
    directions: Vec<f64>,
    sides: Vec<f64>,
}

/// The courses about the eight samples of a block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CourseAt<'a> {
    pub(super) table: &'a Table,
    /// Found when first asked for.
    pub(super) courses: &'a OnceLock<Courses>,
    pub(super) channels: usize,
    /// Changes by less are none.
    pub(super) still: &'a [f64],
    /// Rows of the recording at which the samples were taken.
    pub(super) rows: [usize; WIDTH],
    /// Rows about each of which a sample is the mean.
    pub(super) counts: [usize; WIDTH],
}

/// How a channel follows what it is to follow.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Late {
    /// By what it is late in a steady motion \[s\].
    pub lag: f64,
    /// Square of the time constant that is part of it \[s²\]; none where nobody asks.
    pub square: Option<f64>,
}

impl Late {
    /// True where readings are those of their own instant.
    pub(crate) fn is_nothing(self) -> bool {
        self.lag == 0.0 && self.square.is_none_or(|square| square == 0.0)
    }
}

impl std::ops::Add for Late {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let square = match (self.square, other.square) {
            (Some(own), Some(other)) => Some(own + other),
            (own, other) => own.or(other),
        };
        Self { lag: self.lag + other.lag, square }
    }
}

/// A sum over rows, and its derivatives by the two of [`Late`].
pub(crate) type Sum<T> = [T; 3];

/// What eight samples become at another instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moved {
    /// By how much a channel reads more there.
    pub change: Sum<Lanes>,
    /// Standard deviation there of readings of unit noise, (164).
    pub spread: Sum<Lanes>,
    /// What was read in these rows.
    pub raw: Lanes,
}

/// What the samples of a channel followed, by some of its effects; none where that is themselves.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Followed {
    /// By the effects before one.
    pub before: Option<Moved>,
    /// By that one as well.
    pub with: Option<Moved>,
    /// By all, with derivatives.
    pub all: Option<Moved>,
}

impl CourseAt<'_> {
    /// In which direction a channel moves: -1, 0 or 1; 0 where it stands still over the rows that tell its velocity.
    pub fn direction(&self, channel: usize) -> Lanes {
        let courses = self.courses.get_or_init(|| Courses::of(self.table, self.channels));
        let ways = courses.ways(self.table, channel, self.still[channel]);
        Lanes(self.rows.map(|row| ways.directions.get(row).copied().unwrap_or(0.0)))
    }

    /// From which side a channel came to where it is `later` seconds after each sample: at rest, that of its last
    /// motion.
    pub fn side(&self, channel: usize, later: f64) -> Lanes {
        let courses = self.courses.get_or_init(|| Courses::of(self.table, self.channels));
        let ways = courses.ways(self.table, channel, self.still[channel]);
        let last = |row| courses.last_before(self.table, row, later).unwrap_or(row);
        Lanes(self.rows.map(|row| ways.sides.get(last(row)).copied().unwrap_or(0.0)))
    }

    /// The samples of a channel as what it followed.
    pub fn moved(&self, channel: usize, late: Late) -> Moved {
        let courses = self.courses.get_or_init(|| Courses::of(self.table, self.channels));
        let zero = [Lanes::ZERO; 3];
        let mut all = Moved { change: zero, spread: zero, raw: Lanes::ZERO };
        let mut last = [[0.0; 3]; 2];
        for (lane, &row) in self.rows.iter().enumerate() {
            if lane == 0 || row != self.rows[lane - 1] {
                let stretch = self.counts[lane];
                last = dispatch(
                    #[inline(always)]
                    || courses.moved(self.table, row, stretch, channel, late),
                );
            }
            for (to, values) in [&mut all.change, &mut all.spread].into_iter().zip(last) {
                to.iter_mut().zip(values).for_each(|(to, value)| to.0[lane] = value);
            }
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
        let (reach, bent) = (vec![FARTHEST; channels], vec![FARTHEST; channels]);
        let (noise, ways) = (vec![0.0; channels], vec![OnceLock::new(); channels]);
        let mut courses = Self { run, reach, bent, noise, ways, locals };
        let best = |terms| -> (Vec<usize>, Vec<f64>) {
            courses.best_reaches(table, terms).into_iter().unzip()
        };
        let ((reach, noise), (bent, _)) = (best(PARABOLA), best(QUARTIC));
        (courses.reach, courses.noise, courses.bent) = (reach, noise, bent);
        courses
    }

    /// True where rows of the same run were read before and after an instant.
    pub fn has(&self, table: &Table, row: usize, later: f64) -> bool {
        let Some(time) = &table.time else { return false };
        let [start, end] = self.run[row].map(|row| row as usize);
        (time[start]..=time[end - 1]).contains(&(time[row] + later))
    }

    /// By what a channel moves over the rows that tell its velocity, and the standard deviation of that by noise.
    fn step(&self, table: &Table, row: usize, channel: usize) -> (f64, f64) {
        let Some(time) = &table.time else { return (0.0, 0.0) };
        let local = self.local(time, row, self.reach[channel]);
        let mut weights = Weights::from(local.first);
        weights.add(time, &local, [ZERO, local.basis(0.0)[1], ZERO]);
        let value = |row: usize| table.values[row * self.reach.len() + channel];
        // Weights sum to zero: what all rows have in common would only round.
        let [_, weights_of_rows, _] = weights.of_rows(&weights.rows());
        let (velocity, square) = zip(weights.rows(), weights_of_rows)
            .fold((0.0, 0.0), |(sum, square), (k, w)| {
                (sum + w * (value(k) - value(row)), square + w * w)
            });
        let long = time[local.end - 1] - time[local.first];
        (velocity * long, self.noise[channel] * square.sqrt() * long)
    }

    /// The last row of the same run at an instant so much later than a row; the first where none is.
    fn last_before(&self, table: &Table, row: usize, later: f64) -> Option<usize> {
        let time = table.time.as_ref()?;
        let [start, end] = self.run[row].map(|row| row as usize);
        let after = start + time[start..end].partition_point(|t| *t <= time[row] + later);
        Some(after.saturating_sub(1).max(start))
    }

    /// Directions and sides of a channel; none without a clock. It moves where it does so by `still`; and it comes
    /// from another side where noise does not make as much.
    fn ways(&self, table: &Table, channel: usize, still: f64) -> &Ways {
        self.ways[channel].get_or_init(|| {
            let rows = table.time.as_ref().map_or(0, Vec::len);
            let mut last = (usize::MAX, 0.0);
            let of_row = |row| {
                let (change, noise) = self.step(table, row, channel);
                let (session, sure) = (table.session_of(row), direction(change, SURE * noise));
                let moves = direction(change, still);
                let rests = moves * sure == 0.0 && last.0 == session;
                last = (session, if rests { last.1 } else { moves * sure.abs() });
                (moves, last.1)
            };
            let (directions, sides) = (0..rows).map(of_row).unzip();
            Ways { directions, sides }
        })
    }

    /// Change and the spread of (164), of a row that becomes what it followed, and is the middle of a stretch of
    /// so many.
    #[inline(always)]
    fn moved(
        &self,
        table: &Table,
        row: usize,
        stretch: usize,
        channel: usize,
        late: Late,
    ) -> [Sum<f64>; 2] {
        let Some(time) = &table.time else { return [[0.0; 3], [1.0, 0.0, 0.0]] };
        let reach = self.reach[channel];
        let own = self.local(time, row, reach);
        let [here, speed, _] = own.basis(0.0);
        let at = time[row] + late.lag;
        let [start, end] = self.run[row].map(|row| row as usize);
        let after = start + time[start..end].partition_point(|t| *t <= at);
        let beyond = after == start || after == end;
        let near = if beyond { row } else { after - 1 };
        let bent = late.square.filter(|_| !beyond).map(|square| (square, self.bent[channel]));
        let first = |reach: usize| self.about_rows(near, reach).start;
        let mut others =
            Weights::from(bent.map_or(first(reach), |(_, r)| first(r).min(first(reach))));
        let mut of_own = Weights::from(own.first);
        if late.lag == 0.0 {
            of_own.add(time, &own, [ZERO, speed, ZERO]);
        } else {
            of_own.add(time, &own, [here.map(|v| -v), ZERO, ZERO]);
        }
        if beyond && late.lag != 0.0 {
            let edge = if after == start { start } else { end - 1 };
            let (last, line) =
                (self.local(time, edge, reach), self.about(time, edge, reach, PARABOLA));
            let ([value, ..], [_, slope, _]) = (last.basis(0.0), line.basis(0.0));
            others = Weights::from(last.first);
            others.add(time, &last, [value, ZERO, ZERO]);
            others.add(time, &line, [slope.map(|s| s * (at - time[edge])), slope, ZERO]);
        } else if !beyond {
            if late.lag != 0.0 {
                self.blend(time, at, near, reach, &mut others, |local, t| {
                    let [value, slope, _] = local.basis(t);
                    [value, slope, ZERO]
                });
            }
            if let Some((square, reach)) = bent {
                self.blend(time, at, near, reach, &mut others, |local, t| local.bent(t, square));
            }
        }
        let value = |row: usize| table.values[row * self.reach.len() + channel];
        of_own.with(&others, row, stretch, value)
    }

    /// Adds what the polynomials about a row and the next make of an instant between both, blended as (165).
    #[inline(always)]
    fn blend(
        &self,
        time: &[f64],
        at: f64,
        row: usize,
        reach: usize,
        into: &mut Weights,
        of: impl Fn(&Local, f64) -> Sum<[f64; QUARTIC]>,
    ) {
        let step = time[row + 1] - time[row];
        let f = (at - time[row]) / step;
        let (w, rise) = (f * f * (3.0 - 2.0 * f), 6.0 * f * (1.0 - f) / step);
        for (row, share, rise) in [(row, 1.0 - w, -rise), (row + 1, w, rise)] {
            let local = self.local(time, row, reach);
            let [value, slope, bend] = of(&local, at - local.origin);
            let slope = std::array::from_fn(|k| share * slope[k] + rise * value[k]);
            into.add(time, &local, [value.map(|v| share * v), slope, bend.map(|b| share * b)]);
        }
    }

    /// The polynomials of fourth degree about a row; those of a recording that is not long are kept.
    fn local(&self, time: &[f64], row: usize, reach: usize) -> Local {
        let of = |row| self.about(time, row, reach, QUARTIC);
        if time.len() > KEPT {
            return of(row);
        }
        self.locals[reach].get_or_init(|| (0..time.len()).map(of).collect())[row]
    }

    /// Rows about one by which its polynomial is told.
    fn about_rows(&self, row: usize, reach: usize) -> Range<usize> {
        let [start, end] = self.run[row].map(|row| row as usize);
        row.saturating_sub(reach).max(start)..(row + reach + 1).min(end)
    }

    fn about(&self, time: &[f64], row: usize, reach: usize, terms: usize) -> Local {
        Local::through(time, self.about_rows(row, reach), time[row], terms)
    }

    /// For each channel the reach whose polynomials, each without its own row, predict the rows best, and by what
    /// they are off, root mean square. The weights of a row are those of all channels.
    fn best_reaches(&self, table: &Table, terms: usize) -> Vec<(usize, f64)> {
        let channels = self.reach.len();
        let Some(time) = &table.time else { return vec![(FARTHEST, 0.0); channels] };
        let inner = |row: &usize| {
            let [start, end] = self.run[*row].map(|row| row as usize);
            row - start >= FARTHEST && end - row > FARTHEST
        };
        let rows: Vec<usize> = (0..self.run.len()).filter(inner).collect();
        let apart = rows.len().div_ceil(COMPARED).max(1);
        let values = |row: usize| &table.values[row * channels..][..channels];
        let errors = |reach: usize| -> Vec<f64> {
            let mut squares = vec![0.0; channels];
            let mut off = vec![0.0; channels];
            for &row in rows.iter().step_by(apart) {
                let local = self.about(time, row, reach, terms);
                let mut weights = Weights::from(local.first);
                weights.add(time, &local, [local.basis(0.0)[0], ZERO, ZERO]);
                // Weights sum to one.
                off.fill(0.0);
                let [of_rows, ..] = weights.of_rows(&weights.rows());
                for (k, w) in zip(weights.rows(), of_rows) {
                    for (off, (own, other)) in off.iter_mut().zip(zip(values(row), values(k))) {
                        *off += w * (own - other);
                    }
                }
                let without = 1.0 - of_rows[row - weights.first];
                zip(&mut squares, &off)
                    .for_each(|(square, off)| *square += (off / without).powi(2));
            }
            squares
        };
        let errors: Vec<(usize, Vec<f64>)> = (terms.div_euclid(2) + 1..=FARTHEST)
            .rev()
            .map(|reach| (reach, errors(reach)))
            .collect();
        // The longest of those that are alike, as of a channel that stands still.
        let best = |channel: usize| {
            let of = errors.iter().map(|(reach, squares)| (squares[channel], *reach));
            let best = of.least_by(|a| a.0).unwrap_or((0.0, FARTHEST));
            (best.1, (best.0 * apart as f64 / rows.len().max(1) as f64).sqrt())
        };
        (0..channels).map(best).collect()
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
    /// `1 / Σ p_k²` of each `k`.
    per: [f64; QUARTIC],
}

impl Local {
    fn through(time: &[f64], rows: Range<usize>, origin: f64, terms: usize) -> Self {
        let zero = [0.0; QUARTIC];
        let (first, end, told) = (rows.start, rows.end, terms.min(rows.len()));
        let (mut a, mut b, mut squares) = (zero, zero, zero);
        let mut p = [[0.0; MOST]; QUARTIC];
        let time = &time[rows];
        p[0].fill(1.0);
        for k in 0..told {
            let [mut square, mut moment] = [0.0; 2];
            for (t, p) in zip(time, p[k]) {
                (square, moment) = (square + p * p, moment + (t - origin) * p * p);
            }
            (squares[k], a[k]) = (square, moment / square);
            b[k] = if k > 0 { square / squares[k - 1] } else { 0.0 };
            if k + 1 < told {
                for (row, t) in time.iter().enumerate() {
                    let before = if k > 0 { p[k - 1][row] } else { 0.0 };
                    p[k + 1][row] = (t - origin - a[k]) * p[k][row] - b[k] * before;
                }
            }
        }
        Self { first, end, origin, a, b, told, per: squares.map(f64::recip) }
    }

    /// The polynomials at an instant after the origin, their slopes, and the slopes of these.
    #[inline(always)]
    fn basis(&self, t: f64) -> [[f64; QUARTIC]; 3] {
        let [mut p, mut d, mut dd] = [ZERO; 3];
        p[0] = 1.0;
        for k in 1..self.told {
            let (u, b) = (t - self.a[k - 1], self.b[k - 1]);
            let [before, slope, bend] =
                if k > 1 { [p[k - 2], d[k - 2], dd[k - 2]] } else { [0.0; 3] };
            p[k] = u * p[k - 1] - b * before;
            d[k] = u * d[k - 1] + p[k - 1] - b * slope;
            dd[k] = u * dd[k - 1] + 2.0 * d[k - 1] - b * bend;
        }
        [p, d, dd]
    }

    /// `E` of (157) at an instant after the origin, and its derivatives by the instant and by `T²`.
    #[inline(always)]
    fn bent(&self, t: f64, square: f64) -> Sum<[f64; QUARTIC]> {
        let (sign, constant) = (square.signum(), square.abs().sqrt());
        let [here, speed, _] = self.basis(t);
        let [value, slope, bend] = self.basis(t - constant);
        [
            std::array::from_fn(|k| sign * (value[k] + constant * slope[k] - here[k])),
            std::array::from_fn(|k| sign * (slope[k] + constant * bend[k] - speed[k])),
            bend.map(|b| -0.5 * b),
        ]
    }
}

/// Weights of neighbouring rows in a value, and in its derivatives.
#[derive(Debug, Clone, Copy)]
struct Weights {
    first: usize,
    end: usize,
    of: Sum<[f64; SPAN]>,
}

impl Weights {
    /// None, of rows from `first` on.
    const fn from(first: usize) -> Self {
        Self { first, end: first, of: [[0.0; SPAN]; 3] }
    }

    /// Adds a polynomial, given by what its `p` are and their derivatives, of rows at these times.
    #[inline(always)]
    fn add(&mut self, time: &[f64], local: &Local, of: Sum<[f64; QUARTIC]>) {
        self.end = self.end.max(local.end);
        let (at, rows) = (local.first - self.first, local.end - local.first);
        let (mut t, mut before, mut p) = ([0.0; ROWS], [0.0; ROWS], [0.0; ROWS]);
        // From the origin on, as the polynomials are told: a clock may count since 1970.
        zip(&mut t, &time[local.first..local.end]).for_each(|(t, time)| *t = time - local.origin);
        p[..rows].fill(1.0);
        for k in 0..local.told {
            if k > 0 {
                let (a, b) = (local.a[k - 1], local.b[k - 1]);
                for i in 0..ROWS {
                    (before[i], p[i]) = (p[i], (t[i] - a) * p[i] - b * before[i]);
                }
            }
            for (to, of) in zip(&mut self.of, &of) {
                let share = of[k] * local.per[k];
                zip(&mut to[at..at + ROWS], &p).for_each(|(to, p)| *to += share * p);
            }
        }
    }

    fn rows(&self) -> Range<usize> {
        self.first..self.end
    }

    /// Weights of some rows.
    fn of_rows(&self, rows: &Range<usize>) -> Sum<&[f64]> {
        self.of.each_ref().map(|of| &of[rows.start - self.first..rows.end - self.first])
    }

    /// The change since `row` that has these weights and those of others, and what both make of the noise of
    /// the mean of a `stretch` of so many rows about it, (164).
    #[inline(always)]
    fn with(
        mut self,
        others: &Self,
        row: usize,
        stretch: usize,
        value: impl Fn(usize) -> f64,
    ) -> [Sum<f64>; 2] {
        let both = self.first.max(others.first)..self.end.min(others.end);
        let (before, after) = if both.is_empty() {
            (others.rows(), others.end..others.end)
        } else {
            for (to, more) in zip(&mut self.of, others.of_rows(&both)) {
                zip(&mut to[both.start - self.first..], more).for_each(|(to, more)| *to += more);
            }
            (others.first..both.start, both.end..others.end)
        };
        let [mut change, mut half] = [[0.0; 3]; 2];
        // Weights sum to zero: what all rows have in common would only round.
        let own = value(row);
        let (count, first) = (stretch as f64, row.saturating_sub(stretch / 2));
        let (part, mut met) = (1.0 / count, 0.0);
        for (of, rows) in [(&self, self.rows()), (others, before), (others, after)] {
            let [whole, by_lag, by_square] = of.of_rows(&rows);
            for (k, w) in zip(rows, zip(whole, zip(by_lag, by_square))) {
                let w = [*w.0, *w.1.0, *w.1.1];
                let of_mean = if (first..first + stretch).contains(&k) { part } else { 0.0 };
                let (apart, whole) = (value(k) - own, w[0] + of_mean);
                met += of_mean;
                for i in 0..3 {
                    change[i] += w[i] * apart;
                    half[i] += whole * if i == 0 { whole } else { w[i] };
                }
            }
        }
        // Rows of the stretch that have no weights.
        half[0] += (1.0 - met) * part;
        let spread = (count * half[0]).sqrt();
        [change, [spread, count * half[1] / spread, count * half[2] / spread]]
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

    fn by(lag: f64) -> Late {
        Late { lag, square: None }
    }

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
            let [[change, slope, _], _] = courses.moved(&table, row, 1, 0, by(later));
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
        let [[change, slope, _], _] = courses.moved(&table, 38, 1, 0, by(0.5));
        assert!((slope - 7.8).abs() < 1e-9);
        assert!((change - (3.9 * 3.9 + 7.8 * 0.4 - 3.8 * 3.8)).abs() < 1e-9);
        let [[change, ..], _] = courses.moved(&table, 0, 1, 0, by(-2.0));
        assert!(change.abs() < 1e-9, "at rest at the beginning: {change}");
    }

    #[test]
    fn fast_motion_has_short_polynomials_and_noise_long_ones() {
        let fast = table(|t| (9.0 * t).sin());
        assert_eq!(Courses::of(&fast, 1).reach, [2]);
        // A slow motion with steps of a coarse encoder.
        let coarse = table(|t| (7.3 * t).round());
        assert!(Courses::of(&coarse, 1).reach[0] >= 6);
    }

    #[test]
    fn change_and_spread_have_their_derivatives() {
        let table = table(|t| (3.0 * t).sin() + 0.1 * (17.0 * t).cos());
        let courses = Courses::of(&table, 1);
        let lags = [-0.33, -0.1, 1e-6, 0.05, 0.1, 0.17, 0.9, 3.0];
        let each = |lag: f64| [(lag, 0.02, 1_u32), (lag, -0.01, 1), (lag, 0.01, 5)];
        for (lag, square, stretch) in lags.into_iter().flat_map(each) {
            let late = |lag, square| Late { lag, square: Some(square) };
            let at =
                |lag, square| courses.moved(&table, 20, stretch as usize, 0, late(lag, square));
            let step = 1e-6;
            let later = [at(lag - step, square), at(lag + step, square)];
            let slower = [at(lag, square - step), at(lag, square + step)];
            for (k, [below, above]) in [(1, later), (2, slower)] {
                for (what, here) in at(lag, square).iter().enumerate() {
                    let difference = (above[what][0] - below[what][0]) / (2.0 * step);
                    // At a row slopes bend, in units of the noise of the mean.
                    let off = 1e-4 * f64::from(stretch);
                    assert!((difference - here[k]).abs() < off, "{lag} {square} {k} {what}");
                }
            }
        }
    }

    #[test]
    fn what_follows_by_degrees_tells_its_goal() {
        // y + T y' of a polynomial, at instants that no row has.
        let motion = |t: f64| 3.0 - 2.0 * t + 0.5 * t * t - 0.1 * t.powi(3) + 0.02 * t.powi(4);
        let speed = |t: f64| -2.0 + t - 0.3 * t * t + 0.08 * t.powi(3);
        let table = table(motion);
        let courses = Courses::of(&table, 1);
        for (row, lag, constant) in [(10, 0.234, 0.08), (60, 0.05, 0.05), (55, 0.0, 0.11)] {
            let t = table.time.as_ref().expect("times")[row] + lag - constant;
            let late = Late { lag, square: Some(constant * constant) };
            let [[change, ..], _] = courses.moved(&table, row, 1, 0, late);
            let goal = motion(t) + constant * speed(t);
            assert!((table.values[row] + change - goal).abs() < 1e-8, "{row} {lag} {constant}");
        }
    }

    #[test]
    fn the_spread_is_that_of_a_reading_whose_rows_each_have_unit_noise() {
        // The change is linear in what was read: its weights are what it makes of one row alone.
        let still = table(|_| 0.0);
        let rough = Courses { reach: vec![5], bent: vec![6], ..Courses::of(&still, 1) };
        let late = |lag| Late { lag, square: Some(0.01) };
        for (row, later) in [(20, 0.14), (20, 0.0), (20, 2.0), (33, 0.72), (4, -0.4)] {
            for stretch in [1_u32, 4, 8] {
                let rows = row - stretch as usize / 2..;
                let weight = |k: usize| {
                    let mut one = Table { values: vec![0.0; 80], ..still.clone() };
                    one.values[k] = 1.0;
                    let mean: f64 =
                        rows.clone().take(stretch as usize).map(|j| one.values[j]).sum();
                    mean / f64::from(stretch) + rough.moved(&one, row, 1, 0, late(later))[0][0]
                };
                let variance: f64 = (0..80).map(|k| weight(k).powi(2)).sum();
                let spread = rough.moved(&still, row, stretch as usize, 0, late(later))[1][0];
                let wanted = (f64::from(stretch) * variance).sqrt();
                assert!((spread - wanted).abs() < 1e-9, "{row} {later} {stretch}: {spread}");
            }
        }
    }
}

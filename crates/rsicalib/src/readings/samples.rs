//! Readings that are checked once and laid out for vector lanes.
//!
//! A *sample* is one reading of all channels; a pose is a label on samples. Samples are kept in
//! blocks of [`WIDTH`], channel by channel, and all samples of a block touch the same unknown
//! points. The direction of approach and the velocity are the *context* of a sample: they are
//! computed once from the raw readings, when a model needs them, and are then constant.

use std::sync::{Arc, OnceLock};

use crate::Error;
use crate::mechanism::{Channel, Mechanism};
use crate::numerics::bounds::{self, LARGEST};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::block::Block;
use crate::readings::context::{STRETCH, direction, is_motion, sides, standstills, velocities};
use crate::readings::course::{CourseAt, Courses};
use crate::readings::doubled::doubled;
use crate::readings::holding::Holding;
use crate::readings::table::{Part, Table, average, mean_of};
use crate::readings::way::{Memories, Memory, Visits};

/// Temperatures this near to the one they count from show nothing of it [K].
const STEADY: f64 = 0.05;

/// Checked readings of one mechanism.
#[derive(Debug, Clone)]
pub struct Readings {
    /// Number of samples.
    pub samples: usize,
    /// Number of channels.
    pub channels: usize,
    /// Label of each pose.
    pub labels: Vec<i64>,
    /// Number of the pose of each sample, from 0.
    pub pose: Vec<usize>,
    /// True for labelled poses, each sampled once or more; false for rows without labels.
    pub held: bool,
    /// True for a table with a time column; velocities are then per second.
    pub timed: bool,
    /// True for a table with a temperature that changes.
    pub tempered: bool,
    /// Mean temperature (°C), from which temperatures are counted.
    pub mean_temperature: Option<f64>,
    /// Mean reading of each channel.
    pub mean: Vec<f64>,
    /// Lowest and highest reading of each channel.
    pub span: Vec<[f64; 2]>,
    /// Number of sessions.
    pub sessions: usize,
    /// Number of the session of each pose, from 0.
    pub session_of_pose: Vec<usize>,
    /// Combinations of keys that occur, in order of appearance: one value per key column.
    pub groups: Vec<Vec<String>>,
    /// The raw table, row by row.
    pub table: Table,
    /// Names of its columns of numbers.
    pub(crate) named: Vec<String>,
    /// First and last time of each session (s); numbers of the first and last pose without a time
    /// column.
    pub clock: Vec<[f64; 2]>,
    /// What these samples are means of; none for readings as they were taken.
    pub merged: Option<Merged>,
    /// Rows that were taken: of these samples, or of those whose means these are.
    pub taken: usize,
    /// Which closures hold in which rows.
    pub holding: Holding,
    /// True where rows tell their order: by a time, or since one thing alone is touched, or one is
    /// touched again after another. A file that has each in one piece may be sorted by their names.
    pub ordered: bool,
    blocks: Vec<Block>,
    raw: Vec<Lanes>,
    columns: Vec<Lanes>,
    /// Below so much change a channel stands still.
    still: Vec<f64>,
    sides: OnceLock<Vec<i8>>,
    motion: OnceLock<Motion>,
    memories: Memories,
    courses: OnceLock<Courses>,
    /// The session as it was taken, where these are some of its rows or means of them: which row each is,
    /// or stands for. All that a row has from others is from there.
    whole: Option<(Arc<Self>, Vec<usize>)>,
}

/// Stretches of a recording of which samples are means.
#[derive(Debug, Clone)]
pub struct Merged {
    /// Rows of the recording that count.
    pub rows: usize,
    /// Those of each stretch, about its middle row.
    counts: Vec<usize>,
}

/// Direction of approach and velocity of each channel, block by block.
#[derive(Debug, Clone)]
struct Motion {
    approach: Vec<Lanes>,
    velocity: Vec<Lanes>,
}

impl Readings {
    /// Checks a table and lays it out.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for columns that differ in length or in number from what the mechanism
    /// needs, [`Error::Reading`] for a reading that is not a number in its channel's range and for
    /// a time, a temperature or a distance that is not a number, and for a row in which no closure
    /// holds. Columns of a closure's own may be NaN, and texts empty, where it does not hold,
    /// [`Error::Empty`] for a table without rows, [`Error::Mechanism`] for a mechanism without
    /// channels.
    pub fn new(mechanism: &Mechanism, table: Table) -> Result<Self, Error> {
        Self::build(mechanism, table, None, None, true)
    }

    /// Checks a table that is used beside the readings of a fit. Time, temperature and the order
    /// of poses are counted as in `main`, the readings of the fit.
    ///
    /// # Errors
    ///
    /// As [`Readings::new`].
    pub fn beside(mechanism: &Mechanism, table: Table, main: &Self) -> Result<Self, Error> {
        Self::build(mechanism, table, None, Some(main), false)
    }

    /// Some of these rows, beside these readings.
    ///
    /// # Errors
    ///
    /// As [`Readings::new`].
    pub(crate) fn some(
        self: &Arc<Self>,
        mechanism: &Mechanism,
        rows: &[usize],
    ) -> Result<Self, Error> {
        let table = self.table.some(self.channels, rows);
        Self::build(mechanism, table, Some(self.as_taken(rows)), Some(self), false)
    }

    /// One sample for each held pose, the mean of its samples with a weight above zero, and the
    /// number of those samples. `weights` holds one number per sample.
    ///
    /// # Errors
    ///
    /// As [`Readings::new`], and [`Error::Shape`] unless there is one weight per sample.
    pub fn averaged(
        &self,
        mechanism: &Mechanism,
        weights: &[f64],
    ) -> Result<(Self, Vec<f64>), Error> {
        Error::same("weights", weights.len(), self.samples)?;
        let rows_of_poses = self.rows_of_poses();
        let mut live = Vec::with_capacity(rows_of_poses.len());
        let mut used = Vec::with_capacity(rows_of_poses.len());
        for rows in rows_of_poses {
            let counted: Vec<usize> = rows.iter().copied().filter(|&r| weights[r] > 0.0).collect();
            live.push(counted.len() as f64);
            used.push(if counted.is_empty() { rows } else { counted });
        }
        let rows: Vec<_> = used.iter().map(|rows| rows.iter().copied()).collect();
        let pose = Some(self.labels.clone());
        let table = Table { pose, ..average(&self.table, self.channels, &rows) };
        let of_whole = |(whole, own): &(Arc<Self>, Vec<usize>)| {
            (whole.clone(), used.iter().map(|u| own[u[0]]).collect())
        };
        let whole = self.whole.as_ref().map(of_whole);
        Ok((Self::build(mechanism, table, whole, Some(self), true)?, live))
    }

    /// These poses and all that is known of them, with other readings, row by row.
    ///
    /// # Errors
    ///
    /// As [`Readings::new`].
    pub(crate) fn with_values(
        mut self,
        mechanism: &Mechanism,
        values: Vec<f64>,
    ) -> Result<Self, Error> {
        let table = Table { values, ..std::mem::take(&mut self.table) };
        let whole = self.whole.take();
        Self::build(mechanism, table, whole, Some(&self), true)
    }

    /// One sample for each stretch of this recording: all that is known of its middle row, with these
    /// readings, one per channel, in place of that row's. `stretches` holds the first row and the
    /// middle row of each, and how many of its rows count; `rows` is how many of the recording do.
    ///
    /// Means and spans are those of the recording, so that parameters are the same.
    #[must_use]
    pub(crate) fn merged(
        self: &Arc<Self>,
        stretches: &[[usize; 3]],
        values: Vec<f64>,
        rows: usize,
    ) -> Self {
        let middles: Vec<usize> = stretches.iter().map(|[_, middle, _]| *middle).collect();
        let counts: Vec<usize> = stretches.iter().map(|[.., count]| *count).collect();
        let lane_of = self.lane_of_rows();
        let places: Vec<(usize, usize)> = middles.iter().map(|&row| lane_of[row]).collect();
        let of_block = |f: &dyn Fn(&Block) -> Lanes| -> Vec<f64> {
            places.iter().map(|&(block, lane)| f(&self.blocks[block]).0[lane]).collect()
        };
        let group: Vec<usize> = places.iter().map(|&(block, _)| self.blocks[block].group).collect();
        let (time, temperature) = (of_block(&|b| b.time), of_block(&|b| b.temperature));
        let table = Table { values, ..self.table.alone(self.channels, &middles) };
        let session_of_pose = middles.iter().map(|&row| self.table.session_of(row)).collect();
        let whole = self.as_taken(&middles);
        let mut merged = Self {
            samples: middles.len(),
            channels: self.channels,
            labels: stretches.iter().map(|[first, ..]| self.labels[self.pose[*first]]).collect(),
            pose: (0..middles.len()).collect(),
            held: false,
            timed: self.timed,
            tempered: self.tempered,
            mean_temperature: self.mean_temperature,
            mean: self.mean.clone(),
            span: self.span.clone(),
            sessions: self.sessions,
            session_of_pose,
            groups: self.groups.clone(),
            table,
            named: self.named.clone(),
            clock: self.clock.clone(),
            merged: Some(Merged { rows, counts }),
            taken: self.taken,
            holding: self.holding.picked(&middles),
            ordered: self.ordered,
            blocks: Vec::new(),
            raw: Vec::new(),
            columns: Vec::new(),
            still: self.still.clone(),
            sides: OnceLock::new(),
            motion: OnceLock::new(),
            memories: Memories::default(),
            courses: OnceLock::new(),
            whole: Some(whole),
        };
        let order: Vec<f64> = (0..merged.samples).map(|pose| pose as f64).collect();
        merged.lay_out(&group, &time, &temperature, &order);
        merged
    }

    fn build(
        mechanism: &Mechanism,
        table: Table,
        whole: Option<(Arc<Self>, Vec<usize>)>,
        main: Option<&Self>,
        own_poses: bool,
    ) -> Result<Self, Error> {
        let channels = mechanism.channels.len();
        let named = mechanism.value_columns();
        let table = with_columns(mechanism, table, &named, main);
        let samples = check(mechanism, &table)?;
        let holding = Holding::of(mechanism, &table, samples)?;
        let whole = match (&table.part, whole) {
            (Some(part), None) => Some(Self::taken(mechanism, part, samples)?),
            (_, whole) => whole,
        };
        let (pose, labels) = number_poses(&table, samples);
        let held = table.pose.is_some();
        let mut session_of_pose = vec![0; labels.len()];
        for (row, &pose) in pose.iter().enumerate() {
            session_of_pose[pose] = table.session_of(row);
        }
        let (group, groups) = number_groups(&table, samples);
        let runs = 1 + group.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let ordered = table.time.is_some() || groups.len() < 2 || runs > groups.len();
        let (all, own): (&Table, &[usize]) = match &whole {
            Some((whole, _)) => (&whole.table, &whole.pose),
            None => (&table, &pose),
        };
        let clock = match main {
            Some(main) => main.clock.clone(),
            None => session_clock(all, own),
        };
        // The mean of a pose has the mean of its times.
        let time = match &whole {
            Some((_, rows)) if table.time.is_none() => {
                picked(&session_time(all, own, &clock), 1, rows)
            }
            _ => session_time(&table, &pose, &clock),
        };
        let mean_temperature = match main {
            Some(main) => main.mean_temperature,
            None => table.temperature.as_ref().map(|t| t.iter().sum::<f64>() / samples as f64),
        };
        let temperature: Vec<f64> = match (&table.temperature, mean_temperature) {
            (Some(t), Some(mean)) => t.iter().map(|t| t - mean).collect(),
            _ => vec![0.0; samples],
        };
        let tempered = temperature.iter().any(|t| t.abs() > STEADY)
            || main.is_some_and(|main| main.tempered && table.temperature.is_some());

        let column = |c: usize| table.values.iter().skip(c).step_by(channels).copied();
        let mean = (0..channels).map(|c| column(c).sum::<f64>() / samples as f64).collect();
        let span: Vec<[f64; 2]> = (0..channels)
            .map(|c| column(c).fold([f64::MAX, f64::MIN], |[l, h], v| [l.min(v), h.max(v)]))
            .collect();

        let still = standstills(mechanism, &span);
        let mut readings = Self {
            samples,
            channels,
            labels,
            pose,
            held,
            timed: table.time.is_some(),
            tempered,
            mean_temperature,
            mean,
            span,
            sessions: clock.len(),
            session_of_pose,
            groups,
            table,
            named,
            clock,
            merged: None,
            taken: main.filter(|_| own_poses).map_or(samples, |main| main.taken),
            holding,
            ordered,
            blocks: Vec::new(),
            raw: Vec::new(),
            columns: Vec::new(),
            still,
            sides: OnceLock::new(),
            motion: OnceLock::new(),
            memories: Memories::default(),
            courses: OnceLock::new(),
            whole,
        };
        let order: Vec<f64> = match main {
            Some(main) if !own_poses => main.places_of(&readings.table, samples),
            _ => readings.pose.iter().map(|&p| p as f64).collect(),
        };
        readings.lay_out(&group, &time, &temperature, &order);
        Ok(readings)
    }

    /// The session that rows are part of: what they have from others is asked of it, and whether its readings are
    /// within their range is not.
    fn taken(
        mechanism: &Mechanism,
        Part { whole, rows }: &Part,
        samples: usize,
    ) -> Result<(Arc<Self>, Vec<usize>), Error> {
        let table =
            Table { keys: Vec::new(), columns: Vec::new(), part: None, ..(**whole).clone() };
        let plain = |channel: &Channel| Channel { torque: None, range: None, ..channel.clone() };
        let bare = Mechanism {
            channels: mechanism.channels.iter().map(plain).collect(),
            chains: mechanism.chains.clone(),
            ..Mechanism::default()
        };
        let mut taken = Self::build(&bare, table, None, None, true)?;
        taken.still = standstills(mechanism, &taken.span);
        match rows.iter().find(|row| **row >= taken.samples) {
            Some(row) => Err(Error::shape("rows of the whole session", *row, taken.samples)),
            None => Error::same("rows of a part of a session", rows.len(), samples)
                .map(|()| (taken.into(), rows.clone())),
        }
    }

    /// The same readings less known errors of one channel, sample by sample. What a sample needs from
    /// others, directions, velocities and its course, stays as it was read.
    #[must_use]
    pub fn less(self: &Arc<Self>, channel: usize, errors: &[f64]) -> Self {
        self.motion();
        let mut less = Self::clone(self);
        less.whole.get_or_insert_with(|| (self.clone(), (0..self.samples).collect()));
        let own = less.table.values.iter_mut().skip(channel).step_by(self.channels);
        own.zip(errors).for_each(|(value, error)| *value -= error);
        for (k, block) in self.blocks.iter().enumerate() {
            less.raw[k * self.channels + channel] =
                Lanes(block.rows.map(|r| less.table.values[r * self.channels + channel]));
        }
        less
    }

    fn lay_out(&mut self, group: &[usize], time: &[f64], temperature: &[f64], pose: &[f64]) {
        let mut order: Vec<usize> = (0..self.samples).collect();
        order.sort_by_key(|&row| group[row]);
        // So much at most: every group begins a block.
        let blocks = self.samples / WIDTH + self.groups.len();
        self.blocks.reserve_exact(blocks);
        self.raw.reserve_exact(blocks * self.channels);
        self.columns.reserve_exact(blocks * self.table.columns.len());
        // What is blank is as it is on average: it counts nowhere.
        let usual =
            |column: &Vec<f64>| Some(mean_of(column.iter().copied())).filter(|m| !m.is_nan());
        let usual: Vec<f64> =
            self.table.columns.iter().map(|column| usual(column).unwrap_or(0.0)).collect();
        let mut first = 0;
        while first < order.len() {
            let mut last = first;
            while last < order.len()
                && last - first < WIDTH
                && group[order[last]] == group[order[first]]
            {
                last += 1;
            }
            let rows: [usize; WIDTH] =
                std::array::from_fn(|lane| order[(first + lane).min(last - 1)]);
            let gather = |f: &dyn Fn(usize) -> f64| Lanes(rows.map(f));
            for c in 0..self.channels {
                self.raw.push(gather(&|r| self.table.values[r * self.channels + c]));
            }
            for (column, usual) in self.table.columns.iter().zip(&usual) {
                let cell = |r: usize| if column[r].is_nan() { *usual } else { column[r] };
                self.columns.push(Lanes(rows.map(cell)));
            }
            self.holding.lay_out(&rows);
            self.blocks.push(Block {
                rows,
                live: last - first,
                group: group[order[first]],
                time: gather(&|r| time[r]),
                temperature: gather(&|r| temperature[r]),
                pose: gather(&|r| pose[r]),
                session: gather(&|r| self.table.session_of(r) as f64),
            });
            first = last;
        }
    }

    /// Positions of the rows of another table in the order of these poses: by the clock, half-way
    /// between two poses; without a clock that all sessions have in common, after the last pose.
    fn places_of(&self, other: &Table, rows: usize) -> Vec<f64> {
        match (&self.table.time, &other.time) {
            (Some(mine), Some(theirs)) if self.table.has_one_clock() => {
                let before = |time: &f64| mine.partition_point(|t| t <= time).checked_sub(1);
                let place = |row: usize| self.pose[row] as f64 + 0.5;
                theirs.iter().map(|time| before(time).map_or(-0.5, place)).collect()
            }
            _ => vec![self.poses() as f64 - 0.5; rows],
        }
    }

    /// Puts another reading in place of the only one.
    ///
    /// # Errors
    ///
    /// As [`Readings::new`]; the reading is then in place all the same.
    pub(crate) fn replace(&mut self, mechanism: &Mechanism, reading: &[f64]) -> Result<(), Error> {
        self.table.values.clear();
        self.table.values.extend_from_slice(reading);
        self.raw.clear();
        self.raw.extend(reading.iter().map(|value| Lanes::splat(*value)));
        (self.sides, self.motion) = (OnceLock::new(), OnceLock::new());
        (self.memories, self.courses) = (Memories::default(), OnceLock::new());
        check(mechanism, &self.table).map(|_| ())
    }

    /// Counts temperatures from `mean` (°C), that of another session, instead of the mean of these readings. What has the
    /// temperature of all rows alike then differs from that session's all the same, and terms of temperature act.
    pub fn count_temperature_from(&mut self, mean: f64) {
        let Some(own) = self.mean_temperature else { return };
        self.mean_temperature = Some(mean);
        self.tempered = true;
        for block in &mut self.blocks {
            block.temperature += Lanes::splat(own - mean);
        }
    }

    /// Places the samples at these times, in sessions from the first pose, one for each, after the
    /// last of `poses`.
    ///
    /// The time of a pose that is not yet visited is beyond 1.
    pub(crate) fn set_times(&mut self, times: &[f64], poses: usize) {
        for block in &mut self.blocks {
            block.time = Lanes(block.rows.map(|row| times[row]));
            block.pose = Lanes::splat(poses as f64);
        }
    }

    /// Lets all samples be approached from one reading `from`, one per channel.
    pub(crate) fn set_approach(&mut self, from: &[f64]) {
        let moved = |(k, raw): (usize, &Lanes)| {
            let c = k % self.channels;
            (*raw - Lanes::splat(from[c])).map(|change| direction(change, self.still[c]))
        };
        let approach = self.raw.iter().enumerate().map(moved).collect();
        self.motion = Motion { approach, velocity: self.motion().velocity.clone() }.into();
    }

    /// Number of poses.
    #[must_use]
    pub fn poses(&self) -> usize {
        self.labels.len()
    }

    /// The blocks.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Raw readings of a block: one [`Lanes`] per channel, one lane per sample. Empty for an index
    /// beyond the last block.
    #[must_use]
    #[inline(always)]
    pub fn raw(&self, block: usize) -> &[Lanes] {
        part(&self.raw, block, self.channels)
    }

    /// Raw readings of all blocks, one after another.
    #[must_use]
    pub(crate) fn all_raw(&self) -> &[Lanes] {
        &self.raw
    }

    /// Direction of approach of each row, one per channel: -1, 0 or 1. Found when first asked for.
    #[must_use]
    pub(crate) fn sides(&self) -> &[i8] {
        self.sides.get_or_init(|| match &self.whole {
            Some((whole, rows)) => picked(whole.sides(), self.channels, rows),
            None => sides(&self.table, &self.pose, &self.still, !self.moves()),
        })
    }

    /// Velocities of the rows, one per channel: none of held poses.
    fn velocities(&self) -> Vec<f64> {
        match &self.whole {
            _ if self.held => vec![0.0; self.samples * self.channels],
            Some((whole, rows)) => velocities(&whole.table, self.channels, rows.iter().copied()),
            None => velocities(&self.table, self.channels, 0..self.samples),
        }
    }

    /// Some of these rows, as rows of the session as it was taken.
    fn as_taken(self: &Arc<Self>, rows: &[usize]) -> (Arc<Self>, Vec<usize>) {
        match &self.whole {
            Some((whole, own)) => (whole.clone(), picked(own, 1, rows)),
            None => (self.clone(), rows.to_vec()),
        }
    }

    /// True for rows that are a motion. Poses that are read once each need no labels: without
    /// them, how far neighbours are apart tells them from a recording.
    pub(crate) fn moves(&self) -> bool {
        let rows: Vec<usize> = (0..self.samples).collect();
        let stretches: Vec<&[usize]> = rows.chunks_exact(STRETCH).collect();
        !self.held && is_motion(&self.table, &stretches, &self.mean, &self.span)
    }

    /// Directions and velocities in blocks. Few models need them, and of a long recording they are as
    /// large as the readings: they are found when first asked for.
    fn motion(&self) -> &Motion {
        self.motion.get_or_init(|| self.laid_out(&self.velocities()))
    }

    /// Where the samples of a block are in the recording that they are of; none where no clock tells.
    pub(crate) fn course(&self, block: usize) -> Option<CourseAt<'_>> {
        let rows = &self.blocks.get(block).filter(|_| self.timed && !self.held)?.rows;
        let of = |merged: &Merged| rows.map(|row| merged.counts[row]);
        let counts = self.merged.as_ref().map_or([1; WIDTH], of);
        let (whole, rows) = match &self.whole {
            Some((whole, middles)) => (&**whole, rows.map(|row| middles[row])),
            None => (self, *rows),
        };
        let Self { table, courses, channels, still, .. } = whole;
        Some(CourseAt { table, courses, channels: *channels, still, rows, counts })
    }

    /// True where the recording goes on to an instant so much later than a row; true without a clock.
    pub(crate) fn goes_on(&self, row: usize, later: f64) -> bool {
        if let Some((whole, rows)) = &self.whole {
            return whole.goes_on(rows[row], later);
        }
        let new = || Courses::of(&self.table, self.channels);
        !self.timed || self.held || self.courses.get_or_init(new).has(&self.table, row, later)
    }

    /// The directions and these velocities, row by row, one per channel, in blocks.
    fn laid_out(&self, velocity: &[f64]) -> Motion {
        let (sides, channels) = (self.sides(), self.channels);
        let gather = |f: &dyn Fn(usize) -> f64| -> Vec<Lanes> {
            let of_block =
                |block: &Block, c: usize| Lanes(block.rows.map(|row| f(row * channels + c)));
            let all = self.blocks.iter().flat_map(|block| (0..channels).map(move |c| (block, c)));
            all.map(|(block, c)| of_block(block, c)).collect()
        };
        Motion { approach: gather(&|i| f64::from(sides[i])), velocity: gather(&|i| velocity[i]) }
    }

    /// Direction of approach of each channel in a block: -1, 0 or 1. Empty for an index beyond the
    /// last block.
    #[must_use]
    #[inline(always)]
    pub fn approach(&self, block: usize) -> &[Lanes] {
        part(&self.motion().approach, block, self.channels)
    }

    /// What a channel remembers of its way to the samples of a block; zero for an index beyond the last
    /// block.
    #[must_use]
    pub(crate) fn remembered(&self, block: usize, channel: usize, memory: Memory) -> Lanes {
        let find = || self.laid_out_memory(channel, memory);
        self.memories.of(channel, memory, find).get(block).copied().unwrap_or(Lanes::ZERO)
    }

    /// The way of a channel to every sample, through the session as it was taken.
    pub(crate) fn visits(&self, channel: usize) -> Visits {
        let of = |whole: &Self| {
            let of = [channel, whole.channels];
            Visits::of(&whole.table, &whole.pose, of, whole.still[channel])
        };
        match &self.whole {
            Some((whole, rows)) => of(whole).at_rows(rows),
            None => of(self),
        }
    }

    fn laid_out_memory(&self, channel: usize, memory: Memory) -> Vec<Lanes> {
        let values = self.visits(channel).remembered(memory);
        self.blocks.iter().map(|block| Lanes(block.rows.map(|row| values[row]))).collect()
    }

    /// Velocity of each channel in a block, in readings per second. Empty for an index beyond the
    /// last block.
    #[must_use]
    #[inline(always)]
    pub fn velocity(&self, block: usize) -> &[Lanes] {
        part(&self.motion().velocity, block, self.channels)
    }

    /// Measured distances of a block in length units, one [`Lanes`] per value column. Empty for an
    /// index beyond the last block.
    #[must_use]
    #[inline(always)]
    pub fn columns(&self, block: usize) -> &[Lanes] {
        part(&self.columns, block, self.table.columns.len())
    }

    /// The lanes of a block's samples in which a closure of the mechanism holds.
    pub(crate) fn lanes(&self, block: usize, closure: usize) -> impl Iterator<Item = usize> {
        let live = self.blocks.get(block).map_or(0, |block| block.live);
        let holds = self.holding.of_block(block, closure);
        (0..live).filter(move |lane| holds.is_none_or(|holds| holds.0[*lane] > 0.0))
    }

    /// One row of raw readings, one per channel. Empty for an index beyond the last row.
    #[must_use]
    pub fn row(&self, row: usize) -> &[f64] {
        part(&self.table.values, row, self.channels)
    }

    /// Block and lane of each row.
    #[must_use]
    pub(crate) fn lane_of_rows(&self) -> Vec<(usize, usize)> {
        let mut lane_of = vec![(0, 0); self.samples];
        for (block, meta) in self.blocks.iter().enumerate() {
            for (row, lane) in meta.rows.iter().zip(0..meta.live) {
                lane_of[*row] = (block, lane);
            }
        }
        lane_of
    }

    /// The rows of each pose, in order.
    #[must_use]
    pub fn rows_of_poses(&self) -> Vec<Vec<usize>> {
        let mut rows = vec![Vec::new(); self.poses()];
        for (row, &pose) in self.pose.iter().enumerate() {
            rows[pose].push(row);
        }
        rows
    }

    /// Poses whose readings are those of an earlier pose, to the last digit of every sample.
    ///
    /// Even where nothing is noisy, they share the rounding, and say nothing new. In a
    /// recording rows may stand still: there a whole session is compared with another, and rows where nothing else
    /// tells them apart, and more than half of them are copies.
    #[must_use]
    pub fn copies(&self) -> Vec<usize> {
        if !self.held && self.sessions < 2 {
            return self.repeated_rows();
        }
        let whole = if self.held { self.rows_of_poses() } else { self.rows_of_sessions() };
        let mut seen = std::collections::HashSet::new();
        let again = |rows: &&Vec<usize>| !rows.is_empty() && !seen.insert(self.content(rows));
        let again: Vec<usize> = whole.iter().filter(again).flatten().copied().collect();
        let mut poses: Vec<usize> = again.into_iter().map(|row| self.pose[row]).collect();
        poses.sort_unstable();
        poses.dedup();
        poses
    }

    /// Rows of a recording that are an earlier row over again, where these are more than half of them and neither
    /// time nor temperature says what changed between them.
    fn repeated_rows(&self) -> Vec<usize> {
        let Table { time, temperature, .. } = &self.table;
        if time.is_some() || temperature.is_some() {
            return Vec::new();
        }
        let mut seen = std::collections::HashSet::new();
        let mut again = Vec::new();
        for row in 0..self.samples {
            if !seen.insert(self.content(&[row])) {
                again.push(self.pose[row]);
            } else if 2 * seen.len() >= self.samples {
                return Vec::new();
            }
        }
        again
    }

    /// Rows that are an earlier row of their held pose over again, to the last digit of all that was read.
    /// `counts` says which channels are counters.
    pub(crate) fn doubled(&self, counts: &[bool]) -> Vec<usize> {
        if !self.held {
            return Vec::new();
        }
        let mut found = doubled(&self.table.values, counts, &self.rows_of_poses());
        if !found.is_empty() {
            // What is read beside the channels may be new.
            let mut seen = std::collections::HashSet::new();
            let new = |row: &usize| seen.insert((self.pose[*row], self.content(&[*row])));
            let new: std::collections::HashSet<usize> = (0..self.samples).filter(new).collect();
            found.retain(|row| !new.contains(row));
        }
        found
    }

    /// All that these rows hold, time, temperature and labels aside.
    fn content(&self, rows: &[usize]) -> (Vec<u64>, Vec<&String>) {
        let of_row = |row: &usize| {
            let columns = self.table.columns.iter().map(|column| column[*row]);
            let values = self.row(*row).iter().copied().chain(columns);
            values.map(f64::to_bits).collect::<Vec<_>>()
        };
        let keys = self.table.keys.iter().flat_map(|key| rows.iter().map(|r| &key[*r]));
        (rows.iter().flat_map(of_row).collect(), keys.collect())
    }

    fn rows_of_sessions(&self) -> Vec<Vec<usize>> {
        let mut rows = vec![Vec::new(); self.sessions];
        for row in 0..self.samples {
            rows[self.table.session_of(row)].push(row);
        }
        rows
    }
}

/// Parts `rows` of `all` in parts of `width` entries.
fn picked<T: Copy>(all: &[T], width: usize, rows: &[usize]) -> Vec<T> {
    rows.iter().flat_map(|&row| all[row * width..(row + 1) * width].iter().copied()).collect()
}

/// Part `k` of `all` in parts of `width` entries; empty where there is no such part.
#[inline(always)]
fn part<T>(all: &[T], k: usize, width: usize) -> &[T] {
    let first = k.saturating_mul(width);
    all.get(first..first.saturating_add(width)).unwrap_or_default()
}

/// Largest number of sessions. Clocks are stored by session number, so a wrong number in the
/// table must not set the size of that array.
const MOST_SESSIONS: usize = 100_000;

/// A table with the columns that no closure has of its own, where it has none: what laws and drives use is as on the
/// mean of the readings beside which it stands, and absent where there are none.
fn with_columns(
    mechanism: &Mechanism,
    mut table: Table,
    named: &[String],
    main: Option<&Readings>,
) -> Table {
    let laws = mechanism.law_columns();
    if table.columns.is_empty() && laws.len() == named.len() {
        let rows = table.values.len() / mechanism.channels.len().max(1);
        table.columns = vec![vec![f64::NAN; rows]; named.len()];
    }
    let Some(main) = main else { return table };
    let absent = named.iter().zip(&mut table.columns).filter(|(name, _)| laws.contains(name));
    for (name, column) in absent.filter(|(_, column)| is_absent(column)) {
        let own = main.named.iter().zip(&main.table.columns).find(|(own, _)| *own == name);
        let mean = own.map(|(_, read)| mean_of(read.iter().copied()));
        column.fill(mean.unwrap_or(f64::NAN));
    }
    table
}

/// True for a column of which no row knows anything.
pub(crate) fn is_absent(column: &[f64]) -> bool {
    column.iter().all(|value| value.is_nan())
}

/// The number of rows of a table that a mechanism can be read from.
///
/// # Errors
///
/// [`Error::Shape`] for columns of other lengths, and as [`Readings::new`] for what stands in them.
pub(crate) fn check(mechanism: &Mechanism, table: &Table) -> Result<usize, Error> {
    let channels = mechanism.channels.len();
    if channels == 0 {
        return Err(Error::Mechanism {
            place: "channel".into(),
            found: "none".into(),
            expected: "at least one".into(),
        });
    }
    let samples = table.values.len() / channels;
    Error::same("values", table.values.len(), table.values.len().next_multiple_of(channels))?;
    if samples == 0 {
        return Err(Error::Empty("the table has no rows".into()));
    }
    let same = |what: &str, found: usize| Error::same(what, found, samples);
    same("pose", table.pose.as_ref().map_or(samples, Vec::len))?;
    same("time", table.time.as_ref().map_or(samples, Vec::len))?;
    same("temperature", table.temperature.as_ref().map_or(samples, Vec::len))?;
    same("session", table.session.as_ref().map_or(samples, Vec::len))?;
    let last = table.session.iter().flatten().copied().max().unwrap_or(0);
    if last >= MOST_SESSIONS {
        let what = format!("the list of sessions, which ends with number {last},");
        return Err(Error::shape(what, last.saturating_add(1), MOST_SESSIONS));
    }
    let keys = mechanism.key_columns();
    Error::same(&format!("keys ({})", keys.join(", ")), table.keys.len(), keys.len())?;
    for (name, column) in keys.iter().zip(&table.keys) {
        same(name, column.len())?;
    }
    let values = mechanism.value_columns();
    Error::same(&format!("columns ({})", values.join(", ")), table.columns.len(), values.len())?;
    for (name, column) in values.iter().zip(&table.columns) {
        same(name, column.len())?;
    }
    finite("time", table.time.as_deref().unwrap_or_default())?;
    finite("temperature", table.temperature.as_deref().unwrap_or_default())?;
    let closures = 0..mechanism.closures.len();
    let own: Vec<String> = closures.flat_map(|k| mechanism.own_columns(k)).collect();
    for (name, column) in values.iter().zip(&table.columns) {
        let blanks = if own.contains(name) { f64::is_nan } else { |_: f64| false };
        if own.contains(name) || !is_absent(column) {
            usable(name, column, blanks)?;
        }
    }
    for (row, values) in table.values.chunks_exact(channels).enumerate() {
        for (channel, &found) in mechanism.channels.iter().zip(values) {
            let [low, high] = channel.range.unwrap_or([-LARGEST, LARGEST]);
            if !(found.is_finite() && found >= low && found <= high) {
                let channel = channel.name.clone();
                return Err(Error::Reading { row, channel, found, low, high });
            }
        }
    }
    Ok(samples)
}

/// Refuses a column with an entry that is not a number.
fn finite(name: &str, column: &[f64]) -> Result<(), Error> {
    usable(name, column, |_| false)
}

/// The same, but for entries that may stand there.
fn usable(name: &str, column: &[f64], but: fn(f64) -> bool) -> Result<(), Error> {
    match column.iter().position(|v| !bounds::usable(*v) && !but(*v)) {
        None => Ok(()),
        Some(row) => Err(Error::Reading {
            row,
            channel: name.into(),
            found: column[row],
            low: -LARGEST,
            high: LARGEST,
        }),
    }
}

/// Numbers the poses of each session in order of appearance.
fn number_poses(table: &Table, samples: usize) -> (Vec<usize>, Vec<i64>) {
    let Some(labels) = &table.pose else {
        return ((0..samples).collect(), (1..=samples as i64).collect());
    };
    let session = |row: usize| table.session.as_ref().map_or(0, |s| s[row]);
    let mut seen = std::collections::HashMap::new();
    let mut names = Vec::new();
    let pose = (0..samples)
        .map(|row| {
            *seen.entry((session(row), labels[row])).or_insert_with(|| {
                names.push(labels[row]);
                names.len() - 1
            })
        })
        .collect();
    (pose, names)
}

/// Numbers the combinations of keys in order of appearance.
fn number_groups(table: &Table, samples: usize) -> (Vec<usize>, Vec<Vec<String>>) {
    let mut groups: Vec<Vec<String>> = Vec::new();
    let mut seen = std::collections::HashMap::new();
    let group = (0..samples)
        .map(|row| {
            let key: Vec<&String> = table.keys.iter().map(|column| &column[row]).collect();
            *seen.entry(key).or_insert_with_key(|key| {
                groups.push(key.iter().map(|k| (*k).clone()).collect());
                groups.len() - 1
            })
        })
        .collect();
    (group, groups)
}

/// Time by the clock, else by the order of poses.
fn clock_of(table: &Table, pose: &[usize], row: usize) -> f64 {
    table.time.as_ref().map_or(pose[row] as f64, |t| t[row])
}

/// First and last time of each session.
fn session_clock(table: &Table, pose: &[usize]) -> Vec<[f64; 2]> {
    let mut ends: Vec<[f64; 2]> = Vec::new();
    for row in 0..pose.len() {
        let session = table.session_of(row);
        if ends.len() <= session {
            ends.resize(session + 1, [f64::MAX, f64::MIN]);
        }
        let at = clock_of(table, pose, row);
        ends[session] = [ends[session][0].min(at), ends[session][1].max(at)];
    }
    ends
}

/// Time from 0 to 1 over each session. Readings from before or after the session have time 0 or
/// 1, because a drift outside the session is unknown.
fn session_time(table: &Table, pose: &[usize], clock: &[[f64; 2]]) -> Vec<f64> {
    (0..pose.len())
        .map(|row| {
            let [first, last] = clock[table.session_of(row).min(clock.len() - 1)];
            let at = clock_of(table, pose, row);
            if last > first { ((at - first) / (last - first)).clamp(0.0, 1.0) } else { 0.5 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten poses of a recording without a clock, read once each; the first channel goes up but for pose 5.
    fn session_of_poses() -> Table {
        let way = [0.0, 100.0, 200.0, 300.0, 900.0, 400.0, 500.0, 600.0, 700.0, 800.0];
        let values = way.iter().flat_map(|v| (0..9).map(move |c| if c == 0 { *v } else { 2000.0 }));
        Table { values: values.collect(), pose: Some((1..=10).collect()), ..Table::default() }
    }

    #[test]
    fn what_rows_have_from_others_does_not_depend_on_which_are_used() {
        let mechanism = Mechanism::rsi();
        let rows = [1, 3, 5, 8];
        let part = Readings::new(&mechanism, session_of_poses().some(9, &rows)).expect("counts");
        // By hand: pose 6 comes down from pose 5, which is left out.
        let first = |all: &[i8]| all.iter().step_by(9).copied().collect::<Vec<_>>();
        assert_eq!(first(part.sides()), [1, 1, -1, 1]);
        let block = &part.blocks()[0];
        assert_eq!(block.time.0[..4], [1.0, 3.0, 5.0, 8.0].map(|row: f64| row / 9.0));
        let way = |memory| part.remembered(0, 0, memory).0;
        assert_eq!(way(Memory::Travelled)[..4], [100.0, 300.0, 1400.0, 1700.0]);
        assert_eq!(way(Memory::SinceTurn)[..4], [100.0, 300.0, -500.0, 300.0]);
        // Rows of these rows are rows of the same session, with a mean for each pose or without.
        let fewer = Arc::new(part).some(&mechanism, &[1, 2]).expect("counts");
        assert_eq!(first(fewer.sides()), [1, -1]);
        let table = session_of_poses().some(9, &rows).some(9, &[1, 2]);
        assert_eq!(first(Readings::new(&mechanism, table).expect("counts").sides()), [1, -1]);
        let (means, _) = fewer.averaged(&mechanism, &[1.0, 1.0]).expect("counts");
        assert_eq!(first(means.sides()), [1, -1]);
    }

    #[test]
    fn rows_beside_are_placed_by_a_clock_that_all_sessions_share() {
        let mechanism = Mechanism::rsi();
        let clock = |begins: f64| {
            let time = (0..10).map(|row| if row < 5 { row as f64 } else { begins + row as f64 });
            let session = Some((0..10).map(|row| row / 5).collect());
            Table { time: Some(time.collect()), session, ..session_of_poses() }
        };
        let other = Table { time: Some(vec![2.5, 107.5]), ..session_of_poses().some(9, &[2, 7]) };
        let other = Table { pose: Some(vec![1, 2]), part: None, ..other };
        let places = |begins: f64| {
            let main = Readings::new(&mechanism, clock(begins)).expect("counts");
            let beside = Readings::beside(&mechanism, other.clone(), &main).expect("counts");
            beside.blocks()[0].pose.0[..2].to_vec()
        };
        // By hand: behind the third pose of the first session, and of the second.
        assert_eq!(places(100.0), [2.5, 7.5]);
        // The second clock begins anew: no time says which session it is of.
        assert_eq!(places(-5.0), [9.5, 9.5]);
    }

    #[test]
    fn rows_that_the_session_does_not_have_are_refused() {
        let part = |rows: Vec<usize>| Part { whole: Arc::new(session_of_poses()), rows };
        for rows in [vec![10], vec![0, 1]] {
            let one = Table { part: Some(part(rows)), ..session_of_poses().alone(9, &[3]) };
            assert!(matches!(Readings::new(&Mechanism::rsi(), one), Err(Error::Shape { .. })));
        }
    }
}

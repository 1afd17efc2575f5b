//! The watch itself: one row after the other.

use crate::Error;
use crate::apply::earlier::Applied;
use crate::mechanism::Mechanism;
use crate::monitor::alarm::Alarm;
use crate::monitor::options::MonitorOptions;
use crate::monitor::order::{Counts, Order, Row};
use crate::monitor::platform::Seen;
use crate::monitor::recent::Recent;
use crate::monitor::rows::Rows;
use crate::monitor::runs::Runs;
use crate::monitor::score::Score;
use crate::monitor::state::{State, dot};
use crate::monitor::tails::Tails;
use crate::monitor::thresholds::{Thresholds, as_chi2};
use crate::monitor::unsteady::{Whitener, places};
use crate::monitor::watched::Watched;
use crate::monitor::watching::{CONFIRMED, Monitor, Tested};
use crate::monitor::whitening::Whitening;
use crate::monitor::windows::Windows;
use crate::numerics::distributions::chi2_quantile;
use crate::numerics::lanes::{WIDTH, dispatch};

/// Levels of windows: the longest has 2^20 samples.
const LEVELS: usize = 18;

/// Probability with which a sound sample is taken for one far outside.
const OUTSIDE: f64 = 1e-8;

/// Squared innovations are cut off here before the scale of the noise is learned from them, in
/// their expectation.
const CLIP: f64 = 8.0;

/// Degrees of freedom of a noise that was declared: it may be somewhat wrong.
const DECLARED: f64 = 1e3;

/// Values after which older ones fade in the scale of the noise.
const MEMORY: f64 = 1e6;

/// Values for which the correlation in the calibration counts: the sampling at work may differ.
const CORRELATION: f64 = 200.0;

/// Samples after a start at which parameters are centred for the first time, and names looked at
/// again; then at each power of two.
const LOOK_AGAIN: u64 = 16;

impl Monitor {
    /// A watch over a mechanism under a calibration.
    ///
    /// `covariance` is that of the calibration's parameters, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] for a mechanism whose loops are not closed in every sample: with unknown
    /// points or measured distances; [`Error::Option`] for a calibration with a term that the channels of one row
    /// do not tell, and for options that cannot be used; [`Error::Shape`] for a calibration without a
    /// covariance, or with another number of parameters;
    /// else as [`crate::apply::earlier::platform_poses`].
    pub fn new(
        mechanism: &Mechanism,
        applied: &Applied,
        covariance: &[f64],
        options: &MonitorOptions,
    ) -> Result<Self, Error> {
        options.check()?;
        let mut watched = Watched::at_work(mechanism, applied, covariance)?;
        watched.places = places(mechanism, &watched);
        if watched.uncertain == 0 {
            let expected = applied.parameters.len().pow(2);
            return Err(Error::shape("the covariance of the calibration", 0, expected));
        }
        let (equations, width) = (watched.under.model.equations(), watched.order.len());
        let state = State::new(watched.prior.clone(), watched.uncertain, width, equations);
        let thresholds =
            Thresholds::new(options.false_alarms, LEVELS, watched.candidates.len(), Windows::step);
        Ok(Self {
            order: Order::new(&mechanism.channels),
            counts: Counts::default(),
            rows: Rows::new(&watched, &watched.under.noise),
            whitening: Whitening::new(options.quiet.correlation, CORRELATION, equations, width),
            state,
            windows: Windows::new(width, LEVELS, watched.tested())
                .with_live(width - watched.drifts.len()),
            thresholds,
            tails: Tails::new(LEVELS),
            score: Score::new(width),
            seen: Seen::new(mechanism.channels.len()),
            spread: 1.0,
            rate: options.false_alarms,
            runs: Runs::new(mechanism.channels.len()),
            stuck: Vec::new(),
            unsteady: Vec::new(),
            whitener: Whitener::new(equations, width),
            lately: Vec::new(),
            silent: false,
            scale: 1.0,
            dof: options.quiet.dof.unwrap_or(DECLARED),
            outside: chi2_quantile(OUTSIDE, equations as f64),
            r: vec![0.0; equations],
            g: vec![0.0; equations * width],
            waiting: [0; CONFIRMED],
            held: 0,
            age: 0,
            recent: Recent::new(mechanism.channels.len()),
            again: Rows::new(&watched, &watched.under.noise),
            out: None,
            open: None,
            alarms: Vec::new(),
            watched,
        })
    }

    /// Tests one row: the reading of each channel, in the channel's unit, and its time (s).
    ///
    /// Returns the alarms that it raises. A row that cannot be used, is late or repeated is
    /// counted and otherwise ignored. After the first row, memory is allocated only for an alarm, and now and then
    /// while something is unsteady.
    pub fn update(&mut self, readings: &[f64], time: Option<f64>) -> &[Alarm] {
        self.alarms.clear();
        if let Some(tested) = self.judge(readings, time) {
            self.rows.put(0, readings);
            self.rows.linearise(&self.watched, tested.row);
            self.test(0, tested);
            self.seen.see(readings.iter().copied());
        }
        &self.alarms
    }

    /// Tests many rows, `values` row by row, with their times (s): as [`Monitor::update`] with one
    /// after the other, and faster.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] where `values` is not whole rows, or where there is not a time for each.
    pub fn update_all(&mut self, values: &[f64], times: Option<&[f64]>) -> Result<&[Alarm], Error> {
        let channels = self.watched.under.model.scales.len();
        let rows = values.len() / channels;
        Error::same("values", values.len(), values.len().next_multiple_of(channels))?;
        Error::same("time", times.map_or(rows, <[f64]>::len), rows)?;
        self.alarms.clear();
        let mut block = [Tested { row: 0, time: None, gap: None }; WIDTH];
        let mut full = 0;
        for (row, readings) in values.chunks_exact(channels).enumerate() {
            if let Some(tested) = self.judge(readings, times.map(|t| t[row])) {
                self.rows.put(full, readings);
                block[full] = tested;
                full += 1;
            }
            if full == WIDTH || row + 1 == rows {
                self.test_block(&block[..full]);
                full = 0;
            }
        }
        Ok(&self.alarms)
    }

    /// Rows so far, by what became of them.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Noise at work: its standard deviation over that of the calibration, and the correlation of
    /// neighbouring samples.
    #[must_use]
    pub fn noise(&self) -> (f64, f64) {
        (self.scale.sqrt(), self.whitening.correlation())
    }

    /// Usual time between neighbouring rows (s), where rows have a time.
    #[must_use]
    pub fn interval(&self) -> Option<f64> {
        self.order.interval
    }

    fn judge(&mut self, readings: &[f64], time: Option<f64>) -> Option<Tested> {
        let (row, missing) = (self.counts.rows, self.counts.missing);
        match self.order.judge(readings, time, &mut self.counts) {
            Row::LeftOut => None,
            found => {
                self.recent.keep(row, time, readings);
                let missing = self.counts.missing - missing;
                let gap = (found == Row::AfterGap).then_some((missing > 0).then_some(missing));
                Some(Tested { row, time, gap })
            }
        }
    }

    fn test_block(&mut self, block: &[Tested]) {
        let Some(first) = block.first() else { return };
        self.rows.linearise(&self.watched, first.row);
        for (lane, tested) in block.iter().enumerate() {
            if self.test(lane, *tested) {
                self.rows.linearise(&self.watched, first.row);
            }
            self.seen.see(self.rows.in_lane(lane));
        }
    }

    /// Counts what repeats; true where a channel has done so for longer than chance allows since this
    /// row, while the name of a change is open.
    fn see_runs(&mut self, lane: usize, row: u64) -> bool {
        for channel in 0..self.watched.under.model.scales.len() {
            let stuck = self.stuck.contains(&channel);
            let moved = self.runs.see(channel, self.rows.reading(channel, lane), row, stuck);
            if moved && stuck {
                self.stuck.retain(|own| *own != channel);
                // Begins anew with this row.
                self.windows.now.mark.row = row;
                self.restart();
                self.age = 0;
            }
        }
        let Some(open) = &self.open else { return false };
        self.long_run(open.alarm.since_row).is_some_and(|(place, _)| {
            let channel = self.watched.places[place].channel.unwrap_or_default();
            self.runs.rows(channel).is_power_of_two()
        })
    }

    /// Tests the row in a lane; true where the parameters have moved.
    fn test(&mut self, lane: usize, tested: Tested) -> bool {
        if self.silent {
            self.counts.silent += 1;
            return false;
        }
        match tested.gap {
            None => {}
            Some(None) => self.whitening.interrupt(),
            Some(Some(missing)) => self.whitening.skip(missing),
        }
        let rare = self.see_runs(lane, tested.row);
        if !self.stuck.is_empty() {
            self.counts.silent += 1;
            return false;
        }
        self.rows.read(lane, &self.watched, tested.row, &mut self.r, &mut self.g);
        if self.is_out(tested.row) {
            self.counts.silent += 1;
            return false;
        }
        if !self.unsteady.is_empty() {
            let Self { whitener, watched, unsteady, r, g, state, scale, .. } = self;
            whitener.row(watched, unsteady, *scale, tested.row, r, g);
            unsteady.iter_mut().for_each(|one| one.hear(watched, r, g, &state.mean, *scale));
        }
        let crossed = dispatch(
            #[inline(always)]
            || self.advance(tested),
        );
        if crossed {
            self.raise(tested);
            return true;
        }
        if self.held > 0 {
            return false;
        }
        self.unsteady.iter_mut().for_each(|one| one.learn(MEMORY));
        self.age += 1;
        let due = rare || (self.age >= LOOK_AGAIN && self.age.is_power_of_two());
        if due {
            self.recentre();
            self.look_again(tested);
            if !self.unsteady.is_empty() {
                self.take_turned(tested.row);
            }
        }
        due
    }

    /// Puts the mean of the state into the parameters about which rows are linearised: while a
    /// name is open, the mean under this name.
    fn recentre(&mut self) {
        let named: Option<Vec<f64>> = self.open.as_ref().and_then(|open| {
            let (mean, _) = open.alone(&self.watched, &self.state, open.named)?;
            let places = mean.iter().enumerate();
            Some(places.map(|(k, m)| m - open.moved(&self.watched, k)).collect())
        });
        let mut mean = std::mem::take(&mut self.state.mean);
        let shift = named.as_ref().unwrap_or(&mean);
        let Watched { at, order, scale, .. } = &mut self.watched;
        for ((position, column), by) in order.iter().enumerate().zip(shift) {
            at[*column] += by * scale[position];
        }
        self.windows.recentre(shift);
        self.whitening.recentre(shift);
        match &named {
            Some(shift) => mean.iter_mut().zip(shift).for_each(|(mean, by)| *mean -= by),
            None => mean.fill(0.0),
        }
        self.state.mean = mean;
    }

    /// Takes over one sample; true where a window exceeds its threshold, or where samples far outside
    /// have been confirmed.
    #[inline(always)]
    fn advance(&mut self, tested: Tested) -> bool {
        let width = self.watched.order.len();
        self.whitening.filter(&mut self.r, &mut self.g);
        let squared = self.state.compare(&self.r, &self.g, width) / self.scale;
        if squared > self.outside && as_chi2(squared, self.values()) > self.outside {
            self.whitening.interrupt();
            self.waiting[self.held] = tested.row;
            self.held += 1;
            return self.held == CONFIRMED;
        }
        self.waiting[..self.held].iter().for_each(|row| self.recent.leave_out(*row));
        self.counts.outliers += std::mem::take(&mut self.held) as u64;
        self.state.absorb();
        self.counts.used += 1;
        let equations = self.r.len() as f64;
        let squared = squared.min(CLIP * equations) * self.scale;
        self.scale = (self.scale * self.dof + squared) / (self.dof + equations);
        let far = (squared / self.scale - equations).powi(2) / (2.0 * equations);
        let known = self.dof / equations;
        self.spread = (self.spread * known + far) / (known + 1.0);
        self.dof = (self.dof + equations).min(MEMORY);
        let (state, size) = (&self.state, self.state.size);
        self.whitening.learn(|g| dot(&g[..size], &state.mean));
        self.windows.add(&self.r, &self.g, tested.row, tested.time);
        let Some((level, onset)) = self.windows.keep() else { return false };
        let mut loudest: Option<f64> = None;
        let values = self.values();
        for candidate in &self.watched.candidates {
            let begin = self.windows.onset(onset);
            let (statistic, rank) =
                self.score.test(&candidate.columns, &self.state, &self.windows.now, begin);
            let far = self.thresholds.far(level, rank, statistic / self.scale, values);
            if far > loudest {
                loudest = far;
            }
        }
        loudest.is_some_and(|log| self.thresholds.exceeded(level, log, &mut self.tails))
    }
}

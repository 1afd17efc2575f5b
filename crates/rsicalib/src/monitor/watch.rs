//! The watch itself: one row after the other.

use nalgebra::DMatrix;

use crate::Error;
use crate::apply::earlier::Applied;
use crate::mechanism::Mechanism;
use crate::monitor::alarm::{Alarm, Change};
use crate::monitor::options::MonitorOptions;
use crate::monitor::order::{Counts, Order, Row};
use crate::monitor::platform::Seen;
use crate::monitor::rows::Rows;
use crate::monitor::score::Score;
use crate::monitor::state::{State, dot};
use crate::monitor::thresholds::{Thresholds, as_chi2, log_tail, quantile};
use crate::monitor::watched::Watched;
use crate::monitor::whitening::Whitening;
use crate::monitor::windows::{Mark, Sums, Windows};
use crate::numerics::lanes::{WIDTH, dispatch};

/// Levels of windows: the longest has 2^20 samples.
const LEVELS: usize = 18;

/// Probability with which a sound sample is taken for one far outside.
const OUTSIDE: f64 = 1e-8;

/// Number of samples far outside, one after the other, that make a change of the device.
const CONFIRMED: usize = 4;

/// Squared innovations are cut off here before the scale of the noise is learned from them, in
/// their expectation.
const CLIP: f64 = 8.0;

/// Degrees of freedom of a noise that was declared: it may be somewhat wrong.
const DECLARED: f64 = 1e3;

/// Values after which older ones fade in the scale of the noise.
const MEMORY: f64 = 1e6;

/// Values for which the correlation in the calibration counts: the sampling at work may differ.
const CORRELATION: f64 = 200.0;

/// Changes fit as well where twice the logarithm of their probability differs by less.
const AS_WELL: f64 = 6.0;

/// Standard deviation, in typical sizes, of the parameters of a change that has several: holds
/// those that the readings cannot tell.
const TYPICAL: f64 = 10.0;

/// A calibrated mechanism that is watched at work.
///
/// # Example
///
/// ```
/// use rsicalib::monitor::{Monitor, MonitorOptions};
/// use rsicalib::{Mechanism, apply::earlier::{Applied, Reference}};
///
/// let mechanism = Mechanism::rsi();
/// let reference = Reference { centre: vec![2048.0; 9], span: vec![[1000.0, 3000.0]; 9], temperature: None };
/// let applied = Applied { reference, sigma: vec![1.0; 9], ..Applied::default() };
/// let mut monitor = Monitor::new(&mechanism, &applied, None, &MonitorOptions::default())?;
/// for row in 0..100 {
///     // The rest pose under nominal parameters, read with a little noise.
///     let readings: Vec<f64> = (0..9).map(|c| 2048.0 + f64::from((7 * row + 5 * c) % 3) - 1.0).collect();
///     assert!(monitor.update(&readings, None).is_empty());
/// }
/// assert_eq!(monitor.counts().used, 100);
/// # Ok::<(), rsicalib::Error>(())
/// ```
pub struct Monitor {
    watched: Watched,
    sigma: Vec<f64>,
    order: Order,
    counts: Counts,
    rows: Rows,
    whitening: Whitening,
    state: State,
    windows: Windows,
    thresholds: Thresholds,
    score: Score,
    seen: Seen,
    /// Scale of the noise, as a variance, and the values that it is known from.
    scale: f64,
    dof: f64,
    /// Limit beyond which a sample is far outside.
    outside: f64,
    /// Samples far outside that wait to be confirmed.
    waiting: Vec<Waiting>,
    held: usize,
    r: Vec<f64>,
    g: Vec<f64>,
    alarms: Vec<Alarm>,
}

/// A sample that waits.
#[derive(Debug, Clone, Default)]
struct Waiting {
    r: Vec<f64>,
    g: Vec<f64>,
    row: u64,
    time: Option<f64>,
}

/// A row that is to be tested.
#[derive(Debug, Clone, Copy)]
struct Tested {
    row: u64,
    time: Option<f64>,
    after_gap: bool,
}

/// The best onset of a candidate.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    candidate: usize,
    /// None: the onset before the samples that waited.
    onset: Option<usize>,
    statistic: f64,
    rank: usize,
    log_p: f64,
}

impl Monitor {
    /// A watch over a mechanism under a calibration.
    ///
    /// `covariance` is that of the calibration's parameters, row by row; none: they are exact.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] for a mechanism whose loops are not closed in every sample: with unknown
    /// points or measured distances; [`Error::Context`] for a calibration with a term that
    /// needs more than one row of readings; [`Error::Option`] for options that cannot be used;
    /// else as [`crate::apply::earlier::platform_poses`].
    pub fn new(
        mechanism: &Mechanism,
        applied: &Applied,
        covariance: Option<&[f64]>,
        options: &MonitorOptions,
    ) -> Result<Self, Error> {
        options.check()?;
        let watched = Watched::new(mechanism, applied, covariance)?;
        let (equations, width) = (watched.under.model.equations(), watched.order.len());
        let state = State::new(watched.prior.clone(), watched.uncertain, width, equations);
        let thresholds =
            Thresholds::new(options.false_alarms, LEVELS, watched.candidates.len(), Windows::step);
        let waiting = Waiting {
            r: vec![0.0; equations],
            g: vec![0.0; equations * width],
            ..Waiting::default()
        };
        Ok(Self {
            sigma: applied.sigma.clone(),
            order: Order::new(&mechanism.channels),
            counts: Counts::default(),
            rows: Rows::new(&watched, &applied.sigma),
            whitening: Whitening::new(options.quiet.correlation, CORRELATION, equations, width),
            state,
            windows: Windows::new(width, LEVELS),
            thresholds,
            score: Score::new(width),
            seen: Seen::new(mechanism.channels.len()),
            scale: 1.0,
            dof: options.quiet.dof.unwrap_or(DECLARED),
            outside: quantile(OUTSIDE, equations as f64),
            r: waiting.r.clone(),
            g: waiting.g.clone(),
            waiting: vec![waiting; CONFIRMED],
            held: 0,
            alarms: Vec::new(),
            watched,
        })
    }

    /// Tests one row: the reading of each channel, in the channel's unit, and its time (s).
    ///
    /// Returns the alarms that it raises. A row that cannot be used, is late or repeated is
    /// counted and otherwise ignored. After the first row, memory is allocated only for an alarm.
    pub fn update(&mut self, readings: &[f64], time: Option<f64>) -> &[Alarm] {
        self.alarms.clear();
        if let Some(tested) = self.judge(readings, time) {
            self.rows.put(0, readings);
            self.rows.linearise(&self.watched);
            self.test(0, tested);
            self.seen.see(readings);
        }
        &self.alarms
    }

    /// Tests many rows, `values` row by row, with their times (s): as [`Monitor::update`] with one
    /// after the other, and faster.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] where `values` is not whole rows, or where there is not a time for each.
    pub fn update_all(
        &mut self,
        values: &[f64],
        times: Option<&[f64]>,
    ) -> Result<&[Alarm], Error> {
        let channels = self.sigma.len();
        let rows = values.len() / channels;
        let shape = |what: &str, found, expected| Error::Shape { what: what.into(), found, expected };
        if !values.len().is_multiple_of(channels) {
            return Err(shape("values", values.len(), (rows + 1) * channels));
        }
        if let Some(found) = times.map(<[f64]>::len).filter(|found| *found != rows) {
            return Err(shape("time", found, rows));
        }
        self.alarms.clear();
        let mut block = [Tested { row: 0, time: None, after_gap: false }; WIDTH];
        let mut full = 0;
        for (row, readings) in values.chunks_exact(channels).enumerate() {
            if let Some(tested) = self.judge(readings, times.map(|t| t[row])) {
                self.rows.put(full, readings);
                self.seen.see(readings);
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
        let row = self.counts.rows;
        match self.order.judge(readings, time, &mut self.counts) {
            Row::LeftOut => None,
            found => Some(Tested { row, time, after_gap: found == Row::AfterGap }),
        }
    }

    fn test_block(&mut self, block: &[Tested]) {
        if block.is_empty() {
            return;
        }
        self.rows.linearise(&self.watched);
        for (lane, tested) in block.iter().enumerate() {
            let before = self.alarms.len();
            self.test(lane, *tested);
            if self.alarms.len() > before {
                // The parameters have changed.
                self.rows.linearise(&self.watched);
            }
        }
    }

    fn test(&mut self, lane: usize, tested: Tested) {
        if tested.after_gap {
            self.whitening.interrupt();
        }
        self.rows.read(lane, &self.watched, &mut self.r, &mut self.g);
        let crossed = dispatch(
            #[inline(always)]
            || self.advance(tested),
        );
        if let Some(onset) = crossed {
            self.raise(onset, tested);
        }
    }

    /// Takes over one sample; the onset of a window that exceeds its threshold, `Some(None)` where
    /// samples far outside have been confirmed.
    #[inline(always)]
    fn advance(&mut self, tested: Tested) -> Option<Option<usize>> {
        let width = self.watched.order.len();
        self.whitening.filter(&mut self.r, &mut self.g);
        let squared = self.state.compare(&self.r, &self.g, width) / self.scale;
        if squared > self.outside && as_chi2(squared, self.dof) > self.outside {
            self.whitening.interrupt();
            let place = &mut self.waiting[self.held];
            place.r.copy_from_slice(&self.r);
            place.g.copy_from_slice(&self.g);
            (place.row, place.time) = (tested.row, tested.time);
            self.held += 1;
            return (self.held == CONFIRMED).then_some(None);
        }
        self.counts.outliers += std::mem::take(&mut self.held) as u64;
        self.state.absorb();
        self.counts.used += 1;
        let equations = self.r.len() as f64;
        let squared = squared.min(CLIP * equations) * self.scale;
        self.scale = (self.scale * self.dof + squared) / (self.dof + equations);
        self.dof = (self.dof + equations).min(MEMORY);
        let (state, size) = (&self.state, self.state.size);
        self.whitening.learn(|g| dot(&g[..size], &state.mean));
        self.windows.add(&self.r, &self.g, tested.row, tested.time);
        let (level, onset) = self.windows.keep()?;
        for candidate in &self.watched.candidates {
            let begin = self.windows.onset(onset);
            let (statistic, rank) =
                self.score.test(&candidate.columns, &self.state, &self.windows.now, begin);
            if self.thresholds.exceeded(level, rank, statistic / self.scale, self.dof) {
                return Some(Some(onset));
            }
        }
        None
    }

    /// Names the change, and goes on with it.
    fn raise(&mut self, crossed: Option<usize>, tested: Tested) {
        let mut before = None;
        let mut onsets: Vec<Option<usize>> = vec![crossed];
        if crossed.is_none() {
            before = Some(self.windows.now.clone());
            for place in std::mem::take(&mut self.waiting) {
                self.state.compare(&place.r, &place.g, self.watched.order.len());
                self.state.absorb();
                self.counts.used += 1;
                self.windows.add(&place.r, &place.g, place.row, place.time);
                self.waiting.push(place);
            }
            self.held = 0;
        } else {
            onsets = self.windows.onsets().into_iter().map(Some).collect();
        }
        let Some((best, others)) = self.suspects(&onsets, before.as_ref()) else {
            self.windows.restart();
            return;
        };
        let mut begin = self.begin(best.onset, before.as_ref()).mark;
        if before.is_some() {
            // The samples that waited are the first of the change.
            (begin.row, begin.time) = (self.waiting[0].row, self.waiting[0].time);
        }
        let p_value = self.thresholds.p_value(best.rank, best.statistic, self.dof);
        let also_fits = others.iter().map(|s| self.spec(s)).collect();
        let earlier = self.watched.at.clone();
        let spec = self.spec(&best);
        let (parameters, [size, sd], unit) = self.take_over(&best, before.as_ref());
        let platform_rms =
            self.seen.change(&self.watched, &self.sigma, &earlier, &self.watched.at);
        let Mark { row: since_row, time: since, .. } = begin;
        self.counts.alarms += 1;
        self.alarms.push(Alarm {
            row: tested.row,
            time: tested.time,
            since_row,
            since,
            spec,
            size,
            sd,
            unit,
            parameters,
            platform_rms,
            p_value,
            also_fits,
        });
        self.windows.restart();
        self.whitening.interrupt();
    }

    fn spec(&self, suspect: &Suspect) -> crate::model::Spec {
        self.watched.candidates[suspect.candidate].spec.clone()
    }

    fn begin<'a>(&'a self, onset: Option<usize>, before: Option<&'a Sums>) -> &'a Sums {
        match (onset, before) {
            (Some(kept), _) => self.windows.onset(kept),
            (None, Some(before)) => before,
            (None, None) => &self.windows.now,
        }
    }

    /// The least probable candidate at its best onset, and those that fit as well.
    fn suspects(
        &mut self,
        onsets: &[Option<usize>],
        before: Option<&Sums>,
    ) -> Option<(Suspect, Vec<Suspect>)> {
        let mut all: Vec<Suspect> = Vec::new();
        for number in 0..self.watched.candidates.len() {
            let mut best: Option<Suspect> = None;
            for &onset in onsets {
                let begin = match (onset, before) {
                    (Some(kept), _) => self.windows.onset(kept),
                    (None, Some(before)) => before,
                    (None, None) => continue,
                };
                let columns = &self.watched.candidates[number].columns;
                let (statistic, rank) =
                    self.score.test(columns, &self.state, &self.windows.now, begin);
                if rank == 0 {
                    continue;
                }
                let statistic = statistic / self.scale;
                let log_p = log_tail(statistic, rank as f64);
                if best.is_none_or(|b| log_p < b.log_p) {
                    best = Some(Suspect { candidate: number, onset, statistic, rank, log_p });
                }
            }
            all.extend(best);
        }
        all.sort_by(|a, b| a.log_p.total_cmp(&b.log_p));
        let best = *all.first()?;
        let near = |s: &Suspect| 2.0 * (s.log_p - best.log_p) < AS_WELL;
        Some((best, all.into_iter().skip(1).filter(near).collect()))
    }

    /// Puts the estimate of a change into the parameters, and its uncertainty into the state.
    fn take_over(
        &mut self,
        suspect: &Suspect,
        before: Option<&Sums>,
    ) -> (Vec<Change>, [f64; 2], String) {
        let candidate = self.watched.candidates[suspect.candidate].clone();
        let (columns, m) = (&candidate.columns, self.state.size);
        let q = columns.len();
        let begin = match (suspect.onset, before) {
            (Some(kept), _) => self.windows.onset(kept),
            (None, Some(before)) => before,
            (None, None) => &self.windows.now,
        };
        self.score.test(columns, &self.state, &self.windows.now, begin);
        let ridge = if q > 1 { TYPICAL.powi(-2) } else { 0.0 };
        let Some((theta, v)) = self.score.estimate(q, ridge) else {
            return (Vec::new(), [0.0, 0.0], String::new());
        };

        // Error of the calibration beside the change: β - W θ, with W = J⁻¹ D_gz.
        let w = DMatrix::from_fn(m, q, |row, column| self.score.absorbed[column * m + row]);
        let beta = DMatrix::from_row_slice(m, 1, &self.state.mean) - &w * &theta;
        let old = DMatrix::from_row_slice(m, m, &self.state.covariance);
        let mut joint = DMatrix::zeros(m + q, m + q);
        joint.view_mut((0, 0), (m, m)).copy_from(&(old + &w * &v * w.transpose()));
        joint.view_mut((0, m), (m, q)).copy_from(&(-&w * &v));
        joint.view_mut((m, 0), (q, m)).copy_from(&(-(&w * &v).transpose()));
        joint.view_mut((m, m), (q, q)).copy_from(&v);

        // A change of a parameter that is uncertain adds to it; another one joins them.
        let joining: Vec<usize> = (0..q).filter(|&i| columns[i] >= m).collect();
        let mut map = DMatrix::zeros(m + joining.len(), m + q);
        (0..m).for_each(|k| map[(k, k)] = 1.0);
        for i in (0..q).filter(|&i| columns[i] < m) {
            map[(columns[i], m + i)] = 1.0;
        }
        for (k, &i) in joining.iter().enumerate() {
            map[(m + k, m + i)] = 1.0;
        }
        let covariance = &map * joint * map.transpose();
        for i in 0..q {
            let position = columns[i];
            self.watched.at[self.watched.order[position]] += theta[i] * self.watched.scale[position];
        }
        let units: Vec<f64> = columns.iter().map(|&z| self.watched.scale[z]).collect();
        for &i in &joining {
            let column = self.watched.candidates[suspect.candidate].columns[i];
            self.watched.join(column);
        }
        self.state.size = m + joining.len();
        self.state.mean.clear();
        self.state.mean.extend(beta.iter());
        self.state.mean.resize(self.state.size, 0.0);
        self.state.covariance.clear();
        // Symmetric, so the order of rows and columns is the same.
        self.state.covariance.extend(covariance.iter());

        let scale = self.scale.sqrt();
        let change = |i: usize| Change {
            name: candidate.parameters[i].0.into(),
            value: theta[i] * units[i],
            sd: v[(i, i)].max(0.0).sqrt() * units[i] * scale,
            unit: candidate.parameters[i].1.clone(),
        };
        let parameters: Vec<Change> = (0..q).map(change).collect();
        let size = size_of(&parameters, |i, j| v[(i, j)] * units[i] * units[j] * self.scale);
        let unit = parameters[0].unit.clone();
        (parameters, size, unit)
    }
}

/// The value of a single parameter, or the length of those in the unit of the first; with its
/// standard deviation.
fn size_of(parameters: &[Change], covariance: impl Fn(usize, usize) -> f64) -> [f64; 2] {
    if let [only] = parameters {
        return [only.value, only.sd];
    }
    let own: Vec<usize> =
        (0..parameters.len()).filter(|&i| parameters[i].unit == parameters[0].unit).collect();
    let size = own.iter().map(|&i| parameters[i].value.powi(2)).sum::<f64>().sqrt();
    let part = |i: usize| parameters[i].value / size.max(f64::MIN_POSITIVE);
    let pairs = own.iter().flat_map(|&i| own.iter().map(move |&j| (i, j)));
    let variance: f64 = pairs.map(|(i, j)| part(i) * part(j) * covariance(i, j)).sum();
    [size, variance.max(0.0).sqrt()]
}

//! What has changed: named at once, and again when later rows tell.
//!
//! In the first rows of a change several names may fit: three sensors of an arm move one point.
//! All are estimated from then on, from the rows since the onset, as far as they are kept,
//! linearised about the estimate; [`super::open`] compares the names.

use nalgebra::{DMatrix, DVector};

use crate::model::Spec;
use crate::monitor::alarm::Alarm;
use crate::monitor::open::Open;
use crate::monitor::score::MOST_COLUMNS;
use crate::monitor::thresholds::log_tail;
use crate::monitor::watch::{Monitor, Tested};
use crate::monitor::watched::Watched;
use crate::monitor::windows::Sums;
use crate::numerics::lanes::WIDTH;

/// Changes fit as well where twice the logarithm of their probability differs by less.
const AS_WELL: f64 = 6.0;

/// Changes within this of the best, or within this share of it, are estimated beside it: more rows
/// may tell, and a large change looks different where it is linearised elsewhere.
const BESIDE: (f64, f64) = (20.0, 0.9);

/// Largest standard deviation beforehand, in typical sizes, of the parameters of a change that has
/// several: holds those that the readings cannot tell.
const TYPICAL: f64 = 3.0;

/// Linearisations about the estimate of a change.
const SETTLED: usize = 3;

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
    /// Names a change, and goes on with it.
    pub(super) fn raise(&mut self, crossed: Option<usize>, tested: Tested) {
        let mut before = None;
        let mut onsets: Vec<Option<usize>> = vec![None];
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
        if let Some(alarm) = self.name(&onsets, before.as_ref(), tested) {
            self.counts.alarms += 1;
            self.alarms.push(alarm);
        }
        self.restart();
        self.age = 0;
    }

    /// Begins with new windows.
    fn restart(&mut self) {
        self.windows.restart(self.watched.tested());
        self.whitening.interrupt();
    }

    fn name(
        &mut self,
        onsets: &[Option<usize>],
        before: Option<&Sums>,
        tested: Tested,
    ) -> Option<Alarm> {
        self.open = None;
        let suspects = self.suspects(onsets, before);
        let best = *suspects.first()?;
        let mut since = match best.onset {
            Some(kept) => self.windows.onset(kept).mark,
            None => before?.mark,
        };
        if before.is_some() {
            // The samples that waited are the first of the change.
            (since.row, since.time) = (self.waiting[0].row, self.waiting[0].time);
        }
        let behind = |s: &Suspect| 2.0 * (s.log_p - best.log_p);
        let limit = BESIDE.0.max(-2.0 * BESIDE.1 * best.log_p);
        let beside: Vec<Suspect> = suspects.into_iter().filter(|s| behind(s) < limit).collect();
        let as_well = beside[1..].iter().filter(|s| behind(s) < AS_WELL);
        let also_fits: Vec<Spec> = as_well.map(|s| self.spec(s.candidate)).collect();
        let mut open = self.take_over(&beside, before)?;
        open.alarm = Alarm {
            row: tested.row,
            time: tested.time,
            since_row: since.row,
            since: since.time,
            p_value: self.thresholds.p_value(best.rank, best.statistic, self.dof),
            also_fits,
            ..Alarm::default()
        };
        let alarm = self.alarm(&open, best.candidate, tested);
        open.alarm = alarm.clone();
        if open.suspects.len() > 1 {
            self.refit(&open, None, tested.row);
            self.open = Some(open);
        }
        Some(alarm)
    }

    fn spec(&self, candidate: usize) -> Spec {
        self.watched.candidates[candidate].spec.clone()
    }

    /// Corrects the name of the last change where later rows have told it.
    pub(super) fn look_again(&mut self, tested: Tested) {
        let Some(mut open) = self.open.take() else { return };
        self.refit(&open, None, tested.row);
        let Some(names) = open.evidence(&self.watched, &self.state) else { return };
        let [(best, candidate), (next, _), ..] = names[..] else { return };
        if best - next < AS_WELL {
            self.open = Some(open);
            return;
        }
        if candidate == open.suspects[0] {
            self.refit(&open, Some(candidate), tested.row);
            return;
        }
        let revises = Some(open.alarm.row);
        open.alarm.also_fits.clear();
        let alarm = self.alarm(&open, candidate, tested);
        self.alarms.push(Alarm { row: tested.row, time: tested.time, revises, ..alarm });
    }

    /// The alarm that names one of the suspects, which alone is then estimated.
    fn alarm(&mut self, open: &Open, candidate: usize, tested: Tested) -> Alarm {
        let columns = open.columns(&self.watched, candidate);
        let (first, width) = (columns.start, columns.len());
        let alone = if self.refit(open, Some(candidate), tested.row) {
            let (values, covariance) = open.difference(&self.watched, &self.state);
            let block = covariance.view((first, first), (width, width)).into_owned();
            Some((values.rows(first, width).into_owned(), block))
        } else {
            open.alone(&self.watched, &self.state, candidate)
        };
        let (values, covariance) =
            alone.unwrap_or((DVector::zeros(width), DMatrix::identity(width, width)));
        let covariance = covariance * self.scale;
        let named = &self.watched.candidates[candidate];
        let (parameters, [size, sd], unit) = named.changes(&values, &covariance);
        let mut after = open.was.clone();
        for (i, value) in columns.zip(&values) {
            let place = open.places[i];
            after[self.watched.order[place]] += value * self.watched.scale[place];
        }
        let platform_rms = self.seen.change(&self.watched, &self.sigma, &open.was, &after);
        let spec = self.spec(candidate);
        Alarm { spec, size, sd, unit, parameters, platform_rms, ..open.alarm.clone() }
    }

    /// Every candidate at its best onset, the least probable by chance first.
    fn suspects(&mut self, onsets: &[Option<usize>], before: Option<&Sums>) -> Vec<Suspect> {
        let mut all: Vec<Suspect> = Vec::new();
        for (number, candidate) in self.watched.candidates.iter().enumerate() {
            let mut best: Option<Suspect> = None;
            for &onset in onsets {
                let begin = match (onset, before) {
                    (Some(kept), _) => self.windows.onset(kept),
                    (None, Some(before)) => before,
                    (None, None) => continue,
                };
                let (statistic, rank) =
                    self.score.test(&candidate.columns, &self.state, &self.windows.now, begin);
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
        all
    }

    /// Puts the estimates of changes into the parameters, and their uncertainty into the state.
    fn take_over(&mut self, beside: &[Suspect], before: Option<&Sums>) -> Option<Open> {
        let (mut width, mut columns): (Vec<f64>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut suspects: Vec<usize> = Vec::new();
        let begin = match (beside.first()?.onset, before) {
            (Some(kept), _) => self.windows.onset(kept),
            (None, before) => before?,
        };
        for suspect in beside {
            let own = &self.watched.candidates[suspect.candidate].columns;
            if columns.len() + own.len() > MOST_COLUMNS {
                continue;
            }
            self.score.test(own, &self.state, &self.windows.now, begin);
            let ridge = if own.len() > 1 { TYPICAL.powi(-2) } else { 0.0 };
            let Some((theta, v)) = self.score.estimate(&vec![ridge; own.len()]) else { continue };
            let most = if own.len() > 1 { TYPICAL.powi(2) } else { f64::INFINITY };
            width.extend((0..own.len()).map(|i| theta[i].powi(2) + v[(i, i)].min(most)));
            columns.extend(own);
            suspects.push(suspect.candidate);
        }
        self.score.test(&columns, &self.state, &self.windows.now, begin);
        let precision: Vec<f64> = width.iter().map(|w| 1.0 / w).collect();
        let (theta, v) = self.score.estimate(&precision)?;
        let (m, q) = (self.state.size, columns.len());

        // Error of the calibration beside the changes: β - W θ, with W = J⁻¹ D_gz.
        let w = DMatrix::from_fn(m, q, |row, column| self.score.absorbed[column * m + row]);
        let beta = DMatrix::from_row_slice(m, 1, &self.state.mean) - &w * &theta;
        let old = DMatrix::from_row_slice(m, m, &self.state.covariance) + &w * &v * w.transpose();
        let mut joint = DMatrix::zeros(m + q, m + q);
        joint.view_mut((0, 0), (m, m)).copy_from(&old);
        joint.view_mut((0, m), (m, q)).copy_from(&(-&w * &v));
        joint.view_mut((m, 0), (q, m)).copy_from(&(-(&w * &v).transpose()));
        joint.view_mut((m, m), (q, q)).copy_from(&v);

        let Watched { order, scale, at, .. } = &mut self.watched;
        let mut was = at.clone();
        (0..m).for_each(|k| was[order[k]] += beta[k] * scale[k]);
        let model: Vec<usize> = columns.iter().map(|&z| order[z]).collect();
        for (i, &position) in columns.iter().enumerate() {
            at[order[position]] += theta[i] * scale[position];
        }
        // A change of a parameter that is uncertain adds to it; another one joins them.
        for &column in &model {
            let position = self.watched.order.iter().position(|&o| o == column)?;
            if position >= self.watched.uncertain {
                self.watched.join(position);
            }
        }
        let place = |column: &usize| self.watched.order.iter().position(|o| o == column);
        let places: Vec<usize> = model.iter().filter_map(place).collect();
        let size = self.watched.uncertain;
        let mut map = DMatrix::zeros(size, m + q);
        (0..m).for_each(|k| map[(k, k)] = 1.0);
        places.iter().enumerate().for_each(|(i, &p)| map[(p, m + i)] = 1.0);
        self.state.set(beta.as_slice(), &(&map * joint * map.transpose()));
        let mut known = DMatrix::zeros(size, size);
        known.view_mut((0, 0), (m, m)).copy_from(&old);
        Some(Open { suspects, places, width, was, known, alarm: Alarm::default() })
    }

    /// Estimates the suspects, or one of them, from the rows since the onset, linearised about the
    /// estimate; false where those rows are gone, and nothing was done.
    fn refit(&mut self, open: &Open, only: Option<usize>, last: u64) -> bool {
        let Some(rows) = self.recent.between(open.alarm.since_row, last) else { return false };
        let columns = match only {
            Some(candidate) => open.columns(&self.watched, candidate),
            None => 0..open.places.len(),
        };
        let prior = open.prior(columns);
        let width = self.watched.order.len();
        for _ in 0..SETTLED {
            let shift: Vec<f64> = (0..prior.nrows())
                .map(|k| (self.watched.order[k], self.watched.scale[k]))
                .map(|(column, scale)| (open.was[column] - self.watched.at[column]) / scale)
                .collect();
            self.state.set(&shift, &prior);
            self.whitening.interrupt();
            for block in rows.chunks(WIDTH) {
                (0..block.len()).for_each(|lane| self.again.put(lane, block[lane]));
                self.again.linearise(&self.watched);
                for lane in 0..block.len() {
                    self.again.read(lane, &self.watched, &mut self.r, &mut self.g);
                    self.whitening.filter(&mut self.r, &mut self.g);
                    self.state.compare(&self.r, &self.g, width);
                    self.state.absorb();
                }
            }
            for (k, mean) in self.state.mean.iter_mut().enumerate() {
                self.watched.at[self.watched.order[k]] += *mean * self.watched.scale[k];
                *mean = 0.0;
            }
        }
        self.restart();
        true
    }
}

//! Estimates of a change that is named: from sums, then again from the rows themselves.

use nalgebra::DMatrix;

use crate::monitor::alarm::Alarm;
use crate::monitor::drift::{Drift, sums_since};
use crate::monitor::open::{Kind, Kinds, Open, Rest, Suspected};
use crate::monitor::recent::{Kept, numbered};
use crate::monitor::score::MOST_COLUMNS;
use crate::monitor::suspects::Suspect;
use crate::monitor::unsteady::Unsteady;
use crate::monitor::watched::Watched;
use crate::monitor::watching::Monitor;
use crate::monitor::windows::{Mark, Sums};

/// Standard deviation of a change beforehand, in typical sizes.
pub(super) const TYPICAL: f64 = 3.0;

/// Standard deviation of a rate beforehand, in sizes of the change over the rows since its onset.
const FASTER: f64 = 3.0;

/// Linearisations about the estimate of a change.
const LINEARISATIONS: usize = 3;

impl Monitor {
    /// Puts the estimates of changes since an onset into the parameters, and their uncertainty into
    /// the state.
    pub(super) fn take_over(&mut self, beside: &[Suspect], begin: &Sums) -> Option<Open> {
        let since = begin.mark.row;
        let chosen = self.chosen(beside);
        self.count_from(since, &chosen);
        let drifts: Vec<&Drift> =
            chosen.iter().filter_map(|s| self.watched.drift(s.candidate)).collect();
        let (within, none) =
            (sums_since(&self.windows, begin, since, &drifts), Sums::new(begin.scores.len()));
        let rows = (within.mark.row - since).max(1) as f64;

        let (mut width, mut columns): (Vec<f64>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut suspects: Vec<Suspected> = Vec::new();
        for suspect in chosen {
            let candidate = &self.watched.candidates[suspect.candidate];
            let most: Vec<f64> = candidate.typical.iter().map(|t| (TYPICAL * t).powi(2)).collect();
            let known: Vec<f64> = most.iter().map(|m| 1.0 / m).collect();
            self.score.test(&candidate.columns, &self.state, &within, &none);
            let Some((theta, variance)) = self.score.estimate(&known) else { continue };
            width.extend(most.iter().zip(&theta).map(|(m, t)| m + t.powi(2)));
            columns.extend(&candidate.columns);
            if let Some(drift) = self.watched.drift(suspect.candidate) {
                let size = theta[0].powi(2) + variance[(0, 0)];
                width.push(FASTER.powi(2) * size / rows.powi(2));
                columns.push(drift.own);
            }
            suspects.push(suspect);
        }
        self.score.test(&columns, &self.state, &within, &none);
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
                self.score.turned.swap(position, self.watched.uncertain);
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
        let named = Kind { candidate: suspects.first()?.candidate, drifts: false }.into();
        let alarm = Alarm::default();
        Some(Open { suspects, named, places, width, was, known, alarm, left: None })
    }

    /// The suspects that are estimated together: as many as there is room for.
    fn chosen(&self, beside: &[Suspect]) -> Vec<Suspected> {
        let mut room = MOST_COLUMNS;
        let mut chosen = Vec::new();
        for suspect in beside {
            let candidate = &self.watched.candidates[suspect.candidate];
            let (columns, drifts) = (candidate.columns.len(), candidate.drift.is_some());
            if let Some(left) = room.checked_sub(columns + usize::from(drifts)) {
                room = left;
                chosen.push(Suspected { candidate: suspect.candidate, columns, drifts });
            }
        }
        chosen
    }

    /// Counts the parameters that may drift from where they are in the first row of a change.
    fn count_from(&mut self, since: u64, suspects: &[Suspected]) {
        for suspect in suspects {
            let Some(drift) = self.watched.candidates[suspect.candidate].drift else { continue };
            let Watched { at, order, drifts, .. } = &mut self.watched;
            let drift = &mut drifts[drift];
            self.windows.all_live();
            let Some(rows) = drift.age(since) else {
                drift.since = Some(since);
                continue;
            };
            drift.since = Some(since);
            at[order[drift.base]] += rows * at[order[drift.own]];
            self.state.move_on(drift.base, drift.own, rows);
        }
    }

    /// Estimates the suspects from the rows since the onset, linearised about the estimate of
    /// what is named alone; what that leaves of these rows. None where they are gone, and nothing was
    /// done.
    pub(super) fn refit(&mut self, open: &Open, kinds: Kinds, last: u64) -> Option<Rest> {
        let rows = self.recent.between(open.alarm.since_row, last)?;
        let alone = open.prior(open.all_columns(kinds));
        let mut rest = Rest::default();
        for _ in 0..LINEARISATIONS {
            rest = self.pass(open, &alone, &rows);
            for (k, mean) in self.state.mean.iter_mut().enumerate() {
                self.watched.at[self.watched.order[k]] += *mean * self.watched.scale[k];
                *mean = 0.0;
            }
        }
        self.pass(open, &open.prior(0..open.places.len()), &rows);
        self.restart();
        Some(rest)
    }

    /// The state after some rows, with this covariance before the change, and what it leaves of them.
    fn pass(&mut self, open: &Open, prior: &DMatrix<f64>, rows: &[Kept]) -> Rest {
        let width = self.watched.order.len();
        let mean: Vec<f64> = (0..prior.nrows()).map(|k| -open.moved(&self.watched, k)).collect();
        self.state.set(&mean, prior);
        let mut rest = Rest::default();
        let Self { again, watched, whitening, state, unsteady, whitener, .. } = self;
        let most = self.outside;
        whitening.interrupt();
        again.each(watched, &numbered(rows), |place, r, g| {
            whitener.row(watched, unsteady, self.scale, rows[place].0, r, g);
            whitening.filter(r, g);
            let squared = state.compare(r, g, width) / self.scale;
            rest.add(squared.min(most));
            state.absorb();
        });
        rest
    }

    /// Begins again with the rows since the onset of a change, from before it: with these suspects
    /// only. None where the rows are gone.
    pub(super) fn begin_again(
        &mut self,
        open: &Open,
        beside: &[Suspect],
        last: u64,
    ) -> Option<Open> {
        let rows = self.recent.between(open.alarm.since_row, last)?;
        let (first, time, _) = rows.first()?;
        self.watched.at.clone_from(&open.was);
        self.state.set(&[], &open.known);
        self.restart();
        let width = self.watched.order.len();
        let mut begin = Sums::new(width);
        begin.mark = Mark { samples: 0, row: *first, time: *time };
        (self.windows.now.mark, self.windows.began) = (begin.mark, *first);
        let Self { again, watched, whitening, state, unsteady, whitener, windows, .. } = self;
        again.each(watched, &numbered(&rows), |place, r, g| {
            let (row, time, _) = rows[place];
            whitener.row(watched, unsteady, self.scale, row, r, g);
            whitening.filter(r, g);
            state.compare(r, g, width);
            state.absorb();
            windows.add(r, g, row, time);
            windows.keep();
        });
        let found = self.take_over(beside, &begin)?;
        // The same rows again tell nothing new of what was before them.
        let (size, before) = (found.known.nrows(), open.known.nrows());
        let mut known = DMatrix::zeros(size, size);
        known.view_mut((0, 0), (before, before)).copy_from(&open.known);
        let (alarm, was) = (open.alarm.clone(), open.was.clone());
        Some(Open { alarm, was, known, ..found })
    }

    /// Takes the name of the last change for certain: nothing else has changed.
    pub(super) fn take_for_certain(&mut self) {
        if let Some(open) = self.open.take() {
            self.leave(&open, open.named);
        }
    }

    /// Goes on with one name only.
    pub(super) fn leave(&mut self, open: &Open, kinds: Kinds) {
        if let Some((mean, covariance)) = open.alone(&self.watched, &self.state, kinds) {
            let mean: Vec<f64> =
                mean.iter().enumerate().map(|(k, m)| m - open.moved(&self.watched, k)).collect();
            self.state.set(&mean, &covariance);
        }
    }

    /// Goes back to before a change.
    pub(super) fn go_back(&mut self, open: &Open) {
        self.watched.at.clone_from(&open.was);
        self.state.set(&[], &open.known);
        self.restart();
    }

    /// Goes on from before a change, with a place that is unsteady since then; false where the rows
    /// since its onset are gone, and nothing was done.
    pub(super) fn go_on_with(&mut self, open: &Open, own: Unsteady, last: u64) -> bool {
        let Some(rows) = self.recent.between(open.alarm.since_row, last) else { return false };
        self.watched.at.clone_from(&open.was);
        self.unsteady.push(own);
        self.pass(open, &open.known.clone(), &rows);
        self.restart();
        self.take_turned(last);
        true
    }
}

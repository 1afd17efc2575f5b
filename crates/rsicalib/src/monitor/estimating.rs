//! Estimates of a change that is named: from sums, then again from the rows themselves.

use nalgebra::DMatrix;

use crate::monitor::alarm::Alarm;
use crate::monitor::drift::{Drift, sums_since};
use crate::monitor::naming::Suspect;
use crate::monitor::open::{Kind, Open, Suspected};
use crate::monitor::recent::{Kept, numbered};
use crate::monitor::score::MOST_COLUMNS;
use crate::monitor::watch::Monitor;
use crate::monitor::watched::Watched;
use crate::monitor::windows::Sums;

/// Standard deviation of a change beforehand, in typical sizes.
const TYPICAL: f64 = 3.0;

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
        let named = Kind { candidate: suspects.first()?.candidate, drifts: false };
        Some(Open { suspects, named, places, width, was, known, alarm: Alarm::default() })
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
            let Some(rows) = drift.age(since) else {
                drift.since = Some(since);
                continue;
            };
            drift.since = Some(since);
            at[order[drift.base]] += rows * at[order[drift.own]];
            self.state.move_on(drift.base, drift.own, rows);
        }
    }

    /// Estimates the suspects from the rows since the onset, linearised about the estimate of one
    /// of them alone; false where those rows are gone, and nothing was done.
    pub(super) fn refit(&mut self, open: &Open, kind: Kind, last: u64) -> bool {
        let Some(rows) = self.recent.between(open.alarm.since_row, last) else { return false };
        let alone = open.prior(open.columns(kind));
        for _ in 0..LINEARISATIONS {
            self.pass(open, &alone, &rows);
            for (k, mean) in self.state.mean.iter_mut().enumerate() {
                self.watched.at[self.watched.order[k]] += *mean * self.watched.scale[k];
                *mean = 0.0;
            }
        }
        self.pass(open, &open.prior(0..open.places.len()), &rows);
        self.restart();
        true
    }

    /// The state after some rows, with this covariance before the change.
    fn pass(&mut self, open: &Open, prior: &DMatrix<f64>, rows: &[Kept]) {
        let width = self.watched.order.len();
        let mean: Vec<f64> = (0..prior.nrows()).map(|k| -open.moved(&self.watched, k)).collect();
        self.state.set(&mean, prior);
        let Self { again, watched, whitening, state, .. } = self;
        whitening.interrupt();
        again.each(watched, &numbered(rows), |_, r, g| {
            whitening.filter(r, g);
            state.compare(r, g, width);
            state.absorb();
        });
    }
}

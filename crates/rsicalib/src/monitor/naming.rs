//! What has changed: named at once, and again when later rows tell.
//!
//! In the first rows of a change several names may fit: three sensors of an arm move one point.
//! All are estimated together from then on, from the rows since the onset as long as these are
//! kept, linearised about the estimate of the best; [`super::open`] compares the names. A sensor or a
//! distance has a rate beside its step ([`super::drift`]), so what drifts is named once.

use nalgebra::{DMatrix, DVector};

use crate::model::Spec;
use crate::monitor::alarm::{Alarm, Change};
use crate::monitor::drift::{Drift, sums_since};
use crate::monitor::open::{Kind, Name, Open, Suspected};
use crate::monitor::score::MOST_COLUMNS;
use crate::monitor::recent::Kept;
use crate::monitor::thresholds::log_tail;
use crate::monitor::watch::{Monitor, Tested};
use crate::monitor::watched::Watched;
use crate::monitor::windows::Sums;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::lanes::WIDTH;

/// Changes within this of the best, or within this share of it, are estimated beside it: more rows
/// may tell, and a large change looks different where it is linearised elsewhere.
const BESIDE: (f64, f64) = (20.0, 0.9);

/// Standard deviation of a change beforehand, in typical sizes.
const TYPICAL: f64 = 3.0;

/// Samples after which a name is taken for certain.
const SETTLED_AT: u64 = 1 << 15;

/// Linearisations about the estimate of a change.
const SETTLED: usize = 3;

/// The best onset of a candidate.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    candidate: usize,
    onset: usize,
    statistic: f64,
    rank: usize,
    log_p: f64,
}

impl Monitor {
    /// Names a change, and goes on with it.
    pub(super) fn raise(&mut self, tested: Tested) {
        for place in &self.waiting[..std::mem::take(&mut self.held)] {
            self.state.compare(&place.r, &place.g, self.watched.order.len());
            self.state.absorb();
            self.counts.used += 1;
            self.windows.add(&place.r, &place.g, place.row, place.time);
        }
        if let Some(alarm) = self.name(tested) {
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

    fn name(&mut self, tested: Tested) -> Option<Alarm> {
        self.settle();
        let onsets = self.onsets(tested.row);
        let suspects = self.suspects(&onsets);
        let best = *suspects.first()?;
        let begin = &onsets[best.onset];
        let since = begin.mark;
        let behind = |s: &Suspect| 2.0 * (s.log_p - best.log_p);
        let limit = BESIDE.0.max(-2.0 * BESIDE.1 * best.log_p);
        let beside: Vec<Suspect> = suspects.into_iter().filter(|s| behind(s) < limit).collect();
        let mut open = self.take_over(&beside, begin)?;
        open.alarm = Alarm {
            row: tested.row,
            time: tested.time,
            since_row: since.row,
            since: since.time,
            p_value: self.thresholds.p_value(best.rank, best.statistic, self.dof),
            ..Alarm::default()
        };
        let names = self.compare(&open, tested.row);
        open.named = names.first().map_or(open.named, |name| name.kind);
        let alarm = self.alarm(&open, &names, tested);
        self.open = Some(open);
        Some(alarm)
    }

    /// Corrects the name of the last change where later rows have told it.
    pub(super) fn look_again(&mut self, tested: Tested) {
        let Some(mut open) = self.open.take() else { return };
        let names = self.compare(&open, tested.row);
        let of = |kind| names.iter().find(|n| n.kind == kind).copied();
        let (Some(best), Some(now)) = (names.first().copied(), of(open.named)) else { return };
        if best.evidence > now.evidence + AS_WELL {
            open.named = best.kind;
            let revises = Some(open.alarm.row);
            let alarm = self.alarm(&open, &names, tested);
            self.alarms.push(Alarm { row: tested.row, time: tested.time, revises, ..alarm });
        }
        let Kind { candidate, .. } = open.named;
        let other = |n: &&Name| n.kind.candidate != candidate;
        let excluded = |n: &Name| n.fit < now.fit - BESIDE.0;
        let alone = best.kind.candidate == candidate && names.iter().filter(other).all(excluded);
        self.open = Some(open);
        if self.age >= SETTLED_AT {
            self.settle();
        } else if alone {
            self.narrow(candidate);
        }
    }

    /// Takes the name of the last change for certain: nothing else has changed.
    fn settle(&mut self) {
        if let Some(open) = self.open.take() {
            self.leave(&open, open.named);
        }
    }

    /// Takes for certain what has changed, but not whether it drifts.
    fn narrow(&mut self, candidate: usize) {
        let Some(mut open) = self.open.take() else { return };
        let drifts = self.watched.drift(candidate).is_some();
        let widest = Kind { candidate, drifts };
        if drifts && open.suspects.len() > 1 {
            self.leave(&open, widest);
        }
        if !drifts {
            return self.leave(&open, widest);
        }
        let own = open.columns(widest);
        open.places = open.places[own.clone()].to_vec();
        open.width = open.width[own].to_vec();
        open.suspects.retain(|one| one.candidate == candidate);
        self.open = Some(open);
    }

    /// Goes on with one name only.
    fn leave(&mut self, open: &Open, kind: Kind) {
        if let Some((mean, covariance)) = open.alone(&self.watched, &self.state, kind) {
            let mean: Vec<f64> =
                mean.iter().enumerate().map(|(k, m)| m - open.moved(&self.watched, k)).collect();
            self.state.set(&mean, &covariance);
        }
    }

    /// Names by their evidence, the best first, linearised about the estimate of the best as long
    /// as the rows since the onset are there.
    fn compare(&mut self, open: &Open, last: u64) -> Vec<Name> {
        let mut names = self.names(open);
        for _ in 0..SETTLED {
            let Some(best) = names.first().map(|n| n.kind) else { break };
            if !self.refit(open, best, last) {
                break;
            }
            names = self.names(open);
            if names.first().is_some_and(|n| n.kind == best) {
                break;
            }
        }
        names
    }

    fn names(&self, open: &Open) -> Vec<Name> {
        let told = open.told(&self.watched, &self.state, self.scale);
        told.map_or(Vec::new(), |told| open.names(&told))
    }

    /// The alarm that says what is named in a row, and what the rows cannot tell from it.
    fn alarm(&self, open: &Open, names: &[Name], tested: Tested) -> Alarm {
        let watched = &self.watched;
        let places = &open.places[open.columns(open.named)];
        let n = self.state.size;
        let (mean, covariance) = open
            .alone(watched, &self.state, open.named)
            .unwrap_or((DVector::zeros(n), DMatrix::identity(n, n)));
        let mut values = DVector::from_fn(places.len(), |i, _| mean[places[i]]);
        let mut covariance = DMatrix::from_fn(places.len(), places.len(), |i, j| {
            covariance[(places[i], places[j])] * self.scale
        });
        // What drifts has no other way to begin with: it counts from where it was.
        let mut before = open.was.clone();
        let mut after = open.was.clone();
        for (&place, value) in places.iter().zip(&values) {
            after[watched.order[place]] += value * watched.scale[place];
        }
        let mut rate = None;
        if let (true, &[_, own]) = (open.named.drifts, &places[..]) {
            let column = watched.order[own];
            before[column] = 0.0;
            values[1] = after[column] / watched.scale[own];
            rate = Some(self.rate(open, values[1], covariance[(1, 1)].sqrt()));
            let age = tested.row as f64 - open.alarm.since_row as f64;
            let now = DMatrix::from_row_slice(1, 2, &[1.0, age]);
            (values, covariance) = (&now * values, &now * covariance * now.transpose());
        }
        let named = &watched.candidates[open.named.candidate];
        let (parameters, [size, sd], unit) = named.changes(&values, &covariance);
        let in_row = |at| watched.in_row(at, tested.row);
        let platform_rms =
            self.seen.change(watched, &self.sigma, &in_row(&before), &in_row(&after));
        let spec = |candidate: usize| watched.candidates[candidate].spec.clone();
        let now = names.iter().find(|n| n.kind == open.named);
        let mut also_fits: Vec<Spec> = Vec::new();
        for name in names.iter().filter(|n| n.kind.candidate != open.named.candidate) {
            let other = spec(name.kind.candidate);
            if now.is_some_and(|now| name.ties(now)) && !also_fits.contains(&other) {
                also_fits.push(other);
            }
        }
        let spec = spec(open.named.candidate);
        let alarm = open.alarm.clone();
        Alarm { spec, size, sd, unit, parameters, rate, platform_rms, also_fits, ..alarm }
    }

    /// A rate per row, in units of the named candidate, as an alarm has it.
    fn rate(&self, open: &Open, value: f64, sd: f64) -> Change {
        let named = &self.watched.candidates[open.named.candidate];
        let (name, unit) = &named.parameters[0];
        let (rows, per) = match self.order.interval {
            Some(interval) => (3600.0 / interval, "h"),
            None => (1.0, "row"),
        };
        let factor = named.scale[0] * rows;
        let unit = format!("{unit}/{per}");
        Change { name: (*name).into(), value: value * factor, sd: sd * factor, unit }
    }

    /// Every candidate at its best onset, the least probable by chance first.
    fn suspects(&mut self, onsets: &[Sums]) -> Vec<Suspect> {
        let mut all: Vec<Suspect> = Vec::new();
        for (number, candidate) in self.watched.candidates.iter().enumerate() {
            let mut best: Option<Suspect> = None;
            for (onset, begin) in onsets.iter().enumerate() {
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

    /// Puts the estimates of changes since an onset into the parameters, and their uncertainty into
    /// the state.
    fn take_over(&mut self, beside: &[Suspect], begin: &Sums) -> Option<Open> {
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
                // What goes on may have moved by as much since the onset as a step does at once.
                width.push((theta[0].powi(2) + variance[(0, 0)]) / rows.powi(2));
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
        let named = Kind { candidate: suspects[0].candidate, drifts: false };
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
    fn refit(&mut self, open: &Open, kind: Kind, last: u64) -> bool {
        let Some(rows) = self.recent.between(open.alarm.since_row, last) else { return false };
        let alone = open.prior(open.columns(kind));
        for _ in 0..SETTLED {
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
        self.whitening.interrupt();
        for block in rows.chunks(WIDTH) {
            for (lane, (.., readings)) in block.iter().enumerate() {
                self.again.put(lane, readings);
            }
            self.again.linearise(&self.watched, block[0].0);
            for (lane, (row, ..)) in block.iter().enumerate() {
                self.again.read(lane, &self.watched, *row, &mut self.r, &mut self.g);
                self.whitening.filter(&mut self.r, &mut self.g);
                self.state.compare(&self.r, &self.g, width);
                self.state.absorb();
            }
        }
    }
}

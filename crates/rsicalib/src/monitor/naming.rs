//! What has changed: named at once, and again when later rows tell.
//!
//! In the first rows of a change several names may fit: three sensors of an arm move one point.
//! All are estimated together from then on, from the rows since the onset as long as these are
//! kept, linearised about the estimate of the best; [`super::open`] compares the names. A sensor or a
//! distance has a rate beside its step ([`super::drift`]), so what drifts is named once.

use crate::monitor::alarm::Alarm;
use crate::monitor::open::{Kind, Name};
use crate::monitor::suspects::Suspect;
use crate::monitor::watching::{Monitor, Tested};
use crate::monitor::windows::Sums;
use crate::numerics::credible_set::AS_WELL;

/// Changes within this of the best, or within this share of it, are estimated beside it: more rows
/// may tell, and a large change looks different where it is linearised elsewhere.
const ESTIMATED_BESIDE: (f64, f64) = (20.0, 0.9);

/// Samples after which a name is taken for certain.
const CERTAIN_AFTER: u64 = 1 << 15;

impl Monitor {
    /// Names a change, or corrects the name of the last one, and goes on with it.
    pub(super) fn raise(&mut self, tested: Tested) {
        let broken = (std::mem::take(&mut self.held) > 0).then_some(self.waiting[0]);
        let before = broken.map(|_| self.state());
        if let Some(first) = broken {
            self.absorb_waiting(first, tested.row);
        }
        let mut corrected = self.correct(tested);
        let mut alarms = Vec::new();
        if corrected.is_empty() {
            alarms = self.name(tested, broken);
        }
        if let (Some(first), Some(before)) = (broken, before) {
            let said = if corrected.is_empty() { &alarms } else { &corrected };
            if let Some(found) = self.far(said, before, first, tested) {
                (corrected, alarms) = (Vec::new(), vec![found]);
            }
        }
        if corrected.is_empty() {
            self.counts.alarms += u64::from(!alarms.is_empty());
            match self.too_many(tested, &alarms) {
                Some(alarm) => self.alarms.push(alarm),
                None => self.alarms.extend(alarms),
            }
        }
        self.alarms.extend(corrected);
        self.restart();
        self.age = 0;
    }

    /// Where a test exceeds its threshold soon after a change: the lines that say that this was
    /// another one than was named.
    fn correct(&mut self, tested: Tested) -> Vec<Alarm> {
        if self.open.is_none() {
            return Vec::new();
        }
        let before = self.state();
        let corrected = self.corrected(tested);
        if corrected.is_empty() {
            // The next change is named as if nothing had been tried: these bytes are of this watch.
            let _same = self.restore(before);
        }
        corrected
    }

    fn corrected(&mut self, tested: Tested) -> Vec<Alarm> {
        let Some(open) = self.open.take() else { return Vec::new() };
        let mut open = self.refreshed(open, tested.row);
        let (names, rest) = self.compare(&mut open, tested.row);
        let revises = Some(open.alarm.row);
        let corrected = self.reconsider(&open, &names, rest, tested, revises);
        if let Some(corrected) = corrected {
            return corrected;
        }
        // Two in one row that leave nothing of it are no third change.
        let best = names.first().filter(|name| name.kinds.second.is_some());
        let explained = rest.is_some_and(|rest| !self.leaves(rest.squares, rest.rows));
        let mut corrected = Vec::new();
        if let Some(best) = best.filter(|best| explained && best.kinds != open.named) {
            open.named = best.kinds;
            corrected = self.alarms_of(&open, &names, tested, revises);
        }
        self.open = Some(open);
        corrected
    }

    /// Takes over the samples that waited, from the row `first` on. Each was filtered as if those
    /// before it were bad readings; now they are its neighbours. The first has none: the row before
    /// it lacks the change, and the filtered `G` is that of a change that both have.
    fn absorb_waiting(&mut self, first: u64, last: u64) {
        for (row, time, r, g) in self.filtered(first, last, Some(first)) {
            self.state.compare(&r, &g, self.watched.order.len());
            self.state.absorb();
            self.counts.used += 1;
            self.windows.add(&r, &g, row, time);
        }
    }

    fn name(&mut self, tested: Tested, broken: Option<u64>) -> Vec<Alarm> {
        self.take_for_certain();
        let mut onsets = self.onsets(tested.row, broken);
        if let Some(first) = broken {
            // What is far outside began with the first row that is.
            let begins = |onset: &Sums| onset.mark.row == first;
            if onsets.iter().any(begins) {
                onsets.retain(begins);
            }
        }
        let suspects = self.suspects(&onsets);
        let Some(best) = suspects.first().copied() else { return Vec::new() };
        let begin = &onsets[best.onset];
        let since = begin.mark;
        let behind = |s: &Suspect| 2.0 * (s.log_p - best.log_p);
        let limit = ESTIMATED_BESIDE.0.max(-2.0 * ESTIMATED_BESIDE.1 * best.log_p);
        let beside: Vec<Suspect> = suspects.into_iter().filter(|s| behind(s) < limit).collect();
        let Some(mut open) = self.take_over(&beside, begin) else { return Vec::new() };
        open.alarm = Alarm {
            row: tested.row,
            time: tested.time,
            since_row: since.row,
            since: since.time.unwrap_or(since.row as f64),
            p_value: self.thresholds.p_value(best.rank, best.statistic, self.values()),
            ..Alarm::default()
        };
        let (names, rest) = self.compare(&mut open, tested.row);
        open.named = names.first().map_or(open.named, |name| name.kinds);
        if let Some(alarms) = self.reconsider(&open, &names, rest, tested, None) {
            return alarms;
        }
        let alarms = self.alarms_of(&open, &names, tested, None);
        self.open = Some(open);
        alarms
    }

    /// Corrects the name of the last change where later rows have told it.
    pub(super) fn look_again(&mut self, tested: Tested) {
        let Some(open) = self.open.take() else { return };
        let mut open = self.refreshed(open, tested.row);
        let (names, rest) = self.compare(&mut open, tested.row);
        let revises = Some(open.alarm.row);
        if let Some(alarms) = self.reconsider(&open, &names, rest, tested, revises) {
            return self.alarms.extend(alarms);
        }
        let of = |kinds| names.iter().find(|n| n.kinds == kinds).copied();
        let (Some(best), Some(now)) = (names.first().copied(), of(open.named)) else { return };
        if best.evidence > now.evidence + AS_WELL {
            open.named = best.kinds;
            self.alarms.extend(self.alarms_of(&open, &names, tested, revises));
        }
        let named = open.named;
        let other = |n: &&Name| !n.kinds.has(named.first.candidate);
        let excluded = |n: &Name| n.fit < now.fit - ESTIMATED_BESIDE.0;
        let narrow = named.second.is_none()
            && best.kinds.first.candidate == named.first.candidate
            && best.kinds.second.is_none();
        // A second change beside the named one always fits better.
        let alone = narrow && names.iter().filter(other).all(excluded);
        self.open = Some(open);
        if self.age >= CERTAIN_AFTER {
            self.take_for_certain();
        } else if alone {
            self.narrow(named.first.candidate);
        }
    }

    /// Takes for certain what has changed, but not whether it drifts.
    fn narrow(&mut self, candidate: usize) {
        let Some(mut open) = self.open.take() else { return };
        let drifts = self.watched.drift(candidate).is_some();
        let widest = Kind { candidate, drifts };
        if drifts && open.suspects.len() > 1 {
            self.leave(&open, widest.into());
        }
        if !drifts {
            return self.leave(&open, widest.into());
        }
        let own = open.columns(widest);
        open.places = open.places[own.clone()].to_vec();
        open.width = open.width[own].to_vec();
        open.suspects.retain(|one| one.candidate == candidate);
        self.open = Some(open);
    }
}

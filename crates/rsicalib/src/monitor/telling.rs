//! The alarm that says what has changed, from the estimates.

use nalgebra::{DMatrix, DVector};

use crate::apply::change::PlatformRms;
use crate::model::Spec;
use crate::monitor::alarm::{Action, Alarm, Change};
use crate::monitor::open::{Kind, Name, Open};
use crate::monitor::watching::{Monitor, Tested};

impl Monitor {
    /// The alarms that say what is named in a row, and what the rows cannot tell from it: of two changes
    /// the first takes the place of the one that is corrected.
    pub(super) fn alarms_of(
        &self,
        open: &Open,
        names: &[Name],
        tested: Tested,
        revises: Option<u64>,
    ) -> Vec<Alarm> {
        let now = (tested.row, tested.time);
        let told = open.named.each().map(|kind| self.alarm(open, kind, names, tested));
        told.map(|alarm| Alarm { row: now.0, time: now.1, revises, ..alarm }).collect()
    }

    fn alarm(&self, open: &Open, kind: Kind, names: &[Name], tested: Tested) -> Alarm {
        let watched = &self.watched;
        let places = &open.places[open.columns(kind)];
        let (mean, covariance) =
            open.alone(watched, &self.state, open.named).unwrap_or_else(|| self.state.all());
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
        if let (true, &[_, own]) = (kind.drifts, places) {
            let column = watched.order[own];
            before[column] = 0.0;
            values[1] = after[column] / watched.scale[own];
            rate = Some(self.rate_of(kind, values[1], covariance[(1, 1)].sqrt()));
            let age = tested.row as f64 - open.alarm.since_row as f64;
            let now = DMatrix::from_row_slice(1, 2, &[1.0, age]);
            (values, covariance) = (&now * values, &now * covariance * now.transpose());
        }
        let named = &watched.candidates[kind.candidate];
        let (parameters, [size, sd], unit) = named.changes(&values, &covariance);
        let in_row = |at| watched.in_row(at, tested.row);
        let noise = &watched.under.noise;
        let platform_rms = self.seen.change(watched, noise, &in_row(&before), &in_row(&after));
        let least = self.seen.noise(watched, noise, &in_row(&before));
        let small = |own: &PlatformRms, least: &PlatformRms| {
            own.position < least.position && own.orientation < least.orientation
        };
        let small = platform_rms.as_ref().zip(least.as_ref()).is_some_and(|(a, b)| small(a, b));
        let action = match small && rate.is_none() {
            true => Action::GoOn,
            false => Action::Recalibrate,
        };
        let spec = |candidate: usize| watched.candidates[candidate].spec.clone();
        let now = names.iter().find(|n| n.kinds == open.named);
        let mut also_fits: Vec<Spec> = Vec::new();
        for name in names.iter().filter(|name| now.is_some_and(|now| name.ties(now))) {
            for other in name.kinds.each().filter(|k| !open.named.has(k.candidate)) {
                let other = spec(other.candidate);
                if !also_fits.contains(&other) {
                    also_fits.push(other);
                }
            }
        }
        let spec = spec(kind.candidate);
        let alarm = open.alarm.clone();
        Alarm { spec, size, sd, unit, parameters, rate, platform_rms, also_fits, action, ..alarm }
    }

    /// A rate per row, in units of the named candidate, as an alarm has it.
    fn rate_of(&self, kind: Kind, value: f64, sd: f64) -> Change {
        let named = &self.watched.candidates[kind.candidate];
        let (name, unit) = &named.parameters[0];
        let (rows, per) = match self.order.interval {
            Some(interval) => (3600.0 / interval, "h"),
            None => (1.0, "row"),
        };
        let factor = named.scale[0] * rows;
        let unit = format!("{unit}/{per}");
        Change { name: (*name).into(), value: value * factor, sd: sd * factor, unit }
    }
}

//! The alarm that says what has changed, from the estimates.

use nalgebra::{DMatrix, DVector};

use crate::model::Spec;
use crate::monitor::alarm::{Alarm, Change};
use crate::monitor::open::{Name, Open};
use crate::monitor::watch::{Monitor, Tested};

impl Monitor {
    /// The alarm that says what is named in a row, and what the rows cannot tell from it.
    pub(super) fn alarm(&self, open: &Open, names: &[Name], tested: Tested) -> Alarm {
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
        if let (true, &[_, own]) = (open.named.drifts, places) {
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
            self.seen.change(watched, &watched.under.noise, &in_row(&before), &in_row(&after));
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
}

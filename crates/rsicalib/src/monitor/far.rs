//! A change that is farther than a linearisation reaches: a coupling that slipped by a quarter of a turn, an encoder that
//! lost its reference, a plug that was pulled, cables that were exchanged.
//!
//! About the calibration such rows are linearised at the wrong place, and what is estimated there is nonsense. Of each
//! joint that turns all angles of a turn are tried in place of its offset. Where the best leaves no more of the rows far
//! outside than chance it is the change, and the watch goes on from there. Where one joint alone explains every row by another angle, its readings are wrong;
//! else what happened has no name. Then nothing is tested until the loops close again.

use nalgebra::DMatrix;

use crate::model::Spec;
use crate::monitor::alarm::{Action, Alarm, Change, Unnamed};
use crate::monitor::any_angle::{Turned, nearest_turn};
use crate::monitor::recent::{Kept, numbered};
use crate::monitor::thresholds::log_tail;
use crate::monitor::watching::{CONFIRMED, Monitor, Tested};
use crate::monitor::weighing::{ALL, UNNAMED};
use crate::numerics::lanes::WIDTH;
use crate::numerics::order;

/// Angle (rad) from which linearised estimates are off by a fortieth: a change by less is named by these.
pub(super) const LINEAR: f64 = 0.05;

/// Typical sizes beyond which a linearised change is not believed by itself.
const FAR: f64 = 10.0;

impl Monitor {
    /// The alarm of what is far off, from the row `first` on, in place of those that are `said` of it. None where these
    /// stand, and nothing was done; `before` is the state without these rows.
    pub(super) fn far(
        &mut self,
        said: &[Alarm],
        before: Vec<u8>,
        first: u64,
        tested: Tested,
    ) -> Option<Alarm> {
        let rows = self.recent.between(first, tested.row)?;
        let (far, named) =
            (said.iter().any(|alarm| self.is_far(alarm)), self.names_all(said, tested.row));
        if !far && named {
            return None;
        }
        let now = self.state();
        let _same = self.restore(before);
        self.take_for_certain();
        let found = self.turned(&rows, tested).or_else(|| {
            let alone = if far { self.alone(&rows) } else { Vec::new() };
            (far && !(named && alone.is_empty())).then(|| self.lost(&rows, &alone, first, tested))
        });
        if found.is_none() {
            let _same = self.restore(now);
        }
        found
    }

    /// The alarm of a joint that has turned, where that explains these rows.
    fn turned(&mut self, rows: &[Kept], tested: Tested) -> Option<Alarm> {
        let dof = (rows.len() * self.r.len()) as f64;
        let mut turned: Vec<Turned> =
            self.watched.turning().into_iter().map(|k| self.turn(k, rows)).collect();
        turned.retain(|one| !self.leaves_of(one.squares, dof - 1.0));
        order::ascending(&mut turned, |a| a.squares);
        let best = *turned.first()?;
        let as_well = turned[1..].iter();
        let as_well =
            as_well.map(|one| self.watched.candidates[one.candidate].spec.clone()).collect();
        Some(self.jumped(best, as_well, rows, tested))
    }

    /// The alarm of what is far off and has no such name; some joints may each explain it `alone`. From now on nothing is
    /// tested until loops close again.
    fn lost(
        &mut self,
        rows: &[Kept],
        alone: &[(f64, f64, usize)],
        first: u64,
        tested: Tested,
    ) -> Alarm {
        self.out = Some(0);
        let began = self.began(first, tested);
        let mut spec = Spec { term: UNNAMED.into(), target: Some(ALL.into()), place: None };
        let unit = self.watched.under.model.mechanism.length_unit.clone();
        let mut found = Alarm {
            action: Action::Stop,
            size: self.misclosure(rows),
            unit,
            unnamed: Some(Unnamed::FarOff),
            ..began
        };
        let mut named = alone.iter().filter_map(|(_, size, candidate)| {
            let place = self.watched.places.iter().find(|p| p.candidate == *candidate)?;
            let own =
                Spec { term: place.term.into(), target: Some(place.target.clone()), place: None };
            Some((own, *size, place.unit.clone()))
        });
        if let Some((own, size, unit)) = named.next() {
            let sd = size / (2.0 * rows.len() as f64).sqrt();
            let change = Change { name: "noise".into(), value: size, sd, unit: unit.clone() };
            (spec, found.size, found.sd, found.unit) = (own, size, sd, unit);
            found.unnamed = None;
            found.parameters = vec![change];
            found.also_fits = named.map(|(own, ..)| own).collect();
        }
        self.open = None;
        Alarm { spec, ..found }
    }

    /// Misclosure of some rows, root mean square [length unit].
    fn misclosure(&mut self, rows: &[Kept]) -> f64 {
        let lengths = self.watched.under.model.lengths();
        let mut squares = 0.0;
        for part in rows.chunks(WIDTH) {
            part.iter().enumerate().for_each(|(lane, row)| self.again.put(lane, &row.2));
            squares += self.again.misclosure(&self.watched, &lengths, part.len());
        }
        (squares / (rows.len() * lengths.len()).max(1) as f64).sqrt()
    }

    /// True while what happened is not named; tested again once loops have closed in as many rows as confirm a change.
    pub(super) fn is_out(&mut self, row: u64) -> bool {
        let Some(closed) = self.out else { return false };
        let width = self.watched.order.len();
        self.whitening.interrupt();
        let squared = self.state.compare(&self.r, &self.g, width) / self.scale;
        if squared > self.outside {
            self.out = Some(0);
            return true;
        }
        self.out = Some(closed + 1);
        if closed + 1 < CONFIRMED as u64 {
            return true;
        }
        self.out = None;
        self.windows.now.mark.row = row;
        self.restart();
        self.age = 0;
        false
    }

    /// True where alarms leave no more of the rows that raised them than chance, and have fewer numbers than these have
    /// equations.
    fn names_all(&mut self, alarms: &[Alarm], last: u64) -> bool {
        let numbers: usize = alarms.iter().map(|alarm| alarm.parameters.len()).sum();
        let Some(open) = self.open.take() else { return true };
        let known = open.left.filter(|left| left.kinds == open.named && left.last == last);
        let rest = match known {
            Some(left) => Some(left.rest),
            None => self.refit(&open, open.named, last),
        };
        self.open = Some(open);
        let left = rest.is_none_or(|rest| self.leaves(rest.squares, rest.rows));
        numbers < CONFIRMED * self.r.len() && !left
    }

    /// Joints that each explain all of some rows by themselves, by another angle in each: what they leave, the root mean
    /// square of the angles, and the candidate.
    fn alone(&mut self, rows: &[Kept]) -> Vec<(f64, f64, usize)> {
        let dof = (rows.len() * self.r.len().saturating_sub(1)) as f64;
        let mut found = Vec::new();
        for candidate in self.watched.turning() {
            let each: Vec<Turned> =
                rows.iter().map(|row| self.turn(candidate, std::slice::from_ref(row))).collect();
            let squares = each.iter().map(|one| one.squares).sum::<f64>();
            let size = each.iter().map(|one| one.shift.powi(2)).sum::<f64>() / rows.len() as f64;
            if dof > 0.0 && !self.leaves_of(squares, dof) {
                found.push((squares, size.sqrt(), candidate));
            }
        }
        order::ascending(&mut found, |a| a.0);
        found
    }

    /// True for a joint that has turned farther than a linearisation reaches, unless another change of its sensor fits as
    /// well, which later rows tell; and for a change of many times the typical size.
    fn is_far(&self, alarm: &Alarm) -> bool {
        let mut candidates = self.watched.candidates.iter();
        candidates.find(|candidate| candidate.spec == alarm.spec).is_some_and(|own| {
            let typical = own.typical.iter().zip(&own.scale).map(|(typical, unit)| typical * unit);
            let tied = alarm.also_fits.iter().any(|other| other.target == alarm.spec.target);
            let turned = own.turns && !tied;
            let most = typical.map(|typical| if turned { LINEAR } else { FAR * typical });
            let near = |(change, most): (&Change, f64)| change.value.abs() <= most;
            !alarm.parameters.iter().zip(most).all(near)
        })
    }

    /// The angle by which a joint explains rows best.
    fn turn(&mut self, candidate: usize, rows: &[Kept]) -> Turned {
        let position = self.watched.candidates[candidate].columns[0];
        let column = self.watched.order[position];
        let (was, step) = (self.watched.at[column], self.watched.scale[position]);
        let mut at = |shift: f64| {
            self.watched.at[column] = was + shift;
            self.squares_of(rows)
        };
        let (_, shift) = nearest_turn(&mut at);
        let turned = Turned::at(candidate, shift, &mut at, step);
        self.watched.at[column] = was;
        turned
    }

    /// What rows leave about the present parameters, as they are known before these rows.
    fn squares_of(&mut self, rows: &[Kept]) -> f64 {
        let width = self.watched.order.len();
        let state = self.state.clone();
        let mut squares = 0.0;
        let Self { again, watched, whitening, state: own, unsteady, whitener, scale, .. } = self;
        whitening.interrupt();
        again.each(watched, &numbered(rows), |place, r, g| {
            whitener.row(watched, unsteady, *scale, rows[place].0, r, g);
            whitening.filter(r, g);
            squares += own.compare(r, g, width) / *scale;
            own.absorb();
        });
        self.state = state;
        squares
    }

    /// Goes on from the angle to which a joint has turned, and says so.
    fn jumped(
        &mut self,
        best: Turned,
        also_fits: Vec<Spec>,
        rows: &[Kept],
        tested: Tested,
    ) -> Alarm {
        let named = self.watched.candidates[best.candidate].clone();
        let position = named.columns[0];
        let before = self.watched.at.clone();
        if position >= self.watched.uncertain {
            self.score.turned.swap(position, self.watched.uncertain);
            self.watched.join(position);
        }
        let (known, size) = (self.state.size, self.watched.uncertain);
        let mut covariance = DMatrix::zeros(size, size);
        let own = DMatrix::from_row_slice(known, known, &self.state.covariance);
        covariance.view_mut((0, 0), (known, known)).copy_from(&own);
        best.go_on(&mut self.watched, covariance.as_mut_slice());
        let mean = self.state.mean.clone();
        self.state.set(&mean, &covariance);
        let watched = &self.watched;
        let noise = &watched.under.noise;
        let in_row = |at: &[f64]| watched.in_row(at, tested.row);
        let platform_rms = self.seen.change(watched, noise, &in_row(&before), &in_row(&watched.at));
        let (name, unit) = &named.parameters[0];
        let change =
            Change { name: (*name).into(), value: best.shift, sd: best.sd, unit: unit.clone() };
        let first = rows.first().map_or(tested.row, |row| row.0);
        self.open = None;
        Alarm {
            spec: named.spec,
            size: best.shift,
            sd: best.sd,
            unit: unit.clone(),
            parameters: vec![change],
            platform_rms,
            also_fits,
            ..self.began(first, tested)
        }
    }

    /// An alarm of rows that are far outside from the row `first` on.
    fn began(&self, first: u64, tested: Tested) -> Alarm {
        let since = self.recent.time_of(first).unwrap_or(first as f64);
        // No sample of so many is as far outside by chance.
        let p_value =
            self.rate.min(f64::MIN_POSITIVE.max(log_tail(self.outside, self.r.len() as f64).exp()));
        Alarm {
            row: tested.row,
            time: tested.time,
            since_row: first,
            since,
            p_value,
            ..Alarm::default()
        }
    }
}

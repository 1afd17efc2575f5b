//! What one change does not explain: two in one row, something unsteady, or nothing that has a name.
//!
//! Where the change that is named leaves more of its own rows than a sound device would, once in as many
//! samples as there is a false alarm, others are weighed on these rows by the evidence: each pair of
//! candidates, and what has another size in every row, (134). One of them is named if it leaves no
//! more than chance.
//!
//! A channel that repeats its reading, while others move, for longer than chance allows as often is
//! stuck where the rows speak against this channel: with the evidence of what its offset or its noise
//! explains, and that of the run, the best.
//!
//! Alarms that follow each other faster than false ones may are one change without a name: with
//! `n` more alarms in `t` rows after one of them, where `P(Poisson(α t) ≥ n) < α`, the watch says so
//! once, says where, and is silent from then on.

use crate::model::Spec;
use crate::monitor::alarm::{Action, Alarm, Change, Unnamed};
use crate::monitor::estimating::TYPICAL;
use crate::monitor::open::{Name, Open, Rest};
use crate::monitor::recent::Linearised;
use crate::monitor::state::State;
use crate::monitor::suspects::Suspect;
use crate::monitor::thresholds::log_tail;
use crate::monitor::unsteady::{Found, NOISE, STUCK, Unsteady};
use crate::monitor::watching::{Monitor, Tested};
use crate::monitor::windows::Sums;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::distributions::poisson_tail;
use crate::numerics::order;
use crate::numerics::order::Ends;

/// Candidates and pairs within this of the best are estimated together: where a change is large, it
/// looks different about its estimate.
const ESTIMATED_TOGETHER: f64 = 40.0;

/// Term of a change that has no name, and place of what is nowhere in particular.
pub(super) const UNNAMED: &str = "unnamed";
pub(super) const ALL: &str = "all";

/// Alarms among which those that follow too fast are looked for.
const LATELY: usize = 8;

/// What explains the rows since an onset better than the change that was named.
enum Better {
    /// Candidates of the best pair, and of others that fit nearly as well.
    Pair(Vec<usize>),
    Unsteady(usize, Found),
    Stuck(usize, f64),
}

impl Monitor {
    /// Looks at an open name again where more has happened than it explains: the lines that say
    /// so. None where it explains them, and nothing was done.
    pub(super) fn reconsider(
        &mut self,
        open: &Open,
        names: &[Name],
        rest: Option<Rest>,
        tested: Tested,
        revises: Option<u64>,
    ) -> Option<Vec<Alarm>> {
        match self.better(open, names, rest, tested.row)? {
            Better::Pair(candidates) => self.pair(open, &candidates, tested, revises),
            Better::Unsteady(place, found) => {
                let own = Unsteady::new(place, found, open.alarm.since_row);
                let alarm = self.unsteady_alarm(open, own, found.evidence);
                let alarm = Alarm { row: tested.row, time: tested.time, revises, ..alarm };
                self.go_on_with(open, own, tested.row).then(|| vec![alarm])
            }
            Better::Stuck(place, evidence) => {
                let channel = self.watched.places[place].channel.unwrap_or_default();
                let (began, _) = self.runs.of(channel);
                let alarm = self.stuck_alarm(open, channel, began, evidence, tested);
                self.go_back(open);
                self.stuck.push(channel);
                Some(vec![Alarm { row: tested.row, time: tested.time, revises, ..alarm }])
            }
        }
    }

    /// An open change with the candidates that all rows since its onset speak for, those of the likeliest
    /// pairs among them, before those that it had: what goes on is told by neither steps nor pairs of
    /// them. As it was where these rows are gone.
    pub(super) fn refreshed(&mut self, open: Open, last: u64) -> Open {
        let rows = self.rows_of(&open, last);
        if rows.is_empty() {
            return open;
        }
        let ranked = self.singles_and_pairs(&open, &rows);
        let best = ranked.first().map_or(0.0, |best| best.1);
        let near = ranked.iter().filter(|(_, evidence, _)| *evidence > best - ESTIMATED_TOGETHER);
        let near = near.flat_map(|(candidates, ..)| candidates.iter().copied());
        let named = open.named.each().map(|kind| kind.candidate);
        let before = open.suspects.iter().map(|one| one.candidate);
        let mut chosen: Vec<usize> = Vec::new();
        for candidate in named.chain(near).chain(before) {
            if !chosen.contains(&candidate) {
                chosen.push(candidate);
            }
        }
        let beside: Vec<Suspect> = chosen.into_iter().map(Suspect::of).collect();
        match self.begin_again(&open, &beside, last) {
            Some(again) => Open { named: open.named, ..again },
            None => open,
        }
    }

    /// The rows since the onset of a change, about what was before it; none where they are gone.
    fn rows_of(&mut self, open: &Open, last: u64) -> Vec<Linearised> {
        let since = open.alarm.since_row;
        let before = std::mem::replace(&mut self.watched.at, open.was.clone());
        let rows = self.filtered(since, last, Some(since));
        self.watched.at = before;
        rows
    }

    fn pair(
        &mut self,
        open: &Open,
        candidates: &[usize],
        tested: Tested,
        revises: Option<u64>,
    ) -> Option<Vec<Alarm>> {
        let beside: Vec<Suspect> = candidates.iter().map(|&k| Suspect::of(k)).collect();
        let mut pair = self.begin_again(open, &beside, tested.row)?;
        let (names, _) = self.compare(&mut pair, tested.row);
        pair.named = names.first().map_or(pair.named, |name| name.kinds);
        let alarms = self.alarms_of(&pair, &names, tested, revises);
        self.open = Some(pair);
        Some(alarms)
    }

    /// True where a change leaves more of its rows than chance does.
    pub(super) fn leaves(&self, squares: f64, rows: f64) -> bool {
        self.leaves_of(squares, rows * self.r.len() as f64)
    }

    /// True where more is left than chance leaves, with so many degrees of freedom.
    pub(super) fn leaves_of(&self, squares: f64, dof: f64) -> bool {
        let spread = self.spread.max(1.0);
        dof > 0.0 && log_tail(squares / spread, dof / spread) < self.rate.ln()
    }

    fn better(
        &mut self,
        open: &Open,
        names: &[Name],
        rest: Option<Rest>,
        last: u64,
    ) -> Option<Better> {
        let named = names.first()?;
        let left = rest.is_some_and(|rest| self.leaves(rest.squares, rest.rows));
        let stuck = self.long_run(open.alarm.since_row);
        if !left && stuck.is_none() {
            return None;
        }
        let told = open.told(&self.watched, &self.state, self.scale)?;
        let unchanged = open.unchanged(&told);
        let rows = self.rows_of(open, last);
        if rows.is_empty() {
            return None;
        }
        let unsteady: Vec<Option<Found>> = self
            .watched
            .places
            .iter()
            .map(|place| self.watched.unsteady(place, &rows, self.scale))
            .collect();
        if let Some((place, chance)) = stuck {
            let channel = self.watched.places[place].channel;
            let target = self.target_of(place);
            let of_channel = |name: &&Name| {
                name.kinds.second.is_none()
                    && self.watched.candidates[name.kinds.first.candidate].spec.target == target
            };
            let noise = unsteady[place].map(|found| found.evidence);
            let own = names.iter().find(of_channel).map(|name| name.evidence - unchanged);
            let others = names.iter().find(|name| !of_channel(name));
            let other = others.map_or(0.0, |name| name.evidence - unchanged);
            let evidence = own.into_iter().chain(noise).fold(f64::NEG_INFINITY, f64::max);
            let evidence = evidence - 2.0 * chance;
            if channel.is_some() && evidence > other {
                return Some(Better::Stuck(place, evidence));
            }
        }
        if !left {
            return None;
        }
        let as_it_is = named.evidence - unchanged + AS_WELL;
        let count = rows.len() as f64;
        let loud = unsteady.into_iter().enumerate().filter_map(|(place, found)| {
            let found = found?;
            (!self.leaves(found.rest, count)).then_some((place, found))
        });
        let loud = loud.greatest_by(|a| a.1.evidence);
        let ranked = self.singles_and_pairs(open, &rows);
        let pairs: Vec<_> = ranked
            .into_iter()
            .filter(|(found, _, rest)| found.len() > 1 && !self.leaves(*rest, count))
            .collect();
        let pair = pairs.first().map(|(_, evidence, _)| *evidence);
        let loudest = loud.map(|(_, found)| found.evidence);
        if pair.into_iter().chain(loudest).all(|evidence| evidence <= as_it_is) {
            return None;
        }
        if let Some((place, found)) = loud.filter(|(_, found)| Some(found.evidence) > pair) {
            return Some(Better::Unsteady(place, found));
        }
        let mut chosen: Vec<usize> = Vec::new();
        let near =
            pairs.iter().filter(|(_, evidence, _)| Some(evidence + ESTIMATED_TOGETHER) > pair);
        for candidate in near.flat_map(|(candidates, ..)| candidates) {
            if !chosen.contains(candidate) {
                chosen.push(*candidate);
            }
        }
        Some(Better::Pair(chosen))
    }

    fn target_of(&self, place: usize) -> Option<String> {
        Some(self.watched.places[place].target.clone())
    }

    /// The channel that has repeated its reading for longer than chance allows, as a place, with the
    /// logarithm of that chance; its run may have begun a little after the onset.
    pub(super) fn long_run(&self, since: u64) -> Option<(usize, f64)> {
        let places = self.watched.places.iter().enumerate();
        let runs = places.filter_map(|(place, own)| {
            let (began, chance) = self.runs.of(own.channel?);
            let rare = chance < (self.rate / self.watched.places.len() as f64).ln();
            (rare && began <= since + self.runs.rows(own.channel?)).then_some((place, chance))
        });
        runs.least_by(|a| a.1)
    }

    /// Candidates and pairs of them, with the evidence of rows against a sound device, the best first,
    /// and the squares that they leave.
    fn singles_and_pairs(
        &mut self,
        open: &Open,
        rows: &[Linearised],
    ) -> Vec<(Vec<usize>, f64, f64)> {
        let width = self.watched.order.len();
        let tested = self.watched.tested();
        let mut state = State::new(Vec::new(), 0, width, self.r.len());
        state.set(&[], &open.known);
        let (mut sums, none) = (Sums::new(width), Sums::new(width));
        let mut squares = 0.0;
        for (.., r, g) in rows {
            squares += (state.compare(r, g, width) / self.scale).min(self.outside);
            state.absorb();
            sums.take(r, g, &tested);
        }
        let all = self.watched.candidates.len();
        let charge = 2.0 * (all as f64).ln();
        let target = |k: usize| &self.watched.candidates[k].spec.target;
        let pairs = (0..all).flat_map(|j| (0..j).map(move |i| vec![i, j]));
        let pairs = pairs.filter(|pair| target(pair[0]) != target(pair[1]));
        let kinds: Vec<Vec<usize>> = (0..all).map(|k| vec![k]).chain(pairs).collect();
        let mut found = Vec::new();
        for kinds in kinds {
            let own = || kinds.iter().map(|&k| &self.watched.candidates[k]);
            let columns: Vec<usize> = own().flat_map(|k| k.columns.clone()).collect();
            let typical = own().flat_map(|k| k.typical.iter().take(k.columns.len()));
            let precision: Vec<f64> =
                typical.map(|typical| self.scale / (TYPICAL * typical).powi(2)).collect();
            self.score.test(&columns, &state, &sums, &none);
            let Some((theta, covariance)) = self.score.estimate(&precision) else { continue };
            let u = (0..columns.len()).map(|k| self.score.score[k] * theta[k]);
            let fit = u.sum::<f64>() / self.scale;
            let widths: f64 = precision.iter().map(|p| p.ln()).sum();
            let charged = charge * (kinds.len() - 1) as f64;
            let evidence = fit + covariance.determinant().abs().ln() + widths - charged;
            if evidence.is_finite() {
                found.push((kinds, evidence, (squares - fit).max(0.0)));
            }
        }
        order::descending(&mut found, |a| a.1);
        found
    }

    fn unsteady_alarm(&self, open: &Open, own: Unsteady, evidence: f64) -> Alarm {
        let place = &self.watched.places[own.place];
        let name = if place.term == NOISE { "noise" } else { "displacement" };
        let (value, sd, unit) = (own.deviation, own.sd(), place.unit.clone());
        let change = Change { name: name.into(), value, sd, unit: unit.clone() };
        Alarm {
            spec: Spec { term: place.term.into(), target: Some(place.target.clone()), place: None },
            size: value,
            sd,
            unit,
            rate: None,
            parameters: vec![change],
            platform_rms: None,
            // A ratio of likelihoods of a sound device exceeds x with a probability of 1/x at most.
            p_value: (-0.5 * evidence).exp().min(1.0),
            also_fits: Vec::new(),
            action: Action::Stop,
            ..open.alarm.clone()
        }
    }

    fn stuck_alarm(
        &self,
        open: &Open,
        channel: usize,
        began: u64,
        evidence: f64,
        tested: Tested,
    ) -> Alarm {
        let mechanism = &self.watched.under.model.mechanism;
        let own = &mechanism.channels[channel];
        let value = self.runs.reading(channel);
        let reading = Change { name: "reading".into(), value, sd: 0.0, unit: own.unit.clone() };
        Alarm {
            spec: Spec { term: STUCK.into(), target: Some(own.name.clone()), place: None },
            since_row: began,
            since: match (self.recent.time_of(began), tested.time) {
                (Some(time), _) => time,
                (None, Some(_)) => open.alarm.since,
                (None, None) => began as f64,
            },
            size: self.runs.rows(channel) as f64,
            sd: 0.0,
            unit: "rows".into(),
            rate: None,
            parameters: vec![reading],
            platform_rms: None,
            p_value: (-0.5 * evidence).exp().min(1.0),
            also_fits: Vec::new(),
            action: Action::Stop,
            ..open.alarm.clone()
        }
    }

    /// Takes in a new alarm with what it names; the line that says that there is no name for what
    /// happens, where alarms follow each other too fast.
    pub(super) fn too_many(&mut self, tested: Tested, alarms: &[Alarm]) -> Option<Alarm> {
        let mut places = alarms.iter().map(|alarm| self.place_of(&alarm.spec));
        let first = places.next()?;
        let place = if places.all(|place| place == first) { first } else { ALL.into() };
        if self.lately.len() == LATELY {
            self.lately.remove(0);
        }
        self.lately.push((tested.row, (tested.time, place)));
        let last = self.lately.len() - 1;
        let chance = |k: usize| {
            let expected = self.rate * (tested.row - self.lately[k].0) as f64;
            poisson_tail((last - k) as f64, expected)
        };
        let (p_value, first) = (0..last).map(|k| (chance(k), k)).least_by(|a| a.0)?;
        if p_value >= self.rate {
            return None;
        }
        self.silent = true;
        let all = &self.lately[first..];
        let (since_row, (since, place)) = all[0].clone();
        let same = all.iter().all(|(_, (_, other))| *other == place);
        let target = Some(if same { place } else { ALL.into() });
        Some(Alarm {
            row: tested.row,
            time: tested.time,
            since_row,
            since: since.unwrap_or(since_row as f64),
            spec: Spec { term: UNNAMED.into(), target, place: None },
            size: all.len() as f64,
            unit: "alarms".into(),
            p_value,
            action: Action::Stop,
            unnamed: Some(Unnamed::ManyAlarms),
            ..Alarm::default()
        })
    }

    /// The chain of what is named, or all.
    fn place_of(&self, spec: &Spec) -> String {
        let mechanism = &self.watched.under.model.mechanism;
        let target = spec.target.as_deref().unwrap_or_default();
        let channel = mechanism.channels.iter().position(|c| c.name == target);
        let chain = channel.and_then(|c| mechanism.chain_of(c)).map(|k| &mechanism.chains[k]);
        let own = target.split('/').next();
        let named = chain.or_else(|| mechanism.chains.iter().find(|c| Some(&*c.name) == own));
        named.map_or_else(|| ALL.into(), |chain| chain.name.clone())
    }
}

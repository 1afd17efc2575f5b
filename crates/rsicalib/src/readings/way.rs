//! What a channel remembers of the way by which it came to a reading.
//!
//! The way goes from held pose to held pose, or from row to row of a recording: noise travels nowhere and
//! turns nowhere. What moves by less than a standstill has not moved.

use std::sync::{Arc, PoisonError, RwLock};

use crate::numerics::lanes::Lanes;
use crate::readings::table::Table;

/// What a channel remembers of its way, in the unit of readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Memory {
    /// The path travelled since the session began.
    Travelled,
    /// How far it is from where it turned last, with its sign.
    SinceTurn,
    /// Its place between the sides of a play to `width` on both sides, -1 to 1.
    Play { width: f64 },
}

/// What was asked for, of each channel: its values block by block.
type Asked = Vec<((usize, Memory), Arc<[Lanes]>)>;

/// What channels remember, each found when it is first asked for. A copy finds its own.
#[derive(Debug, Default)]
pub(crate) struct Memories(RwLock<Asked>);

impl Clone for Memories {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Memories {
    /// What is known, or else found.
    pub(crate) fn of(
        &self,
        channel: usize,
        memory: Memory,
        find: impl FnOnce() -> Vec<Lanes>,
    ) -> Arc<[Lanes]> {
        let known = self.0.read().unwrap_or_else(PoisonError::into_inner);
        let there = known.iter().find(|(of, _)| *of == (channel, memory));
        if let Some((_, values)) = there {
            return values.clone();
        }
        drop(known);
        let values: Arc<[Lanes]> = find().into();
        let mut known = self.0.write().unwrap_or_else(PoisonError::into_inner);
        known.push(((channel, memory), values.clone()));
        values
    }
}

/// The way of one channel through its sessions, visit by visit. A visit is a held pose until another comes, or
/// a row of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Visits {
    readings: Vec<f64>,
    begins: Vec<bool>,
    still: f64,
    /// The visit of every row.
    of_row: Vec<usize>,
}

impl Visits {
    pub(crate) fn of(
        table: &Table,
        pose: &[usize],
        [channel, channels]: [usize; 2],
        still: f64,
    ) -> Self {
        let session = |row: usize| table.session_of(row);
        let new =
            |row: usize| row == 0 || pose[row] != pose[row - 1] || session(row) != session(row - 1);
        let mut rows: Vec<Vec<usize>> = Vec::new();
        for row in 0..pose.len() {
            match rows.last_mut().filter(|_| !new(row)) {
                Some(visit) => visit.push(row),
                None => rows.push(vec![row]),
            }
        }
        let mean = |rows: &Vec<usize>| {
            let sum: f64 = rows.iter().map(|row| table.values[row * channels + channel]).sum();
            sum / rows.len() as f64
        };
        let begins = |v: usize| v == 0 || session(rows[v][0]) != session(rows[v - 1][0]);
        Self {
            readings: rows.iter().map(mean).collect(),
            begins: (0..rows.len()).map(begins).collect(),
            still,
            of_row: rows
                .iter()
                .enumerate()
                .flat_map(|(v, rows)| rows.iter().map(move |_| v))
                .collect(),
        }
    }

    /// The same way, with these rows alone.
    pub(crate) fn at_rows(mut self, rows: &[usize]) -> Self {
        self.of_row = rows.iter().map(|&row| self.of_row[row]).collect();
        self
    }

    /// The same way as coordinates. Visits of the rows are where a fit settles these; any other is where the gain
    /// puts what was read there, as far off as the settled ones are in the mean.
    pub(crate) fn settled(mut self, coordinates: &[f64], gain: f64) -> Self {
        let mut rows = vec![Vec::new(); self.readings.len()];
        for (&visit, coordinate) in self.of_row.iter().zip(coordinates) {
            rows[visit].push(*coordinate);
        }
        let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
        let settled = rows.iter().zip(&self.readings).filter(|(rows, _)| !rows.is_empty());
        let off: Vec<f64> = settled.map(|(rows, reading)| mean(rows) - gain * reading).collect();
        let off = mean(&off);
        for (reading, rows) in self.readings.iter_mut().zip(&rows) {
            *reading = if rows.is_empty() { gain * *reading + off } else { mean(rows) };
        }
        self.still *= gain.abs();
        self
    }

    /// Where it is in every row.
    pub(crate) fn places(&self) -> Vec<f64> {
        self.of_row.iter().map(|&visit| self.readings[visit]).collect()
    }

    /// What the channel remembers in every row.
    pub(crate) fn remembered(&self, memory: Memory) -> Vec<f64> {
        let way = Way { readings: &self.readings, begins: &self.begins, still: self.still };
        let values = way.of(memory);
        self.of_row.iter().map(|&visit| values[visit]).collect()
    }
}

/// The way of one channel, sample by sample.
pub struct Way<'a> {
    /// Its readings, settled.
    pub readings: &'a [f64],
    /// True for the first sample of a session: what was before is not known.
    pub begins: &'a [bool],
    /// Below so much change it stands still.
    pub still: f64,
}

/// Widths of plays that are tried.
const PLAYS: i32 = 6;

/// Widths of plays of a channel that goes from one place to another: halvings of half of that way.
pub(crate) fn widths([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    (1..=PLAYS).map(move |k| (high - low) * 0.5_f64.powi(k))
}

impl Way<'_> {
    /// What is remembered, sample by sample.
    pub(crate) fn of(&self, memory: Memory) -> Vec<f64> {
        match memory {
            Memory::Travelled => self.travelled(),
            Memory::SinceTurn => self.since_turn(),
            Memory::Play { width } => self.play(width),
        }
    }

    /// The path travelled since the session began.
    pub fn travelled(&self) -> Vec<f64> {
        let (mut from, mut way) = (0.0, 0.0);
        self.each(|reading, begins| {
            if begins {
                (from, way) = (reading, 0.0);
            }
            let step = (reading - from).abs();
            if step >= self.still {
                (from, way) = (reading, way + step);
            }
            way
        })
    }

    /// How far it is from where it turned last, with its sign; until it turns, from where it began.
    pub fn since_turn(&self) -> Vec<f64> {
        // The farthest that it has come in this direction, 0 while it has none.
        let (mut turn, mut end, mut side) = (0.0, 0.0, 0.0);
        self.each(|reading, begins| {
            if begins {
                (turn, end, side) = (reading, reading, 0.0);
            }
            let step = reading - end;
            if step.abs() >= self.still && step * side < 0.0 {
                turn = end;
            }
            if step.abs() >= self.still || step * side > 0.0 {
                (end, side) = (reading, step.signum());
            }
            reading - turn
        })
    }

    /// Time since it moved last.
    pub fn since_move(&self, time: &[f64]) -> Vec<f64> {
        let (mut from, mut at, mut p) = (0.0, 0.0, 0);
        self.each(|reading, begins| {
            if begins || (reading - from).abs() >= self.still {
                (from, at) = (reading, time[p]);
            }
            p += 1;
            time[p - 1] - at
        })
    }

    /// Plays of several widths, each as its place between its sides, -1 to 1: what gives by them all, by
    /// whatever weights, remembers all turns that a longer way has not wiped out (Prandtl, Ishlinskii).
    pub fn plays(&self) -> Vec<Vec<f64>> {
        let low = self.readings.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.readings.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        widths([low, high])
            .filter(|width| *width > self.still)
            .map(|width| self.play(width))
            .collect()
    }

    /// A play to `width` on both sides: it begins in the middle.
    fn play(&self, width: f64) -> Vec<f64> {
        let mut carried = 0.0;
        self.each(|reading, begins| {
            let least = if begins { reading } else { carried };
            carried = least.max(reading - width).min(reading + width);
            (reading - carried) / width
        })
    }

    fn each(&self, mut at: impl FnMut(f64, bool) -> f64) -> Vec<f64> {
        self.readings.iter().zip(self.begins).map(|(&r, &begins)| at(r, begins)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Memory, Visits, Way};
    use crate::readings::table::Table;

    const BEGINS: [bool; 7] = [true, false, false, false, false, true, false];

    fn way(readings: &[f64]) -> Way<'_> {
        Way { readings, begins: &BEGINS[..readings.len()], still: 0.5 }
    }

    /// A pose that comes again is another visit; what it reads is the mean of its rows.
    #[test]
    fn all_rows_of_a_visit_have_the_way_to_it() {
        let values = vec![1.0, 3.0, 7.0, 5.0, 2.0];
        let table = Table { values, session: Some(vec![0, 0, 0, 0, 1]), ..Table::default() };
        let visits = Visits::of(&table, &[0, 0, 1, 0, 1], [0, 1], 0.5);
        let of = |memory| visits.remembered(memory);
        assert_eq!(of(Memory::Travelled), [0.0, 0.0, 5.0, 7.0, 0.0]);
        assert_eq!(of(Memory::SinceTurn), [0.0, 0.0, 5.0, -2.0, 0.0]);
        // Of 2, 7 and 5 a play of 2 carries 2, 5 and 5.
        assert_eq!(of(Memory::Play { width: 2.0 }), [0.0, 0.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn noise_travels_nowhere_and_a_session_begins_anew() {
        let way = way(&[0.0, 0.2, 4.0, 4.3, 1.0, 9.0, 7.0]);
        assert_eq!(way.travelled(), [0.0, 0.0, 4.0, 4.0, 7.0, 0.0, 2.0]);
        let time = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(way.since_move(&time), [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_turn_is_where_it_had_come_farthest() {
        let way = way(&[0.0, 3.0, 4.0, 3.8, 1.0, 9.0, 7.0]);
        let wanted = [0.0, 3.0, 4.0, 3.8, -3.0, 0.0, -2.0];
        for (got, wanted) in way.since_turn().iter().zip(wanted) {
            assert!((got - wanted).abs() < 1e-12, "{got} for {wanted}");
        }
    }

    /// A visit that no row is of is as far off as the others: no jump stands between them.
    #[test]
    fn a_way_is_settled_where_rows_are_left_out_too() {
        let values = vec![1.0, 3.0, 7.0, 5.0, 2.0];
        let table = Table { values, ..Table::default() };
        let visits = Visits::of(&table, &[0, 0, 1, 2, 3], [0, 1], 0.5).at_rows(&[0, 1, 3]);
        // Twice what is read and 10 more, a quarter beside it in the pose of two rows.
        let settled = visits.settled(&[12.25, 16.25, 20.0], 2.0);
        let off = 10.125;
        let way = [14.25, 14.0 + off, 20.0, 4.0 + off];
        assert_eq!(settled.readings, way);
        assert_eq!(settled.places(), [14.25, 14.25, 20.0]);
        let travelled = settled.remembered(Memory::Travelled)[2];
        assert_eq!(travelled, (off - 0.25) + (off - 6.0));
    }

    #[test]
    fn a_play_follows_only_beyond_its_sides() {
        let way = way(&[0.0, 1.0, 4.0, 3.0, 0.0]);
        // Carried: 0, 0, 2, 2, 2.
        assert_eq!(way.play(2.0), [0.0, 0.5, 1.0, 0.5, -1.0]);
        // Half of the way is 2: then 1; a half is no more than a standstill.
        assert_eq!(way.plays().len(), 2);
        assert_eq!(way.plays()[0], way.play(2.0));
    }
}

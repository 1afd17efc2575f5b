//! What a channel remembers of the way by which it came to a reading.
//!
//! The way goes from held pose to held pose, or from row to row of a recording: noise travels nowhere and
//! turns nowhere. What moves by less than a standstill has not moved.

use crate::readings::table::Table;

/// Path travelled and distance from the last turn, row by row, one pair per channel, in the unit of readings. The
/// way goes from visit to visit: a held pose until another comes, or a row of a recording.
pub(crate) fn ways(table: &Table, pose: &[usize], still: &[f64]) -> Vec<[f64; 2]> {
    let channels = still.len();
    let session = |row: usize| table.session_of(row);
    let begins =
        |&row: &usize| row == 0 || pose[row] != pose[row - 1] || session(row) != session(row - 1);
    let firsts: Vec<usize> = (0..pose.len()).filter(begins).collect();
    let ends = firsts.iter().skip(1).copied().chain([pose.len()]);
    let visits: Vec<_> = firsts.iter().zip(ends).map(|(&first, end)| first..end).collect();
    let begins: Vec<bool> =
        (0..visits.len()).map(|v| v == 0 || session(firsts[v]) != session(firsts[v - 1])).collect();
    let mut out = vec![[0.0; 2]; pose.len() * channels];
    for c in 0..channels {
        let mean = |rows: &std::ops::Range<usize>| {
            let sum: f64 = rows.clone().map(|row| table.values[row * channels + c]).sum();
            sum / rows.len() as f64
        };
        let readings: Vec<f64> = visits.iter().map(mean).collect();
        let way = Way { readings: &readings, begins: &begins, still: still[c] };
        let both = way.travelled().into_iter().zip(way.since_turn());
        for (rows, (travelled, since_turn)) in visits.iter().zip(both) {
            rows.clone().for_each(|row| out[row * channels + c] = [travelled, since_turn]);
        }
    }
    out
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

/// Widths of plays: halvings of half the way that a channel goes.
const PLAYS: i32 = 6;

impl Way<'_> {
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
        let half = 0.5 * (high - low);
        let widths = (0..PLAYS).map(|k| half * 0.5_f64.powi(k));
        widths.filter(|width| *width > self.still).map(|width| self.play(width)).collect()
    }

    /// A play to `width` on both sides: it begins in the middle.
    fn play(&self, width: f64) -> Vec<f64> {
        let mut carried = 0.0;
        self.each(|reading, begins| {
            let least = if begins { reading } else { carried };
            carried = least.clamp(reading - width, reading + width);
            (reading - carried) / width
        })
    }

    fn each(&self, mut at: impl FnMut(f64, bool) -> f64) -> Vec<f64> {
        self.readings.iter().zip(self.begins).map(|(&r, &begins)| at(r, begins)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Way, ways};
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
        let found = ways(&table, &[0, 0, 1, 0, 1], &[0.5]);
        assert_eq!(found, [[0.0, 0.0], [0.0, 0.0], [5.0, 5.0], [7.0, -2.0], [0.0, 0.0]]);
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

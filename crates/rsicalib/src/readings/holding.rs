//! Which closures hold in which rows.

use crate::Error;
use crate::mechanism::Mechanism;
use crate::numerics::bounds::LARGEST;
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::table::Table;

/// Which closures hold in which rows: a closure does not where a column of its own is blank.
///
/// An arm touches a cone in some rows and a table in others; a tracker does not see every pose; a
/// length was measured in some. What closures do not hold says nothing: its equations are zero in all
/// that is computed of the row, and are not counted.
#[derive(Debug, Clone, Default)]
pub struct Holding {
    /// Closures of the mechanism.
    closures: usize,
    /// Row by row, closure by closure; empty where all hold in all rows.
    rows: Vec<bool>,
    /// Block by block, closure by closure: one where it holds, zero where not; empty likewise.
    lanes: Vec<Lanes>,
}

impl Holding {
    /// Of the rows of a table, before they are laid out.
    ///
    /// # Errors
    ///
    /// [`Error::Reading`] for a row in which no closure holds: it says nothing.
    pub(crate) fn of(mechanism: &Mechanism, table: &Table, samples: usize) -> Result<Self, Error> {
        let (keys, values) = (mechanism.key_columns(), mechanism.value_columns());
        let of_keys = |name: &String| keys.iter().position(|k| k == name);
        let of_values = |name: &String| values.iter().position(|v| v == name);
        let own = |closure: usize| {
            let columns = mechanism.own_columns(closure);
            let keys: Vec<usize> = columns.iter().filter_map(of_keys).collect();
            let values: Vec<usize> = columns.iter().filter_map(of_values).collect();
            (keys, values)
        };
        let count = mechanism.closures.len();
        let own: Vec<_> = (0..count).map(own).collect();
        let holds = |row: usize, (keys, values): &(Vec<usize>, Vec<usize>)| {
            keys.iter().all(|&k| !table.keys[k][row].is_empty())
                && values.iter().all(|&v| !table.columns[v][row].is_nan())
        };
        let all = (0..samples).all(|row| own.iter().all(|own| holds(row, own)));
        if all {
            return Ok(Self { closures: count, ..Self::default() });
        }
        let mut rows = Vec::with_capacity(samples * count);
        for row in 0..samples {
            rows.extend(own.iter().map(|own| holds(row, own)));
            let links = |k: &usize| mechanism.is_link(&mechanism.closures[*k]);
            let here = &rows[row * count..];
            if !(0..count).filter(|k| !links(k)).any(|k| here[k]) {
                let blank = (0..count).find_map(|k| mechanism.own_columns(k).into_iter().next());
                return Err(Error::Reading {
                    row,
                    channel: blank.unwrap_or_default(),
                    found: f64::NAN,
                    low: -LARGEST,
                    high: LARGEST,
                });
            }
        }
        Ok(Self { closures: count, rows, lanes: Vec::new() })
    }

    /// Of some of these rows.
    pub(crate) fn picked(&self, rows: &[usize]) -> Self {
        let of = |row: &usize| self.rows[row * self.closures..(row + 1) * self.closures].to_vec();
        let rows = if self.is_whole() { Vec::new() } else { rows.iter().flat_map(of).collect() };
        Self { closures: self.closures, rows, lanes: Vec::new() }
    }

    /// Lays out the next block, of these rows.
    pub(crate) fn lay_out(&mut self, rows: &[usize; WIDTH]) {
        if self.is_whole() {
            return;
        }
        for k in 0..self.closures {
            self.lanes.push(Lanes(rows.map(|row| f64::from(u8::from(self.holds(row, k))))));
        }
    }

    /// True where all closures hold in all rows.
    #[inline(always)]
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.rows.is_empty()
    }

    /// True for a closure of the mechanism that holds in a row.
    #[must_use]
    pub fn holds(&self, row: usize, closure: usize) -> bool {
        self.rows.get(row * self.closures + closure).copied().unwrap_or(true)
    }

    /// One in the lanes of a block in which a closure of the mechanism holds, zero in the others; none
    /// where all closures hold in all rows.
    #[inline(always)]
    pub(crate) fn of_block(&self, block: usize, closure: usize) -> Option<Lanes> {
        self.lanes.get(block * self.closures + closure).copied()
    }
}

//! Where a mechanism is, one reading after the other: what depends on the result alone is made once.

use crate::Error;
use crate::apply::earlier::{Applied, Under};
use crate::apply::places::{Placed, names_of};
use crate::apply::poses::poses_of;
use crate::mechanism::Mechanism;
use crate::readings::Table;

/// A mechanism under a result, which tells its place reading by reading.
///
/// Each reading is by itself, as one row is for [`places`](crate::apply::places::places): without a
/// time, a temperature and a pose before.
#[derive(Debug)]
pub struct Placer {
    mechanism: Mechanism,
    applied: Applied,
    names: Vec<String>,
    /// The mechanism with its last reading, and the parameters of its model.
    last: Option<(Under, Vec<f64>)>,
}

impl Placer {
    /// A mechanism under a result.
    ///
    /// # Errors
    ///
    /// As [`places`](crate::apply::places::places).
    pub fn new(mechanism: &Mechanism, applied: Applied) -> Result<Self, Error> {
        let names = names_of(mechanism)?;
        Ok(Self { mechanism: mechanism.clone(), applied, names, last: None })
    }

    /// Names of the values: `x y z rx ry rz`, or `ball.x ball.y ball.z` of a point `ball`.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The place of one reading, one number for each channel: a value for each name.
    ///
    /// # Errors
    ///
    /// As [`places`](crate::apply::places::places).
    pub fn place(&mut self, reading: &[f64]) -> Result<Vec<f64>, Error> {
        Error::same("reading", reading.len(), self.mechanism.channels.len())?;
        let what = Placed::of(&self.mechanism);
        let (under, beta) = match self.last.take() {
            Some((mut under, beta)) => {
                under.readings.replace(&under.model.mechanism, reading)?;
                self.last.insert((under, beta))
            }
            None => {
                let table = Table { values: reading.to_vec(), ..Table::default() };
                let build = if what == Placed::Carried { Under::open } else { Under::new };
                let under = build(&self.mechanism, &self.applied, table, &[])?;
                let beta = under.internal(&under.values);
                self.last.insert((under, beta))
            }
        };
        Ok(match what {
            Placed::Platform => {
                poses_of(&under.model, &under.readings, beta, &under.noise).concat()
            }
            Placed::Carried => under.points_at(beta).concat().concat(),
            Placed::Moving => under.moving_at(beta).concat().concat(),
        })
    }
}

//! The state of a watch as bytes: what it knew goes on where it ended.
//!
//! One list of fields serves to write and to read: [`Keep::keep`] passes every number of a value
//! through [`Bytes`], which copies it out, or puts a saved one in its place.

use nalgebra::DMatrix;

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::model::Spec;
use crate::monitor::alarm::{Action, Alarm, Change};

/// Bytes that are written, or read.
pub(crate) struct Bytes {
    bytes: Vec<u8>,
    /// Where the next number is read; none while writing.
    at: Option<usize>,
    damaged: bool,
}

impl Bytes {
    /// To be written.
    pub(crate) const fn new() -> Self {
        Self { bytes: Vec::new(), at: None, damaged: false }
    }

    /// To be read.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] where they are not what was written.
    pub(crate) fn of(mut bytes: Vec<u8>) -> Result<Self, Error> {
        let end = bytes.len().checked_sub(8).ok_or_else(damaged)?;
        let sum = bytes.split_off(end);
        match sum == checksum(&bytes).to_le_bytes() {
            true => Ok(Self { bytes, at: Some(0), damaged: false }),
            false => Err(damaged()),
        }
    }

    /// What was written, and its checksum.
    pub(crate) fn written(mut self) -> Vec<u8> {
        let sum = checksum(&self.bytes);
        self.bytes.extend_from_slice(&sum.to_le_bytes());
        self.bytes
    }

    /// Checks that all was read, and nothing was missing.
    pub(crate) fn whole(&self) -> Result<(), Error> {
        match self.damaged || self.at != Some(self.bytes.len()) {
            true => Err(damaged()),
            false => Ok(()),
        }
    }

    fn word(&mut self, word: &mut u64) {
        let Some(at) = self.at else {
            self.bytes.extend_from_slice(&word.to_le_bytes());
            return;
        };
        match self.bytes.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()) {
            Some(bytes) => (*word, self.at) = (u64::from_le_bytes(bytes), Some(at + 8)),
            None => self.damaged = true,
        }
    }

    /// The length of a list; it stays as it is where the bytes are damaged.
    fn length(&mut self, own: usize) -> usize {
        let mut length = own as u64;
        self.word(&mut length);
        // A longer list than there are bytes left is damage, not memory to be asked for.
        let left = self.at.map_or(u64::MAX, |at| (self.bytes.len() - at) as u64 / 8);
        self.damaged |= length > left;
        if self.damaged { own } else { length as usize }
    }

    pub(crate) const fn reads(&self) -> bool {
        self.at.is_some()
    }
}

fn damaged() -> Error {
    Error::option("state", "a damaged one", "what a watch has written")
}

/// FNV-1a of 64 bits: another value of one byte always changes it.
fn checksum(bytes: &[u8]) -> u64 {
    let step = |sum: u64, byte: &u8| (sum ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

/// A value that is part of a state.
pub(crate) trait Keep {
    /// Passes every number of the value.
    fn keep(&mut self, bytes: &mut Bytes);
}

impl Keep for u64 {
    fn keep(&mut self, bytes: &mut Bytes) {
        bytes.word(self);
    }
}

impl Keep for usize {
    fn keep(&mut self, bytes: &mut Bytes) {
        let mut word = *self as u64;
        bytes.word(&mut word);
        *self = word as Self;
    }
}

impl Keep for f64 {
    fn keep(&mut self, bytes: &mut Bytes) {
        let mut word = self.to_bits();
        bytes.word(&mut word);
        *self = Self::from_bits(word);
    }
}

impl Keep for bool {
    fn keep(&mut self, bytes: &mut Bytes) {
        let mut word = u64::from(*self);
        bytes.word(&mut word);
        *self = word == 1;
    }
}

impl<T: Keep + Default> Keep for Option<T> {
    fn keep(&mut self, bytes: &mut Bytes) {
        let mut some = self.is_some();
        some.keep(bytes);
        if bytes.reads() {
            *self = some.then(T::default);
        }
        if let Some(value) = self {
            value.keep(bytes);
        }
    }
}

impl<T: Keep + Default + Clone> Keep for Vec<T> {
    fn keep(&mut self, bytes: &mut Bytes) {
        let length = bytes.length(self.len());
        self.resize(length, T::default());
        self.iter_mut().for_each(|value| value.keep(bytes));
    }
}

impl<T: Keep, const N: usize> Keep for [T; N] {
    fn keep(&mut self, bytes: &mut Bytes) {
        self.iter_mut().for_each(|value| value.keep(bytes));
    }
}

impl<A: Keep, B: Keep> Keep for (A, B) {
    fn keep(&mut self, bytes: &mut Bytes) {
        self.0.keep(bytes);
        self.1.keep(bytes);
    }
}

impl Keep for String {
    fn keep(&mut self, bytes: &mut Bytes) {
        let mut codes: Vec<u64> = self.bytes().map(u64::from).collect();
        codes.keep(bytes);
        let text: Vec<u8> = codes.iter().map(|code| *code as u8).collect();
        match Self::from_utf8(text) {
            Ok(text) => *self = text,
            Err(_) => bytes.damaged = true,
        }
    }
}

impl Keep for DMatrix<f64> {
    fn keep(&mut self, bytes: &mut Bytes) {
        let rows = bytes.length(self.nrows());
        let mut all: Vec<f64> = self.iter().copied().collect();
        all.keep(bytes);
        if rows > 0 && all.len().is_multiple_of(rows) {
            *self = Self::from_vec(rows, all.len() / rows, all);
        } else {
            bytes.damaged |= !all.is_empty();
        }
    }
}

/// Passes the fields of a value, one after the other.
macro_rules! fields {
    ($bytes:expr, $($field:expr),+ $(,)?) => {
        $( $crate::monitor::kept::Keep::keep(&mut $field, $bytes); )+
    };
}
pub(crate) use fields;

/// Makes a value part of a state: `keep!(Type: first, second)` passes its fields in this order.
macro_rules! keep {
    ($type:ident: $($field:ident),+) => {
        impl $crate::monitor::kept::Keep for $type {
            fn keep(&mut self, bytes: &mut $crate::monitor::kept::Bytes) {
                $crate::monitor::kept::fields!(bytes, $(self.$field),+);
            }
        }
    };
}
pub(crate) use keep;

keep!(Spec: term, target, place);
keep!(PlatformRms: position, orientation);
keep!(Change: name, value, sd, unit);
keep!(
    Alarm: row, time, since_row, since, spec, size, sd, unit, rate, parameters, platform_rms,
    p_value, also_fits, revises, action
);

impl Keep for Action {
    fn keep(&mut self, bytes: &mut Bytes) {
        let all = [Self::GoOn, Self::Recalibrate, Self::Stop];
        let mut place = all.iter().position(|one| one == self).unwrap_or_default();
        place.keep(bytes);
        match all.get(place) {
            Some(own) => *self = *own,
            None => bytes.damaged = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_again_and_damage_is_refused() {
        let mut alarm = Alarm { row: 7, time: Some(f64::MIN_POSITIVE), ..Alarm::default() };
        alarm.spec.term = "länge".into();
        alarm.parameters.push(Change { value: -0.1, unit: "rad".into(), ..Change::default() });
        let mut bytes = Bytes::new();
        alarm.clone().keep(&mut bytes);
        let written = bytes.written();
        let mut again = Alarm::default();
        let mut reading = Bytes::of(written.clone()).expect("as it was written");
        again.keep(&mut reading);
        assert!(reading.whole().is_ok() && again == alarm);
        for at in 0..written.len() {
            assert!(Bytes::of(written[..at].to_vec()).is_err(), "{at}");
            let mut flipped = written.clone();
            flipped[at] ^= 1 << (at % 8);
            assert!(Bytes::of(flipped).is_err(), "{at}");
        }
        // A state of other fields.
        let mut bytes = Bytes::new();
        (1_u64, 2.0_f64).keep(&mut bytes);
        let mut reading = Bytes::of(bytes.written()).expect("as it was written");
        Alarm::default().keep(&mut reading);
        assert!(reading.whole().is_err());
    }
}

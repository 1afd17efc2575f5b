//! Names of unknown places: `surface[surface=table]`, `socket[group=front,at=socket0]`.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// The name of one of several places of something unknown, as results write it.
///
/// A name is kept once for the whole process: that makes it as small as an index, and the same in all
/// mechanisms and readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PlaceName(&'static str);

/// The names that there are. They are few: one for each thing that some readings touch.
static KNOWN: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());

impl PlaceName {
    /// This name.
    pub(crate) fn of(text: &str) -> Self {
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = known.get(text) {
            return Self(kept);
        }
        let kept: &'static str = Box::leak(Box::from(text));
        known.insert(kept);
        Self(kept)
    }

    /// Its text.
    #[must_use]
    pub fn text(self) -> &'static str {
        self.0
    }
}

/// The name of a place: that of the thing, and what tells its places apart; the name alone where
/// there is one place for all rows.
pub(crate) fn place_name(thing: &str, columns: &[String], keys: &[String]) -> String {
    if columns.is_empty() {
        return thing.into();
    }
    let pairs = columns.iter().zip(keys).map(|(column, key)| format!("{column}={key}"));
    format!("{thing}[{}]", pairs.collect::<Vec<_>>().join(","))
}

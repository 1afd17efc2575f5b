//! Readings that a fit has moved onto the closures, where the next fit of them may start.

use std::sync::{Arc, Weak};

use crate::numerics::lanes::Lanes;
use crate::readings::Readings;

/// Estimated readings without noise, `â` of (52), and the readings that they are of.
#[derive(Debug, Clone)]
pub(crate) struct Adjusted {
    of: Weak<Readings>,
    adjusted: Arc<[Lanes]>,
}

impl Adjusted {
    /// Of these readings, in the order of their blocks.
    pub(crate) fn new(readings: &Arc<Readings>, adjusted: Vec<Lanes>) -> Self {
        Self { of: Arc::downgrade(readings), adjusted: adjusted.into() }
    }

    /// Those of these readings; none where they are of others.
    pub(crate) fn of(&self, readings: &Readings) -> Option<&[Lanes]> {
        std::ptr::eq(self.of.as_ptr(), readings).then_some(&*self.adjusted)
    }
}

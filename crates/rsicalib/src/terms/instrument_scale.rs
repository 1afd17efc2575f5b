//! [`InstrumentScale`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, OfInstrument, Term};

term! {
    /// An instrument that reads all lengths long, or short.
    ///
    /// Multiplies the coordinates of all points that it sees by one and `scale`: a tracker with a wrong temperature of
    /// the air, cameras whose bar is not as long as its certificate says. It has the name of the first closure that
    /// ends at what the instrument sees. The lengths of the drawing tell it, so that links that are all longer by the
    /// same part are the same.
    InstrumentScale("instrument_scale", Closure, per Closure, needs Nothing) {
        scale: "1" ~ 3e-4,
    } acts Acts::Instrument(OfInstrument::Scale)
}

impl Term for InstrumentScale {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(closure) if mechanism.first_seen(closure))
    }
}

//! [`Distance`].

use crate::terms::term::{Acts, Info, Term};

term! {
    /// A distance between two points that is not the drawn one.
    ///
    /// Adds `d` to the value of a distance closure, for example one side of a handle.
    Distance("distance", Closure, per Closure, needs Nothing) {
        d: "length" ~ 2.5e-3,
    }
}

impl Term for Distance {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Distance
    }
}

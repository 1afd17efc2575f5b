//! [`Touch`].

use crate::closures::kind::{Given, Kind, Part};

/// Two points coincide.
///
/// ```text
/// f = a - b
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Touch;

impl Kind for Touch {
    fn equations(&self) -> usize {
        3
    }

    fn between(&self) -> [Part; 2] {
        [Part::Point; 2]
    }

    fn given(&self) -> Given {
        Given::Nothing
    }

    fn is_vector(&self) -> bool {
        true
    }

    fn words(&self) -> &'static str {
        "two points coincide"
    }
}

//! [`Touch`].

use crate::closures::kind::{Facts, Given, Kind, Part};

/// Two points coincide.
///
/// ```text
/// f = a - b
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Touch;

impl Kind for Touch {
    const FACTS: Facts = Facts {
        words: "two points coincide",
        equations: 3,
        between: [Part::Point; 2],
        given: Given::Nothing,
        is_vector: true,
        dimension: 1,
    };
}

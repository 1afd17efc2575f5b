//! Numbers that can be computed with.

/// The largest number that is taken as an input: products of four, and their sums, stay finite.
pub const LARGEST: f64 = 1e60;

/// True for a number that can be computed with.
#[must_use]
pub fn usable(number: f64) -> bool {
    number.abs() <= LARGEST
}

/// True for a positive number that can be computed with, and divided by.
#[must_use]
pub fn positive(number: f64) -> bool {
    (LARGEST.recip()..=LARGEST).contains(&number)
}

/// What is expected where such a number stands.
#[must_use]
pub fn expected(number: f64) -> String {
    match number.is_finite() {
        true => format!("a number of at most {LARGEST:e} in size"),
        false => "a finite number".into(),
    }
}

//! The median.

use crate::numerics::order;

/// The median of some values, of an even number the mean of the two in the middle; NaN of none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    order::sort(&mut values);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

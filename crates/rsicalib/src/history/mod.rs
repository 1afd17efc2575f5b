//! Results of one device over years: what drifts, what jumped, and what only scatters.
//!
//! ```text
//! y_i = a + ρ (t_i - t_n) - Σ_k s_k 1(i ≤ j_k) + e_i,    e_i ~ N(0, sd_i² + τ²)      (127)
//! ```
//!
//! `a` is the level at the last date, `ρ` the rate, `s_k` a jump after result `j_k`, `τ` the scatter of
//! the device beside the deviations that its results state.

mod course;
mod forecast;
mod past;
mod rates;
mod regression;
mod series;

pub use course::{Course, CourseKind, Jump, course};
pub use forecast::{Forecast, forecast};
pub use past::Past;
pub use series::{Dated, Series, series};

//! Calibration of closed kinematic chains from their own joint readings.
//!
//! # The problem
//!
//! A closed mechanism with sensed joints satisfies `f(a*, β) = 0` in every pose, where `a*` are
//! the true readings and `β` the parameters: offsets, gains and everything else that is not as
//! drawn. Readings carry noise, `a = a* + e` with `e ~ N(0, Σ)`. The estimate minimises
//!
//! ```text
//! Σ_samples eᵀ Σ⁻¹ e    subject to    f(a - e, β) = 0                      (50)
//! ```
//!
//! A *calibration* estimates the parameters of given terms, tests whether the residual is above
//! the noise, and names directions that the poses cannot determine. A *trace* searches for the
//! terms that explain such a residual. Equation numbers are those of `docs/model.md`; units,
//! frames and signs are those of `docs/conventions.md`, both in the repository.
//!
//! # From readings to report
//!
//! Each layer uses those above it and none below.
//!
//! | layer | input | output |
//! |---|---|---|
//! | `numerics` | residuals and derivatives | minimum by Levenberg-Marquardt, (31) to (33) |
//! | `closures` | ends of a closure, its value | equations and their derivatives, kind by kind |
//! | [`mechanism`] | Rust values or TOML | [`Mechanism`]: channels, chains, points, closures |
//! | `readings` | [`Table`] | readings: checked, in blocks of eight samples |
//! | `kinematics` | elements of a chain, joint coordinates | points and their derivatives, (21), (22) |
//! | `terms` | readings, joint coordinates | corrections of one physical effect, (41) to (43) |
//! | `model` | mechanism and terms | a model: misclosure `f` and its derivatives, (10), (44) |
//! | `estimate` | [`Observations`]: readings, weights, options | a fit: estimates, covariance, χ², (50) to (65) |
//! | `apply` | a fit and other readings | platform poses, comparison with known poses |
//! | `monitor` | a calibration and rows at work | alarms: what changed, since when, by how much, (101) to (104) |
//! | `screening` | readings | faults of converters, outliers, damage, (81) to (84) |
//! | `diagnosis` | a fit with a residual | score tests, search over explanations, fault isolation, verdict, (71) to (74) |
//! | `history` | estimates and dates | [`Course`]: what drifts, what jumped, (127), (128); when an error is too large, (147), (178) |
//! | `population` | what many devices tell | common errors of the drawing, spread, priors, (121) to (126) |
//! | `design` | poses | Cramér-Rao bound and pose plans, (91), (92) |
//! | [`report`] | observations | results of a calibration and of a trace, as plain structs |
//!
//! # Example
//!
//! The hand controller holds 60 poses. The sensor of `a22` has a parabolic error. Offsets and
//! gains do not explain the readings; the trace names the missing effect.
//!
//! ```
//! use rsicalib::mechanism::hand_controller;
//! use rsicalib::{FitOptions, Mechanism, Observations, SearchOptions, Table, Verdict};
//!
//! let mechanism = Mechanism::rsi();
//! let mut values = Vec::new(); // nine counts per pose
//! for n in 1..=60 {
//!     let spread = |prime: f64| 2.0 * (f64::from(n) * prime.sqrt()).fract() - 1.0; // -1 to 1
//!     let [x, y, z, rx, ry, rz] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0].map(spread);
//!     let pose = [1.5 * x, 1.5 * y, 1.3 * z - 2.9, 0.4 * rx, 0.4 * ry, 0.4 * rz]; // in, rad
//!     let Ok(angles) = hand_controller::inverse(&pose) else { continue }; // out of reach
//!     for (channel, angle) in mechanism.channels.iter().zip(angles.concat()) {
//!         let u = (angle - channel.angle(channel.middle())) / 3.0;
//!         let error = if channel.name == "a22" { 0.2 * u * u } else { 0.0 }; // rad
//!         values.push(((angle - error - channel.offset) / channel.gain).round());
//!     }
//! }
//! let pose = Some((0..values.len() as i64 / 9).collect());
//! let options = FitOptions { noise: Some(vec![0.29; 9]), ..FitOptions::default() }; // rounding
//! let table = Table { values, pose, ..Table::default() };
//! let observations = Observations::new(&mechanism, table, None, options)?;
//! assert_eq!(rsicalib::calibrate(&observations)?.verdict, Verdict::Unexplained);
//! let traced = rsicalib::trace(&observations, &SearchOptions::default())?;
//! assert_eq!((traced.verdict, &*traced.steps[0].target), (Verdict::Explained, "a22"));
//! # Ok::<(), rsicalib::Error>(())
//! ```
//!
//! A result is applied to other readings as [`Applied`]: `Applied::from(&traced)` gives
//! [`platform_poses`] and a mechanism to export ([`exported`]). [`Monitor::of`] watches the device at
//! work under a result, [`update`] compares a later session with it, and [`course`] says what a
//! parameter has done over results of years.
//!
//! The examples `calibrate` (a four-bar linkage that the example defines) and `trace` print
//! estimates: `cargo run --example calibrate`.
//!
//! # Stability
//!
//! The names at the root of the crate are stable, and so are those of [`mechanism`], of which a
//! mechanism is made, and of [`report`], of which results are made. All other modules are public
//! because the bindings need them, are not documented here, and may change in a minor version.
//!
//! Feature `toml`: mechanisms from TOML text. Feature `serde`: results as serde values. Feature `document`: results that Python
//! has written, read back.

#[cfg(test)]
extern crate self as rsicalib; // the tests' devices name the crate as users do

#[macro_use]
mod stated;
mod error;
mod text;

// Layers: each uses those above it and none below.

#[doc(hidden)]
pub mod numerics;

#[doc(hidden)]
pub mod closures;

pub mod mechanism;

#[doc(hidden)]
pub mod readings;

#[doc(hidden)]
pub mod kinematics;

#[doc(hidden)]
pub mod terms;

#[doc(hidden)]
pub mod model;

#[doc(hidden)]
pub mod estimate;

#[doc(hidden)]
pub mod apply;

#[doc(hidden)]
pub mod monitor;

#[doc(hidden)]
pub mod screening;

#[doc(hidden)]
pub mod diagnosis;

#[doc(hidden)]
pub mod history;

#[doc(hidden)]
pub mod population;

#[doc(hidden)]
pub mod design;

pub mod report;

pub use apply::earlier::{Applied, platform_poses};
pub use apply::export::{Exported, exported};
pub use diagnosis::options::SearchOptions;
pub use diagnosis::verdict::Verdict;
pub use error::Error;
pub use estimate::{FitOptions, Method, Observations};
pub use history::{Course, Jump, Past, course};
pub use mechanism::Mechanism;
pub use monitor::{Alarm, Monitor, MonitorOptions};
pub use readings::Table;
pub use report::calibrated::CalibrationReport as Calibration;
pub use report::front::{calibrate, trace, update};
pub use report::trace_report::TraceReport as Trace;
pub use report::update::Update;

#[doc(hidden)]
pub use estimate::{Fit, fit};
#[doc(hidden)]
pub use faer::Mat;
#[doc(hidden)]
pub use mechanism::Target;
#[doc(hidden)]
pub use model::{Instance, Model};
#[doc(hidden)]
pub use readings::Readings;

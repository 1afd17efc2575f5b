//! A calibration at work: every sample closes its loop or does not.
//!
//! A sample with readings `a` under the parameters `β` of a calibration has the whitened
//! misclosure `r = L⁻¹ w` of (51), and with `G = -L⁻¹ X`
//!
//! ```text
//! r_t = G_t δ + Z_t θ 1(t > τ) + ε_t,     δ ~ N(0, P₀)                   (101)
//! ```
//!
//! `δ` is what the calibration is wrong by, with its covariance `P₀`: it is the same in every
//! sample. `θ` is a change at time `τ`, with the columns `Z` of a channel, a closure or a chain.
//! A test that took `P₀` for noise of a sample would raise an alarm at every device in the end, as
//! the same error adds up. Here `δ` is estimated from all samples, beside every change that
//! is tested: with the sums `J = P₀⁻¹ + Σ GᵀG`, `b = Σ Gᵀr` of all samples and
//! `D_zz = Σ ZᵀZ`, `D_zg = Σ ZᵀG`, `d_z = Σ Zᵀr` of those after `τ`,
//!
//! ```text
//! M = D_zz - D_zg J⁻¹ D_gz,   u = d_z - D_zg J⁻¹ b,   T = uᵀ M⁻¹ u ~ χ²(rank M)   (102)
//! ```
//!
//! without a change, whatever `δ` is and whatever was tested before: that keeps a promised
//! rate of false alarms. `J⁻¹` and `J⁻¹ b` are covariance and mean of a Kalman filter whose state
//! stands still, updated sample by sample. The estimates of a change are `M⁻¹ u` with covariance
//! `M⁻¹`; the state takes them over, and the watch goes on.
//!
//! Neighbouring samples may be correlated: `r`, `G` and `Z` pass through the filter that makes
//! the residual white, learned from the residual itself (`whitening`). Its scale is learned, too.
//! Samples far outside wait until the next ones confirm them; a bad reading alone is counted and
//! left out. Onsets `τ` lie on a grid with windows of 8, 16, 32, … samples (`windows`), and
//! thresholds share the promised rate between all windows and candidates (`thresholds`). Noise with
//! heavier tails than the normal one is told by the tests themselves (`tails`).
//!
//! | symbol | here | |
//! |---|---|---|
//! | r, G, Z | `rows` | whitened misclosure and its derivatives of one sample |
//! | δ, J⁻¹, J⁻¹b | `state` | error of the calibration: covariance and mean |
//! | D, d | `windows` | sums since an onset |
//! | x, n, s | `tails` | how far out the tests of this device are by chance |
//! | M, u, T | `score` | score test of one candidate in one window |
//! | θ | `open`, `suspects`, `estimating`, `names`, `naming` | the change that is named, and corrected when later rows tell |
//! | ρ | `drift` | its rate, (106) |
//! | φ | `factor` | a gain, or the reference of all, (133) |
//! | τ, S | `unsteady` | what has another size in every row, (134), (135) |
//! | | `watching`, `watch` | what a watch holds, and what it does with a row |
//! | | `weighing` | two changes in one row, what is stuck, what has no name |

pub mod alarm;
mod any_angle;
pub mod by_parameters;
pub mod closing;
pub mod compare;
mod covariance;
mod drift;
mod estimating;
mod factor;
mod far;
mod kept;
mod names;
mod naming;
mod onsets;
mod open;
pub mod options;
mod order;
mod place;
mod platform;
mod recent;
mod rows;
mod runs;
mod saved;
mod score;
mod state;
mod suspects;
mod tails;
mod telling;
mod thresholds;
mod turned;
mod unsteady;
mod watch;
mod watched;
mod watching;
mod weighing;
mod whitening;
mod windows;

pub use alarm::{Action, Alarm, Change};
pub use options::{MonitorOptions, Quiet};
pub use order::Counts;
pub(crate) use watched::tells_by_rows;
pub use watching::Monitor;

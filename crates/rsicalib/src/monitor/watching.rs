//! What a watch holds.

use crate::monitor::alarm::Alarm;
use crate::monitor::open::Open;
use crate::monitor::order::{Counts, Order};
use crate::monitor::platform::Seen;
use crate::monitor::recent::Recent;
use crate::monitor::rows::Rows;
use crate::monitor::runs::Runs;
use crate::monitor::score::Score;
use crate::monitor::state::State;
use crate::monitor::tails::Tails;
use crate::monitor::thresholds::Thresholds;
use crate::monitor::unsteady::{Unsteady, Whitener};
use crate::monitor::watched::Watched;
use crate::monitor::whitening::Whitening;
use crate::monitor::windows::Windows;

/// Number of samples far outside, one after the other, that make a change of the device.
pub(super) const CONFIRMED: usize = 4;

/// A calibrated mechanism that is watched at work.
///
/// # Example
///
/// ```
/// use rsicalib::apply::earlier::Applied;
/// use rsicalib::monitor::{Monitor, MonitorOptions};
/// use rsicalib::{Error, Mechanism};
///
/// /// Watches rows of readings under a calibration and the covariance of its parameters.
/// fn watch(calibration: &Applied, covariance: &[f64], rows: &[[f64; 9]]) -> Result<(), Error> {
///     let options = MonitorOptions::default();
///     let mut monitor = Monitor::new(&Mechanism::rsi(), calibration, covariance, &options)?;
///     for row in rows {
///         for alarm in monitor.update(row, None) {
///             println!("{} has changed since row {}", alarm.spec, alarm.since_row);
///         }
///     }
///     Ok(())
/// }
/// // Without an uncertainty nothing says how far the loops of a sound device may be open.
/// assert!(watch(&Applied::default(), &[], &[]).is_err());
/// ```
pub struct Monitor {
    pub(super) watched: Watched,
    pub(super) order: Order,
    pub(super) counts: Counts,
    pub(super) rows: Rows,
    pub(super) whitening: Whitening,
    pub(super) state: State,
    pub(super) windows: Windows,
    pub(super) thresholds: Thresholds,
    pub(super) tails: Tails,
    pub(super) score: Score,
    pub(super) seen: Seen,
    /// Scale of the noise, as a variance, and the values that it is known from.
    pub(super) scale: f64,
    pub(super) dof: f64,
    /// Limit beyond which a sample is far outside.
    pub(super) outside: f64,
    /// Rows of samples far outside that wait to be confirmed.
    pub(super) waiting: [u64; CONFIRMED],
    pub(super) held: usize,
    /// Samples since the start, or since the last change.
    pub(super) age: u64,
    /// The last rows, to look at a change again.
    pub(super) recent: Recent,
    /// Room to linearise them.
    pub(super) again: Rows,
    /// Variance of a sample's squared innovation, over that of normal noise.
    pub(super) spread: f64,
    /// Promised rate of false alarms per sample.
    pub(super) rate: f64,
    pub(super) runs: Runs,
    /// Channels that are stuck: nothing is tested until they move again.
    pub(super) stuck: Vec<usize>,
    /// What has another size in every row.
    pub(super) unsteady: Vec<Unsteady>,
    pub(super) whitener: Whitener,
    /// Rows, times and places of the last alarms.
    pub(super) lately: Vec<(u64, (Option<f64>, String))>,
    /// True since it was told that what happens has no name: nothing is tested any more.
    pub(super) silent: bool,
    /// Rows in succession whose loops close again, while nothing is tested since something far off has no name.
    pub(super) out: Option<u64>,
    /// The last change, as long as its name is open.
    pub(super) open: Option<Open>,
    pub(super) r: Vec<f64>,
    pub(super) g: Vec<f64>,
    pub(super) alarms: Vec<Alarm>,
}

/// A row that is to be tested.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tested {
    pub(super) row: u64,
    pub(super) time: Option<f64>,
    /// Rows that are missing before it, if there is a gap; none of a gap of unknown length.
    pub(super) gap: Option<Option<u64>>,
}

impl Monitor {
    /// Values from which it is known how far a sample scatters, what is unsteady among them.
    pub(super) fn values(&self) -> f64 {
        self.unsteady.iter().map(Unsteady::values).fold(self.dof, f64::min)
    }

    /// Begins with new windows.
    pub(super) fn restart(&mut self) {
        self.windows.restart(self.watched.tested());
        self.whitening.interrupt();
    }
}

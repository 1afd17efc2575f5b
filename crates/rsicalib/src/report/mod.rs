//! Results as users hold them: plain structs in the shape of the JSON, and words.

#[doc(hidden)]
pub mod beside;
#[doc(hidden)]
pub mod between;
pub(crate) mod by_pose;
#[doc(hidden)]
pub mod calibrated;
#[cfg(feature = "document")]
#[doc(hidden)]
pub mod certificate;
#[doc(hidden)]
pub mod device;
#[cfg(feature = "document")]
#[doc(hidden)]
pub mod document;
#[cfg(feature = "document")]
#[doc(hidden)]
pub mod evidence;
pub(crate) mod front;
#[doc(hidden)]
pub mod named;
#[cfg(feature = "document")]
#[doc(hidden)]
pub mod read;
#[doc(hidden)]
pub mod result;
#[cfg(feature = "document")]
#[doc(hidden)]
pub mod schema;
mod touched_instead;
#[doc(hidden)]
pub mod trace_report;
#[doc(hidden)]
pub mod traced;
#[doc(hidden)]
pub mod update;
#[doc(hidden)]
pub mod warned;
#[doc(hidden)]
pub mod words;

pub use crate::apply::check::Check;
pub use crate::diagnosis::held_out::HeldOut;
pub use crate::diagnosis::verdict::Reason;
pub use crate::estimate::directions::ParameterReport;
pub use named::Named;
pub use result::{Estimates, ExcludedReport, FitReport, NoiseReport};
pub use trace_report::{Left, Place, RivalReport, StepReport, Unexplained};
pub use update::Changed;
pub use warned::{Kind, Warned};

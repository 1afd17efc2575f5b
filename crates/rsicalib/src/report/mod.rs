//! Results as users hold them: plain structs in the shape of the JSON, and words.

pub mod beside;
pub mod calibrated;
pub mod device;
#[cfg(feature = "document")]
pub mod document;
#[cfg(feature = "document")]
pub mod evidence;
pub mod front;
#[cfg(feature = "document")]
pub mod read;
pub mod result;
#[cfg(feature = "document")]
pub mod schema;
pub mod traced;
pub mod warned;
pub mod words;

//! Readings: tables, checks, and the layout for vector lanes.

mod along;
mod block;
pub mod codes;
pub(crate) mod context;
pub(crate) mod course;
pub(crate) mod doubled;
mod holding;
pub mod plain;
pub(crate) mod repeating;
pub mod sampled;
mod samples;
pub mod still;
mod table;
pub(crate) mod way;

pub(crate) use along::{along, ascending};
pub use block::Block;
pub use holding::Holding;
pub use samples::Readings;
pub(crate) use samples::{check, is_absent};
pub use table::{Part, Table};
pub(crate) use table::{as_of, average, runs_of, runs_of_poses};

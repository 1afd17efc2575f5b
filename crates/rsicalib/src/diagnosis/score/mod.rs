//! Score tests of every effect that a model lacks, from one linearisation.

pub mod candidates;
pub mod moved;
pub mod pairs;
pub mod periodic;
pub mod places;
pub mod projection;
pub mod scan;
pub mod scored;

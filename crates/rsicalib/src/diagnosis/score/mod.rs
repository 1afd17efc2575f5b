//! Score tests of every effect that a model lacks, from one linearisation.

pub mod bodies;
pub mod candidates;
pub mod pairs;
pub mod periodic;
pub mod places;
pub mod projection;
pub mod room;
pub mod scan;
pub mod scored;
pub mod times;

//! Which poses to visit, and what they can tell.
//!
//! A plan draws `candidates`, makes their rows at one point (`linearised`), and has poses chosen
//! (`choice`) that make its criterion small: a variance (`precision`) or the probability of a wrong
//! decision (`contest`).

pub mod bound;
mod candidates;
mod choice;
mod contest;
pub mod criterion;
mod forecast;
pub mod further;
pub mod guided;
mod hidden;
pub mod identifiability;
mod linearised;
mod moments;
pub mod observability;
pub mod plan;
mod precision;
pub mod purpose;
pub mod reach;
mod rivals;
pub mod suppose;
pub mod until;
mod visits;
pub mod within_limits;

//! Closures: the equations that hold in every pose, one kind in one file.
//!
//! A kind says how many equations it has, between what, how they change as its ends move, and how
//! large an error of a length is in them. The model owns the chain rule, and knows no kind by
//! name. A new kind is a file in this folder and a line in `kinds.rs`;
//! `laws.rs` has what it must pass.

pub mod distance;
pub mod equal;
pub mod kind;
mod kinds;
#[cfg(test)]
mod laws;
pub mod line;
pub mod plane;
pub mod touch;

pub use kinds::ClosureKind;

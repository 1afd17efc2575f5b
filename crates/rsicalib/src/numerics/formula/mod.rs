//! Formulas as text: parsed once, differentiated exactly, evaluated eight samples at a time.
//!
//! ```text
//! sum     = product { ("+" | "-") product }
//! product = sign { ("*" | "/") sign }
//! sign    = ("+" | "-") sign | power
//! power   = atom [ ("^" | "**") sign ]
//! atom    = number | pi | name [ "[" number "]" ] | function "(" sum { "," sum } ")" | "(" sum ")"
//! ```
//!
//! A formula becomes a [`Graph`]: a list of operations, each of which refers to earlier ones, and
//! in which no operation stands twice. Derivatives are more operations of the same list. A
//! [`Program`] is what some of its results need, in order, and no more.

mod graph;
mod parse;
mod program;

pub use graph::{Graph, Id};
pub use parse::{Misread, parse};
pub use program::Program;

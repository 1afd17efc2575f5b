//! What the pictures of a report are drawn from, beyond the result itself.

mod added_variable;
mod against;
mod drawing;
pub mod gather;
mod hypotheses;
mod known;
mod laws;
mod points;
mod reliability;
mod scores;
pub mod shapes;
mod switchboard;
mod thinned;
mod uncertain;
mod workspace;

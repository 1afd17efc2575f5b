//! A fit, or an earlier result, applied to readings: poses, points, known poses, the open loop.

pub mod change;
pub mod check;
pub mod earlier;
pub mod fixture;
pub mod poses;

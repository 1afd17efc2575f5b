//! A fit, or an earlier result, applied to readings: poses, points, known poses, the open loop.

pub mod accuracy;
pub mod change;
pub mod check;
pub mod earlier;
pub mod export;
pub mod fixture;
pub mod groups;
pub(crate) mod known;
pub mod moved;
pub mod placer;
pub mod places;
pub mod poses;
pub(crate) mod slopes;

//! A fit, or an earlier result, applied to readings: poses, points, known poses, the open loop.

pub mod accuracy;
pub mod budget;
pub mod change;
pub mod check;
pub mod coordinates;
pub mod decision;
pub mod earlier;
pub mod export;
pub mod fixture;
pub mod groups;
pub(crate) mod known;
pub mod misread;
pub mod moved;
pub mod placer;
pub mod places;
pub mod poses;
pub(crate) mod scale;
pub(crate) mod slopes;
pub mod unseen;

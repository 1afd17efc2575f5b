//! Readings that are wrong whatever the model lacks: converters, outliers, placements.

pub mod blame;
pub mod converter;
pub mod excluded;
pub mod fault;
pub mod outliers;
pub mod placements;
pub mod raw;
pub mod sound;
pub mod steps;

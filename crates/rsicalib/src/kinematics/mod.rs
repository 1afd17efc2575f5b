//! Forward kinematics of chains, eight samples at a time.

pub mod elements;
pub(crate) mod posture;
pub(crate) mod rigid;

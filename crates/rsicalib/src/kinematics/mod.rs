//! Forward kinematics of chains, eight samples at a time.

pub mod elements;
pub mod posture;
pub mod rigid;

//! Forward kinematics of chains, eight samples at a time.

pub mod posture;
pub mod rigid;
pub mod steps;

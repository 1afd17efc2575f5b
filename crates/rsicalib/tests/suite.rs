//! Tests of the library as its users have it, in one program: the library is linked once.

mod algebraic;
mod closures;
mod devices;
#[path = "devices/differences.rs"]
mod differences;
mod export;
mod faults;
mod fixture;
mod front;
mod identifiability;
mod lm;
mod main_path;
mod mechanism;
mod model;
mod nist;
mod objective;
mod paper;
mod plan;
mod public_input;
mod readme;
mod rsi;

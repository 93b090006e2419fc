//! `liveview video`.

#[path = "../common/mod.rs"]
mod common;

mod faults;
mod frames;
mod interrupts;
mod sources;

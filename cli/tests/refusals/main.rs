//! Invalid input, and failures outside the program.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../tests/scene_common/mod.rs"]
mod scene_common;
#[path = "../../../tests/wheel/mod.rs"]
mod wheel;

mod bad_input;
mod faults;
mod limits;
mod poison;

//! Every stage compared with the float64 oracle and float32 torch, on the goldens of
//! `parity/generate.py` (`make test-rust` generates them).
//!
//! The input of each stage is the output of the oracle's previous stage, rounded to float32, so the
//! first stage that fails is the one that is wrong. The bounds are in `parity/tolerances.json`.

mod golden;
mod guided;
mod stage_case;
mod stages;
#[cfg(feature = "surface")]
mod surface;
#[cfg(feature = "surface")]
mod surface_case;
mod tolerance;
#[path = "../wheel/mod.rs"]
mod wheel;

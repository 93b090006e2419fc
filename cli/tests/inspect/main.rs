//! Commands that render no picture: `inspect`, `select`, `depth`, `models` and `manual`.

#[path = "../common/mod.rs"]
mod common;

mod depth;
mod installed;
mod scenes;

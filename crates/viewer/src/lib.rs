//! A scene, or the video of a rig, as a page that draws it: baked into one file, or served while the depth of the photos is found.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod bake;
mod depth_code;
mod page;
#[cfg(feature = "server")]
mod server;

pub use bake::{Baked, bake};
#[cfg(feature = "server")]
pub use server::viewer::{Served, Shown, ViewSettings, Viewer};

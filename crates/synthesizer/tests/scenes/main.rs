//! Depth ranges of scenes, and real scenes.

mod real_scenes;
#[path = "../../../../tests/scene_common/mod.rs"]
mod scene_common;

//! Scenes and photos: the formats with poses worked out by hand, invalid files, other photo
//! sources, and pictures.

mod colmap;
mod folder;
mod folders;
mod jpeg;
mod llff;
mod photo_source;
mod pictures;
mod realestate10k;
#[path = "../../../../tests/scene_common/mod.rs"]
mod scene_common;
mod spaces;
mod transforms;
mod variants;

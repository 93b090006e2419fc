//! One module per format; each makes [`super::draft::Drafts`] of the files it knows.

pub(super) mod colmap;
mod json;
pub(super) mod llff;
pub(super) mod poses_bounds;
pub(super) mod realestate10k;
pub(super) mod spaces;
pub(super) mod transforms;

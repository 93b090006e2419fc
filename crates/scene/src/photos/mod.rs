//! The photos of a scene: in its folder or from any other source; and how the entries of a pose file
//! are matched with them.

pub(super) mod file;
pub(super) mod folder;
pub(super) mod lookup;
pub(super) mod source;

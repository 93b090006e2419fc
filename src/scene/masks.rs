//! Notes that say that masks are not used.

use std::path::Path;

/// Folders of masks that COLMAP, nerfstudio and gsplat write.
const FOLDERS: [&str; 5] = ["masks", "masks_2", "masks_4", "masks_8", "mask"];

/// One note for each folder of masks in a scene folder.
pub(super) fn folder_notes(root: &Path) -> impl Iterator<Item = String> {
    FOLDERS.into_iter().filter(move |folder| root.join(folder).is_dir()).map(note)
}

/// The note on masks that a scene holds in the folder or field `name`.
pub(super) fn note(name: &str) -> String {
    format!("{name}: masks are not supported, masked pixels are used like all others")
}

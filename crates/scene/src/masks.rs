//! Notes that say that masks are not used.

/// Folders of masks that COLMAP, nerfstudio and gsplat write.
pub(super) const FOLDERS: [&str; 5] = ["masks", "masks_2", "masks_4", "masks_8", "mask"];

/// The note on masks that a scene holds in the folder or field `name`.
pub(super) fn note(name: &str) -> String {
    format!("{name}: masks are not supported, masked pixels are used like all others")
}

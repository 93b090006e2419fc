//! Scenes in zip archives.

use std::fs::File;
use std::io;
use std::path::Path;

use zip::ZipArchive;

use crate::SceneError;
use liveview_files::bounded::check_regular;
use liveview_files::unfinished::Unfinished;

/// Largest size of all files of an archive, unpacked, bytes.
const MAX_BYTES: u128 = 16 << 30;

/// Unpacks an archive into a temporary folder, which is deleted when it is dropped.
pub(crate) fn unpack(path: &Path) -> Result<Unfinished, SceneError> {
    let failed = |source: io::Error| SceneError::Read { path: path.to_owned(), source };
    check_regular(path).map_err(failed)?;
    let mut archive = ZipArchive::new(File::open(path).map_err(failed)?).map_err(|error| failed(error.into()))?;
    let folder = Unfinished::folder().map_err(failed)?;
    if archive.decompressed_size().is_none_or(|bytes| bytes > MAX_BYTES) {
        let what = format!("more than {} GB unpacked", MAX_BYTES >> 30);
        return Err(SceneError::malformed(path, what, "a smaller archive, or its folder"));
    }
    archive.extract(folder.path()).map_err(|error| failed(error.into()))?;
    Ok(folder)
}

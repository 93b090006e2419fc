//! Files written completely or not at all: under a temporary name, then renamed. Devices and pipes
//! are written to directly.

use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::unfinished::Unfinished;

/// Prefix of all temporary names. Files of a killed process with this prefix may be deleted.
pub const TEMPORARY: &str = ".liveview-tmp-";

/// A file being written under its own temporary name, in the folder of the final file. It is
/// deleted if it is dropped without [`AtomicFile::finish`], and by [`delete_all`] before a signal ends
/// the process. A [special file](is_special) is written to directly.
///
/// [`delete_all`]: super::unfinished::delete_all
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<File>,
    /// `None` for a special file.
    temporary: Option<Unfinished>,
    path: PathBuf,
}

impl AtomicFile {
    /// Creates the temporary file for `path`, with the same extension. Blocks on a pipe until it
    /// has a reader.
    ///
    /// # Errors
    ///
    /// Those of creating a file in `path`'s folder, or of opening a special file.
    pub fn create(path: &Path) -> io::Result<Self> {
        if is_special(path) {
            let file = BufWriter::new(OpenOptions::new().append(true).open(path)?);
            return Ok(Self { file, temporary: None, path: path.to_owned() });
        }
        let mut ending = OsString::new();
        if let Some(extension) = path.extension() {
            ending.push(".");
            ending.push(extension);
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Opened here because only their owner may read the files that tempfile opens.
        let open = |name: &Path| OpenOptions::new().write(true).create_new(true).open(name);
        let (file, temporary) = Unfinished::create(|| {
            Ok(tempfile::Builder::new().prefix(TEMPORARY).suffix(&ending).make_in(folder, open)?.keep()?)
        })?;
        let file = BufWriter::new(file);
        Ok(Self { file, temporary: Some(temporary), path: path.to_owned() })
    }

    /// The temporary name, for a program that writes the file by itself.
    pub fn temporary(&self) -> &Path {
        self.temporary.as_ref().map_or(&self.path, Unfinished::path)
    }

    /// Gives the file its name; a file of that name is replaced.
    ///
    /// # Errors
    ///
    /// Those of writing what was buffered, of storing it (some file systems report only then that
    /// they are full) and of renaming. On an error the temporary file is deleted, and an existing
    /// file at `path` is unchanged.
    pub fn finish(self) -> io::Result<()> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        if let Some(temporary) = self.temporary {
            file.sync_data()?;
            temporary.rename(&self.path)?;
        }
        Ok(())
    }
}

/// Whether a path names a device, a pipe or a file that this process has open (`/dev/stderr`),
/// which must not be replaced.
pub fn is_special(path: &Path) -> bool {
    let of_process = |path: &Path| path.starts_with("/proc");
    let open = || {
        path.read_link().is_ok_and(|target| of_process(&target))
            || path.parent().and_then(|folder| folder.canonicalize().ok()).is_some_and(|folder| of_process(&folder))
    };
    path.metadata().is_ok_and(|about| !about.is_dir() && (!about.is_file() || open()))
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes a complete file, or none.
///
/// # Errors
///
/// Those of [`AtomicFile`].
pub fn write(path: &Path, contents: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(contents)?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn file_appears_only_when_finished() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("a.txt");
        write(&path, b"first").unwrap();
        let mut files = [0, 1].map(|_| AtomicFile::create(&path).unwrap());
        assert_ne!(files[0].temporary(), files[1].temporary());
        for (file, text) in files.iter_mut().zip(["second", "third"]) {
            file.write_all(text.as_bytes()).unwrap();
            assert!(file.temporary().file_name().unwrap().to_str().unwrap().starts_with(TEMPORARY));
            assert_eq!(file.temporary().extension(), path.extension());
        }
        assert_eq!((std::fs::read(&path).unwrap(), names(root.path()).len()), (b"first".to_vec(), 3));
        let [second, third] = files;
        third.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        drop(second);
        assert_eq!((std::fs::read(&path).unwrap(), names(root.path())), (b"third".to_vec(), vec!["a.txt".to_owned()]));
    }

    #[cfg(unix)]
    #[test]
    fn special_file_is_written_to_and_not_replaced() {
        let root = tempfile::tempdir().unwrap();
        let [null, own] = ["null", "own"].map(|name| root.path().join(name));
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write(&null, b"text").unwrap();
        assert!(null.symlink_metadata().unwrap().is_symlink() && is_special(&null));
        write(&own, b"first ").unwrap();
        assert!(!is_special(&own));
        let open = OpenOptions::new().append(true).open(&own).unwrap();
        let path = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&open));
        if Path::new(&path).exists() {
            write(path.as_ref(), b"second").unwrap();
            assert_eq!(std::fs::read(&own).unwrap(), b"first second");
        }
        assert_eq!(names(root.path()).len(), 2);
    }

    #[test]
    fn write_to_the_name_of_a_folder_is_an_error_and_leaves_no_file() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("a");
        std::fs::create_dir(&path).unwrap();
        write(&path, b"text").unwrap_err();
        assert_eq!(names(root.path()), ["a"]);
    }
}

//! Files and folders that are deleted unless they are finished, also by a signal that ends the
//! process.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// How often a folder that is filled while it is deleted is deleted again, at most.
const DELETIONS: usize = 100;

/// All that this process has not finished.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn list() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file or a folder that is deleted when this is dropped, and by [`delete_all`].
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// A new folder for temporary files, in the system's.
    ///
    /// # Errors
    ///
    /// Those of creating it.
    pub fn folder() -> io::Result<Self> {
        Self::create(|| Ok(((), tempfile::tempdir()?.keep()))).map(|((), folder)| folder)
    }

    /// What `create` creates, at the path that it returns. Listed under the same lock, so that
    /// [`delete_all`] cannot come in between.
    pub(super) fn create<T>(create: impl FnOnce() -> io::Result<(T, PathBuf)>) -> io::Result<(T, Self)> {
        let mut list = list();
        let (created, path) = create()?;
        list.insert(path.clone());
        Ok((created, Self(path)))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Gives the file its name; a file of that name is replaced.
    pub(super) fn rename(self, path: &Path) -> io::Result<()> {
        fs::rename(&self.0, path)
    }
}

impl Drop for Unfinished {
    /// Deletes it, if it was not renamed: its name is random and not used again.
    fn drop(&mut self) {
        delete(&self.0);
        list().remove(&self.0);
    }
}

/// Deletes all unfinished files and folders. The process must end now: to create another would wait
/// for ever.
pub fn delete_all() {
    let list = list();
    list.iter().for_each(|path| delete(path));
    std::mem::forget(list);
}

fn delete(path: &Path) {
    // Errors cannot be reported: the process may be ending.
    if !path.is_dir() {
        let _ = fs::remove_file(path);
        return;
    }
    // Under another name no other thread begins to create a file in it; one that has begun may fill
    // it again once.
    let renamed = path.with_extension("deleted");
    let path = if fs::rename(path, &renamed).is_ok() { &renamed } else { path };
    let is_filled_again = |error: io::Error| error.kind() == ErrorKind::DirectoryNotEmpty;
    let _ = (0..DELETIONS).find(|_| !fs::remove_dir_all(path).is_err_and(is_filled_again));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folder_that_another_thread_fills_is_deleted() {
        for _ in 0..50 {
            let folder = Unfinished::folder().unwrap();
            let path = folder.path().to_owned();
            let fill = || (0..).take_while(|index| fs::write(path.join(index.to_string()), "").is_ok()).count();
            std::thread::scope(|scope| {
                let filled = scope.spawn(fill);
                while fs::read_dir(&path).unwrap().count() == 0 {}
                delete(&path);
                assert!(!path.exists() && !path.with_extension("deleted").exists());
                assert!(filled.join().unwrap() > 0);
            });
        }
    }
}

//! Flash contents in a file, which preserves them between runs.

use std::fmt;
use std::fs::{File, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use simulator::rig::STORE_BYTES;

/// Contents of the module's flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlashImage(pub(super) Vec<u8>);

/// Error of reading or writing a flash file.
#[derive(Debug)]
pub enum FlashImageError {
    /// The file cannot be read.
    Unreadable(PathBuf, io::Error),
    /// The file has a wrong size, given in bytes.
    Size(PathBuf, u64),
    /// The file cannot be written.
    Unwritable(PathBuf, io::Error),
    /// Another module has locked the file.
    InUse(PathBuf),
}

impl FlashImageError {
    /// Stable error code for scripts.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Unreadable(..) => "flash-unreadable",
            Self::Size(..) => "flash-size",
            Self::Unwritable(..) => "flash-unwritable",
            Self::InUse(_) => "flash-in-use",
        }
    }
}

impl fmt::Display for FlashImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Size(path, bytes) => write!(
                f,
                "{}: a flash of this module has {STORE_BYTES} bytes, this file has {bytes}; name another, or none that is \
                 there yet",
                path.display()
            ),
            Self::InUse(path) => {
                write!(f, "{}: another served module uses this file; end it, or name another file", path.display())
            }
            Self::Unwritable(path, error) => write!(f, "{} cannot be written: {error}", path.display()),
        }
    }
}

impl std::error::Error for FlashImageError {}

impl FlashImage {
    /// Flash contents.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Locks a file against other modules until the handle is dropped, and reads it; `None` if it does not exist.
    ///
    /// # Errors
    ///
    /// The file cannot be read, has a wrong size, or is locked.
    pub fn lock_and_read(path: &Path) -> Result<Option<(File, Self)>, FlashImageError> {
        let unreadable = |error| FlashImageError::Unreadable(path.to_owned(), error);
        let file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(unreadable(error)),
            Ok(file) => file,
        };
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(FlashImageError::InUse(path.to_owned())),
            Err(TryLockError::Error(error)) => return Err(unreadable(error)),
        }
        // Reads through the locked handle, as Windows requires, at most one byte more than the size, in case the file
        // is endless.
        let mut bytes = Vec::new();
        (&file).take(STORE_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() != STORE_BYTES {
            let size = file.metadata().map_err(unreadable)?.len();
            return Err(FlashImageError::Size(path.to_owned(), size));
        }
        Ok(Some((file, Self(bytes))))
    }

    /// Writes the file atomically through a temporary file in the same directory; returns it, locked against other
    /// modules until the handle is dropped.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write_file(&self, path: &Path) -> Result<File, FlashImageError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let written = tempfile::NamedTempFile::new_in(folder).and_then(|mut file| {
            file.write_all(&self.0)?;
            file.as_file().sync_all()?;
            file.as_file().try_lock()?;
            Ok(file.persist(path)?)
        });
        written.map_err(|error| FlashImageError::Unwritable(path.to_owned(), error))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(path: &Path) -> Option<FlashImage> {
        FlashImage::lock_and_read(path).unwrap().map(|(_, image)| image)
    }

    #[test]
    fn a_written_image_is_read_back_without_temporary_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash.bin");
        assert_eq!(read(&path), None);
        for fill in [0x5A, 0xA5] {
            let image = FlashImage(vec![fill; STORE_BYTES]);
            image.write_file(&path).unwrap();
            assert_eq!(read(&path), Some(image));
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Writing replaces the file; the lock then is on the new file.
    #[test]
    fn a_file_in_use_is_locked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash.bin");
        assert!(read(&path).is_none());
        let image = FlashImage(vec![0x5A; STORE_BYTES]);
        let first = image.write_file(&path).unwrap();
        assert_eq!(FlashImage::lock_and_read(&path).unwrap_err().stable_code(), "flash-in-use");
        let second = image.write_file(&path).unwrap();
        drop(first);
        assert_eq!(FlashImage::lock_and_read(&path).unwrap_err().stable_code(), "flash-in-use");
        drop(second);
        assert!(read(&path).is_some());
    }

    #[test]
    fn a_file_of_wrong_size_is_rejected_with_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash.bin");
        for size in [0, 1, STORE_BYTES - 1, STORE_BYTES + 1] {
            fs::write(&path, vec![0xFF; size]).unwrap();
            let error = FlashImage::lock_and_read(&path).unwrap_err();
            assert_eq!(error.stable_code(), "flash-size");
            assert!(error.to_string().contains(&format!("16384 bytes, this file has {size};")), "{error}");
            assert_eq!(fs::read(&path).unwrap().len(), size, "it is left as it was");
        }
        assert!(matches!(FlashImage::lock_and_read(Path::new("/dev/zero")).unwrap_err(), FlashImageError::Size(_, 0)));
        let nowhere = folder.path().join("none").join("flash.bin");
        let error = FlashImage(vec![0; STORE_BYTES]).write_file(&nowhere).unwrap_err();
        assert_eq!(error.stable_code(), "flash-unwritable");
    }
}

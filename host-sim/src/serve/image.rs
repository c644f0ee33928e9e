//! The flash in a file, so that a module remembers when it is served again.

use std::fmt;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::rig::STORE_BYTES;

/// What the module's flash holds, byte by byte.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image(pub(super) Vec<u8>);

/// Why a file is no flash, or cannot be written.
#[derive(Debug)]
pub enum ImageError {
    /// It cannot be read.
    Unreadable(PathBuf, io::Error),
    /// It is there, but has so many bytes.
    Size(PathBuf, u64),
    /// It cannot be written.
    Unwritable(PathBuf, io::Error),
}

impl ImageError {
    /// A stable code for scripts.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Unreadable(..) => "flash-unreadable",
            Self::Size(..) => "flash-size",
            Self::Unwritable(..) => "flash-unwritable",
        }
    }
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Size(path, bytes) => write!(
                f,
                "{}: a flash of this module has {STORE_BYTES} bytes, this file has {bytes}; name another, or none that is \
                 there yet",
                path.display()
            ),
            Self::Unwritable(path, error) => write!(f, "{} cannot be written: {error}", path.display()),
        }
    }
}

impl std::error::Error for ImageError {}

impl Image {
    /// Its bytes, as many as the module's flash has.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Reads a file; none if there is none yet.
    ///
    /// # Errors
    ///
    /// [`ImageError`] when it cannot be read or is not of a flash's size.
    pub fn read(path: &Path) -> Result<Option<Self>, ImageError> {
        let unreadable = |error| ImageError::Unreadable(path.to_owned(), error);
        // Its size first: a path to something endless is not read.
        let bytes = match fs::metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(unreadable(error)),
            Ok(there) if there.len() != STORE_BYTES as u64 => {
                return Err(ImageError::Size(path.to_owned(), there.len()));
            }
            Ok(_) => fs::read(path).map_err(unreadable)?,
        };
        if bytes.len() == STORE_BYTES {
            Ok(Some(Self(bytes)))
        } else {
            Err(ImageError::Size(path.to_owned(), bytes.len() as u64))
        }
    }

    /// Writes a file: another beside it, which then takes its place, so that there is a whole one whenever this ends.
    ///
    /// # Errors
    ///
    /// [`ImageError::Unwritable`].
    pub fn write(&self, path: &Path) -> Result<(), ImageError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let written = tempfile::NamedTempFile::new_in(folder).and_then(|mut file| {
            file.write_all(&self.0)?;
            file.as_file().sync_all()?;
            file.persist(path)?;
            Ok(())
        });
        written.map_err(|error| ImageError::Unwritable(path.to_owned(), error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash.bin");
        assert_eq!(Image::read(&path).unwrap(), None);
        for fill in [0x5A, 0xA5] {
            let image = Image(vec![fill; STORE_BYTES]);
            image.write(&path).unwrap();
            assert_eq!(Image::read(&path).unwrap(), Some(image));
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_that_is_no_flash_is_told_with_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash.bin");
        for size in [0, 1, STORE_BYTES - 1, STORE_BYTES + 1] {
            fs::write(&path, vec![0xFF; size]).unwrap();
            let error = Image::read(&path).unwrap_err();
            assert_eq!(error.code(), "flash-size");
            assert!(error.to_string().contains(&format!("16384 bytes, this file has {size};")), "{error}");
            assert_eq!(fs::read(&path).unwrap().len(), size, "it is left as it was");
        }
        assert!(matches!(Image::read(Path::new("/dev/zero")).unwrap_err(), ImageError::Size(_, 0)));
        let nowhere = folder.path().join("none").join("flash.bin");
        let error = Image(vec![0; STORE_BYTES]).write(&nowhere).unwrap_err();
        assert_eq!(error.code(), "flash-unwritable");
    }
}

//! File of the module's flash.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::serve::{FlashImage, FlashImageError, ServedModule};

use host_sim::command_failure::CommandFailure;

/// Writes the flash to its file after each change, and keeps the file locked.
#[derive(Default)]
pub struct FlashWriter {
    path: Option<PathBuf>,
    locked_file: Option<File>,
    written_change_count: u64,
    seen_change_count: u64,
}

impl FlashWriter {
    /// Locks and reads a file.
    pub fn open_file(path: Option<&Path>) -> Result<(Self, Option<FlashImage>), CommandFailure> {
        let (locked_file, image) =
            path.map(FlashImage::lock_and_read).transpose().map_err(flash_failure)?.flatten().unzip();
        Ok((Self { path: path.map(Path::to_owned), locked_file, ..Self::default() }, image))
    }

    /// Writes the module's flash contents to the file.
    pub fn write_flash(&mut self, served_module: &ServedModule) -> Result<(), CommandFailure> {
        if let Some(path) = &self.path {
            if cfg!(windows) {
                // Windows cannot replace an open file, so the locked file is closed first.
                self.locked_file = None;
            }
            self.locked_file = Some(served_module.flash_image().write_file(path).map_err(flash_failure)?);
        }
        Ok(())
    }

    /// Writes the file if the flash changed and is stable since the last call, or at the end.
    pub fn write_if_stable(&mut self, served_module: &ServedModule, is_end: bool) -> Result<(), CommandFailure> {
        let changes = served_module.flash_change_count();
        let is_stable = changes == self.seen_change_count || is_end;
        self.seen_change_count = changes;
        if is_stable && changes != self.written_change_count {
            self.write_flash(served_module)?;
            self.written_change_count = changes;
        }
        Ok(())
    }
}

fn flash_failure(error: FlashImageError) -> CommandFailure {
    CommandFailure::with_code(error.stable_code(), error)
}

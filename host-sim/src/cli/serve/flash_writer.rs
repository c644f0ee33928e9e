//! File of the module's flash.

use std::path::Path;

use host_sim::serve::ServedModule;

use crate::cli::failure::Failure;

/// Writes the flash to its file after each change.
pub struct FlashWriter<'a> {
    path: Option<&'a Path>,
    written_changes: u64,
    seen_changes: u64,
}

impl<'a> FlashWriter<'a> {
    pub fn new(path: Option<&'a Path>) -> Self {
        Self { path, written_changes: 0, seen_changes: 0 }
    }

    /// Writes if the content changed and is stable since the last call, or at the end.
    pub fn look(&mut self, served_module: &ServedModule, is_end: bool) -> Result<(), Failure> {
        let Some(path) = self.path else { return Ok(()) };
        let changes = served_module.flash_changes();
        let rests = changes == self.seen_changes || is_end;
        self.seen_changes = changes;
        if rests && changes != self.written_changes {
            served_module.flash().write(path).map_err(|error| Failure::with_code(error.code(), error))?;
            self.written_changes = changes;
        }
        Ok(())
    }
}

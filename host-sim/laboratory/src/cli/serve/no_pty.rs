//! Replaces `pty.rs` on systems without pseudo-terminals, such as Windows.

use super::byte_connections::OpenedPty;
use host_sim::command_failure::CommandFailure;

/// Opens nothing: without pseudo-terminals the module is served on TCP ports alone.
#[expect(clippy::unnecessary_wraps, reason = "as on Unix, where it can fail")]
pub fn open_pty() -> Result<Option<OpenedPty>, CommandFailure> {
    Ok(None)
}

//! Replaces `pty.rs` on systems without pseudo-terminals, such as Windows.

use std::net::TcpStream;
use std::path::Path;

use super::byte_connections::{Connection, OpenedPty};
use host_sim::command_failure::CommandFailure;

/// Opens nothing: without pseudo-terminals the module is served on TCP ports alone.
#[expect(clippy::unnecessary_wraps, reason = "as on Unix, where it can fail")]
pub fn open_pty() -> Result<Option<OpenedPty>, CommandFailure> {
    Ok(None)
}

/// Always fails: on this system serial ports are no files. The return type is that of `pty.rs`.
pub fn connect_serial(path: &Path) -> Result<Connection<TcpStream>, CommandFailure> {
    let reason =
        "this system's serial ports are no files; use a terminal program such as PuTTY, or, for a served module, --tcp";
    Err(CommandFailure::with_code("no-serial", format!("{}: {reason}", path.display())))
}

//! Streams of local sockets, by which QEMU is connected.

use std::io;
use std::path::Path;

/// Whether this system has local sockets. Without them, as on Windows, no emulator starts.
pub const ARE_LOCAL_SOCKETS_SUPPORTED: bool = cfg!(unix);

#[cfg(unix)]
pub use std::os::unix::net::UnixStream as LocalStream;

/// Type in the place of a local socket, which this system does not have; never connected.
#[cfg(not(unix))]
pub use std::net::TcpStream as LocalStream;

/// Connects to a socket.
#[cfg(unix)]
pub fn connect_socket(socket: &Path) -> io::Result<LocalStream> {
    LocalStream::connect(socket)
}

/// Fails: see [`ARE_LOCAL_SOCKETS_SUPPORTED`].
#[cfg(not(unix))]
pub fn connect_socket(_socket: &Path) -> io::Result<LocalStream> {
    Err(io::ErrorKind::Unsupported.into())
}

//! Pseudo-terminals, files of Unix. Other systems have `no_pty.rs`.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::{FdFlags, fcntl_setfd, ioctl_fionbio};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::byte_connections::{BufferedStream, ByteConnection, OpenedPty};
use host_sim::command_failure::CommandFailure;

/// A pseudo-terminal with its path, closed when dropped.
pub fn open_pty() -> Result<Option<OpenedPty>, CommandFailure> {
    let pty = Pty::open_pty().map_err(|error| CommandFailure::with_code("no-pty", error))?;
    let path = pty.path.clone();
    Ok(Some((Box::new(pty), path)))
}

struct Pty {
    master: BufferedStream<File>,
    is_attached: bool,
    path: PathBuf,
}

impl Pty {
    fn open_pty() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        // Close-on-exec is set by a second call: on macOS openpt has no flag for it.
        fcntl_setfd(&master, FdFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = PathBuf::from(ptsname(&master, Vec::new())?.to_string_lossy().into_owned());
        ioctl_fionbio(&master, true)?;
        // The pseudo-terminal is opened and closed once: before that, an absent far end is not reported.
        make_raw(&open_terminal(&path)?)?;
        Ok(Self { master: BufferedStream::new(File::from(master)), is_attached: false, path })
    }
}

impl ByteConnection for Pty {
    fn read_bytes(&mut self, max_bytes: usize) -> Vec<u8> {
        self.master.read_bytes(max_bytes)
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.master.write_bytes(bytes);
    }

    fn take_notices(&mut self) -> Vec<String> {
        let is_attached = !self.master.is_disconnected;
        let has_changed = std::mem::replace(&mut self.is_attached, is_attached) != is_attached;
        let change = if is_attached { "attached to" } else { "detached from" };
        has_changed.then(|| format!("a program {change} {}", self.path.display())).into_iter().collect()
    }
}

fn open_terminal(path: &Path) -> io::Result<File> {
    let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits().cast_signed();
    OpenOptions::new().read(true).write(true).custom_flags(flags).open(path)
}

/// Disables echo, translation and control characters.
fn make_raw(terminal: &File) -> io::Result<()> {
    let mut settings = tcgetattr(terminal)?;
    settings.make_raw();
    Ok(tcsetattr(terminal, OptionalActions::Now, &settings)?)
}

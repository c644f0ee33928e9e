//! Emulator errors.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Program that emulates the machine.
pub(super) const QEMU_PROGRAM: &str = "qemu-system-arm";

/// Reason why the emulator did not start or has ended.
#[derive(Debug)]
pub enum EmulatorError {
    /// QEMU could not be started.
    NoQemu(io::Error),
    /// This system has no local sockets to connect QEMU by.
    NoLocalSockets,
    /// No file at this path.
    NoImage(PathBuf),
    /// The file at this path is not a firmware image; its actual type.
    NotFirmware(PathBuf, &'static str),
    /// Stopped on request of the caller.
    Interrupted,
    /// QEMU has ended; contains its output.
    Ended(String),
    /// A connection to QEMU failed; its purpose.
    Connection(&'static str, io::Error),
    /// QEMU sent an unexpected message; its text.
    Protocol(String),
}

impl EmulatorError {
    /// Stable error code for scripts.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::NoQemu(_) => "no-qemu",
            Self::NoLocalSockets => "no-local-sockets",
            Self::NoImage(_) => "no-image",
            Self::NotFirmware(..) => "not-firmware",
            Self::Interrupted => "interrupted",
            Self::Ended(_) => "emulator-ended",
            Self::Connection(..) => "emulator-connection",
            Self::Protocol(_) => "emulator-protocol",
        }
    }
}

impl fmt::Display for EmulatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoQemu(error) => write!(
                f,
                "{QEMU_PROGRAM} cannot be started ({error}); install QEMU's system emulator for ARM, on Debian: \
                 apt-get install qemu-system-arm"
            ),
            Self::NoLocalSockets => f.write_str(
                "the emulator needs Unix sockets, which this system does not have; emulate on Linux or macOS, or fly the \
                 same code without an emulator: host-sim fly",
            ),
            Self::NoImage(path) => {
                write!(f, "no firmware at {}; build it: scripts/build-firmware", path.display())
            }
            Self::NotFirmware(path, detail) => {
                write!(
                    f,
                    "{} is no firmware: {detail}; scripts/build-firmware makes target/firmware/*.elf",
                    path.display()
                )
            }
            Self::Interrupted => f.write_str("interrupted"),
            Self::Ended(output) => write!(f, "{QEMU_PROGRAM} has ended: {}", output.trim()),
            Self::Connection(detail, error) => write!(f, "the emulator's {detail}: {error}"),
            Self::Protocol(response) => write!(f, "the emulator reported: {response}"),
        }
    }
}

impl std::error::Error for EmulatorError {}

//! What can go wrong with an emulator.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Why there is no emulator, or no longer.
#[derive(Debug)]
pub enum EmulatorError {
    /// The program cannot be started.
    NoQemu(io::Error),
    /// There is no firmware image at this place.
    NoImage(PathBuf),
    /// What is at this place is no firmware; what it is instead.
    NotFirmware(PathBuf, &'static str),
    /// Whoever runs it wants it to end.
    Interrupted,
    /// It has ended by itself; what it said.
    Ended(String),
    /// A connection to it failed; what for.
    Connection(&'static str, io::Error),
    /// It answered what was not asked; what it said.
    Protocol(String),
}

impl EmulatorError {
    /// A stable code for scripts.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NoQemu(_) => "no-qemu",
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
                "{} cannot be started ({error}); install QEMU's system emulator for ARM, on Debian: \
                 apt-get install qemu-system-arm",
                super::QEMU
            ),
            Self::NoImage(path) => {
                write!(f, "no firmware at {}; build it: scripts/build-firmware", path.display())
            }
            Self::NotFirmware(path, what) => {
                write!(
                    f,
                    "{} is no firmware: {what}; scripts/build-firmware makes target/firmware/*.elf",
                    path.display()
                )
            }
            Self::Interrupted => f.write_str("interrupted"),
            Self::Ended(said) => write!(f, "{} has ended: {}", super::QEMU, said.trim()),
            Self::Connection(what, error) => write!(f, "the emulator's {what}: {error}"),
            Self::Protocol(said) => write!(f, "the emulator said: {said}"),
        }
    }
}

impl std::error::Error for EmulatorError {}

//! Error of the store.

/// Error of a load or a save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The flash failed to read, write or erase.
    Flash,
    /// The flash did not complete a save in time.
    Timeout,
    /// Stored bytes are damaged.
    Corrupt,
    /// The store has another format.
    OtherFormat(u8),
    /// A value is too long for its place in the store.
    Full,
    /// The written bytes read back differently.
    ReadBackDiffers,
    /// A value is out of its range. Nothing was written.
    Invalid,
}

impl core::fmt::Display for StoreError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Flash => "the flash memory failed",
            Self::Timeout => "the flash memory did not complete a save in time",
            Self::Corrupt => "the stored data are damaged",
            Self::OtherFormat(_) => "another firmware wrote the stored data",
            Self::Full => "the data do not fit into the flash region",
            Self::ReadBackDiffers => "the written data read back differently",
            Self::Invalid => "a value is out of its range, and nothing was written",
        })
    }
}

impl core::error::Error for StoreError {}

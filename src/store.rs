//! What the module remembers without power: settings and two generations of calibration, in NOR flash.
//!
//! # What is promised
//!
//! - A save is atomic: when power fails at any instant of it, the next start finds what was stored before or what was
//!   to be stored, complete. Settings and calibrations are one item of a log that goes round the region
//!   ([`sequential_storage`]), and the page that is erased for new items never holds the valid one, so that not even
//!   an erase that breaks off half-way can touch it.
//! - Nothing that comes out of the flash is trusted: every value is checked by CRC, version and range. No content of
//!   the region makes a load or a save panic.
//! - A region that holds garbage does not brick the module: a save that cannot be written in the log erases the region
//!   and writes again.
//!
//! # What is not
//!
//! That erase is the one moment at which a power failure loses what was stored, and a readable log can lead to it: a
//! power failure that tears the marker which closes a full page leaves a word that refuses the next save. So two
//! failures, one at that marker and one in the erase of the save after it, leave the module uncalibrated.

mod contents;
#[cfg(test)]
mod tests;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

use contents::{Contents, VALUE_SIZE};
pub use contents::{Generations, Record, Settings};

/// The only key of the map.
const KEY: u8 = 0;
/// For one item of the map: key and value, rounded up to any flash's word (the map allows 32 bytes).
const ITEM_SIZE: usize = (1 + VALUE_SIZE).next_multiple_of(32);

/// Why something could not be loaded or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The flash refused to read, write or erase.
    Flash,
    /// What is stored cannot be understood.
    Corrupt,
    /// What is stored was written by a firmware with this later (or much earlier) version of the format.
    UnknownVersion(u8),
    /// The value does not fit into the region.
    Full,
    /// What was written reads back differently.
    Verify,
    /// The value is out of its range (see [`Settings::is_valid`], [`Record::is_valid`]); nothing was written.
    Invalid,
}

impl StoreError {
    /// A stable code for people and programs.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Flash => "store-flash",
            Self::Corrupt => "store-corrupt",
            Self::UnknownVersion(_) => "store-version",
            Self::Full => "store-full",
            Self::Verify => "store-verify",
            Self::Invalid => "store-invalid",
        }
    }
}

/// What to do about it, in words.
impl core::fmt::Display for StoreError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Flash => "the flash memory failed; try again, then replace the board",
            Self::Corrupt => "what was stored is damaged; calibrate anew",
            Self::UnknownVersion(_) => "it was stored by another firmware; calibrate anew or load that firmware",
            Self::Full => "it does not fit; this is a fault of the firmware, please report it",
            Self::Verify => "what was written reads back differently; try again, then replace the board",
            Self::Invalid => "a value is out of its range; nothing was written",
        })
    }
}

impl<E> From<sequential_storage::Error<E>> for StoreError {
    fn from(error: sequential_storage::Error<E>) -> Self {
        use sequential_storage::Error;
        match error {
            Error::Storage { .. } => Self::Flash,
            Error::FullStorage | Error::ItemTooBig => Self::Full,
            // An item longer than the buffer, or without a key, is none that this module wrote.
            _ => Self::Corrupt,
        }
    }
}

/// The store: a region of a NOR flash.
pub struct Store<F: NorFlash> {
    map: MapStorage<u8, F, Cache<Uncached, Uncached, Uncached, u8>>,
}

impl<F: NorFlash> Store<F> {
    /// A store in this region of the flash, as offsets from the flash's start. The flash is not touched yet.
    ///
    /// # Panics
    ///
    /// If the region is not made of at least two whole pages: a mistake in a board's memory map, seen at its first
    /// start.
    #[must_use]
    pub const fn new(flash: F, region: Range<u32>) -> Self {
        Self { map: MapStorage::new(flash, MapConfig::new(region), Cache::new_uncached()) }
    }

    /// The settings; the default ones when none were ever stored.
    pub async fn load_settings(&mut self) -> Result<Settings, StoreError> {
        Ok(self.load().await?.settings)
    }

    /// The calibrations; none when none were ever stored.
    pub async fn load_generations(&mut self) -> Result<Generations, StoreError> {
        Ok(self.load().await?.generations)
    }

    /// Stores settings, leaving the calibrations as they are.
    pub async fn save_settings(&mut self, settings: &Settings) -> Result<(), StoreError> {
        let old = self.load_for_change().await?;
        self.save(&Contents { settings: *settings, ..old }).await
    }

    /// Stores calibrations, leaving the settings as they are.
    pub async fn save_generations(&mut self, generations: &Generations) -> Result<(), StoreError> {
        let old = self.load_for_change().await?;
        self.save(&Contents { generations: *generations, ..old }).await
    }

    async fn load(&mut self) -> Result<Contents, StoreError> {
        let mut buffer = [0; ITEM_SIZE];
        match self.map.fetch_item::<&[u8]>(&mut buffer, &KEY).await? {
            Some(value) => Contents::decode(value),
            None => Ok(Contents::default()),
        }
    }

    /// What a save leaves in place. What cannot be understood has no future: it is replaced by the default. A flash
    /// that merely failed to read it is no reason to throw it away.
    async fn load_for_change(&mut self) -> Result<Contents, StoreError> {
        match self.load().await {
            Err(StoreError::Corrupt | StoreError::UnknownVersion(_)) => Ok(Contents::default()),
            other => other,
        }
    }

    async fn save(&mut self, contents: &Contents) -> Result<(), StoreError> {
        let mut buffer = [0; VALUE_SIZE];
        let value = contents.encode(&mut buffer)?;
        if self.write(value).await.is_ok() {
            return Ok(());
        }
        self.map.erase_all().await?;
        self.write(value).await
    }

    /// Appends the value to the log and reads it back.
    async fn write(&mut self, value: &[u8]) -> Result<(), StoreError> {
        let mut buffer = [0; ITEM_SIZE];
        self.map.store_item(&mut buffer, &KEY, &value).await?;
        match self.map.fetch_item::<&[u8]>(&mut buffer, &KEY).await? {
            Some(stored) if stored == value => Ok(()),
            _ => Err(StoreError::Verify),
        }
    }
}

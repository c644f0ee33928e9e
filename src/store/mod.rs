//! What the module remembers without power: settings and two generations of calibration, in NOR flash.
//!
//! # What is promised
//!
//! - A save is atomic: when power fails at any instant of it, the next start finds what was stored before or what was
//!   to be stored, complete. That holds for every save, also for one after a failure, and after a failure of that one.
//! - Nothing that comes out of the flash is trusted: every value is checked by CRC, version and range. No content of
//!   the region makes a load or a save panic.
//! - A region that holds garbage does not brick the module: it is erased and written again.
//!
//! # How
//!
//! Settings and calibrations are one item of a log ([`sequential_storage`]). There are two such logs, one in each half of
//! the region. A save appends to the one that does *not* hold the newest copy, so that whatever a power failure tears,
//! and whatever the log makes of the torn words, the newest copy's half is not being written. If the log refuses - a
//! failure can tear the very word that the next item needs - its half is erased and begun anew. A count of saves in each
//! copy says which one is newer.

mod contents;
#[cfg(test)]
pub(crate) mod tests;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

pub use contents::{Change, Generations, Record};
use contents::{Contents, VALUE_SIZE};

use crate::settings::Settings;

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
    flash: F,
    halves: [Range<u32>; 2],
}

/// What a half holds: a copy, with its count of saves; nothing; or why that is not known.
type Found = Result<Option<u32>, StoreError>;

impl<F: NorFlash> Store<F> {
    /// A store in this region of the flash, as offsets from the flash's start. The flash is not touched yet.
    ///
    /// # Panics
    ///
    /// At the first load or save, if the region is not made of an even number of pages, four at least: a mistake in a
    /// board's memory map, seen at its first start.
    #[must_use]
    pub const fn new(flash: F, region: Range<u32>) -> Self {
        let middle = region.start.midpoint(region.end);
        Self { flash, halves: [region.start..middle, middle..region.end] }
    }

    /// The settings; the default ones when none were ever stored.
    pub async fn load_settings(&mut self) -> Result<Settings, StoreError> {
        let mut contents = Contents::default();
        self.load(&mut contents).await?;
        Ok(contents.settings)
    }

    /// The calibrations; none when none were ever stored.
    pub async fn load_generations(&mut self) -> Result<Generations, StoreError> {
        let mut contents = Contents::default();
        self.load(&mut contents).await?;
        Ok(contents.generations)
    }

    /// Stores a change, leaving the rest as it is. What cannot be understood has no future: it is replaced by the default.
    /// A flash that merely failed to read it is no reason to throw it away.
    pub async fn save(&mut self, change: Change<'_>) -> Result<(), StoreError> {
        let mut contents = Contents::default();
        let found = self.survey(&mut contents).await;
        if found.contains(&Err(StoreError::Flash)) {
            return Err(StoreError::Flash);
        }
        contents.change(change);
        contents.saves = contents.saves.wrapping_add(1);
        let mut buffer = [0; VALUE_SIZE];
        let value = contents.encode(&mut buffer)?;
        let half = newest_half(&found).map_or(0, |newest| 1 - newest);
        if self.append(half, value).await.is_ok() {
            return Ok(());
        }
        self.log(half).erase_all().await?;
        self.append(half, value).await
    }

    /// Puts the newest copy into `contents`; an error if there is none, but something that cannot be read.
    async fn load(&mut self, contents: &mut Contents) -> Result<(), StoreError> {
        let found = self.survey(contents).await;
        match (newest_half(&found), found) {
            (None, [Err(error), _] | [_, Err(error)]) => Err(error),
            _ => Ok(()),
        }
    }

    /// What the halves hold; the newest copy is in `contents` afterwards, if there is one.
    async fn survey(&mut self, contents: &mut Contents) -> [Found; 2] {
        let first = self.read(0, contents).await;
        let second = self.read(1, contents).await;
        let found = [first, second];
        // The second copy now stands where the first one was.
        if newest_half(&found) == Some(0) && second.is_ok_and(|copy| copy.is_some()) {
            // It could be read a moment ago.
            let _ = self.read(0, contents).await;
        }
        found
    }

    fn log(&mut self, half: usize) -> MapStorage<u8, &mut F, Cache<Uncached, Uncached, Uncached, u8>> {
        let [first, second] = &self.halves;
        let region = if half == 0 { first } else { second };
        MapStorage::new(&mut self.flash, MapConfig::new(region.clone()), Cache::new_uncached())
    }

    /// Reads the copy in a half into `contents`, which stay as they are if there is none.
    async fn read(&mut self, half: usize, contents: &mut Contents) -> Found {
        let mut buffer = [0; ITEM_SIZE];
        match self.log(half).fetch_item::<&[u8]>(&mut buffer, &KEY).await? {
            Some(value) => {
                contents.decode(value)?;
                Ok(Some(contents.saves))
            }
            None => Ok(None),
        }
    }

    /// Appends the value to a log and reads it back.
    async fn append(&mut self, half: usize, value: &[u8]) -> Result<(), StoreError> {
        let mut buffer = [0; ITEM_SIZE];
        let mut log = self.log(half);
        log.store_item(&mut buffer, &KEY, &value).await?;
        match log.fetch_item::<&[u8]>(&mut buffer, &KEY).await? {
            Some(stored) if stored == value => Ok(()),
            _ => Err(StoreError::Verify),
        }
    }
}

/// The half with the newest copy that can be read.
fn newest_half(found: &[Found; 2]) -> Option<usize> {
    match *found {
        // They are never more than a few saves apart.
        [Ok(Some(first)), Ok(Some(second))] => Some(usize::from(second.wrapping_sub(first).cast_signed() > 0)),
        [Ok(Some(_)), _] => Some(0),
        [_, Ok(Some(_))] => Some(1),
        _ => None,
    }
}

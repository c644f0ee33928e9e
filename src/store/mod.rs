//! What the module remembers without power: settings and two generations of calibration, in NOR flash.
//!
//! # What is promised
//!
//! - A save is atomic: when power fails at any instant of it, the next start finds what was stored before or what was
//!   to be stored, complete. That holds for every save, also for one after a failure, and after a failure of that one.
//! - Nothing that comes out of the flash is trusted: every value is checked by CRC, version and range. No content of
//!   the region makes a load or a save panic.
//! - A region that holds garbage does not brick the module: it is erased and written again.
//! - An update keeps everything: what the versions before stored is read and converted. The first save afterwards writes
//!   the present version; until then, and if power fails during that save, the firmware before finds its own.
//! - A later firmware's copy is neither read nor written over, however many saves ago it was written: nothing is loaded
//!   and every save is refused until [`Change::Clear`] forgets it on purpose.
//!
//! # How
//!
//! Settings and calibrations are one item of a log ([`sequential_storage`]). There are two such logs, one in each half
//! of the region. A save appends to the one that does *not* hold the newest copy, so that whatever a power failure
//! tears, and whatever the log makes of the torn words, the newest copy's half is not being written. If the log refuses,
//! for a failure can tear the very word that the next item needs, its half is erased and begun anew. A count of saves in
//! each copy says which one is newer.
//!
//! To replace a later firmware's copies, the new copy is written first and the half with the last of them erased then:
//! as long as one is left, nothing else counts.

mod contents;
#[cfg(test)]
pub(crate) mod tests;
mod v2;
mod v3;
mod v4;
mod v5;
mod v6;
mod v7;
mod v8;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

pub use contents::{Change, Generations, Record, Remembered, Stored};
use contents::{Contents, VALUE_SIZE, VERSION};

/// The only key of the map.
const KEY: u8 = 0;
/// For any item of the map, one of a later firmware included: no item is longer than a page.
const ITEM_SIZE: usize = 2048;
const _: () = assert!(VALUE_SIZE < ITEM_SIZE, "the key takes a byte");

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
    /// The value is out of its range (see [`Settings::is_valid`](crate::settings::Settings::is_valid),
    /// [`Record::is_valid`]); nothing was written.
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

    /// Whether it is of a later firmware's copy, which is not to be touched.
    const fn is_later_version(self) -> bool {
        matches!(self, Self::UnknownVersion(version) if version > VERSION)
    }
}

/// What to do about it, in words.
impl core::fmt::Display for StoreError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Flash => "the flash memory failed; try again, then replace the board",
            Self::Corrupt => "what was stored is damaged; calibrate anew",
            later if later.is_later_version() => {
                "a later firmware stored it; load that firmware, or forget it: cal clear all"
            }
            Self::UnknownVersion(_) => "a firmware long ago stored it; calibrate anew",
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
            // An item without a key, for example, is none that this module wrote.
            _ => Self::Corrupt,
        }
    }
}

/// The store: a region of a NOR flash.
pub struct Store<F: NorFlash> {
    flash: F,
    halves: [Range<u32>; 2],
}

/// What a half holds: a copy; nothing; or why that is not known.
type Found = Result<Option<Contents>, StoreError>;

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

    /// What is stored; the defaults when nothing ever was.
    ///
    /// # Errors
    ///
    /// [`StoreError::UnknownVersion`] where there is a copy of a later firmware. Otherwise only where no copy can be
    /// read: [`Flash`](StoreError::Flash), [`Corrupt`](StoreError::Corrupt), or `UnknownVersion` of one long ago.
    pub async fn load(&mut self) -> Result<Stored, StoreError> {
        let found = self.survey().await;
        let errors = || found.iter().filter_map(|half| half.as_ref().err());
        if let Some(&later) = errors().find(|error| error.is_later_version()) {
            return Err(later);
        }
        match (newest(&found), errors().next()) {
            (Some((_, contents)), _) => Ok(contents.stored),
            (None, Some(&error)) => Err(error),
            (None, None) => Ok(Stored::default()),
        }
    }

    /// Stores a change, leaving the rest as it is. What cannot be understood has no future: it is replaced by the
    /// default. A flash that merely failed to read it is no reason to throw it away, nor is a later firmware's format.
    ///
    /// # Errors
    ///
    /// - [`StoreError::Flash`]: the flash refused. If it refused to read, nothing was written.
    /// - [`StoreError::UnknownVersion`]: a later firmware's copy is there, and the change is not [`Change::Clear`].
    ///   Nothing was written.
    /// - [`StoreError::Invalid`]: a value is out of its range. Nothing was written.
    /// - [`StoreError::Full`], [`StoreError::Verify`]: it does not fit, or reads back differently.
    ///
    /// After an error the next load finds what was stored before, or the change if it was written after all.
    pub async fn save(&mut self, change: Change<'_>) -> Result<(), StoreError> {
        let found = self.survey().await;
        if found.contains(&Err(StoreError::Flash)) {
            return Err(StoreError::Flash);
        }
        let later = found.each_ref().map(|half| half.as_ref().err().filter(|error| error.is_later_version()));
        match (later, change) {
            ([None, None], _) => self.replace_older(&found, change).await,
            (_, Change::Clear) => self.replace_later(later.map(|half| half.is_some())).await,
            ([Some(&error), _] | [_, Some(&error)], _) => Err(error),
        }
    }

    /// Writes the change into the half that does not hold the newest copy.
    async fn replace_older(&mut self, found: &[Found; 2], change: Change<'_>) -> Result<(), StoreError> {
        let newest = newest(found);
        let contents = newest.map_or_else(Contents::default, |(_, contents)| *contents).changed(change);
        let mut buffer = [0; VALUE_SIZE];
        let value = contents.encode(&mut buffer)?;
        let half = newest.map_or(0, |(half, _)| 1 - half);
        if self.append(half, value).await.is_ok() {
            return Ok(());
        }
        self.log(half).erase_all().await?;
        self.append(half, value).await
    }

    /// Writes the defaults into one half and erases the other, which holds a later firmware's copy until then.
    async fn replace_later(&mut self, is_later: [bool; 2]) -> Result<(), StoreError> {
        let mut buffer = [0; VALUE_SIZE];
        let value = Contents::default().changed(Change::Clear).encode(&mut buffer)?;
        // If both do, the second half keeps its own.
        let (first, last) = if is_later == [true, false] { (1, 0) } else { (0, 1) };
        self.log(first).erase_all().await?;
        self.append(first, value).await?;
        Ok(self.log(last).erase_all().await?)
    }

    async fn survey(&mut self) -> [Found; 2] {
        [self.read(0).await, self.read(1).await]
    }

    fn log(&mut self, half: usize) -> MapStorage<u8, &mut F, Cache<Uncached, Uncached, Uncached, u8>> {
        let [first, second] = &self.halves;
        let region = if half == 0 { first } else { second };
        MapStorage::new(&mut self.flash, MapConfig::new(region.clone()), Cache::new_uncached())
    }

    /// The copy in a half.
    async fn read(&mut self, half: usize) -> Found {
        let mut buffer = [0; ITEM_SIZE];
        let value = self.log(half).fetch_item::<&[u8]>(&mut buffer, &KEY).await?;
        value.map(Contents::decode).transpose()
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

/// The half with the newest copy that can be read, and the copy.
fn newest(found: &[Found; 2]) -> Option<(usize, &Contents)> {
    match found {
        [Ok(Some(first)), Ok(Some(second))] if is_newer(second.saves, first.saves) => Some((1, second)),
        [Ok(Some(first)), _] => Some((0, first)),
        [_, Ok(Some(second))] => Some((1, second)),
        _ => None,
    }
}

/// Of two counts of saves, which wrap; the copies are never more than a few saves apart.
const fn is_newer(saves: u32, than: u32) -> bool {
    saves.wrapping_sub(than).cast_signed() > 0
}

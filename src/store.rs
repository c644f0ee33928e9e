//! What the module remembers without power: settings and two generations of calibration, in NOR flash.
//!
//! Each page of the store holds one copy of everything. A save erases the page after the newest copy, writes the new
//! copy there and reads it back; a load takes the newest copy whose CRC is right. So the wear goes round all pages
//! (8 pages of 10,000 erases: 80,000 saves), and there is nothing to clean up, to migrate or to format.
//!
//! # What is promised
//!
//! - A save is atomic: when power fails at any instant of it, and again in any attempt after that, the next start finds
//!   what was stored before or what was to be stored, complete. The page of the newest copy is never touched.
//! - Nothing that comes out of the flash is trusted: every copy is checked by CRC, version and range. No content of
//!   the flash makes a load or a save panic, and none keeps a save from working.
//! - A page that has gone bad is passed over.

mod contents;
mod snapshot;
#[cfg(test)]
mod tests;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

use contents::Contents;
pub use contents::{Generations, Record, Settings};
use snapshot::{SNAPSHOT_SIZE, Snapshot};

/// A byte of NOR flash after an erase.
const ERASED: u8 = 0xFF;

/// Why something could not be loaded or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The flash refused to read, write or erase.
    Flash,
    /// What is stored cannot be understood.
    Corrupt,
    /// What is stored was written by a firmware with another version of the format.
    UnknownVersion(u8),
    /// The value does not fit into a copy.
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

/// The store: whole pages of a NOR flash.
pub struct Store<F> {
    flash: F,
    /// Offset of the first page.
    start: u32,
    pages: u32,
}

/// What a look through all pages has found.
struct Found {
    /// Page and content of the newest copy.
    newest: Option<(u32, Snapshot)>,
    /// Pages that hold something, but no copy.
    unreadable: u32,
}

impl<F: NorFlash> Store<F> {
    const PAGE_SIZE: u32 = F::ERASE_SIZE as u32;

    /// A store in this region of the flash, as offsets from the flash's start. The flash is not touched yet.
    ///
    /// # Panics
    ///
    /// If the region is not made of at least two whole pages: a mistake in a board's memory map, seen at its first
    /// start.
    #[must_use]
    pub const fn new(flash: F, region: Range<u32>) -> Self {
        assert!(region.start.is_multiple_of(Self::PAGE_SIZE) && region.end.is_multiple_of(Self::PAGE_SIZE));
        let pages = region.end.saturating_sub(region.start) / Self::PAGE_SIZE;
        assert!(pages >= 2 && SNAPSHOT_SIZE <= F::ERASE_SIZE && SNAPSHOT_SIZE.is_multiple_of(F::WRITE_SIZE));
        Self { flash, start: region.start, pages }
    }

    /// The settings; the default ones when none were ever stored.
    pub async fn load_settings(&mut self) -> Result<Settings, StoreError> {
        Ok(self.load().await?.settings)
    }

    /// The calibrations; none when none were ever stored.
    pub async fn load_generations(&mut self) -> Result<Generations, StoreError> {
        Ok(self.load().await?.generations)
    }

    /// Stores settings, leaving the calibrations as they are. What cannot be understood is not kept.
    pub async fn save_settings(&mut self, settings: &Settings) -> Result<(), StoreError> {
        let found = self.look().await?;
        let old = found.contents().unwrap_or_default();
        self.save(&found, &Contents { settings: *settings, ..old }).await
    }

    /// Stores calibrations, leaving the settings as they are. What cannot be understood is not kept.
    pub async fn save_generations(&mut self, generations: &Generations) -> Result<(), StoreError> {
        let found = self.look().await?;
        let old = found.contents().unwrap_or_default();
        self.save(&found, &Contents { generations: *generations, ..old }).await
    }

    async fn load(&mut self) -> Result<Contents, StoreError> {
        self.look().await?.contents()
    }

    const fn offset(&self, page: u32) -> u32 {
        self.start + page * Self::PAGE_SIZE
    }

    async fn read(&mut self, page: u32) -> Result<[u8; SNAPSHOT_SIZE], StoreError> {
        let mut bytes = [0; SNAPSHOT_SIZE];
        self.flash.read(self.offset(page), &mut bytes).await.map_err(|_| StoreError::Flash)?;
        Ok(bytes)
    }

    /// Looks through all pages.
    async fn look(&mut self) -> Result<Found, StoreError> {
        let mut found = Found { newest: None, unreadable: 0 };
        for page in 0..self.pages {
            let bytes = self.read(page).await?;
            match Snapshot::from_bytes(bytes) {
                Some(snapshot) => found.add(page, snapshot),
                None if bytes.iter().all(|&byte| byte == ERASED) => {}
                None => found.unreadable += 1,
            }
        }
        Ok(found)
    }

    /// Writes into the page after the newest copy, or into the next one that works. The newest copy stays.
    async fn save(&mut self, found: &Found, contents: &Contents) -> Result<(), StoreError> {
        let (page, serial) = match &found.newest {
            Some((page, snapshot)) => (*page, snapshot.serial()),
            None => (self.pages - 1, 0),
        };
        let snapshot = Snapshot::new(serial.wrapping_add(1), contents)?;
        let mut result = Err(StoreError::Flash);
        for step in 1..self.pages {
            result = self.write((page + step) % self.pages, &snapshot).await;
            if result.is_ok() {
                break;
            }
        }
        result
    }

    async fn write(&mut self, page: u32, snapshot: &Snapshot) -> Result<(), StoreError> {
        let offset = self.offset(page);
        self.flash.erase(offset, offset + Self::PAGE_SIZE).await.map_err(|_| StoreError::Flash)?;
        self.flash.write(offset, snapshot.bytes()).await.map_err(|_| StoreError::Flash)?;
        if self.read(page).await? == *snapshot.bytes() { Ok(()) } else { Err(StoreError::Verify) }
    }
}

impl Found {
    fn add(&mut self, page: u32, snapshot: Snapshot) {
        if self.newest.as_ref().is_none_or(|(_, newest)| snapshot.is_newer_than(newest)) {
            self.newest = Some((page, snapshot));
        }
    }

    /// What is stored. One unreadable page and nothing else is a first save that was cut off: nothing is stored.
    fn contents(&self) -> Result<Contents, StoreError> {
        match &self.newest {
            Some((_, snapshot)) => snapshot.contents(),
            None if self.unreadable <= 1 => Ok(Contents::default()),
            None => Err(StoreError::Corrupt),
        }
    }
}

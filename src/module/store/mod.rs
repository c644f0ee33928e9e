//! Non-volatile storage of settings and the current and the previous calibration in NOR flash.
//!
//! # Guarantees
//!
//! - A save is atomic: after a power failure at any flash operation, the next start loads the values from before the
//!   save or those from after it, never a mixture. This also holds for a save after a failed one.
//! - One damaged page never loses both calibrations.
//! - Nothing that is read from flash is trusted: CRC, format and range of every item are checked. No content of the
//!   region causes a panic, and garbage is overwritten by the next save.
//! - Items of another format are reported and never overwritten, except by [`StoreChange::Clear`].
//!
//! # Method
//!
//! Each page holds one item (`flash_page`), whose content is a list of tagged fields (`fields`). The first pages are
//! slots for calibrations. The others hold states: settings, startup values, and references to the slots of the current
//! and the previous calibration. The state with the highest count of saves is valid.
//!
//! A save writes a new calibration to a slot to which the valid state does not refer, and then a new state to the page
//! after the valid one. The write of the state is the instant at which the save takes effect. Every write begins with
//! an erase, because a word that a power failure has torn can be programmed only after an erase. If the page of the
//! valid state is damaged, the state before it becomes valid; the slots to which that one refers are still complete,
//! because only one save has followed it.

mod error;
mod fields;
mod flash_page;
mod stored_items;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

pub use error::StoreError;
use flash_page::{MAX_ITEM_SIZE, PageContent, StoredItem, WORD_SIZE};
use stored_items::{CALIBRATION_SLOTS, SlotReference, StoredState};
pub use stored_items::{CalibrationRecord, StartupValues, StoreChange, StoredCalibrations, StoredValues};

/// First page for states, after the slots.
const FIRST_STATE_PAGE: u32 = CALIBRATION_SLOTS as u32;

/// Minimum number of pages for states: a save leaves the valid one in place.
const MIN_STATE_PAGES: u32 = 2;

/// Result of a load: the readable values, and defaults for the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadedValues {
    /// Values that could be read.
    pub stored_values: StoredValues,
    /// Reason why a value, or all of them, could not be read.
    pub load_error: Option<StoreError>,
}

/// Store in a region of a NOR flash.
pub struct Store<F: NorFlash> {
    flash: F,
    region: Range<u32>,
}

struct PageScan {
    /// Page and content of the valid state.
    valid_state: Option<(u32, StoredState)>,
    /// Page and format of an item of another format.
    other_format: Option<(u32, u8)>,
    /// [`StoreError::Flash`] if a page could not be read; otherwise [`StoreError::Corrupt`] if a state is damaged.
    scan_error: Option<StoreError>,
}

impl<F: NorFlash> Store<F> {
    const PAGE_SIZE: u32 = F::ERASE_SIZE as u32;

    /// Creates a store in a region, in bytes from the start of the flash, without accessing it.
    ///
    /// # Panics
    ///
    /// If the region is not a whole number of pages, at least six: an error in the board's memory map, detected at its
    /// first start.
    #[must_use]
    pub const fn new(flash: F, region: Range<u32>) -> Self {
        const { assert!(F::ERASE_SIZE >= MAX_ITEM_SIZE && WORD_SIZE.is_multiple_of(F::WRITE_SIZE)) };
        assert!(region.start.is_multiple_of(Self::PAGE_SIZE) && region.end.is_multiple_of(Self::PAGE_SIZE));
        assert!((region.end - region.start) / Self::PAGE_SIZE >= FIRST_STATE_PAGE + MIN_STATE_PAGES);
        Self { flash, region }
    }

    /// Loads everything readable; defaults if nothing was ever stored.
    ///
    /// The error is [`StoreError::OtherFormat`] if the store has another format (nothing is loaded), and
    /// [`Corrupt`](StoreError::Corrupt) or [`Flash`](StoreError::Flash) if no state or one of the calibrations is
    /// unreadable.
    pub async fn load_state(&mut self) -> LoadedValues {
        let PageScan { valid_state: valid, other_format: other, scan_error: error } = self.scan_pages().await;
        let mut loaded = LoadedValues { stored_values: StoredValues::default(), load_error: error };
        if let Some((_, format)) = other {
            loaded.load_error = Some(StoreError::OtherFormat(format));
        } else if let Some((
            _,
            StoredState { current_slot: current, previous_slot: previous, settings, startup_values, .. },
        )) = valid
        {
            loaded.load_error = None;
            let StoredValues { stored_calibrations, .. } = &mut loaded.stored_values;
            for (reference, record) in [
                (current, &mut stored_calibrations.current_calibration),
                (previous, &mut stored_calibrations.previous_calibration),
            ] {
                match self.read_calibration(reference).await {
                    Ok(stored) => *record = stored,
                    Err(error) => loaded.load_error = Some(error),
                }
            }
            loaded.stored_values.settings = settings;
            loaded.stored_values.startup_values = startup_values;
        }
        loaded
    }

    /// Stores a change. Damaged values are replaced by their defaults. After an error the next load returns the values
    /// from before the save, or the new ones if they were written.
    ///
    /// # Errors
    ///
    /// - [`StoreError::Flash`]: the flash failed. If a read failed, nothing was written, because the failure may be
    ///   temporary.
    /// - [`StoreError::OtherFormat`]: the store has another format, and the change is not [`StoreChange::Clear`].
    ///   Nothing was written.
    /// - [`StoreError::Invalid`]: a value is out of its range. Nothing was written.
    /// - [`StoreError::Full`], [`StoreError::ReadBackDiffers`]: the value does not fit, or reads back differently.
    pub async fn save_change(&mut self, change: StoreChange<'_>) -> Result<(), StoreError> {
        let PageScan { valid_state: valid, other_format: other, scan_error: error } = self.scan_pages().await;
        if error == Some(StoreError::Flash) {
            return Err(StoreError::Flash);
        }
        if let Some((page, format)) = other {
            return match change {
                StoreChange::Clear => self.erase_other_format(page).await,
                _ => Err(StoreError::OtherFormat(format)),
            };
        }
        let (page, mut state) =
            valid.map_or((FIRST_STATE_PAGE, StoredState::default()), |(page, state)| (self.page_after(page), state));
        state.save_count = state.save_count.saturating_add(1);
        // A new calibration ends its collection; a continued collection is flagged again later.
        state.startup_values.is_collecting &= matches!(change, StoreChange::Settings(_));
        match change {
            StoreChange::Settings(settings) => state.settings = *settings,
            StoreChange::StartupValues(startup_values) => state.startup_values = startup_values,
            StoreChange::Clear => (state.current_slot, state.previous_slot) = (None, None),
            StoreChange::StoredCalibrations { current, previous } => {
                if ![current, previous].into_iter().flatten().all(CalibrationRecord::is_valid) {
                    return Err(StoreError::Invalid);
                }
                let used_slots = [state.current_slot, state.previous_slot];
                state.current_slot = self.write_to_free_slot(current, &used_slots).await?;
                state.previous_slot =
                    self.write_to_free_slot(previous, &[used_slots[0], used_slots[1], state.current_slot]).await?;
            }
        }
        self.write_state(page, &state).await
    }

    /// Erases all pages without reading them: afterwards nothing is stored.
    ///
    /// # Errors
    ///
    /// [`StoreError::Flash`]: a page could not be erased.
    pub async fn erase_all(&mut self) -> Result<(), StoreError> {
        for page in 0..self.page_count() {
            self.erase_page(page).await?;
        }
        Ok(())
    }

    /// Replaces a store of another format by the default state. Erases the page with that format's item last, so that
    /// it is still reported after a power failure.
    async fn erase_other_format(&mut self, format_page: u32) -> Result<(), StoreError> {
        let state_page = if format_page == FIRST_STATE_PAGE { FIRST_STATE_PAGE + 1 } else { FIRST_STATE_PAGE };
        self.write_state(state_page, &StoredState::default()).await?;
        for page in
            (0..self.page_count()).filter(|page| *page != state_page && *page != format_page).chain([format_page])
        {
            self.erase_page(page).await?;
        }
        Ok(())
    }

    /// Reads every page and finds the valid state.
    async fn scan_pages(&mut self) -> PageScan {
        let mut scan = PageScan { valid_state: None, other_format: None, scan_error: None };
        for page in 0..self.page_count() {
            let mut buffer = [0; MAX_ITEM_SIZE];
            match self.read_page(page, &mut buffer).await {
                Err(error) => scan.scan_error = Some(error),
                Ok(PageContent::OtherFormat(format)) => scan.other_format = Some((page, format)),
                Ok(content) if page >= FIRST_STATE_PAGE => scan.add_state(page, &content),
                Ok(_) => {}
            }
        }
        scan
    }

    async fn read_calibration(
        &mut self,
        reference: Option<SlotReference>,
    ) -> Result<Option<CalibrationRecord>, StoreError> {
        let Some(SlotReference { slot, crc }) = reference else { return Ok(None) };
        let mut buffer = [0; MAX_ITEM_SIZE];
        match self.read_page(u32::from(slot), &mut buffer).await? {
            PageContent::Item(item) if item.crc == crc => fields::decode_fields(item.field_bytes).map(Some),
            _ => Err(StoreError::Corrupt),
        }
    }

    /// Writes a calibration to a free slot, unless a slot already holds it. Slots in `used_slots` are not free.
    async fn write_to_free_slot(
        &mut self,
        record: Option<&CalibrationRecord>,
        used_slots: &[Option<SlotReference>],
    ) -> Result<Option<SlotReference>, StoreError> {
        let Some(record) = record else { return Ok(None) };
        let mut buffer = [0; MAX_ITEM_SIZE];
        let (item, crc) = flash_page::encode_item(record, &mut buffer)?;
        for slot in 0..CALIBRATION_SLOTS {
            if self.page_contains(u32::from(slot), item).await? {
                return Ok(Some(SlotReference { slot, crc }));
            }
        }
        // Starts after the current calibration's slot, for even wear.
        let start = used_slots.iter().flatten().next().map_or(0, |reference| reference.slot + 1);
        let is_free = |slot: &u8| used_slots.iter().flatten().all(|reference| reference.slot != *slot);
        let slot = (0..CALIBRATION_SLOTS)
            .map(|offset| (start + offset) % CALIBRATION_SLOTS)
            .find(is_free)
            .ok_or(StoreError::Full)?;
        self.program_page(u32::from(slot), item).await?;
        Ok(Some(SlotReference { slot, crc }))
    }

    /// Writes the state to a page.
    async fn write_state(&mut self, page: u32, state: &StoredState) -> Result<(), StoreError> {
        let mut buffer = [0; MAX_ITEM_SIZE];
        let (item, _) = flash_page::encode_item(state, &mut buffer)?;
        self.program_page(page, item).await
    }

    /// Erases a page, programs an item and reads it back.
    async fn program_page(&mut self, page: u32, item: &[u8]) -> Result<(), StoreError> {
        self.erase_page(page).await?;
        self.flash.write(self.page_offset(page), item).await.map_err(|_| StoreError::Flash)?;
        if self.page_contains(page, item).await? { Ok(()) } else { Err(StoreError::ReadBackDiffers) }
    }

    async fn erase_page(&mut self, page: u32) -> Result<(), StoreError> {
        let start = self.page_offset(page);
        self.flash.erase(start, start + Self::PAGE_SIZE).await.map_err(|_| StoreError::Flash)
    }

    async fn page_contains(&mut self, page: u32, item: &[u8]) -> Result<bool, StoreError> {
        let mut buffer = [0; MAX_ITEM_SIZE];
        let page_bytes = &mut buffer[..item.len()];
        self.flash.read(self.page_offset(page), page_bytes).await.map_err(|_| StoreError::Flash)?;
        Ok(page_bytes == item)
    }

    async fn read_page<'a>(
        &mut self,
        page: u32,
        buffer: &'a mut [u8; MAX_ITEM_SIZE],
    ) -> Result<PageContent<'a>, StoreError> {
        self.flash.read(self.page_offset(page), buffer).await.map_err(|_| StoreError::Flash)?;
        Ok(flash_page::parse_page(buffer))
    }

    const fn page_count(&self) -> u32 {
        (self.region.end - self.region.start) / Self::PAGE_SIZE
    }

    const fn page_after(&self, page: u32) -> u32 {
        if page + 1 < self.page_count() { page + 1 } else { FIRST_STATE_PAGE }
    }

    const fn page_offset(&self, page: u32) -> u32 {
        self.region.start + page * Self::PAGE_SIZE
    }
}

impl PageScan {
    fn add_state(&mut self, page: u32, content: &PageContent<'_>) {
        let state = match content {
            PageContent::Item(StoredItem { field_bytes: fields, .. }) => fields::decode_fields::<StoredState>(fields),
            // Only a power failure during the very first save damages the first page alone; nothing was stored before.
            PageContent::Damaged if page == FIRST_STATE_PAGE => return,
            PageContent::Damaged => Err(StoreError::Corrupt),
            PageContent::Erased | PageContent::OtherFormat(_) => return,
        };
        match (state, &self.valid_state) {
            (Ok(state), Some((_, valid))) if state.save_count < valid.save_count => {}
            (Ok(state), _) => self.valid_state = Some((page, state)),
            (Err(error), _) => _ = self.scan_error.get_or_insert(error),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;

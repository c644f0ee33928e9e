//! The item on a page of flash.
//!
//! ```text
//! byte 0           format
//! byte 1 to 2      length of the fields, little endian
//! byte 3 on        fields (see `fields`)
//! then 4 bytes     CRC-32 (ISO-HDLC) of everything before, little endian
//! ```
//!
//! The rest of the page is erased. Format, length and CRC have their places in every format, so that each firmware
//! recognises an item that it must not overwrite.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

use super::fields::{self, StoredFields};
use crate::store::error::StoreError;

/// Changes with the position or meaning of stored bytes; appended fields do not change it.
pub const STORE_FORMAT: u8 = 1;

/// Largest item of any format, bytes: twice a calibration.
pub const MAX_ITEM_SIZE: usize = 1024;

/// Program granularity, bytes: a double word of the STM32L4.
pub const WORD_SIZE: usize = 8;

const HEADER_SIZE: usize = 3;
const CRC_SIZE: usize = 4;

/// CRC-32 without a lookup table of 1 KB: a save waits for the flash, not for the checksum.
pub const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

#[derive(Debug, PartialEq, Eq)]
pub enum PageContent<'a> {
    /// The page was not written since its last erase.
    Erased,
    /// The page has no complete item: damaged, or interrupted by a power failure.
    Damaged,
    /// A complete item of another format.
    OtherFormat(u8),
    Item(StoredItem<'a>),
}

#[derive(Debug, PartialEq, Eq)]
pub struct StoredItem<'a> {
    pub field_bytes: &'a [u8],
    pub crc: u32,
}

/// Finds the item at the start of a page.
pub fn parse_page(page: &[u8]) -> PageContent<'_> {
    let Some(&[format, low, high]) = page.first_chunk::<HEADER_SIZE>() else { return PageContent::Damaged };
    let length = HEADER_SIZE + usize::from(u16::from_le_bytes([low, high]));
    match split_with_valid_crc(page, length) {
        Some((item, crc)) if format == STORE_FORMAT => {
            PageContent::Item(StoredItem { field_bytes: &item[HEADER_SIZE..], crc })
        }
        Some(_) => PageContent::OtherFormat(format),
        None if [format, low, high] == [0xFF; HEADER_SIZE] => PageContent::Erased,
        None => PageContent::Damaged,
    }
}

/// Encodes an item into the buffer, padded like erased flash. Returns the bytes to program and the item's CRC.
pub fn encode_item<'a, T: StoredFields>(
    value: &T,
    buffer: &'a mut [u8; MAX_ITEM_SIZE],
) -> Result<(&'a [u8], u32), StoreError> {
    buffer.fill(0xFF);
    let length = HEADER_SIZE + fields::encode_fields(value, &mut buffer[HEADER_SIZE..MAX_ITEM_SIZE - CRC_SIZE])?;
    let [low, high] = ((length - HEADER_SIZE) as u16).to_le_bytes();
    buffer[..HEADER_SIZE].copy_from_slice(&[STORE_FORMAT, low, high]);
    let crc = CRC.checksum(&buffer[..length]);
    buffer[length..length + CRC_SIZE].copy_from_slice(&crc.to_le_bytes());
    Ok((&buffer[..(length + CRC_SIZE).next_multiple_of(WORD_SIZE)], crc))
}

/// The first `length` bytes and their CRC, if the CRC that follows them is correct.
fn split_with_valid_crc(bytes: &[u8], length: usize) -> Option<(&[u8], u32)> {
    let (body, crc_and_padding) = bytes.split_at_checked(length)?;
    let crc = u32::from_le_bytes(*crc_and_padding.first_chunk::<CRC_SIZE>()?);
    (CRC.checksum(body) == crc).then_some((body, crc))
}

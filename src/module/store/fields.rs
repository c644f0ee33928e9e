//! Encoding of an item's content as tagged fields, so that the format grows without a new version.
//!
//! Each field is a tag (1 byte), the length of its value (2 bytes, little endian) and the value in postcard's format.
//! A reader looks every field up by its tag: it skips unknown tags, and a missing optional field keeps its default.
//! Postcard alone writes values one behind the other and can do neither.
//!
//! Rules for changes within a format:
//! - A new field takes the next unused tag, is optional, and is visited last. A tag is never used again.
//! - The type of a field never changes. A new variant of an enumeration is its last; firmware without that variant
//!   treats an optional field that holds it as missing.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::store::error::StoreError;

/// Length of a field's header, bytes: tag and length of the value.
pub(super) const HEADER_SIZE: usize = 3;

/// Value stored as tagged fields.
pub trait StoredFields: Copy {
    /// Value before any field is read, with defaults in optional fields.
    fn with_defaults() -> Self;

    /// Passes each field and its tag to the visitor, in the order of introduction.
    fn visit_fields(&mut self, visitor: &mut impl FieldVisitor);

    fn is_valid(&self) -> bool;
}

/// Reads or writes fields.
pub trait FieldVisitor {
    /// Visits a field without which the value is invalid.
    fn visit_required<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T);

    /// Visits a field that keeps its value if missing or unreadable.
    fn visit_optional<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T);
}

/// Encodes all fields; returns their length in bytes.
pub fn encode_fields<T: StoredFields>(value: &T, buffer: &mut [u8]) -> Result<usize, StoreError> {
    if !value.is_valid() {
        return Err(StoreError::Invalid);
    }
    let mut writer = FieldWriter { buffer, length: Some(0) };
    { *value }.visit_fields(&mut writer);
    writer.length.ok_or(StoreError::Full)
}

pub fn decode_fields<T: StoredFields>(fields: &[u8]) -> Result<T, StoreError> {
    let mut reader = FieldReader { fields, is_complete: is_well_formed(fields) };
    let mut value = T::with_defaults();
    value.visit_fields(&mut reader);
    if reader.is_complete && value.is_valid() { Ok(value) } else { Err(StoreError::Corrupt) }
}

struct FieldWriter<'a> {
    buffer: &'a mut [u8],
    /// Bytes written; `None` once a field does not fit.
    length: Option<usize>,
}

impl FieldWriter<'_> {
    /// Writes a field at `offset`; returns the end offset.
    fn write_field<T: Serialize>(&mut self, offset: usize, tag: u8, field: &T) -> Option<usize> {
        let (header, unused) = self.buffer.get_mut(offset..)?.split_first_chunk_mut::<HEADER_SIZE>()?;
        let value = postcard::to_slice(field, unused).ok()?;
        let [low, high] = u16::try_from(value.len()).ok()?.to_le_bytes();
        *header = [tag, low, high];
        Some(offset + HEADER_SIZE + value.len())
    }
}

impl FieldVisitor for FieldWriter<'_> {
    fn visit_required<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T) {
        self.length = self.length.and_then(|offset| self.write_field(offset, tag, field));
    }

    fn visit_optional<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T) {
        self.visit_required(tag, field);
    }
}

struct FieldReader<'a> {
    fields: &'a [u8],
    /// Whether all required fields were read.
    is_complete: bool,
}

impl FieldReader<'_> {
    /// The field with this tag, if present and decodable.
    fn read_field<T: DeserializeOwned>(&self, tag: u8) -> Option<T> {
        let mut remaining = self.fields;
        while let Some((field_tag, value, next_fields)) = split_field(remaining) {
            if field_tag == tag {
                return postcard::from_bytes(value).ok();
            }
            remaining = next_fields;
        }
        None
    }
}

impl FieldVisitor for FieldReader<'_> {
    fn visit_required<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T) {
        match self.read_field(tag) {
            Some(value) => *field = value,
            None => self.is_complete = false,
        }
    }

    fn visit_optional<T: Serialize + DeserializeOwned>(&mut self, tag: u8, field: &mut T) {
        if let Some(value) = self.read_field(tag) {
            *field = value;
        }
    }
}

/// Tag and value of the first field, and the remaining bytes.
fn split_field(fields: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (&[tag, low, high], value_and_next) = fields.split_first_chunk::<HEADER_SIZE>()?;
    let (value, next_fields) = value_and_next.split_at_checked(usize::from(u16::from_le_bytes([low, high])))?;
    Some((tag, value, next_fields))
}

/// Whether the bytes consist of whole fields.
fn is_well_formed(mut fields: &[u8]) -> bool {
    while let Some((_, _, next_fields)) = split_field(fields) {
        fields = next_fields;
    }
    fields.is_empty()
}

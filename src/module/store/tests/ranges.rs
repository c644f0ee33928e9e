//! Values out of their ranges are neither stored nor loaded.

use super::*;
use crate::store::fields::FieldVisitor;

/// A value without range checks.
#[derive(Clone, Copy)]
struct Unchecked<T>(T);

impl<T: StoredFields> StoredFields for Unchecked<T> {
    fn with_defaults() -> Self {
        Self(T::with_defaults())
    }

    fn visit_fields(&mut self, visitor: &mut impl FieldVisitor) {
        self.0.visit_fields(visitor);
    }

    fn is_valid(&self) -> bool {
        true
    }
}

fn assert_validity<T: StoredFields + PartialEq + core::fmt::Debug>(value: &T, valid: bool, label: &str) {
    let unchecked = encoded_item(&Unchecked(*value));
    let PageContent::Item(StoredItem { field_bytes: fields, .. }) = flash_page::parse_page(&unchecked) else {
        panic!("{label}")
    };
    let mut buffer = [0; MAX_ITEM_SIZE];
    let encoded = flash_page::encode_item(value, &mut buffer).map(|(item, _)| item);
    if valid {
        assert_eq!(encoded, Ok(&unchecked[..]), "{label}");
        assert_eq!(fields::decode_fields(fields), Ok(*value), "{label}");
    } else {
        assert_eq!(encoded, Err(StoreError::Invalid), "{label}");
        assert_eq!(fields::decode_fields::<T>(fields), Err(StoreError::Corrupt), "{label}");
    }
}

/// Tags of a record's fields that contain numbers in single precision.
const NUMBER_TAGS: [u8; 17] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 13, 14, 15, 17, 18, 19, 20];

/// Each number of a record, also the elements of its matrices, in place of which other numbers are stored.
#[test]
fn records_are_kept_if_every_number_is_finite() {
    let item = encoded_item(&calibration_record(1));
    let fields = format::field_bytes_of_item(&item);
    let mut numbers = 0;
    let mut field_start = 0;
    for (tag, field) in format::split_into_fields(&fields) {
        // Behind the header of the field, and behind the tag of an optional value.
        let value = field_start + fields::HEADER_SIZE + usize::from(tag == 17)..field_start + field.len();
        field_start += field.len();
        for at in value.step_by(size_of::<f32>()).filter(|_| NUMBER_TAGS.contains(&tag)) {
            numbers += 1;
            for (number, valid) in
                [(0.5, true), (f32::MAX, true), (f32::INFINITY, false), (-f32::INFINITY, false), (f32::NAN, false)]
            {
                let mut changed = fields.clone();
                changed[at..at + size_of::<f32>()].copy_from_slice(&f32::to_le_bytes(number));
                let Unchecked(record): Unchecked<CalibrationRecord> = fields::decode_fields(&changed).unwrap();
                assert_validity(&record, valid, &format!("{number} in field {tag}, byte {at}"));
            }
        }
    }
    assert_eq!(numbers, 9 + 3 + 3 + 3 + 3 + 4 + 2 + 60 + 2);
    for (number, valid) in [(23, true), (24, false)] {
        let mount = Orientation::from_number(number);
        assert_validity(&CalibrationRecord { mount, ..calibration_record(1) }, valid, "mount");
    }
}

#[test]
fn an_invalid_value_is_rejected_and_not_written() {
    let [current, previous] = [9, 8].map(calibration_record);
    let bad = CalibrationRecord { mount: Orientation::from_number(24), ..current };
    let calibrations = |current, previous| StoreChange::StoredCalibrations { current, previous };
    let bad_settings = Settings { stream_rate_hz: 0, ..Settings::default() };
    for saves in [0, 3] {
        for change in [
            calibrations(Some(&bad), Some(&previous)),
            calibrations(Some(&current), Some(&bad)),
            StoreChange::Settings(&bad_settings),
        ] {
            let mut flash = flash_after_saves(saves);
            flash.operation_count = 0;
            assert_eq!(save_change(&mut flash, change), Err(StoreError::Invalid));
            assert_eq!(flash.operation_count, 0);
        }
    }
}

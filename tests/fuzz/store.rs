//! The store on flash with arbitrary contents.

use std::sync::LazyLock;

use autoswing_module::settings::Settings;
use autoswing_module::store::{
    CalibrationRecord, LoadedValues, Store, StoreChange, StoreError, StoredCalibrations, StoredValues,
};
use embassy_futures::block_on;
use proptest::collection::vec;
use proptest::prelude::*;
use testkit::flash::RamFlash;

use crate::calibration_record::calibration_record;
use crate::{PropertyResult, check_costly_property};

const PAGE_SIZE: usize = 2048;
const PAGE_COUNT: usize = 8;
const REGION_SIZE: usize = PAGE_SIZE * PAGE_COUNT;

type Flash = RamFlash<PAGE_SIZE>;

/// Flash after 0, 1, 2 and 30 rounds of accepting a calibration and changing a setting.
static SAVED_FLASHES: LazyLock<[Flash; 4]> = LazyLock::new(|| {
    [0, 1, 2, 30].map(|times| {
        let mut flash = Flash::new(PAGE_COUNT);
        let mut generations = StoredCalibrations::default();
        for time in 0..times {
            generations.make_current(&calibration_record(time));
            save_calibrations(&mut flash, &generations).expect("a sound flash");
            save_settings(&mut flash, &Settings { stream_rate_hz: 1 + time as u8, ..Settings::DEFAULT })
                .expect("a sound flash");
        }
        flash
    })
});

fn open_store(flash: &mut Flash) -> Store<&mut Flash> {
    Store::new(flash, 0..REGION_SIZE as u32)
}

fn save_settings(flash: &mut Flash, settings: &Settings) -> Result<(), StoreError> {
    block_on(open_store(flash).save_change(StoreChange::Settings(settings)))
}

fn save_calibrations(flash: &mut Flash, generations: &StoredCalibrations) -> Result<(), StoreError> {
    let StoredCalibrations { current_calibration: current, previous_calibration: previous } = generations;
    block_on(
        open_store(flash)
            .save_change(StoreChange::StoredCalibrations { current: current.as_ref(), previous: previous.as_ref() }),
    )
}

/// Replacement bytes and their positions, mostly within items.
fn any_damage() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
    let item_offset = (0..PAGE_COUNT, 0..480_usize).prop_map(|(page, offset)| page * PAGE_SIZE + offset);
    let offset = prop_oneof![2 => item_offset, 1 => 0..REGION_SIZE];
    let few_bytes = vec(any::<u8>(), 1..12);
    let equal_bytes =
        (proptest::sample::select(&[0x00, 0xFF, 0x55][..]), 1..PAGE_SIZE).prop_map(|(byte, size)| vec![byte; size]);
    vec((offset, prop_oneof![3 => few_bytes, 1 => equal_bytes]), 0..4)
}

fn replace_bytes(flash: &mut Flash, offset: usize, bytes: &[u8]) {
    for (flash_byte, byte) in flash.bytes[offset..].iter_mut().zip(bytes) {
        *flash_byte = *byte;
    }
}

/// Loaded values are in range, loaded calibrations were stored, and later saves are loaded again. Only an item of
/// another format is preserved; it needs a correct CRC, which damage produces once in four billion cases.
#[test]
fn arbitrary_flash_contents_load_valid_values_and_allow_saves() {
    check_costly_property((0..4_usize, any_damage()), |(times, damage)| -> PropertyResult {
        let mut flash = SAVED_FLASHES[times].clone();
        for (offset, bytes) in &damage {
            replace_bytes(&mut flash, *offset, bytes);
        }
        let LoadedValues { stored_values: StoredValues { settings, stored_calibrations: generations, .. }, .. } =
            block_on(open_store(&mut flash).load_state());
        prop_assert!(settings.is_valid());
        for loaded_calibration in
            [generations.current_calibration, generations.previous_calibration].into_iter().flatten()
        {
            prop_assert_eq!(loaded_calibration, calibration_record(loaded_calibration.serial_number));
        }
        let settings = Settings { stream_rate_hz: 77, ..Settings::DEFAULT };
        let generations = StoredCalibrations {
            current_calibration: Some(calibration_record(99)),
            previous_calibration: generations.current_calibration,
        };
        prop_assert_eq!(save_settings(&mut flash, &settings), Ok(()));
        prop_assert_eq!(save_calibrations(&mut flash, &generations), Ok(()));
        let LoadedValues { stored_values: stored, load_error: error } = block_on(open_store(&mut flash).load_state());
        prop_assert_eq!((stored.settings, stored.stored_calibrations, error), (settings, generations, None));
        Ok(())
    });
}

/// CRC-32 (ISO-HDLC).
fn item_crc(bytes: &[u8]) -> u32 {
    !bytes
        .iter()
        .fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc: u32, _| (crc >> 1) ^ (0xEDB8_8320 * (crc & 1))))
}

/// Items with a correct CRC: fields with headers like the store's, or arbitrary bytes.
fn any_items() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
    let field = (1..30_u8, vec(any::<u8>(), 0..40)).prop_map(|(tag, value)| {
        let mut field = vec![tag, value.len() as u8, 0];
        field.extend(value);
        field
    });
    let fields = prop_oneof![3 => vec(field, 0..25).prop_map(|fields| fields.concat()), 1 => vec(any::<u8>(), 0..300)];
    vec((0..PAGE_COUNT, fields), 1..6)
}

#[test]
fn the_store_handles_any_fields() {
    check_costly_property((0..4_usize, any_items()), |(times, items)| -> PropertyResult {
        let mut flash = SAVED_FLASHES[times].clone();
        for (page, fields) in items {
            let mut encoded_item = vec![1];
            encoded_item.extend((fields.len() as u16).to_le_bytes());
            encoded_item.extend(fields);
            encoded_item.extend(item_crc(&encoded_item).to_le_bytes());
            replace_bytes(&mut flash, page * PAGE_SIZE, &encoded_item);
        }
        let LoadedValues { stored_values: StoredValues { settings, stored_calibrations: generations, .. }, .. } =
            block_on(open_store(&mut flash).load_state());
        prop_assert!(settings.is_valid());
        prop_assert!(
            [generations.current_calibration, generations.previous_calibration]
                .iter()
                .flatten()
                .all(CalibrationRecord::is_valid)
        );
        let generations =
            StoredCalibrations { current_calibration: Some(calibration_record(99)), previous_calibration: None };
        prop_assert_eq!(save_calibrations(&mut flash, &generations), Ok(()));
        let LoadedValues { stored_values: stored, load_error: error } = block_on(open_store(&mut flash).load_state());
        prop_assert_eq!((stored.settings, stored.stored_calibrations, error), (settings, generations, None));
        Ok(())
    });
}

//! The store on a flash with the rules of the STM32L4's.

mod damage;
mod faults;
mod format;
mod other_formats;
mod power_cuts;
mod ranges;

use embassy_futures::block_on;
use testkit::flash::RamFlash;

use super::fields::StoredFields;
use super::*;
use crate::settings::{HeadingKind, ProtocolKind, Settings};
use crate::synthetic::typical_quality;
use autoswing::calibration::{
    AttitudeEnvelope, AttitudeLatency, Method, MotorCurrentInterference, Orientation, Quality,
};
use autoswing::reading::MagnetometerModel;

const PAGE_SIZE: usize = 2048;
/// Number of pages, as on the board.
const PAGE_COUNT: usize = 8;
const STORE_REGION: Range<u32> = 0..(PAGE_SIZE * PAGE_COUNT) as u32;

type Flash = RamFlash<PAGE_SIZE>;

pub(crate) fn calibration_record(serial: u32) -> CalibrationRecord {
    let mut record = CalibrationRecord { serial_number: serial, ..CalibrationRecord::with_defaults() };
    let calibration = &mut record.calibration;
    calibration.b_ut = [serial as f32, 2.0, 3.0];
    (calibration.inclination_rad, calibration.total_ut, calibration.latency_s) = (1.0, 48.0, -0.04);
    record.quality = Quality {
        expected_worst_deg: 0.7,
        samples: u16::MAX,
        latency: Some(AttitudeLatency { estimate_s: -0.042, sigma_s: 0.006 }),
        ..typical_quality(0.3)
    };
    record.sensor.address = 0x1E;
    record.uncertainty.relative_sensor_sigma = 0.002;
    record
}

fn stored_calibrations(serial: u32) -> StoredCalibrations {
    StoredCalibrations {
        current_calibration: Some(calibration_record(serial)),
        previous_calibration: Some(calibration_record(serial.wrapping_sub(1))),
    }
}

fn calibration_change(stored_calibrations: &StoredCalibrations) -> StoreChange<'_> {
    StoreChange::StoredCalibrations {
        current: stored_calibrations.current_calibration.as_ref(),
        previous: stored_calibrations.previous_calibration.as_ref(),
    }
}

pub(super) fn settings() -> Settings {
    let stream_heading = HeadingKind::Raw;
    Settings {
        declination_deg: Some(12.5),
        stream_on: false,
        stream_heading,
        accuracy_deg: 1.5,
        auto_on: false,
        ..Settings::default()
    }
}

fn encoded_item(value: &impl StoredFields) -> Vec<u8> {
    flash_page::encode_item(value, &mut [0; MAX_ITEM_SIZE]).unwrap().0.to_vec()
}

fn append_crc(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(flash_page::CRC.checksum(&bytes).to_le_bytes());
    bytes
}

fn write_page(flash: &mut Flash, page: usize, bytes: &[u8]) {
    let page = &mut flash.bytes[page * PAGE_SIZE..(page + 1) * PAGE_SIZE];
    page.fill(0xFF);
    page[..bytes.len()].copy_from_slice(bytes);
}

/// Flash after this number of saves of calibrations with serial numbers from 1.
fn flash_after_saves(saves: u32) -> Flash {
    let mut flash = Flash::new(PAGE_COUNT);
    for serial in 1..=saves {
        save_calibration(&mut flash, serial).unwrap();
    }
    flash
}

/// Saves a calibration with a newly created store.
fn save_calibration(flash: &mut Flash, serial: u32) -> Result<(), StoreError> {
    save_change(flash, calibration_change(&stored_calibrations(serial)))
}

fn save_change(flash: &mut Flash, change: StoreChange<'_>) -> Result<(), StoreError> {
    block_on(Store::new(flash, STORE_REGION).save_change(change))
}

/// Loaded values, or the error.
fn load_values(flash: &mut Flash) -> Result<StoredValues, StoreError> {
    let LoadedValues { stored_values: stored, load_error: error } = load_readable_values(flash);
    error.map_or(Ok(stored), Err)
}

fn load_readable_values(flash: &mut Flash) -> LoadedValues {
    block_on(Store::new(flash, STORE_REGION).load_state())
}

fn load_stored_calibrations(flash: &mut Flash) -> Result<StoredCalibrations, StoreError> {
    load_values(flash).map(|stored| stored.stored_calibrations)
}

#[test]
fn an_empty_flash_gives_the_defaults() {
    assert_eq!(load_values(&mut Flash::new(PAGE_COUNT)), Ok(StoredValues::default()));
}

#[test]
fn settings_and_calibrations_do_not_disturb_each_other() {
    let mut flash = flash_after_saves(5);
    let only_current = StoredCalibrations { previous_calibration: None, ..stored_calibrations(7) };
    for (change, stored_calibrations) in [
        (StoreChange::Settings(&settings()), stored_calibrations(5)),
        (calibration_change(&stored_calibrations(6)), stored_calibrations(6)),
        (calibration_change(&only_current), only_current),
        (StoreChange::Clear, StoredCalibrations::default()),
    ] {
        save_change(&mut flash, change).unwrap();
        let expected = StoredValues { settings: settings(), stored_calibrations, ..StoredValues::default() };
        assert_eq!(load_values(&mut flash), Ok(expected));
    }
}

#[test]
#[should_panic(expected = "assertion failed")]
fn a_region_that_is_too_small_is_refused() {
    let _ = Store::new(&mut Flash::new(PAGE_COUNT), 0..(5 * PAGE_SIZE) as u32);
}

#[test]
fn a_stored_calibration_clears_the_collecting_flag() {
    let startup_values =
        StartupValues { is_collecting: true, detected_protocols: [ProtocolKind::Msp, ProtocolKind::Auto] };
    let none = StoreChange::StoredCalibrations { current: None, previous: None };
    for (change, is_collecting) in
        [(StoreChange::Settings(&settings()), true), (none, false), (StoreChange::Clear, false)]
    {
        let mut flash = flash_after_saves(1);
        save_change(&mut flash, StoreChange::StartupValues(startup_values)).unwrap();
        assert_eq!(load_values(&mut flash).unwrap().startup_values, startup_values);
        save_change(&mut flash, change).unwrap();
        assert_eq!(load_values(&mut flash).unwrap().startup_values, StartupValues { is_collecting, ..startup_values });
    }
}

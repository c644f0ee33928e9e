//! Values out of their ranges are neither stored nor loaded.

use super::*;
use crate::settings::AttitudeError;
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

/// Orientation with any number, as read from flash.
fn orientation_of_number(number: u8) -> Orientation {
    postcard::from_bytes(&[number]).unwrap()
}

#[test]
fn settings_are_kept_up_to_the_ends_of_their_ranges() {
    let good = StoredState { settings: settings(), ..StoredState::default() };
    let check =
        |settings: Settings, valid, label: &str| assert_validity(&StoredState { settings, ..good }, valid, label);
    for (size, valid) in
        [(0.0, true), (179.9, true), (180.0, true), (180.1, false), (f32::INFINITY, false), (f32::NAN, false)]
    {
        for deg in [size, -size] {
            check(Settings { declination_deg: Some(deg), ..good.settings }, valid, "declination");
            check(Settings { align_deg: deg, ..good.settings }, valid, "align");
        }
    }
    for (size, valid) in [(89.9, true), (90.0, true), (90.1, false), (f32::NAN, false)] {
        for deg in [size, -size] {
            check(Settings { inclination_deg: Some(deg), ..good.settings }, valid, "inclination");
        }
    }
    for (stream_rate_hz, valid) in [(0, false), (1, true), (80, true), (81, false)] {
        check(Settings { stream_rate_hz, ..good.settings }, valid, "rate");
    }
    for (bias_deg, valid) in
        [(-0.1, false), (0.0, true), (5.0, true), (5.1, false), (f32::INFINITY, false), (f32::NAN, false)]
    {
        let attitude_error = AttitudeError { bias_deg, ..AttitudeError::DEFAULT };
        check(Settings { attitude_error, ..good.settings }, valid, "attitude bias");
        let attitude_error = AttitudeError { bank_percent: 4.0 * bias_deg, ..AttitudeError::DEFAULT };
        check(Settings { attitude_error, ..good.settings }, valid, "bank error");
    }
    for (accuracy_deg, valid) in
        [(0.19, false), (0.2, true), (3.0, true), (3.1, false), (-1.0, false), (f32::NAN, false)]
    {
        check(Settings { accuracy_deg, ..good.settings }, valid, "accuracy");
    }
    for (number, valid) in [(23, true), (24, false), (255, false)] {
        check(Settings { mount: orientation_of_number(number), ..good.settings }, valid, "mount");
    }
}

type SetNumber = fn(&mut CalibrationRecord, f32);

#[test]
fn records_are_kept_if_every_number_is_finite() {
    let numbers: [(&str, SetNumber); 18] = [
        ("w", |record, n| record.calibration.w[2][1] = n),
        ("b", |record, n| record.calibration.b_ut[1] = n),
        ("inclination", |record, n| record.calibration.inclination_rad = n),
        ("total", |record, n| record.calibration.total_ut = n),
        ("latency", |record, n| record.calibration.latency_s = n),
        ("by current", |record, n| record.calibration.motor_current.ut_per_a[2] = n),
        ("sigma of that", |record, n| record.calibration.motor_current.sigma_ut_per_a = n),
        ("mean current", |record, n| record.calibration.motor_current.mean_current_a = n),
        ("its spread", |record, n| record.calibration.motor_current.current_sigma_a = n),
        ("latency found", |record, n| record.quality.latency = Some(AttitudeLatency { estimate_s: n, sigma_s: 0.01 })),
        ("its sigma", |record, n| record.quality.latency = Some(AttitudeLatency { estimate_s: 0.01, sigma_s: n })),
        ("expected", |record, n| record.quality.expected_rms_deg = n),
        ("worst", |record, n| record.quality.expected_worst_deg = n),
        ("norm", |record, n| record.quality.norm_residual = n),
        ("inclination", |record, n| record.quality.inclination_residual_deg = n),
        ("products", |record, n| record.uncertainty.reduced_covariance[5][9] = n),
        ("sensor sigma", |record, n| record.uncertainty.relative_sensor_sigma = n),
        ("attitude sigma", |record, n| record.uncertainty.attitude_sigma_rad = n),
    ];
    for (label, set) in numbers {
        for (number, valid) in
            [(0.5, true), (f32::MAX, true), (f32::INFINITY, false), (-f32::INFINITY, false), (f32::NAN, false)]
        {
            let mut record = calibration_record(1);
            set(&mut record, number);
            assert_validity(&record, valid, label);
        }
    }
    for (number, valid) in [(23, true), (24, false)] {
        assert_validity(
            &CalibrationRecord { mount: orientation_of_number(number), ..calibration_record(1) },
            valid,
            "mount",
        );
    }
}

#[test]
fn an_invalid_calibration_is_rejected_and_not_written() {
    let bad = CalibrationRecord { mount: orientation_of_number(24), ..calibration_record(9) };
    for (current, previous) in [(&bad, &calibration_record(8)), (&calibration_record(9), &bad)] {
        let mut flash = flash_after_saves(2);
        flash.operation_count = 0;
        let change = StoreChange::StoredCalibrations { current: Some(current), previous: Some(previous) };
        assert_eq!(save_change(&mut flash, change), Err(StoreError::Invalid));
        assert_eq!(flash.operation_count, 0);
    }
}

//! Stored values and the tags of their fields.

use serde::{Deserialize, Serialize};

use super::fields::{FieldVisitor, StoredFields};
use crate::settings::{Field, PORT_COUNT, ProtocolKind, SETTINGS, Settings};
use autoswing::attitude::HAS_OWN_ATTITUDE;
use autoswing::calibration::{
    AttitudeEnvelope, AttitudeLatency, Calibration, HeadingUncertainty, Method, MotorCurrentInterference, Orientation,
    Quality,
};
use autoswing::inertial::SensorOffsets;
use autoswing::reading::{Identity, MagnetometerModel};

/// Pages for calibrations: two that the valid state refers to, and two for the next state.
pub(super) const CALIBRATION_SLOTS: u8 = 4;

/// A calibration, with sensor and mounting for which it is valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationRecord {
    /// Calibration coefficients.
    pub calibration: Calibration,
    /// Expected accuracy of the calibration.
    pub quality: Quality,
    /// Heading uncertainty of the calibration.
    pub uncertainty: HeadingUncertainty,
    /// Sensor of the samples.
    pub sensor: Identity,
    /// Mounting of the sensor.
    pub mount: Orientation,
    /// Sequence number of accepted calibrations.
    pub serial_number: u32,
    /// Offsets of the module's gyro and accelerometer at the end of the collection.
    pub sensor_offsets: SensorOffsets,
}

impl CalibrationRecord {
    /// Whether all numbers are finite and the mounting is one of the 24.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let Quality { expected_rms_deg, expected_worst_deg, norm_residual, inclination_residual_deg, latency, .. } =
            self.quality;
        let AttitudeLatency { estimate_s: found_s, sigma_s } =
            latency.unwrap_or(AttitudeLatency { estimate_s: 0.0, sigma_s: 0.0 });
        self.calibration.is_finite()
            && self.uncertainty.is_finite()
            && [expected_rms_deg, expected_worst_deg, norm_residual, inclination_residual_deg, found_s, sigma_s]
                .iter()
                .all(|number| number.is_finite())
            && self.mount.is_valid()
            && (!HAS_OWN_ATTITUDE || self.sensor_offsets.is_finite())
    }
}

/// All fields are required.
impl StoredFields for CalibrationRecord {
    fn with_defaults() -> Self {
        Self {
            calibration: Calibration::uncalibrated(Orientation::IDENTITY_ROTATION),
            quality: Quality {
                method: Method::Level,
                envelope: AttitudeEnvelope::Level,
                expected_rms_deg: 0.0,
                expected_worst_deg: 0.0,
                norm_residual: 0.0,
                inclination_residual_deg: 0.0,
                samples: 0,
                latency: None,
                knows_inclination: true,
            },
            uncertainty: HeadingUncertainty::NO_UNCERTAINTY,
            sensor: Identity { model: MagnetometerModel::Lis3mdl, address: 0 },
            mount: Orientation::IDENTITY_ROTATION,
            serial_number: 0,
            sensor_offsets: SensorOffsets::UNKNOWN,
        }
    }

    fn visit_fields(&mut self, visitor: &mut impl FieldVisitor) {
        let Self { calibration, quality, uncertainty, sensor, mount, serial_number: serial, sensor_offsets } = self;
        let Calibration { w, b_ut, inclination_rad, total_ut, latency_s, motor_current: current } = calibration;
        visitor.visit_required(1, w);
        visitor.visit_required(2, b_ut);
        visitor.visit_required(3, inclination_rad);
        visitor.visit_required(4, total_ut);
        visitor.visit_required(5, latency_s);
        let MotorCurrentInterference { ut_per_a, sigma_ut_per_a, mean_current_a: mean_a, current_sigma_a } = current;
        visitor.visit_required(6, ut_per_a);
        visitor.visit_required(7, sigma_ut_per_a);
        visitor.visit_required(8, mean_a);
        visitor.visit_required(9, current_sigma_a);
        let Quality {
            method,
            envelope,
            expected_rms_deg,
            expected_worst_deg,
            norm_residual,
            inclination_residual_deg,
            samples,
            latency,
            knows_inclination,
        } = quality;
        visitor.visit_required(10, method);
        visitor.visit_required(11, envelope);
        visitor.visit_required(12, expected_rms_deg);
        visitor.visit_required(13, expected_worst_deg);
        visitor.visit_required(14, norm_residual);
        visitor.visit_required(15, inclination_residual_deg);
        visitor.visit_required(16, samples);
        visitor.visit_required(17, latency);
        let HeadingUncertainty { reduced_covariance, relative_sensor_sigma, attitude_sigma_rad } = uncertainty;
        visitor.visit_required(18, reduced_covariance);
        visitor.visit_required(19, relative_sensor_sigma);
        visitor.visit_required(20, attitude_sigma_rad);
        let Identity { model, address } = sensor;
        visitor.visit_required(21, model);
        visitor.visit_required(22, address);
        visitor.visit_required(23, mount);
        visitor.visit_required(24, serial);
        visitor.visit_required(25, knows_inclination);
        if HAS_OWN_ATTITUDE {
            visitor.visit_optional(26, &mut sensor_offsets.gyro_rad_s);
            visitor.visit_optional(27, &mut sensor_offsets.accelerometer_m_s2);
            visitor.visit_optional(28, &mut sensor_offsets.gyro_sigma_rad_s);
            visitor.visit_optional(29, &mut sensor_offsets.temperature_c);
            visitor.visit_optional(30, &mut sensor_offsets.movement_m_s);
        }
    }

    fn is_valid(&self) -> bool {
        Self::is_valid(self)
    }
}

/// Current and previous calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoredCalibrations {
    /// Active calibration, if any.
    pub current_calibration: Option<CalibrationRecord>,
    /// Calibration that [`undo_last`](Self::undo_last) restores.
    pub previous_calibration: Option<CalibrationRecord>,
}

impl StoredCalibrations {
    /// Adds a new current calibration; the current one becomes the previous one.
    pub fn make_current(&mut self, record: &CalibrationRecord) {
        self.previous_calibration = self.current_calibration;
        self.current_calibration = Some(*record);
    }

    /// Swaps the current and the previous calibration, so that a second `undo` reverses the first.
    pub fn undo_last(&mut self) {
        core::mem::swap(&mut self.current_calibration, &mut self.previous_calibration);
    }

    /// Removes both calibrations.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// All stored values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoredValues {
    /// User settings.
    pub settings: Settings,
    /// Current and previous calibration.
    pub stored_calibrations: StoredCalibrations,
    /// Values for the next start.
    pub startup_values: StartupValues,
}

/// Values that the module stores for its next start without a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartupValues {
    /// Whether a collection is running. Its samples are in RAM only, and lost with the power.
    pub is_collecting: bool,
    /// Detected protocol of each port; `Auto` if none.
    pub detected_protocols: [ProtocolKind; PORT_COUNT],
}

impl StartupValues {
    /// No collection and no detected protocol.
    pub const DEFAULT: Self = Self { is_collecting: false, detected_protocols: [ProtocolKind::Auto; PORT_COUNT] };
}

impl Default for StartupValues {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Change made by a save. All other values are preserved.
#[derive(Clone, Copy, Debug)]
pub enum StoreChange<'a> {
    /// New settings of the user.
    Settings(&'a Settings),
    /// New calibrations, possibly already stored.
    StoredCalibrations {
        /// New active calibration.
        current: Option<&'a CalibrationRecord>,
        /// New previous calibration.
        previous: Option<&'a CalibrationRecord>,
    },
    /// New values for the next start.
    StartupValues(StartupValues),
    /// Removes both calibrations; in a store of another format, everything.
    Clear,
}

/// Slot of a stored calibration, and the CRC of the item expected there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlotReference {
    pub slot: u8,
    pub crc: u32,
}

/// State item: everything except the calibrations, which it refers to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoredState {
    /// Number of saves; the state with the highest is valid. Cannot overflow: a page endures 10,000 erases.
    pub save_count: u32,
    pub current_slot: Option<SlotReference>,
    pub previous_slot: Option<SlotReference>,
    pub settings: Settings,
    pub startup_values: StartupValues,
}

impl StoredFields for StoredState {
    fn with_defaults() -> Self {
        Self::default()
    }

    fn visit_fields(&mut self, visitor: &mut impl FieldVisitor) {
        let Self { save_count: saves, current_slot: current, previous_slot: previous, settings, startup_values } = self;
        visitor.visit_required(1, saves);
        visitor.visit_required(2, current);
        visitor.visit_required(3, previous);
        let StartupValues { is_collecting, detected_protocols: [first, second] } = startup_values;
        for tag in FIRST_SETTING_TAG..=LAST_TAG {
            match tag {
                20 => visitor.visit_optional(tag, is_collecting),
                21 => visitor.visit_optional(tag, first),
                22 => visitor.visit_optional(tag, second),
                _ => visit_setting(tag, settings, visitor),
            }
        }
        visitor.visit_optional(REPLACED_NUMBERS_TAG, &mut settings.replaced_numbers);
    }

    fn is_valid(&self) -> bool {
        let mut references = [self.current_slot, self.previous_slot].into_iter().flatten();
        references.all(|reference| reference.slot < CALIBRATION_SLOTS) && self.settings.is_valid()
    }
}

/// Tag of the first setting.
const FIRST_SETTING_TAG: u8 = 4;

/// Largest tag. The tags of settings and of three startup values have no gap.
const LAST_TAG: u8 = FIRST_SETTING_TAG + SETTINGS.len() as u8 + 2;

/// Tag of the autopilot's numbers, which have no row: far from the tags of later rows.
const REPLACED_NUMBERS_TAG: u8 = 200;

/// Visits the setting with a tag, if there is one, in the type that its kind is stored as. A choice is its number.
fn visit_setting(tag: u8, settings: &mut Settings, visitor: &mut impl FieldVisitor) {
    let Some(setting) = SETTINGS.iter().find(|setting| setting.stored_tag == tag) else { return };
    match (setting.field)(settings) {
        Field::Choice(choice) => {
            let mut number = choice.number();
            visitor.visit_optional(tag, &mut number);
            choice.set_number(number);
        }
        Field::Whole(number) => visitor.visit_optional(tag, number),
        Field::Number(number) => visitor.visit_optional(tag, number),
        Field::Angle(angle_deg) => visitor.visit_optional(tag, angle_deg),
        Field::Key(key) => visitor.visit_optional(tag, key),
    }
}

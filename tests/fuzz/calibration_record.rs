//! A stored calibration; a fixture of the fuzz tests, too.

use autoswing::calibration::{AttitudeEnvelope, Calibration, HeadingUncertainty, Method, Orientation, Quality};
use autoswing::inertial::SensorOffsets;
use autoswing::reading::{Identity, MagnetometerModel};
use autoswing_module::store::CalibrationRecord;

pub fn calibration_record(serial: u32) -> CalibrationRecord {
    let calibration =
        Calibration { b_ut: [serial as f32, 2.0, 3.0], ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) };
    let quality = Quality {
        method: Method::MaximumLikelihood,
        envelope: AttitudeEnvelope::Banked,
        expected_rms_deg: 0.3,
        expected_worst_deg: 0.7,
        norm_residual: 0.004,
        inclination_residual_deg: 0.4,
        samples: u16::MAX,
        latency: None,
        knows_inclination: true,
    };
    let sensor = Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E };
    CalibrationRecord {
        calibration,
        quality,
        uncertainty: HeadingUncertainty::NO_UNCERTAINTY,
        sensor,
        mount: Orientation::IDENTITY_ROTATION,
        serial_number: serial,
        sensor_offsets: SensorOffsets::UNKNOWN,
    }
}

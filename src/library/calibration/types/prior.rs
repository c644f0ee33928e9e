//! Prior knowledge of a calibration.

use super::orientation::Orientation;

/// Mounting, inclination and averaging, as known before a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Mounting of the sensor.
    pub mount: Orientation,
    /// Inclination of the local Earth field, radians, positive down, if known.
    pub inclination_rad: Option<f32>,
    /// Whether the inclination is that of a field model: samples that contradict it are solved without it.
    pub is_inclination_modelled: bool,
    /// Number of sensor readings averaged in each sample.
    pub readings_per_sample: u16,
}

/// Sensor aligned with the body, unknown field, single readings.
impl Default for Prior {
    fn default() -> Self {
        Self {
            mount: Orientation::IDENTITY_ROTATION,
            inclination_rad: None,
            is_inclination_modelled: false,
            readings_per_sample: 1,
        }
    }
}

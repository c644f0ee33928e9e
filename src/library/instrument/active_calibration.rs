//! The active calibration: all that a reading is corrected with, replaced as a whole.

use super::correction::Correction;
use super::monitor::{MonitorOutput, MonitoredCalibration};
use super::output_map::OutputMap;
use crate::calibration::{Calibration, HeadingUncertainty};
use crate::frames::{Body, Field, Sensor};
use crate::time::Timestamp;

#[derive(Clone, Debug)]
pub(super) struct ActiveCalibration {
    /// Correction that the state machine set, with the calibration as stored.
    pub stored_correction: Correction,
    /// The monitor's adjustment of `stored_correction`.
    pub adjustment: MonitorOutput,
    /// Time of the adjustment.
    pub adjusted_at: Timestamp,
    /// Calibration of `stored_correction` as adjusted by the monitor; `None` if uncalibrated.
    pub adjusted_calibration: Option<(Calibration, HeadingUncertainty)>,
    /// Map of the corrected field to the compass field.
    pub output_map: OutputMap,
}

impl ActiveCalibration {
    /// A correction without an adjustment.
    pub fn new(stored_correction: Correction) -> Self {
        Self {
            adjustment: MonitorOutput::INITIAL,
            adjusted_at: Timestamp::START,
            adjusted_calibration: stored_correction.calibration,
            output_map: OutputMap::new(&stored_correction, total_field_ut(stored_correction.calibration.as_ref())),
            stored_correction,
        }
    }

    /// Another correction with the same calibration, hence the same adjustment.
    pub fn with_stored_correction(self, stored_correction: Correction) -> Self {
        let output_map = OutputMap::new(&stored_correction, total_field_ut(self.adjusted_calibration.as_ref()));
        Self { stored_correction, output_map, ..self }
    }

    /// Adjusts the calibration to the monitor's states.
    pub fn apply_monitor_output(&mut self, at: Timestamp, adjustment: &MonitorOutput, readings_per_sample: u16) {
        let Some((calibration, uncertainty)) = &self.stored_correction.calibration else { return };
        let monitored = MonitoredCalibration { calibration, uncertainty, readings_per_sample };
        self.adjusted_calibration = Some(adjustment.correct_calibration(&monitored));
        self.output_map = OutputMap::new(&self.stored_correction, total_field_ut(self.adjusted_calibration.as_ref()));
        (self.adjustment, self.adjusted_at) = (*adjustment, at);
    }

    /// Calibration applied to readings; before the first calibration, the mounting alone.
    pub fn calibration(&self) -> Option<Calibration> {
        let adjusted = self.adjusted_calibration.as_ref().map(|(calibration, _)| *calibration);
        adjusted.or_else(|| self.stored_correction.mount.map(Calibration::uncalibrated))
    }

    /// A reading without motor-current interference.
    pub fn remove_motor_current(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Sensor> {
        self.adjusted_calibration
            .as_ref()
            .map_or(field, |(calibration, _)| calibration.remove_motor_current(field, current_a))
    }

    /// The field of a reading by the stored calibration; without one, the raw field.
    pub fn field_as_stored(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Body> {
        self.stored_correction.calibration.as_ref().map_or(Field::new(field.ut), |(calibration, _)| {
            calibration.calibrated_field(calibration.remove_motor_current(field, current_a))
        })
    }

    /// The corrected field of a reading; `None` without a calibration.
    pub fn calibrated_field(&self, field: Field<Sensor>) -> Option<Field<Body>> {
        self.adjusted_calibration.as_ref().map(|(calibration, _)| calibration.calibrated_field(field))
    }
}

fn total_field_ut(calibration: Option<&(Calibration, HeadingUncertainty)>) -> Option<f32> {
    calibration.map(|(calibration, _)| calibration.total_ut)
}

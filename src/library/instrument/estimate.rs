//! Results of the instrument at one time, and counters of rejected inputs.

use super::monitor::InstallationChange;
use crate::attitude::{EulerRates, RejectedReports};
use crate::frames::{Body, Field, RollPitch};
use crate::heading::{Heading, NoHeading};
use crate::time::Timestamp;

/// Results of the instrument at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Time of the reading, or of the silence.
    pub timestamp: Timestamp,
    /// Corrected field in body axes, in the sensor's microtesla, without alignment. `None` without a calibration, and
    /// if the sensor is silent or faulty. Needs no attitude.
    pub body_field: Option<Field<Body>>,
    /// Field for an autopilot's compass, body axes, microtesla: corrected by calibration and monitor, with alignment,
    /// scaled to the true field strength if known. `None` while not trusted. Needs no attitude. Before the first
    /// calibration it is the raw field.
    pub compass_field: Option<Field<Body>>,
    /// Heading with alignment, or the reason for its absence.
    pub heading: Result<Heading, NoHeading>,
    /// Heading smoothed with the body rates; `None` without a heading, and while the rates are missing, new or
    /// inconsistent with it.
    pub smoothed_heading: Option<Heading>,
    /// Attitude at the time of the reading, if reports are recent.
    pub attitude: Option<RollPitch>,
    /// Standard deviations of roll and pitch, radians, of an attitude of the module's own sensors.
    pub tilt_sigmas_rad: Option<[f32; 2]>,
    /// Rates of the attitude and of the heading by a gyro.
    pub euler_rates: Option<EulerRates>,
    /// Change of hard iron since the calibration, once significant.
    pub installation_change: Option<InstallationChange>,
    /// Motor current, amperes, if reported recently.
    pub current_a: Option<f32>,
}

impl Estimate {
    /// State before the first reading.
    pub const EMPTY: Self = Self {
        timestamp: Timestamp::START,
        body_field: None,
        compass_field: None,
        heading: Err(NoHeading::SensorSilent),
        smoothed_heading: None,
        attitude: None,
        tilt_sigmas_rad: None,
        euler_rates: None,
        installation_change: None,
        current_a: None,
    };
}

/// Rejected inputs by reason; each counter wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectionCounts {
    /// Readings without an attitude.
    pub unpaired_readings: u32,
    /// Readings at the chip's range limit.
    pub saturated_readings: u32,
    /// Readings with an axis limited below the chip's range.
    pub clipped_readings: u32,
    /// Readings with an axis that repeats.
    pub stuck_readings: u32,
    /// Readings too far from the previous one.
    pub spike_readings: u32,
    /// Motor currents that the field strength contradicts.
    pub contradicted_currents: u32,
    /// Rejected attitude reports.
    pub rejected_reports: RejectedReports,
}

impl RejectionCounts {
    /// All counts zero.
    pub const NO_REJECTIONS: Self = Self {
        unpaired_readings: 0,
        saturated_readings: 0,
        clipped_readings: 0,
        stuck_readings: 0,
        spike_readings: 0,
        contradicted_currents: 0,
        rejected_reports: RejectedReports::NO_REJECTIONS,
    };
}

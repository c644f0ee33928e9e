//! A logged flight, independent of the log's format.

use std::collections::BTreeMap;
use std::fmt;

use autoswing::calibration::Orientation;
use autoswing::earth::{Date, EarthField, Position};
use nalgebra::Vector3;
use serde::Serialize;

use super::compass_slot::{CompassSlot, DeviceId, UnknownSlot, ardupilot_vector, external_parameter, firmware_version};
use super::correction::FieldCorrection;
use super::correction_residual::CorrectionResidual;
use super::load::LoadSource;
use super::mounting::{CustomRotation, NumberedRotation, logged_mounting, mounting_parameters, orientation_parameter};
use super::time_series::Series;
use super::vtol_view::VtolView;
use crate::log::parameters::ParameterHistory;
use crate::numbers::median;

/// Format of a log file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum LogFormat {
    /// Binary DataFlash log of ArduPilot.
    DataFlash,
    /// DataFlash log of ArduPilot as text.
    DataFlashText,
    /// ULog of PX4.
    ULog,
    /// MAVLink frames with the receiver's clock.
    TLog,
    /// Table of comma-separated values.
    #[default]
    Csv,
    /// Blackbox of INAV or Betaflight.
    Blackbox,
}

impl LogFormat {
    /// The format's usual name.
    #[must_use]
    pub const fn format_name(self) -> &'static str {
        match self {
            Self::DataFlash => "ArduPilot DataFlash",
            Self::DataFlashText => "ArduPilot DataFlash text",
            Self::ULog => "PX4 ULog",
            Self::TLog => "MAVLink tlog",
            Self::Csv => "CSV",
            Self::Blackbox => "blackbox",
        }
    }

    /// Default latency of a logged field, seconds. ArduPilot's rows are means over the preceding interval (usually 10
    /// Hz); MAVLink adds transmission.
    #[must_use]
    pub const fn default_field_latency_s(self) -> f64 {
        match self {
            Self::DataFlash | Self::DataFlashText => 0.05,
            Self::TLog => 0.09,
            Self::ULog | Self::Csv | Self::Blackbox => 0.0,
        }
    }
}

/// The autopilot that wrote the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum AutopilotKind {
    /// ArduPilot.
    ArduPilot,
    /// PX4.
    Px4,
    /// INAV, or Betaflight, whose blackbox is the same.
    Inav,
    /// An autopilot that the log does not identify.
    #[default]
    Unknown,
}

/// Axes that a logged attitude is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeView {
    /// The axes of the body, which the compass is fixed to.
    #[default]
    Body,
    /// The axes of the body, from this message in place of the autopilot's own attitude, which is the VTOL view.
    BodyForVtol(&'static str),
    /// The axes of the body, by undoing the view of VTOL modes, which flight modes and parameters give.
    BodyByModes,
    /// The view of VTOL modes, which may differ from the body.
    Vtol(VtolView),
}

/// A compass of the aircraft.
#[derive(Clone, Debug)]
pub struct LoggedCompass {
    /// The autopilot's number of the compass in its messages, from 1; ArduPilot's priority.
    pub compass_number: u8,
    /// Slot of its calibration parameters.
    pub slot: CompassSlot,
    /// Device id of the sensor, if logged.
    pub device_id: Option<DeviceId>,
    /// Raw field x, y, z and the field as the autopilot corrected it, body axes, microtesla.
    pub field: Series<6>,
    /// The autopilot's last correction; none if its parameters or its slot are unknown.
    pub correction: Option<FieldCorrection>,
    /// Difference of the corrected field from the corrected raw field, where the log has both.
    pub correction_residual: Option<CorrectionResidual>,
    /// Whether the autopilot uses it for its heading, if known.
    pub is_used_for_heading: Option<bool>,
}

#[cfg(test)]
impl LoggedCompass {
    /// A compass without readings.
    pub(crate) const fn without_readings(compass_number: u8, slot: CompassSlot) -> Self {
        Self {
            compass_number,
            slot,
            device_id: None,
            field: Series::new(),
            correction: None,
            correction_residual: None,
            is_used_for_heading: None,
        }
    }
}

/// Row of [`LoggedFlight::gps`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gps {
    /// Latitude, degrees.
    pub latitude_deg: f32,
    /// Longitude, degrees.
    pub longitude_deg: f32,
    /// Height above mean sea level, metres.
    pub height_m: f32,
    /// Speed over ground, m/s.
    pub speed_m_s: f32,
    /// Course over ground from true north, degrees.
    pub course_deg: f32,
    /// Heading from two antennas, degrees from true north; NaN if absent.
    pub yaw_deg: f32,
}

impl Gps {
    /// Values in the order of the columns of [`LoggedFlight::gps`].
    #[must_use]
    pub const fn columns(self) -> [f32; 6] {
        let Self { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg } = self;
        [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg]
    }

    /// GPS row from its values in column order.
    #[must_use]
    pub const fn from_columns(
        [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg]: [f32; 6],
    ) -> Self {
        Self { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg }
    }
}

/// Numbers of rows and messages skipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SkippedCounts {
    /// Number of unrecognised bytes, or of lines of a table.
    pub garbage: u64,
    /// Number of messages with an invalid time.
    pub bad_times: u64,
    /// Number of rows that repeat a time.
    #[serde(rename = "repeats")]
    pub repeated_times: u64,
    /// Number of magnetometer readings that are out of range or marked unhealthy.
    #[serde(rename = "unhealthy")]
    pub rejected_readings: u64,
    /// Number of fields of PX4 sensors without device id, which no parameters can be assigned to.
    #[serde(rename = "unassigned")]
    pub unassigned_fields: u64,
    /// Number of currents of exactly 0 or -1 A between rows of usual current.
    pub current_dropouts: u64,
    /// Number of messages of other MAVLink systems.
    #[serde(rename = "others")]
    pub other_system_messages: u64,
    /// Number of restarts of the autopilot.
    pub restarts: u32,
}

/// A logged flight: the series of all sensors on one clock, parameters, and counts of skipped rows.
#[derive(Clone, Debug, Default)]
pub struct LoggedFlight {
    /// Format of the log.
    pub log_format: LogFormat,
    /// The autopilot that wrote the log.
    pub autopilot: AutopilotKind,
    /// The autopilot's firmware name.
    pub firmware_name: Option<String>,
    /// Whether it is a rotorcraft.
    pub is_copter: bool,
    /// The compasses of the aircraft.
    pub compasses: Vec<LoggedCompass>,
    /// The autopilot's roll, pitch and yaw from true north, radians; yaw is NaN if absent.
    pub attitude: Series<3>,
    /// Message that replaced a missing autopilot attitude.
    pub fallback_attitude_message: Option<&'static str>,
    /// Axes that the attitude is of.
    pub attitude_view: AttitudeView,
    /// Body rates p, q, r, rad/s: as logged, repaired, or differences of the attitude.
    pub body_rates: Series<3>,
    /// Why `body_rates` were repaired or replaced by differences of the attitude; `None` if as logged.
    pub rates_problem: Option<RatesProblem>,
    /// Sign of each logged body rate relative to `body_rates`: -1 for an axis whose sign was repaired.
    pub logged_rate_signs: [f32; 3],
    /// Whether `body_rates` were measured, so that they give a heading; differences of the attitude do not.
    pub has_measured_rates: bool,
    /// GPS rows; columns as in [`Gps`].
    pub gps: Series<6>,
    /// Battery current, amperes, not negative; empty if the log has zeros only.
    pub battery_current: Series<1>,
    /// Whether the logged current is negative, and used by its size.
    pub is_current_negated: bool,
    /// Outputs, 0 to 1, and currents beside that of the first battery, amperes.
    pub loads: BTreeMap<LoadSource, Series<1>>,
    /// Times and armed states at each change; before the first change the aircraft had the opposite state.
    pub armed_changes: Vec<(f64, bool)>,
    /// Latencies of GPS yaw and of the reference heading that were removed: name of the heading, and seconds.
    pub heading_latencies: Vec<(&'static str, f64)>,
    /// A simulator's true roll, pitch and yaw, radians, for scoring only.
    pub true_attitude: Series<3>,
    /// Logged reference heading, radians, from an arbitrary north.
    pub reference_heading: Series<1>,
    /// Whether fit and score may use the rows from a time on: 1, or 0 if the log excludes them.
    pub row_usability: Series<1>,
    /// The autopilot's parameters.
    pub parameters: ParameterHistory,
    /// Test ratio of the magnetometer in the autopilot's own filter, which rejects it above one.
    pub magnetometer_test_ratio: Series<1>,
    /// The autopilot's own texts about its compasses, with their times, seconds.
    pub compass_texts: Vec<(f64, String)>,
    /// Day of the flight.
    pub flight_date: Option<Date>,
    /// Number of rows without a time stamp; each is stored with the preceding message's time.
    pub rows_without_time: u64,
    /// MAVLink systems with an autopilot, first the one read.
    pub autopilot_system_ids: Vec<u8>,
    /// Components with an autopilot in the system that is read, first the one read.
    pub autopilot_component_ids: Vec<u8>,
    /// Counts of skipped rows.
    pub skipped_counts: SkippedCounts,
}

impl LoggedFlight {
    /// Turns the fields of all compasses from the axes of sensors of this orientation to body axes.
    pub fn rotate_fields_to_body(&mut self, orientation: Orientation) {
        let body_from_sensor = orientation.body_from_sensor();
        for row in self.compasses.iter_mut().flat_map(|compass| compass.field.rows_mut()) {
            let [x, y, z, logged_x, logged_y, logged_z] = row.row_values;
            let raw = body_from_sensor * Vector3::new(x, y, z);
            let logged = body_from_sensor * Vector3::new(logged_x, logged_y, logged_z);
            row.row_values = [raw.x, raw.y, raw.z, logged.x, logged.y, logged.z];
        }
    }

    /// Replaces the orientation that the log gives for a compass, or for all compasses; the logged field is unchanged.
    ///
    /// # Errors
    ///
    /// The number of a compass whose orientation is that of the board, or unknown.
    pub fn set_orientation(&mut self, orientation: Orientation, compass_number: Option<u8>) -> Result<(), u8> {
        let Self { compasses, parameters, autopilot, .. } = self;
        let is_px4 = *autopilot == AutopilotKind::Px4;
        let body_from_sensor = orientation.body_from_sensor().map(f64::from);
        let rotation = NumberedRotation::nearest_to_matrix(&body_from_sensor);
        for compass in compasses
            .iter_mut()
            .filter(|compass| compass_number.is_none_or(|compass_number| compass_number == compass.compass_number))
        {
            let slot = compass.slot.map_err(|_| compass.compass_number)?;
            let turn = |t_s: f64| {
                let logged = logged_mounting(parameters, is_px4, t_s, slot)?;
                Some(body_from_sensor * logged.transpose())
            };
            let last = turn(f64::INFINITY).ok_or(compass.compass_number)?;
            for row in compass.field.rows_mut() {
                let [x, y, z, ..] = row.row_values.map(f64::from);
                let raw = turn(row.t_s).unwrap_or(last) * Vector3::new(x, y, z);
                row.row_values[..3].copy_from_slice(raw.map(|axis| axis as f32).as_slice());
            }
            compass.correction = compass.correction.map(|correction| FieldCorrection {
                matrix: correction.matrix * last.transpose(),
                hard_iron_ut: last * correction.hard_iron_ut,
                motor_ut_per_a: last * correction.motor_ut_per_a,
            });
            parameters.replace_value(&orientation_parameter(is_px4, slot), rotation.rotation_number().into());
            // PX4 uses angles other than zero with any number.
            for name in CustomRotation::Px4(slot).angle_parameters().iter().filter(|_| is_px4) {
                if parameters.last_value(name).is_some() {
                    parameters.replace_value(name, 0.0);
                }
            }
        }
        Ok(())
    }

    /// The compass with this number.
    #[must_use]
    pub fn compass(&self, compass_number: u8) -> Option<&LoggedCompass> {
        self.compasses.iter().find(|compass| compass.compass_number == compass_number)
    }

    /// Slot of a compass in the names of its parameters.
    pub(crate) fn slot(&self, compass_number: u8) -> CompassSlot {
        self.compass(compass_number).map_or(Err(UnknownSlot::NoParameters), |compass| compass.slot)
    }

    /// Where the sensor of a compass is, its chip and its bus, as far as the log has them: `external RM3100, I2C bus 0`.
    #[must_use]
    pub fn sensor_description(&self, compass_number: u8) -> String {
        let is_px4 = self.autopilot == AutopilotKind::Px4;
        let place = self.slot(compass_number).ok().and_then(|slot| {
            // PX4: -1 is a sensor on the board, other numbers are orientations of an external one.
            let (name, least_external) =
                if is_px4 { (orientation_parameter(true, slot), 0.0) } else { (external_parameter(slot), 1.0) };
            let value = self.parameters.last_value(&name)?;
            Some(if value >= least_external { "external" } else { "internal" }.to_owned())
        });
        let device =
            self.compass(compass_number).and_then(|compass| compass.device_id).map(|id| id.chip_and_bus(is_px4));
        place.into_iter().chain(device).collect::<Vec<_>>().join(" ")
    }

    /// Major and minor version of the firmware, if its name has one.
    pub fn firmware_version(&self) -> Option<(u32, u32)> {
        self.firmware_name.as_deref().and_then(firmware_version)
    }

    /// Creates an empty flight.
    #[must_use]
    pub fn new(format: LogFormat) -> Self {
        Self { log_format: format, logged_rate_signs: [1.0; 3], has_measured_rates: true, ..Self::default() }
    }

    /// Whether the attitude has a yaw.
    pub(crate) fn has_yaw(&self) -> bool {
        self.attitude.rows().iter().any(|row| row.row_values[2].is_finite())
    }

    /// Whether the vehicle banks into its turns, as aeroplanes do; an unknown one may.
    #[must_use]
    pub fn banks_into_turns(&self) -> bool {
        let firmware = self.firmware_name.as_deref().unwrap_or_default();
        !self.is_copter && ["Rover", "Sub", "Blimp"].iter().all(|kind| !firmware.contains(kind))
    }

    /// Median position of the flight, which a damaged row does not move.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        let median_of =
            |column: usize| median(self.gps.rows().iter().map(|row| f64::from(row.row_values[column]))) as f32;
        Position::new(median_of(0), median_of(1), median_of(2))
    }

    /// Modelled Earth field at the middle of the flight, and whether the model is valid on that day; otherwise that of its
    /// first day.
    #[must_use]
    pub fn earth_field(&self) -> Option<(EarthField, bool)> {
        /// 2025-01-01, the model's first day.
        const MODEL_BEGINS_UNIX_S: u64 = 1_735_689_600;
        let position = self.position()?;
        let today = self.flight_date.and_then(|day| EarthField::from_model(position, day)).map(|field| (field, true));
        today.or_else(|| {
            EarthField::from_model(position, Date::from_unix_s(MODEL_BEGINS_UNIX_S)?).map(|field| (field, false))
        })
    }

    /// Times of the first and the last field row, seconds.
    #[must_use]
    pub fn time_range_s(&self) -> [f64; 2] {
        let ranges_s = self.compasses.iter().filter_map(|compass| {
            let rows = compass.field.rows();
            Some([rows.first()?.t_s, rows.last()?.t_s])
        });
        ranges_s.reduce(|[from, to], [first, last]| [from.min(first), to.max(last)]).unwrap_or_default()
    }

    /// Whether the aircraft was armed at a time; none if unknown.
    #[must_use]
    pub fn is_armed(&self, t_s: f64) -> Option<bool> {
        let &(_, first) = self.armed_changes.first()?;
        let latest = self.armed_changes.iter().take_while(|&&(at_s, _)| at_s <= t_s).last();
        Some(latest.map_or(!first, |&(_, is_armed_since)| is_armed_since))
    }
}

/// Mounting parameters of a compass or the board that changed in flight, with the time of the last change, seconds.
pub fn mounting_parameter_changes(flight: &LoggedFlight, compass_number: u8) -> Vec<(String, f64)> {
    let is_px4 = match flight.autopilot {
        AutopilotKind::ArduPilot => false,
        AutopilotKind::Px4 => true,
        AutopilotKind::Inav | AutopilotKind::Unknown => return Vec::new(),
    };
    let names = mounting_parameters(&flight.parameters, is_px4, flight.slot(compass_number).ok());
    let changed = |name: String| flight.parameters.last_change_s(&name).map(|at_s| (name, at_s));
    names.into_iter().filter_map(changed).collect()
}

/// ArduPilot's calibration parameters of a compass that are missing although another of the same x, y, z triple is present.
pub fn missing_ardupilot_parameters(flight: &LoggedFlight, compass_number: u8) -> Vec<String> {
    let slot = flight.slot(compass_number).ok().filter(|_| flight.autopilot == AutopilotKind::ArduPilot);
    let mut missing = Vec::new();
    for vector in slot.into_iter().flat_map(|slot| ["OFS", "DIA", "ODI"].map(|part| ardupilot_vector(part, slot))) {
        let (known, unknown): (Vec<_>, Vec<_>) =
            vector.into_iter().partition(|name| flight.parameters.last_value(name).is_some());
        if !known.is_empty() {
            missing.extend(unknown);
        }
    }
    missing
}

/// Reason why body rates are not used as logged; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RatesProblem {
    /// The log has no body rates.
    NotLogged,
    /// The body rate about this axis (0 to 2) has the opposite sign of the attitude's change.
    WrongSign(usize),
    /// Wrong unit: ratio of the attitude's change to the integrated body rates.
    WrongUnit(f64),
    /// Random walk of the heading integrated from the body rates, deg/s^0.5.
    Inexact(f64),
}

/// Largest relative deviation of a rate ratio from that of degrees to radians: noise of rates and attitude.
const MAX_RATIO_ERROR: f64 = 0.5;

impl RatesProblem {
    /// Factors by axis that correct the body rates; `None` if they must be replaced.
    pub(super) fn repair_factors(self) -> Option<[f32; 3]> {
        match self {
            Self::WrongSign(wrong) => Some(std::array::from_fn(|axis| if axis == wrong { -1.0 } else { 1.0 })),
            Self::WrongUnit(ratio) => [1_f64.to_degrees(), 1_f64.to_radians()]
                .into_iter()
                .find(|factor| (ratio / factor - 1.0).abs() < MAX_RATIO_ERROR)
                .map(|factor| [factor as f32; 3]),
            Self::NotLogged | Self::Inexact(_) => None,
        }
    }
}

impl fmt::Display for RatesProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotLogged => f.write_str("no body rates are logged"),
            Self::WrongSign(axis) => {
                let axis = ["x", "y", "z"][*axis];
                write!(f, "the body rate about {axis} has the sign opposite to the attitude's change")
            }
            Self::WrongUnit(ratio) => write!(
                f,
                "the attitude changes {ratio:.3} times as fast as the body rates, which are in another unit (degrees or \
                 radians)"
            ),
            Self::Inexact(walk_deg) => write!(
                f,
                "the body rates are sampled too coarsely (integrated, the heading drifts by {walk_deg:.1} deg in a second)"
            ),
        }
    }
}

//! A flight as an autopilot's sensors report it, for the writers of all formats.

use std::f64::consts::TAU;

/// Start of a flight: GPS week 2400, 2026-01-04, microseconds.
pub(super) const FLIGHT_START_UTC_US: u64 = 1_767_484_800_000_000;

/// Simulated autopilot data at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightSample {
    /// Time since start, microseconds.
    pub time_us: u64,
    /// Raw field of each compass, body axes, microtesla.
    pub field_ut: Vec<[f64; 3]>,
    /// Reported roll, pitch and yaw, radians.
    pub attitude_rad: [f64; 3],
    /// Body rates (roll, pitch, yaw axis), rad/s.
    pub rates_rad_s: [f64; 3],
    /// True heading, radians, from true north if the declination is known, else from magnetic north.
    pub heading_rad: f64,
    /// Velocity over ground towards north and east, m/s; of the same north as `heading_rad`.
    pub velocity_m_s: [f64; 2],
    /// Displacement from the start towards north and east, metres.
    pub displacement_m: [f64; 2],
    /// Motor current, amperes.
    pub current_a: f64,
    /// Whether the aircraft is armed.
    pub is_armed: bool,
    /// ArduPilot's number of the flight mode.
    pub flight_mode: u8,
    /// Outputs to servos and speed controllers, 0 to 1, at most 14.
    pub outputs: Vec<f64>,
    /// Currents of the speed controllers, amperes, at most 4.
    pub esc_currents_a: Vec<f64>,
    /// Currents of further batteries, amperes.
    pub further_currents_a: Vec<f64>,
}

/// Simulated autopilot data of a flight, to be written as a log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightRecording {
    /// Samples in order of time.
    pub samples: Vec<FlightSample>,
    /// The autopilot's parameters.
    pub parameters: Vec<(String, f64)>,
    /// Start: latitude, longitude, degrees, and height, metres.
    pub start_position: Option<[f64; 3]>,
    /// Declination at the start, degrees, east positive.
    pub declination_deg: f64,
    /// Whether the aircraft is a copter.
    pub is_copter: bool,
    /// Latency of the field, seconds.
    pub field_latency_s: f64,
}

impl FlightSample {
    /// Pulses of the outputs, microseconds, without those after the last; zero of outputs not in use.
    pub(super) fn output_pulses_us<const N: usize>(&self) -> [f64; N] {
        std::array::from_fn(|i| self.outputs.get(i).map_or(0.0, |fraction| (1000.0 + 1000.0 * fraction).round()))
    }

    /// Speed over ground, m/s, and course, radians, 0 to 2 pi.
    pub(super) fn speed_and_course(&self) -> [f64; 2] {
        let [north, east] = self.velocity_m_s;
        [libm::hypot(north, east), libm::atan2(east, north).rem_euclid(TAU)]
    }
}

impl FlightRecording {
    /// The recording with other parameters of the autopilot.
    #[must_use]
    pub fn with_parameters(self, parameters: &[(&str, f64)]) -> Self {
        let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        Self { parameters, ..self }
    }

    /// Latitude, longitude, degrees, and height, metres, of a sample.
    pub(super) fn sample_position(&self, sample: &FlightSample) -> Option<[f64; 3]> {
        /// Length of one degree of latitude, metres.
        const METRES_PER_DEGREE: f64 = 111_200.0;
        let [latitude_deg, longitude_deg, height_m] = self.start_position?;
        let [north_deg, east_deg] = sample.displacement_m.map(|metres| metres / METRES_PER_DEGREE);
        let shrinks = libm::cos(latitude_deg.to_radians());
        Some([latitude_deg + north_deg, longitude_deg + east_deg / shrinks, height_m])
    }

    pub(super) fn parameter_value(&self, name: &str) -> f64 {
        self.parameters.iter().find(|(parameter_name, _)| parameter_name == name).map_or(0.0, |&(_, value)| value)
    }

    /// ArduPilot's parameters `COMPASS_OFS_X`, `_Y` and `_Z` of a compass numbered from 1, or those of another vector.
    pub(super) fn ardupilot_vector(&self, vector_name: &str, compass_number: usize) -> [f64; 3] {
        let index = if compass_number == 1 { String::new() } else { compass_number.to_string() };
        ["X", "Y", "Z"].map(|axis| self.parameter_value(&format!("COMPASS_{vector_name}{index}_{axis}")))
    }

    /// ArduPilot's logged field of a compass numbered from 1, and the motor-current compensation in it, microtesla;
    /// independent of the reader's code.
    pub(in crate::log) fn ardupilot_field_ut(
        &self,
        sample: &FlightSample,
        compass_number: usize,
    ) -> ([f64; 3], [f64; 3]) {
        let index = if compass_number == 1 { String::new() } else { compass_number.to_string() };
        let scale = self.parameter_value(&format!("COMPASS_SCALE{index}"));
        let scale = if scale == 0.0 { 1.0 } else { scale };
        let [offset, diagonal, off_diagonal, motor] =
            ["OFS", "DIA", "ODI", "MOT"].map(|name| self.ardupilot_vector(name, compass_number));
        let raw = sample.field_ut.get(compass_number - 1).copied().unwrap_or_default();
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| (raw[axis] + offset[axis] / 10.0) * scale);
        let soft = if diagonal.iter().all(|axis| axis.abs() < f64::EPSILON) {
            [x, y, z]
        } else {
            [
                diagonal[0] * x + off_diagonal[0] * y + off_diagonal[1] * z,
                off_diagonal[0] * x + diagonal[1] * y + off_diagonal[2] * z,
                off_diagonal[1] * x + off_diagonal[2] * y + diagonal[2] * z,
            ]
        };
        let current_a = if self.parameter_value("COMPASS_MOTCT") as u8 == 2 { sample.current_a } else { 0.0 };
        let share = motor.map(|per_ten_amperes| per_ten_amperes / 10.0 * current_a);
        (std::array::from_fn(|axis| soft[axis] + share[axis]), share)
    }

    pub(super) fn compass_count(&self) -> usize {
        self.samples.first().map_or(0, |sample| sample.field_ut.len())
    }
}

//! World settings and the airframe file.

use std::fmt;

use autoswing::attitude::AttitudeSource;
use log_analysis::numbers::round_to;
use serde::Deserialize;

use super::aircraft::{VehicleConfig, VehicleKind};
use super::airframe::{Airframe, AirframeDescription};
use super::attitude_source::AttitudeSourceConfig;
use super::earth::Earth;
use super::gyro::GyroConfig;
use super::weather::Weather;
use crate::devices::sensor::SensorModel;
use crate::random::{RandomStream, StreamPurpose};

/// All settings of a world. Equal settings and seeds give equal worlds.
///
/// An airframe file has the tables `[airframe]` (required), `[earth]`, `[aircraft]`, `[weather]`, `[attitude_source]`,
/// `[gyro]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldConfig {
    /// Seed of all random streams.
    #[serde(skip)]
    pub seed: u64,
    /// Soft iron, hard iron and sensor mounting.
    pub airframe: Airframe,
    /// Earth's field at the place of the flight.
    #[serde(default)]
    pub earth: Earth,
    /// Motion settings of the vehicle.
    #[serde(default)]
    pub aircraft: VehicleConfig,
    /// Wind and turbulence.
    #[serde(default)]
    pub weather: Weather,
    /// Error model of the attitude source.
    #[serde(default)]
    pub attitude_source: AttitudeSourceConfig,
    /// Error model of the autopilot's gyro.
    #[serde(default)]
    pub gyro: GyroConfig,
    /// Motor-current interference at cruise or hover current, chip axes, microtesla.
    #[serde(skip)]
    pub current_interference_ut: [f64; 3],
    /// Whether the autopilot measures and reports the motor current.
    #[serde(skip)]
    pub reports_current: bool,
    /// Magnetometer of the module.
    #[serde(skip)]
    pub sensor: SensorModel,
    /// Source of the module's attitude: of the autopilot alone, and the module has no gyro; of its own gyro, and there is no
    /// autopilot; or of both.
    #[serde(skip)]
    pub attitude: AttitudeSource,
    /// Whether an attitude source that answers no requests reports position and date, in Xi'an.
    #[serde(skip)]
    pub reports_position: bool,
}

/// Reason why settings were rejected.
#[derive(Clone, Debug, PartialEq)]
pub enum ConfigError {
    /// The file is not valid TOML for an airframe; position and reason.
    Format(String),
    /// A number outside its allowed range.
    OutOfRange {
        /// Name of the setting in the file.
        setting: &'static str,
        /// Rejected value.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
}

impl ConfigError {
    /// Stable error code for scripts.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Format(_) => "airframe-format",
            Self::OutOfRange { .. } => "airframe-out-of-range",
        }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Format(message) => f.write_str(message.trim_end()),
            Self::OutOfRange { setting, value, min, max } => {
                write!(f, "{setting} is {value}; it must lie in {min} to {max}")
            }
        }
    }
}

impl std::error::Error for ConfigError {}

impl WorldConfig {
    /// Aircraft of Liu 2007 table 1 over Xi'an.
    #[must_use]
    pub fn of_table1(seed: u64) -> Self {
        Self { seed, airframe: Airframe::of_table1(), ..Self::default() }
    }

    /// Airframe and place drawn from the seed.
    #[must_use]
    pub fn random_world(seed: u64) -> Self {
        let earth = Earth::random_earth(seed);
        Self { seed, airframe: Airframe::random_airframe(seed, &earth), earth, ..Self::default() }
    }

    /// Parses the text of an airframe file (format: `host-sim/airframes/example.toml`).
    ///
    /// # Errors
    ///
    /// [`ConfigError::Format`] and [`ConfigError::OutOfRange`].
    pub fn from_toml(text: &str, seed: u64) -> Result<Self, ConfigError> {
        let file: Self = toml::from_str(text).map_err(|error| ConfigError::Format(error.to_string()))?;
        let config = Self { seed, ..file };
        config.validate()?;
        Ok(config)
    }

    /// The same world with another vehicle kind and the attitude errors typical for that kind.
    #[must_use]
    pub fn with_vehicle_kind(self, vehicle_kind: VehicleKind) -> Self {
        if vehicle_kind == self.aircraft.kind {
            return self;
        }
        let aircraft = VehicleConfig { kind: vehicle_kind, ..self.aircraft };
        let push_error_deg = vehicle_kind.tilt_error_deg_per_m_s2();
        Self { aircraft, attitude_source: AttitudeSourceConfig { push_error_deg, ..self.attitude_source }, ..self }
    }

    /// The same world with motor-current interference of this magnitude (microtesla) in a random direction.
    #[must_use]
    pub fn with_current_interference(self, size_ut: f64) -> Self {
        let current_ut = RandomStream::new(self.seed, StreamPurpose::Current).random_direction() * size_ut;
        Self { current_interference_ut: current_ut.into(), ..self }
    }

    /// Airframe file of this world for [`from_toml`](Self::from_toml): matrix to 0.0001, microtesla and degrees to
    /// 0.01.
    #[must_use]
    pub fn airframe_toml(&self) -> String {
        let AirframeDescription { soft_iron, hard_iron_ut, mounting_deg } = AirframeDescription::from(&self.airframe);
        let numbers = |values: [f64; 3], decimals: u8| {
            let ([x, y, z], digits) = (values.map(|value| round_to(value, decimals.into())), usize::from(decimals));
            format!("[{x:.digits$}, {y:.digits$}, {z:.digits$}]")
        };
        let [x, y, z] = soft_iron.map(|row| numbers(row, 4));
        let (hard_iron, mounting) = (numbers(hard_iron_ut, 2), numbers(mounting_deg, 2));
        let Earth { total_ut, inclination_deg } = self.earth;
        format!(
            "[airframe]\nsoft_iron = [\n    {x},\n    {y},\n    {z},\n]\nhard_iron_ut = {hard_iron}\nmounting_deg = {mounting}\n\n\
             [earth]\ntotal_ut = {total_ut:.2}\ninclination_deg = {inclination_deg:.2}\n"
        )
    }

    /// Checks that all numbers are finite and in range.
    ///
    /// # Errors
    ///
    /// [`ConfigError::OutOfRange`] with the first invalid number.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let Self { airframe, earth, aircraft, weather, attitude_source: source, gyro, .. } = self;
        let singular = airframe.field_matrix.singular_values();
        let ranges = [
            // Weaker or stronger soft iron makes any compass useless; a negative determinant is a mirrored chip.
            ("smallest gain of airframe.soft_iron", singular.min(), 0.2, 5.0),
            ("largest gain of airframe.soft_iron", singular.max(), 0.2, 5.0),
            ("determinant of airframe.soft_iron", airframe.field_matrix.determinant(), 0.008, 125.0),
            ("length of airframe.hard_iron_ut", airframe.hard_iron_ut.norm(), 0.0, 1000.0),
            ("earth.total_ut", earth.total_ut, 15.0, 80.0),
            // Closer to a pole the horizontal field is too weak for a heading.
            ("earth.inclination_deg", earth.inclination_deg, -85.0, 85.0),
            ("aircraft.airspeed_m_s", aircraft.airspeed_m_s, 5.0, 100.0),
            ("aircraft.speed_m_s", aircraft.speed_m_s, 0.5, 30.0),
            ("aircraft.max_roll_rate_deg_s", aircraft.max_roll_rate_deg_s, 1.0, 360.0),
            ("aircraft.heading_deg", aircraft.heading_deg, -360.0, 360.0),
            ("weather.wind_m_s", weather.wind_m_s, 0.0, 50.0),
            ("weather.wind_from_deg", weather.wind_from_deg, -360.0, 360.0),
            ("weather.gust_m_s", weather.gust_m_s, 0.0, 5.0),
            ("weather.bank_wander_deg", weather.bank_wander_deg, 0.0, 15.0),
            ("weather.pitch_wander_deg", weather.pitch_wander_deg, 0.0, 15.0),
            ("weather.wander_time_s", weather.wander_time_s, 0.1, 60.0),
            ("attitude_source.rate_hz", source.rate_hz, 1.0, 200.0),
            ("attitude_source.noise_deg", source.noise_deg, 0.0, 30.0),
            ("attitude_source.noise_time_s", source.noise_time_s, 0.001, 1000.0),
            ("attitude_source.bias_deg", source.bias_deg, 0.0, 30.0),
            // The world stores only the last two seconds.
            ("attitude_source.latency_ms", source.latency_ms, 0.0, 1500.0),
            ("attitude_source.turn_error", source.turn_error, -0.5, 0.5),
            ("attitude_source.push_error_deg", source.push_error_deg, 0.0, 10.0),
            ("attitude_source.yaw_offset_deg", source.yaw_offset_deg, -360.0, 360.0),
            ("attitude_source.yaw_drift_deg_s", source.yaw_drift_deg_s, -90.0, 90.0),
            ("gyro.scale_percent", gyro.scale_percent, 0.0, 50.0),
            ("gyro.offset_deg_s", gyro.offset_deg_s, 0.0, 20.0),
            ("gyro.drift_deg_s", gyro.drift_deg_s, 0.0, 20.0),
            ("gyro.drift_time_s", gyro.drift_time_s, 0.1, 1e6),
            ("gyro.noise_deg_s", gyro.noise_deg_s, 0.0, 20.0),
            ("gyro.g_sensitivity_deg_s", gyro.g_sensitivity_deg_s, 0.0, 1.0),
        ];
        match ranges.into_iter().find(|(_, value, min, max)| !(min..=max).contains(&value)) {
            Some((setting, value, min, max)) => Err(ConfigError::OutOfRange { setting, value, min, max }),
            None => Ok(()),
        }
    }
}

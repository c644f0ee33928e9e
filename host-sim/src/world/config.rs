//! All settings of a world, and the file that a person writes them in.

use std::fmt;
use std::path::Path;

use serde::Deserialize;

use super::aircraft::Kind;
use super::airframe::{Airframe, Description};
use super::earth::Earth;
use super::weather::Weather;
use super::{aircraft, attitude_source};
use crate::random::{Purpose, Random};

/// Everything about a world. The same settings and seed give the same world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldConfig {
    /// Seed of all randomness.
    pub seed: u64,
    /// Iron and mounting.
    pub airframe: Airframe,
    /// Field at the place of the flight.
    pub earth: Earth,
    /// How the aircraft flies.
    pub aircraft: aircraft::Config,
    /// What the air does.
    pub weather: Weather,
    /// How good the attitude is.
    pub attitude_source: attitude_source::Config,
    /// Iron by current: what the motors add in the chip's axes in level flight, in hover, or on the flat, microtesla.
    /// It follows their current. See [`World::set_current_ut`](super::World::set_current_ut).
    pub current_ut: [f64; 3],
    /// Whether the autopilot measures that current, and tells it.
    pub tells_current: bool,
}

/// The file: tables `[airframe]` (required), `[earth]`, `[aircraft]`, `[weather]`, `[attitude_source]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    airframe: Description,
    #[serde(default)]
    earth: Earth,
    #[serde(default)]
    aircraft: aircraft::Config,
    #[serde(default)]
    weather: Weather,
    #[serde(default)]
    attitude_source: attitude_source::Config,
}

/// Why settings cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub enum ConfigError {
    /// The file could not be read; what the operating system says.
    Unreadable {
        /// The file.
        path: String,
        /// The reason.
        reason: String,
    },
    /// What is in this file cannot be used.
    InFile(String, Box<Self>),
    /// The file is not of the format; where and why.
    Format(String),
    /// A number makes no sense.
    OutOfRange {
        /// Its name in the file.
        setting: &'static str,
        /// What it is.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
}

impl ConfigError {
    /// A stable code for scripts.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } => "airframe-unreadable",
            Self::InFile(_, error) => error.code(),
            Self::Format(_) => "airframe-format",
            Self::OutOfRange { .. } => "airframe-out-of-range",
        }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { path, reason } => {
                let kinds = Kind::ALL.map(Kind::name).join("`, `");
                write!(f, "{path}: {reason} (expected `{kinds}`, `table1`, `random` or an airframe file)")
            }
            Self::InFile(path, error) => write!(f, "{path}: {error}"),
            Self::Format(message) => f.write_str(message.trim_end()),
            Self::OutOfRange { setting, value, min, max } => {
                write!(f, "{setting} is {value}; it must lie in {min} to {max}")
            }
        }
    }
}

impl std::error::Error for ConfigError {}

impl WorldConfig {
    /// The aircraft of Liu 2007 table 1 over Xi'an.
    #[must_use]
    pub fn table1(seed: u64) -> Self {
        Self::of(seed, Airframe::table1(), Earth::default())
    }

    /// An airframe and a place drawn from the seed.
    #[must_use]
    pub fn random(seed: u64) -> Self {
        let earth = Earth::random(seed);
        Self::of(seed, Airframe::random(seed, &earth), earth)
    }

    /// `table1`, `random`, or the path of an airframe file.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the file cannot be read, is not of the format, or a number in it makes no sense.
    pub fn named(aircraft: &str, seed: u64) -> Result<Self, ConfigError> {
        match aircraft {
            "table1" => Ok(Self::table1(seed)),
            "random" => Ok(Self::random(seed)),
            path => Self::from_file(Path::new(path), seed),
        }
    }

    /// Reads an airframe file; see `host-sim/airframes/example.toml` for the format.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the file cannot be read, is not of the format, or a number in it makes no sense.
    pub fn from_file(path: &Path, seed: u64) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| ConfigError::Unreadable { path: path.display().to_string(), reason: error.to_string() })?;
        Self::from_toml(&text, seed).map_err(|error| ConfigError::InFile(path.display().to_string(), Box::new(error)))
    }

    /// Reads the text of an airframe file.
    ///
    /// # Errors
    ///
    /// [`ConfigError::Format`] and [`ConfigError::OutOfRange`].
    pub fn from_toml(text: &str, seed: u64) -> Result<Self, ConfigError> {
        let file: File = toml::from_str(text).map_err(|error| ConfigError::Format(error.to_string()))?;
        let config = Self {
            seed,
            airframe: file.airframe.into(),
            earth: file.earth,
            aircraft: file.aircraft,
            weather: file.weather,
            attitude_source: file.attitude_source,
            current_ut: [0.0; 3],
            tells_current: false,
        };
        config.validate()?;
        Ok(config)
    }

    /// Default settings around an airframe and a place.
    #[must_use]
    fn of(seed: u64, airframe: Airframe, earth: Earth) -> Self {
        Self {
            seed,
            airframe,
            earth,
            aircraft: aircraft::Config::default(),
            weather: Weather::default(),
            attitude_source: attitude_source::Config::default(),
            current_ut: [0.0; 3],
            tells_current: false,
        }
    }

    /// The same around a vehicle of another kind, with an attitude source as such a vehicle has one.
    #[must_use]
    pub fn carried_by(self, kind: Kind) -> Self {
        if kind == self.aircraft.kind {
            return self;
        }
        let aircraft = aircraft::Config { kind, ..self.aircraft };
        let push_error_deg = kind.push_error_deg();
        Self { aircraft, attitude_source: attitude_source::Config { push_error_deg, ..self.attitude_source }, ..self }
    }

    /// The same with iron by current of so many microtesla, in a direction that the seed chooses.
    #[must_use]
    pub fn with_current(self, size_ut: f64) -> Self {
        let current_ut = Random::new(self.seed, Purpose::Current).direction() * size_ut;
        Self { current_ut: current_ut.into(), ..self }
    }

    /// Iron and place as a file that [`from_file`](Self::from_file) reads: matrix to 0.0001, microtesla to 0.01, degrees to
    /// 0.01.
    #[must_use]
    pub fn iron_file(&self) -> String {
        let Description { soft_iron, hard_iron_ut, mounting_deg } = Description::from(&self.airframe);
        let numbers = |values: [f64; 3], decimals: u8| {
            // No minus before what rounds to nothing.
            let scale = 10_f64.powi(decimals.into());
            let decimals = usize::from(decimals);
            let [x, y, z] = values.map(|value| (value * scale).round() / scale + 0.0);
            format!("[{x:.decimals$}, {y:.decimals$}, {z:.decimals$}]")
        };
        let [x, y, z] = soft_iron.map(|row| numbers(row, 4));
        let (hard_iron, mounting) = (numbers(hard_iron_ut, 2), numbers(mounting_deg, 2));
        let Earth { total_ut, inclination_deg, .. } = self.earth;
        format!(
            "[airframe]\nsoft_iron = [\n    {x},\n    {y},\n    {z},\n]\nhard_iron_ut = {hard_iron}\nmounting_deg = {mounting}\n\n\
             [earth]\ntotal_ut = {total_ut:.2}\ninclination_deg = {inclination_deg:.2}\n"
        )
    }

    /// Checks that every number makes sense, infinities and not-a-numbers included.
    ///
    /// # Errors
    ///
    /// [`ConfigError::OutOfRange`] with the first number that makes none.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let Self { airframe, earth, aircraft, weather, attitude_source: source, .. } = self;
        let singular = airframe.a.singular_values();
        let ranges = [
            // Weaker or stronger soft iron would let no compass work; a mirrored chip does not exist.
            ("smallest gain of airframe.soft_iron", singular.min(), 0.2, 5.0),
            ("largest gain of airframe.soft_iron", singular.max(), 0.2, 5.0),
            ("determinant of airframe.soft_iron", airframe.a.determinant(), 0.008, 125.0),
            ("length of airframe.hard_iron_ut", airframe.b_ut.norm(), 0.0, 1000.0),
            ("earth.total_ut", earth.total_ut, 15.0, 80.0),
            // Nearer to a pole nothing horizontal is left to steer by.
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
            // The world remembers two seconds.
            ("attitude_source.latency_ms", source.latency_ms, 0.0, 1500.0),
            ("attitude_source.turn_error", source.turn_error, -0.5, 0.5),
            ("attitude_source.push_error_deg", source.push_error_deg, 0.0, 10.0),
            ("attitude_source.yaw_offset_deg", source.yaw_offset_deg, -360.0, 360.0),
            ("attitude_source.yaw_drift_deg_s", source.yaw_drift_deg_s, -90.0, 90.0),
        ];
        match ranges.into_iter().find(|(_, value, min, max)| !(min..=max).contains(&value)) {
            Some((setting, value, min, max)) => Err(ConfigError::OutOfRange { setting, value, min, max }),
            None => Ok(()),
        }
    }
}

//! User settings.

mod ports;

use core::fmt;
use core::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use autoswing::calibration::{ConsiderSigmas, Orientation};
pub use ports::{BaudRate, PORT_COUNT, PortNumber, PortSettings, PortsSettings, ProtocolKind};

/// User settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Magnetic declination (variation), degrees, east positive, if entered.
    pub declination_deg: Option<f32>,
    /// Inclination of the local Earth field, degrees, positive down, if entered.
    pub inclination_deg: Option<f32>,
    /// Heading offset, degrees: yaw mounting angle of the attitude source, or of the sensor where the mounting is
    /// unobservable.
    pub align_deg: f32,
    /// Whether headings are sent on the autopilot port.
    pub stream_on: bool,
    /// Heading rate on the autopilot port, Hz.
    pub stream_rate_hz: u8,
    /// Mounting of the sensor.
    pub mount: Orientation,
    /// Assumed constant errors of the attitude source.
    pub attitude_error: AttitudeError,
    /// Heading to send.
    pub stream_heading: HeadingKind,
    /// Expected heading error that ends a collection in flight, degrees RMS.
    pub accuracy_deg: f32,
    /// Whether an uncalibrated module starts collecting in flight.
    pub auto_on: bool,
    /// Protocol and baud rate of the ports.
    pub ports: PortsSettings,
    /// Whether true yaw is sent to an autopilot that can use an external yaw.
    pub sends_vision_yaw: bool,
    /// Highest rate at which attitude is requested from a MAVLink autopilot, Hz.
    pub attitude_rate_hz: u8,
    /// Key of MAVLink's signatures; with a key, frames without a valid signature are rejected.
    pub signing_key: Option<SigningKey>,
    /// Node on a CAN bus.
    pub can: CanSettings,
    /// Errors of gyro and magnetometer that the monitor expects.
    pub sensor_error: SensorError,
}

/// Settings of the node on a CAN bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CanSettings {
    /// Number of the node; 0 asks the autopilot for one.
    pub node: u8,
    /// Rate of the field, Hz.
    pub rate_hz: u8,
    /// Whether the field is sent with its covariance, in three frames instead of one.
    pub sends_covariance: bool,
    /// Whether the board's terminating resistor is on, if it has one that can be switched.
    pub is_terminated: bool,
}

impl CanSettings {
    /// Factory settings. CAN rates: autopilots drop a compass after 500 ms of silence.
    pub const DEFAULT: Self = Self { node: 0, rate_hz: 50, sends_covariance: false, is_terminated: false };

    /// Range of the node's number; 126 and 127 are for tools.
    pub const NODE_ID_RANGE: RangeInclusive<u8> = 0..=125;

    /// Range of the field's rate, up to the measurement rate.
    pub const RATE_HZ_RANGE: RangeInclusive<u8> = 5..=80;

    fn is_valid(self) -> bool {
        Self::NODE_ID_RANGE.contains(&self.node) && Self::RATE_HZ_RANGE.contains(&self.rate_hz)
    }
}

/// Secret key of MAVLink's signatures.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SigningKey(pub [u8; 32]);

/// Writes the type's name instead of the secret key.
impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey")
    }
}

/// Kind of heading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HeadingKind {
    /// Heading from field and attitude of one reading: for an autopilot with its own filter.
    Raw,
    /// Heading smoothed with the attitude source's body rates; raw while they are missing or inconsistent.
    Smooth,
}

impl HeadingKind {
    /// Both kinds of heading.
    pub const ALL_HEADING_KINDS: [Self; 2] = [Self::Raw, Self::Smooth];

    /// Name in commands.
    #[must_use]
    pub const fn kind_name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Smooth => "smooth",
        }
    }

    /// Parses a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL_HEADING_KINDS.into_iter().find(|kind| kind.kind_name() == name)
    }
}

/// Errors of an attitude source that are constant over a flight, 1 sigma. Turns do not reveal them; the expected error
/// of a calibration includes them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudeError {
    /// Roll and pitch bias, degrees.
    pub bias_deg: f32,
    /// Bank-angle scale error in turns, percent.
    pub bank_percent: f32,
}

impl AttitudeError {
    /// A good, carefully levelled autopilot: the solver's default.
    pub const DEFAULT: Self = Self { bias_deg: 0.2, bank_percent: 1.0 };

    /// Range of the bias, degrees.
    pub const BIAS_DEG_RANGE: RangeInclusive<f32> = 0.0..=5.0;

    /// Range of the bank-angle scale error, percent.
    pub const BANK_PERCENT_RANGE: RangeInclusive<f32> = 0.0..=20.0;

    /// Converts to the solver's units.
    #[must_use]
    pub fn to_consider_sigmas(self) -> ConsiderSigmas {
        ConsiderSigmas { bias_rad: self.bias_deg.to_radians(), bank_scale: self.bank_percent / 100.0 }
    }

    fn is_valid(self) -> bool {
        Self::BIAS_DEG_RANGE.contains(&self.bias_deg) && Self::BANK_PERCENT_RANGE.contains(&self.bank_percent)
    }
}

/// Errors of gyro and magnetometer that the monitor expects, 1 sigma.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorError {
    /// Scale error and cross-axis sensitivity of the gyro, percent.
    pub gyro_percent: f32,
    /// Drift of the hard iron in a minute, percent of the field.
    pub drift_percent: f32,
}

impl SensorError {
    /// Default errors, those of the monitor.
    pub const DEFAULT: Self = Self { gyro_percent: 2.0, drift_percent: 0.25 };

    /// Range of the gyro's error, percent, up to the largest that the monitor estimates.
    pub const GYRO_PERCENT_RANGE: RangeInclusive<f32> = 0.1..=20.0;

    /// Range of the drift, percent of the field.
    pub const DRIFT_PERCENT_RANGE: RangeInclusive<f32> = 0.05..=5.0;

    fn is_valid(self) -> bool {
        Self::GYRO_PERCENT_RANGE.contains(&self.gyro_percent) && Self::DRIFT_PERCENT_RANGE.contains(&self.drift_percent)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// Factory settings. Autopilots expect a compass at 10 Hz. An accuracy of 0.5 deg requires a whole routine: of
    /// copters that stopped at 0.7 deg, after the first tilts, one in six had more than three times the expected error.
    pub const DEFAULT: Self = Self {
        declination_deg: None,
        inclination_deg: None,
        align_deg: 0.0,
        stream_on: true,
        stream_rate_hz: 10,
        mount: Orientation::IDENTITY_ROTATION,
        attitude_error: AttitudeError::DEFAULT,
        stream_heading: HeadingKind::Smooth,
        accuracy_deg: 0.5,
        auto_on: true,
        ports: PortsSettings::DEFAULT,
        sends_vision_yaw: false,
        attitude_rate_hz: 40,
        signing_key: None,
        can: CanSettings::DEFAULT,
        sensor_error: SensorError::DEFAULT,
    };

    /// Factory settings with the present alignment, which belongs to the calibration.
    #[must_use]
    pub const fn factory_reset(&self) -> Self {
        Self { align_deg: self.align_deg, ..Self::DEFAULT }
    }

    /// Range of the declination, degrees.
    pub const DECLINATION_DEG_RANGE: RangeInclusive<f32> = -180.0..=180.0;

    /// Range of the inclination, degrees.
    pub const INCLINATION_DEG_RANGE: RangeInclusive<f32> = -90.0..=90.0;

    /// Range of the heading rate, up to the measurement rate.
    pub const STREAM_RATE_HZ_RANGE: RangeInclusive<u8> = 1..=80;

    /// Range of the requested attitude rate. ArduPilot warns of a request above 80 % of its loop rate, 50 Hz in a
    /// plane.
    pub const ATTITUDE_RATE_HZ_RANGE: RangeInclusive<u8> = 20..=50;

    /// Range of the accuracy, degrees RMS: from that of the best compasses to the largest accepted expected error.
    pub const ACCURACY_DEG_RANGE: RangeInclusive<f32> = 0.2..=3.0;

    /// Whether every setting is within its range; the alignment's is -180..180 deg.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.declination_deg.is_none_or(|declination_deg| Self::DECLINATION_DEG_RANGE.contains(&declination_deg))
            && self.inclination_deg.is_none_or(|inclination_deg| Self::INCLINATION_DEG_RANGE.contains(&inclination_deg))
            && self.align_deg.abs() <= 180.0
            && Self::STREAM_RATE_HZ_RANGE.contains(&self.stream_rate_hz)
            && Self::ATTITUDE_RATE_HZ_RANGE.contains(&self.attitude_rate_hz)
            && self.mount.is_valid()
            && self.attitude_error.is_valid()
            && Self::ACCURACY_DEG_RANGE.contains(&self.accuracy_deg)
            && self.can.is_valid()
            && self.sensor_error.is_valid()
    }
}

/// Change of one setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingChange {
    /// Heading output on or off.
    StreamOn(bool),
    /// Heading rate, Hz.
    StreamRateHz(u8),
    /// Heading to send.
    StreamHeading(HeadingKind),
    /// Declination (variation), degrees, east positive; `None` omits it from the sentences.
    Declination(Option<f32>),
    /// Inclination of the local Earth field, degrees, positive down; `None` estimates it from the samples.
    Inclination(Option<f32>),
    /// Mounting of the sensor.
    Mount(Orientation),
    /// Assumed constant errors of the attitude source.
    AttitudeError(AttitudeError),
    /// Expected heading error that ends a collection in flight, degrees RMS.
    Accuracy(f32),
    /// Whether an uncalibrated module starts collecting in flight.
    Auto(bool),
    /// Protocol of a port.
    Protocol(PortNumber, ProtocolKind),
    /// Baud rate of a port.
    Baud(PortNumber, BaudRate),
    /// Whether true yaw is sent to an autopilot.
    Vision(bool),
    /// Highest requested attitude rate, Hz.
    AttitudeRateHz(u8),
    /// Key of MAVLink's signatures; `None` accepts and sends frames without.
    Signing(Option<SigningKey>),
    /// Number of the node on a CAN bus; 0 asks for one.
    CanNode(u8),
    /// Rate of the field on a CAN bus, Hz.
    CanRateHz(u8),
    /// Whether the field is sent with its covariance on a CAN bus.
    CanCovariance(bool),
    /// Whether the terminating resistor of the CAN bus is on.
    CanTermination(bool),
    /// Expected errors of gyro and magnetometer.
    SensorError(SensorError),
}

/// Description of the valid range, for a value outside of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange(pub &'static str);

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl core::error::Error for OutOfRange {}

impl SettingChange {
    /// Whether solves use this setting, so that it must not change during one.
    #[must_use]
    pub const fn is_used_by_solves(self) -> bool {
        match self {
            Self::Inclination(_) | Self::Mount(_) | Self::AttitudeError(_) => true,
            Self::StreamOn(_)
            | Self::StreamRateHz(_)
            | Self::StreamHeading(_)
            | Self::Declination(_)
            | Self::Accuracy(_)
            | Self::Auto(_)
            | Self::Protocol(..)
            | Self::Baud(..)
            | Self::Vision(_)
            | Self::AttitudeRateHz(_)
            | Self::Signing(_)
            | Self::CanNode(_)
            | Self::CanRateHz(_)
            | Self::CanCovariance(_)
            | Self::CanTermination(_)
            | Self::SensorError(_) => false,
        }
    }

    const fn valid_range(self) -> &'static str {
        match self {
            Self::StreamOn(_) | Self::Auto(_) | Self::Vision(_) | Self::CanCovariance(_) | Self::CanTermination(_) => {
                "on or off"
            }
            Self::StreamRateHz(_) => "a rate is 1 to 80 sentences a second",
            Self::StreamHeading(_) => "a heading is raw or smooth",
            Self::AttitudeRateHz(_) => "a rate of attitude is 20 to 50 Hz",
            Self::Declination(_) => "a declination is -180 to 180 degrees",
            Self::Inclination(_) => "an inclination is -90 to 90 degrees, positive down",
            Self::Mount(_) => "a mounting is one of the 24 right-angle ones",
            Self::AttitudeError(_) => "a constant error is 0 to 5 degrees, one of bank 0 to 20 percent",
            Self::SensorError(_) => "an error of the gyro is 0.1 to 20 percent, a drift 0.05 to 5 percent of the field",
            Self::Signing(_) => "a passphrase or off",
            Self::Accuracy(_) => "an accuracy is 0.2 to 3 degrees",
            Self::Protocol(..) => "a protocol that this firmware was built with",
            Self::CanNode(_) => "a node is 1 to 125, or 0 to ask the autopilot for one",
            Self::CanRateHz(_) => "a rate of the field is 5 to 80 Hz",
            Self::Baud(..) => "57600, 115200, 230400 or 460800 baud",
        }
    }
}

impl Settings {
    /// Applies a change.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the settings would be [invalid](Self::is_valid).
    pub fn with_setting(self, setting: SettingChange) -> Result<Self, OutOfRange> {
        let mut changed = self;
        match setting {
            SettingChange::StreamOn(on) => changed.stream_on = on,
            SettingChange::StreamRateHz(hz) => changed.stream_rate_hz = hz,
            SettingChange::StreamHeading(kind) => changed.stream_heading = kind,
            SettingChange::Declination(deg) => changed.declination_deg = deg,
            SettingChange::Inclination(deg) => changed.inclination_deg = deg,
            SettingChange::Mount(mount) => changed.mount = mount,
            SettingChange::AttitudeError(error) => changed.attitude_error = error,
            SettingChange::Accuracy(deg) => changed.accuracy_deg = deg,
            SettingChange::Auto(on) => changed.auto_on = on,
            SettingChange::Protocol(port, protocol) => changed.ports.port_mut(port).protocol = protocol,
            SettingChange::Baud(port, baud) => changed.ports.port_mut(port).baud = baud,
            SettingChange::Vision(on) => changed.sends_vision_yaw = on,
            SettingChange::AttitudeRateHz(hz) => changed.attitude_rate_hz = hz,
            SettingChange::Signing(key) => changed.signing_key = key,
            SettingChange::CanNode(node) => changed.can.node = node,
            SettingChange::CanRateHz(hz) => changed.can.rate_hz = hz,
            SettingChange::CanCovariance(on) => changed.can.sends_covariance = on,
            SettingChange::CanTermination(on) => changed.can.is_terminated = on,
            SettingChange::SensorError(error) => changed.sensor_error = error,
        }
        if changed.is_valid() { Ok(changed) } else { Err(OutOfRange(setting.valid_range())) }
    }
}

#[cfg(test)]
mod tests;

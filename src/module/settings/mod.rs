//! User settings: their values ([`Settings`]), and the table ([`SETTINGS`]) from which commands, `status all`, parameters,
//! stored fields and range checks derive.

mod ports;
mod replaced_numbers;
mod setting;

use core::fmt;

use autoswing::attitude::AttitudeSource;
use autoswing::calibration::{ConsiderSigmas, Orientation};
pub use ports::{BaudRate, PORT_COUNT, PortNumber, PortSettings, ProtocolKind};
pub use replaced_numbers::{ReplacedNumber, ReplacedNumbers};
use setting::DependentState;
pub use setting::{Choice, SettingKind, SettingRow, SettingValue, SigningKey};

/// User settings.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    pub attitude_error: AttitudeErrorSetting,
    /// Heading to send.
    pub stream_heading: HeadingKind,
    /// Expected heading error that ends a collection in flight, degrees RMS.
    pub accuracy_deg: f32,
    /// Whether an uncalibrated module starts collecting in flight.
    pub auto_on: bool,
    /// Protocol and baud rate of the ports.
    pub ports: [PortSettings; PORT_COUNT],
    /// Whether true yaw is sent to an autopilot that can use an external yaw.
    pub sends_vision_yaw: bool,
    /// Highest rate at which attitude is requested from a MAVLink autopilot, Hz.
    pub attitude_rate_hz: u8,
    /// Source of the attitude.
    pub attitude_source: AttitudeSource,
    /// MAVLink component of the module.
    pub component: u8,
    /// Key of MAVLink's signatures; with a key, frames without a valid signature are rejected.
    pub signing_key: Option<SigningKey>,
    /// Node on a CAN bus.
    pub can: CanSettings,
    /// Errors of gyro and magnetometer that the monitor expects.
    pub sensor_error: SensorErrorSetting,
    /// Numbers of the autopilot's parameters that a setup replaced. No command sets them.
    pub replaced_numbers: ReplacedNumbers,
}

/// Settings of the node on a CAN bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanSettings {
    /// Number of the node; 0 asks the autopilot for one.
    pub node: u8,
    /// Rate of the field, Hz.
    pub rate_hz: u8,
    /// Whether the field is sent with its covariance, in three frames instead of one.
    pub sends_covariance: bool,
    /// Whether the board's switchable terminating resistor, if any, is on.
    pub is_terminated: bool,
}

impl CanSettings {
    /// Factory settings. CAN rates: autopilots drop a compass after 500 ms of silence.
    pub const DEFAULT: Self = Self { node: 0, rate_hz: 50, sends_covariance: false, is_terminated: false };
}

setting::named_choices! {
    /// Kind of heading.
    HeadingKind {
        /// Heading from field and attitude of one reading: for an autopilot with its own filter.
        Raw: "raw",
        /// Heading smoothed with the attitude source's body rates; raw while they are missing or inconsistent.
        Smooth: "smooth",
    }
}

/// Errors of an attitude source that are constant over a flight, 1 sigma. Turns do not reveal them; the expected error
/// of a calibration includes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeErrorSetting {
    /// Roll and pitch bias, degrees.
    pub bias_deg: f32,
    /// Bank-angle scale error in turns, percent.
    pub bank_percent: f32,
}

impl AttitudeErrorSetting {
    /// A good, carefully levelled autopilot: the solver's default.
    pub const DEFAULT: Self = Self { bias_deg: 0.2, bank_percent: 1.0 };

    /// Converts to the solver's units.
    #[must_use]
    pub fn to_consider_sigmas(self) -> ConsiderSigmas {
        ConsiderSigmas { bias_rad: self.bias_deg.to_radians(), bank_scale: self.bank_percent / 100.0 }
    }
}

/// Errors of gyro and magnetometer that the monitor expects, 1 sigma.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorErrorSetting {
    /// Scale error and cross-axis sensitivity of the gyro, percent.
    pub gyro_percent: f32,
    /// Drift of the hard iron in a minute, percent of the field.
    pub drift_percent: f32,
}

impl SensorErrorSetting {
    /// Default errors, those of the monitor.
    pub const DEFAULT: Self = Self { gyro_percent: 2.0, drift_percent: 0.25 };
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
        attitude_error: AttitudeErrorSetting::DEFAULT,
        stream_heading: HeadingKind::Smooth,
        accuracy_deg: 0.5,
        auto_on: true,
        ports: PortSettings::DEFAULT_OF_PORTS,
        sends_vision_yaw: false,
        attitude_rate_hz: 40,
        component: 158,
        attitude_source: AttitudeSource::Autopilot,
        signing_key: None,
        can: CanSettings::DEFAULT,
        sensor_error: SensorErrorSetting::DEFAULT,
        replaced_numbers: ReplacedNumbers::NONE,
    };

    /// Factory settings with the present alignment, which belongs to the calibration, and the autopilot's numbers.
    #[must_use]
    pub const fn factory_reset(&self) -> Self {
        Self { align_deg: self.align_deg, replaced_numbers: self.replaced_numbers, ..Self::DEFAULT }
    }

    /// Settings of a port.
    #[must_use]
    pub const fn settings_of_port(&self, number: PortNumber) -> PortSettings {
        *number.port_element(&self.ports)
    }

    /// Whether every setting is within its range.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        SETTINGS.iter().all(|setting| setting.is_valid(self))
    }

    /// Applies a change.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the settings would be [invalid](Self::is_valid).
    pub fn with_setting(self, change: SettingChange) -> Result<Self, OutOfRange> {
        let SettingChange { setting, value } = change;
        let mut changed = self;
        let is_set = match value {
            SettingValue::Numbers(numbers) => {
                let settings = SETTINGS.iter().skip_while(|row| *row != setting);
                let mut values = numbers.map(|number| SettingValue::Number(Some(number))).into_iter();
                settings.zip(&mut values).all(|(setting, value)| setting.set_value(&mut changed, value))
            }
            value => setting.set_value(&mut changed, value),
        };
        if is_set && changed.is_valid() { Ok(changed) } else { Err(OutOfRange(setting.range_text)) }
    }
}

/// Row of the table of [`Settings`].
pub type Setting = SettingRow<Settings>;

/// Rows of the table: name and position as a parameter (none: `""`), tag of the stored field, kind of value; words of the
/// command, name of its argument, help; line of `status all`, texts before and after the value; answer to a value out of
/// its range; state that depends on the setting.
macro_rules! setting_rows {
    ($($name:literal $index:literal, stored $tag:literal: $kind:ident($($access_and_range:expr),*),
       $words:tt $argument:literal: $help:literal,
       shown $status:tt, refused $range:expr $(, used by $dependent:ident)?;)*) => {
        [$(SettingRow {
            command_words: $words,
            argument_name: $argument,
            help_text: $help,
            kind: SettingKind::$kind($($access_and_range),*),
            range_text: $range,
            status_texts: $status,
            stored_tag: $tag,
            parameter_index: $index,
            parameter_name: $name,
            dependent_state: setting_rows!(@state $($dependent)?),
        }),*]
    };
    (@state $dependent:ident) => { DependentState::$dependent };
    (@state) => { DependentState::None };
}

const ON_OR_OFF: [&str; 2] = ["off", "on"];
const RANGE_OF_PROTOCOLS: &str = "a protocol that this firmware was built with";
const RANGE_OF_BAUD_RATES: &str = "57600, 115200, 230400 or 460800 baud";
const RANGE_OF_ATTITUDE_ERRORS: &str = "a constant error is 0 to 5 degrees, one of bank 0 to 20 percent";
const RANGE_OF_SENSOR_ERRORS: &str =
    "an error of the gyro is 0.1 to 20 percent, a drift 0.05 to 5 percent of the field";

/// All settings, in the order of `help`.
///
/// `stream on`, `stream off` and `set align` are commands of their own. The rate of headings, and of the field, is at
/// most the measurement rate.
pub static SETTINGS: [Setting; 26] = setting_rows! {
    "STREAM" 17, stored 7: Switch(|s| &mut s.stream_on, ON_OR_OFF),
        ["", ""] "": "",
        shown ["stream", "", ""], refused "on or off";
    "STREAM_RATE" 18, stored 8: Whole(|s| &mut s.stream_rate_hz, [1, 80], "a second", None),
        ["stream", "rate"] "HZ": "sentences per second",
        shown ["stream", ", ", " Hz"], refused "a rate is 1 to 80 sentences a second";
    "STREAM_HEADING" 19, stored 12: Choice(|s| &mut s.stream_heading),
        ["stream", "heading"] "KIND":
            "heading sent: smoothed by the body rates, or raw for an autopilot with its own filter",
        shown ["stream", ", ", " heading"], refused "a heading is raw or smooth";
    "DECLINATION" 5, stored 4: Angle(
            |s| &mut s.declination_deg, [-180.0, 180.0], |field| field.declination_deg, "not set"
        ),
        ["set", "declination"] "DEG": "declination, east positive; none: by the field model",
        shown ["declination", "", ""], refused "a declination is -180 to 180 degrees";
    "MOUNT" 7, stored 9: Choice(|s| &mut s.mount),
        ["set", "mount"] "ORIENTATION":
            "orientation of the sensor: rotated from the vehicle by yaw, then pitch, then roll",
        shown ["mount", "", ""], refused "a mounting is one of the 24 right-angle ones", used by Calibration;
    "INCLINATION" 6, stored 5: Angle(
            |s| &mut s.inclination_deg, [-90.0, 90.0], |field| Some(field.inclination_deg),
            "not set, found from the samples"
        ),
        ["set", "inclination"] "DEG":
            "inclination of the local field, positive down; none: by the field model or the samples",
        shown ["inclination", "", ""], refused "an inclination is -90 to 90 degrees, positive down", used by Solve;
    "" 0, stored 6: Alignment(|s| &mut s.align_deg),
        ["set", "align"] "": "",
        shown ["mount", ", align ", " deg"], refused "";
    "ATT_ERROR_DEG" 8, stored 10: Number(|s| &mut s.attitude_error.bias_deg, [0.0, 5.0], "deg", 2, Some("default")),
        ["set", "attitude-error"] "DEG":
            "constant attitude error of a flight, 1 sigma: in degrees, and in percent of the bank",
        shown ["attitude-error", "", " deg"], refused RANGE_OF_ATTITUDE_ERRORS, used by Solve;
    "ATT_ERROR_BANK" 9, stored 11: Number(|s| &mut s.attitude_error.bank_percent, [0.0, 20.0], "%", 1, None),
        ["set", "attitude-error"] "PERCENT": "",
        shown ["attitude-error", ", ", " % of bank, 1 sigma"], refused RANGE_OF_ATTITUDE_ERRORS, used by Solve;
    // Up to the largest error that the monitor estimates.
    "GYRO_ERROR" 20, stored 28: Number(|s| &mut s.sensor_error.gyro_percent, [0.1, 20.0], "%", 1, Some("default")),
        ["set", "sensor-error"] "GYRO":
            "errors that the monitor expects, 1 sigma: scale of the gyro, and drift of iron in a minute",
        shown ["sensor-error", "gyro ", " %"], refused RANGE_OF_SENSOR_ERRORS;
    "IRON_DRIFT" 21, stored 29: Number(|s| &mut s.sensor_error.drift_percent, [0.05, 5.0], "% of the field", 2, None),
        ["set", "sensor-error"] "DRIFT": "",
        shown ["sensor-error", ", drift ", " % of the field a minute, 1 sigma"], refused RANGE_OF_SENSOR_ERRORS;
    // From the accuracy of the best compasses to the largest accepted expected error.
    "ACCURACY" 4, stored 13: Number(|s| &mut s.accuracy_deg, [0.2, 3.0], "deg", 1, None),
        ["set", "accuracy"] "DEG": "expected error at which a collection in flight ends",
        shown ["accuracy", "", " deg wanted"], refused "an accuracy is 0.2 to 3 degrees";
    "AUTO" 3, stored 14: Switch(
            |s| &mut s.auto_on, ["off, collects when asked", "on, collects automatically while uncalibrated"]
        ),
        ["cal", "auto"] "SWITCH":
            "start collecting automatically while uncalibrated, as soon as the autopilot is armed",
        shown ["auto", "", ""], refused "on or off", used by AutomaticStart;
    "PORT1" 13, stored 15: Choice(|s| &mut s.ports[0].protocol),
        ["set", "port1"] "PROTOCOL": "protocol of the first port; auto: detect the autopilot's",
        shown ["port1", "", ""], refused RANGE_OF_PROTOCOLS;
    "PORT2" 14, stored 17: Choice(|s| &mut s.ports[1].protocol),
        ["set", "port2"] "PROTOCOL": "protocol of the second port; auto: detect the autopilot's",
        shown ["port2", "", ""], refused RANGE_OF_PROTOCOLS;
    "BAUD1" 15, stored 16: Choice(|s| &mut s.ports[0].baud),
        ["set", "baud1"] "BAUD": "baud rate of the first port",
        shown ["port1", ", ", " baud"], refused RANGE_OF_BAUD_RATES;
    "BAUD2" 16, stored 18: Choice(|s| &mut s.ports[1].baud),
        ["set", "baud2"] "BAUD": "baud rate of the second port",
        shown ["port2", ", ", " baud"], refused RANGE_OF_BAUD_RATES;
    "VISION" 11, stored 19: Switch(|s| &mut s.sends_vision_yaw, ON_OR_OFF),
        ["set", "vision"] "SWITCH":
            "send true yaw to a MAVLink autopilot, in place of its own compass; needs a declination",
        shown ["vision", "", ""], refused "on or off";
    "ATTITUDE" 23, stored 31: Choice(|s| &mut s.attitude_source),
        ["set", "attitude"] "SOURCE":
            "whose roll and pitch; auto: own body rates, and all own without an autopilot",
        shown ["attitude-source", "", ""], refused "a source of attitude is autopilot, own or auto", used by Solve;
    // ArduPilot warns of a request above 80 % of its loop rate, 50 Hz in a plane.
    "ATTITUDE_RATE" 10, stored 23: Whole(|s| &mut s.attitude_rate_hz, [20, 50], "a second", None),
        ["set", "attitude-rate"] "HZ": "highest rate at which attitude is requested from a MAVLink autopilot",
        shown ["attitude-rate", "", " Hz at most"], refused "a rate of attitude is 20 to 50 Hz";
    "SIGNING" 12, stored 24: Key(|s| &mut s.signing_key),
        ["set", "signing"] "PASSPHRASE":
            "sign MAVLink frames, and reject others, with the key of a passphrase, one word",
        shown ["signing", "", ""], refused "a passphrase or off";
    // MAV_COMP_ID_USER1 and above; 158 is MAV_COMP_ID_PERIPHERAL.
    "COMPONENT" 24, stored 32: Whole(|s| &mut s.component, [25, 250], "in MAVLink", None),
        ["set", "component"] "NUMBER": "MAVLink component of the module",
        shown ["component", "", ""], refused "a component is 25 to 250 in MAVLink";
    // Nodes 126 and 127 are for tools.
    "CAN_NODE" 0, stored 25: Whole(|s| &mut s.can.node, [0, 125], "as a node", Some("by allocation")),
        ["set", "can-node"] "NUMBER": "number on the CAN bus, after a restart; 0: the autopilot gives one",
        shown ["can", "node ", ""], refused "a node is 1 to 125, or 0 to ask the autopilot for one";
    "CAN_RATE" 1, stored 26: Whole(|s| &mut s.can.rate_hz, [5, 80], "a second", None),
        ["set", "can-rate"] "HZ": "rate of the field on the CAN bus",
        shown ["can", ", ", " Hz"], refused "a rate of the field is 5 to 80 Hz";
    "CAN_COVARIANCE" 2, stored 27: Switch(|s| &mut s.can.sends_covariance, ON_OR_OFF),
        ["set", "can-covariance"] "SWITCH": "send the field on the CAN bus with its covariance",
        shown ["can", ", covariance ", ""], refused "on or off";
    "CAN_TERMINATE" 22, stored 30: Switch(|s| &mut s.can.is_terminated, ON_OR_OFF),
        ["set", "can-termination"] "SWITCH": "terminating resistor of the CAN bus, if the board switches one",
        shown ["can", ", termination ", ""], refused "on or off";
};

impl Setting {
    /// Setting with this parameter name.
    #[must_use]
    pub fn from_parameter_name(parameter_name: &[u8]) -> Option<&'static Self> {
        SETTINGS.iter().find(|setting| setting.is_parameter() && setting.parameter_name.as_bytes() == parameter_name)
    }

    /// Number of parameters: all settings but the alignment.
    pub const PARAMETER_COUNT: u8 = SETTINGS.len() as u8 - 1;

    /// Setting with this position as a parameter.
    #[must_use]
    pub fn nth_parameter(index: u8) -> Option<&'static Self> {
        SETTINGS.iter().find(|setting| setting.is_parameter() && setting.parameter_index == index)
    }

    const fn is_parameter(&self) -> bool {
        !self.parameter_name.is_empty()
    }

    /// Change to a value; `None` for a value of another kind, or of no choice. Ranges are checked when it is applied.
    #[must_use]
    pub fn change_to(&'static self, value: SettingValue) -> Option<SettingChange> {
        self.set_value(&mut { Settings::DEFAULT }, value).then_some(SettingChange { setting: self, value })
    }
}

/// Change of one setting, or of the two of one command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingChange {
    /// Setting to change.
    pub setting: &'static Setting,
    /// New value of the setting.
    pub value: SettingValue,
}

impl SettingChange {
    /// Change of the setting with this parameter name; of numbers also of the next setting in the table.
    ///
    /// # Panics
    ///
    /// If no setting has this parameter name; callers pass constants.
    #[must_use]
    pub const fn new(parameter_name: &str, value: SettingValue) -> Self {
        let mut index = 0;
        while !is_equal_text(SETTINGS[index].parameter_name, parameter_name) {
            index += 1;
        }
        Self { setting: &SETTINGS[index], value }
    }

    /// Whether solves use this setting, so that it must not change during one.
    #[must_use]
    pub fn is_used_by_solves(self) -> bool {
        matches!(self.setting.dependent_state, DependentState::Solve | DependentState::Calibration)
    }

    /// Whether a calibration is valid for one value of this setting.
    #[must_use]
    pub fn is_of_calibration(self) -> bool {
        self.setting.dependent_state == DependentState::Calibration
    }

    /// Whether the change permits automatic collection.
    #[must_use]
    pub fn enables_automatic_start(self) -> bool {
        self.setting.dependent_state == DependentState::AutomaticStart && self.value == SettingValue::Whole(1)
    }
}

const fn is_equal_text(first: &str, second: &str) -> bool {
    let (first, second) = (first.as_bytes(), second.as_bytes());
    let mut index = 0;
    while index < first.len() && index < second.len() && first[index] == second[index] {
        index += 1;
    }
    index == first.len() && index == second.len()
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

#[cfg(test)]
mod tests;

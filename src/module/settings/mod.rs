//! User settings: one table ([`SETTINGS`]), from which fields ([`Settings`]), factory settings, commands, `status all`,
//! parameters, stored fields and range checks derive.

mod ports;
mod setting;

use core::fmt;

use crate::replaced_numbers::ReplacedNumbers;
use autoswing::attitude::AttitudeSource;
use autoswing::calibration::{ConsiderSigmas, Orientation};
use autoswing::instrument::SensorErrorSigmas;
pub use ports::{BaudRate, PORT_COUNT, PortNumber, PortSettings, ProtocolKind};
pub use setting::{Choice, DependentState, SettingKind, SettingRow, SettingValue, SigningKey};

/// Row of the table of [`Settings`].
pub type Setting = SettingRow<Settings>;

/// Declares [`Settings`] and [`SETTINGS`]. A row: name and position as a parameter (none: `""`), tag of the stored
/// field, field, factory setting, kind of value; words of the command, name of its argument, help; line of `status all`, texts
/// before and after the value; answer to a value out of its range; state that depends on the setting.
macro_rules! settings {
    ($($(#[$description:meta])*
       $name:literal $index:literal, stored $tag:literal:
       $field:ident: $type:ty = $default:expr, $kind:ident $(($($particular:expr),*))?;
       $words:tt $argument:literal: $help:literal;
       shown $status:tt, refused $range:expr $(, used by $dependent:ident)?;)*) => {
        /// User settings.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Settings {
            $(#[doc = $help] $(#[$description])* pub $field: $type,)*
            /// Numbers of the autopilot's parameters that a setup replaced. No command sets them.
            pub replaced_numbers: ReplacedNumbers,
        }

        impl Settings {
            /// Factory settings.
            pub const DEFAULT: Self = Self { $($field: $default,)* replaced_numbers: ReplacedNumbers::NONE };
        }

        /// All settings, in the order of `help`. Adjacent rows with the same words are the arguments of one command.
        pub static SETTINGS: [Setting; [$($index),*].len()] = [$(SettingRow {
            parameter_name: $name,
            parameter_index: $index,
            stored_tag: $tag,
            kind: SettingKind::$kind(|settings| &mut settings.$field $($(, $particular)*)?),
            command_words: $words,
            argument_name: $argument,
            help_text: $help,
            status_texts: $status,
            range_text: $range,
            dependent_state: [$(DependentState::$dependent,)? DependentState::None][0],
        }),*];
    };
}

const ON_OR_OFF: [&str; 2] = ["off", "on"];
const RANGE_OF_PROTOCOLS: &str = "a protocol that this firmware was built with";
const RANGE_OF_BAUD_RATES: &str = "57600, 115200, 230400 or 460800 baud";
const RANGE_OF_ATTITUDE_ERRORS: &str = "a constant error is 0 to 5 degrees, one of bank 0 to 20 percent";
const RANGE_OF_SENSOR_ERRORS: &str =
    "an error of the gyro is 0.1 to 20 percent, a drift 0.05 to 5 percent of the field";

// `stream on`, `stream off` and `set align` are commands of their own. The rate of headings, and of the field, is at
// most the measurement rate.
settings! {
    /// Whether headings are sent on the autopilot port.
    "STREAM" 17, stored 7: stream_on: bool = true, Switch(ON_OR_OFF);
        ["", ""] "": "";
        shown ["stream", "", ""], refused "on or off";
    // Autopilots expect a compass at 10 Hz.
    "STREAM_RATE" 18, stored 8: stream_rate_hz: u8 = 10, Whole([1, 80], "a second", None);
        ["stream", "rate"] "HZ": "sentences per second";
        shown ["stream", ", ", " Hz"], refused "a rate is 1 to 80 sentences a second";
    "STREAM_HEADING" 19, stored 12: stream_heading: HeadingKind = HeadingKind::Smooth, Choice;
        ["stream", "heading"] "KIND":
            "heading sent: smoothed by the body rates, or raw for an autopilot with its own filter";
        shown ["stream", ", ", " heading"], refused "a heading is raw or smooth";
    "DECLINATION" 5, stored 4: declination_deg: Option<f32> = None,
        Angle([-180.0, 180.0], |field| field.declination_deg, "not set");
        ["set", "declination"] "DEG": "declination, east positive; none: by the field model";
        shown ["declination", "", ""], refused "a declination is -180 to 180 degrees";
    "MOUNT" 7, stored 9: mount: Orientation = Orientation::IDENTITY_ROTATION, Choice;
        ["set", "mount"] "ORIENTATION":
            "orientation of the sensor: rotated from the vehicle by yaw, then pitch, then roll";
        shown ["mount", "", ""], refused "a mounting is one of the 24 right-angle ones", used by Calibration;
    "INCLINATION" 6, stored 5: inclination_deg: Option<f32> = None,
        Angle([-90.0, 90.0], |field| Some(field.inclination_deg), "not set, found from the samples");
        ["set", "inclination"] "DEG":
            "inclination of the local field, positive down; none: by the field model or the samples";
        shown ["inclination", "", ""], refused "an inclination is -90 to 90 degrees, positive down", used by Solve;
    /// Heading offset, degrees: yaw mounting angle of the attitude source, or of the sensor where the mounting is
    /// unobservable.
    "" 0, stored 6: align_deg: f32 = 0.0, Alignment([-180.0, 180.0]);
        ["set", "align"] "": "";
        shown ["mount", ", align ", " deg"], refused "";
    // A good, carefully levelled autopilot: the solver's default.
    "ATT_ERROR_DEG" 8, stored 10: attitude_bias_deg: f32 = 0.2, Number([0.0, 5.0], "deg", 2, Some("default"));
        ["set", "attitude-error"] "DEG":
            "constant attitude error of a flight, 1 sigma: in degrees, and in percent of the bank";
        shown ["attitude-error", "", " deg"], refused RANGE_OF_ATTITUDE_ERRORS, used by Solve;
    /// Bank-angle scale error in turns, 1 sigma, percent.
    "ATT_ERROR_BANK" 9, stored 11: bank_scale_error_percent: f32 = 1.0, Number([0.0, 20.0], "%", 1, None);
        ["set", "attitude-error"] "PERCENT": "";
        shown ["attitude-error", ", ", " % of bank, 1 sigma"], refused RANGE_OF_ATTITUDE_ERRORS, used by Solve;
    // Up to the largest error that the monitor estimates; the defaults are those of the monitor.
    "GYRO_ERROR" 20, stored 28: gyro_error_percent: f32 = 2.0, Number([0.1, 20.0], "%", 1, Some("default"));
        ["set", "sensor-error"] "GYRO":
            "errors that the monitor expects, 1 sigma: scale of the gyro, and drift of iron in a minute";
        shown ["sensor-error", "gyro ", " %"], refused RANGE_OF_SENSOR_ERRORS;
    /// Expected drift of the hard iron in a minute, 1 sigma, percent of the field.
    "IRON_DRIFT" 21, stored 29: iron_drift_percent: f32 = 0.25, Number([0.05, 5.0], "% of the field", 2, None);
        ["set", "sensor-error"] "DRIFT": "";
        shown ["sensor-error", ", drift ", " % of the field a minute, 1 sigma"], refused RANGE_OF_SENSOR_ERRORS;
    // From the accuracy of the best compasses to the largest accepted expected error. 0.5 deg requires a whole routine:
    // of copters that stopped at 0.7 deg, after the first tilts, one in six had over three times the expected error.
    "ACCURACY" 4, stored 13: accuracy_deg: f32 = 0.5, Number([0.2, 3.0], "deg", 1, None);
        ["set", "accuracy"] "DEG": "expected error at which a collection in flight ends";
        shown ["accuracy", "", " deg wanted"], refused "an accuracy is 0.2 to 3 degrees";
    "AUTO" 3, stored 14: auto_on: bool = true,
        Switch(["off, collects when asked", "on, collects automatically while uncalibrated"]);
        ["cal", "auto"] "SWITCH":
            "start collecting automatically while uncalibrated, as soon as the autopilot is armed";
        shown ["auto", "", ""], refused "on or off", used by AutomaticStart;
    "PORT1" 13, stored 15: port1_protocol: ProtocolKind = ProtocolKind::Auto, Choice;
        ["set", "port1"] "PROTOCOL": "protocol of the first port; auto: detect the autopilot's";
        shown ["port1", "", ""], refused RANGE_OF_PROTOCOLS;
    // To instruments.
    "PORT2" 14, stored 17: port2_protocol: ProtocolKind = ProtocolKind::Nmea, Choice;
        ["set", "port2"] "PROTOCOL": "protocol of the second port; auto: detect the autopilot's";
        shown ["port2", "", ""], refused RANGE_OF_PROTOCOLS;
    "BAUD1" 15, stored 16: port1_baud: BaudRate = BaudRate::B115200, Choice;
        ["set", "baud1"] "BAUD": "baud rate of the first port";
        shown ["port1", ", ", " baud"], refused RANGE_OF_BAUD_RATES;
    "BAUD2" 16, stored 18: port2_baud: BaudRate = BaudRate::B115200, Choice;
        ["set", "baud2"] "BAUD": "baud rate of the second port";
        shown ["port2", ", ", " baud"], refused RANGE_OF_BAUD_RATES;
    "VISION" 11, stored 19: sends_vision_yaw: bool = false, Switch(ON_OR_OFF);
        ["set", "vision"] "SWITCH":
            "send true yaw to a MAVLink autopilot, in place of its own compass; needs a declination";
        shown ["vision", "", ""], refused "on or off";
    "ATTITUDE" 23, stored 31: attitude_source: AttitudeSource = AttitudeSource::Autopilot, Choice;
        ["set", "attitude"] "SOURCE": "whose roll and pitch; auto: own body rates, and all own without an autopilot";
        shown ["attitude-source", "", ""], refused "a source of attitude is autopilot, own or auto", used by Solve;
    // ArduPilot warns of a request above 80 % of its loop rate, 50 Hz in a plane.
    "ATTITUDE_RATE" 10, stored 23: attitude_rate_hz: u8 = 40, Whole([20, 50], "a second", None);
        ["set", "attitude-rate"] "HZ": "highest rate at which attitude is requested from a MAVLink autopilot";
        shown ["attitude-rate", "", " Hz at most"], refused "a rate of attitude is 20 to 50 Hz";
    "SIGNING" 12, stored 24: signing_key: Option<SigningKey> = None, Key;
        ["set", "signing"] "PASSPHRASE":
            "sign MAVLink frames, and reject others, with the key of a passphrase, one word";
        shown ["signing", "", ""], refused "a passphrase or off";
    // MAV_COMP_ID_USER1 and above; 158 is MAV_COMP_ID_PERIPHERAL.
    "COMPONENT" 24, stored 32: component: u8 = 158, Whole([25, 250], "in MAVLink", None);
        ["set", "component"] "NUMBER": "MAVLink component of the module";
        shown ["component", "", ""], refused "a component is 25 to 250 in MAVLink";
    // Nodes 126 and 127 are for tools.
    "CAN_NODE" 0, stored 25: can_node: u8 = 0, Whole([0, 125], "as a node", Some("by allocation"));
        ["set", "can-node"] "NUMBER": "number on the CAN bus, after a restart; 0: the autopilot gives one";
        shown ["can", "node ", ""], refused "a node is 1 to 125, or 0 to ask the autopilot for one";
    // Autopilots drop a compass after 500 ms of silence.
    "CAN_RATE" 1, stored 26: can_rate_hz: u8 = 50, Whole([5, 80], "a second", None);
        ["set", "can-rate"] "HZ": "rate of the field on the CAN bus";
        shown ["can", ", ", " Hz"], refused "a rate of the field is 5 to 80 Hz";
    // In three frames instead of one.
    "CAN_COVARIANCE" 2, stored 27: can_sends_covariance: bool = false, Switch(ON_OR_OFF);
        ["set", "can-covariance"] "SWITCH": "send the field on the CAN bus with its covariance";
        shown ["can", ", covariance ", ""], refused "on or off";
    "CAN_TERMINATE" 22, stored 30: can_is_terminated: bool = false, Switch(ON_OR_OFF);
        ["set", "can-termination"] "SWITCH": "terminating resistor of the CAN bus, if the board switches one";
        shown ["can", ", termination ", ""], refused "on or off";
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

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// Factory settings with the present alignment, which belongs to the calibration, and the autopilot's numbers.
    #[must_use]
    pub const fn factory_reset(&self) -> Self {
        Self { align_deg: self.align_deg, replaced_numbers: self.replaced_numbers, ..Self::DEFAULT }
    }

    /// Settings of a port.
    #[must_use]
    pub const fn settings_of_port(&self, number: PortNumber) -> PortSettings {
        match number {
            PortNumber::One => PortSettings { protocol: self.port1_protocol, baud: self.port1_baud },
            PortNumber::Two => PortSettings { protocol: self.port2_protocol, baud: self.port2_baud },
        }
    }

    /// Constant attitude errors in the solver's units. Turns do not reveal them; the expected error of a calibration
    /// includes them.
    #[must_use]
    pub fn attitude_error_sigmas(&self) -> ConsiderSigmas {
        ConsiderSigmas {
            bias_rad: self.attitude_bias_deg.to_radians(),
            bank_scale: self.bank_scale_error_percent / 100.0,
        }
    }

    /// Errors of gyro and magnetometer in the monitor's units.
    #[must_use]
    pub fn sensor_error_sigmas(&self) -> SensorErrorSigmas {
        SensorErrorSigmas {
            gyro_scale: self.gyro_error_percent / 100.0,
            hard_iron_drift_per_minute: self.iron_drift_percent / 100.0,
        }
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
    pub fn with_setting(mut self, SettingChange { setting, value }: SettingChange) -> Result<Self, OutOfRange> {
        let is_set = match value {
            SettingValue::Numbers(numbers) => {
                let mut rows = SETTINGS.iter().skip_while(|row| *row != setting).zip(numbers);
                rows.all(|(row, number)| row.set_value(&mut self, SettingValue::Number(Some(number))))
            }
            value => setting.set_value(&mut self, value),
        };
        if is_set && self.is_valid() { Ok(self) } else { Err(OutOfRange(setting.range_text)) }
    }
}

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
        while !is_equal_text(SETTINGS[index].parameter_name.as_bytes(), parameter_name.as_bytes()) {
            index += 1;
        }
        Self { setting: &SETTINGS[index], value }
    }

    /// Whether a state depends on the setting. Calibrations come from solves.
    #[must_use]
    pub fn affects(self, state: DependentState) -> bool {
        let dependent = self.setting.dependent_state;
        dependent == state || (dependent, state) == (DependentState::Calibration, DependentState::Solve)
    }
}

const fn is_equal_text(first: &[u8], second: &[u8]) -> bool {
    match (first, second) {
        ([first, first_rest @ ..], [second, second_rest @ ..]) => {
            *first == *second && is_equal_text(first_rest, second_rest)
        }
        _ => first.is_empty() && second.is_empty(),
    }
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

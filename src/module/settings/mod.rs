//! User settings: one table ([`SETTINGS`]), from which fields ([`Settings`]), factory settings, commands, `status all`,
//! parameters, stored fields and range checks derive.

mod ports;
mod setting;

use core::fmt;

use crate::replaced_numbers::ReplacedNumbers;
use autoswing::attitude::AttitudeSource;
use autoswing::calibration::{ConsiderSigmas, Orientation};
use autoswing::earth::EarthField;
use autoswing::instrument::SensorErrorSigmas;
pub use ports::{BaudRate, PORT_COUNT, PortNumber, PortSettings, ProtocolKind};
pub use setting::{Choice, DependentState, Field, SettingRow, SettingValue, SigningKey};

/// Row of the table of [`Settings`].
pub type Setting = SettingRow<Settings>;

/// Declares [`Settings`] and [`SETTINGS`]. A row: name as a parameter (none: `""`), tag of the stored field, field,
/// factory setting, kind of value; of a number its range and unit, of an angle that of the field model; word of the
/// command `set` (none: `""`), help; line of `status all` if it is not the word, text before the value; state that
/// depends on the setting.
macro_rules! settings {
    ($($(#[$description:meta])*
       $name:literal stored $tag:literal: $field:ident: $type:ty = $default:expr, $kind:ident
       $($least:literal to $most:literal $unit:literal)? $(, model $model:expr)?;
       $word:literal: $help:literal $(, shown $line:literal $label:literal)? $(, used by $dependent:ident)?;)*) => {
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

        /// All settings, in the order of `help`.
        pub static SETTINGS: [Setting; [$($tag),*].len()] = [$(SettingRow {
            parameter_name: $name,
            stored_tag: $tag,
            field: |settings| Field::$kind(&mut settings.$field),
            command_word: $word,
            help_text: $help,
            status_texts: [$([$line, $label],)? [$word, ""]][0],
            range: [$([$least as f32, $most as f32],)? [0.0; 2]][0],
            unit: concat!($($unit)?),
            refusal_text: [
                $(concat!($word, " is ", $least, " to ", $most, " ", $unit),)?
                concat!($word, " has no such value"),
            ][0],
            model_angle: [$($model as fn(&EarthField) -> Option<f32>,)? |_: &EarthField| None][0],
            dependent_state: [$(DependentState::$dependent,)? DependentState::None][0],
        }),*];
    };
}

// The rates of headings and of the field are at most the measurement rate. A setting that is no parameter, which a
// command of its own sets, is last.
settings! {
    "STREAM" stored 7: stream_on: bool = true, Choice;
        "stream": "send heading sentences";
    // Autopilots expect a compass at 10 Hz.
    "STREAM_RATE" stored 8: stream_rate_hz: u8 = 10, Whole 1 to 80 "Hz";
        "stream-rate": "sentences per second", shown "stream" "";
    "STREAM_HEADING" stored 12: stream_heading: HeadingKind = HeadingKind::Smooth, Choice;
        "heading": "heading sent: smoothed by the body rates, or raw for an autopilot with its own filter",
        shown "stream" "heading ";
    "DECLINATION" stored 4: declination_deg: Option<f32> = None,
        Angle -180 to 180 "deg", model |field: &EarthField| field.declination_deg;
        "declination": "declination, east positive; none: by the field model";
    "INCLINATION" stored 5: inclination_deg: Option<f32> = None,
        Angle -90 to 90 "deg", model |field: &EarthField| Some(field.inclination_deg);
        "inclination": "inclination of the local field, positive down; none: by model or samples",
        used by Solve;
    "MOUNT" stored 9: mount: Orientation = Orientation::IDENTITY_ROTATION, Choice;
        "mount": "orientation of the sensor: rotated from the vehicle by yaw, then pitch, then roll",
        used by Calibration;
    // A good, carefully levelled autopilot: the solver's default.
    "ATT_ERROR_DEG" stored 10: attitude_bias_deg: f32 = 0.2, Number 0 to 5 "deg";
        "attitude-error": "constant attitude error of a flight, 1 sigma", used by Solve;
    "ATT_ERROR_BANK" stored 11: bank_scale_error_percent: f32 = 1.0, Number 0 to 20 "% of bank";
        "bank-error": "scale error of the bank angle in turns, 1 sigma", shown "attitude-error" "", used by Solve;
    // Up to the largest error that the monitor estimates; the defaults are those of the monitor.
    "GYRO_ERROR" stored 28: gyro_error_percent: f32 = 2.0, Number 0.1 to 20 "%";
        "gyro-error": "expected scale error of the gyro, 1 sigma";
    "IRON_DRIFT" stored 29: iron_drift_percent: f32 = 0.25, Number 0.05 to 5 "% of the field a minute";
        "iron-drift": "expected drift of the hard iron, 1 sigma";
    // From the accuracy of the best compasses to the largest accepted expected error. 0.5 deg requires a whole routine:
    // of copters that stopped at 0.7 deg, after the first tilts, one in six had over three times the expected error.
    "ACCURACY" stored 13: accuracy_deg: f32 = 0.5, Number 0.2 to 3 "deg";
        "accuracy": "expected error at which a collection in flight ends";
    "AUTO" stored 14: auto_on: bool = true, Choice;
        "auto": "collect automatically while uncalibrated, as soon as the autopilot is armed", used by AutomaticStart;
    "PORT1" stored 15: port1_protocol: ProtocolKind = ProtocolKind::Auto, Choice;
        "port1": "protocol of the first port; auto: as the autopilot";
    // To instruments.
    "PORT2" stored 17: port2_protocol: ProtocolKind = ProtocolKind::Nmea, Choice;
        "port2": "protocol of the second port; auto: as the autopilot";
    "BAUD1" stored 16: port1_baud: BaudRate = BaudRate::B115200, Choice;
        "baud1": "baud rate of the first port", shown "port1" "baud ";
    "BAUD2" stored 18: port2_baud: BaudRate = BaudRate::B115200, Choice;
        "baud2": "baud rate of the second port", shown "port2" "baud ";
    "VISION" stored 19: sends_vision_yaw: bool = false, Choice;
        "vision": "send true yaw to a MAVLink autopilot; needs a declination";
    "ATTITUDE" stored 31: attitude_source: AttitudeSource = AttitudeSource::Autopilot, Choice;
        "attitude": "whose roll and pitch; auto: the autopilot's, checked by the own gyro; own without one",
        shown "attitude-source" "", used by Solve;
    // ArduPilot warns of a request above 80 % of its loop rate, 50 Hz in a plane.
    "ATTITUDE_RATE" stored 23: attitude_rate_hz: u8 = 40, Whole 20 to 50 "Hz";
        "attitude-rate": "highest rate of attitude that is requested by MAVLink";
    "SIGNING" stored 24: signing_key: Option<SigningKey> = None, Key;
        "signing": "sign MAVLink frames, and reject others, with the key of a passphrase, one word";
    // MAV_COMP_ID_USER1 and above; 158 is MAV_COMP_ID_PERIPHERAL.
    "COMPONENT" stored 32: component: u8 = 158, Whole 25 to 250 "in MAVLink";
        "component": "MAVLink component of the module";
    // Nodes 126 and 127 are for tools.
    "CAN_NODE" stored 25: can_node: u8 = 0, Whole 0 to 125 "on the bus";
        "can-node": "number on the CAN bus, after a restart; 0: by allocation", shown "can" "node ";
    // Autopilots drop a compass after 500 ms of silence.
    "CAN_RATE" stored 26: can_rate_hz: u8 = 50, Whole 5 to 80 "Hz";
        "can-rate": "rate of the field on the CAN bus", shown "can" "";
    // In three frames instead of one.
    "CAN_COVARIANCE" stored 27: can_sends_covariance: bool = false, Choice;
        "can-covariance": "send the field on the CAN bus with its covariance", shown "can" "covariance ";
    "CAN_TERMINATE" stored 30: can_is_terminated: bool = false, Choice;
        "can-termination": "terminating resistor of the CAN bus, if the board has one",
        shown "can" "termination ";
    /// Heading offset, degrees: yaw mounting angle of the attitude source, or of the sensor where the mounting is
    /// unobservable.
    "" stored 6: align_deg: f32 = 0.0, Number -180 to 180 "deg";
        "": "", shown "mount" "align ";
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

/// Settings that are parameters, in the order of their indices: all but the last.
pub static PARAMETERS: &[Setting] = SETTINGS.split_at(SETTINGS.len() - 1).0;

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
            cross_axis: self.attitude_source.gyro_cross_axis(),
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
        let is_applied = setting.set_value(&mut self, value) && self.is_valid();
        is_applied.then_some(self).ok_or(OutOfRange(setting.refusal_text))
    }
}

impl Setting {
    /// Setting with this parameter name.
    #[must_use]
    pub fn from_parameter_name(parameter_name: &[u8]) -> Option<&'static Self> {
        PARAMETERS.iter().find(|setting| setting.parameter_name.as_bytes() == parameter_name)
    }

    /// Change to a value; `None` for a value of another kind, or of no choice. Ranges are checked when it is applied.
    #[must_use]
    pub fn change_to(&'static self, value: SettingValue) -> Option<SettingChange> {
        self.set_value(&mut { Settings::DEFAULT }, value).then_some(SettingChange { setting: self, value })
    }
}

/// Change of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingChange {
    /// Setting to change.
    pub setting: &'static Setting,
    /// New value of the setting.
    pub value: SettingValue,
}

impl SettingChange {
    /// Change of the setting with this parameter name to a number, or to no angle; `None` for an unknown name, a value of
    /// another kind, or of no choice.
    #[must_use]
    pub fn named(parameter_name: &str, number: impl Into<Option<f32>>) -> Option<Self> {
        Setting::from_parameter_name(parameter_name.as_bytes())?.change_to(SettingValue::Number(number.into()))
    }

    /// Whether a state depends on the setting. Calibrations come from solves.
    #[must_use]
    pub fn affects(self, state: DependentState) -> bool {
        let dependent = self.setting.dependent_state;
        dependent == state || (dependent, state) == (DependentState::Calibration, DependentState::Solve)
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

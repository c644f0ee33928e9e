//! The settings as a list of named parameters, for protocols that read and write them one by one. Ranges, choices and
//! defaults are those of [`Settings`].

use core::ops::RangeInclusive;

use autoswing::calibration::Orientation;
use autoswing_module::settings::{
    AttitudeError, BaudRate, CanSettings, HeadingKind, PortNumber, ProtocolKind, SensorError, SettingChange, Settings,
    SigningKey,
};

/// Setting with a name of at most 16 characters.
#[derive(Debug)]
pub struct SettingParameter {
    /// Name, that of the console's command in capitals.
    pub parameter_name: &'static str,
    parameter_kind: ParameterKind,
}

/// Value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterValue {
    /// Integer; 0 and 1 of a switch, the position of a choice, bits per second of a baud rate.
    Whole(u32),
    /// Number; NaN if the setting has no value.
    Number(f32),
    /// Key of MAVLink signatures.
    Key(Option<SigningKey>),
}

#[derive(Debug)]
enum ParameterKind {
    Whole { range: [u32; 2], get: fn(&Settings) -> u32, set: fn(u32) -> Option<SettingChange> },
    Number { range: RangeInclusive<f32>, get: fn(&Settings) -> f32, set: fn(&Settings, f32) -> SettingChange },
    Key { get: fn(&Settings) -> Option<SigningKey>, set: fn(Option<SigningKey>) -> SettingChange },
}

/// All parameters. Tools also refer to parameters by position, so a new one is appended.
pub static PARAMETERS: [SettingParameter; 23] = [
    whole_number_parameter(
        "CAN_NODE",
        byte_range(&CanSettings::NODE_ID_RANGE),
        |settings| settings.can.node.into(),
        |value| change_to_byte(value, SettingChange::CanNode),
    ),
    whole_number_parameter(
        "CAN_RATE",
        byte_range(&CanSettings::RATE_HZ_RANGE),
        |settings| settings.can.rate_hz.into(),
        |value| change_to_byte(value, SettingChange::CanRateHz),
    ),
    whole_number_parameter(
        "CAN_COVARIANCE",
        SWITCH_RANGE,
        |settings| settings.can.sends_covariance.into(),
        |value| change_to_switch(value, SettingChange::CanCovariance),
    ),
    whole_number_parameter(
        "AUTO",
        SWITCH_RANGE,
        |settings| settings.auto_on.into(),
        |value| change_to_switch(value, SettingChange::Auto),
    ),
    number_parameter(
        "ACCURACY",
        Settings::ACCURACY_DEG_RANGE,
        |settings| settings.accuracy_deg,
        |_, deg| SettingChange::Accuracy(deg),
    ),
    number_parameter(
        "DECLINATION",
        Settings::DECLINATION_DEG_RANGE,
        |settings| settings.declination_deg.unwrap_or(f32::NAN),
        |_, deg| SettingChange::Declination(number_if_set(deg)),
    ),
    number_parameter(
        "INCLINATION",
        Settings::INCLINATION_DEG_RANGE,
        |settings| settings.inclination_deg.unwrap_or(f32::NAN),
        |_, deg| SettingChange::Inclination(number_if_set(deg)),
    ),
    whole_number_parameter(
        "MOUNT",
        [0, Orientation::ORIENTATION_COUNT as u32 - 1],
        |settings| choice_position(Orientation::all_orientations(), &settings.mount),
        |value| nth_choice(Orientation::all_orientations(), value).map(SettingChange::Mount),
    ),
    number_parameter(
        "ATT_ERROR_DEG",
        AttitudeError::BIAS_DEG_RANGE,
        |settings| settings.attitude_error.bias_deg,
        |settings, bias_deg| SettingChange::AttitudeError(AttitudeError { bias_deg, ..settings.attitude_error }),
    ),
    number_parameter(
        "ATT_ERROR_BANK",
        AttitudeError::BANK_PERCENT_RANGE,
        |settings| settings.attitude_error.bank_percent,
        |settings, bank_percent| {
            SettingChange::AttitudeError(AttitudeError { bank_percent, ..settings.attitude_error })
        },
    ),
    whole_number_parameter(
        "ATTITUDE_RATE",
        byte_range(&Settings::ATTITUDE_RATE_HZ_RANGE),
        |settings| settings.attitude_rate_hz.into(),
        |value| change_to_byte(value, SettingChange::AttitudeRateHz),
    ),
    whole_number_parameter(
        "VISION",
        SWITCH_RANGE,
        |settings| settings.sends_vision_yaw.into(),
        |value| change_to_switch(value, SettingChange::Vision),
    ),
    SettingParameter {
        parameter_name: "SIGNING",
        parameter_kind: ParameterKind::Key { get: |settings| settings.signing_key, set: SettingChange::Signing },
    },
    whole_number_parameter(
        "PORT1",
        PROTOCOL_POSITION_RANGE,
        |settings| protocol_position(settings, PortNumber::One),
        |value| protocol_change(PortNumber::One, value),
    ),
    whole_number_parameter(
        "PORT2",
        PROTOCOL_POSITION_RANGE,
        |settings| protocol_position(settings, PortNumber::Two),
        |value| protocol_change(PortNumber::Two, value),
    ),
    whole_number_parameter(
        "BAUD1",
        BAUD_RANGE_BITS_PER_S,
        |settings| baud_bits_per_s(settings, PortNumber::One),
        |value| baud_change(PortNumber::One, value),
    ),
    whole_number_parameter(
        "BAUD2",
        BAUD_RANGE_BITS_PER_S,
        |settings| baud_bits_per_s(settings, PortNumber::Two),
        |value| baud_change(PortNumber::Two, value),
    ),
    whole_number_parameter(
        "STREAM",
        SWITCH_RANGE,
        |settings| settings.stream_on.into(),
        |value| change_to_switch(value, SettingChange::StreamOn),
    ),
    whole_number_parameter(
        "STREAM_RATE",
        byte_range(&Settings::STREAM_RATE_HZ_RANGE),
        |settings| settings.stream_rate_hz.into(),
        |value| change_to_byte(value, SettingChange::StreamRateHz),
    ),
    whole_number_parameter(
        "STREAM_HEADING",
        [0, HeadingKind::ALL_HEADING_KINDS.len() as u32 - 1],
        |settings| choice_position(HeadingKind::ALL_HEADING_KINDS, &settings.stream_heading),
        |value| nth_choice(HeadingKind::ALL_HEADING_KINDS, value).map(SettingChange::StreamHeading),
    ),
    number_parameter(
        "GYRO_ERROR",
        SensorError::GYRO_PERCENT_RANGE,
        |settings| settings.sensor_error.gyro_percent,
        |settings, gyro_percent| SettingChange::SensorError(SensorError { gyro_percent, ..settings.sensor_error }),
    ),
    number_parameter(
        "IRON_DRIFT",
        SensorError::DRIFT_PERCENT_RANGE,
        |settings| settings.sensor_error.drift_percent,
        |settings, drift_percent| SettingChange::SensorError(SensorError { drift_percent, ..settings.sensor_error }),
    ),
    whole_number_parameter(
        "CAN_TERMINATE",
        SWITCH_RANGE,
        |settings| settings.can.is_terminated.into(),
        |value| change_to_switch(value, SettingChange::CanTermination),
    ),
];

const SWITCH_RANGE: [u32; 2] = [0, 1];
const PROTOCOL_POSITION_RANGE: [u32; 2] = [0, ProtocolKind::ALL_PROTOCOLS.len() as u32 - 1];
const BAUD_RANGE_BITS_PER_S: [u32; 2] = {
    let [least, .., most] = BaudRate::ALL_RATES;
    [least.bits_per_s(), most.bits_per_s()]
};

impl SettingParameter {
    /// Value in these settings.
    #[must_use]
    pub fn parameter_value(&self, settings: &Settings) -> ParameterValue {
        match self.parameter_kind {
            ParameterKind::Whole { get, .. } => ParameterValue::Whole(get(settings)),
            ParameterKind::Number { get, .. } => ParameterValue::Number(get(settings)),
            ParameterKind::Key { get, .. } => ParameterValue::Key(get(settings)),
        }
    }

    /// Least and largest value; `None` of a key.
    #[must_use]
    pub fn value_range(&self) -> Option<[ParameterValue; 2]> {
        match &self.parameter_kind {
            ParameterKind::Whole { range, .. } => Some(range.map(ParameterValue::Whole)),
            ParameterKind::Number { range, .. } => Some([*range.start(), *range.end()].map(ParameterValue::Number)),
            ParameterKind::Key { .. } => None,
        }
    }

    /// Change to a value; `None` for one of another kind, or of no choice. The state machine checks ranges.
    #[must_use]
    pub fn setting_change(&self, settings: &Settings, value: ParameterValue) -> Option<SettingChange> {
        match (&self.parameter_kind, value) {
            (ParameterKind::Whole { set, .. }, ParameterValue::Whole(value)) => set(value),
            (ParameterKind::Number { set, .. }, ParameterValue::Number(value)) => Some(set(settings, value)),
            (ParameterKind::Key { set, .. }, ParameterValue::Key(key)) => Some(set(key)),
            _ => None,
        }
    }
}

const fn whole_number_parameter(
    name: &'static str,
    range: [u32; 2],
    get: fn(&Settings) -> u32,
    set: fn(u32) -> Option<SettingChange>,
) -> SettingParameter {
    SettingParameter { parameter_name: name, parameter_kind: ParameterKind::Whole { range, get, set } }
}

const fn number_parameter(
    name: &'static str,
    range: RangeInclusive<f32>,
    get: fn(&Settings) -> f32,
    set: fn(&Settings, f32) -> SettingChange,
) -> SettingParameter {
    SettingParameter { parameter_name: name, parameter_kind: ParameterKind::Number { range, get, set } }
}

const fn byte_range(range: &RangeInclusive<u8>) -> [u32; 2] {
    [*range.start() as u32, *range.end() as u32]
}

fn change_to_byte(value: u32, set: fn(u8) -> SettingChange) -> Option<SettingChange> {
    u8::try_from(value).ok().map(set)
}

fn change_to_switch(value: u32, set: fn(bool) -> SettingChange) -> Option<SettingChange> {
    nth_choice([false, true], value).map(set)
}

/// A number; `None` for NaN, the value of a setting without a number.
fn number_if_set(value: f32) -> Option<f32> {
    (!value.is_nan()).then_some(value)
}

fn choice_position<T: PartialEq>(choices: impl IntoIterator<Item = T>, value: &T) -> u32 {
    choices.into_iter().position(|choice| choice == *value).map_or(0, |position| position as u32)
}

fn nth_choice<T>(choices: impl IntoIterator<Item = T>, position: u32) -> Option<T> {
    choices.into_iter().nth(usize::try_from(position).ok()?)
}

fn protocol_position(settings: &Settings, port: PortNumber) -> u32 {
    choice_position(ProtocolKind::ALL_PROTOCOLS, &settings.ports.settings_of_port(port).protocol)
}

fn protocol_change(port: PortNumber, value: u32) -> Option<SettingChange> {
    nth_choice(ProtocolKind::ALL_PROTOCOLS, value).map(|kind| SettingChange::Protocol(port, kind))
}

fn baud_bits_per_s(settings: &Settings, port: PortNumber) -> u32 {
    settings.ports.settings_of_port(port).baud.bits_per_s()
}

fn baud_change(port: PortNumber, value: u32) -> Option<SettingChange> {
    let baud = BaudRate::ALL_RATES.into_iter().find(|baud| baud.bits_per_s() == value)?;
    Some(SettingChange::Baud(port, baud))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Least and largest value of a parameter; no key and an example key for the signing key, which has no range.
    fn range_limits(parameter: &SettingParameter) -> [ParameterValue; 2] {
        parameter.value_range().unwrap_or([None, Some(SigningKey([7; 32]))].map(ParameterValue::Key))
    }

    /// The extremes are within the range of the settings, each is read back, and no other parameter changes.
    #[test]
    fn a_parameter_changes_itself_and_nothing_else() {
        for parameter in &PARAMETERS {
            for value in range_limits(parameter) {
                let change = parameter.setting_change(&Settings::DEFAULT, value).unwrap();
                let changed = Settings::DEFAULT.with_setting(change).unwrap();
                assert_eq!(parameter.parameter_value(&changed), value, "{}", parameter.parameter_name);
                for other in PARAMETERS.iter().filter(|other| other.parameter_name != parameter.parameter_name) {
                    let [before, after] =
                        [&Settings::DEFAULT, &changed].map(|settings| format!("{:?}", other.parameter_value(settings)));
                    assert_eq!(before, after, "{} by {}", other.parameter_name, parameter.parameter_name);
                }
            }
        }
    }

    /// One past each end of the range is refused, by the parameter or by the settings.
    #[test]
    fn values_beyond_a_range_are_refused() {
        let settings = Settings::DEFAULT;
        let refuses = |parameter: &SettingParameter, value| {
            parameter.setting_change(&settings, value).is_none_or(|change| settings.with_setting(change).is_err())
        };
        for parameter in &PARAMETERS {
            let outside = match parameter.value_range() {
                Some([ParameterValue::Whole(least), ParameterValue::Whole(most)]) => {
                    [least.wrapping_sub(1), most + 1].map(ParameterValue::Whole)
                }
                Some([ParameterValue::Number(least), ParameterValue::Number(most)]) => {
                    [least - 0.01, most + 0.01].map(ParameterValue::Number)
                }
                _ => [ParameterValue::Whole(0), ParameterValue::Number(0.0)],
            };
            for value in outside {
                assert!(refuses(parameter, value), "{} {value:?}", parameter.parameter_name);
            }
        }
    }

    /// Position of a variant; a new one is missing here at compile time.
    const fn variant_index(change: SettingChange) -> u8 {
        match change {
            SettingChange::StreamOn(_) => 0,
            SettingChange::StreamRateHz(_) => 1,
            SettingChange::StreamHeading(_) => 2,
            SettingChange::Declination(_) => 3,
            SettingChange::Inclination(_) => 4,
            SettingChange::Mount(_) => 5,
            SettingChange::AttitudeError(_) => 6,
            SettingChange::Accuracy(_) => 7,
            SettingChange::Auto(_) => 8,
            SettingChange::Protocol(port, _) => 9 + port as u8,
            SettingChange::Baud(port, _) => 11 + port as u8,
            SettingChange::Vision(_) => 13,
            SettingChange::AttitudeRateHz(_) => 14,
            SettingChange::Signing(_) => 15,
            SettingChange::CanNode(_) => 16,
            SettingChange::CanRateHz(_) => 17,
            SettingChange::CanCovariance(_) => 18,
            SettingChange::SensorError(_) => 19,
            SettingChange::CanTermination(_) => 20,
        }
    }

    #[test]
    fn every_setting_is_a_parameter_with_a_short_unique_name() {
        let changes = PARAMETERS
            .iter()
            .filter_map(|parameter| parameter.setting_change(&Settings::DEFAULT, range_limits(parameter)[0]));
        assert_eq!(changes.map(variant_index).collect::<BTreeSet<_>>(), (0..21).collect());
        let names: BTreeSet<&str> = PARAMETERS.iter().map(|parameter| parameter.parameter_name).collect();
        assert_eq!(names.len(), PARAMETERS.len());
        assert!(names.iter().all(|name| name.len() <= 16));
    }

    #[test]
    fn not_a_number_removes_an_entered_angle() {
        let declination = PARAMETERS.iter().find(|parameter| parameter.parameter_name == "DECLINATION").unwrap();
        let none = declination.setting_change(&Settings::DEFAULT, ParameterValue::Number(f32::NAN));
        assert_eq!(none, Some(SettingChange::Declination(None)));
    }
}

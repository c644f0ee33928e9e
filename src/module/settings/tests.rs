//! Unit tests of `settings`.

use std::collections::BTreeSet;

use super::*;
use crate::replaced_numbers::ReplacedNumber;
use autoswing::inertial::GYRO_CROSS_AXIS;

#[test]
fn attitude_errors_convert_to_the_solver_s_units() {
    let changed = Settings {
        attitude_bias_deg: 2.0,
        bank_scale_error_percent: 5.0,
        attitude_source: AttitudeSource::Own,
        ..Settings::DEFAULT
    };
    for (settings, expected) in [
        (Settings::DEFAULT, ConsiderSigmas::DEFAULT),
        (changed, ConsiderSigmas { bias_rad: 0.034_906_585, bank_scale: 0.05, cross_axis: GYRO_CROSS_AXIS }),
    ] {
        let ConsiderSigmas { bias_rad, bank_scale, cross_axis } = settings.attitude_error_sigmas();
        assert!((bias_rad / expected.bias_rad - 1.0).abs() < 0.003, "{expected:?}");
        assert!((bank_scale / expected.bank_scale - 1.0).abs() < 1e-6, "{expected:?}");
        assert_eq!(cross_axis.to_bits(), expected.cross_axis.to_bits());
    }
}

#[test]
fn sensor_errors_convert_to_the_monitor_s_units() {
    let settings = Settings { gyro_error_percent: 12.5, iron_drift_percent: 0.5, ..Settings::DEFAULT };
    let expected = SensorErrorSigmas { gyro_scale: 0.125, hard_iron_drift_per_minute: 0.005 };
    assert_eq!(settings.sensor_error_sigmas(), expected);
}

/// Every number at an end of a range, every choice, and the special ones: no angle, a key and none.
fn accepted_values(setting: &Setting) -> Vec<SettingValue> {
    let words = (0..).map_while(|index| setting.nth_word(index).map(|(_, value)| value));
    match setting.value(&Settings::DEFAULT) {
        SettingValue::Key(_) => words.chain([SettingValue::Key(Some(SigningKey([7; 32])))]).collect(),
        SettingValue::Number(_) => {
            words.chain(setting.value_range().map(|number| SettingValue::Number(Some(number)))).collect()
        }
    }
}

/// The nearest numbers beyond the range, and values of another kind.
fn refused_values(setting: &Setting) -> Vec<SettingValue> {
    let [least, most] = setting.value_range();
    let (numbers, none) = match (setting.field)(&mut { Settings::DEFAULT }) {
        Field::Choice(_) | Field::Whole(_) => {
            (vec![least - 1.0, least + 0.5, most + 1.0, most + 256.0, f32::NAN], true)
        }
        Field::Number(_) => (vec![least.next_down(), most.next_up(), f32::NAN], true),
        Field::Angle(_) => (vec![least.next_down(), most.next_up(), f32::NAN], false),
        Field::Key(_) => return [0.0, 1.0].map(|number| SettingValue::Number(Some(number))).to_vec(),
    };
    let numbers = numbers.into_iter().map(|number| SettingValue::Number(Some(number)));
    numbers.chain(none.then_some(SettingValue::Number(None))).chain([SettingValue::Key(None)]).collect()
}

fn change_settings(settings: Settings, setting: &'static Setting, value: SettingValue) -> Result<Settings, OutOfRange> {
    let change = setting.change_to(value).ok_or(OutOfRange("no change"))?;
    settings.with_setting(change)
}

/// Each row: values up to the ends of its range are read back and change no other row; others are refused.
#[test]
fn every_setting_has_its_range_and_changes_nothing_else() {
    let before = Settings { align_deg: 3.0, ..Settings::DEFAULT };
    for setting in PARAMETERS {
        assert!(setting.is_valid(&before), "{setting:?}");
        for value in accepted_values(setting) {
            let after = change_settings(before, setting, value).unwrap();
            assert_eq!(setting.value(&after), value, "{setting:?}");
            let others = SETTINGS.iter().filter(|other| *other != setting);
            assert!(others.clone().all(|other| other.value(&after) == other.value(&before)), "{setting:?} {value:?}");
        }
        for value in refused_values(setting) {
            let refusal = change_settings(before, setting, value).unwrap_err();
            assert!([setting.refusal_text, "no change"].contains(&refusal.0), "{setting:?} {value:?}: {refusal}");
        }
    }
}

#[test]
fn words_have_their_values() {
    for (name, word, value) in [
        ("AUTO", "on", SettingValue::Number(Some(1.0))),
        ("AUTO", "off", SettingValue::Number(Some(0.0))),
        ("STREAM_HEADING", "raw", SettingValue::Number(Some(0.0))),
        ("MOUNT", "roll90-yaw270", SettingValue::Number(Some(23.0))),
        ("PORT2", "nmea", SettingValue::Number(Some(3.0))),
        ("BAUD1", "230400", SettingValue::Number(Some(230_400.0))),
        ("DECLINATION", "none", SettingValue::Number(None)),
        ("GYRO_ERROR", "default", SettingValue::Number(Some(2.0))),
        ("SIGNING", "off", SettingValue::Key(None)),
    ] {
        let setting = Setting::from_parameter_name(name.as_bytes()).unwrap();
        let found = (0..).map_while(|index| setting.nth_word(index)).find(|(own_word, _)| *own_word == word);
        assert_eq!(found, Some((word, value)), "{name}");
    }
}

#[test]
fn baud_rates_are_the_numbers_of_their_names() {
    for (name, baud) in BaudRate::NAMED_CHOICES {
        assert_eq!(name.parse(), Ok(baud.bits_per_s()));
    }
}

/// A refusal names the ends of the range.
#[test]
fn a_refusal_names_the_range() {
    for (name, value, refusal) in [
        ("CAN_NODE", 126.0, "can-node is 0 to 125 on the bus"),
        ("GYRO_ERROR", 0.0, "gyro-error is 0.1 to 20 %"),
        ("INCLINATION", -91.0, "inclination is -90 to 90 deg"),
    ] {
        let change = SettingChange::named(name, value).unwrap();
        assert_eq!(Settings::DEFAULT.with_setting(change).unwrap_err().to_string(), refusal);
    }
}

/// Stored items have the tags, so that none is shared. Three tags are startup values.
#[test]
fn rows_have_unique_tags_and_short_names() {
    let names: BTreeSet<&str> = PARAMETERS.iter().map(|setting| setting.parameter_name).collect();
    assert_eq!(names.len(), PARAMETERS.len());
    assert!(names.iter().all(|name| (1..=16).contains(&name.len())), "{names:?}");
    let tags: BTreeSet<u8> = SETTINGS.iter().map(|setting| setting.stored_tag).collect();
    assert_eq!(tags, (4..20).chain(23..).take(SETTINGS.len()).collect());
}

#[test]
fn a_signing_key_is_not_printed() {
    let value = SettingValue::Key(Some(SigningKey([7; 32])));
    assert_eq!(format!("{value:?}"), "Key(Some(SigningKey))");
}

#[test]
fn a_factory_reset_keeps_the_alignment_and_the_autopilot_s_numbers() {
    let owner = ReplacedNumbers::NONE.owner();
    let replaced = ReplacedNumber { owner, row: 3, number: Some(7.0) };
    let replaced_numbers = ReplacedNumbers::NONE.with_number(replaced);
    let kept = Settings { align_deg: 5.0, replaced_numbers, ..Settings::DEFAULT };
    assert_eq!(Settings { attitude_rate_hz: 20, ..kept }.factory_reset(), kept);
}

/// The alignment is computed from headings, so only loading checks its range.
#[test]
fn alignment_is_limited_to_180_deg() {
    for (align_deg, valid) in [(180.0, true), (-180.0, true), (180.1, false), (-180.1, false), (f32::NAN, false)] {
        assert_eq!(Settings { align_deg, ..Settings::DEFAULT }.is_valid(), valid, "{align_deg}");
    }
}

#[test]
fn solves_use_mounting_inclination_and_the_attitude_s_error() {
    let used: Vec<&str> = SETTINGS
        .iter()
        .filter(|setting| {
            setting
                .change_to(setting.value(&Settings::DEFAULT))
                .is_some_and(|change| change.affects(DependentState::Solve))
        })
        .map(|setting| setting.parameter_name)
        .collect();
    assert_eq!(used, ["INCLINATION", "MOUNT", "ATT_ERROR_DEG", "ATT_ERROR_BANK", "ATTITUDE"]);
}

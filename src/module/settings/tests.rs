//! Unit tests of `settings`.

use std::collections::BTreeSet;

use super::*;
use crate::replaced_numbers::ReplacedNumber;

#[test]
fn attitude_errors_convert_to_the_solver_s_units() {
    for (settings, expected) in [
        (Settings::DEFAULT, ConsiderSigmas::DEFAULT),
        (
            Settings { attitude_bias_deg: 2.0, bank_scale_error_percent: 5.0, ..Settings::DEFAULT },
            ConsiderSigmas { bias_rad: 0.034_906_585, bank_scale: 0.05 },
        ),
    ] {
        let ConsiderSigmas { bias_rad, bank_scale } = settings.attitude_error_sigmas();
        assert!((bias_rad / expected.bias_rad - 1.0).abs() < 0.003, "{expected:?}");
        assert!((bank_scale / expected.bank_scale - 1.0).abs() < 1e-6, "{expected:?}");
    }
}

#[test]
fn sensor_errors_convert_to_the_monitor_s_units() {
    let settings = Settings { gyro_error_percent: 12.5, iron_drift_percent: 0.5, ..Settings::DEFAULT };
    let expected = SensorErrorSigmas { gyro_scale: 0.125, hard_iron_drift_per_minute: 0.005 };
    assert_eq!(settings.sensor_error_sigmas(), expected);
}

/// Every value at an end of a range, every choice, and the special ones: no angle, a key and none.
fn accepted_values(setting: &Setting) -> Vec<SettingValue> {
    let mut values = setting.value_range().map_or(Vec::new(), Vec::from);
    values.extend((0..).map_while(|index| setting.nth_word(index).map(|(_, value)| value)));
    if let SettingValue::Key(_) = setting.value(&Settings::DEFAULT) {
        values.push(SettingValue::Key(Some(SigningKey([7; 32]))));
    }
    values
}

/// The nearest values beyond the range, and values of another kind.
fn refused_values(setting: &Setting) -> Vec<SettingValue> {
    let mut values = match setting.value_range() {
        Some([SettingValue::Whole(least), SettingValue::Whole(most)]) => {
            [least.wrapping_sub(1), most + 1, most + 256].map(SettingValue::Whole).to_vec()
        }
        Some([SettingValue::Number(Some(least)), SettingValue::Number(Some(most))]) => {
            [least.next_down(), most.next_up(), f32::NAN].map(|number| SettingValue::Number(Some(number))).to_vec()
        }
        _ => Vec::new(),
    };
    values.extend(
        [SettingValue::Whole(0), SettingValue::Number(Some(1.0)), SettingValue::Key(None)].into_iter().filter(
            |other| core::mem::discriminant(other) != core::mem::discriminant(&setting.value(&Settings::DEFAULT)),
        ),
    );
    if let Field::Number(_) = (setting.field)(&mut { Settings::DEFAULT }) {
        values.push(SettingValue::Number(None));
    }
    values
}

fn change_settings(settings: Settings, setting: &'static Setting, value: SettingValue) -> Result<Settings, OutOfRange> {
    let change = setting.change_to(value).ok_or(OutOfRange("no change"))?;
    settings.with_setting(change)
}

/// Each row: values up to the ends of its range are read back and change no other row; others are refused.
#[test]
fn every_setting_has_its_range_and_changes_nothing_else() {
    let before = Settings { align_deg: 3.0, ..Settings::DEFAULT };
    for setting in SETTINGS.iter().filter(|setting| setting.is_parameter()) {
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
        ("AUTO", "on", SettingValue::Whole(1)),
        ("AUTO", "off", SettingValue::Whole(0)),
        ("STREAM_HEADING", "raw", SettingValue::Whole(0)),
        ("MOUNT", "roll90-yaw270", SettingValue::Whole(23)),
        ("PORT2", "nmea", SettingValue::Whole(3)),
        ("BAUD1", "230400", SettingValue::Whole(230_400)),
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
fn numbers_convert_to_values_of_the_setting_s_kind() {
    for (name, number, value) in [
        ("STREAM_RATE", 20.0, Some(SettingValue::Whole(20))),
        ("STREAM_RATE", 20.5, None),
        ("STREAM_RATE", -1.0, None),
        ("BAUD1", 57_600.0, Some(SettingValue::Whole(57_600))),
        ("ACCURACY", 0.5, Some(SettingValue::Number(Some(0.5)))),
        ("SIGNING", 1.0, None),
    ] {
        let setting = Setting::from_parameter_name(name.as_bytes()).unwrap();
        assert_eq!(setting.number_value(number), value, "{name} {number}");
    }
    for (name, baud) in BaudRate::NAMED_CHOICES {
        assert_eq!(name.parse(), Ok(baud.bits_per_s()));
    }
}

/// A refusal names the ends of the range.
#[test]
fn a_refusal_names_the_range() {
    for (name, value, refusal) in [
        ("CAN_NODE", SettingValue::Whole(126), "can-node is 0 to 125 on the bus"),
        ("GYRO_ERROR", SettingValue::Number(Some(0.0)), "gyro-error is 0.1 to 20 %"),
        ("INCLINATION", SettingValue::Number(Some(-91.0)), "inclination is -90 to 90 deg"),
    ] {
        let change = SettingChange::named(name, value).unwrap();
        assert_eq!(Settings::DEFAULT.with_setting(change).unwrap_err().to_string(), refusal);
    }
}

/// Tags and positions are used by stored items and by tools, so that none is shared. Three tags are startup values.
#[test]
fn rows_have_unique_tags_positions_and_short_names() {
    let parameters: Vec<&Setting> = (0..).map_while(Setting::nth_parameter).collect();
    assert_eq!(parameters.len(), usize::from(Setting::PARAMETER_COUNT));
    let names: BTreeSet<&str> = parameters.iter().map(|setting| setting.parameter_name).collect();
    assert_eq!(names.len(), parameters.len());
    assert!(names.iter().all(|name| (1..=16).contains(&name.len())), "{names:?}");
    let tags: BTreeSet<u8> = SETTINGS.iter().map(|setting| setting.stored_tag).collect();
    assert_eq!(tags, (4..20).chain(23..).take(SETTINGS.len()).collect());
}

#[test]
fn a_signing_key_is_not_printed() {
    let change = SettingChange::named("SIGNING", SettingValue::Key(Some(SigningKey([7; 32])))).unwrap();
    assert!(format!("{change:?}").contains("Key(Some(SigningKey))"), "{change:?}");
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
    assert_eq!(used, ["MOUNT", "INCLINATION", "ATT_ERROR_DEG", "ATT_ERROR_BANK", "ATTITUDE"]);
}

//! Unit tests of `settings`.

use super::*;

const fn attitude_error_change(bias_deg: f32, bank_percent: f32) -> SettingChange {
    SettingChange::AttitudeError(AttitudeError { bias_deg, bank_percent })
}

#[test]
fn attitude_errors_convert_to_the_solver_s_units() {
    for (error, expected) in [
        (AttitudeError::DEFAULT, ConsiderSigmas::DEFAULT),
        (
            AttitudeError { bias_deg: 2.0, bank_percent: 5.0 },
            ConsiderSigmas { bias_rad: 0.034_906_585, bank_scale: 0.05 },
        ),
    ] {
        let ConsiderSigmas { bias_rad, bank_scale } = error.to_consider_sigmas();
        assert!((bias_rad / expected.bias_rad - 1.0).abs() < 0.003, "{error:?}");
        assert!((bank_scale / expected.bank_scale - 1.0).abs() < 1e-6, "{error:?}");
    }
}

const fn sensor_error_change(gyro_percent: f32, drift_percent: f32) -> SettingChange {
    SettingChange::SensorError(SensorError { gyro_percent, drift_percent })
}

#[test]
fn every_setting_has_its_range() {
    let nan = f32::NAN;
    for (good, bad, words) in [
        (
            &[SettingChange::StreamRateHz(1), SettingChange::StreamRateHz(80)][..],
            &[SettingChange::StreamRateHz(0), SettingChange::StreamRateHz(81)][..],
            "a rate is 1 to 80",
        ),
        (
            &[SettingChange::CanNode(0), SettingChange::CanNode(125)],
            &[SettingChange::CanNode(126), SettingChange::CanNode(255)],
            "a node is 1 to 125",
        ),
        (
            &[SettingChange::CanRateHz(5), SettingChange::CanRateHz(80)],
            &[SettingChange::CanRateHz(4), SettingChange::CanRateHz(81)],
            "a rate of the field is 5 to 80",
        ),
        (
            &[
                SettingChange::Declination(Some(-180.0)),
                SettingChange::Declination(Some(180.0)),
                SettingChange::Declination(None),
            ],
            &[
                SettingChange::Declination(Some(-180.1)),
                SettingChange::Declination(Some(180.1)),
                SettingChange::Declination(Some(nan)),
            ],
            "a declination is -180 to 180",
        ),
        (
            &[
                SettingChange::Inclination(Some(-90.0)),
                SettingChange::Inclination(Some(90.0)),
                SettingChange::Inclination(None),
            ],
            &[
                SettingChange::Inclination(Some(-90.1)),
                SettingChange::Inclination(Some(90.1)),
                SettingChange::Inclination(Some(nan)),
            ],
            "an inclination is -90 to 90",
        ),
        (
            &[sensor_error_change(0.1, 0.05), sensor_error_change(20.0, 5.0)],
            &[
                sensor_error_change(0.0, 1.0),
                sensor_error_change(20.1, 1.0),
                sensor_error_change(nan, 1.0),
                sensor_error_change(1.0, 0.0),
                sensor_error_change(1.0, 5.1),
                sensor_error_change(1.0, nan),
            ],
            "an error of the gyro is 0.1 to 20",
        ),
        (
            &[attitude_error_change(0.0, 0.0), attitude_error_change(5.0, 0.0), attitude_error_change(0.0, 20.0)],
            &[
                attitude_error_change(-0.1, 1.0),
                attitude_error_change(5.1, 1.0),
                attitude_error_change(nan, 1.0),
                attitude_error_change(1.0, -0.1),
                attitude_error_change(1.0, 20.1),
                attitude_error_change(1.0, nan),
            ],
            "a constant error is 0 to 5 degrees",
        ),
    ] {
        for &setting in good {
            assert!(Settings::DEFAULT.with_setting(setting).is_ok(), "{setting:?}");
        }
        for &setting in bad {
            let OutOfRange(range) = Settings::DEFAULT.with_setting(setting).unwrap_err();
            assert!(range.starts_with(words), "{setting:?}: {range}");
        }
    }
    for mount in Orientation::all_orientations() {
        assert_eq!(Settings::DEFAULT.with_setting(SettingChange::Mount(mount)).unwrap().mount, mount);
    }
}

#[test]
fn heading_kind_names_round_trip() {
    for (kind, name) in [(HeadingKind::Raw, "raw"), (HeadingKind::Smooth, "smooth")] {
        assert_eq!((kind.kind_name(), HeadingKind::from_name(name)), (name, Some(kind)));
    }
    assert_eq!(HeadingKind::from_name("smoothed"), None);
    assert_eq!(Settings::DEFAULT.stream_heading, HeadingKind::Smooth);
}

const TEST_KEY: SigningKey = SigningKey([7; 32]);

#[test]
fn a_signing_key_is_not_printed() {
    assert_eq!(format!("{:?}", SettingChange::Signing(Some(TEST_KEY))), "Signing(Some(SigningKey))");
}

#[test]
fn a_setting_changes_itself_and_nothing_else() {
    let before = Settings { align_deg: 3.0, ..Settings::DEFAULT };
    let mount = Orientation::from_name("yaw90").unwrap();
    for (setting, after) in [
        (SettingChange::StreamOn(false), Settings { stream_on: false, ..before }),
        (SettingChange::StreamRateHz(5), Settings { stream_rate_hz: 5, ..before }),
        (SettingChange::StreamHeading(HeadingKind::Raw), Settings { stream_heading: HeadingKind::Raw, ..before }),
        (SettingChange::Accuracy(1.5), Settings { accuracy_deg: 1.5, ..before }),
        (SettingChange::Auto(false), Settings { auto_on: false, ..before }),
        (SettingChange::Vision(true), Settings { sends_vision_yaw: true, ..before }),
        (SettingChange::AttitudeRateHz(50), Settings { attitude_rate_hz: 50, ..before }),
        (SettingChange::Signing(Some(TEST_KEY)), Settings { signing_key: Some(TEST_KEY), ..before }),
        (SettingChange::CanNode(9), Settings { can: CanSettings { node: 9, ..before.can }, ..before }),
        (SettingChange::CanRateHz(20), Settings { can: CanSettings { rate_hz: 20, ..before.can }, ..before }),
        (
            SettingChange::CanCovariance(true),
            Settings { can: CanSettings { sends_covariance: true, ..before.can }, ..before },
        ),
        (
            SettingChange::CanTermination(true),
            Settings { can: CanSettings { is_terminated: true, ..before.can }, ..before },
        ),
        (SettingChange::Declination(Some(-3.5)), Settings { declination_deg: Some(-3.5), ..before }),
        (SettingChange::Inclination(Some(60.0)), Settings { inclination_deg: Some(60.0), ..before }),
        (SettingChange::Mount(mount), Settings { mount, ..before }),
        (
            sensor_error_change(5.0, 1.0),
            Settings { sensor_error: SensorError { gyro_percent: 5.0, drift_percent: 1.0 }, ..before },
        ),
        (
            attitude_error_change(1.5, 3.0),
            Settings { attitude_error: AttitudeError { bias_deg: 1.5, bank_percent: 3.0 }, ..before },
        ),
    ] {
        assert_eq!(before.with_setting(setting), Ok(after));
    }
}

#[test]
fn a_port_s_setting_changes_that_port() {
    for port in PortNumber::ALL_PORTS {
        let before = Settings::DEFAULT;
        let mut ports = before.ports;
        ports.port_mut(port).protocol = ProtocolKind::Msp;
        assert_eq!(
            before.with_setting(SettingChange::Protocol(port, ProtocolKind::Msp)),
            Ok(Settings { ports, ..before })
        );
        ports.port_mut(port).baud = BaudRate::B230400;
        let both = Settings { ports, ..before };
        let changed = before.with_setting(SettingChange::Protocol(port, ProtocolKind::Msp)).unwrap();
        assert_eq!(changed.with_setting(SettingChange::Baud(port, BaudRate::B230400)), Ok(both));
    }
}

#[test]
fn a_factory_reset_keeps_the_alignment() {
    let used = Settings { align_deg: 5.0, attitude_rate_hz: 20, ..Settings::DEFAULT };
    assert_eq!(used.factory_reset(), Settings { align_deg: 5.0, ..Settings::DEFAULT });
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
    let none = Orientation::IDENTITY_ROTATION;
    for (setting, is_used) in [
        (SettingChange::Mount(none), true),
        (SettingChange::Inclination(None), true),
        (attitude_error_change(0.2, 1.0), true),
        (SettingChange::Declination(None), false),
        (SettingChange::StreamOn(true), false),
        (SettingChange::StreamRateHz(1), false),
        (SettingChange::StreamHeading(HeadingKind::Raw), false),
        (SettingChange::Accuracy(1.0), false),
        (SettingChange::Auto(false), false),
        (SettingChange::Protocol(PortNumber::One, ProtocolKind::Msp), false),
        (SettingChange::Baud(PortNumber::One, BaudRate::B57600), false),
        (SettingChange::Vision(true), false),
        (SettingChange::AttitudeRateHz(50), false),
        (SettingChange::Signing(None), false),
        (SettingChange::CanNode(1), false),
        (SettingChange::CanRateHz(20), false),
        (SettingChange::CanCovariance(true), false),
        (SettingChange::CanTermination(true), false),
        (sensor_error_change(2.0, 1.0), false),
    ] {
        assert_eq!(setting.is_used_by_solves(), is_used, "{setting:?}");
    }
}

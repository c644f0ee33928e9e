//! Stores of other firmware: the versions before, later ones, and those of long ago.
//!
//! # How `testdata/` was made
//!
//! `v2-first-half.bin` and `v2-second-half.bin` are the two halves of the simulated module's flash (eight pages of 2
//! KB), without the erased bytes at their ends, as the last firmware of version 2 left them. It had flown two circles
//! to each side in the world `WorldConfig::table1(3)`, calibrated, and been given `set declination -3.5`,
//! `set inclination 56.25` and `stream rate 25`; a magnet of [6, -4, 3] uT came aboard and it calibrated again; then
//! `stream off`, `set mount yaw90` and `set mount roll180-yaw90`. What is expected of it here is what that firmware
//! loaded.
//!
//! `v3-first-half.bin` and `v3-second-half.bin` are the same of the last firmware of version 3, after the same flights and
//! commands; `v4-first-half.bin` and `v4-second-half.bin` of the last one of version 4, which was given
//! `set attitude-error 0.5 2` before the magnet; `v5-first-half.bin` and `v5-second-half.bin` of the last one of version 5,
//! which was given `stream heading raw` besides; `v6-first-half.bin` and `v6-second-half.bin` of the last one of version 6,
//! which was given `set accuracy 1.5` besides; `v7-first-half.bin` and `v7-second-half.bin` of the last one of version 7, which
//! flew four circles to each side and was given `cal auto off` besides; `v8-first-half.bin` and `v8-second-half.bin` of the last
//! one of version 8, which was given `set vision on` and `set baud2 57600` before the magnet, and `set port1 msp` at the end.
#![expect(clippy::unreadable_literal, reason = "numbers as the device of that time printed them")]

use std::format;

use testkit::flash::Cut;

use super::*;
use crate::settings::{AttitudeError, HeadingKind};
use crate::settings::{Baud, PortNumber, PortsSettings, ProtocolKind};
use crate::store::{v2, v3, v4, v5, v6, v7, v8};

/// Later than any that this firmware knows.
const LATER: u8 = VERSION + 1;

/// The flash with these at the beginnings of its halves.
fn flash_of(images: [&[u8]; 2]) -> Flash {
    let mut flash = Flash::new(PAGES);
    for (half, image) in flash.bytes.chunks_mut(PAGE * PAGES / 2).zip(images) {
        half[..image.len()].copy_from_slice(image);
    }
    flash
}

/// The flash as the last firmware of version 2 left it.
fn flash_of_v2() -> Flash {
    flash_of([include_bytes!("../testdata/v2-first-half.bin"), include_bytes!("../testdata/v2-second-half.bin")])
}

/// The flash as the last firmware of version 3 left it.
fn flash_of_v3() -> Flash {
    flash_of([include_bytes!("../testdata/v3-first-half.bin"), include_bytes!("../testdata/v3-second-half.bin")])
}

/// The flash as the last firmware of version 4 left it.
fn flash_of_v4() -> Flash {
    flash_of([include_bytes!("../testdata/v4-first-half.bin"), include_bytes!("../testdata/v4-second-half.bin")])
}

/// The flash as the last firmware of version 5 left it.
fn flash_of_v5() -> Flash {
    flash_of([include_bytes!("../testdata/v5-first-half.bin"), include_bytes!("../testdata/v5-second-half.bin")])
}

/// The flash as the last firmware of version 6 left it.
fn flash_of_v6() -> Flash {
    flash_of([include_bytes!("../testdata/v6-first-half.bin"), include_bytes!("../testdata/v6-second-half.bin")])
}

/// The flash as the last firmware of version 7 left it.
fn flash_of_v7() -> Flash {
    flash_of([include_bytes!("../testdata/v7-first-half.bin"), include_bytes!("../testdata/v7-second-half.bin")])
}

/// The flash as the last firmware of version 8 left it.
fn flash_of_v8() -> Flash {
    flash_of([include_bytes!("../testdata/v8-first-half.bin"), include_bytes!("../testdata/v8-second-half.bin")])
}

/// What that firmware loaded; of the uncertainty, the noise of an average of eight readings.
#[expect(clippy::too_many_lines, reason = "two records, number by number")]
fn stored_by_v2() -> Stored {
    let settings = Settings {
        declination_deg: Some(-3.5),
        inclination_deg: Some(56.25),
        align_deg: 0.0,
        stream_on: false,
        stream_rate_hz: 25,
        mount: Orientation::from_name("roll180-yaw90").unwrap(),
        attitude_error: AttitudeError::DEFAULT,
        stream_heading: HeadingKind::Smooth,
        accuracy_deg: 0.5,
        auto_on: true,
        ports: PortsSettings::BEFORE_THERE_WERE_TWO,
        tells_vision: false,
    };
    let current = Record {
        calibration: Calibration {
            w: [
                [0.978_914_56, -0.029_673_168, 0.015_907_789],
                [0.024_489_606, 1.048_524_1, 0.018_998_345],
                [0.009_049_57, -0.018_239_329, 0.973_403_6],
            ],
            b_ut: [15.568_871_5, -4.780_499, 2.300_167_3],
            inclination_rad: 0.945_756_7,
            total_ut: 51.482_952,
            latency_s: 0.0,
            current: CurrentIron::NONE,
        },
        quality: Quality {
            method: Method::MaximumLikelihood,
            envelope: Envelope::Banked,
            expected_rms_deg: 0.401_117_18,
            expected_worst_deg: 0.541_662_16,
            norm_residual: 0.002_788_063_1,
            dip_residual_deg: 0.318_224_82,
            samples: 324,
            latency: None,
        },
        uncertainty: Uncertainty {
            products: [
                [
                    5.192298e-5,
                    -4.557737e-6,
                    -3.2702424e-6,
                    -6.918865e-6,
                    2.396258e-6,
                    -1.0685881e-6,
                    -5.091579e-8,
                    2.2118882e-5,
                    1.1710286e-5,
                    4.582809e-6,
                ],
                [
                    1.969168e-6,
                    7.9486694e-5,
                    -1.6239521e-6,
                    -2.8704078e-6,
                    -3.7176171e-6,
                    -2.568785e-6,
                    -5.2983787e-6,
                    -3.8186818e-7,
                    -6.063545e-7,
                    -1.3527605e-7,
                ],
                [
                    -7.572523e-7,
                    -4.0195782e-6,
                    0.000_205_499_63,
                    0.000_239_384_86,
                    3.5485095e-7,
                    -9.899148e-6,
                    -1.0730503e-5,
                    -7.800937e-6,
                    -2.3024015e-5,
                    -1.5820982e-5,
                ],
                [
                    2.2422616e-6,
                    1.5594887e-6,
                    5.3376734e-8,
                    -2.7085696e-7,
                    3.44054e-5,
                    -2.099257e-6,
                    -2.4370124e-6,
                    1.5427453e-5,
                    5.078893e-6,
                    1.8743874e-6,
                ],
                [
                    -3.4201955e-7,
                    -1.0475934e-6,
                    4.1539683e-6,
                    4.9086775e-6,
                    -3.4825448e-6,
                    0.000_168_278_17,
                    0.000_197_198_14,
                    -4.511263e-6,
                    -1.0753944e-5,
                    -6.6932043e-6,
                ],
                [
                    1.4742305e-5,
                    -1.1145181e-7,
                    -1.0546564e-6,
                    -1.5384916e-6,
                    1.4129101e-5,
                    -1.0531145e-5,
                    -1.1255974e-5,
                    0.000_271_607_4,
                    0.000_553_043_73,
                    0.000_281_651_6,
                ],
            ],
            sensor_sigma: 0.002_762_265,
            attitude_sigma_rad: 0.004_803_583,
        },
        sensor: Identity { model: Model::Lis3mdl, address: 0x1E },
        mount: Orientation::NONE,
        serial: 2,
    };
    let previous = Record {
        calibration: Calibration {
            w: [
                [0.979_161_44, -0.028_616_015, 0.017_564_613],
                [0.024_224_699, 1.049_83, 0.023_200_087],
                [0.009_877_677, -0.019_814_504, 0.971_905_6],
            ],
            b_ut: [9.656_52, -0.705_684_36, -0.806_943_66],
            inclination_rad: 0.946_622_7,
            total_ut: 51.541_1,
            latency_s: 0.0,
            current: CurrentIron::NONE,
        },
        quality: Quality {
            method: Method::MaximumLikelihood,
            envelope: Envelope::Banked,
            expected_rms_deg: 0.405_814_17,
            expected_worst_deg: 0.544_446_6,
            norm_residual: 0.002_683_459_8,
            dip_residual_deg: 0.346_578_24,
            samples: 324,
            latency: None,
        },
        uncertainty: Uncertainty {
            products: [
                [
                    5.4822194e-5,
                    -4.5770144e-6,
                    -2.0083755e-6,
                    -6.769141e-6,
                    3.4246466e-6,
                    -3.9502476e-7,
                    7.1665295e-7,
                    2.2423774e-5,
                    1.2200588e-5,
                    4.9066925e-6,
                ],
                [
                    1.8848525e-6,
                    7.7438955e-5,
                    5.67659e-6,
                    3.364719e-6,
                    -3.3500537e-6,
                    -2.082345e-6,
                    -5.230022e-6,
                    -5.4769964e-7,
                    -1.0213823e-6,
                    -4.5040161e-7,
                ],
                [
                    -1.0311111e-6,
                    -2.4534547e-6,
                    0.000_211_383_3,
                    0.000_246_619_3,
                    2.479231e-7,
                    -9.264472e-6,
                    -1.0264403e-5,
                    -5.0612143e-6,
                    -1.920768e-5,
                    -1.4898106e-5,
                ],
                [
                    3.060806e-6,
                    1.3581946e-6,
                    4.3461648e-7,
                    -2.9146564e-8,
                    3.2474854e-5,
                    3.8492344e-6,
                    2.8650836e-6,
                    1.5845508e-5,
                    5.638167e-6,
                    2.1227959e-6,
                ],
                [
                    -6.14883e-7,
                    -1.037065e-6,
                    3.934932e-6,
                    4.6362684e-6,
                    -2.164416e-6,
                    0.000_162_488_88,
                    0.000_192_158,
                    1.1461647e-5,
                    1.9975614e-5,
                    7.880031e-6,
                ],
                [
                    1.49747675e-5,
                    -2.179843e-7,
                    -1.2892375e-6,
                    -1.8692157e-6,
                    1.4483177e-5,
                    -7.1359746e-6,
                    -7.962479e-6,
                    0.000_270_975_23,
                    0.000_553_656_95,
                    0.000_282_925_87,
                ],
            ],
            sensor_sigma: 0.002_714_476_5,
            attitude_sigma_rad: 0.005_421_126_3,
        },
        sensor: Identity { model: Model::Lis3mdl, address: 0x1E },
        mount: Orientation::NONE,
        serial: 1,
    };
    Stored {
        settings,
        generations: Generations { current: Some(current), previous: Some(previous) },
        ..Stored::default()
    }
}

/// With the noise of a single reading, which is the square root of 8 as much: 2.828427.
fn converted() -> Stored {
    let mut stored = stored_by_v2();
    for record in [&mut stored.generations.current, &mut stored.generations.previous].into_iter().flatten() {
        record.uncertainty.sensor_sigma *= 2.828_427;
    }
    stored
}

#[test]
fn what_version_2_stored_is_kept_to_the_last_digit() {
    let found = load(&mut flash_of_v2()).unwrap();
    let current = found.generations.current.unwrap();
    assert_eq!((current.serial, current.uncertainty.sensor_sigma), (2, 0.007_812_865));
    assert_eq!(found, converted());
}

/// The bytes of a record before version 5: what is in one now, without what it says of the attitude's latency.
fn without_latency(record: &Record) -> Vec<u8> {
    let Record { calibration, quality, uncertainty, sensor, mount, serial } = record;
    let coefficients = (calibration.w, calibration.b_ut, calibration.inclination_rad, calibration.total_ut);
    let expected = (quality.method, quality.envelope, quality.expected_rms_deg, quality.expected_worst_deg);
    let fit = (quality.norm_residual, quality.dip_residual_deg, quality.samples);
    let all = (coefficients, expected, fit, uncertainty, (sensor, mount, serial));
    postcard::to_slice(&all, &mut [0; VALUE_SIZE]).unwrap().to_vec()
}

/// What a flash of this version gives: its calibrations are those of its bytes, one by one, and say nothing of the
/// attitude's latency.
fn kept_of(mut flash: Flash, version: u8) -> (Settings, [Record; 2]) {
    let found = load(&mut flash).unwrap();
    let Generations { current: Some(current), previous: Some(previous) } = found.generations else {
        panic!("{found:?}")
    };
    let generations = [&[1], &without_latency(&current)[..], &[1], &without_latency(&previous)].concat();
    for half in [0, 1] {
        let value = get(&mut flash, half).unwrap();
        let (found, contents) = value[..value.len() - 4].split_first().unwrap();
        assert_eq!(*found, version);
        assert!(contents.ends_with(&generations), "half {half}");
    }
    for record in [&current, &previous] {
        assert_eq!((record.calibration.latency_s, record.quality.latency), (0.0, None));
    }
    (found.settings, [current, previous])
}

/// Its settings lack the attitude source's error.
#[test]
fn what_version_3_stored_is_kept_to_the_last_digit() {
    let (settings, [current, previous]) = kept_of(flash_of_v3(), 3);
    assert_eq!(settings, stored_by_v2().settings);
    assert_eq!(settings.attitude_error, AttitudeError { bias_deg: 0.2, bank_percent: 1.0 });
    // As its console showed it.
    assert_eq!((current.serial, previous.serial, current.quality.samples), (2, 1, 214));
    assert_eq!(current.calibration.b_ut.map(|ut| (ut * 1000.0).round() as i32), [15_730, -4_712, 1_885]);
}

/// Its settings lack which heading is sent.
#[test]
fn what_version_4_stored_is_kept_to_the_last_digit() {
    let (settings, [current, previous]) = kept_of(flash_of_v4(), 4);
    let attitude_error = AttitudeError { bias_deg: 0.5, bank_percent: 2.0 };
    assert_eq!(settings, Settings { attitude_error, ..stored_by_v2().settings });
    assert_eq!(settings.stream_heading, HeadingKind::Smooth);
    // As its console showed it.
    assert_eq!((current.serial, previous.serial, current.quality.samples), (2, 1, 216));
    assert_eq!(current.calibration.b_ut.map(|ut| (ut * 1000.0).round() as i32), [15_526, -4_689, 2_232]);
}

/// Of a version whose calibrations are those of its bytes: they are kept to the last digit, and so are its settings, which
/// are given. What its console showed of the one in use: samples, and hard iron in nanotesla.
fn assert_kept_as_it_is(mut flash: Flash, version: u8, settings: Settings, shown: (u16, [i32; 3])) {
    let found = load(&mut flash).unwrap();
    assert_eq!(found.settings, settings);
    let current = found.generations.current.unwrap();
    assert_eq!((current.serial, current.quality.method.name()), (2, "maximum-likelihood"));
    let b_nt = current.calibration.b_ut.map(|ut| (ut * 1000.0).round() as i32);
    assert_eq!((current.quality.samples, b_nt), shown);
    let generations = postcard::to_slice(&found.generations, &mut [0; VALUE_SIZE]).unwrap().to_vec();
    for half in [0, 1] {
        let value = get(&mut flash, half).unwrap();
        let (found, contents) = value[..value.len() - 4].split_first().unwrap();
        assert_eq!(*found, version);
        // Of version 8 on what is remembered may be behind them.
        let before = contents.split_last().map_or(contents, |(_, before)| before);
        let is_kept = contents.ends_with(&generations) || (version >= v8::VERSION && before.ends_with(&generations));
        assert!(is_kept, "half {half}");
    }
}

/// Its settings lack the wanted accuracy.
#[test]
fn what_version_5_stored_is_kept_to_the_last_digit() {
    let attitude_error = AttitudeError { bias_deg: 0.5, bank_percent: 2.0 };
    let settings = Settings { attitude_error, stream_heading: HeadingKind::Raw, ..stored_by_v2().settings };
    assert_eq!(settings.accuracy_deg.to_bits(), 0.5_f32.to_bits());
    assert_kept_as_it_is(flash_of_v5(), 5, settings, (324, [15_480, -4_728, 2_191]));
}

/// Its settings lack whether it collects by itself.
#[test]
fn what_version_6_stored_is_kept_to_the_last_digit() {
    let attitude_error = AttitudeError { bias_deg: 0.5, bank_percent: 2.0 };
    let before = stored_by_v2().settings;
    let settings = Settings { attitude_error, stream_heading: HeadingKind::Raw, accuracy_deg: 1.5, ..before };
    assert!(settings.auto_on);
    assert_kept_as_it_is(flash_of_v6(), 6, settings, (214, [15_871, -4_891, 1_891]));
}

/// The wanted accuracy in its place, and checked; what has no calibrations behind it is none of it.
#[test]
fn settings_of_version_6_are_read_one_by_one() {
    let settings = v3::Settings {
        declination_deg: None,
        inclination_deg: Some(60.0),
        align_deg: 0.0,
        stream_on: true,
        stream_rate_hz: 10,
        mount: v3::Mount(0),
    };
    let error = v4::AttitudeError { bias_deg: 1.0, bank_percent: 3.0 };
    let value = |accuracy_deg: f32| {
        value_of(v6::VERSION, &(v3::Head { saves: 3, settings }, error, false, accuracy_deg, generations(4)))
    };
    let Contents { saves, stored } = Contents::decode(&value(2.5)).unwrap();
    assert_eq!((saves, stored.generations), (3, generations(4)));
    assert_eq!(
        stored.settings,
        Settings {
            inclination_deg: Some(60.0),
            attitude_error: AttitudeError { bias_deg: 1.0, bank_percent: 3.0 },
            stream_heading: HeadingKind::Raw,
            accuracy_deg: 2.5,
            ports: PortsSettings::BEFORE_THERE_WERE_TWO,
            ..Settings::DEFAULT
        }
    );
    assert_eq!(Contents::decode(&value(3.5)), Err(StoreError::Corrupt));
    let cut_short = value_of(v6::VERSION, &(v3::Head { saves: 3, settings }, error, false, 2.5_f32));
    assert_eq!(Contents::decode(&cut_short), Err(StoreError::Corrupt));
}

/// Its settings lack the ports.
#[test]
fn what_version_7_stored_is_kept_to_the_last_digit() {
    let attitude_error = AttitudeError { bias_deg: 0.5, bank_percent: 2.0 };
    let settings = Settings {
        attitude_error,
        stream_heading: HeadingKind::Raw,
        accuracy_deg: 1.5,
        auto_on: false,
        ..stored_by_v2().settings
    };
    assert_kept_as_it_is(flash_of_v7(), 7, settings, (347, [15_377, -4_808, 2_191]));
}

/// Whether it collects by itself in its place, and the sentences where they were.
#[test]
fn settings_of_version_7_are_read_one_by_one() {
    let settings = v3::Settings {
        declination_deg: None,
        inclination_deg: None,
        align_deg: 0.0,
        stream_on: true,
        stream_rate_hz: 10,
        mount: v3::Mount(0),
    };
    let error = v4::AttitudeError { bias_deg: 0.2, bank_percent: 1.0 };
    let head = (v3::Head { saves: 3, settings }, error, true, 2.5_f32);
    for auto_on in [true, false] {
        let value = value_of(v7::VERSION, &(head, auto_on, generations(4)));
        let Contents { saves, stored } = Contents::decode(&value).unwrap();
        assert_eq!((saves, stored.generations), (3, generations(4)));
        let ports = PortsSettings::BEFORE_THERE_WERE_TWO;
        assert_eq!(stored.settings, Settings { accuracy_deg: 2.5, auto_on, ports, ..Settings::DEFAULT });
        assert_eq!(ports.of(PortNumber::One).protocol, ProtocolKind::Nmea);
    }
    let cut_short = value_of(v7::VERSION, &(head, true));
    assert_eq!(Contents::decode(&cut_short), Err(StoreError::Corrupt));
}

/// Nothing goes with the current.
#[test]
fn what_version_8_stored_is_kept_to_the_last_digit() {
    let mut ports = PortsSettings::DEFAULT;
    ports.of_mut(PortNumber::One).protocol = ProtocolKind::Msp;
    // Whatever this firmware was built with.
    ports.of_mut(PortNumber::Two).protocol = ProtocolKind::Nmea;
    ports.of_mut(PortNumber::Two).baud = Baud::B57600;
    let settings = Settings {
        attitude_error: AttitudeError { bias_deg: 0.5, bank_percent: 2.0 },
        stream_heading: HeadingKind::Raw,
        accuracy_deg: 1.5,
        auto_on: false,
        tells_vision: true,
        ports,
        ..stored_by_v2().settings
    };
    assert_kept_as_it_is(flash_of_v8(), 8, settings, (324, [15_437, -4_866, 2_100]));
}

/// What is remembered is where what goes with the current is now, and is not taken for it; and that is not there by half.
#[test]
fn version_8_knew_no_current_and_this_one_wants_it_whole() {
    let before = Contents { saves: 3, stored: Stored { generations: generations(4), ..Stored::default() } };
    let with = |version, behind: &[u8]| {
        let mut payload = postcard::to_slice(&before, &mut [0; VALUE_SIZE]).unwrap().to_vec();
        payload.extend_from_slice(behind);
        Contents::decode(&sealed([vec![version], payload].concat()))
    };
    assert_eq!(with(v8::VERSION, &[]), Ok(before));
    assert!(with(v8::VERSION, &[1]).unwrap().stored.remembered.is_collecting);
    assert_eq!(with(VERSION, &[0; 48]), Ok(before));
    assert_eq!(with(VERSION, &[0; 47]), Err(StoreError::Corrupt));
    let collecting = with(VERSION, &[&[0; 48][..], &[1]].concat()).unwrap();
    assert!(collecting.stored.remembered.is_collecting);
    let nan: [u8; 48] = [f32::NAN.to_le_bytes(); 12].as_flattened().try_into().unwrap();
    assert_eq!(with(VERSION, &nan), Err(StoreError::Corrupt));
}

/// Both headings, every value in its place, and what is checked now is checked.
#[test]
fn settings_of_version_5_are_read_one_by_one() {
    let settings = v3::Settings {
        declination_deg: Some(2.0),
        inclination_deg: None,
        align_deg: 12.0,
        stream_on: false,
        stream_rate_hz: 40,
        mount: v3::Mount(5),
    };
    let error = v4::AttitudeError { bias_deg: 1.0, bank_percent: 3.0 };
    let value = |settings: v3::Settings, is_smooth: bool| {
        value_of(v5::VERSION, &(v3::Head { saves: 3, settings }, error, is_smooth, generations(4)))
    };
    let decoded = |settings, is_smooth| {
        Contents::decode(&value(settings, is_smooth)).map(|contents| (contents.saves, contents.stored))
    };
    let (saves, found) = decoded(settings, true).unwrap();
    let expected = Settings {
        declination_deg: Some(2.0),
        inclination_deg: None,
        align_deg: 12.0,
        stream_on: false,
        stream_rate_hz: 40,
        mount: Orientation::from_name("roll180-yaw90").unwrap(),
        attitude_error: AttitudeError { bias_deg: 1.0, bank_percent: 3.0 },
        stream_heading: HeadingKind::Smooth,
        accuracy_deg: 0.5,
        auto_on: true,
        ports: PortsSettings::BEFORE_THERE_WERE_TWO,
        tells_vision: false,
    };
    assert_eq!((saves, found), (3, Stored { settings: expected, generations: generations(4), ..Stored::default() }));
    let raw = decoded(settings, false).unwrap().1;
    assert_eq!(raw.settings.stream_heading, HeadingKind::Raw);
    for bad in [v3::Settings { mount: v3::Mount(24), ..settings }, v3::Settings { stream_rate_hz: 0, ..settings }] {
        assert_eq!(decoded(bad, true), Err(StoreError::Corrupt));
    }
    for length in [1, 20, 30, 300] {
        let mut cut_short = value(settings, true);
        cut_short.truncate(length);
        assert_eq!(Contents::decode(&sealed(cut_short)), Err(StoreError::Corrupt), "{length}");
    }
}

/// The attitude source's error is checked as now, and what ends within it is not believed.
#[test]
fn values_out_of_range_are_refused_in_version_4_too() {
    let v3::Contents { head, generations } =
        contents_of_v3(5, v3::Method::Level, v3::Envelope::Level, v3::Model::Lis3mdl);
    let value =
        |bias_deg| value_of(v4::VERSION, &(head, v4::AttitudeError { bias_deg, bank_percent: 3.0 }, generations));
    let found = Contents::decode(&value(5.0)).unwrap().stored;
    assert_eq!(found.settings.attitude_error, AttitudeError { bias_deg: 5.0, bank_percent: 3.0 });
    assert_eq!(found.generations.current.unwrap().mount.name(), "roll180-yaw90");
    for bias_deg in [5.1, f32::NAN] {
        assert_eq!(Contents::decode(&value(bias_deg)), Err(StoreError::Corrupt), "{bias_deg}");
    }
    for length in [1, 20, 25, 200] {
        let mut cut_short = value(5.0);
        cut_short.truncate(length);
        assert_eq!(Contents::decode(&sealed(cut_short)), Err(StoreError::Corrupt), "{length}");
    }
}

/// The noise is that of a single reading from version 3 on.
#[test]
fn versions_2_and_3_differ_by_the_noise_of_a_reading() {
    let contents = contents_of_v3(3, v3::Method::Level, v3::Envelope::Level, v3::Model::Lis3mdl);
    let [two, three] = [v2::VERSION, v3::VERSION].map(|version| decoded(version, &contents).unwrap());
    let sigma = |stored: &Stored| stored.generations.current.unwrap().uncertainty.sensor_sigma;
    assert!((sigma(&two) - 0.002_828_427).abs() < 1e-9 && (sigma(&three) - 0.001).abs() < 1e-9);
    let mut mended = two;
    mended.generations.current.as_mut().unwrap().uncertainty.sensor_sigma = sigma(&three);
    assert_eq!(mended, three);
}

/// The last of its saves but one chose another mounting: the newer half is taken, and the other when that one is gone.
#[test]
fn the_newer_of_two_halves_of_version_2_is_taken() {
    let mut mounts = Vec::new();
    for half in [0, 1] {
        let mut flash = flash_of_v2();
        flash.bytes[half * PAGE * PAGES / 2..][..PAGE * PAGES / 2].fill(0xFF);
        let found = load(&mut flash).unwrap();
        assert_eq!(found.generations, converted().generations);
        mounts.push(found.settings.mount.name());
    }
    mounts.sort_unstable();
    assert_eq!(mounts, ["roll180-yaw90", "yaw90"]);
}

#[test]
fn the_first_save_after_an_update_writes_the_present_version() {
    let mut flash = flash_of_v2();
    let versions = |flash: &mut Flash| {
        let mut versions = [0, 1].map(|half| get(flash, half).unwrap()[0]);
        versions.sort_unstable();
        versions
    };
    assert_eq!(versions(&mut flash), [2, 2]);
    load(&mut flash).unwrap();
    assert_eq!(versions(&mut flash), [2, 2], "a load changes nothing");
    save_change(&mut flash, Change::Settings(&settings())).unwrap();
    let after = Stored { settings: settings(), ..converted() };
    assert_eq!((versions(&mut flash), load(&mut flash)), ([2, VERSION], Ok(after)));
    save(&mut flash, 9).unwrap();
    let after = Stored { generations: generations(9), ..after };
    assert_eq!((versions(&mut flash), load(&mut flash)), ([VERSION; 2], Ok(after)));
}

/// Power fails at every program and erase of that save: what version 2 stored is found, or all that was saved.
#[test]
fn a_power_cut_in_the_first_save_after_an_update_leaves_either() {
    let start = flash_of_v2();
    let after = Stored { generations: generations(9), ..converted() };
    let mut complete = start.clone();
    save(&mut complete, 9).unwrap();
    let mut seen = [0, 0];
    for at in 0..complete.operations {
        for cut in Cut::ALL {
            let mut flash = start.cut_at(at, cut);
            save(&mut flash, 9).unwrap_err();
            let mut flash = flash.power_on();
            let found = load(&mut flash);
            assert!(found == Ok(converted()) || found == Ok(after), "{cut:?} at {at}: {found:?}");
            seen[usize::from(found == Ok(after))] += 1;
            save(&mut flash, 10).unwrap();
            assert_eq!(load_generations(&mut flash), Ok(generations(10)), "{cut:?} at {at}");
        }
    }
    // Two records are 87 double words with their header; only after the last can the new ones be whole.
    assert!(seen[0] > 80 * Cut::ALL.len() && seen[1] > 0, "{seen:?}");
}

/// Contents as versions 2 and 3 had them, with these in the record in use.
fn contents_of_v3(mount: u8, method: v3::Method, envelope: v3::Envelope, model: v3::Model) -> v3::Contents {
    let current = v3::Calibrated {
        w: [[1.0, 0.1, 0.2], [0.3, 1.1, 0.4], [0.5, 0.6, 1.2]],
        b_ut: [1.0, 2.0, 3.0],
        inclination_rad: 0.9,
        total_ut: 50.0,
        method,
        envelope,
        expected_rms_deg: 0.5,
        expected_worst_deg: 0.6,
        norm_residual: 0.01,
        dip_residual_deg: 0.7,
        samples: 300,
        products: [[0.125; 10]; 6],
        sensor_sigma: 0.001,
        attitude_sigma_rad: 0.002,
        model,
        address: 0x1C,
        mount: v3::Mount(mount),
        serial: 70_000,
    };
    let settings = v3::Settings {
        declination_deg: None,
        inclination_deg: None,
        align_deg: 12.0,
        stream_on: true,
        stream_rate_hz: 80,
        mount: v3::Mount(0),
    };
    let generations = v3::Generations { current: Some(current), previous: None };
    v3::Contents { head: v3::Head { saves: 1, settings }, generations }
}

fn decoded(version: u8, contents: &v3::Contents) -> Result<Stored, StoreError> {
    Contents::decode(&value_of(version, contents)).map(|contents| contents.stored)
}

fn decoded_v2(contents: &v3::Contents) -> Result<Stored, StoreError> {
    decoded(v2::VERSION, contents)
}

/// Each by its name, which the types of both versions share.
#[test]
fn every_method_envelope_sensor_and_mounting_of_version_2_is_read() {
    use v3::{Envelope::Banked, Method::Level, Model::Lis3mdl};
    let record = |contents: v3::Contents| decoded_v2(&contents).unwrap().generations.current.unwrap();
    for method in [
        Level,
        v3::Method::FourEllipse,
        v3::Method::TwoPlane,
        v3::Method::MaximumLikelihood,
        v3::Method::CompassSwing,
        v3::Method::Ellipsoid,
    ] {
        let found = record(contents_of_v3(0, method, Banked, Lis3mdl)).quality.method;
        assert_eq!(format!("{found:?}"), format!("{method:?}"));
    }
    for envelope in [Banked, v3::Envelope::Level] {
        let found = record(contents_of_v3(0, Level, envelope, Lis3mdl)).quality.envelope;
        assert_eq!(format!("{found:?}"), format!("{envelope:?}"));
    }
    for model in [Lis3mdl, v3::Model::Lsm303dlhc] {
        let found = record(contents_of_v3(0, Level, Banked, model)).sensor;
        assert_eq!((format!("{:?}", found.model), found.address), (format!("{model:?}"), 0x1C));
    }
    for (number, mount) in (0..).zip(Orientation::all()) {
        assert_eq!(record(contents_of_v3(number, Level, Banked, Lis3mdl)).mount, mount);
    }
}

/// The values that differ from the image's.
#[test]
fn a_module_of_version_2_that_was_calibrated_once_keeps_it() {
    let contents = contents_of_v3(5, v3::Method::TwoPlane, v3::Envelope::Level, v3::Model::Lsm303dlhc);
    let found = decoded_v2(&contents).unwrap();
    assert_eq!((found.settings.declination_deg, found.settings.inclination_deg), (None, None));
    assert_eq!((found.settings.align_deg, found.settings.stream_on, found.settings.stream_rate_hz), (12.0, true, 80));
    assert_eq!(found.generations.previous, None);
    let current = found.generations.current.unwrap();
    assert_eq!((current.serial, current.mount.name(), current.quality.samples), (70_000, "roll180-yaw90", 300));
    let none = v3::Contents { generations: v3::Generations { current: None, previous: None }, ..contents };
    assert_eq!(decoded_v2(&none).unwrap().generations, Generations::default());
}

/// What version 2 would not have believed is not believed now.
#[test]
fn values_out_of_range_are_refused_in_version_2_too() {
    let good = contents_of_v3(23, v3::Method::Level, v3::Envelope::Level, v3::Model::Lis3mdl);
    assert!(decoded_v2(&good).is_ok());
    let no_mount = contents_of_v3(24, v3::Method::Level, v3::Envelope::Level, v3::Model::Lis3mdl);
    let mut previous = good;
    previous.generations.previous = no_mount.generations.current;
    let mut mount = good;
    mount.head.settings.mount = v3::Mount(24);
    let mut rate = good;
    rate.head.settings.stream_rate_hz = 81;
    let mut not_a_number = good;
    not_a_number.generations.current.as_mut().unwrap().sensor_sigma = f32::NAN;
    for (what, bad) in
        [("record", no_mount), ("before", previous), ("mount", mount), ("rate", rate), ("sigma", not_a_number)]
    {
        assert_eq!(decoded_v2(&bad), Err(StoreError::Corrupt), "{what}");
    }
    let mut cut_short = value_of(v2::VERSION, &good);
    cut_short.truncate(200);
    assert_eq!(Contents::decode(&sealed(cut_short)), Err(StoreError::Corrupt));
}

/// A copy of a later firmware, longer than any of this one.
fn later(version: u8) -> Vec<u8> {
    let mut value = vec![version];
    value.extend((0..1900).map(|n| n as u8));
    sealed(value)
}

/// Stores that a later firmware has written to: once, so that the other half is this version's, the one's before or
/// empty; or twice. It was the first half last, or the second.
fn flashes_of_later() -> Vec<(String, Flash)> {
    let present = Contents {
        saves: 7,
        stored: Stored { settings: settings(), generations: generations(4), ..Stored::default() },
    };
    let before = contents_of_v3(0, v3::Method::Level, v3::Envelope::Level, v3::Model::Lis3mdl);
    let error = v4::AttitudeError { bias_deg: 0.2, bank_percent: 1.0 };
    let others = [
        ("nothing", None),
        ("this version", Some(super::present(&present))),
        ("version 2", Some(value_of(v2::VERSION, &before))),
        ("version 3", Some(value_of(v3::VERSION, &before))),
        ("version 4", Some(value_of(v4::VERSION, &(before.head, error, before.generations)))),
        ("version 5", Some(value_of(v5::VERSION, &(before.head, error, true, generations(4))))),
        ("version 6", Some(value_of(v6::VERSION, &(before.head, error, true, 1.5_f32, generations(4))))),
        ("version 7", Some(value_of(v7::VERSION, &(before.head, error, true, (1.5_f32, false), generations(4))))),
        ("version 8", Some(value_of(v8::VERSION, &present))),
        ("version 1", Some(sealed(vec![1, 2, 3]))),
        ("damaged", Some(sealed(vec![VERSION, 2, 3]))),
        ("later", Some(later(LATER))),
    ];
    let mut flashes = Vec::new();
    for half in [0, 1] {
        for (name, other) in &others {
            let mut flash = Flash::new(PAGES);
            if let Some(value) = other {
                put(&mut flash, 1 - half, value);
            }
            put(&mut flash, half, &later(LATER));
            flash.operations = 0;
            flashes.push((format!("later in {half}, {name} in the other"), flash));
        }
    }
    flashes
}

/// An older copy beside it is not taken: what a downgraded module does would depend on how often the later firmware had
/// saved, and the calibration could be one that was replaced because it was wrong.
#[test]
fn what_a_later_firmware_stored_is_said_and_left_untouched() {
    for (case, flash) in flashes_of_later() {
        let mut tried = flash.clone();
        assert_eq!(load(&mut tried), Err(StoreError::UnknownVersion(LATER)), "{case}");
        let nothing = Change::Generations { current: None, previous: None };
        for change in [Change::Settings(&settings()), change(&generations(8)), nothing] {
            assert_eq!(save_change(&mut tried, change), Err(StoreError::UnknownVersion(LATER)), "{case}");
        }
        assert_eq!((tried.operations, &tried.bytes), (0, &flash.bytes), "{case}");
    }
    let mut far = Flash::new(PAGES);
    put(&mut far, 0, &later(255));
    assert_eq!(load(&mut far), Err(StoreError::UnknownVersion(255)));
    assert_eq!(save(&mut far, 1), Err(StoreError::UnknownVersion(255)));
}

#[test]
fn what_a_later_firmware_stored_is_forgotten_on_purpose() {
    for (case, mut flash) in flashes_of_later() {
        save_change(&mut flash, Change::Clear).unwrap();
        assert_eq!(load(&mut flash), Ok(Stored::default()), "{case}");
        for serial in 1..=4 {
            save(&mut flash, serial).unwrap();
            assert_eq!(load_generations(&mut flash), Ok(generations(serial)), "{case}");
        }
    }
}

/// Power fails at every program and erase of that: the later firmware's copy is still there, or the defaults are; never
/// an old copy of this version. Forgetting again then works.
#[test]
fn a_power_cut_while_forgetting_leaves_the_later_copy_or_the_defaults() {
    for (case, start) in flashes_of_later() {
        let mut complete = start.clone();
        save_change(&mut complete, Change::Clear).unwrap();
        for at in 0..complete.operations {
            for cut in Cut::ALL {
                let mut flash = start.cut_at(at, cut);
                save_change(&mut flash, Change::Clear).unwrap_err();
                let mut flash = flash.power_on();
                let found = load(&mut flash);
                let allowed = [Err(StoreError::UnknownVersion(LATER)), Ok(Stored::default())];
                assert!(allowed.contains(&found), "{case}, {cut:?} at {at}: {found:?}");
                save_change(&mut flash, Change::Clear).unwrap();
                assert_eq!(load(&mut flash), Ok(Stored::default()), "{case}, {cut:?} at {at}");
            }
        }
    }
}

/// A flash that fails to read is neither cleared: it may hold anything.
#[test]
fn an_unreadable_flash_is_not_cleared() {
    for (case, flash) in flashes_of_later() {
        let mut tried = flash.clone();
        tried.unreadable = Some((0..PAGE * PAGES / 2, usize::MAX));
        assert_eq!(save_change(&mut tried, Change::Clear), Err(StoreError::Flash), "{case}");
        assert_eq!((tried.operations, &tried.bytes), (0, &flash.bytes), "{case}");
    }
}

/// Clearing is told when the flash does not do it.
#[test]
fn a_later_copy_that_cannot_be_erased_is_told() {
    for (case, flash) in flashes_of_later() {
        let mut complete = flash.clone();
        save_change(&mut complete, Change::Clear).unwrap();
        let mut cut = flash.cut_at(complete.operations - 1, (Cut::Before, 0));
        assert_eq!(save_change(&mut cut, Change::Clear), Err(StoreError::Flash), "{case}");
        let mut dead = flash.cut_at(0, (Cut::Before, 0));
        assert_eq!(save_change(&mut dead, Change::Clear), Err(StoreError::Flash), "{case}");
    }
}

/// Versions before 2 were never released: they are said, and replaced by the next save.
#[test]
fn what_came_before_version_2_is_said_and_replaced() {
    for version in [0, 1] {
        for half in [0, 1] {
            let mut flash = Flash::new(PAGES);
            put(&mut flash, half, &sealed(vec![version, 1, 2, 3]));
            assert_eq!(load(&mut flash), Err(StoreError::UnknownVersion(version)));
            save(&mut flash, 3).unwrap();
            assert_eq!(load(&mut flash), Ok(Stored { generations: generations(3), ..Stored::default() }));
            save(&mut flash, 4).unwrap();
            assert_eq!(load_generations(&mut flash), Ok(generations(4)));
        }
    }
}

//! Tests of the instrument without tasks and clocks.

mod current;
mod plausibility;

use super::*;
use crate::attitude::{AttitudeConfig, AttitudeSource, BodyRates, RejectedReports, SenderId};
use crate::calibration::{AngleRates, Calibration, HeadingUncertainty, Orientation};
use crate::frames::{Sensor, wrap_pi};
use crate::time::WrappingMillis;
use core::ops::Range;
use testkit::random::Random;

pub(super) const PERIOD_US: u64 = 12_500;
const LATENCY_US: u64 = AttitudeConfig::DEFAULT.latency_us.unsigned_abs() as u64;
/// Start of the tests' clock, late enough that no time is negative.
const START_US: u64 = 1_000_000;

pub(super) fn us_after_start(us: u64) -> Timestamp {
    Timestamp::from_us(START_US + us)
}

fn instrument() -> Instrument {
    Instrument::new(InstrumentConfig::new(PERIOD_US as u32))
}

pub(super) fn instrument_with(correction: Correction) -> Instrument {
    let mut instrument = instrument();
    instrument.set_correction(correction);
    instrument
}

fn calibrated_instrument() -> Instrument {
    instrument_with(correction_with(test_calibration()))
}

pub(super) fn test_calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
}

pub(super) fn correction_with(calibration: Calibration) -> Correction {
    Correction { calibration: Some((calibration, HeadingUncertainty::NO_UNCERTAINTY)), ..Correction::UNCALIBRATED }
}

/// Sensor field of an aircraft without iron.
pub(super) fn sensor_field(heading_rad: f32, attitude: RollPitch) -> Field<Sensor> {
    Field::new(attitude.to_body_frame(Field::earth_field(50.0, 1.0, heading_rad)).ut)
}

fn reading_of_field(field: Field<Sensor>) -> Reading {
    Reading { field, is_saturated: false, was_overwritten: false }
}

pub(super) fn saturated_reading(field: Field<Sensor>) -> Reading {
    Reading { is_saturated: true, ..reading_of_field(field) }
}

pub(super) fn process_reading(instrument: &mut Instrument, us: u64, field: Field<Sensor>) -> Estimate {
    instrument.on_reading(us_after_start(us), reading_of_field(field))
}

/// Report of a sender without a clock; zero rates mean no gyro.
fn attitude_report(attitude: RollPitch, rates_rad_s: [f32; 3]) -> AttitudeReport {
    AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::default(),
        attitude,
        body_rates: BodyRates::from_rad_s(rates_rad_s),
    }
}

/// Reports an attitude that is true at `us`, after the source's latency.
pub(super) fn report_attitude(instrument: &mut Instrument, us: u64, attitude: RollPitch) {
    report_with_rates(instrument, us, attitude, [0.0; 3]);
}

/// Reports an attitude and body rates that are true at `us`, after the source's latency.
pub(super) fn report_with_rates(instrument: &mut Instrument, us: u64, attitude: RollPitch, rates_rad_s: [f32; 3]) {
    instrument.on_attitude(us_after_start(us + LATENCY_US), attitude_report(attitude, rates_rad_s));
}

/// Body rates of a level turn at 20 deg/s, banked by 5 deg, rad/s.
pub(super) fn level_turn_rates_rad_s() -> [f32; 3] {
    let (sin_roll, cos_roll) = 5_f32.to_radians().sin_cos();
    [0.0, sin_roll, cos_roll].map(|part| 20_f32.to_radians() * part)
}

fn take_samples(instrument: &mut Instrument) -> Vec<Sample> {
    std::iter::from_fn(|| instrument.next_sample()).collect()
}

/// Samples that complete with these readings of [`SAMPLE_FIELD`], by their numbers.
fn read_samples(instrument: &mut Instrument, readings: Range<u64>) -> Vec<Sample> {
    readings
        .flat_map(|i| {
            process_reading(instrument, i * PERIOD_US, SAMPLE_FIELD);
            take_samples(instrument)
        })
        .collect()
}

/// As [`read_samples`], with a report of a bank of 20 deg at each reading.
fn read_samples_with_attitude(instrument: &mut Instrument, readings: Range<u64>) -> Vec<Sample> {
    readings
        .flat_map(|i| {
            report_attitude(instrument, i * PERIOD_US, RollPitch::from_deg(20.0, 0.0));
            read_samples(instrument, i..i + 1)
        })
        .collect()
}

pub(super) const SAMPLE_FIELD: Field<Sensor> = Field::from_ut(20.0, -5.0, 40.0);

#[test]
fn readings_per_sample_give_about_ten_samples_per_second() {
    for (period_us, readings) in
        [(12_500, 8), (6_450, 16), (66_666, 2), (66_667, 1), (1_000_000, 1), (u32::MAX, 1), (0, u16::MAX)]
    {
        assert_eq!(InstrumentConfig::new(period_us).readings_per_sample(), readings, "{period_us} us");
    }
}

/// Latency of +-40 ms at a roll rate of 1 rad/s. Samples keep the reported attitude, so that any calibration can be
/// applied to them.
#[test]
fn latency_is_applied_to_headings_and_not_to_samples() {
    for latency_s in [0.04, -0.04, 0.0] {
        let mut instrument = instrument_with(correction_with(Calibration { latency_s, ..test_calibration() }));
        let rolled = |us: u64| RollPitch { roll_rad: us as f32 * 1e-6 - 0.2, pitch_rad: 0.1 };
        let mut found = Vec::new();
        for us in (0..400_000).step_by(PERIOD_US as usize) {
            if us % 50_000 == 0 {
                report_with_rates(&mut instrument, us, rolled(us), [1.0, 0.0, 0.0]);
            }
            let estimate = process_reading(&mut instrument, us, sensor_field(1.0, rolled(us)));
            if us >= 100_000 {
                let roll_rad = estimate.attitude.unwrap().roll_rad;
                assert!((roll_rad - rolled(us).roll_rad - latency_s).abs() < 1e-3, "{latency_s} {us}: {roll_rad}");
            }
            found.extend(take_samples(&mut instrument));
        }
        assert!(found.len() >= 3);
        for sample in found {
            let us = u64::from(sample.time.as_ms()) * 1000 - START_US;
            // Time resolution of a sample: 1 ms.
            assert!((sample.attitude.roll_rad - rolled(us).roll_rad).abs() < 2e-3, "{sample:?}");
            assert_eq!(sample.rates, AngleRates::from_rad_s([1.0, 0.0, 0.0]));
            assert!(
                (sample.latency_compensated_attitude(0.04).roll_rad - sample.attitude.roll_rad - 0.04).abs() < 1e-5
            );
        }
    }
}

#[test]
fn the_heading_ends_200_ms_after_the_last_attitude() {
    let mut instrument = calibrated_instrument();
    report_attitude(&mut instrument, 0, RollPitch::default());
    let field = sensor_field(1.0, RollPitch::default());
    assert!(process_reading(&mut instrument, 200_000, field).heading.is_ok());
    assert_eq!(process_reading(&mut instrument, 200_001, field).heading, Err(NoHeading::AttitudeStale));
}

/// The roll grows by 1 deg per reading; the mean of eight is 3.5 deg.
#[test]
fn a_sample_waits_for_the_attitude_after_it() {
    let mut instrument = instrument();
    report_attitude(&mut instrument, 0, RollPitch::from_deg(0.0, 2.0));
    assert_eq!(read_samples(&mut instrument, 0..8), [], "an extrapolated attitude is not used");
    report_attitude(&mut instrument, 8 * PERIOD_US, RollPitch::from_deg(8.0, 2.0));
    let [sample] = take_samples(&mut instrument)[..] else { panic!("one sample") };
    assert!((sample.attitude.roll_rad.to_degrees() - 3.5).abs() < 1e-3, "{sample:?}");
    assert_eq!(sample.field, SAMPLE_FIELD);
    assert_eq!(sample.time, us_after_start(7 * PERIOD_US / 2).wrapping_millis());
    assert_eq!(instrument.rejection_counts().unpaired_readings, 0);
}

#[test]
fn saturated_readings_are_in_no_sample() {
    let mut instrument = instrument();
    let mut made = Vec::new();
    for i in 0..24 {
        report_attitude(&mut instrument, i * PERIOD_US, RollPitch::default());
        if i % 3 == 2 {
            instrument.on_reading(us_after_start(i * PERIOD_US), saturated_reading(Field::from_ut(900.0, 0.0, 0.0)));
        } else {
            process_reading(&mut instrument, i * PERIOD_US, SAMPLE_FIELD);
        }
        made.extend(take_samples(&mut instrument));
    }
    assert_eq!(made.len(), 2);
    assert!(made.iter().all(|sample| (sample.field.ut - SAMPLE_FIELD.ut).norm() < 1e-4), "{made:?}");
}

#[test]
fn readings_in_an_attitude_gap_are_counted_and_dropped() {
    let mut instrument = instrument();
    report_attitude(&mut instrument, 0, RollPitch::from_deg(30.0, 0.0));
    assert_eq!(read_samples(&mut instrument, 1..33), []);
    report_attitude(&mut instrument, 400_000, RollPitch::from_deg(30.0, 0.0));
    assert!(take_samples(&mut instrument).is_empty());
    assert_eq!(instrument.rejection_counts().unpaired_readings, 31);
}

#[test]
fn readings_wait_for_attitude_up_to_0_3_s() {
    let mut instrument = instrument();
    for (us, unpaired) in [(0, 0), (299_999, 0), (300_000, 1), (599_998, 1), (599_999, 2)] {
        process_reading(&mut instrument, us, SAMPLE_FIELD);
        assert!(take_samples(&mut instrument).is_empty());
        assert_eq!(instrument.rejection_counts().unpaired_readings, unpaired, "after {us} us");
    }
    instrument.on_reading(us_after_start(899_998), saturated_reading(SAMPLE_FIELD));
    assert!(take_samples(&mut instrument).is_empty());
    assert_eq!(instrument.rejection_counts().unpaired_readings, 4);
}

/// Of more than 64 queued readings the oldest are dropped and counted.
#[test]
fn readings_dropped_from_a_full_queue_are_counted() {
    let mut instrument = Instrument::new(InstrumentConfig::new(1_000));
    report_attitude(&mut instrument, 0, RollPitch::default());
    for i in 1..=70 {
        process_reading(&mut instrument, i * 1_000, SAMPLE_FIELD);
        assert!(take_samples(&mut instrument).is_empty());
    }
    assert_eq!(instrument.rejection_counts().unpaired_readings, 6);
    report_attitude(&mut instrument, 70_000, RollPitch::default());
    assert!(take_samples(&mut instrument).is_empty(), "64 are not yet a sample of 100");
    assert_eq!(instrument.rejection_counts().unpaired_readings, 6);
}

#[test]
fn a_sample_mixes_no_readings_with_and_without_attitude() {
    let field_alone = Correction { sample_attitude: SampleAttitude::Unknown, ..Correction::UNCALIBRATED };
    let mut instrument = instrument_with(field_alone);
    assert_eq!(read_samples(&mut instrument, 0..4), []);
    instrument.set_correction(Correction::UNCALIBRATED);
    assert_eq!(read_samples_with_attitude(&mut instrument, 4..8), []);
    // A change of alignment does not restart the averaging run.
    instrument.set_correction(Correction { align_deg: 5.0, ..Correction::UNCALIBRATED });
    assert_eq!(read_samples_with_attitude(&mut instrument, 8..12).len(), 1);
}

/// Each row of the recording has field and attitude of one time, and becomes a sample.
#[test]
fn a_recording_at_10_hz_passes_unchanged() {
    let attitude = AttitudeConfig { latency_us: 0, ..AttitudeConfig::DEFAULT };
    let mut instrument = Instrument::new(InstrumentConfig { attitude, ..InstrumentConfig::new(100_000) });
    for row in 0..50_u16 {
        let us = u64::from(row) * 100_000;
        let attitude = RollPitch::from_deg(f32::from(row), -f32::from(row) / 10.0);
        let field = Field::from_ut(f32::from(row), 1.0, 2.0);
        instrument.on_attitude(us_after_start(us), attitude_report(attitude, [0.0; 3]));
        let estimate = process_reading(&mut instrument, us, field);
        assert_eq!(estimate.attitude, Some(attitude), "row {row}");
        let sample = Sample { time: us_after_start(us).wrapping_millis(), ..Sample::new(field, attitude) };
        assert_eq!(take_samples(&mut instrument), [sample], "row {row}");
    }
}

#[test]
fn a_new_sensor_sets_the_period_and_drops_waiting_readings() {
    let mut instrument = instrument();
    for us in [0, 300_000, 300_001] {
        process_reading(&mut instrument, us, SAMPLE_FIELD);
        assert!(take_samples(&mut instrument).is_empty());
    }
    assert_eq!(instrument.rejection_counts().unpaired_readings, 1);
    instrument.set_sensor_parameters(100_000, None);
    assert_eq!(instrument.instrument_config().reading_period_us, 100_000);
    report_attitude(&mut instrument, 400_000, RollPitch::default());
    assert!(take_samples(&mut instrument).is_empty(), "nothing waits");
    process_reading(&mut instrument, 400_000, SAMPLE_FIELD);
    assert_eq!(take_samples(&mut instrument).len(), 1);
    assert_eq!(instrument.rejection_counts().unpaired_readings, 1);
}

#[test]
fn no_report_or_reading_panics() {
    let mut random = Random(7);
    let extremes = [0.0, f32::NAN, f32::INFINITY, f32::MAX, -400.0, 1e-30];
    let mut instrument = calibrated_instrument();
    for _ in 0..5_000 {
        let mut pick = || extremes[random.bits() as usize % extremes.len()];
        let field = Field::from_ut(pick(), pick(), pick());
        let attitude = RollPitch { roll_rad: pick(), pitch_rad: pick() };
        let report = attitude_report(attitude, [pick(), pick(), pick()]);
        let us = random.bits() >> (random.bits() % 64);
        let at = Timestamp::from_us(us);
        match random.bits() % 4 {
            0 => {
                let sender_clock_at_sending = WrappingMillis::new(random.bits() as u32);
                instrument.on_attitude(at, AttitudeReport { sender_clock_at_sending, ..report });
            }
            1 => drop(instrument.on_silence(at)),
            _ => drop(instrument.on_reading(at, reading_of_field(field))),
        }
        let _ = take_samples(&mut instrument);
    }
}

/// True heading and estimate every 20 ms of a level turn at 20 deg/s from 1 rad, with body rates scaled by a factor.
fn fly_level_turn(instrument: &mut Instrument, from_s: f32, seconds: f32, rate_scale: f32) -> Vec<(f32, Estimate)> {
    let steps = |s: f32| (s * 50.0) as u64;
    (steps(from_s)..steps(from_s + seconds))
        .map(|i| {
            let us = i * 20_000;
            let heading_rad = 1.0 + 20_f32.to_radians() * i as f32 / 50.0;
            let attitude = RollPitch::from_deg(5.0 + 0.02 * (i % 7) as f32, 0.0);
            report_with_rates(instrument, us, attitude, level_turn_rates_rad_s().map(|rate| rate_scale * rate));
            let estimate = process_reading(instrument, us, sensor_field(heading_rad, attitude));
            while instrument.next_sample().is_some() {
                instrument.update_monitor();
            }
            (heading_rad, estimate)
        })
        .collect()
}

/// Whether all estimates, or none, have a smoothed heading.
fn is_smoothed(flown: &[(f32, Estimate)]) -> bool {
    let has_smoothed = flown[0].1.smoothed_heading.is_some();
    assert!(flown.iter().all(|(_, estimate)| estimate.smoothed_heading.is_some() == has_smoothed));
    has_smoothed
}

#[test]
fn a_source_with_rates_gives_a_smooth_heading() {
    let correction = Correction { align_deg: -30.0, ..correction_with(test_calibration()) };
    let mut instrument = instrument_with(correction);
    let first = fly_level_turn(&mut instrument, 0.0, 2.0, 1.0);
    assert!(!is_smoothed(&first) && first.iter().all(|(_, estimate)| estimate.heading.is_ok()));
    for (heading_rad, estimate) in &fly_level_turn(&mut instrument, 2.0, 20.0, 1.0)[15..] {
        let off_rad = wrap_pi(estimate.smoothed_heading.unwrap().magnetic_rad - heading_rad + 30_f32.to_radians());
        assert!(off_rad.to_degrees().abs() < 0.1, "{}", off_rad.to_degrees());
    }
}

/// Exact sensors that a hand swings at 1.5 Hz, with up to 500 deg/s. The readings of a sample are averaged as of one instant, and so leave
/// nothing that the monitor would take for errors of the gyro. Attitudes 10 ms apart are interpolated with errors of 0.2 deg.
#[test]
fn a_fast_swing_leaves_no_error_behind() {
    const SWING_RAD_S: f32 = 1.5 * core::f32::consts::TAU;
    let noise = HeadingUncertainty {
        relative_sensor_sigma: 0.005,
        attitude_sigma_rad: 0.005,
        ..HeadingUncertainty::NO_UNCERTAINTY
    };
    let calibration = Some((test_calibration(), noise));
    let mut instrument =
        instrument_with(Correction { calibration, attitude_source: AttitudeSource::Own, ..Correction::UNCALIBRATED });
    let mut worst_deg = 0.0_f32;
    for us in (0..60_000_000).step_by(2_500) {
        let (sin, cos) = (us as f32 * 1e-6 * SWING_RAD_S).sin_cos();
        let attitude = RollPitch { roll_rad: 0.3 * cos, pitch_rad: 0.6 * sin };
        let heading_rad = 1.0 + 0.9 * sin;
        let angle_rates = [-0.3 * sin, 0.6 * cos, 0.9 * cos].map(|rate| rate * SWING_RAD_S);
        let [roll_rad_s, pitch_rad_s, heading_rad_s] = angle_rates;
        if us % 10_000 == 0 {
            let rates_rad_s = EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s }.to_body_rates(attitude).into();
            let estimate = InertialAttitude {
                attitude,
                rates_rad_s,
                measured_rates_rad_s: Some(rates_rad_s),
                rest_offset_variance: 0.0,
                frame_heading_rad: heading_rad,
                start_count: 0,
                tilt_covariance: nalgebra::Matrix2::identity() * 1e-5,
                is_accurate: true,
            };
            instrument.on_inertial_attitude(us_after_start(us), &estimate);
        }
        if us % PERIOD_US == 0 {
            let estimate = process_reading(&mut instrument, us, sensor_field(heading_rad, attitude));
            while instrument.next_sample().is_some() {
                instrument.update_monitor();
            }
            if us > 5_000_000 {
                let heading = estimate.smoothed_heading.unwrap_or_else(|| panic!("{us}: {estimate:?}"));
                worst_deg = worst_deg.max(wrap_pi(heading.magnetic_rad - heading_rad).to_degrees().abs());
            }
        }
    }
    assert!(worst_deg < 0.3, "{worst_deg}");
}

#[test]
fn a_correction_with_other_headings_restarts_the_smoothed_heading() {
    let correction = correction_with(test_calibration());
    let other_calibration = correction_with(Calibration { b_ut: [0.1, 0.0, 0.0], ..test_calibration() });
    let mount = Some(Orientation::IDENTITY_ROTATION);
    for (changed, is_continued) in [
        (Correction { total_ut: Some(48.0), mount, is_armed: Some(true), ..correction.clone() }, true),
        (Correction { align_deg: 0.5, ..correction.clone() }, true),
        (Correction { has_valid_inclination: false, ..correction.clone() }, false),
        (other_calibration, false),
    ] {
        let mut instrument = instrument_with(correction.clone());
        fly_level_turn(&mut instrument, 0.0, 5.0, 1.0);
        instrument.set_correction(changed.clone());
        assert_eq!(is_smoothed(&fly_level_turn(&mut instrument, 5.0, 1.0, 1.0)), is_continued, "{changed:?}");
    }
}

/// Of a 64-bit computer; a module's are a few bytes smaller.
#[test]
fn the_state_fits_its_memory() {
    for (size, limit) in [(size_of::<Monitor>(), 2_080), (size_of::<Instrument>(), 7_904)] {
        assert!(size <= limit, "{size}, {limit}");
    }
}

/// Wrong rates also corrupt the monitor's states. A single report does not restart it.
#[test]
fn ten_reports_with_contradicting_rates_restart_the_monitor() {
    let initial = *Monitor::new(SensorErrorSigmas::DEFAULT).monitor_output();
    for (rate_sign, is_contradicting) in [(1.0, false), (-1.0, true)] {
        let mut instrument = calibrated_instrument();
        for second in 0..10_u8 {
            fly_level_turn(&mut instrument, f32::from(second), 1.0, 1.0);
        }
        assert_ne!(*instrument.monitor.monitor_output(), initial);
        let mut consecutive = 0;
        for i in 0..500_u16 {
            let t_s = f32::from(i) * 0.02;
            let before = instrument.attitude_track.rejected_reports().rate_contradictions;
            let attitude = RollPitch::from_deg(5.0 + 10.0 * t_s.sin(), 0.0);
            let rates_rad_s = [rate_sign * 10_f32.to_radians() * t_s.cos(), 0.0, 0.0];
            report_with_rates(&mut instrument, 10_000_000 + u64::from(i) * 20_000, attitude, rates_rad_s);
            let is_rejected = instrument.attitude_track.rejected_reports().rate_contradictions != before;
            consecutive = if is_rejected { consecutive + 1 } else { 0 };
            assert_eq!(*instrument.monitor.monitor_output() == initial, consecutive >= 10, "{rate_sign} {i}");
        }
        assert_eq!(consecutive >= 10, is_contradicting);
    }
}

//! Stuck axes, spikes, clipped readings and frozen attitudes.

use super::*;
use nalgebra::Vector3;

fn instrument_with_stuck_check() -> Instrument {
    let mut instrument = calibrated_instrument();
    instrument.set_sensor_parameters(PERIOD_US as u32, Some(16));
    instrument
}

/// Estimates and samples of a second of readings.
fn process_readings_for_second(
    instrument: &mut Instrument,
    from_us: u64,
    mut field: impl FnMut(u64) -> Field<Sensor>,
) -> (Vec<Estimate>, Vec<Sample>) {
    let mut made = Vec::new();
    let estimates = (0..80)
        .map(|i| {
            let us = from_us + i * PERIOD_US;
            report_attitude(instrument, us, RollPitch::from_deg(0.01 * i as f32, 0.0));
            let estimate = process_reading(instrument, us + LATENCY_US + 1, field(i));
            made.extend(take_samples(instrument));
            estimate
        })
        .collect();
    (estimates, made)
}

/// Estimates and samples of a second of readings that `fault` makes from good ones, after a second of good readings.
fn process_faulty_second(
    instrument: &mut Instrument,
    seed: u64,
    mut fault: impl FnMut(u64, Vector3<f32>) -> Field<Sensor>,
) -> (Vec<Estimate>, Vec<Sample>) {
    let mut random = Random(seed);
    let (estimates, made) = process_readings_for_second(instrument, 0, |_| noisy_field(&mut random));
    assert_eq!((empty_reasons(&estimates), made.len()), (vec![], 9), "the tenth sample waits for a report");
    process_readings_for_second(instrument, 1_000_000, |i| fault(i, noisy_field(&mut random).ut))
}

fn empty_reasons(estimates: &[Estimate]) -> Vec<NoHeading> {
    let mut reasons: Vec<_> = estimates.iter().filter_map(|estimate| estimate.heading.err()).collect();
    reasons.dedup();
    reasons
}

fn noisy_field(random: &mut Random) -> Field<Sensor> {
    let sensed = sensor_field(0.5, RollPitch::default()).ut;
    Field::new(sensed + Vector3::from_fn(|_, _| 0.3 * random.normal()))
}

#[test]
fn a_stuck_axis_is_reported_and_makes_no_samples() {
    let mut instrument = instrument_with_stuck_check();
    let stuck_y = sensor_field(0.5, RollPitch::default()).ut.y;
    let (estimates, made) =
        process_faulty_second(&mut instrument, 1, |_, good| Field::from_ut(good.x, stuck_y, good.z));
    assert_eq!(empty_reasons(&estimates), [NoHeading::SensorStuck]);
    assert!(estimates[15].heading.is_err() && estimates[15].body_field.is_none() && estimates[14].heading.is_ok());
    assert_eq!(instrument.rejection_counts().stuck_readings, 65);
    assert_eq!(made.len(), 2);
}

#[test]
fn a_spike_is_reported_and_excluded_from_its_sample() {
    let mut instrument = instrument_with_stuck_check();
    let (estimates, made) = process_faulty_second(&mut instrument, 2, |i, good| {
        Field::from_ut(if i % 20 == 10 { good.x + 40.0 } else { good.x }, good.y, good.z)
    });
    assert_eq!(empty_reasons(&estimates), [NoHeading::SensorSpike]);
    let counts = instrument.rejection_counts();
    assert_eq!((counts.spike_readings, counts.saturated_readings), (4, 0));
    let true_x = sensor_field(0.5, RollPitch::default()).ut.x;
    assert!(made.len() >= 8 && made.iter().all(|sample| (sample.field.ut.x - true_x).abs() < 0.6), "{made:?}");
}

#[test]
fn a_clipped_axis_is_reported() {
    let mut instrument = instrument_with_stuck_check();
    // The field grows until the axis is at the end of its range.
    let (estimates, _) = process_faulty_second(&mut instrument, 3, |i, good| {
        Field::from_ut((good.x + i as f32 * 0.2).min(30.0), good.y, good.z)
    });
    assert_eq!(empty_reasons(&estimates), [NoHeading::SensorClipped]);
    assert!(estimates[79].heading.is_err() && instrument.rejection_counts().clipped_readings > 30);
}

#[test]
fn a_frozen_attitude_is_reported_at_the_fifth_equal_report() {
    let mut random = Random(4);
    let mut instrument = instrument_with_stuck_check();
    process_readings_for_second(&mut instrument, 0, |_| noisy_field(&mut random));
    let estimates: Vec<Estimate> = (0..20)
        .map(|i| {
            let us = 1_000_000 + i * 20_000;
            report_attitude(&mut instrument, us, RollPitch::from_deg(3.0, 1.0));
            process_reading(&mut instrument, us + LATENCY_US + 1, noisy_field(&mut random))
        })
        .collect();
    assert_eq!(estimates.iter().position(|estimate| estimate.heading.is_err()), Some(4));
    assert_eq!(empty_reasons(&estimates), [NoHeading::AttitudeFrozen]);
    assert!(estimates[4].attitude.is_none() && estimates[4].body_field.is_some());
    assert_eq!(
        instrument.rejection_counts().rejected_reports,
        RejectedReports { frozen_reports: 16, ..RejectedReports::NO_REJECTIONS }
    );
}

/// At a resolution of 0.1 deg a constant attitude is plausible while only the heading turns, but not in a roll.
#[test]
fn a_coarse_source_is_frozen_when_the_field_turns() {
    for (turns, rolls_deg_s, expected) in [(0.3, 0.0, vec![]), (0.3, 10.0, vec![NoHeading::AttitudeFrozen])] {
        let mut instrument = instrument_with_stuck_check();
        let mut random = Random(5);
        let estimates: Vec<Estimate> = (0..160)
            .map(|i| {
                let us = i * PERIOD_US;
                if i % 2 == 0 {
                    report_attitude(&mut instrument, us, RollPitch::from_deg(0.1, 0.0));
                }
                let seconds = i as f32 / 80.0;
                let noise = Vector3::from_fn(|_, _| 0.3 * random.normal());
                let true_attitude = RollPitch::from_deg(0.1 + rolls_deg_s * seconds, 0.0);
                let field = Field::new(sensor_field(0.5 + turns * seconds, true_attitude).ut + noise);
                process_reading(&mut instrument, us + LATENCY_US + 1, field)
            })
            .collect();
        assert_eq!(empty_reasons(&estimates), expected, "{rolls_deg_s}");
    }
}

//! Tests of the attitude history.

use super::history::AttitudeHistory;
use super::testing::{PERIOD_US, report};
use super::*;
use crate::frames::{RollPitch, wrap_pi};
use crate::time::WrappingMillis;

const CONFIG: AttitudeConfig = AttitudeConfig::DEFAULT;
const LATENCY_US: u64 = CONFIG.latency_us.unsigned_abs() as u64;

/// Minimal nonzero rate, deg/s: marks a source with body rates.
const MINIMAL_RATE_DEG_S: f32 = 1e-3;

fn timestamp(us: u64) -> Timestamp {
    Timestamp::from_us(us)
}

fn attitude_report(sender_ms: u32, attitude: RollPitch, rates_deg_s: [f32; 3]) -> AttitudeReport {
    let report = report(attitude, rates_deg_s.map(f32::to_radians));
    AttitudeReport { sender_clock_at_sending: WrappingMillis::new(sender_ms), ..report }
}

fn roll_report(sender_ms: u32, roll_deg: f32, p_deg_s: f32) -> AttitudeReport {
    attitude_report(sender_ms, RollPitch::from_deg(roll_deg, 0.0), [p_deg_s, 0.0, 0.0])
}

/// Adds a report of an attitude that is true at `true_us`.
fn push_report(track: &mut AttitudeHistory, true_us: u64, report: AttitudeReport) {
    track.push_report(timestamp(true_us + LATENCY_US), report, None);
}

/// History of a report that is true at 1 s.
fn history_of_one_report(attitude: RollPitch, rates_deg_s: [f32; 3]) -> AttitudeHistory {
    let mut track = AttitudeHistory::new(CONFIG);
    push_report(&mut track, 1_000_000, attitude_report(0, attitude, rates_deg_s));
    track
}

/// Time at which report `number` of a history is true, microseconds.
fn true_us(number: usize) -> u64 {
    1_000_000 + number as u64 * PERIOD_US
}

/// History of reports that are true at 1 s and every 20 ms from then on.
fn history_of_reports(reports: impl IntoIterator<Item = AttitudeReport>) -> AttitudeHistory {
    let mut track = AttitudeHistory::new(CONFIG);
    reports.into_iter().enumerate().for_each(|(i, report)| push_report(&mut track, true_us(i), report));
    track
}

/// History of reports without a roll rate, and the time at which the last attitude is true, microseconds.
fn history_of_rolls(rolls_deg: &[f32]) -> (AttitudeHistory, u64) {
    let reports = rolls_deg.iter().map(|roll_deg| roll_report(0, *roll_deg, MINIMAL_RATE_DEG_S));
    (history_of_reports(reports), true_us(rolls_deg.len() - 1))
}

fn angles_deg(lookup: AttitudeLookup) -> [f32; 2] {
    match lookup {
        AttitudeLookup::Interpolated(a) | AttitudeLookup::Extrapolated(a) => {
            [a.roll_rad, a.pitch_rad].map(f32::to_degrees)
        }
        other => panic!("{other:?}"),
    }
}

fn roll_deg(lookup: AttitudeLookup) -> f32 {
    angles_deg(lookup)[0]
}

#[test]
fn interpolates_and_extrapolates_to_the_instant() {
    let track = history_of_reports((0..8_u32).map(|i| roll_report(500 + i * 20, 0.2 * i as f32, 10.0)));
    let lookup = track.attitude_at(timestamp(1_050_000));
    assert!(matches!(lookup, AttitudeLookup::Interpolated(_)));
    assert!((roll_deg(lookup) - 0.5).abs() < 1e-3);
    let lookup = track.attitude_at(timestamp(1_180_000));
    assert!(matches!(lookup, AttitudeLookup::Extrapolated(_)));
    assert!((roll_deg(lookup) - 1.8).abs() < 1e-3);
    assert_eq!(track.attitude_at(timestamp(1_400_000)), AttitudeLookup::Stale);
    assert_eq!(track.attitude_at(timestamp(900_000)), AttitudeLookup::Missing);
}

/// Roll the short way round.
#[test]
fn both_angles_are_interpolated() {
    for (from_deg, to_deg, part, [expected_roll, expected_pitch]) in [
        ([10.0, -4.0], [12.0, 0.0], 4, [10.5, -3.0]),
        ([179.0, 0.0], [-177.0, 0.0], 4, [180.0, 0.0]),
        ([-179.0, 0.0], [177.0, 0.0], 2, [179.0, 0.0]),
    ] {
        let track = history_of_reports(
            [from_deg, to_deg]
                .map(|[roll_deg, pitch_deg]| attitude_report(0, RollPitch::from_deg(roll_deg, pitch_deg), [0.0; 3])),
        );
        let [roll, pitch] = angles_deg(track.attitude_at(timestamp(1_000_000 + PERIOD_US / part)));
        let is_near = (roll.abs() - expected_roll).abs() < 1e-3 && (pitch - expected_pitch).abs() < 1e-3;
        assert!(is_near, "{from_deg:?} to {to_deg:?}: {roll} {pitch}");
    }
}

/// The rates of the angles are tested in `euler_rates`.
#[test]
fn extrapolation_uses_body_rates_with_their_signs() {
    for (roll_deg, pitch_deg, rates_deg_s, [expected_roll, expected_pitch]) in [
        (0.0, 0.0, [30.0, 0.0, 0.0], [3.0, 0.0]),
        (0.0, 0.0, [0.0, -20.0, 0.0], [0.0, -2.0]),
        (90.0, 0.0, [0.0, 0.0, 20.0], [90.0, -2.0]),
        // phi' = tan 45 deg q sin 60, theta' = q cos 60.
        (60.0, 45.0, [0.0, 20.0, 0.0], [61.732, 46.0]),
        // Wraps at 180 deg of roll; pitch stops at the vertical.
        (179.0, 0.0, [20.0, 0.0, 0.0], [-179.0, 0.0]),
        (0.0, 89.5, [0.0, 20.0, 0.0], [0.0, 90.0]),
        (0.0, -89.5, [0.0, -20.0, 0.0], [0.0, -90.0]),
    ] {
        let track = history_of_one_report(RollPitch::from_deg(roll_deg, pitch_deg), rates_deg_s);
        let [roll, pitch] = angles_deg(track.attitude_at(timestamp(1_100_000)));
        let case = format!("from {roll_deg} {pitch_deg} at {rates_deg_s:?}: {roll} {pitch}");
        assert!((roll - expected_roll).abs() < 1e-3 && (pitch - expected_pitch).abs() < 1e-3, "{case}");
    }
}

#[test]
fn jitter_of_arrival_times_is_removed() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..200_u32 {
        let jitter_us = u64::from(i * 7919 % 15) * 1000;
        let sent_us = 1_000_000 + u64::from(i) * PERIOD_US;
        track.push_report(timestamp(sent_us + jitter_us), roll_report(i * 20, i as f32 * 0.2, 0.0), None);
    }
    // At 10 deg/s a stamp error of 0.3 ms is 0.003 deg; arrival times would give up to 0.15 deg.
    let lookup_time = timestamp(1_000_000 + 197 * PERIOD_US - LATENCY_US);
    assert!((roll_deg(track.attitude_at(lookup_time)) - 197.0 * 0.2).abs() < 0.003);
}

/// A sender clock that deviates by more than 100 ms is ignored.
#[test]
fn a_distant_sender_clock_is_ignored() {
    for (delay_us, by_clock) in [(100_000, true), (100_001, false)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 0.0), None);
        track.push_report(timestamp(1_020_000 + delay_us), roll_report(20, 0.0, 0.0), None);
        // An instant just after the clock's stamp is extrapolated only if that stamp was used.
        let lookup = track.attitude_at(timestamp(1_020_011 - LATENCY_US));
        assert_eq!(matches!(lookup, AttitudeLookup::Extrapolated(_)), by_clock, "{delay_us} us: {lookup:?}");
    }
}

/// After a restart the source's filter aligns for 15 s. A report out of order is no restart. Without a clock, as of
/// MSP, silence of 2.5 s is one.
#[test]
fn the_attitude_of_a_restarted_sender_is_rejected_at_first() {
    const FIRST_CLOCK_MS: u32 = 900_000;
    // Silence of the sender, and by how much its clock then reads less than at the first report.
    for (silence_us, clock_step_ms, is_restart) in [
        (PERIOD_US, Some(900), false),
        (PERIOD_US, Some(1_100), true),
        (PERIOD_US, Some(FIRST_CLOCK_MS), true),
        (2_400_000, None, false),
        (2_600_000, None, true),
    ] {
        let mut track = AttitudeHistory::new(CONFIG);
        let clock_ms =
            |step_ms: u32, elapsed_ms: u32| clock_step_ms.map_or(0, |_| FIRST_CLOCK_MS - step_ms + elapsed_ms);
        track.push_report(timestamp(1_000_000), roll_report(clock_ms(0, 0), 0.0, 0.0), None);
        for i in 0..1000_u32 {
            let at_us = 1_000_000 + silence_us + u64::from(i) * PERIOD_US;
            let sender_ms = clock_ms(clock_step_ms.unwrap_or(0), 20 * i);
            track.push_report(timestamp(at_us), roll_report(sender_ms, 0.01 * i as f32, 0.5), None);
            let is_accepted =
                matches!(track.attitude_at(timestamp(at_us - LATENCY_US + 1)), AttitudeLookup::Extrapolated(_));
            assert_eq!(is_accepted, !is_restart || i >= 750, "{silence_us} us, {clock_step_ms:?} ms: {i}");
        }
    }
}

/// Extreme rates, angles and times, including NaN.
#[test]
fn no_report_panics() {
    let mut random = testkit::random::Random(1);
    let extremes = [0.0, f32::NAN, f32::INFINITY, f32::MAX, -1e9, 1e-30];
    let mut track = AttitudeHistory::new(CONFIG);
    let mut pick = || extremes[random.bits() as usize % extremes.len()];
    for i in 0..500_u64 {
        let attitude = RollPitch { roll_rad: pick(), pitch_rad: pick() };
        let report = AttitudeReport {
            sender_clock_at_sending: WrappingMillis::new(pick().to_bits()),
            ..report(attitude, [pick(), pick(), pick()])
        };
        track.push_report(timestamp(pick().to_bits().into()), report, None);
        let _ = (track.attitude_at(timestamp(i * 1_000)), track.attitude_at(timestamp(u64::MAX)));
    }
}

/// 5.7 deg, and 57 deg/s since the last report, for rates that change; without body rates 230 deg/s, a fast roll. After
/// 0.25 s any attitude is accepted. A rejected report is replaced by extrapolation.
#[test]
fn a_report_far_from_the_predicted_attitude_is_rejected() {
    const SLOW: [f32; 3] = [MINIMAL_RATE_DEG_S, 0.0, 0.0];
    const ROLLING: [f32; 3] = [60.0, 0.0, 0.0];
    for (rates_deg_s, step_ms, to_deg, is_accepted) in [
        (SLOW, 20, 6.0, true),
        (SLOW, 20, -6.0, true),
        (SLOW, 20, 8.0, false),
        (SLOW, 20, -8.0, false),
        (SLOW, 20, 45.0, false),
        // 1.2 deg are predicted.
        (ROLLING, 20, 7.2, true),
        (ROLLING, 20, 9.2, false),
        (ROLLING, 20, -4.8, true),
        (ROLLING, 20, -6.8, false),
        (SLOW, 100, 10.0, true),
        (SLOW, 100, 13.0, false),
        // A nonzero rate about any axis shows that the source has rates.
        ([0.0, -MINIMAL_RATE_DEG_S, 0.0], 100, 20.0, false),
        ([0.0, 0.0, MINIMAL_RATE_DEG_S], 100, 20.0, false),
        ([0.0; 3], 100, 25.0, true),
        ([0.0; 3], 100, -25.0, true),
        ([0.0; 3], 100, 32.0, false),
        ([0.0; 3], 100, -32.0, false),
        (SLOW, 240, 45.0, false),
        (SLOW, 260, 45.0, true),
    ] {
        let case = format!("{rates_deg_s:?} {step_ms} ms {to_deg} deg");
        let mut track = history_of_one_report(RollPitch::default(), rates_deg_s);
        let true_us = 1_000_000 + step_ms * 1_000;
        push_report(&mut track, true_us, attitude_report(0, RollPitch::from_deg(to_deg, 0.0), rates_deg_s));
        let spike_reports = u32::from(!is_accepted);
        assert_eq!(
            track.rejected_reports(),
            RejectedReports { spike_reports, ..RejectedReports::NO_REJECTIONS },
            "{case}"
        );
        if step_ms <= 200 {
            let extrapolated_deg = rates_deg_s[0] * step_ms as f32 * 1e-3;
            let expected_deg = if is_accepted { to_deg } else { extrapolated_deg };
            assert!((roll_deg(track.attitude_at(timestamp(true_us))) - expected_deg).abs() < 1e-3, "{case}");
        }
    }
}

#[test]
fn the_fourth_distant_report_is_accepted() {
    for (rolls_deg, expected_deg, spikes) in [
        (&[0.0, 30.0, 30.1, 30.2][..], 0.0, 3),
        (&[0.0, 30.0, 30.1, 30.2, 30.3], 30.3, 3),
        (&[0.0, 30.0, 30.1, 0.1, 30.2, 30.3, 30.4], 0.1, 5),
    ] {
        let (track, true_us) = history_of_rolls(rolls_deg);
        assert!((roll_deg(track.attitude_at(timestamp(true_us))) - expected_deg).abs() < 1e-3, "{rolls_deg:?}");
        assert_eq!(track.rejected_reports().spike_reports, spikes, "{rolls_deg:?}");
    }
}

/// Plausibility state is reset, counters are not.
#[test]
fn plausibility_state_is_per_sender() {
    let (mut track, true_us) = history_of_rolls(&[10.0, 10.02, 40.0, 10.05, 10.05, 10.05, 10.05, 10.05]);
    let rejections = RejectedReports { spike_reports: 1, frozen_reports: 1, ..RejectedReports::NO_REJECTIONS };
    assert_eq!(track.rejected_reports(), rejections);
    let other = AttitudeReport { sender: SenderId::new(7), ..roll_report(0, 50.0, 0.0) };
    push_report(&mut track, true_us + PERIOD_US, other);
    assert!((roll_deg(track.attitude_at(timestamp(true_us + PERIOD_US))) - 50.0).abs() < 1e-3);
    assert_eq!(track.rejected_reports(), rejections);
}

#[test]
fn integration_continues_over_a_short_gap_of_one_sender() {
    for (gap_us, sender, is_continued) in [(500_000, 0, true), (500_001, 0, false), (PERIOD_US, 7, false)] {
        let mut track = history_of_one_report(RollPitch::default(), [0.0, 0.0, 10.0]);
        let run_number = |track: &AttitudeHistory, us: u64| track.gyro_heading_at(timestamp(us)).unwrap().run_number;
        let first_run = run_number(&track, 1_000_000);
        let report = attitude_report(0, RollPitch::default(), [0.0, 0.0, 10.0]);
        push_report(&mut track, 1_000_000 + gap_us, AttitudeReport { sender: SenderId::new(sender), ..report });
        let is_same_run = run_number(&track, 1_000_000 + gap_us) == first_run;
        assert_eq!(is_same_run, is_continued, "{gap_us} us, sender {sender}");
    }
}

#[test]
fn contradicting_rates_are_dropped() {
    let phase = |i: u16| 0.02 * f32::from(i);
    let report = |i: u16| roll_report(20 * u32::from(i), 10.0 * phase(i).sin(), -10.0 * phase(i).cos());
    let track = history_of_reports((0..500).map(report));
    let now = timestamp(true_us(499));
    assert!((roll_deg(track.attitude_at(now)) - 10.0 * phase(499).sin()).abs() < 1e-3);
    assert_eq!((track.gyro_heading_at(now), track.newest_body_rates()), (None, None));
    let RejectedReports { rate_contradictions, spike_reports, .. } = track.rejected_reports();
    assert!(rate_contradictions > 300 && spike_reports == 0, "{rate_contradictions} {spike_reports}");
}

/// Swings of 20 deg with a constant field. With trusted rates the source is aligning; with rates already found wrong
/// the attitude is used.
#[test]
fn an_aligning_source_is_rejected() {
    for (rate_factor, is_rejected) in [(1.0, true), (-1.0, false)] {
        let mut track = AttitudeHistory::new(CONFIG);
        let mut found = Vec::new();
        for i in 0..1500_u16 {
            let t_s = f32::from(i) * 0.02;
            let now_us = 1_000_000 + u64::from(i) * PERIOD_US;
            // The aircraft oscillates for 15 s; afterwards only the reports oscillate.
            let is_flown = t_s < 15.0;
            let angle = if is_flown { (10.0 * t_s.sin()).to_radians() } else { 0.0 };
            track.update_raw_field(Field::from_ut(20.0, 43.0 * angle.sin(), 43.0 * angle.cos()));
            let (roll_deg, p_deg_s) =
                if is_flown { (10.0 * t_s.sin(), rate_factor * 10.0 * t_s.cos()) } else { (20.0 * t_s.sin(), 0.01) };
            push_report(&mut track, now_us, roll_report(20 * u32::from(i), roll_deg, p_deg_s));
            if t_s > 20.0 {
                found.push(track.attitude_at(timestamp(now_us + 1)));
            }
        }
        assert!(found.iter().all(|lookup| (*lookup == AttitudeLookup::Contradicted) == is_rejected), "{rate_factor}");
    }
}

/// Estimate of the own sensors: at this roll and body rate about x, and a heading in its frame, degrees and deg/s.
fn own_estimate(roll_deg: f32, p_deg_s: f32, frame_heading_deg: f32) -> InertialAttitude {
    InertialAttitude {
        attitude: RollPitch::from_deg(roll_deg, 0.0),
        rates_rad_s: [p_deg_s.to_radians(), 0.0, 0.0].into(),
        measured_rates_rad_s: Some([p_deg_s.to_radians(), 0.0, 0.0].into()),
        rest_offset_variance: 0.0,
        frame_heading_rad: frame_heading_deg.to_radians(),
        start_count: 0,
        tilt_covariance: Matrix2::identity(),
        is_accurate: true,
    }
}

/// Track of a source with own estimates every 20 ms from 20 s on, with 5 deg/s of roll and turns of 3 deg each, and reports of the
/// same instants of an autopilot with this roll and rate.
fn track_of_both(source: AttitudeSource, autopilot_deg: Option<[f32; 2]>) -> (AttitudeTrack, Timestamp) {
    let mut track = AttitudeTrack::new(CONFIG);
    track.set_source(source);
    let sampled_at = |i: u16| timestamp(20_000_000 + u64::from(i) * PERIOD_US);
    for i in 0..50 {
        track.push_inertial_attitude(sampled_at(i), &own_estimate(20.0, 5.0, 3.0 * f32::from(i)));
        if let Some([roll_deg, p_deg_s]) = autopilot_deg {
            let report = roll_report(0, roll_deg + 0.01 * f32::from(i % 2), p_deg_s);
            let is_used = track.push_report(sampled_at(i).plus_us(LATENCY_US), report);
            assert_eq!(is_used, source != AttitudeSource::Own);
        }
    }
    (track, sampled_at(49))
}

/// The source decides on roll and pitch. The known rate is that of the own gyro, unless the autopilot's contradict it; the turn of the
/// autopilot's attitude is that of its body rates, that of the own attitude the own. An attitude that stays is carried on by the own
/// rate, 1.4 deg in the time constant of 0.3 s.
#[test]
fn attitude_and_rates_are_those_of_the_source() {
    for (source, autopilot_deg, expected_deg, turned_deg) in [
        (AttitudeSource::Autopilot, Some([10.0, -7.0]), Some([10.0, 7.0_f32]), 0.0_f32),
        (AttitudeSource::Automatic, Some([10.0, 5.5]), Some([11.4, 5.0]), 0.0),
        (AttitudeSource::Automatic, Some([10.0, 8.0]), Some([10.0, 8.0]), 0.0),
        (AttitudeSource::Automatic, None, Some([20.0, 5.0]), 3.0),
        (AttitudeSource::Own, Some([10.0, -7.0]), Some([20.0, 5.0]), 3.0),
        (AttitudeSource::Autopilot, None, None, 0.0),
    ] {
        let case = format!("{source:?} {autopilot_deg:?}");
        let (track, newest_at) = track_of_both(source, autopilot_deg);
        let lookup = track.attitude_at(newest_at, 0);
        let Some([expected_roll_deg, expected_deg_s]) = expected_deg else {
            assert_eq!(lookup, AttitudeLookup::Stale, "{case}");
            continue;
        };
        assert!((roll_deg(lookup) - expected_roll_deg).abs() < 0.1, "{case}: {lookup:?}");
        let rate_deg_s = track.body_rate_rad_s(newest_at).unwrap().to_degrees();
        assert!((rate_deg_s - expected_deg_s).abs() < 0.01, "{case}: {rate_deg_s}");
        let [before, after] =
            [timestamp(newest_at.as_us() - PERIOD_US), newest_at].map(|at| track.gyro_heading_at(at, 0).unwrap());
        let change_deg = wrap_pi(after.relative_heading_rad - before.relative_heading_rad).to_degrees();
        assert!((change_deg - turned_deg).abs() < 0.01, "{case}: {change_deg}");
    }
}

/// An autopilot boots for up to 15 s; one that has reported is not replaced when it falls silent.
#[test]
fn the_own_attitude_is_used_alone_only_without_an_autopilot() {
    for (at_us, autopilot_reports, is_used) in
        [(14_000_000, false, false), (16_000_000, false, true), (16_000_000, true, false)]
    {
        let mut track = AttitudeTrack::new(CONFIG);
        track.set_source(AttitudeSource::Automatic);
        if autopilot_reports {
            assert!(track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 1.0)));
        }
        track.push_inertial_attitude(timestamp(at_us), &own_estimate(20.0, 0.0, 0.0));
        let lookup = track.attitude_at(timestamp(at_us), 0);
        assert_eq!(lookup != AttitudeLookup::Stale, is_used, "{at_us} {autopilot_reports}: {lookup:?}");
        assert_eq!(track.own_tilt_covariance().is_some(), is_used);
    }
}

/// Another autopilot has another alignment, here by 8 deg. Of the same one this is a contradiction.
#[test]
fn the_alignment_of_the_verticals_is_that_of_one_autopilot() {
    for (second_sender, is_contradicted) in [(1, true), (2, false)] {
        let mut track = AttitudeTrack::new(CONFIG);
        track.set_source(AttitudeSource::Automatic);
        for i in 0..1100_u16 {
            let (sender, roll_deg) = if i < 1000 { (1, 16.0) } else { (second_sender, 24.0) };
            let at = timestamp(20_000_000 + u64::from(i) * PERIOD_US);
            let tilt_covariance = Matrix2::identity() * 1e-4;
            track.push_inertial_attitude(at, &InertialAttitude { tilt_covariance, ..own_estimate(20.0, 0.0, 0.0) });
            let report = roll_report(0, roll_deg + 0.01 * f32::from(i % 2), 0.0);
            track.push_report(at.plus_us(LATENCY_US), AttitudeReport { sender: SenderId::new(sender), ..report });
        }
        assert_eq!(track.excess_tilt_variance().is_some(), is_contradicted, "{second_sender}");
    }
}

use super::*;
use crate::time::WrappingMillis;

const CONFIG: AttitudeConfig = AttitudeConfig::DEFAULT;
const LATENCY_US: u64 = CONFIG.latency_us.unsigned_abs() as u64;
const PERIOD_US: u64 = 20_000;

fn timestamp(us: u64) -> Timestamp {
    Timestamp::from_us(us)
}

fn roll_report(sender_ms: u32, roll_deg: f32, p_deg_s: f32) -> AttitudeReport {
    attitude_report(sender_ms, Attitude::from_deg(roll_deg, 0.0), [p_deg_s, 0.0, 0.0])
}

fn attitude_report(sender_ms: u32, attitude: Attitude, rates_deg_s: [f32; 3]) -> AttitudeReport {
    let body_rates = BodyRates::from_rad_s(rates_deg_s.map(f32::to_radians));
    AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::new(sender_ms),
        attitude,
        body_rates,
    }
}

fn history_of_one_report(attitude: Attitude, rates_deg_s: [f32; 3]) -> AttitudeHistory {
    let mut track = AttitudeHistory::new(CONFIG);
    track.push_report(timestamp(1_000_000 + LATENCY_US), attitude_report(0, attitude, rates_deg_s));
    track
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
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..8_u32 {
        let true_us = 1_000_000 + u64::from(i) * PERIOD_US;
        track.push_report(timestamp(true_us + LATENCY_US), roll_report(500 + i * 20, 0.2 * i as f32, 10.0));
    }
    let lookup = track.attitude_at(timestamp(1_050_000));
    assert!(matches!(lookup, AttitudeLookup::Interpolated(_)));
    assert!((roll_deg(lookup) - 0.5).abs() < 1e-3);
    let lookup = track.attitude_at(timestamp(1_180_000));
    assert!(matches!(lookup, AttitudeLookup::Extrapolated(_)));
    assert!((roll_deg(lookup) - 1.8).abs() < 1e-3);
    assert_eq!(track.attitude_at(timestamp(1_400_000)), AttitudeLookup::Stale);
    assert_eq!(track.attitude_at(timestamp(900_000)), AttitudeLookup::Missing);
}

#[test]
fn both_angles_are_interpolated() {
    let mut track = AttitudeHistory::new(CONFIG);
    for (i, (roll_deg, pitch_deg)) in [(10.0, -4.0), (12.0, 0.0)].into_iter().enumerate() {
        let report = attitude_report(0, Attitude::from_deg(roll_deg, pitch_deg), [0.0; 3]);
        track.push_report(timestamp(1_000_000 + i as u64 * PERIOD_US + LATENCY_US), report);
    }
    let [roll, pitch] = angles_deg(track.attitude_at(timestamp(1_000_000 + PERIOD_US / 4)));
    assert!((roll - 10.5).abs() < 1e-4 && (pitch + 3.0).abs() < 1e-4, "{roll} {pitch}");
}

/// A recording may hold attitude and field at the same instants only.
#[test]
fn a_lookup_at_the_time_of_a_report_needs_no_second_report() {
    let mut track = history_of_one_report(Attitude::from_deg(12.0, -3.0), [0.0; 3]);
    assert!(matches!(track.attitude_at(timestamp(1_000_000)), AttitudeLookup::Interpolated(_)));
    track.push_report(timestamp(3_000_000 + LATENCY_US), roll_report(0, 50.0, 0.0));
    let [roll, pitch] = angles_deg(track.attitude_at(timestamp(1_000_000)));
    assert!((roll - 12.0).abs() < 1e-4 && (pitch + 3.0).abs() < 1e-4, "{roll} {pitch}");
    assert_eq!(track.attitude_at(timestamp(1_000_001)), AttitudeLookup::Missing);
}

/// Level: p rolls right, q pitches up, r affects neither. At 90 deg of bank, r pitches down; at 45 deg of pitch, phi' =
/// tan 45 deg r.
#[test]
fn extrapolation_uses_body_rates_with_their_signs() {
    let after_tenth = |roll_deg: f32, pitch_deg: f32, rates_deg_s: [f32; 3]| {
        angles_deg(
            history_of_one_report(Attitude::from_deg(roll_deg, pitch_deg), rates_deg_s)
                .attitude_at(timestamp(1_100_000)),
        )
    };
    for (roll_deg, pitch_deg, rates_deg_s, [roll_to, pitch_to]) in [
        (0.0, 0.0, [30.0, 0.0, 0.0], [3.0, 0.0]),
        (0.0, 0.0, [-30.0, 0.0, 0.0], [-3.0, 0.0]),
        (0.0, 0.0, [0.0, 20.0, 0.0], [0.0, 2.0]),
        (0.0, 0.0, [0.0, 0.0, 20.0], [0.0, 0.0]),
        (90.0, 0.0, [0.0, 0.0, 20.0], [90.0, -2.0]),
        (90.0, 45.0, [0.0, 20.0, 0.0], [92.0, 45.0]),
        (0.0, 45.0, [0.0, 0.0, 20.0], [2.0, 45.0]),
        (60.0, 0.0, [0.0, 20.0, 0.0], [60.0, 1.0]),
        // phi' = tan 45 deg (q sin 60 + r cos 60), theta' = q cos 60 - r sin 60.
        (60.0, 45.0, [0.0, 20.0, 0.0], [61.732, 46.0]),
        (60.0, 45.0, [0.0, 0.0, 20.0], [61.0, 43.268]),
        // At steep pitch the tangent is limited to 5.
        (0.0, 88.0, [0.0, 0.0, 10.0], [5.0, 88.0]),
        (0.0, -88.0, [0.0, 0.0, 10.0], [-5.0, -88.0]),
        // Wraps at 180 deg of roll; pitch stops at the vertical.
        (179.0, 0.0, [20.0, 0.0, 0.0], [-179.0, 0.0]),
        (0.0, 89.5, [0.0, 20.0, 0.0], [0.0, 90.0]),
        (0.0, -89.5, [0.0, -20.0, 0.0], [0.0, -90.0]),
    ] {
        let [roll, pitch] = after_tenth(roll_deg, pitch_deg, rates_deg_s);
        let case = format!("from {roll_deg} {pitch_deg} at {rates_deg_s:?}: {roll} {pitch}");
        assert!((roll - roll_to).abs() < 1e-3 && (pitch - pitch_to).abs() < 1e-3, "{case}");
    }
}

/// The limit of extrapolation is 200 ms.
#[test]
fn extrapolation_is_limited() {
    let track = history_of_one_report(Attitude::default(), [10.0, 0.0, 0.0]);
    assert!((roll_deg(track.attitude_at(timestamp(1_200_000))) - 2.0).abs() < 1e-3);
    assert_eq!(track.attitude_at(timestamp(1_200_001)), AttitudeLookup::Stale);
    assert_eq!(AttitudeHistory::new(CONFIG).attitude_at(timestamp(0)), AttitudeLookup::Stale);
}

/// The limit of interpolation is 250 ms.
#[test]
fn a_long_gap_is_not_interpolated() {
    for (gap_us, is_interpolated) in [(250_000, true), (250_001, false)] {
        let mut track = history_of_one_report(Attitude::from_deg(10.0, 0.0), [0.0; 3]);
        track.push_report(timestamp(1_000_000 + gap_us + LATENCY_US), roll_report(0, 20.0, 0.0));
        match track.attitude_at(timestamp(1_100_000)) {
            AttitudeLookup::Interpolated(_) => assert!(is_interpolated, "{gap_us} us"),
            lookup => assert!(!is_interpolated && lookup == AttitudeLookup::Missing, "{gap_us} us: {lookup:?}"),
        }
    }
}

#[test]
fn the_oldest_report_is_dropped() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..9_u32 {
        track.push_report(timestamp(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), roll_report(0, i as f32, 0.0));
    }
    assert_eq!(track.attitude_at(timestamp(1_010_000)), AttitudeLookup::Missing);
    assert!((roll_deg(track.attitude_at(timestamp(1_030_000))) - 1.5).abs() < 1e-3);
}

#[test]
fn a_report_that_is_not_newer_changes_nothing() {
    let mut track = history_of_one_report(Attitude::from_deg(10.0, 0.0), [0.0; 3]);
    for arrival_us in [1_000_000, 990_000, 0] {
        track.push_report(timestamp(arrival_us + LATENCY_US), roll_report(0, 50.0, 0.0));
    }
    assert!((roll_deg(track.attitude_at(timestamp(1_000_000))) - 10.0).abs() < 1e-3);
    assert_eq!(track.attitude_at(timestamp(999_999)), AttitudeLookup::Missing);
}

#[test]
fn jitter_of_arrival_times_is_removed() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..200_u32 {
        let jitter_us = u64::from(i * 7919 % 15) * 1000;
        let sent_us = 1_000_000 + u64::from(i) * PERIOD_US;
        track.push_report(timestamp(sent_us + jitter_us), roll_report(i * 20, i as f32 * 0.2, 0.0));
    }
    // At 10 deg/s a stamp error of 0.3 ms is 0.003 deg; arrival times would give up to 0.15 deg.
    let lookup_time = timestamp(1_000_000 + 197 * PERIOD_US - LATENCY_US);
    assert!((roll_deg(track.attitude_at(lookup_time)) - 197.0 * 0.2).abs() < 0.003);
}

/// 400 ppm are 8 us per report. A constant clock offset would be 16 ms wrong after 2000 reports.
#[test]
fn a_drifting_clock_is_followed() {
    for (ppm, name) in [(400_i64, "slow"), (-400, "fast")] {
        let mut track = AttitudeHistory::new(CONFIG);
        let mut sent_us = 0;
        for i in 0..2000_i64 {
            sent_us = 1_000_000 + i * 20_000 + i * 20_000 * ppm / 1_000_000;
            track.push_report(timestamp(sent_us as u64), roll_report(i as u32 * 20, i as f32 * 0.01, 0.0));
        }
        // The roll grows by 0.01 deg per 20 ms: a clock error of 1 ms is 0.0005 deg.
        let found = roll_deg(track.attitude_at(timestamp(sent_us as u64 - 10_000 - LATENCY_US)));
        assert!((found - 19.985).abs() < 0.0006, "{name}: {found}");
    }
}

/// A sender clock that deviates by more than 100 ms is ignored.
#[test]
fn a_distant_sender_clock_is_ignored() {
    for (delay_us, by_clock) in [(100_000, true), (100_001, false)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 0.0));
        track.push_report(timestamp(1_020_000 + delay_us), roll_report(20, 0.0, 0.0));
        // An instant just after the clock's stamp is extrapolated only if that stamp was used.
        let lookup = track.attitude_at(timestamp(1_020_011 - LATENCY_US));
        assert_eq!(matches!(lookup, AttitudeLookup::Extrapolated(_)), by_clock, "{delay_us} us: {lookup:?}");
    }
}

#[test]
fn a_sender_without_clock_is_stamped_by_arrival() {
    let mut track = AttitudeHistory::new(CONFIG);
    for (i, sender_ms) in [0; 5].into_iter().enumerate() {
        track.push_report(timestamp(2_000_000 + i as u64 * PERIOD_US), roll_report(sender_ms, i as f32, 0.0));
    }
    let newest = timestamp(2_080_000 - LATENCY_US);
    assert!((roll_deg(track.attitude_at(newest)) - 4.0).abs() < 1e-3);
}

/// After a restart the source's filter aligns for 15 s. A report out of order is no restart.
#[test]
fn the_attitude_of_a_restarted_sender_is_rejected_at_first() {
    for (step_ms, is_restart) in [(999, false), (1_000, true), (900_000, true)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(900_020, 0.0, 0.0));
        for i in 1..=1000_u32 {
            let at_us = 1_000_000 + u64::from(i) * PERIOD_US;
            track.push_report(timestamp(at_us), roll_report(900_000 - step_ms + 20 * i, 0.01 * i as f32, 0.5));
            let is_accepted =
                matches!(track.attitude_at(timestamp(at_us - LATENCY_US + 1)), AttitudeLookup::Extrapolated(_));
            assert_eq!(is_accepted, !is_restart || i > 750, "{step_ms} ms, {i}");
        }
    }
}

/// MSP has no clock: silence of 2.5 s is a restart.
#[test]
fn a_sender_without_clock_has_restarted_after_silence() {
    for (silence_us, is_restart) in [(2_500_000, false), (2_500_001, true)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 0.0));
        for i in 0..=1000_u32 {
            let at_us = 1_000_000 + silence_us + u64::from(i) * PERIOD_US;
            track.push_report(timestamp(at_us), roll_report(0, 0.01 * i as f32, 0.5));
            let is_accepted =
                matches!(track.attitude_at(timestamp(at_us - LATENCY_US + 1)), AttitudeLookup::Extrapolated(_));
            assert_eq!(is_accepted, !is_restart || i >= 750, "{silence_us} us, {i}");
        }
    }
}

#[test]
fn a_sender_s_clock_may_wrap() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..40_u32 {
        let jitter_us = if i == 30 { 15_000 } else { 0 };
        let sent_us = 1_000_000 + u64::from(i) * PERIOD_US + jitter_us;
        track.push_report(
            timestamp(sent_us),
            roll_report((i * 20).wrapping_sub(400), if i < 31 { i as f32 } else { 99.0 }, 0.0),
        );
        if i == 30 {
            break;
        }
    }
    // Stamped by arrival, the last report would be 15 ms late, and the lookup would return the previous one.
    assert!((roll_deg(track.attitude_at(timestamp(1_000_000 + 30 * PERIOD_US - LATENCY_US))) - 30.0).abs() < 0.01);
}

#[test]
fn roll_is_interpolated_the_short_way_round() {
    let mut track = AttitudeHistory::new(CONFIG);
    track.push_report(timestamp(1_020_000), roll_report(0, 179.0, 0.0));
    track.push_report(timestamp(1_040_000), roll_report(20, -179.0, 0.0));
    assert!((roll_deg(track.attitude_at(timestamp(1_010_000))).abs() - 180.0).abs() < 1e-3);
}

/// Extreme rates, angles and times, including NaN.
#[test]
fn no_report_panics() {
    let mut random = testkit::random::Random(1);
    let extremes = [0.0, f32::NAN, f32::INFINITY, f32::MAX, -1e9, 1e-30];
    let mut track = AttitudeHistory::new(CONFIG);
    let mut pick = || extremes[random.bits() as usize % extremes.len()];
    for i in 0..500_u64 {
        let attitude = Attitude { roll_rad: pick(), pitch_rad: pick() };
        let rates_rad_s = [pick(), pick(), pick()];
        let sender_clock_at_sending = WrappingMillis::new(pick().to_bits());
        track.push_report(
            timestamp(pick().to_bits().into()),
            AttitudeReport {
                sender: SenderId::default(),
                sender_clock_at_sending,
                attitude,
                body_rates: BodyRates::from_rad_s(rates_rad_s),
            },
        );
        let _ = (track.attitude_at(timestamp(i * 1_000)), track.attitude_at(timestamp(u64::MAX)));
    }
}

/// Minimal nonzero rate, deg/s: marks a source with body rates.
const MINIMAL_RATE_DEG_S: f32 = 1e-3;

/// 50 Hz reports without a roll rate, and the time at which the last attitude was measured, microseconds.
fn history_of_rolls(rolls_deg: &[f32]) -> (AttitudeHistory, u64) {
    let mut track = AttitudeHistory::new(CONFIG);
    let mut true_us = 1_000_000;
    for &roll_deg in rolls_deg {
        true_us += PERIOD_US;
        track.push_report(timestamp(true_us + LATENCY_US), roll_report(0, roll_deg, MINIMAL_RATE_DEG_S));
    }
    (track, true_us)
}

/// Limit: 0.1 rad of margin + 1 rad/s over 20 ms = 6.9 deg. A rejected report is replaced by extrapolation.
#[test]
fn a_distant_report_is_rejected() {
    for (spike_deg, is_accepted) in [(6.7, true), (7.1, false), (-6.7, true), (-7.1, false), (45.0, false)] {
        let (track, true_us) = history_of_rolls(&[0.0, 0.0, spike_deg]);
        let found_deg = roll_deg(track.attitude_at(timestamp(true_us)));
        let expected_deg = if is_accepted { spike_deg } else { 0.0 };
        assert!((found_deg - expected_deg).abs() < 1e-3, "{spike_deg}: {found_deg}");
        assert_eq!(
            track.rejected_reports(),
            RejectedReports { spike_reports: u32::from(!is_accepted), ..RejectedReports::NO_REJECTIONS }
        );
    }
}

/// At 60 deg/s 1.2 deg are predicted in 20 ms; deviations of up to 6.9 deg are accepted.
#[test]
fn motion_predicted_by_rates_is_no_spike() {
    for (to_deg, is_accepted) in [(1.2 + 6.7, true), (1.2 + 7.1, false), (1.2 - 6.7, true), (1.2 - 7.1, false)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 60.0));
        track.push_report(timestamp(1_000_000 + PERIOD_US), roll_report(0, to_deg, 60.0));
        assert_eq!(track.rejected_reports().spike_reports, u32::from(!is_accepted), "{to_deg}");
    }
}

#[test]
fn the_fourth_distant_report_is_accepted() {
    let (track, true_us) = history_of_rolls(&[0.0, 30.0, 30.1, 30.2]);
    assert!(
        roll_deg(track.attitude_at(timestamp(true_us))).abs() < 1e-3 && track.rejected_reports().spike_reports == 3
    );
    let (track, true_us) = history_of_rolls(&[0.0, 30.0, 30.1, 30.2, 30.3]);
    assert!((roll_deg(track.attitude_at(timestamp(true_us))) - 30.3).abs() < 1e-3);
    assert_eq!(track.rejected_reports().spike_reports, 3);
    let (track, _) = history_of_rolls(&[0.0, 30.0, 30.1, 0.1, 30.2, 30.3, 30.4]);
    assert_eq!(track.rejected_reports().spike_reports, 5);
}

/// The interpolation limit of 250 ms also limits the spike test.
#[test]
fn after_a_gap_any_attitude_is_accepted() {
    for (gap_us, spikes) in [(249_000, 1), (251_000, 0)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, MINIMAL_RATE_DEG_S));
        track.push_report(timestamp(1_000_000 + gap_us), roll_report(0, 45.0, MINIMAL_RATE_DEG_S));
        assert_eq!(track.rejected_reports().spike_reports, spikes, "{gap_us}");
    }
}

#[test]
fn roll_at_a_vertical_nose_is_no_spike() {
    let mut track = history_of_one_report(Attitude::from_deg(0.0, 89.0), [0.0; 3]);
    track.push_report(timestamp(1_020_000 + LATENCY_US), attitude_report(0, Attitude::from_deg(180.0, 89.0), [0.0; 3]));
    assert_eq!(track.rejected_reports().spike_reports, 0);
    let mut track = history_of_one_report(Attitude::from_deg(0.0, 0.0), [MINIMAL_RATE_DEG_S; 3]);
    track.push_report(
        timestamp(1_020_000 + LATENCY_US),
        attitude_report(0, Attitude::from_deg(0.0, 8.0), [MINIMAL_RATE_DEG_S; 3]),
    );
    assert_eq!(track.rejected_reports().spike_reports, 1, "pitch counts as well");
}

#[test]
fn the_body_rate_is_that_of_the_newest_report() {
    assert_eq!(AttitudeHistory::new(CONFIG).body_rate_rad_s(), None);
    let track = history_of_one_report(Attitude::default(), [30.0, -40.0, 0.0]);
    assert!((track.body_rate_rad_s().unwrap() - 50_f32.to_radians()).abs() < 1e-5);
    // All-zero rates mean that the source sends none.
    assert_eq!(history_of_one_report(Attitude::default(), [0.0; 3]).body_rate_rad_s(), None);
    // The limit of body rates is 36 rad/s, 2063 deg/s.
    for (rate_deg_s, reads) in [(2060.0, true), (-2060.0, true), (2066.0, false), (-2066.0, false), (f32::MAX, false)] {
        assert_eq!(
            history_of_one_report(Attitude::default(), [0.1, 0.0, rate_deg_s]).body_rate_rad_s().is_some(),
            reads,
            "{rate_deg_s}"
        );
    }
}

#[test]
fn the_fifth_equal_attitude_of_a_fine_source_is_frozen() {
    let rolls_deg = [10.0, 10.02, 10.05, 10.05, 10.05, 10.05];
    let (track, true_us) = history_of_rolls(&rolls_deg);
    assert_ne!(track.attitude_at(timestamp(true_us + 1)), AttitudeLookup::Frozen, "four are equal");
    let (mut track, true_us) = history_of_rolls(&[&rolls_deg[..], &[10.05]].concat());
    assert_eq!(track.attitude_at(timestamp(true_us + 1)), AttitudeLookup::Frozen);
    assert_eq!(track.rejected_reports(), RejectedReports { frozen_reports: 1, ..RejectedReports::NO_REJECTIONS });
    // `Frozen` holds for the extrapolation limit after the last report.
    assert_eq!(track.attitude_at(timestamp(true_us + 200_000)), AttitudeLookup::Frozen);
    assert_eq!(track.attitude_at(timestamp(true_us + 200_001)), AttitudeLookup::Stale);
    // Earlier attitudes remain valid.
    assert!(matches!(track.attitude_at(timestamp(true_us - 50_000)), AttitudeLookup::Interpolated(_)));
    // A new value ends the freeze.
    track.push_report(timestamp(true_us + PERIOD_US + LATENCY_US), roll_report(0, 10.07, 0.0));
    assert!(matches!(track.attitude_at(timestamp(true_us + PERIOD_US + 1)), AttitudeLookup::Extrapolated(_)));
}

/// The second sender's clock is 50 ms behind, which the first one's clock offset would treat as a delayed report.
#[test]
fn a_new_sender_resets_the_history() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..4_u32 {
        track.push_report(
            timestamp(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US),
            roll_report(500 + i * 20, 10.0, 0.0),
        );
    }
    let other = AttitudeReport { sender: SenderId::new(7), ..roll_report(500 + 4 * 20 - 50, 30.0, 0.0) };
    track.push_report(timestamp(1_080_000 + LATENCY_US), other);
    assert!(matches!(track.attitude_at(timestamp(1_080_000)), AttitudeLookup::Interpolated(_)));
    assert!((roll_deg(track.attitude_at(timestamp(1_080_000))) - 30.0).abs() < 1e-3);
    for before in [1_079_999, 1_060_000, 1_030_000] {
        assert_eq!(track.attitude_at(timestamp(before)), AttitudeLookup::Missing, "{before}");
    }
    track.push_report(
        timestamp(1_100_000 + LATENCY_US),
        AttitudeReport { sender_clock_at_sending: WrappingMillis::new(500 + 5 * 20 - 50), ..other },
    );
    assert!(matches!(track.attitude_at(timestamp(1_090_000)), AttitudeLookup::Interpolated(_)));
    // A change back to the first sender resets the history again, even for an older report.
    track.push_report(timestamp(1_090_000 + LATENCY_US), roll_report(0, 10.0, 0.0));
    assert!((roll_deg(track.attitude_at(timestamp(1_090_000))) - 10.0).abs() < 1e-3);
}

/// Plausibility state is reset, counters are not.
#[test]
fn plausibility_state_is_per_sender() {
    let (mut track, true_us) = history_of_rolls(&[10.0, 10.02, 40.0, 10.05, 10.05, 10.05, 10.05, 10.05]);
    assert_eq!(
        track.rejected_reports(),
        RejectedReports { spike_reports: 1, frozen_reports: 1, ..RejectedReports::NO_REJECTIONS }
    );
    let other = AttitudeReport { sender: SenderId::new(7), ..roll_report(0, 50.0, 0.0) };
    track.push_report(timestamp(true_us + PERIOD_US + LATENCY_US), other);
    assert!((roll_deg(track.attitude_at(timestamp(true_us + PERIOD_US))) - 50.0).abs() < 1e-3);
    assert_eq!(
        track.rejected_reports(),
        RejectedReports { spike_reports: 1, frozen_reports: 1, ..RejectedReports::NO_REJECTIONS }
    );
}

/// Limit: 0.1 rad of margin + 4 rad/s over 100 ms = 28.6 deg.
#[test]
fn without_rates_a_fast_roll_is_no_spike() {
    for (to_deg, is_accepted) in [(28.0, true), (29.2, false), (-28.0, true), (-29.2, false)] {
        let mut track = AttitudeHistory::new(CONFIG);
        track.push_report(timestamp(1_000_000), roll_report(0, 0.0, 0.0));
        track.push_report(timestamp(1_100_000), roll_report(0, to_deg, 0.0));
        assert_eq!(track.rejected_reports().spike_reports, u32::from(!is_accepted), "{to_deg}");
    }
    // A nonzero rate about any axis shows that the source has rates, so that its roll rate of zero is valid.
    for rates_deg_s in [[MINIMAL_RATE_DEG_S, 0.0, 0.0], [0.0, -MINIMAL_RATE_DEG_S, 0.0], [0.0, 0.0, MINIMAL_RATE_DEG_S]]
    {
        let mut track = history_of_one_report(Attitude::default(), rates_deg_s);
        track.push_report(timestamp(1_100_000 + LATENCY_US), roll_report(0, 20.0, MINIMAL_RATE_DEG_S));
        assert_eq!(track.rejected_reports().spike_reports, 1, "{rates_deg_s:?}");
    }
}

/// The field is older than the attitude, for example filtered.
#[test]
fn a_negative_latency_selects_earlier_reports() {
    for (latency_us, expected_deg) in [(-30_000, 0.5), (30_000, 1.1)] {
        let mut track = AttitudeHistory::new(AttitudeConfig { latency_us, ..CONFIG });
        for i in 0..8_u32 {
            track.push_report(
                timestamp(1_000_000 + u64::from(i) * PERIOD_US),
                roll_report(500 + i * 20, 0.2 * i as f32, 10.0),
            );
        }
        assert!((roll_deg(track.attitude_at(timestamp(1_080_000))) - expected_deg).abs() < 1e-3, "{latency_us}");
    }
}

/// Yaw rate increasing by 10 deg/s per report: linear in between, constant after the newest.
#[test]
fn the_gyro_heading_covers_the_range_of_the_attitude() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..3_u32 {
        let report = attitude_report(500 + 20 * i, Attitude::default(), [0.0, 0.0, 10.0 * (i + 1) as f32]);
        track.push_report(timestamp(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), report);
    }
    let turning = |us: u64| track.gyro_heading_at(timestamp(us)).unwrap();
    let from = turning(1_000_000);
    for (us, turned_deg, rate_deg_s) in
        [(1_010_000, 0.125, 15.0), (1_020_000, 0.3, 20.0), (1_040_000, 0.8, 30.0), (1_140_000, 3.8, 30.0)]
    {
        let found = turning(us);
        assert!(
            ((found.relative_heading_rad - from.relative_heading_rad).to_degrees() - turned_deg).abs() < 1e-3,
            "{us}: {found:?}"
        );
        assert!((found.euler_rates.heading_rad_s.to_degrees() - rate_deg_s).abs() < 1e-3, "{us}: {found:?}");
        assert_eq!(found.run_number, from.run_number);
    }
    assert_eq!(track.gyro_heading_at(timestamp(1_240_001)), None);
    assert_eq!(track.gyro_heading_at(timestamp(999_999)), None);
    assert_eq!(history_of_one_report(Attitude::default(), [0.0; 3]).gyro_heading_at(timestamp(1_000_000)), None);
}

#[test]
fn integration_continues_over_a_short_gap() {
    for (gap_us, is_continued) in [(500_000, true), (500_001, false)] {
        let mut track = history_of_one_report(Attitude::default(), [0.0, 0.0, 10.0]);
        let run = track.gyro_heading_at(timestamp(1_000_000)).unwrap().run_number;
        track.push_report(
            timestamp(1_000_000 + gap_us + LATENCY_US),
            attitude_report(0, Attitude::default(), [0.0, 0.0, 10.0]),
        );
        assert_eq!(
            track.gyro_heading_at(timestamp(1_000_000 + gap_us)).unwrap().run_number == run,
            is_continued,
            "{gap_us} us"
        );
    }
}

#[test]
fn a_frozen_source_has_no_gyro_heading() {
    let mut track = AttitudeHistory::new(CONFIG);
    for i in 0..20_u32 {
        // The roll changes by fine steps, then stays constant.
        let roll_deg = 0.01 * i.min(8) as f32;
        let report = attitude_report(20 * i, Attitude::from_deg(roll_deg, 0.0), [0.0, 0.0, 10.0]);
        track.push_report(timestamp(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), report);
    }
    let now = timestamp(1_000_000 + 19 * PERIOD_US);
    assert_eq!(track.attitude_at(now), AttitudeLookup::Frozen);
    assert_eq!(track.gyro_heading_at(now), None);
}

#[test]
fn contradicting_rates_are_dropped() {
    let mut track = AttitudeHistory::new(CONFIG);
    let mut now_us = 0;
    for i in 0..500_u16 {
        let t_s = f32::from(i) * 0.02;
        now_us = 1_000_000 + u64::from(i) * PERIOD_US;
        let report = roll_report(20 * u32::from(i), 10.0 * t_s.sin(), -10.0 * t_s.cos());
        track.push_report(timestamp(now_us + LATENCY_US), report);
    }
    assert!((roll_deg(track.attitude_at(timestamp(now_us))) - 10.0 * 9.98_f32.sin()).abs() < 1e-3);
    assert_eq!((track.gyro_heading_at(timestamp(now_us)), track.body_rate_rad_s()), (None, None));
    assert!(
        track.rejected_reports().rate_contradictions > 300 && track.rejected_reports().spike_reports == 0,
        "{:?}",
        track.rejected_reports()
    );
}

/// Swings of 20 deg with a constant field. With trusted rates the source is aligning; with rates already found wrong
/// the attitude is used.
#[test]
fn an_aligning_source_is_rejected() {
    for (rates_are, is_sought) in [(1.0, true), (-1.0, false)] {
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
                if is_flown { (10.0 * t_s.sin(), rates_are * 10.0 * t_s.cos()) } else { (20.0 * t_s.sin(), 0.01) };
            track.push_report(timestamp(now_us + LATENCY_US), roll_report(20 * u32::from(i), roll_deg, p_deg_s));
            if t_s > 20.0 {
                found.push(track.attitude_at(timestamp(now_us + 1)));
            }
        }
        assert!(found.iter().all(|lookup| (*lookup == AttitudeLookup::Contradicted) == is_sought), "{rates_are}");
    }
}

//! What the attitude track promises.

use super::*;

const CONFIG: Config = Config::DEFAULT;
const LATENCY_US: u64 = CONFIG.latency_us.unsigned_abs() as u64;
const PERIOD_US: u64 = 20_000;

fn at(us: u64) -> Timestamp {
    Timestamp::from_us(us)
}

fn rolling(sender_ms: u32, roll_deg: f32, p_deg_s: f32) -> Report {
    moving(sender_ms, Attitude::from_deg(roll_deg, 0.0), [p_deg_s, 0.0, 0.0])
}

fn moving(sender_ms: u32, attitude: Attitude, rates_deg_s: [f32; 3]) -> Report {
    let rates_rad_s = rates_deg_s.map(f32::to_radians);
    Report { source: Source::default(), sender_time: WrappingMillis::new(sender_ms), attitude, rates_rad_s }
}

/// A track with one report whose attitude was true at 1 s.
fn of_one(attitude: Attitude, rates_deg_s: [f32; 3]) -> Track {
    let mut track = Track::new(CONFIG);
    track.push(at(1_000_000 + LATENCY_US), moving(0, attitude, rates_deg_s));
    track
}

fn known(lookup: Lookup) -> [f32; 2] {
    match lookup {
        Lookup::Interpolated(a) | Lookup::Extrapolated(a) => [a.roll_rad, a.pitch_rad].map(f32::to_degrees),
        other => panic!("{other:?}"),
    }
}

fn roll_deg(lookup: Lookup) -> f32 {
    known(lookup)[0]
}

/// 50 Hz reports of a 10 deg/s roll: the attitude asked for is the one that was true, latency taken out.
#[test]
fn interpolates_and_extrapolates_to_the_instant() {
    let mut track = Track::new(CONFIG);
    for i in 0..8_u32 {
        let true_us = 1_000_000 + u64::from(i) * PERIOD_US;
        track.push(at(true_us + LATENCY_US), rolling(500 + i * 20, 0.2 * i as f32, 10.0));
    }
    let lookup = track.at(at(1_050_000));
    assert!(matches!(lookup, Lookup::Interpolated(_)));
    assert!((roll_deg(lookup) - 0.5).abs() < 1e-3);
    let lookup = track.at(at(1_180_000));
    assert!(matches!(lookup, Lookup::Extrapolated(_)));
    assert!((roll_deg(lookup) - 1.8).abs() < 1e-3);
    assert_eq!(track.at(at(1_400_000)), Lookup::Stale);
    assert_eq!(track.at(at(900_000)), Lookup::Missing);
}

/// A quarter of the way from one attitude to the other, in roll and in pitch.
#[test]
fn both_angles_are_interpolated() {
    let mut track = Track::new(CONFIG);
    for (i, (roll_deg, pitch_deg)) in [(10.0, -4.0), (12.0, 0.0)].into_iter().enumerate() {
        let report = moving(0, Attitude::from_deg(roll_deg, pitch_deg), [0.0; 3]);
        track.push(at(1_000_000 + i as u64 * PERIOD_US + LATENCY_US), report);
    }
    let [roll, pitch] = known(track.at(at(1_000_000 + PERIOD_US / 4)));
    assert!((roll - 10.5).abs() < 1e-4 && (pitch + 3.0).abs() < 1e-4, "{roll} {pitch}");
}

/// A recording may hold attitude and field of the same instants, and nothing between or after.
#[test]
fn the_instant_of_a_report_needs_no_other() {
    let mut track = of_one(Attitude::from_deg(12.0, -3.0), [0.0; 3]);
    assert!(matches!(track.at(at(1_000_000)), Lookup::Interpolated(_)));
    // The next comes after a gap too long to interpolate in.
    track.push(at(9_000_000 + LATENCY_US), rolling(0, 50.0, 0.0));
    let [roll, pitch] = known(track.at(at(1_000_000)));
    assert!((roll - 12.0).abs() < 1e-4 && (pitch + 3.0).abs() < 1e-4, "{roll} {pitch}");
    assert_eq!(track.at(at(1_000_001)), Lookup::Missing);
}

/// Level: p rolls to the right, q lifts the nose, r does neither. Banked 90 deg to the right the nose is moved by -r,
/// and at 45 deg nose up a yaw rate rolls: phi' = tan 45 deg r.
#[test]
fn body_rates_carry_roll_and_pitch_on_with_their_signs() {
    let after_tenth = |roll_deg: f32, pitch_deg: f32, rates_deg_s: [f32; 3]| {
        known(of_one(Attitude::from_deg(roll_deg, pitch_deg), rates_deg_s).at(at(1_100_000)))
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
        // The tangent is held at five where the nose is nearly vertical.
        (0.0, 88.0, [0.0, 0.0, 10.0], [5.0, 88.0]),
        (0.0, -88.0, [0.0, 0.0, 10.0], [-5.0, -88.0]),
        // Through 180 deg the short way, and not past the vertical.
        (179.0, 0.0, [20.0, 0.0, 0.0], [-179.0, 0.0]),
        (0.0, 89.5, [0.0, 20.0, 0.0], [0.0, 90.0]),
        (0.0, -89.5, [0.0, -20.0, 0.0], [0.0, -90.0]),
    ] {
        let [roll, pitch] = after_tenth(roll_deg, pitch_deg, rates_deg_s);
        let case = format!("from {roll_deg} {pitch_deg} at {rates_deg_s:?}: {roll} {pitch}");
        assert!((roll - roll_to).abs() < 1e-3 && (pitch - pitch_to).abs() < 1e-3, "{case}");
    }
}

/// 200 ms: a source of 10 Hz with one report lost.
#[test]
fn an_attitude_is_carried_on_so_far_and_no_further() {
    let track = of_one(Attitude::default(), [10.0, 0.0, 0.0]);
    assert!((roll_deg(track.at(at(1_200_000))) - 2.0).abs() < 1e-3);
    assert_eq!(track.at(at(1_200_001)), Lookup::Stale);
    assert_eq!(Track::new(CONFIG).at(at(0)), Lookup::Stale);
}

/// 250 ms.
#[test]
fn a_longer_gap_is_not_interpolated_over() {
    for (gap_us, bridged) in [(250_000, true), (250_001, false)] {
        let mut track = of_one(Attitude::from_deg(10.0, 0.0), [0.0; 3]);
        track.push(at(1_000_000 + gap_us + LATENCY_US), rolling(0, 20.0, 0.0));
        match track.at(at(1_100_000)) {
            Lookup::Interpolated(_) => assert!(bridged, "{gap_us} us"),
            lookup => assert!(!bridged && lookup == Lookup::Missing, "{gap_us} us: {lookup:?}"),
        }
    }
}

/// Eight are kept; what lies before them is gone.
#[test]
fn the_oldest_report_makes_room() {
    let mut track = Track::new(CONFIG);
    for i in 0..9_u32 {
        track.push(at(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), rolling(0, i as f32, 0.0));
    }
    assert_eq!(track.at(at(1_010_000)), Lookup::Missing);
    assert!((roll_deg(track.at(at(1_030_000))) - 1.5).abs() < 1e-3);
}

/// A burst of reports of the same instant, and one that was overtaken: neither may turn the track back.
#[test]
fn a_report_that_is_not_newer_changes_nothing() {
    let mut track = of_one(Attitude::from_deg(10.0, 0.0), [0.0; 3]);
    for arrival_us in [1_000_000, 990_000, 0] {
        track.push(at(arrival_us + LATENCY_US), rolling(0, 50.0, 0.0));
    }
    assert!((roll_deg(track.at(at(1_000_000))) - 10.0).abs() < 1e-3);
    assert_eq!(track.at(at(999_999)), Lookup::Missing);
}

/// Reports delayed at random by up to 15 ms on the line: stamps keep the sender's spacing to the least delay.
#[test]
fn jitter_of_the_line_is_taken_out() {
    let mut track = Track::new(CONFIG);
    for i in 0..200_u32 {
        let jitter_us = u64::from(i * 7919 % 15) * 1000;
        let sent_us = 1_000_000 + u64::from(i) * PERIOD_US;
        track.push(at(sent_us + jitter_us), rolling(i * 20, i as f32 * 0.2, 0.0));
    }
    // Roll rises by 10 deg/s: 0.3 ms of stamp error is 0.003 deg; without the clock it would be up to 0.15.
    let asked = at(1_000_000 + 197 * PERIOD_US - LATENCY_US);
    assert!((roll_deg(track.at(asked)) - 197.0 * 0.2).abs() < 0.003);
}

/// A sender whose clock runs fast by 400 ppm, 8 us a report: the stamps follow it to 1 ms for ever. Without the leak
/// they would be 16 ms behind after 2000 reports.
#[test]
fn a_drifting_clock_is_followed() {
    for (ppm, name) in [(400_i64, "slow"), (-400, "fast")] {
        let mut track = Track::new(CONFIG);
        let mut sent_us = 0;
        for i in 0..2000_i64 {
            sent_us = 1_000_000 + i * 20_000 + i * 20_000 * ppm / 1_000_000;
            track.push(at(sent_us as u64), rolling(i as u32 * 20, i as f32 * 0.01, 0.0));
        }
        // 0.01 deg a report of 20 ms: 1 ms is 0.0005 deg.
        let found = roll_deg(track.at(at(sent_us as u64 - 10_000 - LATENCY_US)));
        assert!((found - 19.985).abs() < 0.0006, "{name}: {found}");
    }
}

/// 100 ms: a report further from where its sender's clock says is stamped by its arrival, one nearer by the clock.
#[test]
fn a_clock_that_is_too_far_off_is_not_believed() {
    for (delay_us, by_clock) in [(100_000, true), (100_001, false)] {
        let mut track = Track::new(CONFIG);
        track.push(at(1_000_000), rolling(0, 0.0, 0.0));
        track.push(at(1_020_000 + delay_us), rolling(20, 0.0, 0.0));
        // Newer than the newest is carried on, so an instant just after the clock's stamp tells which it was.
        let lookup = track.at(at(1_020_011 - LATENCY_US));
        assert_eq!(matches!(lookup, Lookup::Extrapolated(_)), by_clock, "{delay_us} us: {lookup:?}");
    }
}

#[test]
fn a_sender_without_clock_or_after_reboot_is_stamped_by_arrival() {
    let mut track = Track::new(CONFIG);
    for (i, sender_ms) in [900_000, 900_020, 0, 0, 0].into_iter().enumerate() {
        track.push(at(2_000_000 + i as u64 * PERIOD_US), rolling(sender_ms, i as f32, 0.0));
    }
    let newest = at(2_080_000 - LATENCY_US);
    assert!((roll_deg(track.at(newest)) - 4.0).abs() < 1e-3);
}

/// After 49.7 days the sender's milliseconds begin again; its spacing is followed through that.
#[test]
fn a_sender_s_clock_may_wrap() {
    let mut track = Track::new(CONFIG);
    for i in 0..40_u32 {
        let jitter_us = if i == 30 { 15_000 } else { 0 };
        let sent_us = 1_000_000 + u64::from(i) * PERIOD_US + jitter_us;
        track.push(at(sent_us), rolling((i * 20).wrapping_sub(400), if i < 31 { i as f32 } else { 99.0 }, 0.0));
        if i == 30 {
            break;
        }
    }
    // Stamped by its arrival, the last would be 15 ms later and the one before it still the newest here.
    assert!((roll_deg(track.at(at(1_000_000 + 30 * PERIOD_US - LATENCY_US))) - 30.0).abs() < 0.01);
}

#[test]
fn roll_is_interpolated_the_short_way_round() {
    let mut track = Track::new(CONFIG);
    track.push(at(1_020_000), rolling(0, 179.0, 0.0));
    track.push(at(1_040_000), rolling(20, -179.0, 0.0));
    assert!((roll_deg(track.at(at(1_010_000))).abs() - 180.0).abs() < 1e-3);
}

/// Rates that are huge or not numbers, angles at every edge: some attitude or none, never a panic.
#[test]
fn no_report_panics() {
    let mut random = testkit::random::Random(1);
    let odd = [0.0, f32::NAN, f32::INFINITY, f32::MAX, -1e9, 1e-30];
    let mut track = Track::new(CONFIG);
    let mut pick = || odd[random.bits() as usize % odd.len()];
    for i in 0..500_u64 {
        let attitude = Attitude { roll_rad: pick(), pitch_rad: pick() };
        let rates_rad_s = [pick(), pick(), pick()];
        let sender_time = WrappingMillis::new(pick().to_bits());
        track.push(
            at(pick().to_bits().into()),
            Report { source: Source::default(), sender_time, attitude, rates_rad_s },
        );
        let _ = (track.at(at(i * 1_000)), track.at(at(u64::MAX)));
    }
}

/// Hardly any rate, degrees a second: of a source that gives rates.
const AT_REST: f32 = 1e-3;

/// Reports of these rolls at 50 Hz, of an aircraft that does not roll; the last was true at the time that is given.
fn reported(rolls_deg: &[f32]) -> (Track, u64) {
    let mut track = Track::new(CONFIG);
    let mut true_us = 1_000_000;
    for &roll_deg in rolls_deg {
        true_us += PERIOD_US;
        track.push(at(true_us + LATENCY_US), rolling(0, roll_deg, AT_REST));
    }
    (track, true_us)
}

/// 0.1 rad and 1 rad/s in 20 ms are 6.9 deg: what is further off is left away, and what was known is carried on.
#[test]
fn a_report_far_off_is_left_away() {
    for (spike_deg, believed) in [(6.7, true), (7.1, false), (-6.7, true), (-7.1, false), (45.0, false)] {
        let (track, true_us) = reported(&[0.0, 0.0, spike_deg]);
        let found_deg = roll_deg(track.at(at(true_us)));
        let expected_deg = if believed { spike_deg } else { 0.0 };
        assert!((found_deg - expected_deg).abs() < 1e-3, "{spike_deg}: {found_deg}");
        assert_eq!(track.doubted(), Doubted { spikes: u32::from(!believed), ..Doubted::NONE });
    }
}

/// The rates lead from one report to the next: 60 deg/s are 1.2 deg in 20 ms, from which 6.9 deg are allowed.
#[test]
fn what_the_rates_explain_is_no_spike() {
    for (to_deg, believed) in [(1.2 + 6.7, true), (1.2 + 7.1, false), (1.2 - 6.7, true), (1.2 - 7.1, false)] {
        let mut track = Track::new(CONFIG);
        track.push(at(1_000_000), rolling(0, 0.0, 60.0));
        track.push(at(1_000_000 + PERIOD_US), rolling(0, to_deg, 60.0));
        assert_eq!(track.doubted().spikes, u32::from(!believed), "{to_deg}");
    }
}

#[test]
fn the_fourth_report_far_off_is_believed() {
    let (track, true_us) = reported(&[0.0, 30.0, 30.1, 30.2]);
    assert!(roll_deg(track.at(at(true_us))).abs() < 1e-3 && track.doubted().spikes == 3);
    let (track, true_us) = reported(&[0.0, 30.0, 30.1, 30.2, 30.3]);
    assert!((roll_deg(track.at(at(true_us))) - 30.3).abs() < 1e-3);
    assert_eq!(track.doubted().spikes, 3);
    // A good one between them begins the count anew.
    let (track, _) = reported(&[0.0, 30.0, 30.1, 0.1, 30.2, 30.3, 30.4]);
    assert_eq!(track.doubted().spikes, 5);
}

/// After a gap that is not interpolated over, 250 ms, anything may be true.
#[test]
fn after_a_gap_nothing_is_far_off() {
    for (gap_us, spikes) in [(249_000, 1), (251_000, 0)] {
        let mut track = Track::new(CONFIG);
        track.push(at(1_000_000), rolling(0, 0.0, AT_REST));
        track.push(at(1_000_000 + gap_us), rolling(0, 45.0, AT_REST));
        assert_eq!(track.doubted().spikes, spikes, "{gap_us}");
    }
}

/// At a vertical nose roll means nothing: 180 deg of it are no motion.
#[test]
fn roll_at_a_vertical_nose_is_no_spike() {
    let mut track = of_one(Attitude::from_deg(0.0, 89.0), [0.0; 3]);
    track.push(at(1_020_000 + LATENCY_US), moving(0, Attitude::from_deg(180.0, 89.0), [0.0; 3]));
    assert_eq!(track.doubted().spikes, 0);
    let mut track = of_one(Attitude::from_deg(0.0, 0.0), [AT_REST; 3]);
    track.push(at(1_020_000 + LATENCY_US), moving(0, Attitude::from_deg(0.0, 8.0), [AT_REST; 3]));
    assert_eq!(track.doubted().spikes, 1, "pitch counts as well");
}

#[test]
fn how_fast_it_turns_is_the_newest_report_s_rates() {
    assert_eq!(Track::new(CONFIG).turning_rad_s(), None);
    let track = of_one(Attitude::default(), [30.0, -40.0, 0.0]);
    assert!((track.turning_rad_s().unwrap() - 50_f32.to_radians()).abs() < 1e-5);
    // Rates of nothing at all are those of a source that gives none.
    assert_eq!(of_one(Attitude::default(), [0.0; 3]).turning_rad_s(), None);
    // No gyro reads more than 36 rad/s, 2063 deg/s.
    for (rate_deg_s, reads) in [(2060.0, true), (-2060.0, true), (2066.0, false), (-2066.0, false), (f32::MAX, false)] {
        assert_eq!(
            of_one(Attitude::default(), [0.1, 0.0, rate_deg_s]).turning_rad_s().is_some(),
            reads,
            "{rate_deg_s}"
        );
    }
}

/// Fine values, then the same over and over: the fifth of them is left away, and there is no attitude from then on.
#[test]
fn a_source_that_repeats_itself_is_not_believed() {
    let rolls_deg = [10.0, 10.02, 10.05, 10.05, 10.05, 10.05];
    let (track, true_us) = reported(&rolls_deg);
    assert_ne!(track.at(at(true_us + 1)), Lookup::Frozen, "four are equal");
    let (mut track, true_us) = reported(&[&rolls_deg[..], &[10.05]].concat());
    assert_eq!(track.at(at(true_us + 1)), Lookup::Frozen);
    assert_eq!(track.doubted(), Doubted { frozen: 1, ..Doubted::NONE });
    // Of a source that has fallen silent after all nothing else is known than that.
    assert_eq!(track.at(at(true_us + 200_000)), Lookup::Frozen);
    assert_eq!(track.at(at(true_us + 200_001)), Lookup::Stale);
    // What is known of the past stays known.
    assert!(matches!(track.at(at(true_us - 50_000)), Lookup::Interpolated(_)));
    // It goes on.
    track.push(at(true_us + PERIOD_US + LATENCY_US), rolling(0, 10.07, 0.0));
    assert!(matches!(track.at(at(true_us + PERIOD_US + 1)), Lookup::Extrapolated(_)));
}

/// A sender's clock and reports say nothing of another's: here one 50 ms behind, which the first one's clock would take
/// for a report that was long under way.
#[test]
fn another_source_starts_afresh() {
    let mut track = Track::new(CONFIG);
    for i in 0..4_u32 {
        track.push(at(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), rolling(500 + i * 20, 10.0, 0.0));
    }
    let other = Report { source: Source::new(7), ..rolling(500 + 4 * 20 - 50, 30.0, 0.0) };
    track.push(at(1_080_000 + LATENCY_US), other);
    assert!(matches!(track.at(at(1_080_000)), Lookup::Interpolated(_)));
    assert!((roll_deg(track.at(at(1_080_000))) - 30.0).abs() < 1e-3);
    // Between the two there is nothing, nor before.
    for before in [1_079_999, 1_060_000, 1_030_000] {
        assert_eq!(track.at(at(before)), Lookup::Missing, "{before}");
    }
    // From then on it is a sender as any.
    track.push(at(1_100_000 + LATENCY_US), Report { sender_time: WrappingMillis::new(500 + 5 * 20 - 50), ..other });
    assert!(matches!(track.at(at(1_090_000)), Lookup::Interpolated(_)));
    // The first one is another one then, also when its report is older than the last.
    track.push(at(1_090_000 + LATENCY_US), rolling(0, 10.0, 0.0));
    assert!((roll_deg(track.at(at(1_090_000))) - 10.0).abs() < 1e-3);
}

/// What one sender repeated, or where it was, is nothing to the next; what was counted stays.
#[test]
fn another_source_is_not_measured_by_the_one_before() {
    let (mut track, true_us) = reported(&[10.0, 10.02, 40.0, 10.05, 10.05, 10.05, 10.05, 10.05]);
    assert_eq!(track.doubted(), Doubted { spikes: 1, frozen: 1, ..Doubted::NONE });
    let other = Report { source: Source::new(7), ..rolling(0, 50.0, 0.0) };
    track.push(at(true_us + PERIOD_US + LATENCY_US), other);
    assert!((roll_deg(track.at(at(true_us + PERIOD_US))) - 50.0).abs() < 1e-3);
    assert_eq!(track.doubted(), Doubted { spikes: 1, frozen: 1, ..Doubted::NONE });
}

/// 0.1 rad and 4 rad/s in 100 ms are 28.6 deg: a roll of 280 deg/s, of which a source without rates says nothing.
#[test]
fn without_rates_a_fast_roll_is_no_spike() {
    for (to_deg, believed) in [(28.0, true), (29.2, false), (-28.0, true), (-29.2, false)] {
        let mut track = Track::new(CONFIG);
        track.push(at(1_000_000), rolling(0, 0.0, 0.0));
        track.push(at(1_100_000), rolling(0, to_deg, 0.0));
        assert_eq!(track.doubted().spikes, u32::from(!believed), "{to_deg}");
    }
    // With rates, of any axis, that say that it does not roll, it is one.
    for rates_deg_s in [[AT_REST, 0.0, 0.0], [0.0, -AT_REST, 0.0], [0.0, 0.0, AT_REST]] {
        let mut track = of_one(Attitude::default(), rates_deg_s);
        track.push(at(1_100_000 + LATENCY_US), rolling(0, 20.0, AT_REST));
        assert_eq!(track.doubted().spikes, 1, "{rates_deg_s:?}");
    }
}

/// A field that is filtered is older than the attitude: it goes with reports of before.
#[test]
fn a_negative_latency_looks_back() {
    for (latency_us, expected_deg) in [(-30_000, 0.5), (30_000, 1.1)] {
        let mut track = Track::new(Config { latency_us, ..CONFIG });
        for i in 0..8_u32 {
            track.push(at(1_000_000 + u64::from(i) * PERIOD_US), rolling(500 + i * 20, 0.2 * i as f32, 10.0));
        }
        assert!((roll_deg(track.at(at(1_080_000))) - expected_deg).abs() < 1e-3, "{latency_us}");
    }
}

/// A yaw rate that grows by 10 deg/s every report: between two of them its integral is that of a straight line, after
/// the newest it goes on as it was, and it ends where the attitude does.
#[test]
fn the_turn_is_known_where_the_attitude_is() {
    let mut track = Track::new(CONFIG);
    for i in 0..3_u32 {
        let report = moving(500 + 20 * i, Attitude::default(), [0.0, 0.0, 10.0 * (i + 1) as f32]);
        track.push(at(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), report);
    }
    let turning = |us: u64| track.turning_at(at(us)).unwrap();
    let from = turning(1_000_000);
    for (us, turned_deg, rate_deg_s) in
        [(1_010_000, 0.125, 15.0), (1_020_000, 0.3, 20.0), (1_040_000, 0.8, 30.0), (1_140_000, 3.8, 30.0)]
    {
        let found = turning(us);
        assert!(((found.turned_rad - from.turned_rad).to_degrees() - turned_deg).abs() < 1e-3, "{us}: {found:?}");
        assert!((found.motion.heading_rad_s.to_degrees() - rate_deg_s).abs() < 1e-3, "{us}: {found:?}");
        assert_eq!(found.run, from.run);
    }
    assert_eq!(track.turning_at(at(1_240_001)), None);
    assert_eq!(track.turning_at(at(999_999)), None);
    // A source without rates.
    assert_eq!(of_one(Attitude::default(), [0.0; 3]).turning_at(at(1_000_000)), None);
}

/// Two seconds.
#[test]
fn a_turn_goes_on_over_a_short_gap() {
    for (gap_us, goes_on) in [(2_000_000, true), (2_000_001, false)] {
        let mut track = of_one(Attitude::default(), [0.0, 0.0, 10.0]);
        let run = track.turning_at(at(1_000_000)).unwrap().run;
        track.push(at(1_000_000 + gap_us + LATENCY_US), moving(0, Attitude::default(), [0.0, 0.0, 10.0]));
        assert_eq!(track.turning_at(at(1_000_000 + gap_us)).unwrap().run == run, goes_on, "{gap_us} us");
    }
}

/// What repeats itself says nothing of the turn either.
#[test]
fn a_frozen_source_does_not_turn() {
    let mut track = Track::new(CONFIG);
    for i in 0..20_u32 {
        // Fine values at first, the same again and again later.
        let roll_deg = 0.01 * i.min(8) as f32;
        let report = moving(20 * i, Attitude::from_deg(roll_deg, 0.0), [0.0, 0.0, 10.0]);
        track.push(at(1_000_000 + u64::from(i) * PERIOD_US + LATENCY_US), report);
    }
    let now = at(1_000_000 + 19 * PERIOD_US);
    assert_eq!(track.at(now), Lookup::Frozen);
    assert_eq!(track.turning_at(now), None);
}

/// Rolling from side to side with rates of the wrong sign: the attitude is believed, the rates are not.
#[test]
fn rates_that_contradict_their_attitude_are_left_away() {
    let mut track = Track::new(CONFIG);
    let mut now_us = 0;
    for i in 0..500_u16 {
        let t_s = f32::from(i) * 0.02;
        now_us = 1_000_000 + u64::from(i) * PERIOD_US;
        let report = rolling(20 * u32::from(i), 10.0 * t_s.sin(), -10.0 * t_s.cos());
        track.push(at(now_us + LATENCY_US), report);
    }
    assert!((roll_deg(track.at(at(now_us))) - 10.0 * 9.98_f32.sin()).abs() < 1e-3);
    assert_eq!((track.turning_at(at(now_us)), track.turning_rad_s()), (None, None));
    assert!(track.doubted().rates > 300 && track.doubted().spikes == 0, "{:?}", track.doubted());
}

/// Swings of 20 deg with the field at rest: of a source whose rates were right so far it is one that still seeks its
/// attitude, and nothing is known until it has settled; of one whose rates were wrong it is what it says.
#[test]
fn an_attitude_that_is_sought_is_not_believed() {
    for (rates_are, is_sought) in [(1.0, true), (-1.0, false)] {
        let mut track = Track::new(CONFIG);
        let mut found = Vec::new();
        for i in 0..1500_u16 {
            let t_s = f32::from(i) * 0.02;
            let now_us = 1_000_000 + u64::from(i) * PERIOD_US;
            // Flown at first, and then only said.
            let is_flown = t_s < 15.0;
            let angle = if is_flown { (10.0 * t_s.sin()).to_radians() } else { 0.0 };
            track.see_raw_field(Field::from_ut(20.0, 43.0 * angle.sin(), 43.0 * angle.cos()));
            let (roll_deg, p_deg_s) =
                if is_flown { (10.0 * t_s.sin(), rates_are * 10.0 * t_s.cos()) } else { (20.0 * t_s.sin(), 0.01) };
            track.push(at(now_us + LATENCY_US), rolling(20 * u32::from(i), roll_deg, p_deg_s));
            if t_s > 20.0 {
                found.push(track.at(at(now_us + 1)));
            }
        }
        assert!(found.iter().all(|lookup| (*lookup == Lookup::Aligning) == is_sought), "{rates_are}");
    }
}

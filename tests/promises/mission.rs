//! Complete calibration flights with the simulated module.

use simulator::devices::sensor::SensorModel;
use simulator::mission::{MissionResult, TurnPlan, fly_mission, fly_mission_of_module};
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::transcript::Refusal;
use simulator::world::WorldConfig;
use testkit::documents;

use crate::fixtures::share_of_flights;

fn mission_result(world: &WorldConfig) -> MissionResult {
    fly_mission(*world, TurnPlan::default(), &mut |_| {})
}

fn expected_rms_deg(mission_result: &MissionResult) -> f64 {
    let Ok(shown_calibration) = &mission_result.calibration_result else {
        panic!("seed {}: {:?}", mission_result.world.seed, mission_result.calibration_result)
    };
    shown_calibration.expected_rms_deg
}

/// Aircraft of Liu 2007 table 1 (README): 21.5 deg before and at most 1.0 deg after calibration. The paper reaches 2.8
/// deg, or 1.6 without the mean error.
#[test]
fn the_paper_s_aircraft_is_calibrated_to_one_degree() {
    let mut worst_deg = 0.0_f64;
    for seed in 1..=5 {
        let mission_result = mission_result(&WorldConfig::of_table1(seed));
        let expected_deg = expected_rms_deg(&mission_result);
        let (before, after) = (mission_result.errors_before.statistics(), mission_result.errors_after.statistics());
        assert!((before.max_deg - 21.5).abs() <= 1.0, "before {before:?}");
        assert!(after.max_deg <= 1.0, "after {after:?}");
        assert!(after.rms_deg <= 3.0 * expected_deg, "{} deg, expected {expected_deg}", after.rms_deg);
        worst_deg = worst_deg.max(after.max_deg);
    }
    for (document, row) in [("README.md", "airframe of Liu 2007"), ("docs/accuracy.md", "Liu 2007, table 1")] {
        documents::assert_document_states(document, row, &format!("{worst_deg:.2} deg"));
    }
}

/// A tilt of 0.42 deg in a random direction: 0.3 deg RMS of mean pitch, as EKF3's in flights of ArduPlane, 0.2 to 0.4 deg.
/// The default of `set attitude-error` covers it: measured over 40 random airframes 73 and 95 %, with the usual tilt of 0.2
/// deg 75 and 97 %, with 0.6 deg 70 and 94 %.
#[test]
fn sigmas_cover_the_mean_pitch_error_of_an_ekf() {
    let flight_count = share_of_flights(36);
    let within = (1..=flight_count).map(|seed| {
        let mut world = WorldConfig::random_world(seed);
        world.attitude_source.bias_deg = 0.42;
        mission_result(&world).streamed_statistics.unwrap().within_percent
    });
    let sums = within.fold([0.0; 2], |sums, percent| [sums[0] + percent[0], sums[1] + percent[1]]);
    let [one_sigma_percent, two_sigma_percent] = sums.map(|sum| sum / flight_count as f64);
    assert!(
        (64.0..=80.0).contains(&one_sigma_percent) && (91.0..=99.0).contains(&two_sigma_percent),
        "{one_sigma_percent} % and {two_sigma_percent} % within 1 and 2 sigma"
    );
}

/// The limits are those of the reference board's LIS3MDL.
#[test]
fn with_an_rm3100_the_paper_s_aircraft_is_calibrated_to_one_degree() {
    for seed in 1..=3 {
        let world = WorldConfig { sensor: SensorModel::Rm3100, ..WorldConfig::of_table1(seed) };
        let mission_result = mission_result(&world);
        let (expected_deg, after) = (expected_rms_deg(&mission_result), mission_result.errors_after.statistics());
        assert!(after.max_deg <= 1.0, "after {after:?}");
        assert!(after.rms_deg <= 3.0 * expected_deg, "{} deg, expected {expected_deg}", after.rms_deg);
        let streamed = mission_result.streamed_statistics.unwrap();
        assert!(streamed.rms_deg <= 1.0, "seed {seed}: {streamed:?}");
    }
}

/// Interference of 12 uT at 15 A; the current rises with bank. With a reported current headings are as good as without
/// interference. Without it the calibration contains the current of the turns, which differs from that of straight
/// flight.
#[test]
fn with_a_reported_current_an_aeroplane_is_calibrated_to_1_deg() {
    for seed in 1..=3 {
        let world = WorldConfig::of_table1(seed).with_current_interference(12.0);
        let with_current = mission_result(&WorldConfig { reports_current: true, ..world });
        let without_current = mission_result(&world);
        let (with_current_deg, without_current_deg) =
            (with_current.errors_after.statistics().rms_deg, without_current.errors_after.statistics().rms_deg);
        assert!(with_current_deg <= 1.0, "seed {seed}: {with_current_deg}");
        assert!(with_current_deg <= 3.0 * expected_rms_deg(&with_current), "seed {seed}: {with_current_deg}");
        assert!(without_current_deg >= 2.0, "seed {seed}: {without_current_deg}");
        // The limit of streamed headings includes the effect of attitude noise.
        let streamed = with_current.streamed_statistics.unwrap();
        assert!(streamed.rms_deg <= 1.2, "seed {seed}: {streamed:?}");
    }
}

/// Random airframes (README): soft iron to 20 %, hard iron to 1.5 H0, mounting to 10 deg, inclination -70 to 70 deg,
/// default weather and attitude source. The limit by attitude noise is 0.2 to 0.6 deg.
#[test]
fn fifty_random_airframes_are_calibrated_to_their_expected_error() {
    // Two threads fly half of the seeds each, to save time.
    let seed_halves = [1..=25, 26..=50].map(|seeds| {
        std::thread::spawn(move || {
            seeds.map(|seed| mission_result(&WorldConfig::random_world(seed))).collect::<Vec<_>>()
        })
    });
    let mission_results: Vec<MissionResult> =
        seed_halves.into_iter().flat_map(|thread| thread.join().unwrap()).collect();
    let mut rms_deg = Vec::new();
    let mut within = Vec::new();
    let [mut worst_mean_deg, mut worst_ratio, mut worst_streamed_deg] = [0.0_f64; 3];
    for mission_result in &mission_results {
        let seed = mission_result.world.seed;
        let (after, expected_deg) = (mission_result.errors_after.statistics(), expected_rms_deg(mission_result));
        assert!(after.rms_deg <= 1.0, "seed {seed}: {after:?}");
        assert!(after.mean_deg.abs() <= 0.6, "seed {seed}: {after:?}");
        assert!(after.rms_deg <= 3.0 * expected_deg, "seed {seed}: {} deg, expected {expected_deg}", after.rms_deg);
        let streamed = mission_result.streamed_statistics.unwrap();
        // The limit includes calibration, sensor and attitude noise, and latency.
        assert!(streamed.rms_deg <= 1.0, "seed {seed}: {streamed:?}");
        within.push(streamed.within_percent);
        rms_deg.push(after.rms_deg);
        worst_mean_deg = worst_mean_deg.max(after.mean_deg.abs());
        worst_ratio = worst_ratio.max(after.rms_deg / expected_deg);
        worst_streamed_deg = worst_streamed_deg.max(streamed.rms_deg);
    }
    rms_deg.sort_by(f64::total_cmp);
    let [median_deg, worst_deg] = [rms_deg[25], rms_deg[49]];
    assert!(median_deg <= 0.4, "{median_deg}");
    let [one_sigma_percent, two_sigma_percent] =
        [0, 1].map(|i| within.iter().map(|percent| percent[i]).sum::<f64>() / within.len() as f64);
    // The output sigma is slightly conservative.
    assert!(
        (65.0..=80.0).contains(&one_sigma_percent) && (93.0..=99.0).contains(&two_sigma_percent),
        "{one_sigma_percent} % and {two_sigma_percent} % within 1 and 2 sigma"
    );
    let within = format!("{one_sigma_percent:.0}, {two_sigma_percent:.0} %");
    for (document, row, measured) in [
        ("README.md", "50 random airframes", format!("{median_deg:.2}, {worst_deg:.2} deg")),
        ("README.md", "streamed headings", within.clone()),
        ("docs/accuracy.md", "50 random airframes", format!("{median_deg:.2} deg")),
        ("docs/accuracy.md", "| RMS, worst", format!("{worst_deg:.2} deg")),
        ("docs/accuracy.md", "| constant error", format!("{worst_mean_deg:.2} deg")),
        ("docs/accuracy.md", "| RMS over the expected error", format!("{worst_ratio:.1}")),
        ("docs/accuracy.md", "| RMS of the streamed headings", format!("{worst_streamed_deg:.2} deg")),
        ("docs/accuracy.md", "| streamed headings", within),
    ] {
        documents::assert_document_states(document, row, &measured);
    }
}

/// At an inclination of 54 deg one degree of roll or pitch causes tan(54 deg) = 1.4 deg of heading error. Note and
/// `status` agree.
#[test]
fn a_calibration_reports_heading_error_per_attitude_error() {
    let mut rig = Rig::new(WorldConfig::of_table1(1));
    let mission_result = fly_mission_of_module(&mut rig, TurnPlan::default(), &mut |_| {});
    let line_after = |text: &str, line: &str| {
        let ratio_text =
            text.split(line).nth(1).and_then(|rest| rest.split("; a degree of attitude error costs ").nth(1));
        ratio_text.and_then(|rest| rest.split_once(" deg")?.0.parse::<f64>().ok()).unwrap_or_else(|| panic!("{text}"))
    };
    let inclination_rad = mission_result.world.earth.inclination_deg.to_radians();
    let in_note = line_after(&mission_result.transcript, "note calibrated: expected error ");
    assert!((in_note - inclination_rad.tan()).abs() < 0.05, "{in_note}");
    let in_status = line_after(&rig.send_console_line("status all"), "calibration: number 1, expected error ");
    assert!((in_note - in_status).abs() < 1e-9, "{in_note} {in_status}");
}

#[test]
fn one_seed_gives_one_flight() {
    let [first, second, other] = [7, 7, 8].map(|seed| mission_result(&WorldConfig::random_world(seed)));
    assert_eq!(first.transcript, second.transcript);
    assert_eq!(first.streamed_statistics, second.streamed_statistics);
    assert_eq!(first.errors_after, second.errors_after);
    assert_ne!(first.transcript, other.transcript);
}

/// Five degrees of bank are not a turn. A level calibration is not a substitute, because its estimated error excludes
/// the mean error.
#[test]
fn a_flight_without_turns_or_with_little_bank_is_refused() {
    // With seeds 5 and 7 gusts increase the bank to ten degrees for long enough to start a turn, after which level flight
    // is collected.
    for (world, bank_deg, circles_per_side) in [
        (WorldConfig::of_table1(1), 25.0, 0.05),
        (WorldConfig::random_world(5), 5.0, 2.0),
        (WorldConfig::random_world(7), 5.0, 2.0),
    ] {
        let mission_result = fly_mission(world, TurnPlan { bank_deg, circles_per_side }, &mut |_| {});
        let Refusal { code, explanation } = mission_result.calibration_result.unwrap_err();
        assert_eq!(code, "too-few-samples", "{explanation}");
        assert!(explanation.contains("turns"), "{explanation}");
        assert!(mission_result.streamed_statistics.is_none());
    }
}

//! Replays of rows with the true heading as reference.

use std::fmt::Write as _;

use autoswing::acceptance::Rejection;
use autoswing::calibration::SolveError;
use autoswing::collection::CollectionProblem;
use autoswing::frames::RollPitch;
use autoswing_module::messages::{Refusal, RefusalCause};
use log_analysis::replay::{
    EarthFieldPrior, HeadingRow, HeadingScore, ReferenceHeading, ReplayResult, ReplayRow, RowSelection, build_rows,
    replay_rows,
};
use nalgebra::Vector3;
use simulator::heading_errors::HeadingErrors;
use simulator::world::autopilot::Leg;
use simulator::world::{World, WorldConfig};

use super::{max_rms_deg, read_flight};

fn configured_inclination(inclination_deg: f64) -> EarthFieldPrior {
    EarthFieldPrior { inclination_deg: Some(inclination_deg), place_and_day: None }
}

/// Replay of a selection of rows without prior information.
fn replay_selection(rows: &[ReplayRow], selection: RowSelection) -> ReplayResult {
    replay_rows(rows, None, selection, &EarthFieldPrior::default())
}

/// Straight, circles each way, straight, at 10 Hz in milligauss with one decimal and reported attitude; the reference
/// is the true magnetic heading. The first 10 s are not usable.
fn recorded_turns(world: &WorldConfig, circles: f64) -> Vec<ReplayRow> {
    recorded_turns_with_hard_iron(world, circles, |_| [0.0; 3])
}

/// Rows as by [`recorded_turns`], with additional hard iron `iron_ut(t_s)`.
fn recorded_turns_with_hard_iron(
    world: &WorldConfig,
    circles: f64,
    iron_ut: impl Fn(f64) -> [f64; 3],
) -> Vec<ReplayRow> {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    world.append_leg(Leg::Straight { heading_deg: 0.0, seconds: 15.0 });
    for heading_change_deg in [360.0 * circles, -360.0 * circles] {
        world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    world.append_leg(Leg::Straight { heading_deg: 120.0, seconds: 20.0 });
    let mut text = "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,use,p_dps,q_dps,r_dps\n".to_owned();
    let mut last = None;
    for i in 0..(35 + (60.0 * circles) as u64) * 10 {
        let at_us = i * 100_000;
        world.set_disturbance_ut(iron_ut(at_us as f64 / 1e6));
        let truth = world.true_state(at_us);
        let field = world.sensor_field(at_us).ut * 10.0;
        let reported = source.next_report(&truth);
        let [roll_deg, pitch_deg] = [reported.roll_rad, reported.pitch_rad].map(f64::to_degrees);
        let (t_s, reference_deg, usable) = (at_us as f64 / 1e6, truth.heading_deg(), u8::from(i >= 100));
        let [x, y, z] = [field.x, field.y, field.z];
        // The mean rate since the last row, approximated by the mean of both ends.
        let now = truth.body_rates_rad_s().map(f64::to_degrees);
        let [p, q, r] = std::array::from_fn(|axis| now[axis].midpoint(last.unwrap_or(now)[axis]));
        last = Some(now);
        write!(text, "{t_s},{x:.1},{y:.1},{z:.1},{roll_deg:.2},{pitch_deg:.2},{reference_deg:.2},{usable}").unwrap();
        writeln!(text, ",{p:.3},{q:.3},{r:.3}").unwrap();
    }
    let flight = read_flight(text.as_bytes());
    build_rows(&flight, &flight.compasses[0], 0.0, ReferenceHeading::best_reference(&flight).as_ref()).0
}

/// Attitude noise of 0.3 deg and a bank-angle scale error of 1 % make up to 1 deg of heading at these inclinations.
#[test]
fn all_rows_and_turns_alone_give_the_heading() {
    for seed in 0..10 {
        let world = WorldConfig::random_world(seed);
        let rows = recorded_turns(&world, 3.0);
        for selection in [RowSelection::All, RowSelection::Turns] {
            let replay_result = replay_selection(&rows, selection);
            assert_eq!(replay_result.outcome.acceptance, Ok(()), "seed {seed} {selection:?}");
            let score = replay_result.score.unwrap();
            assert!(score.rms_deg < max_rms_deg(&world), "seed {seed} {selection:?}: {score:?}");
            assert!(score.mean_deg.abs() < 0.5, "seed {seed} {selection:?}: {score:?}");
            assert_eq!(score.row_count, rows.len() - 100);
            assert_eq!(replay_result.headings.len(), rows.len());
        }
    }
}

/// The attitude noise of 0.3 deg is correlated over 0.5 s, so smoothing removes most of it.
#[test]
fn body_rates_reduce_the_heading_error_by_smoothing() {
    let rms = |score: Option<HeadingScore>| score.unwrap().rms_deg;
    let mut ratios = Vec::new();
    for seed in 0..5 {
        let rows = recorded_turns(&WorldConfig::random_world(seed), 3.0);
        let with_rates = replay_selection(&rows, RowSelection::All);
        let is_smoothed = |heading_row: &HeadingRow| heading_row.smoothed_and_sigma_deg.is_some();
        let smoothed_count = with_rates.headings.iter().filter(|row| is_smoothed(row)).count();
        assert!(smoothed_count > rows.len() * 9 / 10, "seed {seed}: {smoothed_count} of {}", rows.len());
        assert!(!with_rates.headings[..20].iter().any(is_smoothed), "seed {seed}");
        ratios.push(rms(with_rates.smoothed_score) / rms(with_rates.score));
    }
    // Near the magnetic equator attitude errors hardly affect the heading, and the smoothed one has up to 4 % more error.
    assert!(ratios.iter().all(|&ratio| ratio < 1.05), "{ratios:?}");
    assert!(ratios.iter().sum::<f64>() < 0.9 * ratios.len() as f64, "{ratios:?}");
}

/// Fits parts of the rows from the start, with the inclination unknown or configured (`--inclination`).
#[test]
fn a_fit_to_a_part_of_the_flight_is_good_or_refused() {
    let rows = recorded_turns(&WorldConfig::of_table1(1), 3.0);
    let until = |end_s: f64| -> Vec<ReplayRow> { rows.iter().filter(|row| row.t_s < end_s).copied().collect() };
    for selection in [RowSelection::All, RowSelection::Turns] {
        assert!(
            replay_selection(&until(14.0), selection).outcome.acceptance.is_err(),
            "a steady course, {selection:?}"
        );
    }
    let early_result = replay_selection(&until(25.0), RowSelection::Turns);
    assert!(matches!(early_result.outcome.acceptance, Err(Refusal::Solve(_))), "{:?}", early_result.outcome.acceptance);
    assert!(early_result.headings.is_empty() && early_result.score.is_none());
    let with_inclination =
        replay_rows(&rows, None, RowSelection::Turns, &configured_inclination(54.0)).outcome.solution.unwrap();
    assert!((with_inclination.calibration.inclination_rad.to_degrees() - 54.0).abs() < 1.0);
    let all_rows_result = replay_selection(&rows, RowSelection::All);
    assert!(
        all_rows_result.outcome.fitted_count > replay_selection(&until(35.0), RowSelection::All).outcome.fitted_count
    );
}

/// A straight leg and a third of a circle.
#[test]
fn a_short_flight_is_refused_with_the_missing_manoeuvre_or_has_an_honest_expected_error() {
    let mut inaccurate_count = 0;
    for seed in 0..10 {
        let rows = recorded_turns(&WorldConfig::random_world(seed), 0.0);
        for selection in [RowSelection::All, RowSelection::Turns] {
            let result = replay_selection(&rows, selection);
            if let Err(refusal) = &result.outcome.acceptance {
                let is_inaccurate = refusal.stable_code() == "not-accurate";
                inaccurate_count += usize::from(is_inaccurate);
                let text = refusal.to_string();
                let names_manoeuvre = text.starts_with("expected error ") && text.contains(" deg; missing: ");
                assert!(!is_inaccurate || names_manoeuvre, "seed {seed} {selection:?}: {text}");
            } else {
                let expected_deg = f64::from(result.outcome.solution.unwrap().quality.expected_rms_deg);
                let score = result.score.unwrap();
                let error_deg = score.rms_deg.hypot(score.mean_deg);
                assert!(error_deg < 1.0 + 3.0 * expected_deg, "seed {seed} {selection:?}: {score:?}, {expected_deg}");
            }
        }
    }
    assert!(inaccurate_count > 0);
}

/// Hard iron that steps between the sides or in a turn, or drifts: refused, or included in the expected error at the
/// end.
#[test]
fn a_changing_hard_iron_is_refused_or_in_the_expected_error() {
    let mut refused = 0;
    for seed in 0..6 {
        let world = WorldConfig::random_world(seed);
        for (name, iron_ut) in [
            ("between the sides", (|t_s| if t_s < 110.0 { [0.0; 3] } else { [3.0, -3.0, 3.0] }) as fn(f64) -> [f64; 3]),
            ("in a turn", |t_s| if t_s < 60.0 { [0.0; 3] } else { [-2.0, 2.0, 3.0] }),
            ("drift", |t_s| [0.03 * t_s, 0.02 * t_s, -0.03 * t_s]),
        ] {
            let rows = recorded_turns_with_hard_iron(&world, 3.0, iron_ut);
            let replay_result = replay_selection(&rows, RowSelection::Turns);
            match replay_result.outcome.acceptance {
                Err(Refusal::Rejected(Rejection::IronChanged(_)) | Refusal::Solve(SolveError::HardIronChanged(_))) => {
                    refused += 1;
                }
                accepted => {
                    assert_eq!(accepted, Ok(()), "seed {seed} {name}");
                    let solution = replay_result.outcome.solution.unwrap();
                    assert!(solution.hard_iron_change.is_some(), "seed {seed} {name}");
                    let mut at_the_end = world;
                    at_the_end.airframe.hard_iron_ut += Vector3::from(iron_ut(205.0));
                    let error_deg =
                        HeadingErrors::evaluate_calibration(&solution.calibration, &at_the_end).statistics().rms_deg;
                    let expected_deg = f64::from(solution.quality.expected_rms_deg);
                    assert!(error_deg < 2.0 * expected_deg, "seed {seed} {name}: {error_deg}, {expected_deg}");
                }
            }
        }
    }
    assert!(refused >= 9, "{refused}");
}

/// The configured inclination is off by 10 or 20 deg or has the wrong sign.
#[test]
fn a_wrong_inclination_is_named() {
    for seed in 0..6 {
        let world = WorldConfig::random_world(seed);
        let rows = recorded_turns(&world, 3.0);
        let true_deg = world.earth.inclination_deg;
        for configured_deg in [true_deg + 10.0, true_deg - 20.0, if true_deg.abs() > 5.0 { -true_deg } else { 45.0 }] {
            let prior = configured_inclination(configured_deg);
            let refused = replay_rows(&rows, None, RowSelection::Turns, &prior).outcome.acceptance.unwrap_err();
            let Refusal::Solve(SolveError::InclinationContradicted { found_deg }) = refused else {
                panic!("seed {seed}, configured {configured_deg}: {refused:?}");
            };
            let off_deg = f64::from(found_deg) - true_deg;
            assert!(off_deg.abs() < 1.5, "seed {seed}, configured {configured_deg}: {found_deg}");
        }
    }
}

/// Rows with attitude in radians instead of degrees, and rows at 1 Hz.
#[test]
fn wrong_units_and_slow_rows_are_reported() {
    let rows = recorded_turns(&WorldConfig::of_table1(1), 3.0);
    let in_radians: Vec<ReplayRow> = rows
        .iter()
        .map(|&row| {
            let RollPitch { roll_rad, pitch_rad } = row.attitude;
            let attitude = RollPitch { roll_rad: roll_rad.to_radians(), pitch_rad: pitch_rad.to_radians() };
            ReplayRow { attitude, ..row }
        })
        .collect();
    let problem = |rows: &[ReplayRow]| match replay_selection(rows, RowSelection::Turns).outcome.acceptance {
        Err(Refusal::InsufficientSamples { cause: RefusalCause::CollectionProblem(problem), .. }) => problem,
        other => panic!("{other:?}"),
    };
    assert!(matches!(problem(&in_radians), CollectionProblem::NoTilt { .. }));
    let slow: Vec<ReplayRow> = rows.iter().step_by(10).copied().collect();
    assert!(matches!(problem(&slow), CollectionProblem::SampleIntervalTooLong { .. }));
    assert_eq!(replay_selection(&rows, RowSelection::Turns).outcome.acceptance, Ok(()));
}

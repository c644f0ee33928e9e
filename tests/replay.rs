//! A flight recorded in the simulator, replayed: the answer is that of the module, whichever rows are used.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

use std::fmt::Write as _;

use host_sim::replay::recording::{Row, Unit, parse};
use host_sim::replay::{Options, Refused, Selected, replay};
use host_sim::world::autopilot::Leg;
use host_sim::world::{World, WorldConfig};

const ALL: Options = Options { selected: Selected::All, inclination_deg: None, fit_until_s: None };
const TURNS: Options = Options { selected: Selected::Turns, ..ALL };

/// Straight, two circles each way, straight; a row every 0.1 s as an autopilot logs: milligauss to one decimal, its own
/// attitude. The reference is the true magnetic heading. The first ten seconds are not usable.
fn recorded(world: &WorldConfig, circles: f64) -> Vec<Row> {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    world.fly(Leg::Straight { heading_deg: 0.0, seconds: 15.0 });
    for heading_change_deg in [360.0 * circles, -360.0 * circles] {
        world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    world.fly(Leg::Straight { heading_deg: 120.0, seconds: 20.0 });
    let mut text = "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,use\n".to_owned();
    for i in 0..(35 + (60.0 * circles) as u64) * 10 {
        let at_us = i * 100_000;
        let truth = world.true_state(at_us);
        let field = world.sensor_field(at_us).ut * 10.0;
        let reported = source.report(&truth);
        let [roll_deg, pitch_deg] = [reported.roll_rad, reported.pitch_rad].map(f64::to_degrees);
        let (t_s, reference_deg, usable) = (at_us as f64 / 1e6, truth.heading_deg(), u8::from(i >= 100));
        let [x, y, z] = [field.x, field.y, field.z];
        writeln!(text, "{t_s},{x:.1},{y:.1},{z:.1},{roll_deg:.2},{pitch_deg:.2},{reference_deg:.2},{usable}").unwrap();
    }
    parse(text.as_bytes(), Unit::Milligauss).unwrap()
}

/// Attitude noise of 0.3 deg and a bank 1 % short make up to 1 deg of heading at these inclinations; the coefficients
/// add what the module expects of them.
#[test]
fn both_ways_of_choosing_rows_give_the_heading() {
    for seed in 0..10 {
        let world = WorldConfig::random(seed);
        let rows = recorded(&world, 3.0);
        let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
        for options in [ALL, TURNS] {
            let replayed = replay(&rows, &options);
            assert_eq!(replayed.accepted, Ok(()), "seed {seed} {options:?}");
            let (score, before) = (replayed.score.unwrap(), replayed.uncorrected.unwrap());
            assert!(score.rms_deg < 0.5 + noise_deg, "seed {seed} {options:?}: {score:?}, before {before:?}");
            assert!(score.mean_deg.abs() < 0.5, "seed {seed} {options:?}: {score:?}");
            assert_eq!(score.rows, rows.len() - 100);
            assert_eq!(replayed.shown.len(), rows.len());
        }
    }
}

/// What is asked for with `--fit-until` and `--inclination` is used.
#[test]
fn a_part_of_the_flight_is_enough_or_refused() {
    let rows = recorded(&WorldConfig::table1(1), 3.0);
    let early = replay(&rows, &Options { fit_until_s: Some(25.0), ..TURNS });
    assert!(matches!(early.accepted, Err(Refused::Solve(_))), "{:?}", early.accepted);
    assert!(early.shown.is_empty() && early.score.is_none());
    let told = replay(&rows, &Options { inclination_deg: Some(54.0), ..TURNS }).solution.unwrap();
    assert!((told.calibration.inclination_rad.to_degrees() - 54.0).abs() < 1.0);
    let all = replay(&rows, &ALL);
    assert!(all.samples > replay(&rows, &Options { fit_until_s: Some(35.0), ..ALL }).samples);
}

/// A steady course and a third of a circle: refused, or as good as it says.
#[test]
fn little_is_refused_or_honest() {
    for seed in 0..10 {
        let rows = recorded(&WorldConfig::random(seed), 0.0);
        for options in [ALL, TURNS] {
            let replayed = replay(&rows, &options);
            if replayed.accepted.is_ok() {
                let expected_deg = f64::from(replayed.solution.unwrap().quality.expected_rms_deg);
                let score = replayed.score.unwrap();
                let error_deg = score.rms_deg.hypot(score.mean_deg);
                assert!(error_deg < 1.0 + 3.0 * expected_deg, "seed {seed} {options:?}: {score:?}, {expected_deg}");
            }
        }
    }
}

#[test]
fn a_steady_course_is_refused() {
    let mut rows = recorded(&WorldConfig::table1(1), 0.0);
    rows.retain(|row| row.t_s < 14.0);
    for options in [ALL, TURNS] {
        assert!(replay(&rows, &options).accepted.is_err(), "{options:?}");
    }
}

//! Rows of one compass, with the true heading beside them: the answer is that of the module, whichever are used.

use std::fmt::Write as _;

use autoswing::acceptance::Rejection;
use autoswing::calibration::SolveError;
use autoswing::collection::Lack;
use autoswing::frames::Attitude;
use host_sim::log::{Flight, Iron};
use host_sim::replay::judge::refusal;
use host_sim::replay::{Options, Reference, Refused, Row, Score, Selected, change, replay, rows};
use host_sim::score::Errors;
use host_sim::world::autopilot::Leg;
use host_sim::world::{World, WorldConfig};
use nalgebra::Vector3;

use crate::read;

const ALL: Options = Options::of(Selected::All);
const TURNS: Options = Options { selected: Selected::Turns, ..ALL };

/// The rows of a flight's first compass, whose field is so old.
fn rows_of(flight: &Flight, age_s: f64) -> Vec<Row> {
    rows(flight, &flight.compasses[0], age_s, Reference::best(flight).as_ref()).0
}

/// Straight, two circles each way, straight; a row every 0.1 s as an autopilot logs: milligauss to one decimal, its own
/// attitude. The reference is the true magnetic heading. The first ten seconds are not usable.
fn recorded(world: &WorldConfig, circles: f64) -> Vec<Row> {
    recorded_with(world, circles, |_| [0.0; 3])
}

/// The same with so much more hard iron at so many seconds, microtesla.
fn recorded_with(world: &WorldConfig, circles: f64, iron_ut: impl Fn(f64) -> [f64; 3]) -> Vec<Row> {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    world.fly(Leg::Straight { heading_deg: 0.0, seconds: 15.0 });
    for heading_change_deg in [360.0 * circles, -360.0 * circles] {
        world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    world.fly(Leg::Straight { heading_deg: 120.0, seconds: 20.0 });
    let mut text = "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,use,p_dps,q_dps,r_dps\n".to_owned();
    let mut last = None;
    for i in 0..(35 + (60.0 * circles) as u64) * 10 {
        let at_us = i * 100_000;
        world.disturb(iron_ut(at_us as f64 / 1e6));
        let truth = world.true_state(at_us);
        let field = world.sensor_field(at_us).ut * 10.0;
        let reported = source.report(&truth);
        let [roll_deg, pitch_deg] = [reported.roll_rad, reported.pitch_rad].map(f64::to_degrees);
        let (t_s, reference_deg, usable) = (at_us as f64 / 1e6, truth.heading_deg(), u8::from(i >= 100));
        let [x, y, z] = [field.x, field.y, field.z];
        // The mean of a tenth of a second, near enough: of its ends.
        let now = truth.body_rates_rad_s().map(f64::to_degrees);
        let [p, q, r] = std::array::from_fn(|axis| now[axis].midpoint(last.unwrap_or(now)[axis]));
        last = Some(now);
        write!(text, "{t_s},{x:.1},{y:.1},{z:.1},{roll_deg:.2},{pitch_deg:.2},{reference_deg:.2},{usable}").unwrap();
        writeln!(text, ",{p:.3},{q:.3},{r:.3}").unwrap();
    }
    rows_of(&read(text.as_bytes()), 0.0)
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

/// A recording with rates has a smooth heading once it has settled, which is better than the raw one: most of the noise of
/// 0.3 deg that lasts for half a second is smoothed away. One without has none, and is scored by the raw one.
#[test]
fn rates_make_the_heading_smooth() {
    let rms = |score: Option<Score>| score.unwrap().rms_deg;
    let mut ratios = Vec::new();
    for seed in 0..5 {
        let mut rows = recorded(&WorldConfig::random(seed), 3.0);
        let with = replay(&rows, &ALL);
        let number = with.shown.iter().filter(|shown| shown.smooth_deg.is_some()).count();
        assert!(number > rows.len() * 9 / 10, "seed {seed}: {number} of {}", rows.len());
        assert!(with.shown.iter().take(20).all(|shown| shown.smooth_deg.is_none()), "seed {seed}");
        ratios.push(rms(with.smooth) / rms(with.score));
        for row in &mut rows {
            row.rates_rad_s = None;
        }
        let without = replay(&rows, &ALL);
        assert!(without.shown.iter().all(|shown| shown.smooth_deg.is_none()), "seed {seed}");
        assert_eq!(without.smooth, without.score, "seed {seed}");
    }
    // Where the field is level, an error of attitude makes none of heading, and there is little to smooth.
    assert!(ratios.iter().all(|&ratio| ratio < 1.0), "{ratios:?}");
    assert!(ratios.iter().sum::<f64>() < 0.9 * ratios.len() as f64, "{ratios:?}");
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

/// Of too little flown a log's reader is told what to fly, as the module tells its pilot; there is no console to ask.
#[test]
fn a_refusal_tells_what_to_fly() {
    let of = |seed| replay(&recorded(&WorldConfig::random(seed), 0.0), &ALL);
    let inaccurate: Vec<_> = (0..10)
        .map(of)
        .filter(|replayed| matches!(replayed.accepted, Err(Refused::Rejected(Rejection::NotAccurate { .. }))))
        .collect();
    assert!(!inaccurate.is_empty());
    for replayed in inaccurate {
        let words = refusal(&replayed).unwrap().to_string();
        assert!(words.starts_with("expected error ") && words.contains(" deg; missing: "), "{words}");
    }
}

/// A payload that moves between the sides or in a turn, and a zero that drifts: refused for that, or allowed for in
/// what is expected of the iron of the end.
#[test]
fn a_flight_of_two_airframes_is_refused_or_honest() {
    let mut refused = 0;
    for seed in 0..6 {
        let world = WorldConfig::random(seed);
        for (name, iron_ut) in [
            ("between the sides", (|t_s| if t_s < 110.0 { [0.0; 3] } else { [3.0, -3.0, 3.0] }) as fn(f64) -> [f64; 3]),
            ("in a turn", |t_s| if t_s < 60.0 { [0.0; 3] } else { [-2.0, 2.0, 3.0] }),
            ("drift", |t_s| [0.03 * t_s, 0.02 * t_s, -0.03 * t_s]),
        ] {
            let rows = recorded_with(&world, 3.0, iron_ut);
            let replayed = replay(&rows, &TURNS);
            match replayed.accepted {
                Err(Refused::Rejected(Rejection::IronChanged(_)) | Refused::Solve(SolveError::IronChanged(_))) => {
                    refused += 1;
                }
                accepted => {
                    assert_eq!(accepted, Ok(()), "seed {seed} {name}");
                    let solution = replayed.solution.unwrap();
                    assert!(solution.iron.is_some(), "seed {seed} {name}");
                    let mut at_the_end = world;
                    at_the_end.airframe.b_ut += Vector3::from(iron_ut(205.0));
                    let error_deg = Errors::of(&solution.calibration, &at_the_end).figures().rms_deg;
                    let expected_deg = f64::from(solution.quality.expected_rms_deg);
                    assert!(error_deg < 2.0 * expected_deg, "seed {seed} {name}: {error_deg}, {expected_deg}");
                }
            }
        }
    }
    assert!(refused >= 9, "{refused}");
}

/// The wrong hemisphere's sign, or a chart of another place: the flight's own inclination is named.
#[test]
fn a_wrong_inclination_is_named() {
    for seed in 0..6 {
        let world = WorldConfig::random(seed);
        let rows = recorded(&world, 3.0);
        let true_deg = world.earth.inclination_deg;
        for told_deg in [true_deg + 10.0, true_deg - 20.0, if true_deg.abs() > 5.0 { -true_deg } else { 45.0 }] {
            let refused = replay(&rows, &Options { inclination_deg: Some(told_deg), ..TURNS }).accepted.unwrap_err();
            let Refused::Solve(SolveError::InclinationContradicted { found_deg }) = refused else {
                panic!("seed {seed}, told {told_deg}: {refused:?}");
            };
            assert!((f64::from(found_deg) - true_deg).abs() < 1.5, "seed {seed}, told {told_deg}: {found_deg}");
        }
    }
}

/// Radians in the columns of degrees, and a row a second: the refusal says so.
#[test]
fn what_is_wrong_with_a_recording_is_told() {
    let rows = recorded(&WorldConfig::table1(1), 3.0);
    let in_radians: Vec<Row> = rows
        .iter()
        .map(|&row| {
            let Attitude { roll_rad, pitch_rad } = row.attitude;
            let attitude = Attitude { roll_rad: roll_rad.to_radians(), pitch_rad: pitch_rad.to_radians() };
            Row { attitude, ..row }
        })
        .collect();
    let replayed = replay(&in_radians, &TURNS);
    assert!(replayed.accepted.is_err() && matches!(replayed.lack, Some(Lack::NoTilt { .. })), "{:?}", replayed.lack);
    let slow: Vec<Row> = rows.iter().step_by(10).copied().collect();
    let replayed = replay(&slow, &TURNS);
    assert!(replayed.accepted.is_err() && matches!(replayed.lack, Some(Lack::TooSlow { .. })), "{:?}", replayed.lack);
    assert_eq!(replay(&rows, &TURNS).lack, None);
}

/// A payload that moves: when, by how much and on which axis; and nothing of iron that stays.
#[test]
fn iron_that_changed_is_found_with_its_time_size_and_axis() {
    let world = WorldConfig::table1(1);
    for (moved, axis) in [([8.0, 0.0, 0.0], 'x'), ([0.0, -6.0, 2.0], 'y'), ([0.0; 3], ' ')] {
        let rows = recorded_with(&world, 3.0, |t_s| if t_s < 110.0 { [0.0; 3] } else { moved });
        let solution = replay(&rows, &ALL).solution;
        let calibration = solution.map(|solution| solution.calibration);
        let about = calibration.map_or_else(Iron::none, |calibration| Iron {
            matrix: calibration.w_matrix().map(f64::from),
            by_current_ut: Vector3::zeros(),
            centre_ut: calibration.b_vector_ut().map(f64::from),
        });
        let change = change::found(&rows, &about);
        if axis == ' ' {
            assert_eq!(change, None);
            continue;
        }
        let change = change.unwrap();
        assert!((change.at_s - 110.0).abs() < 2.0, "{change:?}");
        let off = (Vector3::from(change.ut) - Vector3::from(moved)).norm();
        assert!(off < 2.0 && change.axis() == axis, "{change:?}");
    }
}

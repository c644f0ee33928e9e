//! A flight recorded in the simulator, replayed: the answer is that of the module, whichever rows are used.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

use std::fmt::Write as _;

use autoswing::acceptance::Rejection;
use autoswing::calibration::SolveError;
use autoswing::collection::Lack;
use autoswing::frames::{Attitude, wrap_pi};
use host_sim::log::csv::Unit;
use host_sim::log::write::{Instant, Recording, csv, dataflash, tlog, ulog};
use host_sim::log::{self, Flight, Iron, Rotation};
use host_sim::replay::course::{Course, NoCourse};
use host_sim::replay::judge::{Asked, By, Judged, judge, scored};
use host_sim::replay::parameters::{self, Dialect, HandedOver};
use host_sim::replay::{Options, Reference, Refused, Row, Score, Selected, replay, rows, told};
use host_sim::score::Errors;
use host_sim::world::aircraft::Kind;
use host_sim::world::autopilot::Leg;
use host_sim::world::{CRUISE_A, World, WorldConfig};
use nalgebra::{Matrix3, Vector3};

const ALL: Options = Options { selected: Selected::All, inclination_deg: None, fit_until_s: None };
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
    rows_of(&log::read(&mut text.as_bytes(), Unit::Milligauss).unwrap(), 0.0)
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

/// How a native log is judged.
const ASKED: Asked = Asked::OF_THE_LOG;

/// ArduPilot's parameters of a compass that is badly calibrated, and PX4's.
const BAD: [(&str, f64); 16] = [
    ("COMPASS_OFS_X", 90.0),
    ("COMPASS_OFS_Y", -120.0),
    ("COMPASS_DIA_X", 1.1),
    ("COMPASS_DIA_Y", 0.9),
    ("COMPASS_DIA_Z", 1.05),
    ("COMPASS_ODI_X", 0.05),
    ("COMPASS_ODI_Z", -0.06),
    ("COMPASS_SCALE", 1.1),
    ("COMPASS_USE", 1.0),
    ("COMPASS_ORIENT", 0.0),
    ("CAL_MAG0_ID", 396_809.0),
    ("CAL_MAG0_ROT", 6.0),
    ("CAL_MAG0_XOFF", 0.15),
    ("CAL_MAG0_ZOFF", -0.1),
    ("CAL_MAG0_YSCALE", 1.1),
    ("CAL_MAG0_YODIAG", 0.04),
];

/// Turns both ways in still air, then legs, as an autopilot logs them whose field is so old.
fn flown(world: &WorldConfig, age_s: f64) -> Recording {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    for bank_deg in [25.0, 40.0] {
        world.fly(Leg::Straight { heading_deg: 0.0, seconds: 10.0 });
        for heading_change_deg in [720.0, -720.0] {
            world.fly(Leg::Turn { bank_deg, heading_change_deg });
        }
    }
    let mut recording = Recording::aged(age_s);
    recording.parameters = BAD.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    for i in 20..2400 {
        recording.take(&world, &mut source, i * 100_000);
    }
    recording
}

fn judged(bytes: &[u8]) -> (Flight, Judged) {
    let mut source = bytes;
    let flight = log::read(&mut source, Unit::Milligauss).unwrap();
    let mut verdict = judge(&flight, &ASKED);
    (flight, verdict.compasses.remove(0))
}

/// The same flight in each format, whatever its autopilot had applied: the field's age is found to ten milliseconds or,
/// where it rolls little, to what is told, and
/// the module's answer is as good as the attitude noise of 0.3 deg lets it be. The autopilot's own parameters are bad, and
/// shown to be.
#[test]
fn a_native_log_gives_the_heading_and_the_age_of_its_field() {
    let world = WorldConfig::random(3);
    let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
    for (age_s, write) in [(0.05, dataflash as fn(&Recording) -> Vec<u8>), (0.09, tlog), (0.02, ulog), (0.0, csv)] {
        let recording = flown(&world, age_s);
        let (flight, compass) = judged(&write(&recording));
        let name = flight.format.name();
        let most_s = 2.5 * compass.age.sigma_s.unwrap();
        assert!((compass.age.used_s - age_s).abs() < most_s.max(0.01), "{name}: {:?}", compass.age);
        assert_eq!(compass.module.accepted, Ok(()), "{name}");
        let ours = compass.by(By::Module).unwrap().score.unwrap();
        assert!(ours.rms_deg < 0.5 + noise_deg, "{name}: {ours:?}");
        if let Some(theirs) = compass.by(By::Autopilot) {
            assert!(theirs.score.unwrap().rms_deg > 2.0 * ours.rms_deg, "{name}: {theirs:?}");
        }
        let used = compass.rows.iter().filter(|row| row.usable).count();
        assert!(compass.counted.used == used && used > 2300, "{name}: {:?}", compass.counted);
    }
}

/// The file that is handed over, loaded and applied to the raw field by the autopilot's own formula, gives the error that
/// was told, and that is what the solution has but for what is told to be lost.
#[test]
fn parameters_give_what_they_say_when_they_are_applied() {
    for (seed, write, dialect) in [
        (3, dataflash as fn(&Recording) -> Vec<u8>, Dialect::ArduPilot),
        (5, ulog, Dialect::Px4),
        (7, tlog, Dialect::ArduPilot),
    ] {
        let (flight, compass) = judged(&write(&flown(&WorldConfig::random(seed), 0.05)));
        let handed = parameters::handed_over(&flight, &compass, Some(50.0), dialect).unwrap();
        let score = score_of_file(&flight, &compass, &handed, dialect);
        assert!((score.rms_deg - handed.score.unwrap().rms_deg).abs() < 0.05, "seed {seed}: {score:?} {handed:?}");
        let ours = compass.by(By::Module).unwrap().score.unwrap();
        let most = ours.rms_deg + handed.lost_deg[0] + 0.05;
        assert!(score.rms_deg < most, "seed {seed}: {score:?}, {ours:?}, {:?}", handed.lost_deg);
        // As strong as the Earth's field was said to be.
        let strengths: Vec<f64> = compass.rows.iter().map(|row| row.corrected(&handed.iron).norm()).collect();
        let mean = strengths.iter().sum::<f64>() / strengths.len() as f64;
        assert!((mean - 50.0).abs() < 1.5, "seed {seed}: {mean}");
    }
}

/// A compass that sits otherwise than its parameters say is given another number; ArduPilot asks an internal one for none, and
/// turns it as the board.
#[test]
fn an_internal_compass_is_given_no_orientation() {
    let (mut flight, compass) = judged(&dataflash(&flown(&WorldConfig::random(3), 0.05)));
    let mut handed = parameters::handed_over(&flight, &compass, None, Dialect::ArduPilot).unwrap();
    handed.turned = Rotation::new(2.0).unwrap();
    for (external, line) in [(1.0, "\nCOMPASS_ORIENT,2\n"), (0.0, "\n# COMPASS_ORIENT: COMPASS_EXTERNAL is 0")] {
        flight.parameters.set(0.0, "COMPASS_EXTERNAL", external);
        let text = parameters::file(&flight, std::slice::from_ref(&handed), Dialect::ArduPilot);
        assert!(text.contains(line), "{external}: {text}");
    }
}

/// Iron of 8 uT in level flight, by a current of 15 to 30 A that follows the bank: half a microtesla per ampere. It is found
/// with its sigma and used, headings are as good as they are without such iron, and who is not told the current errs by
/// more than what is expected of him who is. An autopilot that loads the file has the same.
#[test]
fn iron_by_current_is_found_and_handed_over() {
    for (seed, write, dialect) in [
        (3, dataflash as fn(&Recording) -> Vec<u8>, Dialect::ArduPilot),
        (5, ulog, Dialect::Px4),
        (7, tlog, Dialect::ArduPilot),
        (9, csv, Dialect::Px4),
    ] {
        let world = WorldConfig::random(seed).with_current(8.0);
        let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
        let (flight, compass) = judged(&write(&flown(&world, 0.05)));
        assert_eq!(compass.module.accepted, Ok(()), "seed {seed}");
        let iron = compass.module.solution.as_ref().unwrap().calibration.current;
        for (found, added_ut) in iron.ut_per_a.iter().zip(world.current_ut) {
            let off = f64::from(*found) - added_ut / CRUISE_A;
            assert!(
                off.abs() < 4.0 * f64::from(iron.sigma_ut_per_a) + 0.01,
                "seed {seed}: {iron:?} {:?}",
                world.current_ut
            );
        }
        let ours = compass.by(By::Module).unwrap().score.unwrap();
        assert!(ours.rms_deg < 0.5 + noise_deg, "seed {seed}: {ours:?}");
        assert!(
            compass.without_current_deg.unwrap() > 1.5 * ours.rms_deg,
            "seed {seed}: {:?}",
            compass.without_current_deg
        );
        let handed = parameters::handed_over(&flight, &compass, Some(50.0), dialect).unwrap();
        let score = score_of_file(&flight, &compass, &handed, dialect);
        assert!((score.rms_deg - handed.score.unwrap().rms_deg).abs() < 0.05, "seed {seed}: {score:?} {handed:?}");
        assert!(score.rms_deg < ours.rms_deg + handed.lost_deg[0] + 0.05, "seed {seed}: {score:?} {ours:?}");
        // Of what takes no current, the mean of it is a part of the offsets, and the rest is lost.
        let inav = parameters::handed_over(&flight, &compass, Some(50.0), Dialect::Inav).unwrap();
        assert!(inav.warnings.iter().any(|words| words.contains("current")), "seed {seed}: {:?}", inav.warnings);
        assert!(inav.lost_deg[0] > handed.lost_deg[0], "seed {seed}: {inav:?}");
        // Half a microtesla per ampere of another 10 A or so in a bank is degrees.
        let is_told = inav.warnings.iter().any(|words| words.contains("costs"));
        assert!(is_told && inav.lost_deg[0] > 0.3, "seed {seed}: {inav:?}");
        // To what is lost of the numbers, which are whole: half a milligauss, a gain of a thousandth.
        let score =
            scored(&compass.rows, &of_inav(&parameters::file(&flight, std::slice::from_ref(&inav), Dialect::Inav)))
                .unwrap();
        assert!((score.rms_deg - inav.score.unwrap().rms_deg).abs() < 0.1, "seed {seed}: {score:?} {inav:?}");
    }
}

/// What INAV makes of its zeros and gains: `(raw - zero) 1024 / gain`, raw in milligauss.
fn of_inav(text: &str) -> Iron {
    let of = |name: &str, axis: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("set {name}_{axis} = "))).unwrap();
        line.parse::<f64>().unwrap()
    };
    let each = |name: &str| Vector3::from(["x", "y", "z"].map(|axis| of(name, axis)));
    Iron::constant(Matrix3::from_diagonal(&each("maggain").map(|gain| 1024.0 / gain)), each("magzero") * 0.1)
}

/// ArduPilot takes no offset beyond a limit that can be set: whoever loads one is told before.
#[test]
fn offsets_that_are_not_taken_are_told() {
    let (mut flight, compass) = judged(&dataflash(&flown(&WorldConfig::random(3), 0.05)));
    let handed = parameters::handed_over(&flight, &compass, Some(50.0), Dialect::ArduPilot).unwrap();
    let largest_mg = handed.iron.centre_ut.amax() * 10.0;
    for (part, is_told) in [(0.95, true), (1.05, false)] {
        flight.parameters.set(f64::MAX, "COMPASS_OFFS_MAX", largest_mg * part);
        let handed = parameters::handed_over(&flight, &compass, Some(50.0), Dialect::ArduPilot).unwrap();
        assert_eq!(handed.warnings.iter().any(|words| words.contains("COMPASS_OFFS_MAX")), is_told, "{handed:?}");
    }
}

/// What the parameters of a file give, read as the autopilot would.
fn score_of_file(flight: &Flight, compass: &Judged, handed: &HandedOver, dialect: Dialect) -> Score {
    let text = parameters::file(flight, std::slice::from_ref(handed), dialect);
    let loaded = parameters::read_back(&text, &flight.parameters);
    assert_eq!(handed.turned.number(), 0, "mounted as the log says");
    let iron = match dialect {
        Dialect::Px4 => Iron::of_px4(&loaded, compass.number),
        Dialect::ArduPilot | Dialect::Inav => Iron::of_ardupilot(&loaded, compass.number),
    };
    scored(&compass.rows, &iron).unwrap()
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
        let change = host_sim::replay::change::found(&rows, &about);
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

/// A field in another unit and an attitude in radians are told by name; what is right is not doubted.
#[test]
fn units_that_cannot_be_are_told() {
    let world = WorldConfig::table1(1);
    // Where the field model has about the strength of that world, 48 uT.
    let text = csv(&Recording { place: Some([48.0, 11.3, 500.0]), ..flown(&world, 0.0) });
    let notes = |bytes: &[u8], unit: Unit| {
        let mut source = bytes;
        let flight = log::read(&mut source, unit).unwrap();
        told::notes(&flight, &judge(&flight, &ASKED)).join("; ")
    };
    assert_eq!(notes(&text, Unit::Milligauss), "");
    let in_ut = notes(&text, Unit::Microtesla);
    assert!(in_ut.contains("milligauss taken for microtesla"), "{in_ut}");
    let radians: String = String::from_utf8(text)
        .unwrap()
        .lines()
        .map(|line| {
            let mut values: Vec<String> = line.split(',').map(str::to_owned).collect();
            for value in &mut values[4..6] {
                if let Ok(degrees) = value.parse::<f64>() {
                    *value = format!("{:.5}", degrees.to_radians());
                }
            }
            values.join(",") + "\n"
        })
        .collect();
    let told = notes(radians.as_bytes(), Unit::Milligauss);
    assert!(told.contains("radians"), "{told}");
}

/// Readings in pairs, out of order and twice: as many samples as of a tidy log.
#[test]
fn readings_in_pairs_and_out_of_order_are_rows() {
    let text = String::from_utf8(csv(&flown(&WorldConfig::random(3), 0.0))).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let mut untidy = format!("{header}\n");
    let lines: Vec<&str> = lines.collect();
    for pair in lines.chunks(2) {
        for line in pair.iter().rev() {
            let (time, rest) = line.split_once(',').unwrap();
            let later: f64 = time.parse::<f64>().unwrap() + 0.002;
            writeln!(untidy, "{later:.3},{rest}\n{line}\n{line}").unwrap();
        }
    }
    let (tidy, untidy) = (judged(text.as_bytes()).1, judged(untidy.as_bytes()).1);
    assert!(untidy.rows.len().abs_diff(tidy.rows.len()) < 20, "{} {}", untidy.rows.len(), tidy.rows.len());
    assert_eq!(untidy.module.accepted, Ok(()));
    let [rms, before] = [&untidy, &tidy].map(|compass| compass.by(By::ModuleOfAll).unwrap().score.unwrap().rms_deg);
    assert!((rms - before).abs() < 0.1, "{rms} {before}");
}

/// A circle each way, then half a minute in each of these directions, at 48 N, with what a receiver says of it.
fn legs(world: &WorldConfig, headings_deg: &[f64]) -> Recording {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    for heading_change_deg in [360.0, -360.0] {
        world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    for &heading_deg in headings_deg {
        world.fly(Leg::Straight { heading_deg, seconds: 30.0 });
    }
    let mut recording = Recording { place: Some([48.0, 11.3, 500.0]), ..Recording::aged(0.0) };
    for i in 10..700 + headings_deg.len() as u64 * 300 {
        recording.take(&world, &mut source, i * 100_000);
    }
    recording
}

const ALL_ROUND_DEG: [f64; 6] = [10.0, 130.0, 250.0, 70.0, 190.0, 310.0];

fn read(bytes: &[u8]) -> Flight {
    let mut source = bytes;
    log::read(&mut source, Unit::Milligauss).unwrap()
}

fn in_wind(seed: u64, wind_m_s: f64) -> WorldConfig {
    let mut world = WorldConfig::random(seed);
    (world.weather.wind_m_s, world.weather.wind_from_deg) = (wind_m_s, 250.0);
    world
}

/// With wind and without, in each format, of a receiver that is 0.3 s late: headings of straight flight by GPS course are true,
/// each to a degree and those of each leg to 0.3 deg, where no gusts make a sideslip; a bank that wanders by 1.5 deg turns
/// it by 0.7 deg/s, and over MAVLink it is told of once a second. The yaw of a recording is the truth. Of turns there are none.
#[test]
fn gps_course_is_the_heading_of_straight_flight_whatever_the_wind() {
    for (seed, wind_m_s, write) in
        [(1, 0.0, dataflash as fn(&Recording) -> Vec<u8>), (1, 8.0, dataflash), (2, 8.0, tlog), (3, 10.0, ulog)]
    {
        let mut world = in_wind(seed, wind_m_s);
        world.weather.gust_m_s = 0.0;
        let flight = read(&write(&late(legs(&world, &ALL_ROUND_DEG))));
        let course = Course::of(&flight).unwrap();
        let name = format!("{:?}, {wind_m_s} m/s: {}", flight.format, course.limits());
        assert!((course.wind_speed_m_s() - wind_m_s).abs() < 0.2, "{name}");
        let is_from = (course.wind_from_deg() - 250.0).abs() < 2.0;
        assert!((is_from || wind_m_s == 0.0) && (course.airspeed_m_s - 22.0).abs() < 0.2, "{name}");
        let mut by_leg: [Vec<f64>; 12] = Default::default();
        for row in flight.attitude.rows() {
            let [roll_rad, _, yaw_rad] = row.of;
            let Some(found_rad) = course.at_rad(row.t_s) else { continue };
            assert!(roll_rad.abs() < 0.2, "{name}: banked by {roll_rad} at {}", row.t_s);
            let error_deg = f64::from(wrap_pi(found_rad - yaw_rad).to_degrees());
            assert!(error_deg.abs() < 1.0, "{name}: {error_deg} at {}", row.t_s);
            by_leg[(f64::from(yaw_rad).to_degrees().rem_euclid(360.0) / 30.0) as usize].push(error_deg);
        }
        assert!(by_leg.concat().len() > 900, "{name}: {}", by_leg.concat().len());
        for leg in by_leg.iter().filter(|leg| leg.len() > 100) {
            let mean_deg = leg.iter().sum::<f64>() / leg.len() as f64;
            assert!(mean_deg.abs() < 0.3, "{name}: {mean_deg}");
        }
    }
}

/// What the receiver says is 0.3 s old.
fn late(mut recording: Recording) -> Recording {
    let velocities: Vec<[f64; 2]> = recording.instants.iter().map(|instant| instant.velocity_m_s).collect();
    for (instant, velocity_m_s) in recording.instants.iter_mut().skip(3).zip(velocities) {
        instant.velocity_m_s = velocity_m_s;
    }
    recording
}

/// What is told against GPS course is what is told against the truth in straight flight: iron makes one cycle of error a turn,
/// and so would a wind that is solved from headings. Sideslip is more: of 100 s of gusts that last 1.5 s, a sixth of its sigma, and
/// thrice that is the bound.
#[test]
fn an_error_against_gps_course_is_that_against_the_truth() {
    for seed in 1..5 {
        let flight = read(&dataflash(&legs(&in_wind(seed, 7.0), &ALL_ROUND_DEG)));
        let course = Reference::best(&flight).unwrap();
        assert!(course.is_accuracy() && course.name() == "GPS course in straight flight", "{course:?}");
        let [by_course, mut by_truth] = [&course, &Reference::AutopilotYaw]
            .map(|reference| rows(&flight, &flight.compasses[0], 0.0, Some(reference)).0);
        for (truth, found) in by_truth.iter_mut().zip(&by_course) {
            truth.reference_deg = truth.reference_deg.filter(|_| found.reference_deg.is_some());
        }
        let [found, truth] = [by_course, by_truth].map(|rows| scored(&rows, &Iron::none()).unwrap());
        let sigma_deg = course.course().unwrap().sigma_deg();
        assert!(truth.rms_deg > 3.0, "seed {seed}: too good a compass to tell, {truth:?}");
        assert!((found.rms_deg - truth.rms_deg).abs() < sigma_deg / 2.0, "seed {seed}: {found:?} {truth:?}");
        assert!((found.mean_deg - truth.mean_deg).abs() < sigma_deg / 2.0, "seed {seed}: {found:?} {truth:?}");
    }
}

/// Each is refused for what it is, and the note says so where there is only the autopilot's yaw.
#[test]
fn gps_course_is_refused_where_it_tells_no_heading() {
    let plane = legs(&in_wind(1, 5.0), &ALL_ROUND_DEG);
    let changed = |change: &dyn Fn(&mut Instant, f64)| {
        let mut recording = plane.clone();
        let number = recording.instants.len() as f64;
        for (i, instant) in recording.instants.iter_mut().enumerate() {
            change(instant, i as f64 / number);
        }
        recording
    };
    let add = |instant: &mut Instant, [north, east]: [f64; 2]| {
        instant.velocity_m_s[0] += north;
        instant.velocity_m_s[1] += east;
    };
    for (why, recording) in [
        (NoCourse::FewDirections, legs(&in_wind(1, 5.0), &[30.0, 210.0, 30.0, 210.0])),
        (NoCourse::Windy, legs(&in_wind(1, 12.0), &ALL_ROUND_DEG)),
        (NoCourse::Copter, Recording { is_copter: true, ..plane.clone() }),
        // The wind turns.
        (NoCourse::UncertainWind, changed(&|instant, part| add(instant, [6.0 * part, -6.0 * part]))),
        // Airspeed comes and goes.
        (
            NoCourse::NoCircle,
            changed(&|instant, part| {
                let by = 1.0 + 0.5 * (part * 200.0).sin();
                instant.velocity_m_s = instant.velocity_m_s.map(|axis| axis * by);
            }),
        ),
        (NoCourse::Slow, changed(&|instant, _| instant.velocity_m_s = instant.velocity_m_s.map(|axis| axis * 0.3))),
        // It goes round, and its nose does not.
        (
            NoCourse::NoseElsewhere,
            changed(&|instant, _| {
                instant.rates_rad_s = [0.001, 0.0, 0.0];
                instant.attitude_rad = [0.0, 0.0, 1.0];
            }),
        ),
    ] {
        let flight = read(&dataflash(&recording));
        assert_eq!(Course::of(&flight).unwrap_err(), why);
        assert_eq!(Reference::best(&flight), Some(Reference::AutopilotYaw), "{why:?}");
        let notes = told::notes(&flight, &judge(&flight, &ASKED)).join("; ");
        assert!(notes.contains(why.words()), "{why:?}: {notes}");
    }
}

/// A copter that is not known as one hovers, and is pushed about at one heading faster than a slow aeroplane.
#[test]
fn a_copter_is_not_compared_with_its_course() {
    let mut config = in_wind(1, 2.0);
    config.aircraft.kind = Kind::Copter;
    let world = World::new(config);
    let mut source = world.attitude_source();
    for i in 0..8 {
        world.fly(Leg::Push { toward_deg: f64::from(i) * 45.0, tilt_deg: 15.0, seconds: 20.0 });
        world.fly(Leg::Hover { seconds: 10.0 });
    }
    let mut recording = Recording { place: Some([48.0, 11.3, 500.0]), ..Recording::aged(0.0) };
    for i in 10..2400 {
        recording.take(&world, &mut source, i * 100_000);
    }
    assert_eq!(Course::of(&read(&ulog(&recording))).unwrap_err(), NoCourse::Copter);
    recording.is_copter = false;
    assert!(Course::of(&read(&ulog(&recording))).is_err());
}

/// What a script reads of it is there and described.
#[test]
fn gps_course_is_told_with_its_limits() {
    let flight = read(&tlog(&legs(&in_wind(1, 5.0), &ALL_ROUND_DEG)));
    let verdict = judge(&flight, &ASKED);
    let told = told::json(&flight, &verdict, &|_| serde_json::Value::Null);
    let reference = &told["reference"];
    assert_eq!(reference["is_accuracy"], true);
    assert!((reference["course"]["wind_m_s"].as_f64().unwrap() - 5.0).abs() < 0.2, "{reference}");
    let limits = reference["limits"].as_str().unwrap();
    assert!(["no compass", "5.0 m/s from 250", "sideslip", "banked"].iter().all(|of| limits.contains(of)), "{limits}");
    let described = include_str!("../docs/your-flight.md");
    for field in reference["course"].as_object().unwrap().keys() {
        assert!(described.contains(&format!("`{field}`")), "{field}: docs/your-flight.md");
    }
}

/// The best first: a simulator's truth, two antennas, course, the autopilot's yaw.
#[test]
fn references_are_ranked() {
    let mut flight = read(&dataflash(&legs(&in_wind(1, 5.0), &ALL_ROUND_DEG)));
    let best = |flight: &Flight| Reference::best(flight).unwrap().name();
    let mut ranked = vec![best(&flight)];
    for row in flight.gps.rows_mut() {
        row.of[5] = 90.0;
    }
    ranked.push(best(&flight));
    flight.truth = flight.attitude.clone();
    ranked.push(best(&flight));
    assert_eq!(ranked, ["GPS course in straight flight", "GPS yaw", "the simulator's own attitude"]);
}

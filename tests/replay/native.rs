//! The same flight as each autopilot logs it, and the parameters that are handed over.

use std::fmt::Write as _;

use host_sim::log::csv::Unit;
use host_sim::log::write::{Recording, csv, dataflash, tlog, turns, ulog};
use host_sim::log::{self, Flight, Iron, Rotation};
use host_sim::replay::judge::{Asked, By, Judged, judge, scored};
use host_sim::replay::parameters::{self, Dialect, HandedOver};
use host_sim::replay::{Score, told};
use host_sim::world::{CRUISE_A, WorldConfig};
use nalgebra::{Matrix3, Vector3};

use crate::{ASKED, read};

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

/// Turns both ways, as an autopilot with bad parameters logs them whose field is so old.
fn flown(world: &WorldConfig, age_s: f64) -> Recording {
    let parameters = BAD.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    Recording { parameters, ..turns(world, age_s) }
}

fn judged(bytes: &[u8]) -> (Flight, Judged) {
    let flight = read(bytes);
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
        assert_eq!(compass.without_current_deg, None, "{name}: nothing goes with the current");
        if let Some(theirs) = compass.by(By::Autopilot) {
            assert!(theirs.score.unwrap().rms_deg > 2.0 * ours.rms_deg, "{name}: {theirs:?}");
        }
        let used = compass.rows.iter().filter(|row| row.usable).count();
        assert!(compass.counted.used == used && used > 2300, "{name}: {:?}", compass.counted);
    }
}

/// Rows on the ground beside a steel hangar, disarmed: no calibrator is given them, and the strength is that of the flight. One
/// compass of two that is asked for is judged, and no other.
#[test]
fn what_is_not_flown_is_given_to_nobody() {
    let world = WorldConfig::table1(1);
    let mut recording = turns(&world, 0.0);
    for (i, instant) in recording.instants.iter_mut().enumerate() {
        instant.is_armed = i >= 400;
        if !instant.is_armed {
            instant.field_ut[0] = [300.0, -200.0 + i as f64 / 10.0, 100.0];
        }
        instant.field_ut.push([1.0, 2.0, 3.0]);
    }
    let (_, compass) = judged(&csv(&recording));
    assert!((compass.radius_ut.unwrap() - 48.0).abs() < 3.0, "{:?} uT", compass.radius_ut);
    for by in [By::Sphere, By::Ellipsoid] {
        // Soft iron is what a sphere leaves.
        assert!(compass.by(by).unwrap().score.unwrap().rms_deg < 10.0, "{by:?}: {:?}", compass.by(by));
    }
    let flight = read(&dataflash(&recording));
    let verdict = judge(&flight, &Asked { compass: Some(2), ..ASKED });
    assert_eq!((flight.compasses.len(), verdict.compasses.len(), verdict.compasses[0].number), (2, 1, 2));
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

/// The field model's inclination is told to the module where the model holds on that day, and nowhere else: what it says of
/// another decade is not what a flight is known by. Where the world is 12 deg off it, it gives way, as in the module: what is found
/// is what is found without.
#[test]
fn an_inclination_of_another_day_is_not_told() {
    for (inclination_deg, is_right) in [(64.0, true), (52.0, false)] {
        let mut world = WorldConfig::random(3);
        world.earth.inclination_deg = inclination_deg;
        let recording = Recording { place: Some([48.0, 11.3, 500.0]), ..turns(&world, 0.0) };
        let flight = read(&dataflash(&recording));
        let of_that_day = judge(&flight, &ASKED);
        let of_another = judge(&Flight { day: None, ..flight }, &ASKED);
        for (verdict, is_valid) in [(&of_that_day, true), (&of_another, false)] {
            let (earth, is) = verdict.earth.as_ref().unwrap();
            assert!(*is == is_valid && (earth.inclination_deg - 64.0).abs() < 1.0, "{earth:?}");
            assert_eq!(verdict.compasses[0].module.accepted, Ok(()), "{inclination_deg} deg, {is_valid}");
        }
        let [told, untold] =
            [of_that_day, of_another].map(|verdict| verdict.compasses[0].all.solution.unwrap().calibration);
        assert_eq!(told != untold, is_right, "{inclination_deg}: {told:?}");
    }
}

/// A flight whose iron moves by 8 uT at so many seconds, judged; its field is not old.
fn moved(world: &WorldConfig, at_s: u64) -> Judged {
    let mut recording = turns(world, 0.0);
    for instant in recording.instants.iter_mut().filter(|instant| instant.at_us >= at_s * 1_000_000) {
        instant.field_ut[0][0] += 8.0;
    }
    judged(&csv(&recording)).1
}

/// Whenever it moves, and however far the iron that is looked from is off, all of the step is found: to 0.3 uT, as a sixth of
/// the flight on one side tells it, at the row where it is. Rows begin two seconds after the clock.
#[test]
fn the_whole_step_of_the_iron_is_found_whenever_it_is() {
    for world in [WorldConfig::table1(1), WorldConfig::random(3), WorldConfig::random(5)] {
        for at_s in [40, 120, 180] {
            let change = moved(&world, at_s).change;
            let change = change.unwrap_or_else(|| panic!("{at_s} s, {} deg", world.earth.inclination_deg));
            let off_ut = Vector3::from(change.ut) - Vector3::new(8.0, 0.0, 0.0);
            assert!(off_ut.norm() < 0.3 && (change.at_s + 2.0 - at_s as f64).abs() < 0.5, "{at_s} s: {change:?}");
        }
    }
}

/// Iron that moves in the last circle: what the part before it gives alone is told first, and is much better than what the part
/// after it gives, with one turn to one side.
#[test]
fn the_part_before_a_change_is_told_first() {
    let compass = moved(&WorldConfig::random(3), 180);
    let &[before, after] = compass.parts.as_slice() else { panic!("{:?}", compass.parts) };
    let before_deg = before.unwrap();
    assert!(before_deg < 1.0 && after.is_none_or(|deg| deg > 2.0 * before_deg), "{:?}", compass.parts);
}

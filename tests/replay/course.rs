//! What headings are compared with: GPS course, and what is better or worse than it.

use autoswing::frames::wrap_pi;
use host_sim::log::write::{Instant, Recording, dataflash, tlog, ulog};
use host_sim::log::{Flight, Iron};
use host_sim::replay::course::{Course, NoCourse};
use host_sim::replay::judge::{judge, scored};
use host_sim::replay::{Reference, rows, told};
use host_sim::world::aircraft::Kind;
use host_sim::world::autopilot::Leg;
use host_sim::world::{World, WorldConfig};

use crate::{ASKED, read};

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
    let described = include_str!("../../docs/your-flight.md");
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

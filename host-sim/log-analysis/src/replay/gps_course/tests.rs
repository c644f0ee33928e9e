use testkit::random::Random;

use super::*;
use crate::log::LogFormat;
use crate::test_flight::{body_rates_rad_s, flight_of_motion};

/// 20 s at 10 Hz with a bank and a turn rate in the eleventh second, degrees. Zero rates would count as missing.
fn heading_integral(bank_deg: f32, turn_deg_s: f32) -> NoseHeadings {
    let flight = flight_of_motion(10.0, 200, |t_s| {
        let is_eleventh_second = (10.0..11.0).contains(&t_s);
        let [roll, turn] =
            [bank_deg, turn_deg_s].map(|angle| 0.001 + if is_eleventh_second { angle.to_radians() } else { 0.0 });
        ([roll, 0.0, 0.0], [0.0, 0.0, turn])
    });
    NoseHeadings::from_flight(&flight).unwrap()
}

/// The time margin before and after must be straight too; beyond the ends of the data this is unknown.
#[test]
fn straight_is_neither_banked_nor_turning() {
    for (name, heading_integral, is_straight) in [
        ("level", heading_integral(0.0, 0.0), true),
        ("in a gust", heading_integral(5.0, 2.0), true),
        ("slipping", heading_integral(15.0, 0.0), false),
        ("turning flat", heading_integral(0.0, 20.0), false),
    ] {
        let times_s =
            [(5.0, true), (8.5, false), (9.0, false), (10.5, false), (12.0, false), (12.5, false), (15.0, true)];
        for (t_s, is_far) in times_s {
            assert_eq!(heading_integral.is_straight(t_s), is_straight || is_far, "{name} at {t_s}");
        }
        assert!(!heading_integral.is_straight(1.0) && !heading_integral.is_straight(19.0), "{name}");
    }
}

/// One velocity in eight is a climb at two thirds of the airspeed, of zero weight. Of 700 velocities with noise of 0.3 m/s
/// a component of the wind has a sigma of 0.016 m/s.
#[test]
fn a_climb_does_not_move_the_circle() {
    for (noise_m_s, limit_m_s) in [(0.0, 1e-9), (0.3, 0.06)] {
        let circle = VelocityCircle::fit_robustly(&velocities_with_climbs(noise_m_s)).unwrap();
        let off_m_s = (circle.wind_m_s - Vector2::new(3.0, -5.0)).norm();
        assert!(off_m_s < limit_m_s && (circle.radius_m_s - 21.0).abs() < limit_m_s, "{noise_m_s}: {circle:?}");
    }
}

fn velocities_with_climbs(noise_m_s: f32) -> Vec<GroundVelocity> {
    let mut random = Random(1);
    let velocity_at = |i: u32| {
        let (sin, cos) = libm::sincos(f64::from(i) * 0.1);
        let air = if i.is_multiple_of(8) { Vector2::new(14.0, 0.0) } else { Vector2::new(cos, sin) * 21.0 };
        let noise = Vector2::from_fn(|_, _| f64::from(noise_m_s * random.normal()));
        GroundVelocity { t_s: f64::from(i), velocity_m_s: air + noise + Vector2::new(3.0, -5.0) }
    };
    (0..800).map(velocity_at).collect()
}

/// A third of a circle.
#[test]
fn the_initial_fit_is_exact_without_noise() {
    let velocities = velocities_at_headings(20.0, 0.0, 1.0, circle_headings(20));
    let circle = VelocityCircle::initial_fit(&velocities).unwrap();
    assert!((circle.wind_m_s - CIRCLE.wind_m_s).norm() < 1e-9 && (circle.radius_m_s - 20.0).abs() < 1e-9, "{circle:?}");
}

/// A wind that is uncertain by 1 m/s across an air velocity of 20 m/s, and a sideslip of 1.5 deg: 2.86 and 1.5 deg.
#[test]
fn the_sigma_of_a_heading_is_that_of_wind_and_sideslip() {
    let course = GpsCourseHeading {
        wind_m_s: CIRCLE.wind_m_s.into(),
        wind_sigma_m_s: 1.0,
        airspeed_m_s: 20.0,
        scatter_m_s: 0.2,
        widest_gap_deg: 120.0,
        heading: Series::new(),
    };
    assert!((course.sigma_deg() - 3.23).abs() < 0.01, "{}", course.sigma_deg());
}

/// Velocities at given headings, `interval_s` apart, in a wind that drifts east.
fn velocities_at_headings(
    airspeed_m_s: f64,
    drift_m_s: f64,
    interval_s: f64,
    headings_deg: impl IntoIterator<Item = f64>,
) -> Vec<GroundVelocity> {
    let headings: Vec<f64> = headings_deg.into_iter().collect();
    let count = headings.len() as f64;
    let velocity_at = |(i, heading_deg): (usize, &f64)| {
        let (sin, cos) = libm::sincos(heading_deg.to_radians());
        let wind = Vector2::new(1.0, -2.0 + drift_m_s * (i as f64 / count - 0.5));
        GroundVelocity { t_s: i as f64 * interval_s, velocity_m_s: Vector2::new(cos, sin) * airspeed_m_s + wind }
    };
    headings.iter().enumerate().map(velocity_at).collect()
}

fn circle_headings(count: u16) -> impl Iterator<Item = f64> {
    (0..count).map(|i| f64::from(i) * 6.0)
}

/// Legs of a heading and a duration in seconds, at 5 Hz.
fn velocities_on_legs(legs: &[(f64, u16)]) -> Vec<GroundVelocity> {
    velocities_at_headings(
        20.0,
        0.0,
        0.2,
        legs.iter().flat_map(|&(heading_deg, seconds)| (0..5 * seconds).map(move |_| heading_deg)),
    )
}

const CIRCLE: VelocityCircle = VelocityCircle { wind_m_s: Vector2::new(1.0, -2.0), radius_m_s: 20.0 };

/// Ten legs of 20 s, each 120 deg to the right of the last, in a wind from north-west: rows at 10 Hz, velocities at 5 Hz.
/// The motion is exact, but that a turn begins and ends at once.
fn flight_of_legs(airspeed_m_s: f64, turn_deg: f64) -> LoggedFlight {
    const TURN_S: f64 = 8.0;
    let heading_rad = |t_s: f64| {
        let (leg, leg_s) = ((t_s / 28.0).floor(), t_s % 28.0);
        (7.0 + turn_deg * (leg + (leg_s - 20.0).max(0.0) / TURN_S)).to_radians()
    };
    let mut flight = flight_of_motion(10.0, 2800, |t_s| {
        let is_turning = t_s % 28.0 > 20.0;
        let (roll_rad, turn_rad_s) =
            if is_turning { (0.5, (turn_deg / TURN_S).to_radians() as f32) } else { (0.01, 0.0) };
        let (sin_roll, cos_roll) = libm::sincosf(roll_rad);
        ([roll_rad, 0.0, f32::NAN], [0.001, turn_rad_s * sin_roll, turn_rad_s * cos_roll])
    });
    for t_s in (0..1400).map(|i| f64::from(i) / 5.0) {
        let (sin, cos) = libm::sincos(heading_rad(t_s));
        let [north, east] = [airspeed_m_s * cos - 4.0, airspeed_m_s * sin + 3.0];
        let (speed_m_s, course_deg) = (libm::hypot(north, east) as f32, libm::atan2(east, north).to_degrees() as f32);
        flight.gps.push_row(t_s, [48.0, 11.0, 500.0, speed_m_s, course_deg, f32::NAN]);
    }
    flight
}

/// Errors are those of `f32` velocities.
#[test]
fn wind_airspeed_and_heading_of_straight_legs_are_exact() {
    let course = GpsCourseHeading::from_flight(&flight_of_legs(20.0, 120.0)).unwrap();
    let wind_off_m_s = libm::hypot(course.wind_m_s[0] + 4.0, course.wind_m_s[1] - 3.0);
    assert!(wind_off_m_s < 1e-3 && (course.airspeed_m_s - 20.0).abs() < 1e-3, "{course:?}");
    assert!(course.wind_sigma_m_s < 1e-3 && course.scatter_m_s < 1e-3, "{course:?}");
    assert!((course.widest_gap_deg - 120.0).abs() < 1e-9, "{}", course.widest_gap_deg);
    assert!((course.wind_speed_m_s() - 5.0).abs() < 1e-3 && (course.wind_from_deg() - 323.13).abs() < 0.01);
    assert!(course.accuracy_description().contains("a wind of 5.0 m/s from 323 deg true"));
    for leg in 0..10_u8 {
        let from_s = 28.0 * f64::from(leg);
        let heading_deg = f64::from(course.heading_rad(from_s + 10.0).unwrap()).to_degrees();
        let off_deg = (heading_deg - 7.0 - 120.0 * f64::from(leg) + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off_deg.abs() < 0.01, "{leg}: {heading_deg}");
        assert_eq!(course.heading_rad(from_s + 24.0), None, "in the turn after leg {leg}");
    }
}

#[test]
fn a_flight_without_a_heading_by_gps_course_is_rejected_with_its_reason() {
    type Change = fn(&mut LoggedFlight);
    let vary_airspeed: Change =
        |flight| flight.gps.rows_mut().iter_mut().for_each(|row| row.row_values[3] *= 1.0 + libm::sinf(row.t_s as f32));
    let reverse_turn: Change =
        |flight| flight.body_rates.rows_mut().iter_mut().for_each(|row| row.row_values[2] *= -1.0);
    let cases: [(f64, f64, Change, GpsCourseRejection); 8] = [
        (20.0, 120.0, |flight| flight.gps = Series::new(), GpsCourseRejection::NotLogged),
        (20.0, 120.0, |flight| flight.is_copter = true, GpsCourseRejection::Copter),
        (20.0, 120.0, |flight| flight.body_rates = Series::new(), GpsCourseRejection::NoRates),
        (7.5, 120.0, |_| {}, GpsCourseRejection::TooSlow),
        (9.0, 120.0, |_| {}, GpsCourseRejection::StrongWind),
        (20.0, 180.0, |_| {}, GpsCourseRejection::FewDirections),
        (20.0, 120.0, vary_airspeed, GpsCourseRejection::NoCircle),
        (20.0, 120.0, reverse_turn, GpsCourseRejection::NoseMismatch),
    ];
    for (airspeed_m_s, turn_deg, change, reason) in cases {
        let mut flight = flight_of_legs(airspeed_m_s, turn_deg);
        change(&mut flight);
        assert_eq!(GpsCourseHeading::from_flight(&flight).map(|_| ()), Err(reason), "{}", reason.description());
    }
}

/// A heading rate that is linear in time, at a bank and a pitch, at irregular intervals: the trapezoidal rule is exact.
#[test]
fn the_heading_is_integrated_from_the_rates_of_a_banked_aircraft() {
    let mut flight = LoggedFlight::new(LogFormat::ULog);
    let (roll_rad, pitch_rad) = (0.5, -0.2);
    let time_s = |i: u32| f64::from(i) * 0.1 + f64::from(i % 3) * 0.03;
    let heading_at_rad = |t_s: f64| 0.1 * t_s + 0.02 * t_s * t_s;
    for i in 0..100 {
        let turn_rad_s = 0.1 + 0.04 * time_s(i);
        flight.attitude.push_row(time_s(i), [roll_rad as f32, pitch_rad as f32, f32::NAN]);
        let rates_rad_s =
            body_rates_rad_s(&Vector3::new(roll_rad, pitch_rad, 0.0), &Vector3::new(0.0, 0.0, turn_rad_s));
        flight.body_rates.push_row(time_s(i), rates_rad_s.map(|rate| rate as f32));
    }
    let heading_integral = NoseHeadings::from_flight(&flight).unwrap();
    assert_eq!(heading_integral.banked_times_s.len(), 100);
    for i in 0..99 {
        let integrated_rad = heading_integral.integrated_heading_rad(time_s(i)).unwrap();
        assert!((integrated_rad - heading_at_rad(time_s(i))).abs() < 1e-5, "{i}: {integrated_rad}");
        let [before_rad, after_rad] = [i, i + 1].map(|i| heading_at_rad(time_s(i)));
        let between_s = 0.75 * time_s(i) + 0.25 * time_s(i + 1);
        let integrated_rad = heading_integral.integrated_heading_rad(between_s).unwrap();
        assert!((integrated_rad - 0.75 * before_rad - 0.25 * after_rad).abs() < 1e-5, "{i}: {integrated_rad}");
    }
    assert_eq!(heading_integral.integrated_heading_rad(-0.1), None);
    assert_eq!(heading_integral.integrated_heading_rad(10.0), None);
}

/// Three legs, 120 deg apart.
const ALL_ROUND_LEGS: [(f64, u16); 3] = [(2.0, 10), (122.0, 10), (242.0, 10)];

fn full_circles(drift_m_s: f64) -> Vec<GroundVelocity> {
    velocities_at_headings(20.0, drift_m_s, 1.0, circle_headings(1200))
}

#[test]
fn the_scatter_of_straight_flight_is_its_rms_distance_from_the_circle() {
    let circle = VelocityCircle { radius_m_s: 19.8, ..CIRCLE };
    let straight = velocities_on_legs(&ALL_ROUND_LEGS);
    let course = GpsCourseHeading::from_fitted_circle(&circle, &full_circles(0.0), &straight);
    assert!(course.is_ok_and(|course| (course.scatter_m_s - 0.2).abs() < 1e-9));
}

/// Taxiing and hover are far slower than cruise.
#[test]
fn slow_or_short_movement_is_not_flight() {
    let still = |speed_m_s: f64, count: usize| {
        vec![GroundVelocity { t_s: 0.0, velocity_m_s: Vector2::new(speed_m_s, 0.0) }; count]
    };
    assert_eq!(velocities_in_flight([still(20.0, 100), still(4.5, 50)].concat()).map(|flown| flown.len()), Some(100));
    assert!(velocities_in_flight(still(20.0, 10)).is_none() && velocities_in_flight(still(2.0, 100)).is_none());
}

/// All headings are in the middle of a bin of 5 deg.
#[test]
fn straight_legs_must_be_long_enough_and_all_round() {
    for (name, legs, gap_deg, is_enough) in [
        ("three directions", &ALL_ROUND_LEGS[..], 120.0, true),
        ("a brief third leg", &[(2.0, 10), (122.0, 10), (242.0, 2)], 240.0, false),
        ("out and back", &[(2.0, 10), (182.0, 10)], 180.0, false),
        ("to one side", &[(62.0, 10), (122.0, 10), (182.0, 10)], 240.0, false),
    ] {
        let straight = velocities_on_legs(legs);
        let found_deg = widest_gap_deg(&straight, &CIRCLE);
        assert!((found_deg - gap_deg).abs() < 1e-9, "{name}: {found_deg}");
        let course = GpsCourseHeading::from_fitted_circle(&CIRCLE, &full_circles(0.0), &straight);
        assert_eq!(course.err(), (!is_enough).then_some(GpsCourseRejection::FewDirections), "{name}");
    }
    assert!((widest_gap_deg(&[], &CIRCLE) - 360.0).abs() < 1e-9);
    // Gusts spread a leg over several bins, whose times add up.
    for around in [[(237.0, 2), (242.0, 2)], [(242.0, 2), (247.0, 2)]] {
        let gusty = velocities_on_legs(&[&ALL_ROUND_LEGS[..2], &around[..]].concat());
        let found_deg = widest_gap_deg(&gusty, &CIRCLE);
        assert!((found_deg - (around[0].0 - 122.0).max(362.0 - around[1].0)).abs() < 1e-9, "{around:?}: {found_deg}");
    }
    // A pause within a leg does not count as flown.
    let mut paused = velocities_on_legs(&[(2.0, 10), (122.0, 10), (242.0, 2)]);
    paused[105..].iter_mut().for_each(|velocity| velocity.t_s += 10.0);
    assert!(widest_gap_deg(&paused, &CIRCLE) > 235.0);
}

/// A linear drift by `D` has variance `D²/12`, half in each component; the jackknife of ten parts adds a ninth: sigma
/// 0.22 `D`, up to a third more by Tukey's weights. An uncertainty of 5 % of the airspeed is 2.9 deg of heading.
#[test]
fn a_drifting_wind_is_uncertain() {
    for (drift_m_s, is_certain) in [(3.0, true), (7.0, false)] {
        let fitted = full_circles(drift_m_s);
        let sigma_m_s = VelocityCircle::wind_sigma_m_s(&fitted).unwrap();
        assert!((0.95..1.35).contains(&(sigma_m_s / (0.22 * drift_m_s))), "{drift_m_s}: {sigma_m_s}");
        let course = GpsCourseHeading::from_fitted_circle(&CIRCLE, &fitted, &velocities_on_legs(&ALL_ROUND_LEGS));
        assert_eq!(course.err(), (!is_certain).then_some(GpsCourseRejection::UncertainWind), "{drift_m_s}");
    }
}

/// Whole turns in gaps are not counted, and a course that turns by 3 deg/s need not be a turn of the aircraft.
#[test]
fn the_gyro_heading_must_follow_the_course() {
    // The nose turns by a share of 6 deg between velocities, and by an angle after a minute.
    let nose = |share: f64, points: &[GroundVelocity], turned_rad: f64| {
        let step_rad = 6_f64.to_radians() * share;
        let at = |(i, v): (usize, &GroundVelocity)| {
            (v.t_s, i as f64 * step_rad + if v.t_s > 60.0 { turned_rad } else { 0.0 })
        };
        let integral = HeadingIntegral::from_points(points.iter().enumerate().map(at), MAX_GAP_S);
        NoseHeadings { integral, banked_times_s: Vec::new() }
    };
    let velocities = velocities_at_headings(20.0, 0.0, 0.5, circle_headings(240));
    let slow = velocities_at_headings(20.0, 0.0, 0.5, (0..240).map(|i| f64::from(i) * 1.5));
    let mut with_gap = velocities.clone();
    with_gap[120..].iter_mut().for_each(|v| v.t_s += 20.0);
    let mut legs = with_gap.clone();
    for (i, leg) in legs.iter_mut().enumerate() {
        leg.velocity_m_s = velocities[usize::from(i >= 120)].velocity_m_s;
    }
    for (name, share, flown, turned_rad, is_followed) in [
        ("as the course", 1.0, &velocities, 0.0, true),
        ("half as far", 0.5, &velocities, 0.0, false),
        ("in the opposite sense", -1.0, &velocities, 0.0, false),
        ("in a slow turn of the course", -0.25, &slow, 0.0, true),
        ("in a gap", 0.0, &legs, 9.0, true),
    ] {
        let found = nose(share, flown, turned_rad).nose_turns_with_velocity(flown, &CIRCLE);
        assert_eq!(found, is_followed, "the nose turns {name}");
    }
    let integral = nose(1.0, &with_gap, 0.0);
    assert!(integral.integrated_heading_rad(75.0).is_none() && integral.integrated_heading_rad(30.1).is_some());
}

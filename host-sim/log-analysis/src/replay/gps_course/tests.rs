use testkit::random::Random;

use super::*;
use crate::test_flight::flight_of_motion;

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

/// Three legs, 120 deg apart.
const ALL_ROUND_LEGS: [(f64, u16); 3] = [(2.0, 10), (122.0, 10), (242.0, 10)];

fn full_circles(drift_m_s: f64) -> Vec<GroundVelocity> {
    velocities_at_headings(20.0, drift_m_s, 1.0, circle_headings(1200))
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

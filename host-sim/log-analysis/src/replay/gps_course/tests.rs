use super::*;
use crate::log::LogFormat;

/// 20 s at 10 Hz with a bank and a turn rate in the eleventh second, degrees. Zero rates would count as missing.
fn heading_integral(bank_deg: f32, turn_deg_s: f32) -> HeadingIntegral {
    let mut flight = Flight::new(LogFormat::ULog);
    for i in 0..200 {
        let is_eleventh_second = (100..110).contains(&i);
        let [roll, turn] =
            [bank_deg, turn_deg_s].map(|angle| 0.001 + if is_eleventh_second { angle.to_radians() } else { 0.0 });
        flight.attitude.push_row(f64::from(i) / 10.0, [roll, 0.0, 0.0]);
        flight.body_rates.push_row(f64::from(i) / 10.0, [0.0, 0.0, turn]);
    }
    HeadingIntegral::from_flight(&flight).unwrap()
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
        for (t_s, is_far) in [(5.0, true), (8.5, false), (10.5, false), (12.5, false), (15.0, true)] {
            assert_eq!(heading_integral.is_straight(t_s), is_straight || is_far, "{name} at {t_s}");
        }
        assert!(!heading_integral.is_straight(1.0) && !heading_integral.is_straight(19.0), "{name}");
    }
}

/// One velocity in eight is a climb at two thirds of the airspeed.
#[test]
fn a_climb_does_not_move_the_circle() {
    let velocity_at = |i: u32| {
        let (sin, cos) = libm::sincos(f64::from(i) * 0.1);
        let air = if i.is_multiple_of(8) { Vector2::new(14.0, 0.0) } else { Vector2::new(cos, sin) * 21.0 };
        GroundVelocity { t_s: f64::from(i), velocity_m_s: air + Vector2::new(3.0, -5.0) }
    };
    let circle = VelocityCircle::fit_robustly(&(0..800).map(velocity_at).collect::<Vec<_>>()).unwrap();
    let off_m_s = (circle.wind_m_s - Vector2::new(3.0, -5.0)).norm();
    assert!(off_m_s < 0.05 && (circle.radius_m_s - 21.0).abs() < 0.05, "{circle:?}");
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

/// Limits of 8 m/s and of 70 % on the circle.
#[test]
fn slow_flight_or_varying_airspeed_is_rejected() {
    for (airspeed_m_s, is_fast) in [(8.5, true), (7.5, false)] {
        let on_circle_velocities = velocities_near_circle(
            &velocities_at_headings(airspeed_m_s, 0.0, 1.0, circle_headings(100)),
            &VelocityCircle { radius_m_s: airspeed_m_s, ..CIRCLE },
        );
        assert_eq!(on_circle_velocities.map(|flown| flown.len()).ok(), is_fast.then_some(100), "{airspeed_m_s}");
    }
    for (slower, is_circle) in [(25, true), (35, false)] {
        let mut velocities = velocities_at_headings(20.0, 0.0, 1.0, circle_headings(100));
        velocities[..slower].copy_from_slice(&velocities_at_headings(14.0, 0.0, 1.0, circle_headings(100))[..slower]);
        let on_circle_velocities = velocities_near_circle(&velocities, &CIRCLE);
        assert_eq!(on_circle_velocities.map(|flown| flown.len()).ok(), is_circle.then_some(100 - slower), "{slower}");
    }
}

/// The limit is 15 % of the airspeed.
#[test]
fn velocities_far_from_the_circle_are_excluded() {
    for (airspeed_m_s, expected_count) in [(17.4, 100), (16.6, 90), (22.6, 100), (23.4, 90)] {
        let mut velocities = velocities_at_headings(20.0, 0.0, 1.0, circle_headings(100));
        velocities[..10].copy_from_slice(&velocities_at_headings(airspeed_m_s, 0.0, 1.0, circle_headings(100))[..10]);
        assert_eq!(
            velocities_near_circle(&velocities, &CIRCLE).map(|expected_count| expected_count.len()),
            Ok(expected_count),
            "{airspeed_m_s}"
        );
    }
}

/// The limit is a wind of half the airspeed.
#[test]
fn a_strong_wind_is_refused() {
    for (wind_m_s, is_taken) in [(9.5, true), (10.5, false)] {
        let wind = Vector2::new(-0.6, 0.8) * wind_m_s;
        let blown = |velocities: Vec<GroundVelocity>| -> Vec<GroundVelocity> {
            velocities
                .into_iter()
                .map(|velocity| GroundVelocity {
                    velocity_m_s: velocity.velocity_m_s - CIRCLE.wind_m_s + wind,
                    ..velocity
                })
                .collect()
        };
        let (fitted, straight) = (
            velocities_at_headings(20.0, 0.0, 1.0, circle_headings(600)),
            velocities_on_legs(&[(2.0, 10), (122.0, 10), (242.0, 10)]),
        );
        let course = GpsCourseHeading::from_fitted_circle(
            &VelocityCircle { wind_m_s: wind, ..CIRCLE },
            &blown(fitted),
            &blown(straight),
        );
        assert_eq!(course.as_ref().err(), (!is_taken).then_some(&GpsCourseRejection::StrongWind), "{wind_m_s}");
        if let Ok(course) = course {
            assert!((course.sigma_deg() - ASSUMED_SIDESLIP_DEG).abs() < 0.1);
            assert!((course.wind_from_deg() - 306.87).abs() < 0.01, "north-west: {}", course.wind_from_deg());
        }
    }
}

#[test]
fn slow_or_short_movement_is_not_flight() {
    let still = |speed_m_s: f64, count: usize| {
        vec![GroundVelocity { t_s: 0.0, velocity_m_s: Vector2::new(speed_m_s, 0.0) }; count]
    };
    assert_eq!(velocities_in_flight([still(20.0, 100), still(4.5, 50)].concat()).unwrap().len(), 100);
    assert!(velocities_in_flight(still(20.0, 29)).is_none() && velocities_in_flight(still(3.9, 100)).is_none());
}

/// A leg counts from three seconds on. Bins of 5 deg widen a gap by up to two bins.
#[test]
fn a_direction_counts_after_three_seconds_of_flight() {
    for (legs, gap_deg, is_enough) in [
        (&[(2.0, 10), (122.0, 10), (242.0, 10)][..], 120.0, true),
        (&[(2.0, 10), (137.0, 10), (242.0, 10)], 135.0, true),
        (&[(2.0, 10), (122.0, 10), (242.0, 2)], 240.0, false),
        (&[(2.0, 10), (162.0, 10), (262.0, 10)], 160.0, false),
        (&[(2.0, 10), (182.0, 10)], 180.0, false),
    ] {
        let straight = velocities_on_legs(legs);
        let found_deg = widest_gap_deg(&straight, &CIRCLE);
        assert!((gap_deg - 0.1..gap_deg + 10.1).contains(&found_deg), "{legs:?}: {found_deg}");
        let course = GpsCourseHeading::from_fitted_circle(
            &CIRCLE,
            &velocities_at_headings(20.0, 0.0, 1.0, circle_headings(600)),
            &straight,
        );
        assert_eq!(course.is_ok(), is_enough, "{legs:?}: {course:?}");
    }
    assert!((widest_gap_deg(&[], &CIRCLE) - 360.0).abs() < 1e-9);
    // A pause within a leg does not count as flown.
    let mut paused = velocities_on_legs(&[(2.0, 10), (122.0, 10), (242.0, 2)]);
    paused[105..].iter_mut().for_each(|velocity| velocity.t_s += 10.0);
    assert!(widest_gap_deg(&paused, &CIRCLE) > 235.0);
}

/// A linear drift by `D` has variance `D²/12`, half in each component; the jackknife of ten parts adds a ninth: sigma
/// 0.22 `D`, up to a third more by Tukey's weights. The limit is 5 % of airspeed, 1 m/s.
#[test]
fn a_drifting_wind_is_uncertain() {
    for (drift_m_s, is_certain) in [(3.0, true), (7.0, false)] {
        let fitted = velocities_at_headings(20.0, drift_m_s, 1.0, circle_headings(1200));
        let sigma_m_s = VelocityCircle::wind_sigma_m_s(&fitted).unwrap();
        assert!((0.95..1.35).contains(&(sigma_m_s / (0.22 * drift_m_s))), "{drift_m_s}: {sigma_m_s}");
        let course = GpsCourseHeading::from_fitted_circle(
            &CIRCLE,
            &fitted,
            &velocities_on_legs(&[(2.0, 10), (122.0, 10), (242.0, 10)]),
        );
        assert_eq!(course.err(), (!is_certain).then_some(GpsCourseRejection::UncertainWind), "{drift_m_s}");
    }
}

/// The limit is 30 % of the turn; whole turns in gaps are not counted.
#[test]
fn the_gyro_heading_must_follow_the_course() {
    let nose = |share: f64, points: &[GroundVelocity], turned_rad: f64| {
        let step_rad = 6_f64.to_radians() * share;
        let at = |(i, v): (usize, &GroundVelocity)| {
            (v.t_s, i as f64 * step_rad + if v.t_s > 60.0 { turned_rad } else { 0.0 })
        };
        HeadingIntegral { heading_by_time: points.iter().enumerate().map(at).collect(), banked_times_s: Vec::new() }
    };
    let velocities = velocities_at_headings(20.0, 0.0, 0.5, circle_headings(240));
    for (share, nose_turns_with_velocity) in [(1.0, true), (0.72, true), (0.68, false), (-1.0, false)] {
        assert_eq!(
            nose(share, &velocities, 0.0).nose_turns_with_velocity(&velocities, &CIRCLE),
            nose_turns_with_velocity,
            "{share}"
        );
    }
    let mut with_gap = velocities.clone();
    with_gap[120..].iter_mut().for_each(|v| v.t_s += 30.0);
    let legs: Vec<GroundVelocity> = with_gap
        .iter()
        .enumerate()
        .map(|(i, v)| GroundVelocity { velocity_m_s: velocities[usize::from(i >= 120)].velocity_m_s, ..*v })
        .collect();
    assert!(nose(0.0, &legs, 9.0).nose_turns_with_velocity(&legs, &CIRCLE));
    assert!(
        nose(1.0, &with_gap, 0.0).integrated_heading_rad(75.0).is_none()
            && nose(1.0, &with_gap, 0.0).integrated_heading_rad(30.1).is_some()
    );
}

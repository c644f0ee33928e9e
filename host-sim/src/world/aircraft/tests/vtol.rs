use super::*;

/// On rotors it turns flat and is pushed; told to go on it takes to its wings, turns by its bank, and stops again.
#[test]
fn it_is_a_copter_where_it_stays_and_an_aeroplane_where_it_goes_on() {
    let mut vtol = vehicle(Kind::Vtol, Weather::still(), 1);
    let turned = fly_leg(&mut vtol, Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: 360.0 });
    assert!(turned.iter().all(|s| s.roll_rad.abs() < 1e-3 && s.north_m.hypot(s.east_m) < 0.1));
    let speed_m_s = |s: &TrueState| s.north_m_s.hypot(s.east_m_s);
    let away = fly_leg(&mut vtol, Leg::Straight { heading_deg: 0.0, seconds: 20.0 });
    assert!((speed_m_s(&away[away.len() - 1]) - 22.0).abs() < 0.5);
    // 22 m/s come within 4 s or so, an acceleration of 5.5 m/s^2 at first, of which the attitude source hears.
    assert!((5.0..5.6).contains(&away[0].push_m_s2), "{}", away[0].push_m_s2);
    let circle = fly_leg(&mut vtol, Leg::Turn { bank_deg: 25.0, heading_change_deg: -360.0 });
    // At the last step of all it has been told to stay.
    let turning = circle[circle.len() - 2];
    assert!((turning.roll_rad.to_degrees() + 25.0).abs() < 0.5);
    assert!((turning.heading_rate_rad_s.to_degrees() + 11.9).abs() < 0.2, "{turning:?}");
    // To stop, 15 deg of nose up take 2.6 m/s^2 and the drag more.
    let stopping = fly_leg(&mut vtol, Leg::Hover { seconds: 12.0 });
    assert!(stopping.iter().any(|s| s.pitch_rad.to_degrees() > 13.0));
    assert!(speed_m_s(&stopping[stopping.len() - 1]) < 0.5);
}

//! Legs flown after the calibration: a common start, then random legs.

use simulator::random::RandomStream;
use simulator::world::aircraft::VehicleKind;
use simulator::world::autopilot::Leg;

/// Time in level flight, seconds after the start of the flight after the calibration.
pub(super) const INSTANT_IN_LEVEL_FLIGHT_S: f64 = 25.0;
/// Time in a turn, seconds after the start of the flight after the calibration.
pub(super) const INSTANT_IN_TURN_S: f64 = 48.0;

/// Straight leg, then a full circle that is in progress 48 s after the start.
pub(super) fn first_legs(vehicle_kind: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    let straight = Leg::Straight {
        heading_deg: random.uniform(0.0, 360.0),
        seconds: INSTANT_IN_LEVEL_FLIGHT_S.midpoint(INSTANT_IN_TURN_S),
    };
    let circle = if vehicle_kind.can_hover() {
        // A full yaw turn in 20 s, about the duration of an aeroplane's circle.
        Leg::Yaw { rate_deg_s: 18.0, heading_change_deg: 360.0 }
    } else {
        Leg::Turn { bank_deg: 25.0, heading_change_deg: 360.0 }
    };
    vec![straight, circle]
}

/// Straight leg; then a turn, or hover, yaw and a tilt to the side.
pub(super) fn further_legs(vehicle_kind: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    let straight = Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: random.uniform(15.0, 30.0) };
    let side_sign = if random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
    let heading_change_deg = side_sign * random.uniform(180.0, 360.0);
    if !vehicle_kind.can_hover() {
        return vec![straight, Leg::Turn { bank_deg: random.uniform(15.0, 35.0), heading_change_deg }];
    }
    vec![
        straight,
        Leg::Hover { seconds: random.uniform(5.0, 10.0) },
        Leg::Yaw { rate_deg_s: random.uniform(15.0, 60.0), heading_change_deg },
        Leg::Tilt {
            toward_deg: random.uniform(0.0, 360.0),
            tilt_deg: random.uniform(10.0, 25.0),
            seconds: random.uniform(1.0, 3.0),
        },
        Leg::Hover { seconds: random.uniform(3.0, 6.0) },
    ]
}

/// Hover at the present heading; vehicles that cannot hover fly straight.
pub(super) fn steady_leg(_: VehicleKind, _: &mut RandomStream) -> Vec<Leg> {
    vec![Leg::Hover { seconds: 60.0 }]
}

/// Straight leg, then a turn at 45 deg of bank.
pub(super) fn steep_turns(vehicle_kind: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    let mut legs = further_legs(vehicle_kind, random);
    for leg in &mut legs {
        if let Leg::Turn { bank_deg, .. } = leg {
            *bank_deg = 45.0;
        }
    }
    legs
}

/// One straight leg to the end of the flight.
pub(super) fn straight_leg(vehicle_kind: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    if !vehicle_kind.can_hover() {
        return steady_leg(vehicle_kind, random);
    }
    vec![Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: f64::INFINITY }]
}

/// A turn at 3 to 8 deg of bank: 1 to 4 deg/s at 20 m/s.
pub(super) fn slow_turn(_: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    vec![Leg::Turn { bank_deg: random.uniform(3.0, 8.0), heading_change_deg: random.uniform(-180.0, 180.0) }]
}

/// Two circles to one side.
pub(super) fn circles(_: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    let heading_change_deg = if random.uniform(-1.0, 1.0) < 0.0 { -720.0 } else { 720.0 };
    vec![Leg::Turn { bank_deg: random.uniform(15.0, 35.0), heading_change_deg }]
}

/// Two tracks of a survey there and back.
pub(super) fn survey(_: VehicleKind, random: &mut RandomStream) -> Vec<Leg> {
    let track = Leg::Hover { seconds: random.uniform(20.0, 60.0) };
    let turn_back = |heading_change_deg| Leg::Turn { bank_deg: 25.0, heading_change_deg };
    vec![track, turn_back(180.0), track, turn_back(-180.0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::random::StreamPurpose;

    /// The order of random draws must not change for aeroplanes, so that a seed gives the same flight as before.
    #[test]
    fn hovering_vehicles_yaw_and_tilt_and_aeroplanes_turn() {
        let mut random = RandomStream::new(3, StreamPurpose::Legs);
        assert!(matches!(first_legs(VehicleKind::Plane, &mut random)[..], [Leg::Straight { .. }, Leg::Turn { .. }]));
        assert!(matches!(further_legs(VehicleKind::Plane, &mut random)[..], [Leg::Straight { .. }, Leg::Turn { .. }]));
        assert!(matches!(first_legs(VehicleKind::Copter, &mut random)[..], [Leg::Straight { .. }, Leg::Yaw { .. }]));
        let legs = further_legs(VehicleKind::Copter, &mut random);
        assert!(legs.iter().any(|leg| matches!(leg, Leg::Tilt { tilt_deg, .. } if (10.0..25.0).contains(tilt_deg))));
        assert!(legs.iter().all(|leg| !matches!(leg, Leg::Turn { .. })));
    }
}

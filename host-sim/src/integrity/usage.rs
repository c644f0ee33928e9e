//! What is flown with a calibration: legs that begin alike for all, then what the seed draws.

use super::case::{LEVEL_AT_S, TURNING_AT_S};
use crate::random::Random;
use crate::world::aircraft::Kind;
use crate::world::autopilot::Leg;

/// Straight, then a full circle, under way at [`TURNING_AT_S`].
pub(super) fn first(kind: Kind, random: &mut Random) -> [Leg; 2] {
    let straight =
        Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: LEVEL_AT_S.midpoint(TURNING_AT_S) };
    let circle = if kind.hovers() {
        // 20 s, as long as an aeroplane's most of the way.
        Leg::Yaw { rate_deg_s: 18.0, heading_change_deg: 360.0 }
    } else {
        Leg::Turn { bank_deg: 25.0, heading_change_deg: 360.0 }
    };
    [straight, circle]
}

/// On to somewhere; then a turn, or what is done there in hover: it looks about, and is pushed to the next spot.
pub(super) fn next(kind: Kind, random: &mut Random) -> Vec<Leg> {
    let straight = Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: random.uniform(15.0, 30.0) };
    let side = if random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
    let heading_change_deg = side * random.uniform(180.0, 360.0);
    if !kind.hovers() {
        return vec![straight, Leg::Turn { bank_deg: random.uniform(15.0, 35.0), heading_change_deg }];
    }
    vec![
        straight,
        Leg::Hover { seconds: random.uniform(5.0, 10.0) },
        Leg::Yaw { rate_deg_s: random.uniform(15.0, 60.0), heading_change_deg },
        Leg::Push {
            toward_deg: random.uniform(0.0, 360.0),
            tilt_deg: random.uniform(10.0, 25.0),
            seconds: random.uniform(1.0, 3.0),
        },
        Leg::Hover { seconds: random.uniform(3.0, 6.0) },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;

    /// Draws in the order in which an aeroplane's flights have always drawn them.
    #[test]
    fn what_hovers_is_turned_and_pushed_and_an_aeroplane_turns() {
        let mut random = Random::new(3, Purpose::Legs);
        assert!(matches!(first(Kind::Plane, &mut random), [Leg::Straight { .. }, Leg::Turn { .. }]));
        assert!(matches!(next(Kind::Plane, &mut random)[..], [Leg::Straight { .. }, Leg::Turn { .. }]));
        assert!(matches!(first(Kind::Copter, &mut random), [Leg::Straight { .. }, Leg::Yaw { .. }]));
        let legs = next(Kind::Copter, &mut random);
        assert!(legs.iter().any(|leg| matches!(leg, Leg::Push { tilt_deg, .. } if (10.0..25.0).contains(tilt_deg))));
        assert!(legs.iter().all(|leg| !matches!(leg, Leg::Turn { .. })));
    }
}

//! Patterns that the simulated pilot flies without commands.

use simulator::random::RandomStream;
use simulator::routine::{CalibrationRoutine, TurnPlan, random_leg};
use simulator::world::aircraft::VehicleKind;
use simulator::world::autopilot::Leg;

/// Flight pattern without commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotPattern {
    /// Calibration routine of the vehicle, then 30 s straight.
    #[default]
    Routine,
    /// Two circles to the right, two to the left.
    Circles,
    /// Random legs.
    Wandering,
    /// Straight ahead, or hover.
    Level,
}

impl PilotPattern {
    /// All patterns.
    pub const ALL_PATTERNS: [Self; 4] = [Self::Routine, Self::Circles, Self::Wandering, Self::Level];

    /// Name on the command line.
    #[must_use]
    pub const fn pattern_name(self) -> &'static str {
        match self {
            Self::Routine => "routine",
            Self::Circles => "circles",
            Self::Wandering => "wandering",
            Self::Level => "level",
        }
    }

    /// The pattern with this name, if any.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL_PATTERNS.into_iter().find(|pattern| pattern.pattern_name() == name)
    }

    /// Legs of one repetition; empty for level flight.
    pub(super) fn legs(self, vehicle_kind: VehicleKind, heading_deg: f64, random: &mut RandomStream) -> Vec<Leg> {
        let straight = Leg::Straight { heading_deg, seconds: 30.0 };
        let circles = |change_deg| match vehicle_kind {
            VehicleKind::Plane | VehicleKind::Vtol => {
                Leg::Turn { bank_deg: CIRCLE_BANK_DEG, heading_change_deg: change_deg }
            }
            VehicleKind::Copter | VehicleKind::Rover | VehicleKind::Boat | VehicleKind::Hand => {
                Leg::Yaw { rate_deg_s: CIRCLE_RATE_DEG_S, heading_change_deg: change_deg }
            }
        };
        match self {
            Self::Routine => {
                let mut legs = CalibrationRoutine::for_vehicle(vehicle_kind, TurnPlan::default(), heading_deg).legs();
                legs.push(straight);
                legs
            }
            Self::Circles => vec![circles(720.0), circles(-720.0)],
            Self::Wandering => vec![random_leg(vehicle_kind, random)],
            Self::Level => Vec::new(),
        }
    }
}

/// Bank of circles, degrees: half a minute each.
const CIRCLE_BANK_DEG: f64 = 25.0;
const CIRCLE_RATE_DEG_S: f64 = 18.0;

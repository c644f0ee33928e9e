//! Calibration routines by vehicle kind, each at most three and a half minutes, the legs flown for evaluation afterwards, and
//! random legs.

use crate::random::RandomStream;
use crate::world::aircraft::VehicleKind;
use crate::world::autopilot::Leg;

/// Settings of an aeroplane's calibration turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnPlan {
    /// Bank in the turns, degrees.
    pub bank_deg: f64,
    /// Full circles to each side.
    pub circles_per_side: f64,
}

impl Default for TurnPlan {
    /// Pilot instructions: 25 deg of bank and four circles, one more than necessary in calm air.
    fn default() -> Self {
        Self { bank_deg: 25.0, circles_per_side: 4.0 }
    }
}

/// Part of a routine.
#[derive(Clone, Debug, PartialEq)]
pub struct RoutinePart {
    /// Name of the part.
    pub part_name: &'static str,
    /// Instruction to the pilot.
    pub instruction: &'static str,
    /// Legs for the simulated autopilot.
    pub legs: Vec<Leg>,
}

/// Calibration routine.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationRoutine {
    /// Console command that starts the collection.
    pub start_command: &'static str,
    /// Uncalibrated leg before the collection.
    pub take_off: Leg,
    /// Parts in the order of flight.
    pub routine_parts: Vec<RoutinePart>,
    /// Legs flown with the calibration.
    pub mission_legs: Vec<Leg>,
}

/// Console command for the collection of informative samples, for all vehicles but aeroplanes.
const START_FLIGHT_COLLECTION: &str = "cal start";

impl CalibrationRoutine {
    /// Calibration routine of a vehicle kind, with take-off heading; the plan applies to aeroplanes.
    #[must_use]
    pub fn for_vehicle(vehicle_kind: VehicleKind, plan: TurnPlan, heading_deg: f64) -> Self {
        match vehicle_kind {
            VehicleKind::Plane => plane_routine(plan, heading_deg),
            VehicleKind::Copter => copter_routine(),
            VehicleKind::Vtol => vtol_routine(heading_deg),
            VehicleKind::Rover => surface_routine(ROVER_INSTRUCTION, heading_deg),
            VehicleKind::Boat => surface_routine(BOAT_INSTRUCTION, heading_deg),
            VehicleKind::Hand => hand_routine(),
        }
    }

    /// All legs in order.
    #[must_use]
    pub fn legs(&self) -> Vec<Leg> {
        self.routine_parts.iter().flat_map(|routine_part| routine_part.legs.iter().copied()).collect()
    }
}

/// Pilot instructions for all kinds.
#[must_use]
pub fn all_instructions() -> String {
    let instructions = VehicleKind::ALL_VEHICLES.map(|vehicle_kind| {
        let routine = CalibrationRoutine::for_vehicle(vehicle_kind, TurnPlan::default(), 0.0);
        let parts = (1..).zip(&routine.routine_parts);
        let parts: Vec<_> = parts.map(|(number, part)| format!("  {number}. {}\n", part.instruction)).collect();
        format!("{}, after `{}`:\n{}", vehicle_kind.vehicle_name(), routine.start_command, parts.concat())
    });
    instructions.concat()
}

fn yaw_leg(rate_deg_s: f64, heading_change_deg: f64) -> Leg {
    Leg::Yaw { rate_deg_s, heading_change_deg }
}

/// Turn rate in hover that a pilot can hold, degrees per second.
const HOVER_RATE_DEG_S: f64 = 30.0;

fn yaw_turns_part() -> RoutinePart {
    RoutinePart {
        part_name: "yaw turns",
        instruction: "in hover, turn the nose slowly once all round to the right, then once to the left, in 12 s each",
        legs: vec![yaw_leg(HOVER_RATE_DEG_S, 360.0), yaw_leg(HOVER_RATE_DEG_S, -360.0)],
    }
}

fn plane_routine(plan: TurnPlan, heading_deg: f64) -> CalibrationRoutine {
    let turns = |side: f64| {
        vec![Leg::Turn { bank_deg: plan.bank_deg, heading_change_deg: side * 360.0 * plan.circles_per_side }]
    };
    CalibrationRoutine {
        start_command: "cal start turns",
        take_off: Leg::Straight { heading_deg, seconds: 5.0 },
        routine_parts: vec![
            RoutinePart {
                part_name: "right turns",
                instruction: "three or four full circles to the right, at 15 to 45 deg of bank",
                legs: turns(1.0),
            },
            RoutinePart {
                part_name: "straight flight",
                instruction: "15 s straight ahead, to show iron that moves with the elevator",
                legs: vec![Leg::Straight { heading_deg, seconds: 15.0 }],
            },
            RoutinePart { part_name: "left turns", instruction: "as many to the left", legs: turns(-1.0) },
        ],
        mission_legs: vec![
            Leg::Turn { bank_deg: 20.0, heading_change_deg: 360.0 },
            Leg::Straight { heading_deg: 60.0, seconds: 15.0 },
            Leg::Turn { bank_deg: 30.0, heading_change_deg: -360.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
        ],
    }
}

fn copter_routine() -> CalibrationRoutine {
    let tilt_and_rest =
        |toward_deg| [Leg::Tilt { toward_deg, tilt_deg: 18.0, seconds: 2.0 }, Leg::Hover { seconds: 2.5 }];
    let tilts = [0.0, 180.0, 90.0, 270.0].map(tilt_and_rest).concat();
    let pushes = RoutinePart {
        part_name: "pushes",
        instruction: "on four headings, a quarter turn apart: push the stick ahead, back, right and left until it \
                      tilts by some 20 deg, two seconds each, and let it come to rest in between",
        legs: [tilts, vec![yaw_leg(2.0 * HOVER_RATE_DEG_S, 90.0)]].concat().repeat(4),
    };
    CalibrationRoutine {
        start_command: START_FLIGHT_COLLECTION,
        take_off: Leg::Hover { seconds: 5.0 },
        routine_parts: vec![yaw_turns_part(), pushes],
        mission_legs: vec![
            yaw_leg(45.0, 360.0),
            Leg::Straight { heading_deg: 60.0, seconds: 20.0 },
            Leg::Turn { bank_deg: 10.0, heading_change_deg: -360.0 },
            Leg::Hover { seconds: 5.0 },
            Leg::Tilt { toward_deg: 45.0, tilt_deg: 20.0, seconds: 2.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
        ],
    }
}

fn vtol_routine(heading_deg: f64) -> CalibrationRoutine {
    CalibrationRoutine {
        start_command: START_FLIGHT_COLLECTION,
        take_off: Leg::Hover { seconds: 5.0 },
        routine_parts: vec![
            yaw_turns_part(),
            RoutinePart {
                part_name: "circles on wings",
                instruction: "on wings, two full circles to the right and two to the left, at some 30 deg of bank",
                legs: vec![
                    Leg::Straight { heading_deg, seconds: 10.0 },
                    Leg::Turn { bank_deg: 30.0, heading_change_deg: 720.0 },
                    Leg::Turn { bank_deg: 30.0, heading_change_deg: -720.0 },
                ],
            },
        ],
        mission_legs: vec![
            yaw_leg(45.0, 360.0),
            Leg::Straight { heading_deg: 60.0, seconds: 25.0 },
            Leg::Turn { bank_deg: 20.0, heading_change_deg: -360.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
            Leg::Hover { seconds: 15.0 },
        ],
    }
}

const ROVER_INSTRUCTION: &str = "on the roughest ground there is, or across a slope: two circles to the right and two \
                                 to the left, and both again, each in 20 s";
const BOAT_INSTRUCTION: &str =
    "in waves that roll it: two circles to the right and two to the left, and both again, each in 20 s";

/// Circles to alternating sides, so that they cover different places.
fn surface_routine(instruction: &'static str, heading_deg: f64) -> CalibrationRoutine {
    CalibrationRoutine {
        start_command: START_FLIGHT_COLLECTION,
        take_off: Leg::Straight { heading_deg, seconds: 5.0 },
        routine_parts: vec![RoutinePart {
            part_name: "circles",
            instruction,
            legs: [yaw_leg(18.0, 720.0), yaw_leg(18.0, -720.0)].repeat(2),
        }],
        mission_legs: vec![
            yaw_leg(20.0, 360.0),
            Leg::Straight { heading_deg: 60.0, seconds: 20.0 },
            yaw_leg(10.0, -360.0),
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
        ],
    }
}

fn hand_routine() -> CalibrationRoutine {
    let tilt = |toward_deg: f64, tilt_deg: f64| Leg::Tilt { toward_deg, tilt_deg, seconds: 2.0 };
    let tilts = [tilt(0.0, 60.0), tilt(180.0, 60.0), tilt(270.0, 90.0), tilt(90.0, 90.0), tilt(90.0, 170.0)];
    let tumble = RoutinePart {
        part_name: "tumble",
        instruction: "on four headings, a quarter turn apart: nose down, nose up, on its left and on its right side, \
                      and upside down, two seconds each",
        legs: [&tilts[..], &[yaw_leg(60.0, 90.0)]].concat().repeat(4),
    };
    CalibrationRoutine {
        start_command: START_FLIGHT_COLLECTION,
        take_off: Leg::Hover { seconds: 5.0 },
        routine_parts: vec![tumble],
        mission_legs: vec![
            yaw_leg(45.0, 360.0),
            tilt(45.0, 30.0),
            yaw_leg(30.0, 120.0),
            tilt(225.0, 40.0),
            yaw_leg(60.0, -360.0),
            Leg::Hover { seconds: 5.0 },
        ],
    }
}

/// A random leg suitable for this vehicle kind.
pub fn random_leg(vehicle_kind: VehicleKind, random: &mut RandomStream) -> Leg {
    let side_sign = if random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
    let choices = if vehicle_kind.can_hover() { 5.0 } else { 2.0 };
    match random.uniform(0.0, choices) as u8 {
        0 => Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: random.uniform(8.0, 25.0) },
        1 => {
            // A copter at 3 m/s turns at 33 deg/s with 10 deg of bank; an aeroplane at 18 deg/s with 35 deg.
            let bank_deg = if vehicle_kind == VehicleKind::Copter { [5.0, 15.0] } else { [10.0, 35.0] };
            let heading_change_deg = side_sign * random.uniform(60.0, 360.0);
            Leg::Turn { bank_deg: random.uniform(bank_deg[0], bank_deg[1]), heading_change_deg }
        }
        2 => Leg::Hover { seconds: random.uniform(2.0, 12.0) },
        3 => Leg::Yaw {
            rate_deg_s: random.uniform(10.0, 60.0),
            heading_change_deg: side_sign * random.uniform(30.0, 360.0),
        },
        _ => Leg::Tilt {
            toward_deg: random.uniform(0.0, 360.0),
            tilt_deg: random.uniform(8.0, 25.0),
            seconds: random.uniform(1.0, 3.0),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::WorldConfig;
    use crate::world::aircraft::Aircraft;

    fn duration_s(vehicle_kind: VehicleKind, legs: &[Leg], seed: u64) -> f64 {
        let config = WorldConfig::random_world(seed).with_vehicle_kind(vehicle_kind);
        let mut aircraft = Aircraft::new(config.aircraft, config.weather, seed, 0);
        for &leg in legs {
            aircraft.autopilot_mut().append_leg(leg);
        }
        while aircraft.autopilot().unfinished_leg_count() > 0 && aircraft.true_state().time_us < 1_000_000_000 {
            aircraft.advance_step();
        }
        aircraft.true_state().time_s()
    }

    /// Limited by battery capacity. Three circles suffice for an aeroplane.
    #[test]
    fn no_routine_takes_more_than_three_and_a_half_minutes() {
        for vehicle_kind in VehicleKind::ALL_VEHICLES {
            let routine = CalibrationRoutine::for_vehicle(
                vehicle_kind,
                TurnPlan { circles_per_side: 3.0, ..TurnPlan::default() },
                0.0,
            );
            let seconds = duration_s(vehicle_kind, &routine.legs(), 3);
            assert!((40.0..=210.0).contains(&seconds), "{vehicle_kind:?}: {seconds} s");
        }
    }

    #[test]
    fn every_vehicle_kind_has_instructions_for_every_part() {
        let instructions = all_instructions();
        for vehicle_kind in VehicleKind::ALL_VEHICLES {
            let routine = CalibrationRoutine::for_vehicle(vehicle_kind, TurnPlan::default(), 0.0);
            assert!(instructions.contains(&format!(
                "{}, after `{}`",
                vehicle_kind.vehicle_name(),
                routine.start_command
            )));
            assert!(
                routine.routine_parts.iter().all(
                    |routine_part| instructions.contains(routine_part.instruction) && !routine_part.legs.is_empty()
                )
            );
        }
    }

    #[test]
    fn the_documentation_lists_the_same_routines() {
        let text = include_str!("../../../docs/routines.md").to_lowercase();
        for vehicle_kind in VehicleKind::ALL_VEHICLES {
            let routine = CalibrationRoutine::for_vehicle(vehicle_kind, TurnPlan::default(), 0.0);
            let row = format!("| `{}` | `{}` |", vehicle_kind.vehicle_name(), routine.start_command);
            let row = text.lines().find(|line| line.starts_with(&row)).unwrap_or_default();
            assert!(
                routine.routine_parts.iter().all(|routine_part| row.contains(&routine_part.instruction.to_lowercase())),
                "{vehicle_kind:?}: {row}"
            );
        }
    }
}

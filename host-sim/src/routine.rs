//! What a person flies to calibrate, kind by kind, none of it longer than three minutes; and what is flown afterwards to
//! see what came of it.

use std::fmt::Write as _;

use crate::world::aircraft::Kind;
use crate::world::autopilot::Leg;

/// How an aeroplane's calibration turns are flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Bank in the turns, degrees.
    pub bank_deg: f64,
    /// Full circles each way.
    pub circles: f64,
}

impl Default for Plan {
    /// What a pilot is asked for: a bank of 25 deg and four circles, one more than the module needs in calm air.
    fn default() -> Self {
        Self { bank_deg: 25.0, circles: 4.0 }
    }
}

/// A part of a routine.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is called.
    pub name: &'static str,
    /// What the pilot does.
    pub says: &'static str,
    /// The same for the autopilot.
    pub legs: Vec<Leg>,
}

/// A calibration routine.
#[derive(Clone, Debug, PartialEq)]
pub struct Routine {
    /// What is typed to begin.
    pub command: &'static str,
    /// What comes before that, while nothing is calibrated.
    pub take_off: Leg,
    /// The parts, in order.
    pub parts: Vec<Part>,
    /// What is flown with the calibration.
    pub mission: Vec<Leg>,
}

/// Begins the collection of everything that informs. What moves as no aeroplane does needs it.
pub const START_FLIGHT: &str = "cal start";

/// Begins the collection of an aeroplane's turns.
const START_TURNS: &str = "cal start turns";

impl Routine {
    /// What is flown with a vehicle of this kind; the plan is for an aeroplane. The heading is the one it takes off at.
    #[must_use]
    pub fn of(kind: Kind, plan: Plan, heading_deg: f64) -> Self {
        match kind {
            Kind::Plane => plane(plan, heading_deg),
            Kind::Copter => copter(),
            Kind::Vtol => vtol(heading_deg),
            Kind::Rover => rover(heading_deg),
            Kind::Boat => boat(heading_deg),
        }
    }

    /// All legs of it, in order.
    #[must_use]
    pub fn legs(&self) -> Vec<Leg> {
        self.parts.iter().flat_map(|part| part.legs.iter().copied()).collect()
    }

    /// What a person does, a line a part.
    #[must_use]
    pub fn words(&self) -> String {
        self.parts.iter().enumerate().fold(String::new(), |mut text, (i, part)| {
            // Writing to a string never fails.
            let _ = writeln!(text, "  {}. {}", i + 1, part.says);
            text
        })
    }
}

/// The routines of all kinds as a person reads them.
#[must_use]
pub fn all_words() -> String {
    Kind::ALL.into_iter().fold(String::new(), |text, kind| {
        let routine = Routine::of(kind, Plan::default(), 0.0);
        format!("{text}{}, after `{}`:\n{}", kind.name(), routine.command, routine.words())
    })
}

fn circle(rate_deg_s: f64, heading_change_deg: f64) -> Leg {
    Leg::Yaw { rate_deg_s, heading_change_deg }
}

/// Turn rate of a yaw turn in hover that a person can hold, degrees per second.
const HOVER_RATE_DEG_S: f64 = 30.0;

fn yaw_turns() -> Part {
    Part {
        name: "yaw turns",
        says: "in hover, turn the nose slowly once all round to the right, then once to the left, in 12 s each",
        legs: vec![circle(HOVER_RATE_DEG_S, 360.0), circle(HOVER_RATE_DEG_S, -360.0)],
    }
}

/// A push to each of four sides, each let go until it has come to rest, at each of so many headings.
fn pushes(name: &'static str, says: &'static str, headings: usize) -> Part {
    const PUSH_S: f64 = 2.0;
    const REST_S: f64 = 2.5;
    let turn = circle(2.0 * HOVER_RATE_DEG_S, 360.0 / headings as f64);
    let each = [0.0, 180.0, 90.0, 270.0].into_iter().flat_map(|toward_deg| {
        [Leg::Push { toward_deg, tilt_deg: 18.0, seconds: PUSH_S }, Leg::Hover { seconds: REST_S }]
    });
    let legs = (0..headings).flat_map(|_| each.clone().chain([turn])).collect();
    Part { name, says, legs }
}

fn plane(plan: Plan, heading_deg: f64) -> Routine {
    let turns =
        |side: f64| vec![Leg::Turn { bank_deg: plan.bank_deg, heading_change_deg: side * 360.0 * plan.circles }];
    Routine {
        command: START_TURNS,
        take_off: Leg::Straight { heading_deg, seconds: 5.0 },
        parts: vec![
            Part {
                name: "right turns",
                says: "three or four full circles to the right, at 15 to 45 deg of bank",
                legs: turns(1.0),
            },
            Part { name: "left turns", says: "as many to the left", legs: turns(-1.0) },
        ],
        mission: vec![
            Leg::Turn { bank_deg: 20.0, heading_change_deg: 360.0 },
            Leg::Straight { heading_deg: 60.0, seconds: 15.0 },
            Leg::Turn { bank_deg: 30.0, heading_change_deg: -360.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
        ],
    }
}

fn copter() -> Routine {
    let says = "on four headings, a quarter turn apart: push the stick ahead, back, right and left until it tilts by some \
                20 deg, two seconds each, and let it come to rest in between";
    Routine {
        command: START_FLIGHT,
        take_off: Leg::Hover { seconds: 5.0 },
        parts: vec![yaw_turns(), pushes("pushes", says, 4)],
        mission: vec![
            circle(45.0, 360.0),
            Leg::Straight { heading_deg: 60.0, seconds: 20.0 },
            Leg::Turn { bank_deg: 10.0, heading_change_deg: -360.0 },
            Leg::Hover { seconds: 5.0 },
            Leg::Push { toward_deg: 45.0, tilt_deg: 20.0, seconds: 2.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
        ],
    }
}

fn vtol(heading_deg: f64) -> Routine {
    Routine {
        command: START_FLIGHT,
        take_off: Leg::Hover { seconds: 5.0 },
        parts: vec![
            yaw_turns(),
            Part {
                name: "circles on wings",
                says: "on wings, two full circles to the right and two to the left, at some 30 deg of bank",
                legs: vec![
                    Leg::Straight { heading_deg, seconds: 10.0 },
                    Leg::Turn { bank_deg: 30.0, heading_change_deg: 720.0 },
                    Leg::Turn { bank_deg: 30.0, heading_change_deg: -720.0 },
                ],
            },
        ],
        mission: vec![
            circle(45.0, 360.0),
            Leg::Straight { heading_deg: 60.0, seconds: 25.0 },
            Leg::Turn { bank_deg: 20.0, heading_change_deg: -360.0 },
            Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
            Leg::Hover { seconds: 15.0 },
        ],
    }
}

/// Circles either way, one after the other, so that they are not over the same place.
fn circles(name: &'static str, says: &'static str, rate_deg_s: f64, number: usize) -> Part {
    let sides = [720.0, -720.0].into_iter().cycle();
    Part { name, says, legs: sides.take(number).map(|change_deg| circle(rate_deg_s, change_deg)).collect() }
}

fn surface_mission() -> Vec<Leg> {
    vec![
        circle(20.0, 360.0),
        Leg::Straight { heading_deg: 60.0, seconds: 20.0 },
        circle(10.0, -360.0),
        Leg::Straight { heading_deg: 250.0, seconds: 15.0 },
    ]
}

fn rover(heading_deg: f64) -> Routine {
    let says = "on the roughest ground there is, or across a slope: two circles to the right and two to the left, and both \
                again, each in 20 s";
    Routine {
        command: START_FLIGHT,
        take_off: Leg::Straight { heading_deg, seconds: 5.0 },
        parts: vec![circles("circles", says, 18.0, 4)],
        mission: surface_mission(),
    }
}

fn boat(heading_deg: f64) -> Routine {
    let says = "in waves that roll it: two circles to the right and two to the left, and both again, each in 20 s";
    Routine {
        command: START_FLIGHT,
        take_off: Leg::Straight { heading_deg, seconds: 5.0 },
        parts: vec![circles("circles", says, 18.0, 4)],
        mission: surface_mission(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::WorldConfig;
    use crate::world::aircraft::Aircraft;

    /// Seconds that the legs take a vehicle.
    fn duration_s(kind: Kind, legs: &[Leg], seed: u64) -> f64 {
        let config = WorldConfig::random(seed).carried_by(kind);
        let mut aircraft = Aircraft::new(config.aircraft, config.weather, seed, 0);
        for &leg in legs {
            aircraft.autopilot_mut().fly(leg);
        }
        while aircraft.autopilot().legs_left() > 0 && aircraft.state().time_us < 1_000_000_000 {
            aircraft.step();
        }
        aircraft.state().time_us as f64 / 1e6
    }

    /// A person has a battery. An aeroplane's four circles are one more than are asked for.
    #[test]
    fn no_routine_takes_more_than_three_minutes() {
        for kind in Kind::ALL {
            let routine = Routine::of(kind, Plan { circles: 3.0, ..Plan::default() }, 0.0);
            let seconds = duration_s(kind, &routine.legs(), 3);
            assert!((60.0..=185.0).contains(&seconds), "{kind:?}: {seconds} s");
        }
    }

    #[test]
    fn every_kind_has_words_for_every_part() {
        let words = all_words();
        for kind in Kind::ALL {
            let routine = Routine::of(kind, Plan::default(), 0.0);
            assert!(words.contains(&format!("{}, after `{}`", kind.name(), routine.command)));
            assert!(routine.parts.iter().all(|part| words.contains(part.says) && !part.legs.is_empty()));
        }
    }

    #[test]
    fn the_documentation_says_the_same() {
        let text = include_str!("../../docs/routines.md").to_lowercase();
        for kind in Kind::ALL {
            let routine = Routine::of(kind, Plan::default(), 0.0);
            let row = format!("| `{}` | `{}` |", kind.name(), routine.command);
            let row = text.lines().find(|line| line.starts_with(&row)).unwrap_or_default();
            assert!(routine.parts.iter().all(|part| row.contains(&part.says.to_lowercase())), "{kind:?}: {row}");
        }
    }
}

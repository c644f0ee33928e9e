//! Flights of one battery charge that include calibration manoeuvres.

use autoswing::calibration::AngleRates;
use autoswing::time::WrappingMillis;
use serde::{Deserialize, Serialize};
use simulator::random::{RandomStream, StreamPurpose};
use simulator::routine::{CalibrationRoutine, TurnPlan, random_leg};
use simulator::world::aircraft::{Aircraft, VehicleConfig, VehicleKind};
use simulator::world::autopilot::Leg;
use simulator::world::weather::Weather;

use super::random_flight::{RandomRanges, TrueSample};

/// Flight pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FlightPattern {
    /// Straight legs, with the routine after one third of the remaining time.
    Routine,
    /// Straight legs, with the routine reversed in order and mirrored left to right after two thirds of the remaining
    /// time.
    Mirrored,
    /// Flight of random legs only, without calibration manoeuvres.
    Wandering,
}

impl FlightPattern {
    /// All patterns.
    pub const ALL_PATTERNS: [Self; 3] = [Self::Routine, Self::Mirrored, Self::Wandering];
}

/// Vehicle, pattern and duration of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudyFlight {
    /// Vehicle kind.
    pub kind: VehicleKind,
    /// Flight pattern.
    pub flight_pattern: FlightPattern,
    /// Duration, minutes.
    pub duration_minutes: f64,
}

const SAMPLE_PERIOD_US: u64 = 100_000;

impl StudyFlight {
    /// True attitudes at 10 Hz, in weather drawn from the seed.
    #[must_use]
    pub fn true_flight(&self, ranges: &RandomRanges, seed: u64) -> Vec<TrueSample> {
        let mut random = RandomStream::new(seed, StreamPurpose::Legs);
        let config =
            VehicleConfig { kind: self.kind, heading_deg: random.uniform(0.0, 360.0), ..VehicleConfig::default() };
        let mut aircraft = Aircraft::new(config, Weather::default(), seed, 0);
        let plan = TurnPlan { bank_deg: random.uniform(ranges.bank_deg[0], ranges.bank_deg[1]), circles_per_side: 3.0 };
        let routine = match self.flight_pattern {
            FlightPattern::Routine => {
                Some((1.0 / 3.0, CalibrationRoutine::for_vehicle(self.kind, plan, config.heading_deg).legs()))
            }
            FlightPattern::Mirrored => Some((
                2.0 / 3.0,
                mirrored_legs(&CalibrationRoutine::for_vehicle(self.kind, plan, config.heading_deg).legs()),
            )),
            FlightPattern::Wandering => None,
        };
        let end_us = (self.duration_minutes * 60e6) as u64;
        let mut true_samples = Vec::new();
        // Flight time without the calibration routine, whose duration a separate simulation determines.
        let spare_us = routine.as_ref().map_or(0, |(_, legs)| end_us.saturating_sub(duration_us(config, seed, legs)));
        let mut routine = routine.map(|(share, legs)| ((spare_us as f64 * share) as u64, legs));
        while aircraft.true_state().time_us < end_us {
            if let Some((_, legs)) = routine.take_if(|(at_us, _)| aircraft.true_state().time_us >= *at_us) {
                // Aborts the straight leg in progress.
                aircraft.autopilot_mut().hold_bank_and_pitch(0.0, 0.0);
                append_legs(&mut aircraft, &legs);
            } else if aircraft.autopilot().unfinished_leg_count() == 0 {
                let leg = if self.flight_pattern == FlightPattern::Wandering {
                    random_leg(self.kind, &mut random)
                } else {
                    straight_leg(&mut random)
                };
                aircraft.autopilot_mut().append_leg(leg);
            }
            aircraft.advance_step();
            if aircraft.true_state().time_us.is_multiple_of(SAMPLE_PERIOD_US) {
                true_samples.push(true_sample(&aircraft));
            }
        }
        true_samples
    }
}

fn true_sample(aircraft: &Aircraft) -> TrueSample {
    let state = aircraft.true_state();
    TrueSample {
        euler: state.euler_angles(),
        disturbing_acceleration_m_s2: state.disturbing_acceleration_m_s2,
        rates: AngleRates::from_rad_s(
            [state.roll_rate_rad_s, state.pitch_rate_rad_s, state.heading_rate_rad_s].map(|rad_s| rad_s as f32),
        ),
        time: WrappingMillis::new((state.time_us / 1000) as u32),
    }
}

fn append_legs(aircraft: &mut Aircraft, legs: &[Leg]) {
    for &leg in legs {
        aircraft.autopilot_mut().append_leg(leg);
    }
}

fn duration_us(config: VehicleConfig, seed: u64, legs: &[Leg]) -> u64 {
    let mut aircraft = Aircraft::new(config, Weather::default(), seed, 0);
    append_legs(&mut aircraft, legs);
    while aircraft.autopilot().unfinished_leg_count() > 0 {
        aircraft.advance_step();
    }
    aircraft.true_state().time_us
}

/// Legs in reverse order, mirrored left to right.
fn mirrored_legs(legs: &[Leg]) -> Vec<Leg> {
    let mirror = |leg: Leg| match leg {
        Leg::Turn { bank_deg, heading_change_deg } => Leg::Turn { bank_deg, heading_change_deg: -heading_change_deg },
        Leg::Yaw { rate_deg_s, heading_change_deg } => Leg::Yaw { rate_deg_s, heading_change_deg: -heading_change_deg },
        Leg::Tilt { toward_deg, tilt_deg, seconds } => Leg::Tilt { toward_deg: -toward_deg, tilt_deg, seconds },
        Leg::Straight { .. } | Leg::Hover { .. } => leg,
    };
    legs.iter().rev().map(|&leg| mirror(leg)).collect()
}

fn straight_leg(random: &mut RandomStream) -> Leg {
    Leg::Straight { heading_deg: random.uniform(0.0, 360.0), seconds: random.uniform(20.0, 60.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly_pattern(vehicle_kind: VehicleKind, pattern: FlightPattern, seed: u64) -> Vec<TrueSample> {
        StudyFlight { kind: vehicle_kind, flight_pattern: pattern, duration_minutes: 3.0 }
            .true_flight(&RandomRanges::WORST_CASE, seed)
    }

    #[test]
    fn a_flight_of_three_minutes_has_1800_samples() {
        for vehicle_kind in [VehicleKind::Plane, VehicleKind::Copter, VehicleKind::Vtol] {
            for pattern in FlightPattern::ALL_PATTERNS {
                let true_samples = fly_pattern(vehicle_kind, pattern, 4);
                assert_eq!(true_samples.len(), 1800, "{vehicle_kind:?} {pattern:?}");
                assert!(true_samples.windows(2).all(|pair| pair[1].time.ms_since(pair[0].time) == 100));
                let rates = |true_samples: &[TrueSample]| {
                    true_samples.iter().map(|true_sample| true_sample.rates).collect::<Vec<_>>()
                };
                assert_eq!(rates(&true_samples), rates(&fly_pattern(vehicle_kind, pattern, 4)));
                assert_ne!(rates(&true_samples), rates(&fly_pattern(vehicle_kind, pattern, 5)));
            }
        }
    }

    #[test]
    fn a_mirrored_routine_reverses_order_and_sides() {
        let legs = CalibrationRoutine::for_vehicle(VehicleKind::Copter, TurnPlan::default(), 0.0).legs();
        let back = mirrored_legs(&legs);
        assert_eq!(back.len(), legs.len());
        assert_eq!(
            back[back.len() - 2..],
            [
                Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: 360.0 },
                Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: -360.0 },
            ]
        );
        assert_eq!(mirrored_legs(&back), legs);
        assert!(back.contains(&Leg::Tilt { toward_deg: -90.0, tilt_deg: 18.0, seconds: 2.0 }));
    }
}

//! Outputs of the autopilot to servos and speed controllers.

use super::aircraft::VehicleKind;
use super::config::WorldConfig;
use super::state::TrueState;
use crate::random::{RandomStream, StreamPurpose};

/// Throttle in cruise or hover.
const CRUISE_THROTTLE: f64 = 0.4;

/// Throttle by which the outputs answer gusts, root mean square.
const GUST_THROTTLE: f64 = 0.06;

/// Intervals between the gusts that are interpolated, microseconds.
const GUST_INTERVALS_US: [u64; 2] = [700_000, 5_000_000];

/// Deflection per body rate, of the range per rad/s.
const DEFLECTION_PER_RATE: f64 = 0.3;

/// Deflection of the elevator per load factor above one, of the range.
const ELEVATOR_PER_LOAD: f64 = 0.3;

/// Directions in which each motor of an X frame lifts, of roll, pitch and yaw: front right, rear left, front left, rear
/// right.
const MIX: [[f64; 3]; 4] = [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]];

/// Outputs at a time, 0 to 1: four motors of a copter; aileron, elevator, throttle and rudder of others, as ArduPilot
/// numbers them.
#[must_use]
pub(super) fn outputs(config: &WorldConfig, truth: &TrueState) -> [f64; 4] {
    let gusts: [f64; 4] = std::array::from_fn(|control| gust(config.seed, control as u64, truth.time_us));
    // Propellers draw a power of the throttle: 1.5 after the momentum theory of a hovering rotor.
    let throttle = CRUISE_THROTTLE * libm::pow(truth.relative_current, 1.0 / 1.5) + GUST_THROTTLE * gusts[0];
    let rates = truth.body_rates_rad_s();
    let controls: [f64; 3] =
        std::array::from_fn(|axis| DEFLECTION_PER_RATE * rates[axis] + GUST_THROTTLE * gusts[axis + 1]);
    let outputs = if config.aircraft.kind == VehicleKind::Copter {
        MIX.map(|mix| throttle + 0.3 * (0..3).map(|axis| mix[axis] * controls[axis]).sum::<f64>())
    } else {
        let load = libm::cos(truth.roll_rad).max(0.2).recip() - 1.0;
        [0.5 + controls[0], 0.5 - ELEVATOR_PER_LOAD * load + controls[1], throttle, 0.5 + controls[2]]
    };
    outputs.map(|output| output.clamp(0.0, 1.0))
}

/// Answer of a control to gusts, of unit variance: random numbers at fixed times, interpolated.
fn gust(seed: u64, control: u64, time_us: u64) -> f64 {
    GUST_INTERVALS_US
        .iter()
        .map(|interval_us| {
            let knot = time_us / interval_us;
            let number = |knot: u64| {
                let seed =
                    seed.wrapping_mul(0x9E37_79B9).wrapping_add(knot * 8 + control).wrapping_add(interval_us << 20);
                RandomStream::new(seed, StreamPurpose::Throttle).gaussian()
            };
            let weight = (time_us % interval_us) as f64 / *interval_us as f64;
            number(knot) * (1.0 - weight) + number(knot + 1) * weight
        })
        .sum()
}

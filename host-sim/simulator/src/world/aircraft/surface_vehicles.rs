//! Rover and boat, on slopes of ground or water: a sum of plane waves. Ground is fixed in place; water waves travel.

use std::array;
use std::f64::consts::TAU;

use crate::random::{RandomStream, StreamPurpose};
use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::{GRAVITY_M_S2, STEP_S, forward_right};
use crate::world::autopilot::VehicleCommand;
use crate::world::state::TrueState;
use crate::world::weather::Weather;

const WAVE_COUNT: usize = 24;

/// Plane wave with slope `slope cos(k (n cos d + e sin d) - w t + p)` along its direction `d`.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// Slope amplitude (height over distance).
    slope: f64,
    /// Wave number north and east, radians per metre.
    rad_per_m: [f64; 2],
    /// Unit direction vector, north and east.
    direction: [f64; 2],
    /// Angular frequency, radians per second; zero for ground.
    frequency_rad_s: f64,
    phase_rad: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Surface(Vec<Wave>);

impl Surface {
    /// Ground with wavelengths of 5 to 40 m in all directions; `slope_deg` is the standard deviation of the slope along
    /// any direction.
    pub fn rough_ground(slope_deg: f64, seed: u64) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::Surface);
        // The mean square slope along a fixed direction is a quarter of the squared amplitude: one half from the wave
        // directions, one half from the cosine.
        let slope = libm::tan(slope_deg.to_radians()) * (4.0 / WAVE_COUNT as f64).sqrt();
        Self((0..WAVE_COUNT).map(|_| Wave::new(&mut random, slope, [5.0, 40.0], [0.0, TAU])).collect())
    }

    /// Waves of 8 to 20 m length (periods 2.3 to 3.6 s) that travel within 40 degrees of `toward_rad`; `slope_deg` is
    /// the standard deviation of the slope along `toward_rad`.
    pub fn water_waves(slope_deg: f64, toward_rad: f64, seed: u64) -> Self {
        const WAVE_DIRECTION_SPREAD_RAD: f64 = 0.7;
        let mut random = RandomStream::new(seed, StreamPurpose::Surface);
        // The mean square of the cosine over +-0.7 rad is 0.85.
        let slope = libm::tan(slope_deg.to_radians()) * (2.0 / 0.85 / WAVE_COUNT as f64).sqrt();
        let directions = [toward_rad - WAVE_DIRECTION_SPREAD_RAD, toward_rad + WAVE_DIRECTION_SPREAD_RAD];
        let travelling = |wave: Wave| {
            // Dispersion relation of deep water: w^2 = g k.
            let rad_per_m = libm::hypot(wave.rad_per_m[0], wave.rad_per_m[1]);
            Wave { frequency_rad_s: (GRAVITY_M_S2 * rad_per_m).sqrt(), ..wave }
        };
        Self((0..WAVE_COUNT).map(|_| travelling(Wave::new(&mut random, slope, [8.0, 20.0], directions))).collect())
    }

    /// Slope to the north and to the east, upward positive (height over distance).
    pub fn surface_slope(&self, [north_m, east_m]: [f64; 2], time_s: f64) -> [f64; 2] {
        self.sum_of_waves(|wave| wave.slope * libm::cos(wave.phase_at([north_m, east_m], time_s)))
    }

    /// Velocity of the water at the surface to the north and to the east, m/s, of waves in deep water: `g slope / w`.
    pub fn orbital_velocity(&self, [north_m, east_m]: [f64; 2], time_s: f64) -> [f64; 2] {
        self.sum_of_waves(|wave| {
            let speed_m_s = GRAVITY_M_S2 * wave.slope / wave.frequency_rad_s;
            speed_m_s * libm::sin(wave.phase_at([north_m, east_m], time_s))
        })
    }

    /// Sum of a component along the direction of each wave, north and east.
    fn sum_of_waves(&self, component: impl Fn(&Wave) -> f64) -> [f64; 2] {
        self.0.iter().fold([0.0; 2], |sum, wave| {
            let component = component(wave);
            [sum[0] + component * wave.direction[0], sum[1] + component * wave.direction[1]]
        })
    }
}

impl Wave {
    /// Standing wave that does not move: unevenness of the ground.
    fn new(random: &mut RandomStream, slope: f64, lengths_m: [f64; 2], directions_rad: [f64; 2]) -> Self {
        // The wavelength is distributed uniformly in its logarithm.
        let length_m = libm::exp(random.uniform(libm::log(lengths_m[0]), libm::log(lengths_m[1])));
        let (sin, cos) = libm::sincos(random.uniform(directions_rad[0], directions_rad[1]));
        let rad_per_m = TAU / length_m;
        Self {
            slope,
            rad_per_m: [rad_per_m * cos, rad_per_m * sin],
            direction: [cos, sin],
            frequency_rad_s: 0.0,
            phase_rad: random.uniform(0.0, TAU),
        }
    }

    fn phase_at(&self, [north_m, east_m]: [f64; 2], time_s: f64) -> f64 {
        let [number_north, number_east] = self.rad_per_m;
        number_north * north_m + number_east * east_m - self.frequency_rad_s * time_s + self.phase_rad
    }
}

/// Roll and pitch of a vehicle on a slope given along its nose and to its right, upward positive.
///
/// Pitch: `tan(theta) = ahead`. The down axis is normal to the slope: `cos(phi) cos(theta) = 1 / sqrt(1 + ahead^2 +
/// right^2)`, so `tan(phi) = -right cos(theta)`.
pub(super) fn roll_pitch_on_slope([ahead, right]: [f64; 2]) -> [f64; 2] {
    let pitch_rad = libm::atan(ahead);
    [-libm::atan(right * libm::cos(pitch_rad)), pitch_rad]
}

/// Heading of a vehicle whose turn rate follows the command with a delay.
#[derive(Clone, Copy, Debug)]
struct DelayedTurn {
    heading_rad: f64,
    rate_rad_s: f64,
    time_constant_s: f64,
}

impl DelayedTurn {
    fn new(config: &VehicleConfig, time_constant_s: f64) -> Self {
        Self { heading_rad: config.heading_deg.to_radians(), rate_rad_s: 0.0, time_constant_s }
    }

    fn advance(&mut self, command: VehicleCommand) {
        self.rate_rad_s += (command.flat_turn_rate_rad_s() - self.rate_rad_s) * STEP_S / self.time_constant_s;
        self.heading_rad += self.rate_rad_s * STEP_S;
    }

    /// Velocity ahead, to the north and to the east.
    fn velocity_m_s(&self, speed_m_s: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.heading_rad);
        [speed_m_s * cos, speed_m_s * sin]
    }
}

/// Ground slope along any direction, standard deviation, degrees.
const GROUND_SLOPE_SIGMA_DEG: f64 = 6.0;
/// Time constant of the rover's turn rate, seconds.
const ROVER_TURN_RATE_TIME_CONSTANT_S: f64 = 0.3;
/// Relative increase of motor current per unit of uphill slope.
const CURRENT_PER_SLOPE: f64 = 5.0;

#[derive(Clone, Debug)]
pub(super) struct Rover {
    config: VehicleConfig,
    ground: Surface,
    turn: DelayedTurn,
}

impl Rover {
    pub fn new(config: VehicleConfig, seed: u64) -> Self {
        let ground = Surface::rough_ground(GROUND_SLOPE_SIGMA_DEG, seed);
        Self { config, ground, turn: DelayedTurn::new(&config, ROVER_TURN_RATE_TIME_CONSTANT_S) }
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        self.turn.advance(command);
        let slope = forward_right(
            self.turn.heading_rad,
            self.ground.surface_slope([previous_state.north_m, previous_state.east_m], 0.0),
        );
        let [roll_rad, pitch_rad] = roll_pitch_on_slope(slope);
        let speed_m_s = self.config.speed_m_s;
        let [north_m_s, east_m_s] = self.turn.velocity_m_s(speed_m_s);
        TrueState {
            roll_rad,
            pitch_rad,
            heading_rad: self.turn.heading_rad,
            north_m_s,
            east_m_s,
            disturbing_acceleration_m_s2: (speed_m_s * self.turn.rate_rad_s).abs(),
            relative_current: (1.0 + CURRENT_PER_SLOPE * slope[0]).max(0.0),
            ..TrueState::default()
        }
    }
}

/// Wave slope along the direction of travel, standard deviation, degrees.
const WAVE_SLOPE_SIGMA_DEG: f64 = 6.0;
/// Roll per slope of the water, which the hull amplifies.
const ROLL_PER_SLOPE: f64 = 1.3;
/// Pitch per slope of the water, which the length of the hull averages.
const PITCH_PER_SLOPE: f64 = 0.6;
/// Outward heel as a share of the angle `turn acceleration / g`.
const HEEL_PER_TURN_ANGLE: f64 = 0.5;
/// Time constant of the boat's turn rate, seconds.
const BOAT_TURN_RATE_TIME_CONSTANT_S: f64 = 1.0;
/// Time in which the hull takes on the motion of the water, seconds: near hull speed the resistance of 5 % of the weight grows
/// with the fourth power of the speed.
const DRAG_TIME_CONSTANT_S: f64 = 1.5;

#[derive(Clone, Debug)]
pub(super) struct Boat {
    config: VehicleConfig,
    water: Surface,
    turn: DelayedTurn,
    /// Velocity north and east by the waves.
    wave_velocity_m_s: [f64; 2],
}

impl Boat {
    pub fn new(config: VehicleConfig, weather: Weather, seed: u64) -> Self {
        let water =
            Surface::water_waves(WAVE_SLOPE_SIGMA_DEG, weather.wind_from_deg.to_radians() + std::f64::consts::PI, seed);
        Self {
            config,
            water,
            turn: DelayedTurn::new(&config, BOAT_TURN_RATE_TIME_CONSTANT_S),
            wave_velocity_m_s: [0.0; 2],
        }
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        self.turn.advance(command);
        let time_s = previous_state.time_s();
        let place_m = [previous_state.north_m, previous_state.east_m];
        let slope = self.water.surface_slope(place_m, time_s);
        let water_m_s = self.water.orbital_velocity(place_m, time_s);
        let [ahead, right] = forward_right(self.turn.heading_rad, slope);
        // Sloping water accelerates the boat by `g * slope`, its motion carries it along.
        self.wave_velocity_m_s = array::from_fn(|axis| {
            let velocity_m_s = self.wave_velocity_m_s[axis];
            let drag_m_s2 = (velocity_m_s - water_m_s[axis]) / DRAG_TIME_CONSTANT_S;
            velocity_m_s - (GRAVITY_M_S2 * slope[axis] + drag_m_s2) * STEP_S
        });
        let speed_m_s = self.config.speed_m_s;
        let centripetal_m_s2 = speed_m_s * self.turn.rate_rad_s;
        let [rolled_rad, pitch_rad] = roll_pitch_on_slope([PITCH_PER_SLOPE * ahead, ROLL_PER_SLOPE * right]);
        let [north_m_s, east_m_s] = self.turn.velocity_m_s(speed_m_s);
        TrueState {
            roll_rad: rolled_rad - HEEL_PER_TURN_ANGLE * centripetal_m_s2 / GRAVITY_M_S2,
            pitch_rad,
            heading_rad: self.turn.heading_rad,
            north_m_s: north_m_s + self.wave_velocity_m_s[0],
            east_m_s: east_m_s + self.wave_velocity_m_s[1],
            disturbing_acceleration_m_s2: centripetal_m_s2.abs() + GRAVITY_M_S2 * libm::hypot(ahead, right),
            relative_current: 1.0,
            ..TrueState::default()
        }
    }
}

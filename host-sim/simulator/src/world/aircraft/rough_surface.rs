//! Slopes of rough ground and of water: a sum of plane waves. Ground is fixed in place; water waves travel.

use std::f64::consts::TAU;

use crate::random::{RandomStream, StreamPurpose};
use crate::world::aircraft::motion::GRAVITY_M_S2;

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

//! Rotations of the simulated world in `f64`, derived independently of the library.
//!
//! A sign error in the library's rotations would cancel if the world used them too. So no code that computes the
//! simulated field uses the library's rotations.
//!
//! Axes: north, east, down for the Earth; forward, right, down for the body. Earth axes become body axes by a yaw about
//! the down axis, a pitch about the right wing, and a roll about the nose (Euler ZYX; B. L. Stevens, F. L. Lewis,
//! "Aircraft Control and Simulation", section 1.3). Each elementary matrix transforms the components of a fixed vector
//! to the rotated axes.

use nalgebra::{Matrix3, Vector3};

/// Euler angles of the body axes, radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Euler {
    /// Roll phi about the nose, right wing down positive.
    pub roll_rad: f64,
    /// Pitch theta about the right wing, nose up positive.
    pub pitch_rad: f64,
    /// Heading psi about the down axis, clockwise from magnetic north seen from above.
    pub heading_rad: f64,
}

impl Euler {
    /// Attitude from degrees.
    #[must_use]
    pub fn from_deg(roll_deg: f64, pitch_deg: f64, heading_deg: f64) -> Self {
        let [roll_rad, pitch_rad, heading_rad] = [roll_deg, pitch_deg, heading_deg].map(f64::to_radians);
        Self { roll_rad, pitch_rad, heading_rad }
    }

    /// Rotation matrix from north, east, down to forward, right, down: `R_x(phi) R_y(theta) R_z(psi)`.
    #[must_use]
    pub fn body_from_earth(&self) -> Matrix3<f64> {
        self.body_from_level() * about_z(self.heading_rad)
    }

    /// Rotation matrix from level axes (x along the horizontal projection of the nose, z down) to body axes: `R_x(phi)
    /// R_y(theta)`.
    #[must_use]
    pub fn body_from_level(&self) -> Matrix3<f64> {
        about_x(self.roll_rad) * about_y(self.pitch_rad)
    }

    /// Earth's field in body axes, in the unit of `total`.
    #[must_use]
    pub fn body_field(&self, total: f64, inclination_rad: f64) -> Vector3<f64> {
        self.body_from_earth() * earth_field(total, inclination_rad)
    }
}

/// Earth's field north, east, down, in the unit of `total`. The east component is zero because north is magnetic north.
/// Inclination is positive where the field points down (northern hemisphere).
#[must_use]
pub fn earth_field(total: f64, inclination_rad: f64) -> Vector3<f64> {
    Vector3::new(total * libm::cos(inclination_rad), 0.0, total * libm::sin(inclination_rad))
}

/// Rotation of the axes about x, y towards z.
fn about_x(angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, sin, 0.0, -sin, cos)
}

/// Rotation of the axes about y, z towards x.
fn about_y(angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    Matrix3::new(cos, 0.0, -sin, 0.0, 1.0, 0.0, sin, 0.0, cos)
}

fn about_z(angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_near(computed: Vector3<f64>, expected: [f64; 3]) {
        assert!((computed - Vector3::from(expected)).norm() < 1e-12, "{computed:?} for {expected:?}");
    }

    #[test]
    fn a_field_points_north_and_with_positive_inclination_down() {
        assert_near(earth_field(50.0, 0.0), [50.0, 0.0, 0.0]);
        assert_near(earth_field(50.0, 90_f64.to_radians()), [0.0, 0.0, 50.0]);
        assert_near(earth_field(50.0, -30_f64.to_radians()), [50.0 * 0.75_f64.sqrt(), 0.0, -25.0]);
    }

    /// Earth axes (north, east, down) in the body (forward, right, down): headings are clockwise from north, pitch is nose up,
    /// roll is right wing down, in the order yaw, pitch, roll.
    #[test]
    fn earth_axes_in_the_body_follow_heading_pitch_and_roll() {
        const FORWARD: [f64; 3] = [1.0, 0.0, 0.0];
        const BACK: [f64; 3] = [-1.0, 0.0, 0.0];
        const RIGHT: [f64; 3] = [0.0, 1.0, 0.0];
        const LEFT: [f64; 3] = [0.0, -1.0, 0.0];
        const BELOW: [f64; 3] = [0.0, 0.0, 1.0];
        const ABOVE: [f64; 3] = [0.0, 0.0, -1.0];
        for (roll_pitch_heading_deg, axes) in [
            ([0.0, 0.0, 0.0], [FORWARD, RIGHT, BELOW]),
            ([0.0, 0.0, 90.0], [LEFT, FORWARD, BELOW]),
            ([0.0, 0.0, 180.0], [BACK, LEFT, BELOW]),
            ([0.0, 0.0, 270.0], [RIGHT, BACK, BELOW]),
            ([0.0, 90.0, 0.0], [BELOW, RIGHT, BACK]),
            ([90.0, 0.0, 0.0], [FORWARD, ABOVE, RIGHT]),
            // Heading east; after pitching up the body's down axis points east, after rolling right its right one.
            ([90.0, 90.0, 90.0], [BELOW, RIGHT, BACK]),
        ] {
            let [roll_deg, pitch_deg, heading_deg] = roll_pitch_heading_deg;
            let rotation = Euler::from_deg(roll_deg, pitch_deg, heading_deg).body_from_earth();
            for (axis, expected) in axes.into_iter().enumerate() {
                assert_near(rotation.column(axis).into(), expected);
            }
        }
    }
}

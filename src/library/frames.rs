//! Reference frames as types, attitude, and angles.
//!
//! A magnetic field is a [`Field`]`<F>` with the frame `F` of its components: [`Sensor`], [`Body`] or [`Level`].
//! [`Calibration::calibrated_field`](crate::calibration::Calibration::calibrated_field) converts from sensor to body
//! axes, [`RollPitch::to_level_frame`] to the level frame, and only a level field has a heading, so no conversion can be
//! omitted. Conventions: [crate docs](crate).

use core::f32::consts::{PI, TAU};
use core::marker::PhantomData;

use nalgebra::Vector3;

use crate::trig;
use crate::trig::{VectorLength as _, sqrt};

/// Axes of the magnetometer chip's registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {}

/// Axes of the attitude source, FRD: x forward, y right, z down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {}

/// Body axes without roll and pitch: x along the horizontal projection of the nose, z down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {}

/// Magnetic field in frame `F`, in microtesla unless stated otherwise.
#[derive(Debug, PartialEq)]
pub struct Field<F> {
    /// Components x, y, z, microtesla.
    pub ut: Vector3<f32>,
    frame: PhantomData<F>,
}

// Derived implementations would require `F: Copy`.
impl<F> Clone for Field<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Field<F> {}

impl<F> Field<F> {
    /// A field from its components x, y, z, microtesla.
    #[must_use]
    pub const fn from_ut(x: f32, y: f32, z: f32) -> Self {
        Self::new(Vector3::new(x, y, z))
    }

    /// A field from its vector, microtesla.
    #[must_use]
    pub const fn new(ut: Vector3<f32>) -> Self {
        Self { ut, frame: PhantomData }
    }

    /// Field strength, microtesla.
    #[must_use]
    pub fn total_ut(&self) -> f32 {
        self.ut.vector_length()
    }
}

/// Roll and pitch.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct RollPitch {
    /// Roll phi, radians, right wing down positive, -pi..pi.
    pub roll_rad: f32,
    /// Pitch theta, radians, nose up positive, -pi/2..pi/2.
    pub pitch_rad: f32,
}

impl RollPitch {
    /// An attitude from roll and pitch, degrees.
    #[must_use]
    pub fn from_deg(roll_deg: f32, pitch_deg: f32) -> Self {
        Self { roll_rad: roll_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
    }

    /// Rotation from body to level frame, for repeated use.
    #[must_use]
    #[inline]
    pub fn tilt_rotation(&self) -> AttitudeRotation {
        let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) =
            (trig::sin_cos(self.roll_rad), trig::sin_cos(self.pitch_rad));
        AttitudeRotation { sin_roll, cos_roll, sin_pitch, cos_pitch }
    }

    /// Rotates a body field to the level frame.
    #[must_use]
    #[inline]
    pub fn to_level_frame(&self, body: Field<Body>) -> Field<Level> {
        self.tilt_rotation().to_level_frame(body)
    }

    /// Rotates a level field to the body frame, the inverse of [`to_level_frame`](Self::to_level_frame).
    #[must_use]
    #[inline]
    pub fn to_body_frame(&self, level: Field<Level>) -> Field<Body> {
        self.tilt_rotation().to_body_frame(level)
    }
}

/// Rotation `C = R_y(theta)^T R_x(phi)^T` from body to level frame (Liu 2007 eq. 7 in FRD axes).
#[derive(Clone, Copy, Debug)]
pub struct AttitudeRotation {
    sin_roll: f32,
    cos_roll: f32,
    sin_pitch: f32,
    cos_pitch: f32,
}

impl AttitudeRotation {
    /// Unit vector down, body axes.
    #[must_use]
    #[inline]
    pub(crate) fn down_in_body(&self) -> Vector3<f32> {
        Vector3::new(-self.sin_pitch, self.cos_pitch * self.sin_roll, self.cos_pitch * self.cos_roll)
    }

    #[must_use]
    pub(crate) const fn sin_pitch(&self) -> f32 {
        self.sin_pitch
    }

    #[must_use]
    pub(crate) const fn cos_pitch(&self) -> f32 {
        self.cos_pitch
    }

    /// Rotates a body field to the level frame: `C h` (Liu 2007 eq. 7).
    #[must_use]
    #[inline]
    pub fn to_level_frame(&self, body: Field<Body>) -> Field<Level> {
        let body = body.ut;
        let lower = self.sin_roll * body.y + self.cos_roll * body.z;
        Field::from_ut(
            self.cos_pitch * body.x + self.sin_pitch * lower,
            self.cos_roll * body.y - self.sin_roll * body.z,
            self.cos_pitch * lower - self.sin_pitch * body.x,
        )
    }

    /// Rotates a level field to the body frame: `C^T l`.
    #[must_use]
    #[inline]
    pub fn to_body_frame(&self, level: Field<Level>) -> Field<Body> {
        let level = level.ut;
        let lower = self.sin_pitch * level.x + self.cos_pitch * level.z;
        Field::from_ut(
            self.cos_pitch * level.x - self.sin_pitch * level.z,
            self.sin_roll * lower + self.cos_roll * level.y,
            self.cos_roll * lower - self.sin_roll * level.y,
        )
    }
}

impl Field<Level> {
    /// Earth's field in the level frame: `H0 [cos psi, -sin psi, tan I]` with `H0 = F cos I` (Liu 2007 eq. 7). Strength
    /// `F` in microtesla, inclination `I` in radians, positive down, magnetic heading in radians.
    #[must_use]
    pub fn earth_field(total_ut: f32, inclination_rad: f32, heading_rad: f32) -> Self {
        let (sin_inclination, cos_inclination) = trig::sin_cos(inclination_rad);
        let (sin_heading, cos_heading) = trig::sin_cos(heading_rad);
        let horizontal_ut = total_ut * cos_inclination;
        Self::from_ut(horizontal_ut * cos_heading, -horizontal_ut * sin_heading, total_ut * sin_inclination)
    }

    /// Magnetic heading `psi = atan2(-l_y, l_x)`, radians, 0..2 pi (Liu 2007 eq. 3); 0 without a horizontal component.
    #[must_use]
    pub fn heading_rad(&self) -> f32 {
        wrap_two_pi(libm::atan2f(-self.ut.y, self.ut.x))
    }

    /// Inclination `atan2(l_z, hypot(l_x, l_y))`, radians, positive down, -pi/2..pi/2.
    #[must_use]
    pub fn inclination_rad(&self) -> f32 {
        libm::atan2f(self.ut.z, sqrt(self.ut.x * self.ut.x + self.ut.y * self.ut.y))
    }
}

/// Wraps an angle in radians to -pi..pi. NaN and infinity give NaN or infinity.
#[must_use]
#[inline]
pub fn wrap_pi(angle_rad: f32) -> f32 {
    // Fast path: most angles are in range.
    if angle_rad.abs() <= PI { angle_rad } else { angle_rad - TAU * libm::floorf((angle_rad + PI) / TAU) }
}

/// Wraps an angle in radians to 0..2 pi, exclusive.
#[must_use]
#[inline]
pub fn wrap_two_pi(angle_rad: f32) -> f32 {
    let wrapped = wrap_pi(angle_rad);
    let wrapped = if wrapped < 0.0 { wrapped + TAU } else { wrapped };
    // A tiny negative angle rounds to 2 pi.
    if wrapped >= TAU { 0.0 } else { wrapped }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// Tolerance of a few units in the last place.
    fn assert_near(found: Vector3<f32>, expected: [f32; 3]) {
        let expected = Vector3::from(expected);
        assert!((found - expected).norm() < 2e-7 * (1.0 + expected.norm()) * 3.0, "{found} {expected}");
    }

    /// Roll lowers the right wing, pitch raises the nose, and roll is removed before pitch: from Liu 2007 eq. 7 by hand.
    #[test]
    fn attitude_has_the_signs_and_order_of_liu() {
        const COS_30: f32 = 0.866_025_4;
        let lower = 0.5 * 2.0 + COS_30 * 3.0;
        for (roll_deg, pitch_deg, body, level) in [
            (90.0, 0.0, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
            (90.0, 0.0, [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
            (0.0, 90.0, [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
            (0.0, 90.0, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]),
            (30.0, 60.0, [1.0, 2.0, 3.0], [0.5 + COS_30 * lower, COS_30 * 2.0 - 0.5 * 3.0, 0.5 * lower - COS_30]),
        ] {
            let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
            assert_near(attitude.to_level_frame(Field::new(body.into())).ut, level);
        }
    }

    /// nalgebra uses the same ZYX angles, body to earth.
    #[test]
    fn level_and_body_rotations_are_inverse_and_match_nalgebra() {
        let field = Vector3::new(20.0, -7.0, 43.0);
        for roll_deg in [-170.0, -45.0, 0.0, 10.0, 80.0] {
            for pitch_deg in [-85.0, -20.0, 0.0, 35.0, 60.0] {
                let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
                let rotation = Rotation3::from_euler_angles(attitude.roll_rad, attitude.pitch_rad, 0.0);
                let level = attitude.to_level_frame(Field::new(field));
                assert_near(level.ut, (rotation * field).into());
                assert_near(attitude.to_body_frame(Field::new(field)).ut, (rotation.inverse() * field).into());
                assert_near(attitude.to_body_frame(level).ut, field.into());
                assert_near(attitude.to_level_frame(attitude.to_body_frame(Field::new(field))).ut, field.into());
                assert_near(
                    attitude.tilt_rotation().down_in_body(),
                    attitude.to_body_frame(Field::from_ut(0.0, 0.0, 1.0)).ut.into(),
                );
                assert!((attitude.tilt_rotation().cos_pitch() - attitude.pitch_rad.cos()).abs() < 2e-7);
            }
        }
    }

    /// An inclination of 60 deg halves the horizontal field; heading east, north is to the left.
    #[test]
    fn the_earth_field_turns_against_the_heading() {
        let earth = |inclination_deg: f32, heading_deg: f32| {
            Field::<Level>::earth_field(50.0, inclination_deg.to_radians(), heading_deg.to_radians()).ut
        };
        assert_near(earth(60.0, 0.0), [25.0, 0.0, 43.301_27]);
        assert_near(earth(60.0, 90.0), [0.0, -25.0, 43.301_27]);
        assert_near(earth(60.0, 180.0), [-25.0, 0.0, 43.301_27]);
        assert_near(earth(-60.0, 270.0), [0.0, 25.0, -43.301_27]);
        assert_near(earth(0.0, 30.0), [43.301_27, -25.0, 0.0]);
    }

    #[test]
    fn a_level_field_shows_heading_inclination_and_intensity() {
        let heading_deg = |x, y| Field::<Level>::from_ut(x, y, 7.0).heading_rad().to_degrees();
        let expected = [
            ((2.0, 0.0), 0.0),
            ((1.0, -1.0), 45.0),
            ((0.0, -3.0), 90.0),
            ((-1.0, -1.0), 135.0),
            ((-1.0, 0.0), 180.0),
            ((-1.0, 1.0), 225.0),
            ((0.0, 1.0), 270.0),
            ((1.0, 1.0), 315.0),
            ((0.0, 0.0), 0.0),
        ];
        for ((x, y), degrees) in expected {
            assert!((heading_deg(x, y) - degrees).abs() < 1e-4, "{x} {y}: {}", heading_deg(x, y));
        }
        // Just west of north rounds to 360 deg, which is 0.
        assert!(heading_deg(1.0, 1e-9).abs() < f32::EPSILON);
        let inclination_deg = |z| Field::<Level>::from_ut(3.0, 4.0, z).inclination_rad().to_degrees();
        assert!((inclination_deg(5.0) - 45.0).abs() < 1e-4);
        assert!((inclination_deg(-5.0) + 45.0).abs() < 1e-4);
        assert!((Field::<Level>::from_ut(0.0, 0.0, 2.0).inclination_rad() - PI / 2.0).abs() < 1e-6);
        assert!((Field::<Body>::from_ut(2.0, -3.0, 6.0).total_ut() - 7.0).abs() < 1e-6);
    }

    #[test]
    fn angles_wrap_at_their_edges_and_nowhere_else() {
        let same = |a: f32, b: f32| (a - b).sin().abs() < 2e-6 && (a - b).cos() > 0.999;
        for half_turns in -5_i8..=5 {
            let edge = f32::from(half_turns) * PI;
            for angle_rad in [edge.next_down(), edge, edge.next_up(), edge - 0.1, edge + 0.1, edge - 1.5, edge + 1.5] {
                let (pi, two_pi) = (wrap_pi(angle_rad), wrap_two_pi(angle_rad));
                // `f32` rounding after several turns: up to 1e-6 rad at an edge of the range.
                assert!(pi.abs() < PI + 2e-6 && same(pi, angle_rad), "{angle_rad}: {pi}");
                assert!((0.0..TAU).contains(&two_pi) && same(two_pi, angle_rad), "{angle_rad}: {two_pi}");
            }
        }
        let exactly = |found: f32, expected: f32| assert_eq!(found.to_bits(), expected.to_bits());
        // Angles in range are unchanged.
        for angle_rad in [PI, -PI, PI.next_down(), 1.0, -1.0, 0.0] {
            exactly(wrap_pi(angle_rad), angle_rad);
        }
        for angle_rad in [0.0, 1.0, PI, TAU.next_down()] {
            exactly(wrap_two_pi(angle_rad), angle_rad);
        }
        exactly(wrap_two_pi(TAU), 0.0);
        exactly(wrap_two_pi(-1e-9), 0.0);
        assert!((wrap_two_pi(-0.5) - (TAU - 0.5)).abs() < 1e-6);
        assert!(wrap_pi(PI.next_up()) < 0.0 && wrap_pi((-PI).next_down()) > 0.0);
    }

    #[test]
    fn non_finite_angles_stay_non_finite_when_wrapped() {
        for angle_rad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!wrap_pi(angle_rad).is_finite() && !wrap_two_pi(angle_rad).is_finite(), "{angle_rad}");
        }
    }
}

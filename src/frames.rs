//! Frames in types, attitude, and angles.
//!
//! A magnetic field is a [`Field`]`<F>` where `F` says in which frame its components are: [`Sensor`], [`Body`] or
//! [`Level`]. [`Calibration::apply`](crate::calibration::Calibration::apply) takes it from sensor to body axes,
//! [`Attitude::level`] from there to the level frame, and only a field in the level frame has a heading; so a frame
//! cannot be forgotten. Frames and signs are those of the [crate docs](crate).

use core::f32::consts::{PI, TAU};
use core::marker::PhantomData;

use nalgebra::Vector3;

use crate::trig;

/// Axes of the magnetometer chip, as its registers report them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {}

/// Axes of the attitude source, FRD: x forward, y right, z down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {}

/// Body axes with roll and pitch taken out: x along the horizontal projection of the nose, z down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {}

/// A magnetic field in frame `F`, in microtesla unless a unit of field is said.
///
/// The frame is only in the type: the field is its three components in memory, and there is no way from one frame to
/// another but the functions that turn the components.
#[derive(Debug, PartialEq)]
pub struct Field<F> {
    /// Components x, y, z along the axes of the frame, in microtesla.
    pub ut: Vector3<f32>,
    frame: PhantomData<F>,
}

// Derived implementations would ask `F: Copy`, which says nothing about the field.
impl<F> Clone for Field<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Field<F> {}

impl<F> Field<F> {
    /// A field from its components x, y, z in microtesla.
    #[must_use]
    pub const fn from_ut(x: f32, y: f32, z: f32) -> Self {
        Self::new(Vector3::new(x, y, z))
    }

    /// A field from its vector in microtesla.
    #[must_use]
    pub const fn new(ut: Vector3<f32>) -> Self {
        Self { ut, frame: PhantomData }
    }

    /// Total intensity in microtesla.
    #[must_use]
    pub fn total_ut(&self) -> f32 {
        self.ut.norm()
    }
}

/// Roll and pitch of the aircraft. Heading is what this crate is asked for, so it is not a part of it.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Attitude {
    /// Roll phi in radians, right wing down positive, -pi..pi.
    pub roll_rad: f32,
    /// Pitch theta in radians, nose up positive, -pi/2..pi/2.
    pub pitch_rad: f32,
}

impl Attitude {
    /// An attitude from roll and pitch in degrees.
    #[must_use]
    pub fn from_deg(roll_deg: f32, pitch_deg: f32) -> Self {
        Self { roll_rad: roll_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
    }

    /// Its rotation, for more than one use.
    #[must_use]
    pub fn tilt(&self) -> Tilt {
        let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) =
            (trig::sin_cos(self.roll_rad), trig::sin_cos(self.pitch_rad));
        Tilt { sin_roll, cos_roll, sin_pitch, cos_pitch }
    }

    /// Takes roll and pitch out of a body field.
    #[must_use]
    pub fn level(&self, body: Field<Body>) -> Field<Level> {
        self.tilt().level(body)
    }

    /// Puts roll and pitch into a level field: the inverse of [`level`](Self::level).
    #[must_use]
    pub fn body(&self, level: Field<Level>) -> Field<Body> {
        self.tilt().body(level)
    }
}

/// An attitude's rotation `C = R_y(theta)^T R_x(phi)^T` that takes body components to level components (Liu 2007 eq. 7
/// in FRD axes).
#[derive(Clone, Copy, Debug)]
pub struct Tilt {
    sin_roll: f32,
    cos_roll: f32,
    sin_pitch: f32,
    cos_pitch: f32,
}

impl Tilt {
    /// The down direction in body axes, a unit vector.
    #[must_use]
    pub(crate) fn down(&self) -> Vector3<f32> {
        Vector3::new(-self.sin_pitch, self.cos_pitch * self.sin_roll, self.cos_pitch * self.cos_roll)
    }

    /// Sine of pitch.
    #[must_use]
    pub(crate) const fn sin_pitch(&self) -> f32 {
        self.sin_pitch
    }

    /// Cosine of pitch.
    #[must_use]
    pub(crate) const fn cos_pitch(&self) -> f32 {
        self.cos_pitch
    }

    /// Takes roll and pitch out of a body field: `C h` (Liu 2007 eq. 7).
    #[must_use]
    pub fn level(&self, body: Field<Body>) -> Field<Level> {
        let body = body.ut;
        let lower = self.sin_roll * body.y + self.cos_roll * body.z;
        Field::from_ut(
            self.cos_pitch * body.x + self.sin_pitch * lower,
            self.cos_roll * body.y - self.sin_roll * body.z,
            self.cos_pitch * lower - self.sin_pitch * body.x,
        )
    }

    /// Puts roll and pitch into a level field: `C^T l`, the inverse of [`level`](Self::level).
    #[must_use]
    pub fn body(&self, level: Field<Level>) -> Field<Body> {
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
    /// The Earth field in the level frame at a heading: `H0 [cos psi, -sin psi, tan I]` with `H0 = F cos I` (Liu 2007
    /// eq. 7). Total intensity `F` in microtesla, inclination `I` in radians and positive down, magnetic heading in
    /// radians.
    #[must_use]
    pub fn earth(total_ut: f32, inclination_rad: f32, heading_rad: f32) -> Self {
        let (sin_inclination, cos_inclination) = trig::sin_cos(inclination_rad);
        let (sin_heading, cos_heading) = trig::sin_cos(heading_rad);
        let horizontal_ut = total_ut * cos_inclination;
        Self::from_ut(horizontal_ut * cos_heading, -horizontal_ut * sin_heading, total_ut * sin_inclination)
    }

    /// Magnetic heading `psi = atan2(-l_y, l_x)` in radians, 0..2 pi (Liu 2007 eq. 3). A field without a horizontal
    /// part has no heading; the result is then 0.
    #[must_use]
    pub fn heading_rad(&self) -> f32 {
        wrap_two_pi(libm::atan2f(-self.ut.y, self.ut.x))
    }

    /// Inclination (dip) `atan2(l_z, hypot(l_x, l_y))` in radians, positive down, -pi/2..pi/2.
    #[must_use]
    pub fn inclination_rad(&self) -> f32 {
        libm::atan2f(self.ut.z, libm::sqrtf(self.ut.x * self.ut.x + self.ut.y * self.ut.y))
    }
}

/// Wraps an angle in radians to -pi..pi, to the last digit of the angle given. What is not finite stays not finite.
#[must_use]
pub fn wrap_pi(angle_rad: f32) -> f32 {
    // Most angles are within the circle already.
    if angle_rad.abs() <= PI { angle_rad } else { wrap_far(angle_rad) }
}

/// Wraps an angle that is not. In flash once, not wherever an angle is wrapped.
#[inline(never)]
fn wrap_far(angle_rad: f32) -> f32 {
    angle_rad - TAU * libm::floorf((angle_rad + PI) / TAU)
}

/// Wraps an angle in radians to 0..2 pi; the upper end is never returned.
#[must_use]
pub fn wrap_two_pi(angle_rad: f32) -> f32 {
    let wrapped = wrap_pi(angle_rad);
    let wrapped = if wrapped < 0.0 { wrapped + TAU } else { wrapped };
    // A tiny negative angle rounds to 2 pi itself.
    if wrapped >= TAU { 0.0 } else { wrapped }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// A few of f32's last digits of a field of this size.
    fn assert_near(found: Vector3<f32>, expected: [f32; 3]) {
        let expected = Vector3::from(expected);
        assert!((found - expected).norm() < 2e-7 * (1.0 + expected.norm()) * 3.0, "{found} {expected}");
    }

    fn level(roll_deg: f32, pitch_deg: f32, body: [f32; 3]) -> Vector3<f32> {
        Attitude::from_deg(roll_deg, pitch_deg).level(Field::new(body.into())).ut
    }

    /// Liu 2007 eq. 7 by hand. On its right side an aircraft has its right wing below and its belly to the left.
    #[test]
    fn roll_lowers_the_right_wing() {
        assert_near(level(90.0, 0.0, [1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]);
        assert_near(level(90.0, 0.0, [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
        assert_near(level(90.0, 0.0, [0.0, 0.0, 1.0]), [0.0, -1.0, 0.0]);
        assert_near(level(30.0, 0.0, [0.0, 2.0, 0.0]), [0.0, 1.732_050_8, 1.0]);
        assert_near(level(-30.0, 0.0, [0.0, 2.0, 0.0]), [0.0, 1.732_050_8, -1.0]);
    }

    /// Standing on its tail an aircraft has its nose above and its belly ahead.
    #[test]
    fn pitch_raises_the_nose() {
        assert_near(level(0.0, 90.0, [1.0, 0.0, 0.0]), [0.0, 0.0, -1.0]);
        assert_near(level(0.0, 90.0, [0.0, 1.0, 0.0]), [0.0, 1.0, 0.0]);
        assert_near(level(0.0, 90.0, [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]);
        assert_near(level(0.0, 30.0, [2.0, 0.0, 0.0]), [1.732_050_8, 0.0, -1.0]);
        assert_near(level(0.0, -30.0, [2.0, 0.0, 0.0]), [1.732_050_8, 0.0, 1.0]);
    }

    /// Roll 30 and pitch 60 deg of a field along all three axes, by hand: in pitch the lower part is `s_r y + c_r z`.
    #[test]
    fn roll_is_taken_out_before_pitch() {
        let lower = 0.5 * 2.0 + 0.866_025_4 * 3.0;
        let expected = [0.5 + 0.866_025_4 * lower, 0.866_025_4 * 2.0 - 0.5 * 3.0, 0.5 * lower - 0.866_025_4];
        assert_near(level(30.0, 60.0, [1.0, 2.0, 3.0]), expected);
    }

    /// nalgebra's Euler angles are the same ZYX, body to earth.
    #[test]
    fn level_and_body_are_the_rotations_of_the_attitude_and_inverse() {
        let field = Vector3::new(20.0, -7.0, 43.0);
        for roll_deg in [-170.0, -45.0, 0.0, 10.0, 80.0] {
            for pitch_deg in [-85.0, -20.0, 0.0, 35.0, 60.0] {
                let attitude = Attitude::from_deg(roll_deg, pitch_deg);
                let rotation = Rotation3::from_euler_angles(attitude.roll_rad, attitude.pitch_rad, 0.0);
                let level = attitude.level(Field::new(field));
                assert_near(level.ut, (rotation * field).into());
                assert_near(attitude.body(Field::new(field)).ut, (rotation.inverse() * field).into());
                assert_near(attitude.body(level).ut, field.into());
                assert_near(attitude.level(attitude.body(Field::new(field))).ut, field.into());
                assert_near(attitude.tilt().down(), attitude.body(Field::from_ut(0.0, 0.0, 1.0)).ut.into());
                assert!((attitude.tilt().cos_pitch() - attitude.pitch_rad.cos()).abs() < 2e-7);
            }
        }
    }

    /// 60 deg of inclination halve the horizontal field; north lies to the left of a nose that points east.
    #[test]
    fn the_earth_field_turns_against_the_heading() {
        let earth = |inclination_deg: f32, heading_deg: f32| {
            Field::<Level>::earth(50.0, inclination_deg.to_radians(), heading_deg.to_radians()).ut
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
        // Just west of north rounds to the full circle, which is north.
        assert!(heading_deg(1.0, 1e-9).abs() < f32::EPSILON);
        let inclination_deg = |z| Field::<Level>::from_ut(3.0, 4.0, z).inclination_rad().to_degrees();
        assert!((inclination_deg(5.0) - 45.0).abs() < 1e-4);
        assert!((inclination_deg(-5.0) + 45.0).abs() < 1e-4);
        assert!((Field::<Level>::from_ut(0.0, 0.0, 2.0).inclination_rad() - PI / 2.0).abs() < 1e-6);
        assert!((Field::<Body>::from_ut(2.0, -3.0, 6.0).total_ut() - 7.0).abs() < 1e-6);
    }

    /// The same angle, and in range, on both sides of each edge.
    #[test]
    fn angles_wrap_at_their_edges_and_nowhere_else() {
        let same = |a: f32, b: f32| (a - b).sin().abs() < 2e-6 && (a - b).cos() > 0.999;
        for half_turns in -5_i8..=5 {
            let edge = f32::from(half_turns) * PI;
            for angle_rad in [edge.next_down(), edge, edge.next_up(), edge - 0.1, edge + 0.1, edge - 1.5, edge + 1.5] {
                let (pi, two_pi) = (wrap_pi(angle_rad), wrap_two_pi(angle_rad));
                // Several circles away the edge itself is rounded to 1e-6.
                assert!(pi.abs() < PI + 2e-6 && same(pi, angle_rad), "{angle_rad}: {pi}");
                assert!((0.0..TAU).contains(&two_pi) && same(two_pi, angle_rad), "{angle_rad}: {two_pi}");
            }
        }
        let exactly = |found: f32, expected: f32| assert_eq!(found.to_bits(), expected.to_bits());
        // What is in range stays as it is, to the last bit.
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
    fn what_is_no_angle_is_not_wrapped_to_one() {
        for angle_rad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!wrap_pi(angle_rad).is_finite() && !wrap_two_pi(angle_rad).is_finite(), "{angle_rad}");
        }
    }
}

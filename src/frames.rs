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

/// An attitude's rotation `C = R_y(theta)^T R_x(phi)^T` that takes body components to level components (Liu 2007 eq. 7 in FRD axes).
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

/// Wraps an angle in radians to -pi..pi. Not finite stays not finite.
#[must_use]
pub fn wrap_pi(angle_rad: f32) -> f32 {
    // Most angles are within the circle already.
    if angle_rad.abs() <= PI { angle_rad } else { angle_rad - TAU * libm::floorf((angle_rad + PI) / TAU) }
}

/// Wraps an angle in radians to 0..2 pi; the upper end is never returned.
#[must_use]
pub fn wrap_two_pi(angle_rad: f32) -> f32 {
    let wrapped = wrap_pi(angle_rad);
    let wrapped = if wrapped < 0.0 { wrapped + TAU } else { wrapped };
    // A tiny negative angle rounds to 2 pi itself.
    if wrapped >= TAU { 0.0 } else { wrapped }
}

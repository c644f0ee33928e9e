//! What the closed forms of a left and a right turn, [two planes](super::two_plane) and [four
//! ellipses](super::four_ellipse), have in common: how many samples they take, the banks of the turns, what their centres
//! say, and which way they run.

use nalgebra::Vector3;

use super::{Sample, Side, SolveError};
use crate::frames::wrap_pi;
use crate::trig;

/// Samples a side must have: five determine a conic, and each sector of 30 deg should have one.
pub(super) const MIN_SAMPLES: usize = 12;

/// Samples further apart in time than this say nothing about the way a turn runs, milliseconds: in 3 s even a sharp
/// turn of 30 deg/s stays below half a circle.
const MAX_STEP_MS: u32 = 3000;

/// The bank must differ by so much between the sides, as a sine: 10 deg.
const MIN_SINE_BETWEEN: f32 = 0.17;

/// The mean bank of a turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bank {
    /// Its sine, right wing down positive.
    pub sin: f32,
    /// Its cosine.
    pub cos: f32,
}

impl Bank {
    /// Of the samples of a turn; none without samples.
    pub fn mean_of(samples: &[Sample]) -> Self {
        let mean_rad = samples.iter().map(|s| s.attitude.roll_rad).sum::<f32>() / samples.len().max(1) as f32;
        let (sin, cos) = trig::sin_cos(mean_rad);
        Self { sin, cos }
    }

    /// Sine of the angle from this bank to another, by which the equations of the two turns are divided.
    ///
    /// # Errors
    ///
    /// [`SolveError::SamePlane`] when the banks are less than 10 deg apart.
    pub fn sine_to(self, other: Self) -> Result<f32, SolveError> {
        let sine = other.sin * self.cos - other.cos * self.sin;
        if sine.abs() < MIN_SINE_BETWEEN { Err(SolveError::SamePlane) } else { Ok(sine) }
    }
}

/// The centres of a left and a right turn: `c = r V + b` each (Liu 2007 eq. 14), with `V` the vertical field in units of
/// the horizontal one and `r` what the sensor measures, at the bank of that turn, of a vertical field of H0. Microtesla.
#[derive(Clone, Copy, Debug)]
pub(super) struct Centres {
    /// `c` of the left and of the right turn.
    pub centres_ut: [Vector3<f32>; 2],
    /// `r` of the left and of the right turn.
    pub by_vertical_ut: [Vector3<f32>; 2],
}

impl Centres {
    /// `V`, from the difference of the centres, in which `b` cancels: least squares of three equations.
    pub fn vertical(&self) -> f32 {
        let [left, right] = self.by_vertical_ut;
        let [centre_left, centre_right] = self.centres_ut;
        let between = right - left;
        between.dot(&(centre_right - centre_left)) / between.norm_squared()
    }

    /// `b`, from the sum of the centres, microtesla.
    pub fn hard_iron_ut(&self, vertical: f32) -> Vector3<f32> {
        let [left, right] = self.by_vertical_ut;
        let [centre_left, centre_right] = self.centres_ut;
        (centre_left + centre_right - (left + right) * vertical) / 2.0
    }
}

/// By how much an angle of the samples runs the way heading does in a turn of this side, up to the right, down to the
/// left: radians, positive if it runs the right way, 0 if the samples are too far apart to say.
pub(super) fn progress_rad(samples: &[Sample], side: Side, angle_rad: impl Fn(&Sample) -> f32) -> f32 {
    let progress_rad: f32 = samples
        .array_windows()
        .filter(|[a, b]| b.time.since(a.time) <= MAX_STEP_MS)
        .map(|[a, b]| wrap_pi(angle_rad(b) - angle_rad(a)))
        .sum();
    match side {
        Side::Left => -progress_rad,
        Side::Right => progress_rad,
    }
}

//! The field that an autopilot's compass is to read.
//!
//! From reading to what is told there is one affine map: the calibration in force, turned by the alignment, in the true
//! strength. A heading made of what is told, in level flight, is ours.
//!
//! # The alignment
//!
//! Alignment adds `a` to every heading. In level flight `(x, y) = H (cos psi, -sin psi)` (see the [crate docs](crate)), and
//! what is told is to be `H (cos(psi + a), -sin(psi + a))`, which is `(x cos a + y sin a, y cos a - x sin a)`.
//!
//! # Another correction in flight
//!
//! An autopilot steers by what it is told, so in the air another correction is not taken at once: what is told goes from
//! the old map to the new one with a weight that grows evenly, slowly enough that the heading made of it never turns by
//! more than [`MAX_TURN_DEG_S`] on account of it. If yet another correction comes meanwhile, the map that is told by then
//! is frozen, and what is told goes from there to the newest one. On the ground a correction is taken at once; so is one
//! after which nothing was told before.

#[cfg(test)]
mod tests;

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::Correction;
use crate::calibration::{Calibration, Uncertainty, inverse};
use crate::frames::{Attitude, Body, Field, Level, Sensor, wrap_pi};
use crate::time::Timestamp;
use crate::trig;

/// A heading made of what is told turns by no more than this on account of another correction, degrees a second.
const MAX_TURN_DEG_S: f32 = 1.0;

/// Headings that are looked at for it, and what may be missed between them: deviations are circles and ovals of a heading,
/// and of an oval a 24th of the circle shows 97 % of the largest.
const HEADINGS: u8 = 24;
const MISSED: f32 = 1.05;

/// No change takes longer, seconds. One that would, by 130 deg or more, is of headings that were none.
const MAX_BLEND_S: f32 = 300.0;

/// Inclination where none is known, radians: 70 deg, steep, where iron turns a heading by much.
const STEEP_RAD: f32 = 1.22;

/// Strengths that differ by a larger factor than this are not of the same field.
const MAX_SCALE: f32 = 2.0;

/// An attitude that stays within so much, radians, is one at rest: 0.3 deg, what a source rounds to tenths may noise...
const AT_REST_RAD: f32 = 0.005;

/// ... if it does for so long, microseconds, ...
const AT_REST_US: u64 = 2_000_000;

/// ... with no longer a gap in its reports than this, microseconds.
const MAX_GAP_US: u64 = 500_000;

/// From the field that is read to the one that is told: `w m + c`, a row for each axis of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Map([[f32; 4]; 3]);

impl Map {
    /// That of a calibration, turned by an alignment, in the true strength if that is known.
    fn new(calibration: &Calibration, correction: &Correction) -> Self {
        let (sin, cos) = trig::sin_cos(correction.align_deg.to_radians());
        let scale = scale(calibration, correction);
        let [x, y, z] = calibration.w.map(|row| Vector3::from(row) * scale);
        let b_ut = calibration.b_vector_ut();
        Self([x * cos + y * sin, y * cos - x * sin, z].map(|row| [row.x, row.y, row.z, -row.dot(&b_ut)]))
    }

    fn apply(&self, field: Field<Sensor>) -> Field<Body> {
        let m = field.ut;
        let row = |[wx, wy, wz, c]: &[f32; 4]| wx * m.x + wy * m.y + wz * m.z + c;
        let [x, y, z] = &self.0;
        Field::from_ut(row(x), row(y), row(z))
    }

    /// On the way from here to another one.
    fn toward(&self, other: &Self, weight: f32) -> Self {
        let Self(mut map) = *self;
        for (from, to) in map.as_flattened_mut().iter_mut().zip(other.0.as_flattened()) {
            *from += weight * (to - *from);
        }
        Self(map)
    }

    /// What is read where this is told; none if the map cannot be turned round.
    fn inverse(&self) -> Option<impl Fn(Field<Body>) -> Field<Sensor>> {
        let Self([x, y, z]) = *self;
        let inverse = inverse(&Matrix3::from_fn(|row, column| self.0[row][column]))?;
        let c_ut = Vector3::new(x[3], y[3], z[3]);
        Some(move |told: Field<Body>| Field::new(inverse * (told.ut - c_ut)))
    }
}

/// By how much the true strength is more than the sensor's; 1 if it is not known, or cannot be of the same field.
fn scale(calibration: &Calibration, correction: &Correction) -> f32 {
    let scale = correction.total_ut.map_or(1.0, |total_ut| total_ut / calibration.total_ut);
    if (MAX_SCALE.recip()..=MAX_SCALE).contains(&scale) { scale } else { 1.0 }
}

/// How long going from one map to another takes at [`MAX_TURN_DEG_S`], seconds: by the heading of level flight in the field
/// of the calibration that the new one is of.
#[inline(never)]
fn blend_s(from: &Map, to: &Map, calibration: &Calibration, correction: &Correction) -> f32 {
    let Some(read) = to.inverse() else { return 0.0 };
    let inclination_rad = if correction.knows_inclination { calibration.inclination_rad } else { STEEP_RAD };
    let total_ut = calibration.total_ut * scale(calibration, correction);
    let turn_rad = |heading: u8| {
        let heading_rad = TAU / f32::from(HEADINGS) * f32::from(heading);
        let after = Attitude::default().body(Field::<Level>::earth(total_ut, inclination_rad, heading_rad));
        fastest_turn_rad(from.apply(read(after)), after)
    };
    let worst_rad = (0..HEADINGS).map(turn_rad).fold(0.0, f32::max);
    (worst_rad.to_degrees() * MISSED / MAX_TURN_DEG_S).min(MAX_BLEND_S)
}

/// How fast the heading turns where it turns fastest, while the field goes from one to another as a weight goes from 0 to 1,
/// radians. On a straight line that is where it comes nearest to the origin: the area that is swept there is the same
/// everywhere.
fn fastest_turn_rad(from: Field<Body>, to: Field<Body>) -> f32 {
    let (from, to) = (from.ut.xy(), to.ut.xy());
    let way = to - from;
    let nearest = from + way * (-from.dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    from.perp(&to).abs() / nearest.norm_squared()
}

/// Whether the attitude is that of something at rest.
#[derive(Debug)]
struct Rest {
    /// Where it has stayed since an instant.
    since: Option<(Timestamp, Attitude)>,
    /// The last report.
    last: Timestamp,
}

impl Rest {
    fn see(&mut self, at: Timestamp, attitude: Attitude) {
        let stays = |(_, from): &(Timestamp, Attitude)| {
            wrap_pi(attitude.roll_rad - from.roll_rad).abs() <= AT_REST_RAD
                && (attitude.pitch_rad - from.pitch_rad).abs() <= AT_REST_RAD
                && at.us_since(self.last) <= MAX_GAP_US
        };
        self.since = self.since.filter(stays).or(Some((at, attitude)));
        self.last = at;
    }

    fn lasts_at(&self, now: Timestamp) -> bool {
        now.us_since(self.last) <= MAX_GAP_US && self.since.is_some_and(|(since, _)| now.us_since(since) >= AT_REST_US)
    }
}

/// A way from one map to another.
#[derive(Clone, Copy, Debug)]
struct Blend {
    from: Map,
    begun: Timestamp,
    seconds: f32,
}

impl Blend {
    /// How much of the newer map is told; none when it is all of it.
    fn weight(&self, at: Timestamp) -> Option<f32> {
        let weight = at.us_since(self.begun) as f32 * 1e-6 / self.seconds;
        (weight < 1.0).then_some(weight)
    }
}

/// What is told. 0.1 KB.
#[derive(Debug)]
pub(super) struct CompassField {
    /// None: nothing is to be told.
    to: Option<Map>,
    blend: Option<Blend>,
    had_calibration: bool,
    rest: Rest,
    /// The last reading.
    last: Timestamp,
}

impl CompassField {
    /// Of a module that knows nothing yet.
    pub const NEW: Self = Self {
        to: None,
        blend: None,
        had_calibration: false,
        rest: Rest { since: None, last: Timestamp::START },
        last: Timestamp::START,
    };

    /// Takes the attitude of a report.
    pub fn see_attitude(&mut self, at: Timestamp, attitude: Attitude) {
        self.rest.see(at, attitude);
    }

    /// Another correction, or the calibration in force without what was learnt beyond it. It may be the same as before.
    #[inline(never)]
    pub fn correct_with(&mut self, correction: &Correction, in_force: Option<&(Calibration, Uncertainty)>) {
        self.had_calibration |= in_force.is_some();
        let before = self.to;
        let now = self.last;
        let from = before.map(|to| self.told_by(now, &to));
        self.follow(correction, in_force);
        if self.to == before {
            return;
        }
        let is_in_air = correction.is_armed.unwrap_or_else(|| !self.rest.lasts_at(now));
        self.blend = match (from, self.to, in_force) {
            (Some(from), Some(to), Some((calibration, _))) if is_in_air => {
                Some(Blend { from, begun: now, seconds: blend_s(&from, &to, calibration, correction) })
            }
            _ => None,
        };
    }

    /// The calibration in force is adjusted a little: that is told at once.
    pub fn follow(&mut self, correction: &Correction, in_force: Option<&(Calibration, Uncertainty)>) {
        self.to = match in_force {
            Some((calibration, _)) => Some(Map::new(calibration, correction)),
            // An autopilot that has been told a corrected field must never be told another.
            None if self.had_calibration => None,
            None => correction.mount.map(|mount| Map::new(&Calibration::uncalibrated(mount), correction)),
        };
    }

    /// What is told of a reading.
    pub fn tell(&mut self, at: Timestamp, field: Field<Sensor>) -> Option<Field<Body>> {
        self.last = at;
        let after = self.to.as_ref()?.apply(field);
        let Some((blend, weight)) = self.blend.as_ref().and_then(|blend| Some((blend, blend.weight(at)?))) else {
            self.blend = None;
            return Some(after);
        };
        let before = blend.from.apply(field);
        Some(Field::new(before.ut + (after.ut - before.ut) * weight))
    }

    /// The map that is told by now, on the way to this one.
    fn told_by(&self, now: Timestamp, to: &Map) -> Map {
        let on_the_way = self.blend.as_ref().and_then(|blend| Some(blend.from.toward(to, blend.weight(now)?)));
        on_the_way.unwrap_or(*to)
    }
}

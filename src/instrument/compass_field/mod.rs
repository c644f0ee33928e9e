//! Field for an autopilot's compass.
//!
//! An affine map converts a reading to the output: the active calibration, rotated by the alignment, scaled to the true
//! field strength. In level flight the output field yields the reported heading.
//!
//! # The alignment
//!
//! Alignment adds `a` to every heading. In level flight `(x, y) = H (cos psi, -sin psi)` (see the [crate docs](crate));
//! the output must be `H (cos(psi + a), -sin(psi + a))`, which is `(x cos a + y sin a, y cos a - x sin a)`.
//!
//! # Change of correction in flight
//!
//! The autopilot uses this field for steering, so in flight the change to a new correction is gradual: the output moves
//! linearly from the old map to the new one, slowly enough that its heading turns by at most [`MAX_TURN_DEG_S`]. A
//! further correction starts from the blended map of that moment. On the ground, and if there was no output before, a
//! correction applies at once.

#[cfg(test)]
mod tests;

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::Correction;
use crate::calibration::{Calibration, HeadingUncertainty, inverse};
use crate::frames::{Attitude, Body, Field, Level, Sensor, wrap_pi};
use crate::time::Timestamp;
use crate::trig;

/// Largest heading rate caused by a new correction, degrees per second.
const MAX_TURN_DEG_S: f32 = 1.0;

/// Headings at which the rate is evaluated, and a margin for the maximum between them: deviations are one- and
/// two-cycle curves of the heading, of which 24 points reach 97 % of the maximum.
const EVALUATED_HEADINGS: u8 = 24;
const SAMPLING_MARGIN: f32 = 1.05;

/// Longest blend, seconds. Only a change of 130 deg or more would need longer, and then the old headings were useless.
const MAX_BLEND_S: f32 = 300.0;

/// Inclination assumed if unknown, radians: 70 deg, where iron has a large effect on the heading.
const DEFAULT_INCLINATION_RAD: f32 = 1.22;

/// Largest accepted ratio of true to measured field strength.
const MAX_STRENGTH_RATIO: f32 = 2.0;

/// Attitude change below which the aircraft is at rest, radians: 0.3 deg, above the noise of a source with 0.1 deg
/// resolution.
const AT_REST_RAD: f32 = 0.005;

/// Duration of a constant attitude that counts as rest, microseconds.
const AT_REST_US: u64 = 2_000_000;

/// Longest gap between attitude reports during rest, microseconds.
const MAX_GAP_US: u64 = 500_000;

/// Affine map from sensor to body field: `w m + c`, one row per body axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FieldMap([[f32; 4]; 3]);

impl FieldMap {
    /// Map of a calibration, rotated by the alignment and scaled to the true strength.
    fn new(calibration: &Calibration, correction: &Correction) -> Self {
        let (sin, cos) = trig::sin_cos(correction.align_deg.to_radians());
        let scale = strength_ratio(calibration, correction);
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

    fn interpolate(&self, other: &Self, weight: f32) -> Self {
        let Self(mut map) = *self;
        for (from, to) in map.as_flattened_mut().iter_mut().zip(other.0.as_flattened()) {
            *from += weight * (to - *from);
        }
        Self(map)
    }

    fn inverse(&self) -> Option<impl Fn(Field<Body>) -> Field<Sensor>> {
        let Self([x, y, z]) = *self;
        let inverse = inverse(&Matrix3::from_fn(|row, column| self.0[row][column]))?;
        let c_ut = Vector3::new(x[3], y[3], z[3]);
        Some(move |mapped: Field<Body>| Field::new(inverse * (mapped.ut - c_ut)))
    }
}

/// True over measured field strength; 1 if unknown or implausible.
fn strength_ratio(calibration: &Calibration, correction: &Correction) -> f32 {
    let scale = correction.total_ut.map_or(1.0, |total_ut| total_ut / calibration.total_ut);
    if (MAX_STRENGTH_RATIO.recip()..=MAX_STRENGTH_RATIO).contains(&scale) { scale } else { 1.0 }
}

/// Duration of a blend at [`MAX_TURN_DEG_S`], seconds, in level flight.
fn blend_duration_s(from: &FieldMap, to: &FieldMap, calibration: &Calibration, correction: &Correction) -> f32 {
    let Some(read) = to.inverse() else { return 0.0 };
    let inclination_rad =
        if correction.has_valid_inclination { calibration.inclination_rad } else { DEFAULT_INCLINATION_RAD };
    let total_ut = calibration.total_ut * strength_ratio(calibration, correction);
    let turn_rad = |heading: u8| {
        let heading_rad = TAU / f32::from(EVALUATED_HEADINGS) * f32::from(heading);
        let after = Attitude::default().body(Field::<Level>::earth(total_ut, inclination_rad, heading_rad));
        max_turn_rad_per_weight(from.apply(read(after)), after)
    };
    let worst_rad = (0..EVALUATED_HEADINGS).map(turn_rad).fold(0.0, f32::max);
    (worst_rad.to_degrees() * SAMPLING_MARGIN / MAX_TURN_DEG_S).min(MAX_BLEND_S)
}

/// Largest heading rate, radians per unit of weight, while the field moves linearly between two values. It occurs at
/// the point of the line nearest to the origin, since the line sweeps area at a constant rate.
fn max_turn_rad_per_weight(from: Field<Body>, to: Field<Body>) -> f32 {
    let (from, to) = (from.ut.xy(), to.ut.xy());
    let way = to - from;
    let nearest = from + way * (-from.dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    from.perp(&to).abs() / nearest.norm_squared()
}

#[derive(Debug)]
struct RestDetector {
    /// First attitude of the present rest, and its time.
    rest_start: Option<(Timestamp, Attitude)>,
    last: Timestamp,
}

impl RestDetector {
    fn update(&mut self, at: Timestamp, attitude: Attitude) {
        let stays = |(_, from): &(Timestamp, Attitude)| {
            wrap_pi(attitude.roll_rad - from.roll_rad).abs() <= AT_REST_RAD
                && (attitude.pitch_rad - from.pitch_rad).abs() <= AT_REST_RAD
                && at.us_since(self.last) <= MAX_GAP_US
        };
        self.rest_start = self.rest_start.filter(stays).or(Some((at, attitude)));
        self.last = at;
    }

    fn is_at_rest(&self, now: Timestamp) -> bool {
        now.us_since(self.last) <= MAX_GAP_US
            && self.rest_start.is_some_and(|(since, _)| now.us_since(since) >= AT_REST_US)
    }
}

#[derive(Clone, Copy, Debug)]
struct MapBlend {
    from: FieldMap,
    started_at: Timestamp,
    duration_s: f32,
}

impl MapBlend {
    /// Weight of the new map; `None` once complete.
    fn weight(&self, at: Timestamp) -> Option<f32> {
        let weight = at.us_since(self.started_at) as f32 * 1e-6 / self.duration_s;
        (weight < 1.0).then_some(weight)
    }
}

/// Output state. 0.1 KB.
#[derive(Debug)]
pub(super) struct CompassField {
    target_map: Option<FieldMap>,
    blend: Option<MapBlend>,
    had_calibration: bool,
    rest_detector: RestDetector,
    last: Timestamp,
}

impl CompassField {
    pub const INITIAL: Self = Self {
        target_map: None,
        blend: None,
        had_calibration: false,
        rest_detector: RestDetector { rest_start: None, last: Timestamp::START },
        last: Timestamp::START,
    };

    pub fn update_attitude(&mut self, at: Timestamp, attitude: Attitude) {
        self.rest_detector.update(at, attitude);
    }

    /// Applies a correction, possibly the same one, with the calibration as stored.
    #[inline(never)]
    pub fn set_correction(&mut self, correction: &Correction, active: Option<&(Calibration, HeadingUncertainty)>) {
        self.had_calibration |= active.is_some();
        let before = self.target_map;
        let now = self.last;
        let from = before.map(|to| self.effective_map_at(now, &to));
        self.apply_adjustment(correction, active);
        if self.target_map == before {
            return;
        }
        let is_in_air = correction.is_armed.unwrap_or_else(|| !self.rest_detector.is_at_rest(now));
        self.blend = match (from, self.target_map, active) {
            (Some(from), Some(to), Some((calibration, _))) if is_in_air => Some(MapBlend {
                from,
                started_at: now,
                duration_s: blend_duration_s(&from, &to, calibration, correction),
            }),
            _ => None,
        };
    }

    /// Applies the monitor's small adjustments, without a blend.
    pub fn apply_adjustment(&mut self, correction: &Correction, active: Option<&(Calibration, HeadingUncertainty)>) {
        self.target_map = match active {
            Some((calibration, _)) => Some(FieldMap::new(calibration, correction)),
            // After a corrected field the raw field must never be output.
            None if self.had_calibration => None,
            None => correction.mount.map(|mount| FieldMap::new(&Calibration::uncalibrated(mount), correction)),
        };
    }

    /// Output for a reading.
    pub fn output_field(&mut self, at: Timestamp, field: Field<Sensor>) -> Option<Field<Body>> {
        self.last = at;
        let after = self.target_map.as_ref()?.apply(field);
        let Some((blend, weight)) = self.blend.as_ref().and_then(|blend| Some((blend, blend.weight(at)?))) else {
            self.blend = None;
            return Some(after);
        };
        let before = blend.from.apply(field);
        Some(Field::new(before.ut + (after.ut - before.ut) * weight))
    }

    fn effective_map_at(&self, now: Timestamp, to: &FieldMap) -> FieldMap {
        let on_the_way = self.blend.as_ref().and_then(|blend| Some(blend.from.interpolate(to, blend.weight(now)?)));
        on_the_way.unwrap_or(*to)
    }
}

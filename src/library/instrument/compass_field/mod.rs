//! Field for an autopilot's compass: the corrected field through the output map, with a gradual change in flight.
//!
//! In level flight the output field yields the reported heading. The autopilot uses this field for steering, so in
//! flight the change to a new correction is gradual: the output moves linearly from the old map to the new one, slowly
//! enough that its heading turns by at most [`MAX_TURN_DEG_S`]. A further correction starts from the blended map of
//! that moment. On the ground, and if there was no output before, a correction applies at once.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::active_calibration::ActiveCalibration;
use super::output_map::OutputMap;
use crate::calibration::{Calibration, inverse};
use crate::frames::{Body, Field, Level, RollPitch, Sensor, wrap_pi};
use crate::time::Timestamp;

/// Largest heading rate caused by a new correction, degrees per second.
const MAX_TURN_DEG_S: f32 = 1.0;

/// Number of headings at which the rate is evaluated: deviations are one- and two-cycle curves of the heading, of which
/// 24 points reach 97 % of the maximum.
const EVALUATED_HEADINGS: u8 = 24;
/// Factor on the rate for a maximum between two evaluated headings.
const SAMPLING_MARGIN: f32 = 1.05;

/// Longest blend, seconds. Only a change of 130 deg or more would need longer, and then the old headings were useless.
const MAX_BLEND_S: f32 = 300.0;

/// Inclination assumed if unknown, radians: 70 deg, where iron has a large effect on the heading.
const DEFAULT_INCLINATION_RAD: f32 = 1.22;

/// Attitude change below which the aircraft is at rest, radians: 0.3 deg, above the noise of a source with 0.1 deg
/// resolution.
const MAX_REST_CHANGE_RAD: f32 = 0.005;

/// Duration of a constant attitude that counts as rest, microseconds.
const MIN_REST_US: u64 = 2_000_000;

/// Longest gap between attitude reports during rest, microseconds.
const MAX_GAP_US: u64 = 500_000;

/// Affine map from sensor field to compass field: `w m + c`, one row per body axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FieldMap([[f32; 4]; 3]);

impl FieldMap {
    fn new(calibration: &Calibration, output_map: &OutputMap) -> Self {
        let map = |ut: Vector3<f32>| output_map.map_field(Field::new(ut)).ut;
        let w = calibration.w_matrix();
        let [x, y, z, c] = [
            map(w.column(0).into()),
            map(w.column(1).into()),
            map(w.column(2).into()),
            map(-(w * calibration.b_vector_ut())),
        ];
        Self([0, 1, 2].map(|row| [x[row], y[row], z[row], c[row]]))
    }

    fn map_field(&self, field: Field<Sensor>) -> Field<Body> {
        let m = field.ut;
        let row = |[wx, wy, wz, c]: &[f32; 4]| wx * m.x + wy * m.y + wz * m.z + c;
        let [x, y, z] = &self.0;
        Field::from_ut(row(x), row(y), row(z))
    }

    fn interpolate(&self, target: &Self, weight: f32) -> Self {
        let Self(mut map) = *self;
        for (element, target_element) in map.as_flattened_mut().iter_mut().zip(target.0.as_flattened()) {
            *element += weight * (target_element - *element);
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

/// Duration of a blend at [`MAX_TURN_DEG_S`], seconds, in level flight.
fn blend_duration_s(from: &FieldMap, to: &FieldMap, calibration: &Calibration, active: &ActiveCalibration) -> f32 {
    let Some(sensor_field) = to.inverse() else { return 0.0 };
    let inclination_rad = if active.stored_correction.has_valid_inclination {
        calibration.inclination_rad
    } else {
        DEFAULT_INCLINATION_RAD
    };
    let total_ut = calibration.total_ut * active.output_map.strength_ratio;
    let turn_rad = |heading: u8| {
        let heading_rad = TAU / f32::from(EVALUATED_HEADINGS) * f32::from(heading);
        let new_field =
            RollPitch::default().to_body_frame(Field::<Level>::earth_field(total_ut, inclination_rad, heading_rad));
        max_heading_rate_per_weight(from.map_field(sensor_field(new_field)), new_field)
    };
    let worst_rad = (0..EVALUATED_HEADINGS).map(turn_rad).fold(0.0, f32::max);
    (worst_rad.to_degrees() * SAMPLING_MARGIN / MAX_TURN_DEG_S).min(MAX_BLEND_S)
}

/// Largest heading rate, radians per unit of weight, while the field moves linearly between two values. It occurs at
/// the point of the line nearest to the origin, since the line sweeps area at a constant rate.
fn max_heading_rate_per_weight(from: Field<Body>, to: Field<Body>) -> f32 {
    let (from, to) = (from.ut.xy(), to.ut.xy());
    let change = to - from;
    let nearest_point = from + change * (-from.dot(&change) / change.norm_squared()).clamp(0.0, 1.0);
    from.perp(&to).abs() / nearest_point.norm_squared()
}

#[derive(Debug)]
struct RestDetector {
    /// First attitude of the present rest, and its time.
    rest_start: Option<(Timestamp, RollPitch)>,
    last_attitude_at: Timestamp,
}

impl RestDetector {
    fn update_rest(&mut self, at: Timestamp, attitude: RollPitch) {
        let is_at_rest = |(_, rest_attitude): &(Timestamp, RollPitch)| {
            wrap_pi(attitude.roll_rad - rest_attitude.roll_rad).abs() <= MAX_REST_CHANGE_RAD
                && (attitude.pitch_rad - rest_attitude.pitch_rad).abs() <= MAX_REST_CHANGE_RAD
                && at.us_since(self.last_attitude_at) <= MAX_GAP_US
        };
        self.rest_start = self.rest_start.filter(is_at_rest).or(Some((at, attitude)));
        self.last_attitude_at = at;
    }

    fn is_at_rest(&self, now: Timestamp) -> bool {
        now.us_since(self.last_attitude_at) <= MAX_GAP_US
            && self.rest_start.is_some_and(|(since, _)| now.us_since(since) >= MIN_REST_US)
    }
}

#[derive(Clone, Copy, Debug)]
struct MapBlend {
    start_map: FieldMap,
    started_at: Timestamp,
    duration_s: f32,
}

impl MapBlend {
    /// Weight of the new map; `None` once complete.
    fn blend_weight(&self, at: Timestamp) -> Option<f32> {
        let weight = at.us_since(self.started_at) as f32 * 1e-6 / self.duration_s;
        (weight < 1.0).then_some(weight)
    }
}

/// State of the field output, with the blend between two calibrations. 0.1 KB.
#[derive(Debug)]
pub(super) struct CompassField {
    map_blend: Option<MapBlend>,
    has_used_calibration: bool,
    rest_detector: RestDetector,
    last_output_at: Timestamp,
}

impl CompassField {
    pub const INITIAL: Self = Self {
        map_blend: None,
        has_used_calibration: false,
        rest_detector: RestDetector { rest_start: None, last_attitude_at: Timestamp::START },
        last_output_at: Timestamp::START,
    };

    pub fn update_attitude(&mut self, at: Timestamp, attitude: RollPitch) {
        self.rest_detector.update_rest(at, attitude);
    }

    /// Begins the blend from one active calibration to the next; none if the output is the same.
    #[inline(never)]
    pub fn change_calibration(&mut self, old: &ActiveCalibration, new: &ActiveCalibration) {
        let map_before = self.active_map(old);
        self.has_used_calibration |= new.adjusted_calibration.is_some();
        let map_after = self.active_map(new);
        if map_after == map_before {
            return;
        }
        let now = self.last_output_at;
        let is_in_air = new.stored_correction.is_armed.unwrap_or_else(|| !self.rest_detector.is_at_rest(now));
        self.map_blend = match (map_before, map_after, &new.adjusted_calibration) {
            (Some(old), Some(to), Some((calibration, _))) if is_in_air => {
                let start_map = self.blended_map(now, old);
                let duration_s = blend_duration_s(&start_map, &to, calibration, new);
                Some(MapBlend { start_map, started_at: now, duration_s })
            }
            _ => None,
        };
    }

    /// Output for a reading; `body` is its corrected field.
    pub fn output_field(
        &mut self,
        at: Timestamp,
        active: &ActiveCalibration,
        field: Field<Sensor>,
        body: Option<Field<Body>>,
    ) -> Option<Field<Body>> {
        self.last_output_at = at;
        let new_field = body.or_else(|| Some(self.output_calibration(active)?.calibrated_field(field)))?;
        let new_field = active.output_map.map_field(new_field);
        let Some((blend, weight)) = self.map_blend.as_ref().and_then(|blend| Some((blend, blend.blend_weight(at)?)))
        else {
            self.map_blend = None;
            return Some(new_field);
        };
        let old_field = blend.start_map.map_field(field);
        Some(Field::new(old_field.ut + (new_field.ut - old_field.ut) * weight))
    }

    /// After a corrected field the raw field must never be output.
    fn output_calibration(&self, active: &ActiveCalibration) -> Option<Calibration> {
        active.calibration().filter(|_| active.adjusted_calibration.is_some() || !self.has_used_calibration)
    }

    fn active_map(&self, active: &ActiveCalibration) -> Option<FieldMap> {
        self.output_calibration(active).map(|calibration| FieldMap::new(&calibration, &active.output_map))
    }

    fn blended_map(&self, now: Timestamp, to: FieldMap) -> FieldMap {
        let blended =
            self.map_blend.as_ref().and_then(|blend| Some(blend.start_map.interpolate(&to, blend.blend_weight(now)?)));
        blended.unwrap_or(to)
    }
}

#[cfg(test)]
mod tests;

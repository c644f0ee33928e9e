//! Plausibility tests of attitude reports: spikes and frozen sources.

use nalgebra::Vector3;

use super::timed_report::{TimedReport, extrapolate_attitude};
use crate::attitude::report::AttitudeReport;
use crate::frames::{Body, Field, RollPitch, wrap_pi};
use crate::time::Timestamp;
use crate::trig;
use crate::trig::VectorLength as _;

/// Largest deviation from the extrapolated previous report, radians.
const SPIKE_MARGIN_RAD: f32 = 0.1;

/// Additional allowed deviation per second since the previous report, rad/s: body rates change.
const SPIKE_MARGIN_RAD_S: f32 = 1.0;

/// Additional allowed deviation per second of a source without body rates, rad/s: a fast roll.
const SPIKE_MARGIN_WITHOUT_RATES_RAD_S: f32 = 4.0;

/// Consecutive rejections after which a report is accepted as a real change.
const MAX_CONSECUTIVE_SPIKES: u8 = 3;

/// Number of equal consecutive reports from which a source may be frozen.
const MIN_EQUAL_REPORTS: u8 = 5;

/// Shortest duration of equal reports, microseconds: five at 50 Hz. A source may send faster than it estimates.
const MIN_EQUAL_DURATION_US: u64 = 80_000;

/// A source that ever changed by less than this, radians (0.05 deg), has a resolution below its noise and does not
/// repeat values.
const FINE_RESOLUTION_RAD: f32 = 8.7e-4;

/// Shortest duration of equal reports of a source of coarse resolution, which repeats values in steady flight,
/// microseconds.
const MIN_COARSE_EQUAL_DURATION_US: u64 = 500_000;

/// Smallest rotation, radians (2 deg), by the rates at the first of the equal reports, after which a source whose rates
/// vanish has stopped: two steps of a heading by MSP. In steps of 0.1 deg a moving aircraft's roll and pitch seldom
/// repeat for so long.
const MIN_MISSING_ROTATION_RAD: f32 = 0.035;

/// Largest ratio of vanished rates to those at the first of the equal reports. In a steady turn the rates remain.
const MAX_VANISHED_RATE_RATIO: f32 = 0.5;

/// Duration of equal reports after which vanished rates no longer count while the field keeps its direction in body axes
/// to 0.7 deg, microseconds: the vehicle has stopped, not its attitude.
const MIN_STEADY_FIELD_US: u64 = 1_000_000;
const COS_MAX_STEADY_FIELD_ROTATION: f32 = 0.999_925;

/// Longest duration of equal reports in which vanished rates count, microseconds. By then an aircraft in straight flight
/// has swayed by 3 deg, or the vehicle stands.
const MAX_VANISHED_RATES_US: u64 = 10_000_000;

/// Cosine of the smallest field rotation in body axes that contradicts a repeated attitude (1.75 deg): six sigma of two
/// mean directions. With 3 deg the heading of a frozen attitude was wrong by 5 deg before it was detected.
const COS_MIN_FIELD_ROTATION: f32 = 0.999_534;

/// Smallest change of the inclination computed with the repeated attitude, radians (1 deg). A rotation about the
/// vertical alone, as of a ground vehicle, does not change it.
const MIN_INCLINATION_CHANGE_RAD: f32 = 0.017_5;

/// Cosine of the tilt (10 deg) above which a vehicle is not on level ground; the inclination condition does not apply.
const COS_MAX_GROUND_TILT: f32 = 0.984_8;

/// Readings averaged for the field direction; a single one has 1 deg of noise in a weak field.
const FIELD_MEAN_READINGS: f32 = 12.0;

/// Settling time of the mean field direction, microseconds.
const FIELD_SETTLING_US: u64 = 400_000;

/// Detects spikes: single reports with a wrong attitude.
#[derive(Debug)]
pub(super) struct SpikeFilter {
    /// Consecutive rejected reports.
    consecutive_spikes: u8,
}

impl SpikeFilter {
    pub const fn new() -> Self {
        Self { consecutive_spikes: 0 }
    }

    /// Returns whether the attitude is a spike; `last_report` is the previous accepted report, unless too old.
    pub fn is_spike(&mut self, last_report: Option<&TimedReport>, at: Timestamp, attitude: RollPitch) -> bool {
        let is_far = last_report.is_some_and(|last_report| {
            let step_s = at.us_since(last_report.sent_at) as f32 * 1e-6;
            let expected = extrapolate_attitude(last_report, step_s);
            let by_time_rad_s = if last_report.report.body_rates.is_some() {
                SPIKE_MARGIN_RAD_S
            } else {
                SPIKE_MARGIN_WITHOUT_RATES_RAD_S
            };
            tilt_between(expected, attitude) > SPIKE_MARGIN_RAD + by_time_rad_s * step_s
        });
        if is_far && self.consecutive_spikes < MAX_CONSECUTIVE_SPIKES {
            self.consecutive_spikes += 1;
            return true;
        }
        self.consecutive_spikes = 0;
        false
    }
}

/// Angle between the down directions of two attitudes, radians; insensitive to roll at vertical pitch.
fn tilt_between(a: RollPitch, b: RollPitch) -> f32 {
    let chord = (a.tilt_rotation().down_in_body() - b.tilt_rotation().down_in_body()).vector_length();
    2.0 * trig::asin(chord / 2.0)
}

/// Exponential mean of a field's direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeanDirection(Option<Vector3<f32>>);

impl MeanDirection {
    pub const UNKNOWN: Self = Self(None);

    /// Updates the mean with a reading, in any axes.
    pub fn update_mean_direction(&mut self, field: Vector3<f32>) {
        let direction = field / field.vector_length();
        let old_mean = self.0.unwrap_or(direction);
        let new_mean = old_mean + (direction - old_mean) / FIELD_MEAN_READINGS;
        // Discards NaN, which would persist in the mean.
        self.0 = new_mean.iter().all(|component| component.is_finite()).then_some(new_mean);
    }

    /// Mean direction, of length near one; `None` before the first reading.
    pub const fn mean(&self) -> Option<Vector3<f32>> {
        self.0
    }
}

/// Detects a source that repeats its attitude.
#[derive(Debug)]
pub(super) struct FreezeDetector {
    last_attitude: Option<RollPitch>,
    equal_report_count: u8,
    /// Times of the first and of the last of the equal reports.
    equal_since: Timestamp,
    last_report_at: Timestamp,
    /// Magnitude of the body rates at the first of the equal reports, rad/s.
    first_equal_rate_rad_s: f32,
    /// Whether the rates have vanished while the attitude repeats, by the last report.
    have_rates_vanished: bool,
    /// Whether a change below the fine resolution was observed.
    has_fine_resolution: bool,
    /// Mean field direction in body axes: current, and settled after the first of the equal reports.
    field_direction: MeanDirection,
    settled_field_direction: Option<Vector3<f32>>,
    is_frozen: bool,
}

impl FreezeDetector {
    pub const fn new() -> Self {
        Self {
            last_attitude: None,
            equal_report_count: 0,
            equal_since: Timestamp::START,
            last_report_at: Timestamp::START,
            first_equal_rate_rad_s: 0.0,
            have_rates_vanished: false,
            has_fine_resolution: false,
            field_direction: MeanDirection::UNKNOWN,
            settled_field_direction: None,
            is_frozen: false,
        }
    }

    pub fn update_field(&mut self, field: Field<Body>) {
        self.field_direction.update_mean_direction(field.ut);
    }

    /// Processes a report, before other plausibility tests.
    pub fn process_report(&mut self, at: Timestamp, report: &AttitudeReport) {
        let attitude = report.attitude;
        let rate_rad_s = report.body_rates.map_or(0.0, |rates| rates.magnitude_rad_s());
        let is_equal = self.last_attitude.is_some_and(|previous_attitude| {
            previous_attitude.roll_rad.to_bits() == attitude.roll_rad.to_bits()
                && previous_attitude.pitch_rad.to_bits() == attitude.pitch_rad.to_bits()
        });
        if is_equal {
            self.equal_report_count = self.equal_report_count.saturating_add(1);
            if at.us_since(self.equal_since) >= FIELD_SETTLING_US {
                // Before the first field reading the mean is `None`; a later report then stores it.
                self.settled_field_direction = self.settled_field_direction.or(self.field_direction.mean());
            }
        } else {
            self.has_fine_resolution |=
                self.last_attitude.is_some_and(|previous_attitude| is_fine_step(previous_attitude, attitude));
            self.equal_report_count = 1;
            self.equal_since = at;
            self.first_equal_rate_rad_s = rate_rad_s;
            self.settled_field_direction = None;
        }
        self.last_attitude = Some(attitude);
        self.last_report_at = at;
        self.is_frozen &= is_equal;
        let for_us = at.us_since(self.equal_since);
        let is_repeated = self.equal_report_count >= MIN_EQUAL_REPORTS;
        self.have_rates_vanished = is_repeated && self.is_rotation_missing(rate_rad_s, for_us);
        if is_repeated {
            self.is_frozen |= self.has_fine_resolution && for_us >= MIN_EQUAL_DURATION_US;
            self.is_frozen |= for_us >= MIN_COARSE_EQUAL_DURATION_US && self.has_field_rotated(attitude);
        }
    }

    /// Time of the last report, if the source is frozen.
    pub fn frozen_at(&self) -> Option<Timestamp> {
        (self.is_frozen || self.have_rates_vanished).then_some(self.last_report_at)
    }

    /// Whether a rotation is missing that the rates showed before they vanished, while the field does not show that the
    /// vehicle has stopped.
    fn is_rotation_missing(&self, rate_rad_s: f32, for_us: u64) -> bool {
        rate_rad_s < MAX_VANISHED_RATE_RATIO * self.first_equal_rate_rad_s
            && self.first_equal_rate_rad_s * for_us as f32 * 1e-6 > MIN_MISSING_ROTATION_RAD
            && for_us < MAX_VANISHED_RATES_US
            && (for_us < MIN_STEADY_FIELD_US
                || self.field_directions().is_some_and(|[current_direction, settled_direction]| {
                    current_direction.dot(&settled_direction) < COS_MAX_STEADY_FIELD_ROTATION
                }))
    }

    /// Unit vectors of the field in body axes: current, and settled after the first equal report.
    fn field_directions(&self) -> Option<[Vector3<f32>; 2]> {
        let directions = [self.field_direction.mean()?, self.settled_field_direction?];
        Some(directions.map(|direction| direction / direction.vector_length()))
    }

    /// Whether the field rotated in body axes since the first equal report, other than about the vertical of a level
    /// vehicle.
    fn has_field_rotated(&self, attitude: RollPitch) -> bool {
        let Some([current_direction, settled_direction]) = self.field_directions() else { return false };
        let down = attitude.tilt_rotation().down_in_body();
        let [current_inclination, settled_inclination] =
            [current_direction, settled_direction].map(|direction| trig::asin(direction.dot(&down)));
        let is_contradicted = (current_inclination - settled_inclination).abs() > MIN_INCLINATION_CHANGE_RAD
            || down.z < COS_MAX_GROUND_TILT;
        current_direction.dot(&settled_direction) < COS_MIN_FIELD_ROTATION && is_contradicted
    }
}

/// Whether an angle changed by less than the steps of coarse sources.
fn is_fine_step(from: RollPitch, to: RollPitch) -> bool {
    let fine = |step_rad: f32| step_rad.abs() > 0.0 && step_rad.abs() < FINE_RESOLUTION_RAD;
    fine(wrap_pi(to.roll_rad - from.roll_rad)) || fine(to.pitch_rad - from.pitch_rad)
}

#[cfg(test)]
mod tests;

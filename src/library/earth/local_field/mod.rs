//! Position and date with the Earth's field there.

use super::field_model::{EarthField, ModelValidity};
use crate::earth::date::Date;
use crate::earth::position::Position;
use crate::time::WrappingMillis;
use crate::trig;

/// Movement that updates the field, degrees of latitude or longitude: 2 km. Below that, declination changes by less
/// than a quarter of the model's own error. Height is not compared: 2 km change the field by 0.1 %.
const MIN_UPDATE_DISTANCE_DEG: f32 = 0.02;

/// Distance from latitude and longitude zero within which a position means none, degrees: without a fix, an autopilot's
/// estimator starts there and drifts.
const MAX_NO_FIX_DISTANCE_DEG: f32 = 0.01;

/// Highest plausible speed, degrees of a great circle per millisecond: 300 m/s, more than unmanned aircraft fly.
const MAX_SPEED_DEG_MS: f32 = 300.0 / 111_200.0 / 1000.0;

/// Reports of a distant position after which a vehicle on the ground takes it: 10 s at 1 Hz.
const REQUIRED_DISTANT_REPORTS: u8 = 10;

/// Largest deviation of the model's inclination from the calibration's, degrees: the limit of headings
/// (`heading::HeadingLimits::DEFAULT`).
const MAX_INCLINATION_DEVIATION_DEG: f32 = 12.0;

/// Knowledge against which a reported position is tested.
#[derive(Clone, Copy, Debug, Default)]
pub struct PositionContext {
    /// Whether the vehicle is known to be disarmed: only then may the position jump, after a wrong first fix.
    pub is_disarmed: bool,
    /// Inclination of the active calibration, degrees.
    pub calibrated_inclination_deg: Option<f32>,
}

/// Position and date from an autopilot, and the model field for both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalField {
    position: Option<Position>,
    /// Time of the last plausible position.
    position_time: WrappingMillis,
    /// Number of consecutive reports of a distant position.
    distant_report_count: u8,
    date: Option<Date>,
    field: Option<EarthField>,
}

impl LocalField {
    /// State without position and date.
    pub const UNKNOWN: Self = Self {
        position: None,
        position_time: WrappingMillis::new(0),
        distant_report_count: 0,
        date: None,
        field: None,
    };

    /// Updates the position, unless it is that of an estimator without a fix, its distance from the last one implies an
    /// impossible speed, or its inclination contradicts the calibration.
    pub fn update_position(&mut self, report_time: WrappingMillis, position: Position, context: PositionContext) {
        if position.latitude_deg.abs() < MAX_NO_FIX_DISTANCE_DEG
            && position.longitude_deg.abs() < MAX_NO_FIX_DISTANCE_DEG
        {
            return;
        }
        let is_plausible = self.position.is_none_or(|last_position| {
            let reachable_deg =
                MIN_UPDATE_DISTANCE_DEG * 1.5 + MAX_SPEED_DEG_MS * report_time.ms_since(self.position_time) as f32;
            distance_deg(last_position, position) <= reachable_deg
        });
        let is_confirmed = context.is_disarmed && self.distant_report_count >= REQUIRED_DISTANT_REPORTS;
        if !(is_plausible || is_confirmed) {
            self.distant_report_count = self.distant_report_count.saturating_add(1);
            return;
        }
        (self.position_time, self.distant_report_count) = (report_time, 0);
        if self.position.is_some_and(|last_position| is_same_place(last_position, position)) {
            return;
        }
        let updated = Self { position: Some(position), ..*self }.with_model_field();
        if !updated.contradicts(context.calibrated_inclination_deg) {
            *self = updated;
        }
    }

    /// Updates the date. The first one shows whether the position before it contradicts the inclination of the active
    /// calibration; then it is dropped.
    pub fn update_date(&mut self, day: Date, calibrated_inclination_deg: Option<f32>) {
        if self.date == Some(day) {
            return;
        }
        let updated = Self { date: Some(day), ..*self }.with_model_field();
        let is_dropped = self.field.is_none() && updated.contradicts(calibrated_inclination_deg);
        *self = if is_dropped { Self { date: Some(day), ..Self::UNKNOWN } } else { updated };
    }

    fn contradicts(&self, calibrated_inclination_deg: Option<f32>) -> bool {
        self.field.zip(calibrated_inclination_deg).is_some_and(|(field, calibrated_deg)| {
            (field.inclination_deg - calibrated_deg).abs() > MAX_INCLINATION_DEVIATION_DEG
        })
    }

    /// Model field; `None` without a position and a date within the model's validity.
    #[must_use]
    pub const fn model_field(&self) -> Option<&EarthField> {
        self.field.as_ref()
    }

    /// Position of the model field.
    #[must_use]
    pub const fn model_position(&self) -> Option<Position> {
        self.position
    }

    /// Current date.
    #[must_use]
    pub const fn date(&self) -> Option<Date> {
        self.date
    }

    /// Validity of the model at the current date, if known.
    #[must_use]
    pub fn validity(&self) -> Option<ModelValidity> {
        self.date.map(ModelValidity::on_date)
    }

    fn with_model_field(self) -> Self {
        let field = self.position.zip(self.date).and_then(|(position, day)| EarthField::from_model(position, day));
        Self { field, ..self }
    }
}

fn is_same_place(first: Position, second: Position) -> bool {
    let difference_deg = [first.latitude_deg - second.latitude_deg, first.longitude_deg - second.longitude_deg];
    difference_deg.iter().all(|deg| deg.abs() < MIN_UPDATE_DISTANCE_DEG)
}

/// Distance of two positions, degrees, in the plane of their mean latitude: exact enough for a speed limit.
fn distance_deg(first: Position, second: Position) -> f32 {
    let east_deg = (first.longitude_deg - second.longitude_deg).abs();
    let (_, cos) = trig::sin_cos((0.5 * (first.latitude_deg + second.latitude_deg)).to_radians());
    trig::hypot(first.latitude_deg - second.latitude_deg, east_deg.min(360.0 - east_deg) * cos)
}

#[cfg(test)]
mod tests;

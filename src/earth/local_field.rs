//! Position and date with the Earth's field there.

use super::field_model::{EarthField, ModelValidity};
use super::{Date, Position};
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
        let contradicts = |field: EarthField| {
            context
                .calibrated_inclination_deg
                .is_some_and(|deg| (field.inclination_deg - deg).abs() > MAX_INCLINATION_DEVIATION_DEG)
        };
        if !updated.field.is_some_and(contradicts) {
            *self = updated;
        }
    }

    /// Updates the date.
    pub fn update_date(&mut self, day: Date) {
        if self.date != Some(day) {
            *self = Self { date: Some(day), ..*self }.with_model_field();
        }
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
mod tests {
    use super::*;

    /// Time after the start of the module; a vehicle can move 300 m each second.
    const TEST_TIME: WrappingMillis = WrappingMillis::new(5_000);

    fn position_at(latitude_deg: f32, longitude_deg: f32) -> Position {
        Position::new(latitude_deg, longitude_deg, 100.0).unwrap()
    }

    fn day(days: u64) -> Date {
        Date::from_unix_s(days * 86_400).unwrap()
    }

    /// Position and date may arrive in either order.
    #[test]
    fn position_and_date_give_a_field() {
        let (position, day) = (position_at(51.1, 13.7), day(20_779));
        let mut local_field = LocalField::UNKNOWN;
        local_field.update_position(TEST_TIME, position, PositionContext::default());
        assert_eq!(
            (local_field.model_position(), local_field.date(), local_field.model_field(), local_field.validity()),
            (Some(position), None, None, None)
        );
        local_field.update_date(day);
        assert_eq!(local_field.model_field(), EarthField::from_model(position, day).as_ref());
        assert!(local_field.model_field().is_some());
        let mut other = LocalField::UNKNOWN;
        other.update_date(day);
        assert_eq!((other.model_field(), other.validity()), (None, Some(ModelValidity::Valid)));
        other.update_position(TEST_TIME, position, PositionContext::default());
        assert_eq!(other, local_field);
    }

    /// The date changes at midnight, or because the first date was wrong.
    #[test]
    fn the_field_follows_the_date() {
        let position = position_at(51.1, 13.7);
        let mut local_field = LocalField::UNKNOWN;
        local_field.update_position(TEST_TIME, position, PositionContext::default());
        for days in [20_000, 20_779, 20_780, 21_000] {
            local_field.update_date(day(days));
            assert_eq!(
                (local_field.date(), local_field.model_field()),
                (Some(day(days)), EarthField::from_model(position, day(days)).as_ref())
            );
        }
    }

    /// Distance counts from the position of the last update.
    #[test]
    fn small_movements_keep_the_field() {
        let start = position_at(51.1, 13.7);
        for (latitude_deg, longitude_deg, is_same) in [
            (51.119, 13.719, true),
            (51.081, 13.681, true),
            (51.121, 13.7, false),
            (51.079, 13.7, false),
            (51.1, 13.721, false),
            (51.1, 13.679, false),
            (51.1, -13.7, false),
        ] {
            let mut local_field = LocalField { date: Some(day(20_779)), ..LocalField::UNKNOWN };
            local_field.update_position(TEST_TIME, start, PositionContext::default());
            let before = local_field;
            local_field.update_position(
                TEST_TIME.plus_ms(12 * 3_600_000),
                position_at(latitude_deg, longitude_deg),
                PositionContext::default(),
            );
            assert_eq!(local_field.model_field() == before.model_field(), is_same, "{latitude_deg} {longitude_deg}");
        }
        let mut local_field = LocalField::UNKNOWN;
        for step in 0..10_u8 {
            let at = TEST_TIME.plus_ms(10_000 * u32::from(step));
            local_field.update_position(
                at,
                position_at(51.1 + 0.015 * f32::from(step), 13.7),
                PositionContext::default(),
            );
        }
        assert!((local_field.model_position().unwrap().latitude_deg - 51.22).abs() < 0.001, "{local_field:?}");
    }

    /// Bavaria; in Greenland the inclination differs by 15 deg, at the same latitude in Canada by 5 deg.
    const BAVARIA: [f32; 2] = [48.1, 11.6];
    const GREENLAND: [f32; 2] = [72.0, -40.0];
    const CANADA: [f32; 2] = [48.1, -80.0];

    /// Reports one position each second for 30 s, long after the last one from Bavaria; returns whether it is accepted.
    fn is_position_accepted([latitude_deg, longitude_deg]: [f32; 2], after_ms: u32, context: PositionContext) -> bool {
        let mut local_field = LocalField { date: Some(day(20_779)), ..LocalField::UNKNOWN };
        local_field.update_position(TEST_TIME, position_at(BAVARIA[0], BAVARIA[1]), context);
        let before = local_field.model_field().copied();
        assert!(before.is_some());
        for second in 0..30 {
            let at = TEST_TIME.plus_ms(after_ms + 1000 * second);
            local_field.update_position(at, position_at(latitude_deg, longitude_deg), context);
        }
        local_field.model_field().copied() != before
    }

    /// 6,200 km from Bavaria to Canada: 170 m/s in ten hours, 430 m/s in four.
    #[test]
    fn a_position_moves_at_a_plausible_speed() {
        let hours = |hours: u32| hours * 3_600_000;
        for (after_ms, is_expected) in [(1000, false), (hours(4), false), (hours(10), true)] {
            assert_eq!(is_position_accepted(CANADA, after_ms, PositionContext::default()), is_expected, "{after_ms}");
        }
    }

    #[test]
    fn a_disarmed_vehicle_takes_a_distant_position_that_persists() {
        let context = PositionContext { is_disarmed: true, ..PositionContext::default() };
        assert!(is_position_accepted(CANADA, 1000, context) && is_position_accepted(GREENLAND, 1000, context));
        // A single report from Greenland is ignored.
        let mut local_field = LocalField::UNKNOWN;
        for [latitude_deg, longitude_deg] in [BAVARIA, GREENLAND, BAVARIA] {
            local_field.update_position(TEST_TIME, position_at(latitude_deg, longitude_deg), context);
            assert_eq!(local_field.model_position(), Some(position_at(BAVARIA[0], BAVARIA[1])));
        }
    }

    #[test]
    fn a_position_near_zero_is_ignored() {
        for (latitude_deg, longitude_deg, is_none) in
            [(0.000_3, -0.009, true), (0.000_3, 0.02, false), (-0.02, 0.0, false)]
        {
            let mut local_field = LocalField::UNKNOWN;
            local_field.update_position(
                TEST_TIME,
                position_at(latitude_deg, longitude_deg),
                PositionContext::default(),
            );
            assert_eq!(local_field.model_position().is_none(), is_none, "{latitude_deg} {longitude_deg}");
        }
    }

    #[test]
    fn a_position_must_agree_with_the_calibrated_inclination() {
        let context = PositionContext { is_disarmed: true, calibrated_inclination_deg: Some(64.0) };
        assert!(is_position_accepted(CANADA, 1000, context) && !is_position_accepted(GREENLAND, 1000, context));
    }

    /// Largest change of declination within 0.02 deg, relative to the model's error `sqrt(0.26^2 + (5.417 uT / H)^2)`
    /// deg, over the Earth.
    #[test]
    fn the_distance_limit_costs_under_a_quarter_sigma_of_declination() {
        let mut worst: f32 = 0.0;
        for row in 0..170_u8 {
            for column in 0..90_u8 {
                let at = position_at(f32::from(row) - 84.5, 4.0 * f32::from(column) - 179.5);
                let field = |position| EarthField::from_model(position, day(20_779)).unwrap();
                let field_here = field(at);
                let Some(declination_deg) = field_here.declination_deg else { continue };
                let horizontal_ut = field_here.total_ut * field_here.inclination_deg.to_radians().cos();
                let sigma_deg = 0.26_f32.hypot(5.417 / horizontal_ut);
                for (north_deg, east_deg) in [(0.02, 0.0), (0.0, 0.02), (0.02, 0.02), (0.02, -0.02)] {
                    let field_there = field(position_at(at.latitude_deg + north_deg, at.longitude_deg + east_deg));
                    let Some(moved_deg) = field_there.declination_deg else { continue };
                    let change_deg = moved_deg - declination_deg;
                    let change_deg = change_deg - 360.0 * (change_deg / 360.0).round();
                    worst = worst.max(change_deg.abs() / sigma_deg);
                }
            }
        }
        assert!(worst < 0.25, "{worst}");
    }
}

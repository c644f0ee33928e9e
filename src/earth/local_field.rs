//! Position and date with the Earth's field there.

use super::model::{EarthField, ModelValidity};
use super::{Date, Position};

/// Position and date from an autopilot, and the model field for both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalField {
    position: Option<Position>,
    date: Option<Date>,
    field: Option<EarthField>,
}

impl LocalField {
    /// No position, no date.
    pub const UNKNOWN: Self = Self { position: None, date: None, field: None };

    /// Updates the position if it moved by at least 0.02 deg (2 km) in latitude or longitude. Below that, declination
    /// changes by less than a quarter of the model's own error. Height is not compared: 2 km change the field by 0.1 %.
    pub fn set_position(&mut self, place: Position) {
        const MIN_DISTANCE_DEG: f32 = 0.02;
        let is_same = |last: Position| {
            let off_deg = [last.latitude_deg - place.latitude_deg, last.longitude_deg - place.longitude_deg];
            off_deg.iter().all(|deg| deg.abs() < MIN_DISTANCE_DEG)
        };
        if !self.position.is_some_and(is_same) {
            self.position = Some(place);
            self.update_field();
        }
    }

    /// Updates the date.
    pub fn set_date(&mut self, day: Date) {
        if self.date != Some(day) {
            self.date = Some(day);
            self.update_field();
        }
    }

    /// Model field; `None` without a position and a date within the model's validity.
    #[must_use]
    pub const fn field(&self) -> Option<&EarthField> {
        self.field.as_ref()
    }

    /// Position of the model field.
    #[must_use]
    pub const fn position(&self) -> Option<Position> {
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

    fn update_field(&mut self) {
        self.field = self.position.zip(self.date).and_then(|(place, day)| EarthField::from_model(place, day));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(latitude_deg: f32, longitude_deg: f32) -> Position {
        Position::new(latitude_deg, longitude_deg, 100.0).unwrap()
    }

    fn day(days: u64) -> Date {
        Date::from_unix_s(days * 86_400).unwrap()
    }

    /// In either order.
    #[test]
    fn position_and_date_give_a_field() {
        let (place, day) = (place(51.1, 13.7), day(20_779));
        let mut here = LocalField::UNKNOWN;
        here.set_position(place);
        assert_eq!((here.position(), here.date(), here.field(), here.validity()), (Some(place), None, None, None));
        here.set_date(day);
        assert_eq!(here.field(), EarthField::from_model(place, day).as_ref());
        assert!(here.field().is_some());
        let mut other = LocalField::UNKNOWN;
        other.set_date(day);
        assert_eq!((other.field(), other.validity()), (None, Some(ModelValidity::Valid)));
        other.set_position(place);
        assert_eq!(other, here);
    }

    /// Midnight passes, or the first date was wrong.
    #[test]
    fn the_field_follows_the_date() {
        let place = place(51.1, 13.7);
        let mut here = LocalField::UNKNOWN;
        here.set_position(place);
        for days in [20_000, 20_779, 20_780, 21_000] {
            here.set_date(day(days));
            assert_eq!(
                (here.date(), here.field()),
                (Some(day(days)), EarthField::from_model(place, day(days)).as_ref())
            );
        }
    }

    /// Distance counts from the position of the last update.
    #[test]
    fn small_movements_keep_the_field() {
        let start = place(51.1, 13.7);
        for (latitude_deg, longitude_deg, is_same) in [
            (51.119, 13.719, true),
            (51.081, 13.681, true),
            (51.121, 13.7, false),
            (51.079, 13.7, false),
            (51.1, 13.721, false),
            (51.1, 13.679, false),
            (51.1, -13.7, false),
        ] {
            let mut here = LocalField { date: Some(day(20_779)), ..LocalField::UNKNOWN };
            here.set_position(start);
            let before = here;
            here.set_position(place(latitude_deg, longitude_deg));
            assert_eq!(here == before, is_same, "{latitude_deg} {longitude_deg}");
        }
        let mut here = LocalField::UNKNOWN;
        for step in 0..10_u8 {
            here.set_position(place(51.1 + 0.015 * f32::from(step), 13.7));
        }
        assert!((here.position().unwrap().latitude_deg - 51.22).abs() < 0.001, "{here:?}");
    }

    /// Largest change of declination within 0.02 deg, relative to the model's error `sqrt(0.26^2 + (5.417 uT / H)^2)`
    /// deg, over the Earth.
    #[test]
    fn the_distance_limit_costs_under_a_quarter_sigma_of_declination() {
        let mut worst: f32 = 0.0;
        for row in 0..170_u8 {
            for column in 0..90_u8 {
                let at = place(f32::from(row) - 84.5, 4.0 * f32::from(column) - 179.5);
                let field = |place| EarthField::from_model(place, day(20_779)).unwrap();
                let here = field(at);
                let Some(declination_deg) = here.declination_deg else { continue };
                let horizontal_ut = here.total_ut * here.inclination_deg.to_radians().cos();
                let sigma_deg = 0.26_f32.hypot(5.417 / horizontal_ut);
                for (north_deg, east_deg) in [(0.02, 0.0), (0.0, 0.02), (0.02, 0.02), (0.02, -0.02)] {
                    let moved = field(place(at.latitude_deg + north_deg, at.longitude_deg + east_deg));
                    let Some(moved_deg) = moved.declination_deg else { continue };
                    let change_deg = moved_deg - declination_deg;
                    let change_deg = change_deg - 360.0 * (change_deg / 360.0).round();
                    worst = worst.max(change_deg.abs() / sigma_deg);
                }
            }
        }
        assert!(worst < 0.25, "{worst}");
    }
}

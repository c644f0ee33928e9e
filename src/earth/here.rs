//! Where the module is, what day it is, and so what the Earth's field is there.

use super::model::{EarthField, Validity};
use super::{Day, Place};

/// Where the module is and what day it is, as far as an autopilot has told it, and the Earth's field there and then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Here {
    place: Option<Place>,
    day: Option<Day>,
    field: Option<EarthField>,
}

impl Here {
    /// Nothing has been told.
    pub const NOWHERE: Self = Self { place: None, day: None, field: None };

    /// Takes a place. One as good as the last is that: less than 0.02 deg away in latitude and in longitude, 2 km, in which
    /// declination changes by less than a quarter of the model's own error wherever there is any. Climbing 2 km changes the
    /// field by a thousandth, which is not worth a look.
    pub fn is_at(&mut self, place: Place) {
        const SAME_DEG: f32 = 0.02;
        let is_same = |last: Place| {
            let off_deg = [last.latitude_deg - place.latitude_deg, last.longitude_deg - place.longitude_deg];
            off_deg.iter().all(|deg| deg.abs() < SAME_DEG)
        };
        if !self.place.is_some_and(is_same) {
            self.place = Some(place);
            self.look();
        }
    }

    /// Takes a day.
    pub fn is_on(&mut self, day: Day) {
        if self.day != Some(day) {
            self.day = Some(day);
            self.look();
        }
    }

    /// The field by the model; none without a place and a day on which the model is used.
    #[must_use]
    pub const fn field(&self) -> Option<&EarthField> {
        self.field.as_ref()
    }

    /// The place that the field is of.
    #[must_use]
    pub const fn place(&self) -> Option<Place> {
        self.place
    }

    /// Today.
    #[must_use]
    pub const fn day(&self) -> Option<Day> {
        self.day
    }

    /// What the model is worth today, if that is known.
    #[must_use]
    pub fn validity(&self) -> Option<Validity> {
        self.day.map(Validity::on)
    }

    fn look(&mut self) {
        self.field = self.place.zip(self.day).and_then(|(place, day)| EarthField::of(place, day));
    }
}

#[cfg(test)]
#[cfg(feature = "wmm")]
mod tests {
    use super::*;

    fn place(latitude_deg: f32, longitude_deg: f32) -> Place {
        Place::new(latitude_deg, longitude_deg, 100.0).unwrap()
    }

    fn day(days: u64) -> Day {
        Day::from_unix_s(days * 86_400).unwrap()
    }

    /// In either order; one alone is not enough.
    #[test]
    fn place_and_day_make_a_field() {
        let (place, day) = (place(51.1, 13.7), day(20_779));
        let mut here = Here::NOWHERE;
        here.is_at(place);
        assert_eq!((here.place(), here.day(), here.field(), here.validity()), (Some(place), None, None, None));
        here.is_on(day);
        assert_eq!(here.field(), EarthField::of(place, day).as_ref());
        assert!(here.field().is_some());
        let mut other = Here::NOWHERE;
        other.is_on(day);
        assert_eq!((other.field(), other.validity()), (None, Some(Validity::Valid)));
        other.is_at(place);
        assert_eq!(other, here);
    }

    /// Either side of 0.02 deg each way, counted from where the field was looked up and not from the last place.
    #[test]
    fn a_place_is_the_same_until_it_is_left() {
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
            let mut here = Here { day: Some(day(20_779)), ..Here::NOWHERE };
            here.is_at(start);
            let before = here;
            here.is_at(place(latitude_deg, longitude_deg));
            assert_eq!(here == before, is_same, "{latitude_deg} {longitude_deg}");
        }
        let mut here = Here::NOWHERE;
        for step in 0..10_u8 {
            here.is_at(place(51.1 + 0.015 * f32::from(step), 13.7));
        }
        assert!((here.place().unwrap().latitude_deg - 51.22).abs() < 0.001, "{here:?}");
    }

    /// What is missed within a place, as a part of the model's own error of declination, `sqrt(0.26^2 + (5.417 uT / H)^2)`
    /// deg: of places all over the Earth, where there is a declination.
    #[test]
    fn what_a_place_misses_is_little() {
        let mut worst: f32 = 0.0;
        for row in 0..170_u8 {
            for column in 0..90_u8 {
                let at = place(f32::from(row) - 84.5, 4.0 * f32::from(column) - 179.5);
                let field = |place| EarthField::of(place, day(20_779)).unwrap();
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

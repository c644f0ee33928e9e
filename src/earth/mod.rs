//! Where on Earth, and on which day: what the Earth's field depends on; and what it is there.

mod here;
mod model;

pub use here::Here;
pub use model::{EarthField, MODEL, Validity};

/// A place, as an autopilot tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Latitude, degrees, north positive.
    pub latitude_deg: f32,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f32,
    /// Height above mean sea level, metres.
    pub height_m: f32,
}

impl Place {
    /// A place, if there is one there: latitude -90..=90, longitude -180..=180 deg, height -1,000..=100,000 m. What a
    /// receiver without a fix sends, latitude and longitude of exactly nothing, is none.
    #[must_use]
    pub fn new(latitude_deg: f32, longitude_deg: f32, height_m: f32) -> Option<Self> {
        let exists = latitude_deg.abs() <= 90.0
            && longitude_deg.abs() <= 180.0
            && (-1_000.0..=100_000.0).contains(&height_m)
            && !(latitude_deg == 0.0 && longitude_deg == 0.0);
        exists.then_some(Self { latitude_deg, longitude_deg, height_m })
    }
}

/// A day: so many since 1970-01-01, UTC. Good until 2149.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Day(u16);

impl Day {
    /// 2020-01-01: what a clock says that was never set is earlier.
    const FIRST: u64 = 18_262;

    /// The day of a Unix time, seconds; none before 2020, which is a clock that was never set, and none after 2149.
    #[must_use]
    pub fn from_unix_s(seconds: u64) -> Option<Self> {
        let days = seconds / 86_400;
        (days >= Self::FIRST).then(|| u16::try_from(days).ok().map(Self))?
    }

    /// Days since 1970-01-01.
    #[must_use]
    pub const fn since_1970(self) -> u16 {
        self.0
    }

    /// Year, month and day of the month, until 2100-02-28; one too early after that.
    #[must_use]
    pub fn date(self) -> (u16, u8, u8) {
        // Counted from 1 March 1968, so that the leap day is the last of four years; none is left out before 2100.
        let days = u32::from(self.0) + 671;
        let (four_years, day) = (days / 1_461, days % 1_461);
        let year = (day / 365).min(3);
        let day = day - 365 * year;
        // Months from March on are 31, 30, 31, 30, 31 days, again and again.
        let month = (5 * day + 2) / 153;
        let day = day - (153 * month + 2) / 5 + 1;
        let year = 1968 + 4 * four_years + year + u32::from(month >= 10);
        let month = if month < 10 { month + 3 } else { month - 9 };
        (year as u16, month as u8, day as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each limit from both sides.
    #[test]
    fn a_place_is_on_earth() {
        for (latitude_deg, longitude_deg, height_m) in
            [(90.0, 180.0, 0.0), (-90.0, -180.0, -1_000.0), (0.0, 1e-7, 100_000.0), (1e-7, 0.0, 0.0)]
        {
            assert!(Place::new(latitude_deg, longitude_deg, height_m).is_some(), "{latitude_deg} {longitude_deg}");
        }
        let nan = f32::NAN;
        for (latitude_deg, longitude_deg, height_m) in [
            (90.001, 0.0, 0.0),
            (-90.001, 0.0, 0.0),
            (1.0, 180.1, 0.0),
            (1.0, -180.1, 0.0),
            (1.0, 1.0, -1_001.0),
            (1.0, 1.0, 100_010.0),
            (0.0, 0.0, 50.0),
            (nan, 1.0, 1.0),
            (1.0, nan, 1.0),
            (1.0, 1.0, nan),
        ] {
            assert!(Place::new(latitude_deg, longitude_deg, height_m).is_none(), "{latitude_deg} {longitude_deg}");
        }
    }

    /// From 2020-01-01 (`date -d 2020-01-01 +%s`) until the number ends, from both sides.
    #[test]
    fn a_day_is_of_a_clock_that_was_set() {
        let day = |seconds| Day::from_unix_s(seconds).map(Day::since_1970);
        assert_eq!(day(1_577_836_800), Some(18_262));
        assert_eq!(day(1_577_836_799), None);
        assert_eq!(day(0), None);
        assert_eq!(day(65_536 * 86_400 - 1), Some(u16::MAX));
        assert_eq!(day(65_536 * 86_400), None);
        assert_eq!(day(u64::MAX), None);
    }

    /// As `date -d` has them; the ends of months, of years, and of leap years.
    #[test]
    fn a_day_has_a_date() {
        for (days, date) in [
            (18_262, (2020, 1, 1)),
            (18_320, (2020, 2, 28)),
            (18_321, (2020, 2, 29)),
            (18_322, (2020, 3, 1)),
            (18_627, (2020, 12, 31)),
            (18_628, (2021, 1, 1)),
            (18_686, (2021, 2, 28)),
            (18_687, (2021, 3, 1)),
            (20_089, (2025, 1, 1)),
            (20_779, (2026, 11, 22)),
            (21_914, (2029, 12, 31)),
            (47_540, (2100, 2, 28)),
        ] {
            let day = Day::from_unix_s(days * 86_400).unwrap();
            assert_eq!(day.date(), date);
        }
        let lengths = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        let all = (1..).zip(lengths).flat_map(|(month, length)| (1..=length).map(move |day| (2026, month, day)));
        for (days, date) in (20_454..).zip(all) {
            assert_eq!(Day::from_unix_s(days * 86_400).unwrap().date(), date);
        }
    }
}

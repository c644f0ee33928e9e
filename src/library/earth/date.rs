//! Date of the calendar.

/// Date as days since 1970-01-01, UTC; until 2149.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Date(u16);

impl Date {
    /// 2020-01-01; an unset clock is earlier.
    const FIRST_VALID_DAY: u64 = 18_262;

    /// Date of a Unix time, seconds; `None` before 2020 (unset clock) and after 2149.
    #[must_use]
    pub fn from_unix_s(seconds: u64) -> Option<Self> {
        let days = seconds / 86_400;
        (days >= Self::FIRST_VALID_DAY).then(|| u16::try_from(days).ok().map(Self))?
    }

    /// Days since 1970-01-01.
    #[must_use]
    pub const fn days_since_1970(self) -> u16 {
        self.0
    }

    /// Year, month and day; valid until 2100-02-28.
    #[must_use]
    pub fn year_month_day(self) -> (u16, u8, u8) {
        // Days since 1968-03-01: the leap day is the last of four years, without exception before 2100.
        let days = u32::from(self.0) + 671;
        let (four_years, day) = (days / 1_461, days % 1_461);
        let year = (day / 365).min(3);
        let day = day - 365 * year;
        // Month lengths from March repeat 31, 30, 31, 30, 31.
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

    /// Limits: 2020-01-01 (`date -d 2020-01-01 +%s`) and the range of `u16`.
    #[test]
    fn an_unset_clock_has_no_date() {
        let day = |seconds| Date::from_unix_s(seconds).map(Date::days_since_1970);
        assert_eq!(day(1_577_836_800), Some(18_262));
        assert_eq!(day(1_577_836_799), None);
        assert_eq!(day(0), None);
        assert_eq!(day(65_536 * 86_400 - 1), Some(u16::MAX));
        assert_eq!(day(65_536 * 86_400), None);
        assert_eq!(day(u64::MAX), None);
    }

    /// Reference: `date -d`. Ends of months, years and leap years.
    #[test]
    fn dates_match_the_calendar() {
        for (days, date) in [
            (18_320, (2020, 2, 28)),
            (18_321, (2020, 2, 29)),
            (18_322, (2020, 3, 1)),
            (18_686, (2021, 2, 28)),
            (18_687, (2021, 3, 1)),
            (21_914, (2029, 12, 31)),
            (47_540, (2100, 2, 28)),
        ] {
            let day = Date::from_unix_s(days * 86_400).unwrap();
            assert_eq!(day.year_month_day(), date);
        }
        let lengths = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        let all = (1..).zip(lengths).flat_map(|(month, length)| (1..=length).map(move |day| (2026, month, day)));
        for (days, date) in (20_454..).zip(all) {
            assert_eq!(Date::from_unix_s(days * 86_400).unwrap().year_month_day(), date);
        }
    }
}

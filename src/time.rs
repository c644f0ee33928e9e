//! Time: instants, and milliseconds that wrap.
//!
//! The library has no clock of its own. Whoever drives it says when things happened, on any clock that starts at zero
//! and does not go back.

/// An instant: microseconds since the module started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

impl Timestamp {
    /// The start of the module.
    pub const START: Self = Self(0);

    /// So many microseconds after the start.
    #[must_use]
    pub const fn from_us(us: u64) -> Self {
        Self(us)
    }

    /// Microseconds since the start.
    #[must_use]
    pub const fn as_us(self) -> u64 {
        self.0
    }

    /// The same instant in milliseconds that wrap after 49 days.
    #[must_use]
    pub const fn wrapping_millis(self) -> WrappingMillis {
        // Keeping the low 32 bits is what wrapping means.
        WrappingMillis((self.0 / 1000) as u32)
    }

    /// Microseconds since an earlier instant; 0 if that is the later one.
    #[must_use]
    pub const fn us_since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// So many microseconds later.
    #[must_use]
    pub const fn plus_us(self, us: u64) -> Self {
        Self(self.0.saturating_add(us))
    }

    /// So many microseconds earlier, but not before the start.
    #[must_use]
    pub const fn minus_us(self, us: u64) -> Self {
        Self(self.0.saturating_sub(us))
    }

    /// So many microseconds later, or earlier where they are negative, but not before the start.
    #[must_use]
    pub const fn shifted_us(self, us: i32) -> Self {
        Self(self.0.saturating_add_signed(us as i64))
    }
}

/// A clock of milliseconds that wraps after 2^32 of them, 49.7 days: of samples, which are kept in small memory, and of
/// autopilots. Only differences of less than half of that mean anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WrappingMillis(u32);

impl WrappingMillis {
    /// The clock at this count.
    #[must_use]
    pub const fn new(millis: u32) -> Self {
        Self(millis)
    }

    /// The count.
    #[must_use]
    pub const fn count(self) -> u32 {
        self.0
    }

    /// Milliseconds since an earlier reading of the same clock.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// So many milliseconds later.
    #[must_use]
    pub const fn plus_ms(self, ms: u32) -> Self {
        Self(self.0.wrapping_add(ms))
    }

    /// Milliseconds since another reading of the same clock; negative if that is the later one.
    #[must_use]
    pub const fn difference(self, other: Self) -> i32 {
        self.since(other).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_differ_by_microseconds_and_stop_at_the_start() {
        let early = Timestamp::from_us(1_000);
        let late = early.plus_us(250);
        assert_eq!((late.us_since(early), early.us_since(late)), (250, 0));
        assert_eq!(late.minus_us(250), early);
        assert_eq!(early.minus_us(5_000), Timestamp::START);
        assert_eq!((early.shifted_us(250), late.shifted_us(-250)), (late, early));
        assert_eq!(early.shifted_us(-5_000), Timestamp::START);
        assert_eq!(Timestamp::from_us(u64::MAX).plus_us(1).as_us(), u64::MAX);
    }

    /// 2^32 ms after the start the count begins again, and differences go on.
    #[test]
    fn milliseconds_wrap_and_their_differences_do_not() {
        let before = Timestamp::from_us((u64::from(u32::MAX) - 99) * 1_000 + 999).wrapping_millis();
        let after = Timestamp::from_us((u64::from(u32::MAX) + 101) * 1_000).wrapping_millis();
        assert_eq!((before.count(), after.count()), (u32::MAX - 99, 100));
        assert_eq!(after.since(before), 200);
        assert_eq!((after.difference(before), before.difference(after)), (200, -200));
        assert_eq!(before.plus_ms(200), after);
    }
}

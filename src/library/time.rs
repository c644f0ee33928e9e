//! Timestamps, and milliseconds that wrap. The library has no clock: its caller supplies times of any clock that starts
//! at zero and is monotonic.

/// Microseconds since the start of the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

impl Timestamp {
    /// Start of the module.
    pub const START: Self = Self(0);

    /// A time in microseconds since the start.
    #[must_use]
    pub const fn from_us(us: u64) -> Self {
        Self(us)
    }

    /// Microseconds since the start.
    #[must_use]
    pub const fn as_us(self) -> u64 {
        self.0
    }

    /// The time in milliseconds, wrapping after 49.7 days.
    #[must_use]
    pub const fn wrapping_millis(self) -> WrappingMillis {
        // The cast wraps at 2^32 ms.
        WrappingMillis((self.0 / 1000) as u32)
    }

    /// Microseconds since an earlier time; 0 if that is later.
    #[must_use]
    pub const fn us_since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// The time plus microseconds, saturating.
    #[must_use]
    pub const fn plus_us(self, us: u64) -> Self {
        Self(self.0.saturating_add(us))
    }

    /// The time plus signed microseconds, at least the start.
    #[must_use]
    pub const fn plus_signed_us(self, us: i32) -> Self {
        Self(self.0.saturating_add_signed(us as i64))
    }
}

/// Milliseconds wrapping after 2^32, 49.7 days, as in samples (for their size) and in autopilot messages. Only
/// differences below half of that are meaningful.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WrappingMillis(u32);

impl WrappingMillis {
    /// A count of milliseconds.
    #[must_use]
    pub const fn new(millis: u32) -> Self {
        Self(millis)
    }

    /// Count of milliseconds, 0 to 2^32 - 1.
    #[must_use]
    pub const fn as_ms(self) -> u32 {
        self.0
    }

    /// Milliseconds since an earlier reading of the same clock.
    #[must_use]
    pub const fn ms_since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// The time plus milliseconds.
    #[must_use]
    pub const fn plus_ms(self, ms: u32) -> Self {
        Self(self.0.wrapping_add(ms))
    }

    /// Signed milliseconds since another reading of the same clock.
    #[must_use]
    pub const fn signed_ms_since(self, other: Self) -> i32 {
        self.ms_since(other).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_have_microseconds_and_saturate_at_start_and_end() {
        let early = Timestamp::from_us(1_000);
        let late = early.plus_us(250);
        assert_eq!((late.us_since(early), early.us_since(late)), (250, 0));
        assert_eq!((early.plus_signed_us(250), late.plus_signed_us(-250)), (late, early));
        assert_eq!(early.plus_signed_us(-5_000), Timestamp::START);
        assert_eq!(Timestamp::from_us(u64::MAX).plus_us(1).as_us(), u64::MAX);
    }

    #[test]
    fn wrapped_milliseconds_have_correct_differences() {
        let before = Timestamp::from_us((u64::from(u32::MAX) - 99) * 1_000 + 999).wrapping_millis();
        let after = Timestamp::from_us((u64::from(u32::MAX) + 101) * 1_000).wrapping_millis();
        assert_eq!((before.as_ms(), after.as_ms()), (u32::MAX - 99, 100));
        assert_eq!(after.ms_since(before), 200);
        assert_eq!((after.signed_ms_since(before), before.signed_ms_since(after)), (200, -200));
        assert_eq!(before.plus_ms(200), after);
    }
}

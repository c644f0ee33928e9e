//! Decimal numbers as text in fixed point: core's float formatting and parsing cost 20 KB of flash and are not linked.

use core::fmt;

/// Shows a number with so many decimals, rounded half away from zero; what is not finite shows as `-`.
///
/// Exact to 7 digits, the precision of `f32`; numbers beyond +-2 000 000 are shown as that bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal<const DECIMALS: u32>(pub f32);

impl<const DECIMALS: u32> fmt::Display for Decimal<DECIMALS> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&fixed(self.0, DECIMALS))
    }
}

/// Shows a number with the decimals that it was typed with: as few as tell it from all others, but so many at least.
///
/// Of [`Decimal`]'s range; zeros at the end that were typed are not known any more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AsTyped(pub f32, pub u32);

impl fmt::Display for AsTyped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value, mut decimals) = *self;
        let mut text = fixed(value, decimals);
        while decimals < MOST_DIGITS && parse(&text) != Some(value) {
            decimals += 1;
            text = fixed(value, decimals);
        }
        f.pad(&text)
    }
}

/// The text of a number with so many decimals. One function for all of them: each would be a copy in flash.
#[inline(never)]
fn fixed(value: f32, decimals: u32) -> heapless::String<24> {
    let mut text = heapless::String::new();
    let scale = 10_u32.pow(decimals.min(MOST_DIGITS));
    let size = value.abs().min(2e6);
    // What is left of the whole part is exact, and so the rounding is that of the number itself.
    let whole = size as u32;
    let fraction = ((size - whole as f32) * scale as f32 + 0.5) as u32;
    let (whole, fraction) = if fraction < scale { (whole, fraction) } else { (whole + 1, 0) };
    let sign = if value < 0.0 && (whole, fraction) != (0, 0) { "-" } else { "" };
    // Sign, seven digits, point and decimals always fit.
    let _ = if !value.is_finite() {
        text.push('-').map_err(|_| fmt::Error)
    } else if decimals == 0 {
        fmt::write(&mut text, format_args!("{sign}{whole}"))
    } else {
        fmt::write(&mut text, format_args!("{sign}{whole}.{fraction:0width$}", width = decimals as usize))
    };
    text
}

/// Digits before the point, and after it, that are read.
const MOST_DIGITS: u32 = 6;

/// Reads a number such as `12`, `-3.75`, `+0.5` or `.5`: a sign, up to 6 digits, up to 6 decimals.
///
/// `None` for anything else: no exponent, no white space, no `nan`.
#[must_use]
pub fn parse(text: &str) -> Option<f32> {
    let (negative, digits) = match text.as_bytes() {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        all => (false, all),
    };
    let point = digits.iter().position(|&b| b == b'.').unwrap_or(digits.len());
    let (whole, fraction) = digits.split_at(point);
    let fraction = fraction.get(1..).unwrap_or(&[]);
    let most = MOST_DIGITS as usize;
    if whole.len() > most || fraction.len() > most || whole.len() + fraction.len() == 0 {
        return None;
    }
    let number = |digits: &[u8]| {
        digits.iter().try_fold(0_u32, |value, &b| b.is_ascii_digit().then(|| value * 10 + u32::from(b - b'0')))
    };
    let decimals = 10_u32.pow(fraction.len() as u32);
    let magnitude = number(whole)? as f32 + number(fraction)? as f32 / decimals as f32;
    Some(if negative { -magnitude } else { magnitude })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shows_rounded_fixed_point() {
        for (value, text) in
            [(0.0, "0.0"), (359.96, "360.0"), (-0.04, "0.0"), (-0.05, "-0.1"), (7.25, "7.3"), (f32::NAN, "-")]
        {
            assert_eq!(Decimal::<1>(value).to_string(), text);
        }
        assert_eq!(Decimal::<3>(1.0625).to_string(), "1.063");
        assert_eq!(Decimal::<0>(-12.5).to_string(), "-13");
        assert_eq!(format!("{:>7}", Decimal::<2>(1.5)), "   1.50");
        assert_eq!(Decimal::<0>(f32::MAX).to_string(), "2000000");
    }

    /// All digits that an `f32` has, and no more than were typed; the first argument says how many there are at least.
    #[test]
    fn what_was_typed_is_shown_as_it_was_typed() {
        for (text, at_least) in [
            ("-3.25", 0),
            ("3.5", 1),
            ("3.50", 2),
            ("0.1", 1),
            ("0.10", 2),
            ("359.9999", 1),
            ("0.000001", 1),
            ("-11.3", 1),
            ("179.999", 0),
            ("7", 0),
            ("0", 0),
            ("-0.5", 0),
        ] {
            assert_eq!(AsTyped(parse(text).unwrap(), at_least).to_string(), text);
        }
        for (typed, shown) in [("+7.", "7.0"), (".5", "0.5"), ("1.500", "1.5"), ("-0", "0.0")] {
            assert_eq!(AsTyped(parse(typed).unwrap(), 1).to_string(), shown);
        }
        assert_eq!(AsTyped(f32::NAN, 2).to_string(), "-");
        assert_eq!(AsTyped(3e6, 0).to_string(), "2000000.000000");
        for i in 0..40_000 {
            let text = format!("{}.{:02}", i / 100, i % 100);
            assert_eq!(AsTyped(parse(&text).unwrap(), 2).to_string(), text);
        }
    }

    #[test]
    fn reads_what_people_type_and_nothing_else() {
        for (text, value) in [("12", 12.0), ("-3.75", -3.75), ("+0.5", 0.5), (".5", 0.5), ("180.", 180.0)] {
            assert_eq!(parse(text), Some(value), "{text}");
        }
        for text in ["", "-", ".", "1e3", "nan", " 1", "1.2.3", "--1", "1234567", "0.1234567", "1,5"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    #[test]
    fn halves_are_rounded_away_from_zero_and_carried() {
        for (value, text) in [(0.5, "1"), (0.49, "0"), (-0.49, "0"), (-0.5, "-1"), (1.5, "2"), (99.5, "100")] {
            assert_eq!(Decimal::<0>(value).to_string(), text);
        }
        // 0.125 and 0.375 are exact in binary.
        for (value, text) in [(0.125, "0.13"), (-0.375, "-0.38"), (9.996, "10.00"), (-0.004, "0.00"), (12.06, "12.06")]
        {
            assert_eq!(Decimal::<2>(value).to_string(), text);
        }
        assert_eq!(Decimal::<4>(0.0625).to_string(), "0.0625", "leading zeros of the fraction");
        assert_eq!(Decimal::<5>(-1.000_01).to_string(), "-1.00001");
    }

    #[test]
    fn what_is_too_large_or_no_number_still_shows() {
        assert_eq!(Decimal::<1>(1_999_999.0).to_string(), "1999999.0");
        assert_eq!(Decimal::<1>(2_000_001.0).to_string(), "2000000.0");
        assert_eq!(Decimal::<1>(f32::MIN).to_string(), "-2000000.0");
        for value in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            assert_eq!(format!("{:>4}|{:<4}", Decimal::<3>(value), Decimal::<3>(value)), "   -|-   ");
        }
    }

    #[test]
    fn six_digits_and_six_decimals_are_read_and_no_more() {
        for (text, value) in [
            ("999999", 999_999.0),
            ("0.000001", 1e-6),
            ("000000.500000", 0.5),
            ("+.25", 0.25),
            ("-.25", -0.25),
            ("-7.", -7.0),
            ("0", 0.0),
            ("1.09", 1.09),
        ] {
            assert_eq!(parse(text), Some(value), "{text}");
        }
        for text in ["1000000", "0000001", "0.0000001", ".0000000", "+", "+.", "-+1", "1-", "1 ", "\u{661}"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    /// The characters before `0` and after `9` are no digits, before the point and after it.
    #[test]
    fn only_digits_are_digits() {
        for text in ["/1", ":1", "1/", "1:", "0./", "0.:", "a", "0x1"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_shown_is_read_back() {
        for value in [0.0, 0.5, -0.5, 359.75, -179.25, 123_456.0] {
            assert_eq!(parse(&Decimal::<2>(value).to_string()), Some(value));
        }
    }
}

//! Decimal text of numbers: fixed and shortest formatting, and a strict parser without exponents.

use core::fmt::{self, Write};

/// Displays a number with a fixed number of decimals, as `core` rounds it, without a sign on zero; NaN and infinity as
/// `-`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal<const DECIMALS: usize>(pub f32);

impl<const DECIMALS: usize> fmt::Display for Decimal<DECIMALS> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format_fixed(self.0, DECIMALS))
    }
}

/// Displays a number with the decimals it was typed with: the fewest that parse to the same number, but at least a
/// minimum.
///
/// Typed zeros at the end are lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShortestDecimal(pub f32, pub usize);

impl fmt::Display for ShortestDecimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value, mut decimals) = *self;
        let mut text = format_fixed(value, decimals);
        while decimals < MAX_DIGITS_EACH_SIDE && parse_decimal(&text) != Some(value) {
            decimals += 1;
            text = format_fixed(value, decimals);
        }
        f.pad(&text)
    }
}

/// Longest text of a number, characters: a sign, 39 digits, a point and the decimals.
const DECIMAL_CAPACITY: usize = 41 + MAX_DIGITS_EACH_SIDE;

/// Formats a number with a fixed number of decimals; not generic, so that flash contains one copy.
fn format_fixed(value: f32, decimals: usize) -> heapless::String<DECIMAL_CAPACITY> {
    let mut text = heapless::String::new();
    if !value.is_finite() {
        let _ = text.push('-');
        return text;
    }
    // Infallible: the capacity is that of the longest text.
    let _ = write!(text, "{value:.decimals$}");
    if text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) && value.is_sign_negative() {
        text.remove(0);
    }
    text
}

/// Maximum number of digits before and after the point.
const MAX_DIGITS_EACH_SIDE: usize = 6;

/// Parses a number such as `12`, `-3.75`, `+0.5` or `.5`: a sign, up to 6 digits, up to 6 decimals.
///
/// `None` for anything else: no exponent, no white space, no `nan`.
#[must_use]
pub fn parse_decimal(text: &str) -> Option<f32> {
    let (negative, digits) = match text.as_bytes() {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        all => (false, all),
    };
    let point = digits.iter().position(|&b| b == b'.').unwrap_or(digits.len());
    let (whole_digits, fraction) = digits.split_at(point);
    let fraction = fraction.get(1..).unwrap_or(&[]);
    if whole_digits.len() > MAX_DIGITS_EACH_SIDE
        || fraction.len() > MAX_DIGITS_EACH_SIDE
        || whole_digits.len() + fraction.len() == 0
    {
        return None;
    }
    let digits_value = |digits: &[u8]| {
        digits.iter().try_fold(0_u32, |value, &b| b.is_ascii_digit().then(|| value * 10 + u32::from(b - b'0')))
    };
    let decimals = 10_u32.pow(fraction.len() as u32);
    let magnitude = digits_value(whole_digits)? as f32 + digits_value(fraction)? as f32 / decimals as f32;
    Some(if negative { -magnitude } else { magnitude })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Halves that are exact in binary are rounded to even, and carried.
    #[test]
    fn decimals_are_rounded_to_fixed_point() {
        for (found, text) in [
            (Decimal::<0>(0.5).to_string(), "0"),
            (Decimal::<0>(0.51).to_string(), "1"),
            (Decimal::<0>(-0.49).to_string(), "0"),
            (Decimal::<0>(1.5).to_string(), "2"),
            (Decimal::<0>(99.5).to_string(), "100"),
            (Decimal::<0>(-12.5).to_string(), "-12"),
            (Decimal::<0>(f32::MAX).to_string(), &format!("{:.0}", f32::MAX)),
            (Decimal::<1>(0.0).to_string(), "0.0"),
            (Decimal::<1>(359.96).to_string(), "360.0"),
            (Decimal::<1>(-0.04).to_string(), "0.0"),
            (Decimal::<1>(-0.05).to_string(), "-0.1"),
            (Decimal::<1>(1_999_999.0).to_string(), "1999999.0"),
            (Decimal::<2>(-0.375).to_string(), "-0.38"),
            (Decimal::<2>(9.996).to_string(), "10.00"),
            (Decimal::<3>(1.0625).to_string(), "1.062"),
            (Decimal::<4>(0.0625).to_string(), "0.0625"),
            (Decimal::<5>(-1.000_01).to_string(), "-1.00001"),
            (Decimal::<6>(f32::MIN).to_string(), &format!("{:.6}", f32::MIN)),
            (format!("{:>7}", Decimal::<2>(1.5)), "   1.50"),
        ] {
            assert_eq!(found, text);
        }
        for value in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            assert_eq!(format!("{:>4}|{:<4}", Decimal::<3>(value), Decimal::<3>(value)), "   -|-   ");
        }
    }

    /// Numbers of up to seven digits are shown as typed, with at least `at_least` decimals.
    #[test]
    fn a_typed_number_is_shown_as_typed() {
        for (typed, at_least, shown) in [
            ("-3.25", 0, "-3.25"),
            ("3.5", 1, "3.5"),
            ("3.50", 2, "3.50"),
            ("0.1", 1, "0.1"),
            ("359.9999", 1, "359.9999"),
            ("0.000001", 1, "0.000001"),
            ("7", 0, "7"),
            ("0", 0, "0"),
            ("-0.5", 0, "-0.5"),
            ("+7.", 1, "7.0"),
            (".5", 1, "0.5"),
            ("1.500", 1, "1.5"),
            ("-0", 1, "0.0"),
        ] {
            assert_eq!(ShortestDecimal(parse_decimal(typed).unwrap(), at_least).to_string(), shown, "{typed}");
        }
        assert_eq!(ShortestDecimal(f32::NAN, 2).to_string(), "-");
        assert_eq!(ShortestDecimal(3e6, 0).to_string(), "3000000.000000", "too many digits to be read back");
        for i in 0..40_000 {
            let text = format!("{}.{:02}", i / 100, i % 100);
            assert_eq!(ShortestDecimal(parse_decimal(&text).unwrap(), 2).to_string(), text);
        }
    }

    /// `/` and `:` are the ASCII neighbours of `0` and `9`.
    #[test]
    fn other_text_is_no_number() {
        for text in [
            "",
            "-",
            ".",
            "+",
            "+.",
            "1e3",
            "nan",
            "a",
            "0x1",
            " 1",
            "1 ",
            "1.2.3",
            "--1",
            "-+1",
            "1-",
            "1,5",
            "\u{661}",
            "/1",
            ":1",
            "1/",
            "1:",
            "0./",
            "0.:",
            "1234567",
            "0000001",
            "0.1234567",
            ".0000000",
        ] {
            assert_eq!(parse_decimal(text), None, "{text}");
        }
    }
}

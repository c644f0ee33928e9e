//! NMEA 0183 heading sentences out: `HCHDM`, `HCHDG`, and the proprietary `PASWH` with the heading's quality.

//!
//! Written without `core::fmt`, which takes 2,000 instructions for such a sentence.

use crate::heading::{Heading, NoHeading};

/// A sentence with its checksum and line end; at most 82 characters by the standard.
pub type Sentence = heapless::String<82>;

/// Whether there was room. Bodies here are at most 40 characters, so there always is.
type Fits = Option<()>;

/// `$HCHDM,hhh.h,M*cs`: magnetic heading. The field is empty when there is no heading to trust.
#[must_use]
pub fn hdm(heading_deg: Option<f32>) -> Sentence {
    sentence(|body| {
        put(body, "HCHDM,")?;
        put_heading(body, heading_deg)?;
        put(body, ",M")
    })
}

/// `$HCHDG,hhh.h,,,v.v,E*cs`: magnetic heading, deviation, variation.
///
/// The deviation fields are empty because the heading has it taken out already. Variation (declination) is what was
/// configured, empty when it was not; the heading is magnetic in any case.
#[must_use]
pub fn hdg(heading_deg: Option<f32>, variation_deg: Option<f32>) -> Sentence {
    sentence(|body| {
        put(body, "HCHDG,")?;
        put_heading(body, heading_deg)?;
        put(body, ",,,")?;
        match variation_deg {
            Some(variation_deg) => {
                put_tenths(body, rounded_tenths(variation_deg.abs()), 1)?;
                put(body, if variation_deg < 0.0 { ",W" } else { ",E" })
            }
            None => put(body, ","),
        }
    })
}

/// `$PASWH,hhh.h,s.s,ok*cs`: magnetic heading, its standard deviation, degrees, and `ok`; or two empty fields and the code
/// of why there is none.
#[must_use]
pub fn quality(heading: &Result<Heading, NoHeading>) -> Sentence {
    sentence(|body| {
        put(body, "PASWH,")?;
        match heading {
            Ok(heading) => {
                put_heading(body, Some(heading.magnetic_deg()))?;
                put(body, ",")?;
                // Beyond this the heading says nothing at all.
                put_tenths(body, rounded_tenths(heading.sigma_deg().min(180.0)), 1)?;
                put(body, ",ok")
            }
            Err(why) => {
                put(body, ",,")?;
                put(body, why.code())
            }
        }
    })
}

fn put(body: &mut Sentence, text: &str) -> Fits {
    body.push_str(text).ok()
}

/// 000.0..359.9, or nothing.
fn put_heading(body: &mut Sentence, heading_deg: Option<f32>) -> Fits {
    let Some(heading_deg) = heading_deg.filter(|h| h.is_finite()) else { return Some(()) };
    // Rounded first, so that 359.97 goes out as 000.0 and never as 360.0.
    let tenths = (heading_deg * 10.0 + 0.5_f32.copysign(heading_deg)) as i32;
    put_tenths(body, tenths.rem_euclid(3600).unsigned_abs(), 3)
}

/// Of a number that is not negative.
fn rounded_tenths(value: f32) -> u32 {
    (value * 10.0 + 0.5) as u32
}

/// A number with one decimal and at least so many digits before the point.
fn put_tenths(body: &mut Sentence, tenths: u32, least_digits: usize) -> Fits {
    /// Digits of the largest whole part.
    const DIGITS: usize = 9;
    let digit = |value: u32| b'0' + (value % 10) as u8;
    let mut text = [b'.'; DIGITS + 2];
    let (whole, fraction) = text.split_at_mut(DIGITS);
    if let Some(last) = fraction.last_mut() {
        *last = digit(tenths);
    }
    let mut rest = tenths / 10;
    let mut digits = 0;
    for place in whole.iter_mut().rev() {
        if rest == 0 && digits >= least_digits {
            break;
        }
        *place = digit(rest);
        rest /= 10;
        digits += 1;
    }
    put(body, core::str::from_utf8(text.get(DIGITS - digits..)?).ok()?)
}

/// Frames a body with `$`, checksum and line end. Should one ever not fit, the sentence is cut and its missing checksum
/// tells the receiver.
fn sentence(fill: impl FnOnce(&mut Sentence) -> Fits) -> Sentence {
    const HEX: &[u8; 16] = b"0123456789ABCDEF";
    let mut out = Sentence::new();
    let complete = put(&mut out, "$").and_then(|()| fill(&mut out));
    if complete.is_some() {
        let checksum = checksum(out.get(1..).unwrap_or_default());
        let [high, low] = [checksum >> 4, checksum & 15].map(|nibble| HEX[usize::from(nibble)]);
        let end = [b'*', high, low, b'\r', b'\n'];
        // ASCII, and there is room: see `Fits`.
        let _ = put(&mut out, core::str::from_utf8(&end).unwrap_or_default());
    }
    out
}

/// Exclusive or of all characters between `$` and `*`.
#[must_use]
pub fn checksum(body: &str) -> u8 {
    body.bytes().fold(0, |sum, byte| sum ^ byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_read_as_the_standard_says() {
        // Checksums from an independent exclusive or over the characters between $ and *.
        assert_eq!(hdm(Some(101.14)).as_str(), "$HCHDM,101.1,M*28\r\n");
        assert_eq!(hdm(None).as_str(), "$HCHDM,,M*07\r\n");
        assert!(hdg(Some(7.0), Some(-11.56)).starts_with("$HCHDG,007.0,,,11.6,W*"));
        assert!(hdg(None, None).starts_with("$HCHDG,,,,,*"));
    }

    #[test]
    fn quality_shows_sigma_or_the_reason() {
        let heading = Heading { magnetic_rad: 1.765_2, sigma_rad: 0.009_6 };
        assert!(quality(&Ok(heading)).starts_with("$PASWH,101.1,0.6,ok*"), "{}", quality(&Ok(heading)));
        assert!(quality(&Err(NoHeading::AttitudeStale)).starts_with("$PASWH,,,attitude-stale*"));
        let lost = Heading { sigma_rad: f32::NAN, ..heading };
        assert!(quality(&Ok(lost)).starts_with("$PASWH,101.1,180.0,ok*"));
    }

    #[test]
    fn heading_never_shows_360() {
        for (heading_deg, text) in [(359.94, "359.9"), (359.96, "000.0"), (-0.2, "359.8"), (360.0, "000.0")] {
            assert!(hdm(Some(heading_deg)).contains(text), "{heading_deg}");
        }
        assert_eq!(hdm(Some(f32::NAN)), hdm(None));
    }
}

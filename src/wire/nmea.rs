//! NMEA 0183 heading sentences out: `HCHDM`, `HCHDG`, and the proprietary `PASWH` with the heading's quality.

use core::fmt::{self, Write as _};

use super::decimal::Decimal;
use crate::heading::{Heading, NoHeading};

/// A sentence with its checksum and line end; at most 82 characters by the standard.
pub type Sentence = heapless::String<82>;

/// `$HCHDM,hhh.h,M*cs`: magnetic heading. The field is empty when there is no heading to trust.
#[must_use]
pub fn hdm(heading_deg: Option<f32>) -> Sentence {
    sentence(|body| {
        body.write_str("HCHDM,")?;
        write_heading(body, heading_deg)?;
        body.write_str(",M")
    })
}

/// `$HCHDG,hhh.h,,,v.v,E*cs`: magnetic heading, deviation, variation.
///
/// The deviation fields are empty because the heading has it taken out already. Variation (declination) is what was
/// configured, empty when it was not; the heading is magnetic in any case.
#[must_use]
pub fn hdg(heading_deg: Option<f32>, variation_deg: Option<f32>) -> Sentence {
    sentence(|body| {
        body.write_str("HCHDG,")?;
        write_heading(body, heading_deg)?;
        body.write_str(",,,")?;
        match variation_deg {
            Some(variation_deg) => {
                let direction = if variation_deg < 0.0 { 'W' } else { 'E' };
                write!(body, "{},{direction}", Decimal::<1>(variation_deg.abs()))
            }
            None => body.write_char(','),
        }
    })
}

/// `$PASWH,hhh.h,s.s,ok*cs`: magnetic heading, its standard deviation, degrees, and `ok`; or two empty fields and the code
/// of why there is none.
#[must_use]
pub fn quality(heading: &Result<Heading, NoHeading>) -> Sentence {
    sentence(|body| {
        body.write_str("PASWH,")?;
        match heading {
            Ok(heading) => {
                write_heading(body, Some(heading.magnetic_deg()))?;
                // Beyond this the heading says nothing at all.
                write!(body, ",{},ok", Decimal::<1>(heading.sigma_deg().min(180.0)))
            }
            Err(why) => write!(body, ",,{}", why.code()),
        }
    })
}

/// Writes 000.0..359.9, or nothing.
fn write_heading(body: &mut Sentence, heading_deg: Option<f32>) -> fmt::Result {
    let Some(heading_deg) = heading_deg.filter(|h| h.is_finite()) else { return Ok(()) };
    // Rounded first, so that 359.97 goes out as 000.0 and never as 360.0.
    let tenths = (heading_deg * 10.0 + 0.5_f32.copysign(heading_deg)) as i32;
    let tenths = tenths.rem_euclid(3600);
    write!(body, "{:03}.{}", tenths / 10, tenths % 10)
}

/// Frames a body with `$`, checksum and line end. Bodies here are at most 40 characters, so they always fit; should
/// one ever not, the sentence is cut and its missing checksum tells the receiver.
fn sentence(fill: impl FnOnce(&mut Sentence) -> fmt::Result) -> Sentence {
    let mut out = Sentence::new();
    let complete = out.write_char('$').and_then(|()| fill(&mut out));
    if complete.is_ok() {
        let checksum = checksum(out.get(1..).unwrap_or_default());
        // Fits for the reason above; nothing is lost but this sentence if it ever does not.
        let _ = write!(out, "*{checksum:02X}\r\n");
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

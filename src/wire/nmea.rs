//! NMEA 0183 heading sentences out: `HCHDM`, `HCHDG`, `HCHDT`, and the proprietary `PASWH` with the heading's quality.
//!
//! Written without `core::fmt`, which takes 2,000 instructions for such a sentence.

use crate::heading::{Heading, NoHeading};
use crate::settings::HeadingKind;

/// A sentence in ASCII, with its checksum and line end; at most 82 characters by the standard.
pub type Sentence = heapless::Vec<u8, 82>;

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
/// The deviation fields are empty because the heading has it taken out already. Variation (declination) is what is known of
/// it, empty where nothing is; the heading is magnetic in any case.
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

/// `$HCHDT,hhh.h,T*cs`: true heading, of a magnetic one and the variation (declination). The field is empty when there is no
/// heading to trust. `HC` is the talker, as of the others: a magnetic compass.
#[must_use]
pub fn hdt(heading_deg: Option<f32>, variation_deg: f32) -> Sentence {
    sentence(|body| {
        put(body, "HCHDT,")?;
        put_heading(body, heading_deg.map(|magnetic_deg| magnetic_deg + variation_deg))?;
        put(body, ",T")
    })
}

/// `$PASWH,hhh.h,s.s,ok,smooth*cs`: magnetic heading, its standard deviation, degrees, `ok`, and which heading it is,
/// `smooth` or `raw`; or two empty fields, the code of why there is none, and an empty field.
#[must_use]
pub fn quality(heading: &Result<Heading, NoHeading>, kind: HeadingKind) -> Sentence {
    sentence(|body| {
        put(body, "PASWH,")?;
        match heading {
            Ok(heading) => {
                put_heading(body, Some(heading.magnetic_deg()))?;
                put(body, ",")?;
                // Beyond this the heading says nothing at all.
                put_tenths(body, rounded_tenths(heading.sigma_deg().min(180.0)), 1)?;
                put(body, ",ok,")?;
                put(body, kind.name())
            }
            Err(why) => {
                put(body, ",,")?;
                put(body, why.code())?;
                put(body, ",")
            }
        }
    })
}

fn put(body: &mut Sentence, text: &str) -> Fits {
    body.extend_from_slice(text.as_bytes()).ok()
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
    body.extend_from_slice(text.get(DIGITS - digits..)?).ok()
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
        // There is room: see `Fits`.
        let _ = out.extend_from_slice(&end);
    }
    out
}

/// Exclusive or of all characters between `$` and `*`.
#[must_use]
pub fn checksum(body: &[u8]) -> u8 {
    body.iter().fold(0, |sum, byte| sum ^ byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(sentence: &Sentence) -> &str {
        str::from_utf8(sentence).unwrap()
    }

    fn heading(magnetic_rad: f32, sigma_rad: f32) -> Heading {
        Heading { magnetic_rad, sigma_rad, systematic_rad2: 0.0 }
    }

    #[test]
    fn sentences_read_as_the_standard_says() {
        // Checksums from an independent exclusive or over the characters between $ and *.
        assert_eq!(text(&hdm(Some(101.14))), "$HCHDM,101.1,M*28\r\n");
        assert_eq!(text(&hdm(None)), "$HCHDM,,M*07\r\n");
        assert!(hdg(Some(7.0), Some(-11.56)).starts_with(b"$HCHDG,007.0,,,11.6,W*"));
        assert!(hdg(None, None).starts_with(b"$HCHDG,,,,,*"));
    }

    /// Across north both ways; without a heading to trust there is a sentence that says so.
    #[test]
    fn a_true_heading_is_the_magnetic_one_and_the_variation() {
        for (heading_deg, variation_deg, text) in [
            (Some(101.1), 5.25, "106.4"),
            (Some(101.1), -11.3, "089.8"),
            (Some(358.0), 3.0, "001.0"),
            (Some(2.0), -3.0, "359.0"),
            (Some(0.0), -180.0, "180.0"),
            (None, 5.0, ""),
            (Some(1.0), f32::NAN, ""),
        ] {
            assert_eq!(body(&hdt(heading_deg, variation_deg)), format!("HCHDT,{text},T"));
        }
    }

    #[test]
    fn quality_shows_sigma_or_the_reason() {
        let heading = heading(1.765_2, 0.009_6);
        for kind in [HeadingKind::Raw, HeadingKind::Smooth] {
            let told = quality(&Ok(heading), kind);
            assert!(text(&told).starts_with(&format!("$PASWH,101.1,0.6,ok,{}*", kind.name())), "{told:?}");
            assert!(quality(&Err(NoHeading::AttitudeStale), kind).starts_with(b"$PASWH,,,attitude-stale,*"));
        }
        let lost = Heading { sigma_rad: f32::NAN, ..heading };
        assert!(quality(&Ok(lost), HeadingKind::Raw).starts_with(b"$PASWH,101.1,180.0,ok,raw*"));
    }

    #[test]
    fn heading_never_shows_360() {
        for (heading_deg, shown) in [(359.94, "359.9"), (359.96, "000.0"), (-0.2, "359.8"), (360.0, "000.0")] {
            assert!(text(&hdm(Some(heading_deg))).contains(shown), "{heading_deg}");
        }
        assert_eq!(hdm(Some(f32::NAN)), hdm(None));
    }

    /// A sentence without its checksum, which is right by an exclusive or of its own; and no longer than may be.
    fn body(sentence: &Sentence) -> &str {
        let (body, sum) =
            text(sentence).strip_prefix('$').unwrap().strip_suffix("\r\n").unwrap().split_once('*').unwrap();
        let mut expected = 0;
        for byte in body.bytes() {
            expected ^= byte;
        }
        assert_eq!(sum, format!("{expected:02X}"), "{sentence:?}");
        assert!(sentence.len() <= 82);
        body
    }

    /// 12.5 and so on are exact in binary, so that their tenths are halves exactly.
    #[test]
    fn a_heading_has_three_digits_and_is_rounded_to_the_nearest_tenth() {
        for (heading_deg, text) in [
            (0.0, "000.0"),
            (0.04, "000.0"),
            (0.06, "000.1"),
            (9.94, "009.9"),
            (9.96, "010.0"),
            (12.125, "012.1"),
            (12.25, "012.3"),
            (99.96, "100.0"),
            (180.0, "180.0"),
            (359.94, "359.9"),
            (359.96, "000.0"),
            (360.04, "000.0"),
            (361.0, "001.0"),
            (725.5, "005.5"),
            (-0.04, "000.0"),
            (-0.06, "359.9"),
            (-0.25, "359.7"),
            (-90.0, "270.0"),
            (-360.1, "359.9"),
        ] {
            assert_eq!(body(&hdm(Some(heading_deg))), format!("HCHDM,{text},M"), "{heading_deg}");
            assert_eq!(body(&hdg(Some(heading_deg), None)), format!("HCHDG,{text},,,,"), "{heading_deg}");
        }
        for heading_deg in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(body(&hdm(Some(heading_deg))), "HCHDM,,M");
            assert_eq!(body(&hdg(Some(heading_deg), Some(1.0))), "HCHDG,,,,1.0,E");
        }
    }

    #[test]
    fn variation_is_a_size_with_its_side() {
        for (variation_deg, text) in [
            (0.0, "0.0,E"),
            (-0.0, "0.0,E"),
            (3.5, "3.5,E"),
            (-3.5, "3.5,W"),
            (0.25, "0.3,E"),
            (-0.25, "0.3,W"),
            (9.96, "10.0,E"),
            (-11.54, "11.5,W"),
            (180.0, "180.0,E"),
            (-180.0, "180.0,W"),
        ] {
            assert_eq!(body(&hdg(Some(90.0), Some(variation_deg))), format!("HCHDG,090.0,,,{text}"));
        }
    }

    #[test]
    fn sigma_is_in_degrees_and_ends_at_half_a_circle() {
        for (sigma_deg, text) in [
            (0.0, "0.0"),
            (0.44, "0.4"),
            (0.46, "0.5"),
            (9.97, "10.0"),
            (179.9, "179.9"),
            (180.1, "180.0"),
            (f32::INFINITY, "180.0"),
        ] {
            let heading = heading(45.0_f32.to_radians(), sigma_deg.to_radians());
            assert_eq!(body(&quality(&Ok(heading), HeadingKind::Smooth)), format!("PASWH,045.0,{text},ok,smooth"));
        }
        let none = quality(&Err(NoHeading::AttitudeStale), HeadingKind::Smooth);
        assert_eq!(body(&none), "PASWH,,,attitude-stale,");
    }

    /// Nothing that can be given to them makes the sentences longer than the standard allows.
    #[test]
    fn the_longest_sentences_are_complete() {
        for extreme in [f32::MAX, f32::MIN, f32::INFINITY, f32::NAN, 1e7] {
            body(&hdm(Some(extreme)));
            body(&hdg(Some(extreme), Some(extreme)));
            body(&hdt(Some(extreme), extreme));
            body(&quality(&Ok(heading(extreme, extreme)), HeadingKind::Smooth));
        }
        assert_eq!(body(&hdg(None, Some(f32::MAX))), format!("HCHDG,,,,{}.5,E", u32::MAX / 10));
    }

    /// `$`, 76 characters, `*`, two digits and the line end are 82.
    #[test]
    fn what_does_not_fit_has_no_checksum() {
        let of = |length: usize| sentence(|out| put(out, &"A".repeat(length)));
        assert_eq!((of(76).len(), body(&of(76)).len()), (82, 76));
        for length in [77, 80, 81, 82, 100] {
            assert!(!of(length).contains(&b'*'), "{length}");
        }
    }

    #[test]
    fn tenths_have_as_many_digits_as_they_need_and_no_fewer_than_asked() {
        for (tenths, least, text) in
            [(0, 1, "0.0"), (0, 3, "000.0"), (7, 1, "0.7"), (99, 1, "9.9"), (100, 1, "10.0"), (12_345, 3, "1234.5")]
        {
            let mut out = Sentence::new();
            put_tenths(&mut out, tenths, least).unwrap();
            assert_eq!(out, text.as_bytes());
        }
    }
}

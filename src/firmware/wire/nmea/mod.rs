//! NMEA 0183: heading sentences `HCHDM`, `HCHDG`, `HCHDT`, and the proprietary `PASWH` with the heading's quality; rate of
//! turn and attitude, `HCROT`, `HCXDR`, `PASHR`; the speed of a satellite receiver, `RMC` and `VTG`.
//!
//! Written without `core::fmt`, which takes 2,000 instructions for a sentence.

mod sentence;
mod speed;

pub use sentence::{Sentence, checksum};
pub use speed::SpeedReceiver;

use autoswing::frames::RollPitch;
use autoswing::heading::{Heading, NoHeading};
use autoswing_module::settings::HeadingKind;

/// `None` if the sentence is full, which never happens: bodies have at most 70 characters.
type WriteResult = Option<()>;

/// `$HCHDM,hhh.h,M*cs`: magnetic heading; the field is empty without a valid heading.
#[must_use]
pub fn hdm_sentence(heading_deg: Option<f32>) -> Sentence {
    build_sentence(|body| {
        put_text(body, "HCHDM,")?;
        put_heading(body, heading_deg)?;
        put_text(body, ",M")
    })
}

/// `$HCHDG,hhh.h,,,v.v,E*cs`: magnetic heading, deviation, variation.
///
/// The deviation fields are empty because the heading is corrected already. Variation (declination) is empty if
/// unknown; the heading is magnetic in any case.
#[must_use]
pub fn hdg_sentence(heading_deg: Option<f32>, variation_deg: Option<f32>) -> Sentence {
    build_sentence(|body| {
        put_text(body, "HCHDG,")?;
        put_heading(body, heading_deg)?;
        put_text(body, ",,,")?;
        match variation_deg {
            Some(variation_deg) => {
                put_tenths(body, rounded_tenths(variation_deg.abs()), 1)?;
                put_text(body, if variation_deg < 0.0 { ",W" } else { ",E" })
            }
            None => put_text(body, ","),
        }
    })
}

/// `$HCHDT,hhh.h,T*cs`: true heading, the sum of magnetic heading and variation (declination); the field is empty
/// without a valid heading. The talker is `HC`, magnetic compass, as in the other sentences.
#[must_use]
pub fn hdt_sentence(heading_deg: Option<f32>, variation_deg: f32) -> Sentence {
    build_sentence(|body| {
        put_text(body, "HCHDT,")?;
        put_heading(body, heading_deg.map(|magnetic_deg| magnetic_deg + variation_deg))?;
        put_text(body, ",T")
    })
}

/// `$PASWH,hhh.h,s.s,ok,smooth*cs`: magnetic heading, its standard deviation, degrees, `ok`, and the kind of heading,
/// `smooth` or `raw`. Without a heading: two empty fields, the code of the reason, and an empty field.
#[must_use]
pub fn quality_sentence(heading: &Result<Heading, NoHeading>, kind: HeadingKind) -> Sentence {
    build_sentence(|body| {
        put_text(body, "PASWH,")?;
        match heading {
            Ok(heading) => {
                put_heading(body, Some(heading.magnetic_deg()))?;
                put_text(body, ",")?;
                // A sigma above 180 deg carries no information.
                put_tenths(body, rounded_tenths(heading.sigma_deg().min(180.0)), 1)?;
                put_text(body, ",ok,")?;
                put_text(body, kind.choice_name())
            }
            Err(reason) => {
                put_text(body, ",,")?;
                put_text(body, reason.stable_code())?;
                put_text(body, ",")
            }
        }
    })
}

/// `$HCROT,r.r,A*cs`: rate of turn, degrees per minute, to starboard positive.
#[must_use]
pub fn rot_sentence(turn_rate_rad_s: f32) -> Sentence {
    build_sentence(|body| {
        put_text(body, "HCROT,")?;
        put_signed(body, 60.0 * turn_rate_rad_s.to_degrees())?;
        put_text(body, ",A")
    })
}

/// `$HCXDR,A,p.p,D,PTCH,A,r.r,D,ROLL*cs`: pitch, nose up positive, and roll, starboard down positive, degrees.
#[must_use]
pub fn xdr_sentence(attitude: RollPitch) -> Sentence {
    build_sentence(|body| {
        for (prefix, angle_rad, name) in
            [("HCXDR,A,", attitude.pitch_rad, ",D,PTCH"), (",A,", attitude.roll_rad, ",D,ROLL")]
        {
            put_text(body, prefix)?;
            put_signed(body, angle_rad.to_degrees())?;
            put_text(body, name)?;
        }
        Some(())
    })
}

/// `$PASHR,,hhh.h,T,r.r,p.p,,s.s,s.s,s.s,0,1*cs`: true heading, roll, pitch, and the standard deviations of roll, pitch and
/// heading, degrees. Time and heave are empty, as the heading without a valid one; no satellite receiver, sensors aligned.
#[must_use]
pub fn pashr_sentence(
    true_heading_deg: Option<f32>,
    attitude: RollPitch,
    tilt_sigmas_rad: [f32; 2],
    heading_sigma_deg: Option<f32>,
) -> Sentence {
    build_sentence(|body| {
        put_text(body, "PASHR,,")?;
        put_heading(body, true_heading_deg)?;
        put_text(body, ",T")?;
        for angle_rad in [attitude.roll_rad, attitude.pitch_rad] {
            put_text(body, ",")?;
            put_signed(body, angle_rad.to_degrees())?;
        }
        put_text(body, ",")?;
        for sigma_rad in tilt_sigmas_rad {
            put_text(body, ",")?;
            put_tenths(body, rounded_tenths(sigma_rad.to_degrees().min(180.0)), 1)?;
        }
        put_text(body, ",")?;
        if let Some(sigma_deg) = heading_sigma_deg {
            put_tenths(body, rounded_tenths(sigma_deg.min(180.0)), 1)?;
        }
        put_text(body, ",0,1")
    })
}

fn put_text(body: &mut Sentence, text: &str) -> WriteResult {
    body.extend_from_slice(text.as_bytes()).ok()
}

/// Writes 000.0..359.9, or nothing.
fn put_heading(body: &mut Sentence, heading_deg: Option<f32>) -> WriteResult {
    let Some(heading_deg) = heading_deg.filter(|h| h.is_finite()) else { return Some(()) };
    // Rounded before it is wrapped, so that 359.97 becomes 000.0 and never 360.0.
    let tenths = (heading_deg * 10.0 + 0.5_f32.copysign(heading_deg)) as i32;
    put_tenths(body, tenths.rem_euclid(3600).unsigned_abs(), 3)
}

/// Writes a number with one decimal, and a minus if it is negative.
fn put_signed(body: &mut Sentence, value: f32) -> WriteResult {
    let tenths = rounded_tenths(value.abs());
    if value < 0.0 && tenths > 0 {
        put_text(body, "-")?;
    }
    put_tenths(body, tenths, 1)
}

fn rounded_tenths(value: f32) -> u32 {
    (value * 10.0 + 0.5) as u32
}

/// Writes tenths as a number with one decimal and a minimum of digits before the point.
fn put_tenths(body: &mut Sentence, tenths: u32, min_whole_digits: usize) -> WriteResult {
    /// Largest number of digits before the decimal point.
    const MAX_WHOLE_DIGITS: usize = 9;
    let digit = |value: u32| b'0' + (value % 10) as u8;
    let mut text = [b'.'; MAX_WHOLE_DIGITS + 2];
    let (whole, fraction) = text.split_at_mut(MAX_WHOLE_DIGITS);
    if let Some(last) = fraction.last_mut() {
        *last = digit(tenths);
    }
    let mut remaining = tenths / 10;
    let mut digits = 0;
    for character in whole.iter_mut().rev() {
        if remaining == 0 && digits >= min_whole_digits {
            break;
        }
        *character = digit(remaining);
        remaining /= 10;
        digits += 1;
    }
    body.extend_from_slice(text.get(MAX_WHOLE_DIGITS - digits..)?).ok()
}

/// Adds `$`, checksum and line end to a body. A sentence that does not fit is cut, and lacks the checksum, so that
/// receivers reject it.
fn build_sentence(fill: impl FnOnce(&mut Sentence) -> WriteResult) -> Sentence {
    const HEX_DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    let mut out = Sentence::new();
    let complete = put_text(&mut out, "$").and_then(|()| fill(&mut out));
    if complete.is_some() {
        let checksum = checksum(out.get(1..).unwrap_or_default());
        let [high, low] = [checksum >> 4, checksum & 15].map(|nibble| HEX_DIGITS[usize::from(nibble)]);
        let ending = [b'*', high, low, b'\r', b'\n'];
        // There is room: bodies have at most 70 characters.
        let _ = out.extend_from_slice(&ending);
    }
    out
}

#[cfg(test)]
mod tests;

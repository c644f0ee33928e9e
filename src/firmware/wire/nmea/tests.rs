//! Unit tests of `nmea`.

use super::*;

fn sentence_text(sentence: &Sentence) -> &str {
    str::from_utf8(sentence).unwrap()
}

fn heading(magnetic_rad: f32, sigma_rad: f32) -> Heading {
    Heading { magnetic_rad, sigma_rad, systematic_variance_rad2: 0.0 }
}

#[test]
fn sentences_match_the_nmea_standard() {
    // Checksums from an independent implementation.
    assert_eq!(sentence_text(&hdm_sentence(Some(101.14))), "$HCHDM,101.1,M*28\r\n");
    assert_eq!(sentence_text(&hdm_sentence(None)), "$HCHDM,,M*07\r\n");
    assert!(hdg_sentence(Some(7.0), Some(-11.56)).starts_with(b"$HCHDG,007.0,,,11.6,W*"));
    assert!(hdg_sentence(None, None).starts_with(b"$HCHDG,,,,,*"));
}

/// The sum is tested across north in both directions; without a valid heading the field is empty.
#[test]
fn a_true_heading_is_magnetic_heading_plus_variation() {
    for (heading_deg, variation_deg, text) in [
        (Some(101.1), 5.25, "106.4"),
        (Some(101.1), -11.3, "089.8"),
        (Some(358.0), 3.0, "001.0"),
        (Some(2.0), -3.0, "359.0"),
        (Some(0.0), -180.0, "180.0"),
        (None, 5.0, ""),
        (Some(1.0), f32::NAN, ""),
    ] {
        assert_eq!(sentence_body(&hdt_sentence(heading_deg, variation_deg)), format!("HCHDT,{text},T"));
    }
}

#[test]
fn quality_shows_sigma_or_the_reason() {
    let heading = heading(1.765_2, 0.009_6);
    for kind in [HeadingKind::Raw, HeadingKind::Smooth] {
        let sentence = quality_sentence(&Ok(heading), kind);
        assert!(
            sentence_text(&sentence).starts_with(&format!("$PASWH,101.1,0.6,ok,{}*", kind.kind_name())),
            "{sentence:?}"
        );
        assert!(quality_sentence(&Err(NoHeading::AttitudeStale), kind).starts_with(b"$PASWH,,,attitude-stale,*"));
    }
    let lost = Heading { sigma_rad: f32::NAN, ..heading };
    assert!(quality_sentence(&Ok(lost), HeadingKind::Raw).starts_with(b"$PASWH,101.1,180.0,ok,raw*"));
}

#[test]
fn heading_never_shows_360() {
    for (heading_deg, shown) in [(359.94, "359.9"), (359.96, "000.0"), (-0.2, "359.8"), (360.0, "000.0")] {
        assert!(sentence_text(&hdm_sentence(Some(heading_deg))).contains(shown), "{heading_deg}");
    }
    assert_eq!(hdm_sentence(Some(f32::NAN)), hdm_sentence(None));
}

/// Body of a sentence, whose length and checksum are checked independently.
fn sentence_body(sentence: &Sentence) -> &str {
    let (body, sum) =
        sentence_text(sentence).strip_prefix('$').unwrap().strip_suffix("\r\n").unwrap().split_once('*').unwrap();
    let mut expected = 0;
    for byte in body.bytes() {
        expected ^= byte;
    }
    assert_eq!(sum, format!("{expected:02X}"), "{sentence:?}");
    assert!(sentence.len() <= 82);
    body
}

/// 12.25 and other quarters are exact in binary, so that rounding to tenths meets exact ties.
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
        assert_eq!(sentence_body(&hdm_sentence(Some(heading_deg))), format!("HCHDM,{text},M"), "{heading_deg}");
        assert_eq!(sentence_body(&hdg_sentence(Some(heading_deg), None)), format!("HCHDG,{text},,,,"), "{heading_deg}");
    }
    for heading_deg in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(sentence_body(&hdm_sentence(Some(heading_deg))), "HCHDM,,M");
        assert_eq!(sentence_body(&hdg_sentence(Some(heading_deg), Some(1.0))), "HCHDG,,,,1.0,E");
    }
}

#[test]
fn variation_is_a_magnitude_with_east_or_west() {
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
        assert_eq!(sentence_body(&hdg_sentence(Some(90.0), Some(variation_deg))), format!("HCHDG,090.0,,,{text}"));
    }
}

#[test]
fn sigma_is_in_degrees_and_limited_to_180() {
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
        assert_eq!(
            sentence_body(&quality_sentence(&Ok(heading), HeadingKind::Smooth)),
            format!("PASWH,045.0,{text},ok,smooth")
        );
    }
    let none = quality_sentence(&Err(NoHeading::AttitudeStale), HeadingKind::Smooth);
    assert_eq!(sentence_body(&none), "PASWH,,,attitude-stale,");
}

#[test]
fn the_longest_sentences_are_complete() {
    for extreme in [f32::MAX, f32::MIN, f32::INFINITY, f32::NAN, 1e7] {
        sentence_body(&hdm_sentence(Some(extreme)));
        sentence_body(&hdg_sentence(Some(extreme), Some(extreme)));
        sentence_body(&hdt_sentence(Some(extreme), extreme));
        sentence_body(&quality_sentence(&Ok(heading(extreme, extreme)), HeadingKind::Smooth));
    }
    assert_eq!(sentence_body(&hdg_sentence(None, Some(f32::MAX))), format!("HCHDG,,,,{}.5,E", u32::MAX / 10));
}

/// `$`, 76 characters, `*`, two digits and the line end are 82.
#[test]
fn a_sentence_over_82_characters_has_no_checksum() {
    let sentence_of_length = |length: usize| build_sentence(|out| put_text(out, &"A".repeat(length)));
    assert_eq!((sentence_of_length(76).len(), sentence_body(&sentence_of_length(76)).len()), (82, 76));
    for length in [77, 80, 81, 82, 100] {
        assert!(!sentence_of_length(length).contains(&b'*'), "{length}");
    }
}

#[test]
fn tenths_are_padded_to_the_requested_digits() {
    for (tenths, min_digits, text) in
        [(0, 1, "0.0"), (0, 3, "000.0"), (7, 1, "0.7"), (99, 1, "9.9"), (100, 1, "10.0"), (12_345, 3, "1234.5")]
    {
        let mut out = Sentence::new();
        put_tenths(&mut out, tenths, min_digits).unwrap();
        assert_eq!(out, text.as_bytes());
    }
}

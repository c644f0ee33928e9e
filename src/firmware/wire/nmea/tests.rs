//! Unit tests of `nmea`.

use super::*;

fn sentence_text(sentence: &Sentence) -> &str {
    str::from_utf8(sentence).unwrap()
}

fn heading(magnetic_rad: f32, sigma_rad: f32) -> Heading {
    Heading { magnetic_rad, sigma_rad, systematic_variance_rad2: 0.0 }
}

/// Checksums from an independent implementation.
#[test]
fn a_sentence_ends_with_the_checksum_of_the_nmea_standard() {
    assert_eq!(sentence_text(&hdm_sentence(Some(101.14))), "$HCHDM,101.1,M*28\r\n");
    assert_eq!(sentence_text(&hdm_sentence(None)), "$HCHDM,,M*07\r\n");
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
        (360.0, "000.0"),
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
fn quality_shows_sigma_up_to_180_deg_or_the_reason() {
    for (sigma_deg, text) in [
        (0.0, "0.0"),
        (0.44, "0.4"),
        (0.46, "0.5"),
        (9.97, "10.0"),
        (179.9, "179.9"),
        (180.1, "180.0"),
        (f32::INFINITY, "180.0"),
        (f32::NAN, "180.0"),
    ] {
        for (kind, name) in [(HeadingKind::Raw, "raw"), (HeadingKind::Smooth, "smooth")] {
            let sentence = quality_sentence(&Ok(heading(45.0_f32.to_radians(), sigma_deg.to_radians())), kind);
            assert_eq!(sentence_body(&sentence), format!("PASWH,045.0,{text},ok,{name}"));
            let none = quality_sentence(&Err(NoHeading::AttitudeStale), kind);
            assert_eq!(sentence_body(&none), "PASWH,,,attitude-stale,");
        }
    }
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

//! NMEA 0183: heading, heading with variation, true heading, and the heading's quality.

use super::{Message, Outlet};
use crate::heading::{Heading, NoHeading};
use crate::instrument::Estimate;
use crate::settings::{HeadingKind, Settings};
use crate::wire::nmea;

/// `HCHDM`, `HCHDG`, `HCHDT` where the declination is known, and `PASWH`, at the rate of `stream rate`, with the heading of `stream heading`.
#[derive(Clone, Copy, Debug, Default)]
pub struct NmeaOutlet;

impl Outlet for NmeaOutlet {
    fn rate_hz(&self, settings: &Settings) -> Option<u8> {
        settings.stream_on.then_some(settings.stream_rate_hz)
    }

    fn tell(&mut self, estimate: &Estimate, settings: &Settings, message: &mut Message) {
        let (heading, kind) = told(estimate, settings.stream_heading);
        let heading_deg = heading.as_ref().ok().map(Heading::magnetic_deg);
        let mut add = |sentence: nmea::Sentence| {
            // All of them always fit.
            let _ = message.extend_from_slice(sentence.as_bytes());
        };
        add(nmea::hdm(heading_deg));
        add(nmea::hdg(heading_deg, settings.declination_deg));
        if let Some(declination_deg) = settings.declination_deg {
            add(nmea::hdt(heading_deg, declination_deg));
        }
        add(nmea::quality(&heading, kind));
    }
}

/// The heading that is told where this one is wanted, and which it is.
fn told(estimate: &Estimate, wanted: HeadingKind) -> (Result<Heading, NoHeading>, HeadingKind) {
    match (wanted, estimate.smooth) {
        (HeadingKind::Smooth, Some(smooth)) => (Ok(smooth), HeadingKind::Smooth),
        _ => (estimate.heading, HeadingKind::Raw),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(estimate: &Estimate, settings: &Settings) -> String {
        let mut message = Message::new();
        NmeaOutlet.tell(estimate, settings, &mut message);
        String::from_utf8(message.to_vec()).unwrap()
    }

    const RAW: Heading = Heading { magnetic_rad: 1.765_2, sigma_rad: 0.009_6, systematic_rad2: 0.0 };
    const SMOOTH: Heading = Heading { magnetic_rad: 1.784, sigma_rad: 0.005, systematic_rad2: 0.0 };

    /// Where the declination is not known, there are three.
    #[test]
    fn four_sentences_tell_a_heading() {
        let estimate = Estimate { heading: Ok(RAW), ..Estimate::NOTHING };
        let settings = Settings { declination_deg: Some(-3.5), ..Settings::DEFAULT };
        let lines: Vec<String> = text(&estimate, &settings).split_inclusive("\r\n").map(str::to_owned).collect();
        assert!(lines[0].starts_with("$HCHDM,101.1,M*"), "{lines:?}");
        assert!(lines[1].starts_with("$HCHDG,101.1,,,3.5,W*"), "{lines:?}");
        assert!(lines[2].starts_with("$HCHDT,097.6,T*"), "{lines:?}");
        assert!(lines[3].starts_with("$PASWH,101.1,0.6,ok,raw*"), "{lines:?}");
        assert_eq!(lines.len(), 4);
        let text = text(&estimate, &Settings::DEFAULT);
        assert!(!text.contains("HCHDT") && text.lines().count() == 3, "{text}");
    }

    #[test]
    fn without_a_heading_the_fields_are_empty_and_the_reason_is_told() {
        let estimate = Estimate { heading: Err(NoHeading::SensorSaturated), ..Estimate::NOTHING };
        let text = text(&estimate, &Settings::DEFAULT);
        assert!(text.starts_with("$HCHDM,,M*07\r\n$HCHDG,,,,,*"), "{text}");
        assert!(text.contains("$PASWH,,,sensor-saturated,*"), "{text}");
        let told = Settings { declination_deg: Some(1.0), ..Settings::DEFAULT };
        assert!(self::text(&estimate, &told).contains("$HCHDT,,T*"));
    }

    /// The longest heading, variation, sigma, code and kind.
    #[test]
    fn the_longest_message_fits() {
        let settings = Settings { declination_deg: Some(-180.0), ..Settings::DEFAULT };
        let unsure = Heading { sigma_rad: f32::INFINITY, ..SMOOTH };
        for estimate in [
            Estimate { smooth: Some(unsure), ..Estimate::NOTHING },
            Estimate { heading: Err(NoHeading::SensorSaturated), ..Estimate::NOTHING },
        ] {
            assert_eq!(text(&estimate, &settings).matches("\r\n").count(), 4, "{estimate:?}");
        }
    }

    /// All sentences tell the same one.
    #[test]
    fn the_smooth_heading_is_told_where_there_is_one_and_it_is_wanted() {
        let both = Estimate { heading: Ok(RAW), smooth: Some(SMOOTH), ..Estimate::NOTHING };
        let only_raw = Estimate { smooth: None, ..both };
        for (estimate, stream_heading, degrees, end) in [
            (both, HeadingKind::Smooth, "102.2", "0.3,ok,smooth*"),
            (both, HeadingKind::Raw, "101.1", "0.6,ok,raw*"),
            (only_raw, HeadingKind::Smooth, "101.1", "0.6,ok,raw*"),
            (only_raw, HeadingKind::Raw, "101.1", "0.6,ok,raw*"),
        ] {
            let text = text(&estimate, &Settings { stream_heading, ..Settings::DEFAULT });
            for sentence in ["$HCHDM", "$HCHDG", "$PASWH"] {
                assert!(text.contains(&format!("{sentence},{degrees},")), "{text}");
            }
            assert!(text.contains(end), "{text}");
        }
    }

    #[test]
    fn the_rate_is_the_one_that_was_set_and_off_is_off() {
        let settings = Settings { stream_rate_hz: 25, ..Settings::DEFAULT };
        assert_eq!(NmeaOutlet.rate_hz(&settings), Some(25));
        assert_eq!(NmeaOutlet.rate_hz(&Settings { stream_on: false, ..settings }), None);
    }
}

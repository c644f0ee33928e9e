//! NMEA 0183: heading, heading with variation, true heading, and the heading's quality.

use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::nmea;
use autoswing::heading::Heading;

/// NMEA protocol of a port: `HCHDM`, `HCHDG`, `HCHDT` if the declination is known, and `PASWH`, with the rate of
/// `stream rate` and the heading of `stream heading`. Received bytes are ignored.
#[derive(Debug, Default)]
pub struct Nmea {
    schedule: MessageSchedule,
}

impl Nmea {
    /// Creates the protocol with the first sentences due at once.
    #[must_use]
    pub const fn new() -> Self {
        Self { schedule: MessageSchedule::new() }
    }

    /// Appends the due sentences.
    pub fn poll(&mut self, snapshot: &Snapshot<'_>, out: &mut TransmitBuffer) {
        let Snapshot { estimate, settings, .. } = snapshot;
        if !(settings.stream_on && self.schedule.is_due(estimate.timestamp, settings.stream_rate_hz)) {
            return;
        }
        let (heading, kind) = snapshot.selected_heading();
        let heading_deg = heading.as_ref().ok().map(Heading::magnetic_deg);
        let [hdm, hdg, quality] = [
            nmea::hdm_sentence(heading_deg),
            nmea::hdg_sentence(heading_deg, settings.declination_deg),
            nmea::quality_sentence(&heading, kind),
        ];
        let hdt = settings.declination_deg.map(|declination_deg| nmea::hdt_sentence(heading_deg, declination_deg));
        let hdt = hdt.as_deref().unwrap_or_default();
        out.append_message(&[&hdm, &hdg, hdt, &quality]);
        if heading.is_err() {
            out.headingless_message_count = out.headingless_message_count.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::snapshot::tests::test_snapshot;

    use autoswing::instrument::Estimate;
    use autoswing_module::settings::{HeadingKind, Settings};

    fn sentences_text(estimate: &Estimate, settings: &Settings) -> String {
        let mut out = TransmitBuffer::new();
        Nmea::new().poll(&test_snapshot(estimate, settings), &mut out);
        assert_eq!(out.message_count, u32::from(!out.pending_bytes().is_empty()));
        assert_eq!(
            out.headingless_message_count,
            u32::from(test_snapshot(estimate, settings).selected_heading().0.is_err())
        );
        String::from_utf8(out.pending_bytes().to_vec()).unwrap()
    }

    const RAW_HEADING: Heading = Heading { magnetic_rad: 1.765_2, sigma_rad: 0.009_6, systematic_variance_rad2: 0.0 };
    const SMOOTH_HEADING: Heading = Heading { magnetic_rad: 1.784, sigma_rad: 0.005, systematic_variance_rad2: 0.0 };

    fn with_declination(declination_deg: f32) -> Settings {
        Settings { declination_deg: Some(declination_deg), ..Settings::DEFAULT }
    }

    /// Longest heading, variation, sigma and kind.
    #[test]
    fn the_longest_message_fits() {
        let unsure = Heading { sigma_rad: f32::INFINITY, ..SMOOTH_HEADING };
        let estimate = Estimate { smoothed_heading: Some(unsure), ..Estimate::EMPTY };
        assert_eq!(sentences_text(&estimate, &with_declination(-180.0)).matches("\r\n").count(), 4);
    }

    /// All sentences contain the same heading.
    #[test]
    fn the_smoothed_heading_is_sent_if_available_and_selected() {
        let both = Estimate { heading: Ok(RAW_HEADING), smoothed_heading: Some(SMOOTH_HEADING), ..Estimate::EMPTY };
        let only_raw = Estimate { smoothed_heading: None, ..both };
        for (estimate, stream_heading, degrees, end) in [
            (both, HeadingKind::Smooth, "102.2", "0.3,ok,smooth*"),
            (both, HeadingKind::Raw, "101.1", "0.6,ok,raw*"),
            (only_raw, HeadingKind::Smooth, "101.1", "0.6,ok,raw*"),
            (only_raw, HeadingKind::Raw, "101.1", "0.6,ok,raw*"),
        ] {
            let text = sentences_text(&estimate, &Settings { stream_heading, ..Settings::DEFAULT });
            for sentence in ["$HCHDM", "$HCHDG", "$PASWH"] {
                assert!(text.contains(&format!("{sentence},{degrees},")), "{text}");
            }
            assert!(text.contains(end), "{text}");
        }
    }
}

//! Report of safe mode, as NMEA sentences and MAVLink messages.

use mavlink_dialect::{MavSeverity, MavState};

use super::mavlink::Transmitter;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::mavlink::{Address, OutboundMessage, Signatures};
use crate::wire::nmea;
use autoswing::heading::NoHeading;
use autoswing_module::settings::{HeadingKind, Settings};

/// Text for ground stations, of at most 50 characters.
const SAFE_MODE_TEXT: &[u8] = b"autoswing: safe-mode: see its console";
const _: () = assert!(SAFE_MODE_TEXT.len() <= OutboundMessage::STATUSTEXT_CAPACITY);

/// Most common address of an autopilot.
const ASSUMED_AUTOPILOT: Address = Address { system_id: 1, component_id: 1 };

/// Reports between two texts.
const REPORTS_PER_TEXT: u8 = 20;

/// Sender of the report. Settings are not loaded and received bytes not processed, either of which can be the cause of
/// the panics: both protocols are sent on every port, MAVLink as a component of system 1.
#[derive(Debug, Default)]
pub struct SafeModeReporter {
    sequence_number: u8,
    reports_since_text: u8,
}

impl SafeModeReporter {
    /// Appends sentences without a heading, a heartbeat, and at every twentieth call a text.
    pub fn report_safe_mode(&mut self, out: &mut TransmitBuffer) {
        // The line end separates the sentences from the binary messages before them.
        out.append_message(&[
            b"\r\n",
            &nmea::hdm_sentence(None),
            &nmea::quality_sentence(&Err(NoHeading::SafeMode), HeadingKind::Raw),
        ]);
        // Frames without a signature, because the key is one of the settings, which safe mode does not read.
        let mut signatures = Signatures::default();
        let sender = (ASSUMED_AUTOPILOT.sender_id(), Settings::DEFAULT.component);
        let mut line = Transmitter::new(out, sender, &mut self.sequence_number, &mut signatures);
        line.send_message(OutboundMessage::heartbeat(MavState::MAV_STATE_CRITICAL));
        if self.reports_since_text == 0 {
            line.send_message(OutboundMessage::status_text(MavSeverity::MAV_SEVERITY_CRITICAL, SAFE_MODE_TEXT, 0, 0));
        }
        self.reports_since_text = (self.reports_since_text + 1) % REPORTS_PER_TEXT;
    }
}

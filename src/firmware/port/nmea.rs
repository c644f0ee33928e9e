//! NMEA 0183: heading, heading with variation, true heading, and the heading's quality; the own attitude.

use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::nmea::{self, SpeedReceiver};
use autoswing::attitude::HAS_OWN_ATTITUDE;
use autoswing::heading::Heading;

/// NMEA protocol of a port: `HCHDM`, `HCHDG`, `HCHDT` if the declination is known, and `PASWH`, with the rate of
/// `set stream-rate` and the heading of `set heading`; with an attitude of the own sensors also `HCROT`, `HCXDR` and `PASHR`,
/// at most 10 a second. The speed of a satellite receiver is received.
#[derive(Debug, Default)]
pub struct Nmea {
    schedule: MessageSchedule,
    attitude_schedule: MessageSchedule,
    /// Receiver of the speed.
    pub speed_receiver: SpeedReceiver,
}

/// Rate of the attitude's sentences, Hz; a line of 115200 baud has room for no more beside the highest rate of headings.
const ATTITUDE_HZ: u8 = 10;

impl Nmea {
    /// Creates the protocol with the first sentences due at once.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            schedule: MessageSchedule::new(),
            attitude_schedule: MessageSchedule::new(),
            speed_receiver: SpeedReceiver::new(),
        }
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
        if HAS_OWN_ATTITUDE && self.attitude_schedule.is_due(estimate.timestamp, ATTITUDE_HZ) {
            append_own_attitude(snapshot, heading.ok(), out);
        }
    }
}

/// Appends rate of turn and attitude of the own sensors, if they are in use.
fn append_own_attitude(snapshot: &Snapshot<'_>, heading: Option<Heading>, out: &mut TransmitBuffer) {
    let estimate = snapshot.estimate;
    let Some((attitude, sigmas_rad)) = estimate.attitude.zip(estimate.tilt_sigmas_rad) else { return };
    let true_heading_deg = heading
        .zip(snapshot.settings.declination_deg)
        .map(|(heading, declination_deg)| heading.magnetic_deg() + declination_deg);
    let rot = estimate.euler_rates.map(|rates| nmea::rot_sentence(rates.heading_rad_s));
    let pashr =
        nmea::pashr_sentence(true_heading_deg, attitude, sigmas_rad, heading.map(|heading| heading.sigma_deg()));
    out.append_message(&[rot.as_deref().unwrap_or_default(), &nmea::xdr_sentence(attitude), &pashr]);
}

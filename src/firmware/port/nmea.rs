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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::snapshot::tests::test_snapshot;
    use autoswing::attitude::EulerRates;
    use autoswing::frames::RollPitch;
    use autoswing::instrument::Estimate;
    use autoswing::time::Timestamp;
    use autoswing_module::settings::Settings;

    /// Roll 3 deg to starboard, nose 4.5 deg down, a turn of 2 deg/s to port.
    #[test]
    fn the_own_attitude_is_sent_ten_times_a_second() {
        let estimate = Estimate {
            heading: Ok(Heading { magnetic_rad: 1.765_2, sigma_rad: 0.009_6, systematic_variance_rad2: 0.0 }),
            attitude: Some(RollPitch::from_deg(3.0, -4.5)),
            tilt_sigmas_rad: Some([0.009, 0.007]),
            euler_rates: Some(EulerRates { heading_rad_s: -2_f32.to_radians(), ..EulerRates::default() }),
            ..Estimate::EMPTY
        };
        let (mut nmea, mut out) = (Nmea::default(), TransmitBuffer::default());
        let settings = Settings { stream_rate_hz: 20, declination_deg: Some(-3.5), ..Settings::DEFAULT };
        let mut texts = (0..2).map(|i| {
            let estimate = Estimate { timestamp: Timestamp::from_us(1_000_000 + 50_000 * i), ..estimate };
            nmea.poll(&test_snapshot(&estimate, &settings), &mut out);
            let text = String::from_utf8(out.pending_bytes().to_vec()).unwrap();
            out.consume_bytes(usize::MAX);
            text
        });
        let text = texts.next().unwrap();
        for body in
            ["$HCROT,-120.0,A*", "$HCXDR,A,-4.5,D,PTCH,A,3.0,D,ROLL*", "$PASHR,,097.6,T,3.0,-4.5,,0.5,0.4,0.6,0,1*"]
        {
            assert!(text.contains(body), "{text}");
        }
        assert_eq!(texts.next().unwrap().lines().count(), 4);
    }
}

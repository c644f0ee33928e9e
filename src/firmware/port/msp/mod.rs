//! MSP: the module sends the corrected field as the autopilot's compass, and requests the autopilot's attitude.
//!
//! The field is sent from power-up, so that the autopilot detects its compass, and is withheld while it is invalid: the
//! autopilot then operates without a compass.
//!
//! One attitude request is open at a time, so that a reply is as recent as possible: autopilots reply in 3.5 to 18 ms.
//! INAV's gyro is requested with it. Until the firmware is known, which determines the signs of the attitude, the
//! firmware is requested instead. Other requests are sent in turn, each about once a second and every second one for
//! the current, without waiting for replies. The firmware remains among them, because an autopilot can be exchanged
//! while the module runs. INAV's settings are checked and changed on request.

use crate::port::autopilot::{AutopilotKind, AutopilotSession, AutopilotState, ParameterRequest};
use crate::port::message_schedule::MessageSchedule;
use crate::port::received_message::ReceivedMessage;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::msp::{
    AutopilotFirmware, MspAngles, MspFunction, MspReceiver, MspReply, SettingInfo, compass_message, encode_request,
    encode_setting_request, inav_body_rates_rad_s,
};
use autoswing::attitude::{AttitudeReport, BodyRates, RateEstimator, SenderId};
use autoswing::time::{Timestamp, WrappingMillis};

/// Rate of compass readings, Hz: INAV drops a compass after 250 ms, ArduPilot after 500 ms; ArduPilot's filter uses 10
/// Hz.
const COMPASS_HZ: u8 = 50;

/// Maximum rate of attitude requests, Hz.
const MAX_ATTITUDE_REQUEST_HZ: u8 = 50;

/// Rate of other requests, Hz: each about once a second, the current four times.
const PERIODIC_REQUESTS_HZ: u8 = PERIODIC_REQUESTS.len() as u8;

/// Requests besides those for attitude, sent in this order.
const PERIODIC_REQUESTS: [MspFunction; 8] = [
    MspFunction::Status,
    MspFunction::Analog,
    MspFunction::RawGps,
    MspFunction::Analog,
    MspFunction::Rtc,
    MspFunction::Analog,
    MspFunction::FcVariant,
    MspFunction::Analog,
];

/// Timeout of a reply, microseconds: nearly three times the longest observed.
const REPLY_TIMEOUT_US: u64 = 50_000;

/// Silence after which the reported armed state expires, microseconds: ten replies.
const ARMED_EXPIRY_US: u64 = 10_000_000;

/// Number of the only compass on this line.
const COMPASS_NUMBER: u8 = 0;

/// MSP protocol of a port.
#[derive(Debug, Default)]
pub struct Msp {
    receiver: MspReceiver,
    autopilot_firmware: Option<AutopilotFirmware>,
    armed_report: Option<(Timestamp, bool)>,
    /// Time and body rates of the last MSP_RAW_IMU, rad/s.
    gyro_report: Option<(Timestamp, [f32; 3])>,
    rate_estimator: RateEstimator,
    /// Time of the open request for attitude or firmware.
    open_request_sent_at: Option<Timestamp>,
    compass_schedule: MessageSchedule,
    attitude_schedule: MessageSchedule,
    periodic_schedule: MessageSchedule,
    /// Index of the next periodic request other than attitude.
    next_periodic_index: usize,
    /// Setting of INAV that was read last.
    last_setting: Option<SettingInfo>,
}

impl Msp {
    /// Kind of autopilot, if actions on it are possible.
    pub(super) fn autopilot_kind(&self) -> Option<AutopilotKind> {
        (self.autopilot_firmware == Some(AutopilotFirmware::Inav)).then_some(AutopilotKind::Inav)
    }

    fn process_message(
        &mut self,
        at: Timestamp,
        message: MspReply,
        session: &mut AutopilotSession,
    ) -> Option<ReceivedMessage> {
        if matches!(message, MspReply::Attitude(_) | MspReply::Refused(MspFunction::Attitude)) {
            self.open_request_sent_at = None;
        }
        match message {
            MspReply::Attitude(angles) => return self.attitude_report(at, angles),
            MspReply::Gyro(counts) if self.autopilot_firmware == Some(AutopilotFirmware::Inav) => {
                self.gyro_report = Some((at, inav_body_rates_rad_s(counts)));
            }
            MspReply::RawGps(place) => return place.map(ReceivedMessage::Position),
            MspReply::Current(amperes) => return Some(ReceivedMessage::Current(amperes)),
            MspReply::Rtc(day) => return day.map(ReceivedMessage::Date),
            MspReply::FcVariant(firmware) => self.autopilot_firmware = Some(firmware),
            MspReply::Armed(is_armed) => self.armed_report = Some((at, is_armed)),
            MspReply::Setting(setting) => {
                self.last_setting = Some(setting);
                session.client.on_number(setting.name, Some(setting.number));
            }
            MspReply::Done | MspReply::Refused(MspFunction::SettingInfo | MspFunction::SetSetting) => {
                session.client.on_answer();
            }
            MspReply::Gyro(_) | MspReply::Refused(_) => {}
        }
        None
    }

    fn attitude_report(&mut self, at: Timestamp, angles: MspAngles) -> Option<ReceivedMessage> {
        // MSP has one sender, without a clock.
        let (source, sender_clock_at_sending) = (SenderId::default(), WrappingMillis::new(0));
        let attitude = self.autopilot_firmware?.attitude_from_angles(angles)?;
        let estimated = self.rate_estimator.update_rates(at, attitude, f32::from(angles.heading_deg).to_radians());
        let measured = self.gyro_report.filter(|(received_at, _)| at.us_since(*received_at) <= REPLY_TIMEOUT_US);
        let rates_rad_s = measured.map_or(estimated, |(_, rates_rad_s)| rates_rad_s);
        Some(ReceivedMessage::Attitude(AttitudeReport {
            sender: source,
            sender_clock_at_sending,
            attitude,
            body_rates: BodyRates::from_rad_s(rates_rad_s).map(BodyRates::as_rough),
        }))
    }

    fn next_periodic_request(&mut self) -> MspFunction {
        let [first, ..] = PERIODIC_REQUESTS;
        let function = PERIODIC_REQUESTS.get(self.next_periodic_index).copied().unwrap_or(first);
        self.next_periodic_index = (self.next_periodic_index + 1) % PERIODIC_REQUESTS.len();
        function
    }

    /// Sends the due request of an action on INAV.
    fn send_autopilot_request(
        &self,
        snapshot: &Snapshot<'_>,
        session: &mut AutopilotSession,
        out: &mut TransmitBuffer,
    ) {
        if !session.has_action() {
            return;
        }
        let (kind, now) = (AutopilotKind::Inav, snapshot.now);
        let is_disarmed = self.is_armed(now) == Some(false);
        let msp_choice = self.last_setting.and_then(|setting| setting.msp_choice);
        session.advance(snapshot, AutopilotState { kind, is_disarmed, trims_deg: [0.0; 2], msp_choice });
        let Some(request) = session.due_request(now, is_disarmed) else { return };
        let is_sent = match request {
            ParameterRequest::Read(name) => out.append_message(&[&encode_setting_request(name, &[])]),
            ParameterRequest::Write(name, number) => {
                let bytes = (number as i32).to_le_bytes();
                let length = self.last_setting.map_or(bytes.len(), |setting| usize::from(setting.length));
                out.append_message(&[&encode_setting_request(name, bytes.get(..length).unwrap_or(&bytes))])
            }
            ParameterRequest::Save => out.append_message(&[&encode_request(MspFunction::EepromWrite)]),
            ParameterRequest::Restart => out.append_message(&[&encode_request(MspFunction::Reboot)]),
        };
        if is_sent {
            session.on_request_sent(now, request);
        }
    }

    /// Request to send whenever the last was answered; none if the firmware's signs are unknown.
    fn attitude_or_firmware_request(&self) -> Option<MspFunction> {
        match self.autopilot_firmware {
            None => Some(MspFunction::FcVariant),
            Some(AutopilotFirmware::Other) => None,
            Some(_) => Some(MspFunction::Attitude),
        }
    }

    /// Whether this request may be sent: none is open, or the open one has timed out.
    fn may_request(&mut self, now: Timestamp) -> bool {
        if self.open_request_sent_at.is_some_and(|at| now.us_since(at) < REPLY_TIMEOUT_US) {
            return false;
        }
        if self.open_request_sent_at.take().is_some() {
            // The rest of a partly received reply is lost.
            self.receiver.discard_partial();
        }
        true
    }

    /// Processes a received byte; returns the message that it completes.
    pub(super) fn process_byte(
        &mut self,
        at: Timestamp,
        byte: u8,
        session: &mut AutopilotSession,
    ) -> Option<ReceivedMessage> {
        let message = self.receiver.push_byte(byte)?;
        Some(self.process_message(at, message, session).unwrap_or(ReceivedMessage::Other))
    }

    /// Whether the autopilot is armed, if it has reported that recently.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.armed_report.filter(|(at, _)| now.us_since(*at) <= ARMED_EXPIRY_US).map(|(_, is_armed)| is_armed)
    }

    /// Number of broken or impossible frames since the start; wraps.
    #[must_use]
    pub fn rejected_frame_count(&self) -> u32 {
        self.receiver.rejected_count()
    }

    /// Appends due messages; called for every estimate, at least ten times a second.
    pub(super) fn poll(&mut self, snapshot: &Snapshot<'_>, session: &mut AutopilotSession, out: &mut TransmitBuffer) {
        let now = snapshot.now;
        if let Some(field) = snapshot.estimate.compass_field
            && self.compass_schedule.is_due(now, COMPASS_HZ)
        {
            out.append_message(&[&compass_message(
                COMPASS_NUMBER,
                snapshot.estimate.timestamp.wrapping_millis().as_ms(),
                field,
            )]);
        }
        let is_other_due = self.periodic_schedule.is_due(now, PERIODIC_REQUESTS_HZ);
        if is_other_due {
            out.append_message(&[&encode_request(self.next_periodic_request())]);
        }
        if let Some(function) = self.attitude_or_firmware_request()
            && self.may_request(now)
            && self.attitude_schedule.is_due(now, MAX_ATTITUDE_REQUEST_HZ)
        {
            // The reply to the first request arrives first. At most two requests at a time: rates remain valid for 50
            // ms.
            let gyro = encode_request(MspFunction::RawImu);
            let has_gyro = function == MspFunction::Attitude
                && self.autopilot_firmware == Some(AutopilotFirmware::Inav)
                && !is_other_due;
            let requests = [if has_gyro { &gyro[..] } else { &[] }, &encode_request(function)];
            self.open_request_sent_at = out.append_message(&requests).then_some(now);
        }
        self.send_autopilot_request(snapshot, session, out);
    }
}

#[cfg(test)]
mod tests;

//! MAVLink frames, each after eight bytes of the receiver's clock (microseconds since 1970, big-endian), as ground stations
//! write them; or without, as they come on a line.
//!
//! Messages are put on the line of time by the sender's clock since its start; those that carry none by the receiver's
//! clock since the last that did. Only the first autopilot that is heard counts.

use std::io::{self, Read};

use mavlink::dialects::common::{MavMessage, MavParamType, PARAM_VALUE_DATA};
use mavlink::{MavlinkVersion, Message, calculate_crc};

use super::flight::{Autopilot, Flight, Format, Gps};
use super::recorder::{Logged, Recorder};
use super::window::Window;

const CLOCK: usize = 8;
/// Marker, length and the rest of a header of version 1 and 2, the checksum, a signature.
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
const CHECKSUM: usize = 2;
const SIGNATURE: usize = 13;
const MAX_FRAME: usize = HEADER_2 + 255 + CHECKSUM + SIGNATURE;

/// ArduPilot's own SIMSTATE, which the common dialect has not, and the extra byte of its checksum.
const SIMSTATE: (u32, u8) = (164, 154);

const MILLIGAUSS_UT: f32 = 0.1;
const GAUSS_UT: f32 = 100.0;

/// In so many bytes the first whole frame is sought.
const WITHIN: usize = 4096;

/// Whether a log begins so: a whole frame within the first bytes.
pub fn begins_in(head: &[u8]) -> bool {
    clock_in(head).is_some()
}

/// How long the clock before every frame is; none where there is no frame. Behind a frame the next one follows: what looks
/// like a clock may be the end of the frame before.
fn clock_in(head: &[u8]) -> Option<usize> {
    let right = |at: usize, clock: usize| Frame::first(head.get(at..)?, clock).filter(|frame| frame.is_right);
    let is_chain = |at: usize, clock: usize| right(at, clock).is_some_and(|one| right(at + one.taken, clock).is_some());
    let begins = || (0..head.len().min(WITHIN)).flat_map(|at| [CLOCK, 0].map(|clock| (at, clock)));
    let chain = begins().find(|&(at, clock)| is_chain(at, clock)).map(|(_, clock)| clock);
    // Of one frame alone it is taken for certain only with its clock.
    chain.or_else(|| begins().any(|(at, _)| right(at, CLOCK).is_some()).then_some(CLOCK))
}

/// Reads the flight of a system, or of the first one that is heard.
///
/// # Errors
///
/// What the source says.
pub fn read(source: &mut dyn Read, system: Option<u8>) -> io::Result<Flight> {
    let mut window = Window::new(source);
    let mut log = Log::new(system);
    let clock = clock_in(window.peek(WITHIN + 2 * (CLOCK + MAX_FRAME))?).unwrap_or(CLOCK);
    loop {
        let bytes = window.peek(CLOCK + MAX_FRAME)?;
        if bytes.is_empty() {
            break;
        }
        let frame = Frame::first(bytes, clock);
        let taken = if let Some(frame) = frame {
            if frame.is_right {
                log.take(&frame);
            }
            frame.taken
        } else {
            log.recorder.flight.counts.garbage += 1;
            1
        };
        window.take(taken);
    }
    Ok(log.finish())
}

struct Frame<'a> {
    /// The receiver's clock; nothing where there is none.
    received_us: u64,
    version: MavlinkVersion,
    sender: [u8; 2],
    id: u32,
    /// Whether its checksum is.
    is_right: bool,
    payload: &'a [u8],
    taken: usize,
}

impl<'a> Frame<'a> {
    /// The frame that stands at the beginning, after its clock of so many bytes.
    fn first(bytes: &'a [u8], clock: usize) -> Option<Self> {
        let (received, frame) = bytes.split_at_checked(clock)?;
        let (version, header, sender, id, has_signature) = match *frame {
            [0xFE, _, _, system, component, id, ..] => {
                (MavlinkVersion::V1, HEADER_1, [system, component], u32::from(id), false)
            }
            [0xFD, _, flags, _, _, system, component, a, b, c, ..] => {
                (MavlinkVersion::V2, HEADER_2, [system, component], u32::from_le_bytes([a, b, c, 0]), flags & 1 != 0)
            }
            _ => return None,
        };
        let end = header + usize::from(*frame.get(1)?);
        let [low, high] = *frame.get(end..end + CHECKSUM)? else { return None };
        let extra_crc = if id == SIMSTATE.0 { SIMSTATE.1 } else { MavMessage::extra_crc(id) };
        let is_right = calculate_crc(frame.get(1..end)?, extra_crc) == u16::from_le_bytes([low, high]);
        let taken = clock + end + CHECKSUM + if has_signature { SIGNATURE } else { 0 };
        // A message that is not known, or was another one when it was sent, has a wrong checksum: if the next frame follows
        // it, it is one nevertheless, of which nothing is believed.
        let is_followed = || bytes.get(taken + clock).is_none_or(|marker| matches!(marker, 0xFE | 0xFD));
        let received_us = received.first_chunk().map_or(0, |clock| u64::from_be_bytes(*clock));
        let payload = &frame[header..end];
        (is_right || is_followed()).then_some(Self { received_us, version, sender, id, is_right, payload, taken })
    }
}

const HEARTBEAT: u32 = 0;

/// Which autopilot (`MAV_AUTOPILOT`) a heartbeat is of; none of another message, or of what has none.
fn autopilot_of(frame: &Frame<'_>) -> Option<u8> {
    const INVALID: u8 = 8;
    // MAV_TYPE: ground station, companion computer, gimbal, traffic, camera. Some call themselves a generic autopilot.
    const NO_VEHICLES: [u8; 5] = [6, 18, 26, 27, 30];
    let byte = |at: usize| frame.payload.get(at).copied().unwrap_or(0);
    let is_one = frame.id == HEARTBEAT && frame.is_right && byte(5) != INVALID && !NO_VEHICLES.contains(&byte(4));
    is_one.then(|| byte(5))
}

struct Log {
    recorder: Recorder,
    /// The system that is asked for.
    wanted: Option<u8>,
    /// System and component of the autopilot.
    autopilot: Option<[u8; 2]>,
    /// Other systems that have an autopilot.
    others: Vec<u8>,
    /// Other components of its system that have one.
    beside: Vec<u8>,
    /// The sender's clock when it was last heard, and the receiver's then.
    clock_us: Option<(u64, u64)>,
}

impl Log {
    fn new(wanted: Option<u8>) -> Self {
        let recorder = Recorder::new(Format::TLog);
        Self { recorder, wanted, autopilot: None, others: Vec::new(), beside: Vec::new(), clock_us: None }
    }

    fn take(&mut self, frame: &Frame<'_>) {
        let [system, _] = frame.sender;
        if self.autopilot.is_some_and(|own| own != frame.sender) || self.wanted.is_some_and(|wanted| wanted != system) {
            self.recorder.flight.counts.others += 1;
            self.other(frame, autopilot_of(frame));
            return;
        }
        if frame.id == HEARTBEAT {
            self.heartbeat(frame);
        } else if self.autopilot.is_none() {
            // Who that is will be known within a second.
        } else if frame.id == SIMSTATE.0 {
            let float = |at: usize| {
                let bytes = [0, 1, 2, 3].map(|byte| frame.payload.get(at + byte).copied().unwrap_or(0));
                f32::from_le_bytes(bytes)
            };
            if let Some(t_s) = self.untimed(frame) {
                self.recorder.truth(t_s, [float(0), float(4), float(8)]);
            }
        } else if let Ok(message) = MavMessage::parse(frame.version, frame.id, frame.payload) {
            self.message(frame, &message);
        }
    }

    /// Whoever else has an autopilot is another vehicle, or of the same system a second autopilot.
    fn other(&mut self, frame: &Frame<'_>, autopilot: Option<u8>) {
        let [system, component] = frame.sender;
        let is_own = self.autopilot.is_some_and(|[own, _]| own == system);
        if autopilot.is_none() {
            return;
        }
        if is_own && !self.beside.contains(&component) {
            self.beside.push(component);
        } else if !is_own && !self.others.contains(&system) {
            self.others.push(system);
        }
    }

    /// Its numbers are taken as they stand: a kind of vehicle that the library does not know is one, too.
    fn heartbeat(&mut self, frame: &Frame<'_>) {
        // MAV_AUTOPILOT.
        const ARDUPILOT: u8 = 3;
        const PX4: u8 = 12;
        const ARMED: u8 = 0x80;
        // MAV_TYPE: four, coaxial, helicopter, six, eight, three, twelve, ten.
        const ROTORS: [u8; 8] = [2, 3, 4, 13, 14, 15, 29, 35];
        let byte = |at: usize| frame.payload.get(at).copied().unwrap_or(0);
        let mode = byte(6);
        let Some(autopilot) = autopilot_of(frame) else { return };
        if self.autopilot.is_none() {
            self.autopilot = Some(frame.sender);
            self.recorder.flight.is_copter = ROTORS.contains(&byte(4));
            self.recorder.flight.autopilot = match autopilot {
                ARDUPILOT => Autopilot::ArduPilot,
                PX4 => Autopilot::Px4,
                _ => Autopilot::Unknown,
            };
        }
        if let Some(t_s) = self.untimed(frame) {
            self.recorder.armed(t_s, mode & ARMED != 0);
        }
    }

    fn finish(mut self) -> Flight {
        let own = |part: usize| self.autopilot.map(|sender| sender[part]).into_iter();
        self.recorder.flight.systems = own(0).chain(self.others.iter().copied()).collect();
        self.recorder.flight.components = own(1).chain(self.beside.iter().copied()).collect();
        self.recorder.finish()
    }

    fn message(&mut self, frame: &Frame<'_>, message: &MavMessage) {
        match message {
            MavMessage::ATTITUDE(m) => {
                if let Some(t_s) = self.timed(frame, u64::from(m.time_boot_ms) * 1000) {
                    self.recorder.attitude(t_s, [m.roll, m.pitch, m.yaw]);
                    self.recorder.rates(t_s, [m.rollspeed, m.pitchspeed, m.yawspeed]);
                }
            }
            MavMessage::RAW_IMU(m) if self.recorder.flight.autopilot != Autopilot::Px4 => {
                self.field(frame, 1, m.time_usec, [m.xmag, m.ymag, m.zmag]);
            }
            MavMessage::SCALED_IMU(m) if self.recorder.flight.autopilot == Autopilot::Px4 => {
                self.field(frame, 1, u64::from(m.time_boot_ms) * 1000, [m.xmag, m.ymag, m.zmag]);
            }
            MavMessage::SCALED_IMU2(m) => {
                self.field(frame, 2, u64::from(m.time_boot_ms) * 1000, [m.xmag, m.ymag, m.zmag]);
            }
            MavMessage::SCALED_IMU3(m) => {
                self.field(frame, 3, u64::from(m.time_boot_ms) * 1000, [m.xmag, m.ymag, m.zmag]);
            }
            MavMessage::HIGHRES_IMU(m) => {
                if is_new(m.fields_updated.bits())
                    && let Some(t_s) = self.timed(frame, m.time_usec)
                {
                    let field_ut = [m.xmag, m.ymag, m.zmag].map(|gauss| gauss * GAUSS_UT);
                    self.recorder.field(1, self.logged(1), t_s, field_ut, None);
                }
            }
            MavMessage::GPS_RAW_INT(m) => {
                if m.fix_type as u32 >= 3
                    && let Some(t_s) = self.untimed(frame)
                {
                    self.recorder.gps(t_s, gps(m));
                }
            }
            MavMessage::SYS_STATUS(m) => {
                if m.current_battery >= 0
                    && let Some(t_s) = self.untimed(frame)
                {
                    self.recorder.current(t_s, f32::from(m.current_battery) * 0.01);
                }
            }
            MavMessage::SYSTEM_TIME(m) => {
                self.timed(frame, u64::from(m.time_boot_ms) * 1000);
                self.recorder.unix_s(m.time_unix_usec / 1_000_000);
            }
            MavMessage::PARAM_VALUE(m) => {
                if let Ok(name) = m.param_id.to_str() {
                    self.recorder.parameter(name, value_of(self.recorder.flight.autopilot, m));
                }
            }
            MavMessage::STATUSTEXT(m) => {
                if let Ok(words) = m.text.to_str()
                    && ["Ardu", "APM", "PX4"].iter().any(|begin| words.starts_with(begin))
                {
                    self.recorder.firmware(words);
                }
            }
            _ => {}
        }
    }

    const fn logged(&self, number: u8) -> Logged {
        match self.recorder.flight.autopilot {
            Autopilot::ArduPilot => Logged::ArduPilot,
            Autopilot::Px4 => Logged::Px4(number - 1),
            Autopilot::Unknown => Logged::Raw,
        }
    }

    /// Milligauss.
    fn field(&mut self, frame: &Frame<'_>, number: u8, us: u64, field: [i16; 3]) {
        // A compass that is not there is sent as nothing.
        if field == [0; 3] {
            return;
        }
        if let Some(t_s) = self.timed(frame, us) {
            let field_ut = field.map(|axis| f32::from(axis) * MILLIGAUSS_UT);
            self.recorder.field(number, self.logged(number), t_s, field_ut, None);
        }
    }

    /// The instant of a message that says its sender's clock, which may count from 1970 in some messages of some senders.
    fn timed(&mut self, frame: &Frame<'_>, us: u64) -> Option<f64> {
        /// Ten years: no autopilot runs for so long, and 1980 was then.
        const MAX_BOOT_US: u64 = 315_000_000_000_000;
        if us == 0 || us > MAX_BOOT_US {
            return self.untimed(frame);
        }
        let t_s = self.recorder.timeline.at(us)?;
        self.clock_us = Some((us, frame.received_us));
        Some(t_s)
    }

    /// The instant of a message that does not.
    fn untimed(&mut self, frame: &Frame<'_>) -> Option<f64> {
        const MAX_US: u64 = 2_000_000;
        let (sent_us, received_us) = self.clock_us?;
        let since_us = frame.received_us.saturating_sub(received_us).min(MAX_US);
        self.recorder.timeline.at(sent_us + since_us)
    }
}

/// What a parameter is: PX4 sends the bytes of a whole number in place of a float's, ArduPilot the number as a float.
fn value_of(autopilot: Autopilot, m: &PARAM_VALUE_DATA) -> f64 {
    if autopilot == Autopilot::Px4 && m.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 {
        f64::from(m.param_value.to_bits().cast_signed())
    } else {
        f64::from(m.param_value)
    }
}

/// Whether a HIGHRES_IMU, which comes for any of its sensors, tells a new field; one that says nothing of that may.
const fn is_new(updated: u16) -> bool {
    const FIELD: u16 = 64 | 128 | 256;
    updated == 0 || updated & FIELD != 0
}

fn gps(m: &mavlink::dialects::common::GPS_RAW_INT_DATA) -> Gps {
    /// Of the course, where it is not known.
    const UNKNOWN: u16 = u16::MAX;
    let hundredths = |number: u16| if number == UNKNOWN { f32::NAN } else { f32::from(number) * 0.01 };
    Gps {
        latitude_deg: (f64::from(m.lat) * 1e-7) as f32,
        longitude_deg: (f64::from(m.lon) * 1e-7) as f32,
        height_m: (f64::from(m.alt) * 1e-3) as f32,
        speed_m_s: hundredths(m.vel),
        course_deg: hundredths(m.cog),
        yaw_deg: f32::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PX4's mounting 2 is the float of the bytes 02 00 00 00, which is next to nothing, and its -1 none at all.
    #[test]
    fn px4s_whole_parameters_are_sent_as_their_bytes() {
        let of = |autopilot, param_type, param_value| {
            value_of(autopilot, &PARAM_VALUE_DATA { param_type, param_value, ..Default::default() })
        };
        let (whole, real) = (MavParamType::MAV_PARAM_TYPE_INT32, MavParamType::MAV_PARAM_TYPE_REAL32);
        for number in [2, -1, 396_809] {
            let told = of(Autopilot::Px4, whole, f32::from_bits(i32::cast_unsigned(number)));
            assert!((told - f64::from(number)).abs() < 1e-9, "{number}: {told}");
        }
        assert!((of(Autopilot::Px4, real, 0.5) - 0.5).abs() < 1e-9);
        assert!((of(Autopilot::ArduPilot, whole, 6.0) - 6.0).abs() < 1e-9);
    }

    /// A reading that is sent again with a new acceleration is as old as it was: only new ones count.
    #[test]
    fn a_field_that_is_not_new_is_not_read_again() {
        let [acceleration, field, nothing] = [7, 64 | 128 | 256, 0].map(is_new);
        assert!(!acceleration && field && nothing);
    }
}

//! MAVLink: the module as a component beside the autopilot.
//!
//! It is component 158, a peripheral, of the system of the autopilot that is believed (`attitude::Senders`), or of the first
//! whose heartbeat was heard while none sends attitude. Until one is heard it sends nothing, for it does not know yet whose
//! component it is, nor whether the line speaks MAVLink. Then it
//!
//! - shows life once a second, and in what state it is;
//! - asks the autopilot for attitude, as often as that gives it, for its current, its position and the time (`asking.rs`);
//! - takes commands of anybody on the network that are addressed to component 158 (`orders.rs`). Those to all components are
//!   left to the autopilot, whose own compass they are meant for;
//! - tells texts (`texts.rs`), how a collection goes on and what comes of it (`collection.rs`), and headings as named values;
//! - tells the heading as a pose where it is to replace the autopilot's own yaw.
//!
//! What another system, or another component of the same one, says of a current, a place or a day changes nothing, nor do
//! the module's own messages that come back.

mod asking;
mod collection;
mod orders;
mod texts;

use ::mavlink::dialects::common::MavState;

use super::{Facts, Heard, Order, Output, Pace, Protocol};
use crate::attitude::{Senders, Source};
use crate::calibration::Calibration;
use crate::compass::{Glance, Refusal};
use crate::frames::wrap_pi;
use crate::settings::HeadingKind;
use crate::time::Timestamp;
use crate::wire::mavlink::{Address, Message, Outgoing, Pose, Receiver};
use asking::Asking;
use collection::Collection;
use orders::Orders;
use texts::Texts;

/// MAV_COMP_ID_PERIPHERAL.
const COMPONENT: u8 = 158;

/// Messages a second. A pose oftener than this is thrown away by autopilots, and less than three are taken for its loss.
const VISION_HZ: u8 = 50;
/// Bytes that may wait before a pose, which is long: on a line too slow for all of them the others keep their room.
const POSE_WAITS: usize = 64;
const HEARTBEAT_HZ: u8 = 1;
/// The heading and its sigma by turns.
const HEADING_HZ: u8 = 10;
const PERCENT_HZ: u8 = 1;

/// MAVLink on a port.
#[derive(Debug, Default)]
pub struct Mavlink {
    receiver: Receiver,
    senders: Senders,
    sequence: u8,
    asking: Asking,
    orders: Orders,
    texts: Texts,
    collection: Collection,
    vision: Pace,
    heartbeat: Pace,
    heading: Pace,
    /// Its sigma is the next to be told of a heading.
    is_sigma_next: bool,
    percent: Pace,
}

/// Where messages go.
struct Line<'a> {
    out: &'a mut Output,
    own: Address,
    sequence: &'a mut u8,
}

impl Line<'_> {
    /// Appends a message; whether there was room for it. Only those that are sent are counted: a gap in the numbers is a
    /// message that was lost on the way.
    fn send(&mut self, message: Outgoing) -> bool {
        let fits = self.out.message(&[&message.frame(self.own, *self.sequence)]);
        *self.sequence = self.sequence.wrapping_add(u8::from(fits));
        fits
    }
}

impl Mavlink {
    /// Nobody was heard yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether this is another calibration than it was told last.
    #[must_use]
    pub fn has_not_seen(&self, calibration: &Calibration) -> bool {
        self.collection.has_not_seen(calibration)
    }

    fn take(&mut self, at: Timestamp, message: Message) -> Option<Heard> {
        let autopilot = self.senders.autopilot(at);
        let is_autopilot = |source: &Source| Some(*source) == autopilot;
        let is_own = |target: Address| autopilot.is_some_and(|autopilot| concerns(target, own(autopilot)));
        match message {
            Message::Heartbeat(heartbeat) => {
                self.senders.hear(at, heartbeat);
                None
            }
            Message::Attitude(report) if self.senders.takes(at, report.source) => {
                self.asking.reported(at, report.sender_time);
                Some(Heard::Attitude(report))
            }
            Message::Attitude(_) => Some(Heard::Foreign),
            Message::Place(source, place) => place.filter(|_| is_autopilot(&source)).map(Heard::Place),
            Message::Day(source, day) => day.filter(|_| is_autopilot(&source)).map(Heard::Day),
            Message::Current(source, current) => current.filter(|_| is_autopilot(&source)).map(Heard::Current),
            Message::Command(command) if command.target.component == COMPONENT && is_own(command.target) => {
                let is_armed = self.senders.is_armed(at) == Some(true);
                self.orders.take(at, &command, is_armed).map(Heard::Asked)
            }
            Message::Command(_) => None,
            Message::Acknowledgement(ack) => {
                if is_autopilot(&ack.source) && is_own(ack.target) {
                    self.asking.acknowledged(at, ack);
                }
                None
            }
        }
    }

    fn tell_heading(&mut self, facts: &Facts<'_>, line: &mut Line<'_>) -> bool {
        let Facts { now, estimate, settings, .. } = *facts;
        let smooth = estimate.smooth.filter(|_| settings.stream_heading == HeadingKind::Smooth);
        let heading = smooth.or(estimate.heading.ok()).filter(|_| settings.stream_on);
        let Some(heading) = heading else { return false };
        if !self.heading.is_due(now, HEADING_HZ) {
            return false;
        }
        let (name, value) =
            if self.is_sigma_next { ("hdg_sigma", heading.sigma_deg()) } else { ("hdg_mag", heading.magnetic_deg()) };
        self.is_sigma_next = !self.is_sigma_next;
        line.send(Outgoing::named_value(now, name, value))
    }

    fn tell_pose(&mut self, facts: &Facts<'_>, line: &mut Line<'_>) -> bool {
        if line.out.pending().len() > POSE_WAITS {
            return false;
        }
        let Some(pose) = pose(facts, self.collection.calibrations()) else { return false };
        self.vision.is_due(facts.now, VISION_HZ) && line.send(Outgoing::vision(&pose))
    }

    fn tell_life(&mut self, facts: &Facts<'_>, line: &mut Line<'_>) -> bool {
        self.heartbeat.is_due(facts.now, HEARTBEAT_HZ) && line.send(Outgoing::heartbeat(state(facts.glance)))
    }

    fn tell_percent(&mut self, facts: &Facts<'_>, line: &mut Line<'_>) -> bool {
        let percent = f32::from(percent(facts.glance));
        self.percent.is_due(facts.now, PERCENT_HZ) && line.send(Outgoing::named_value(facts.now, "cal_pct", percent))
    }
}

/// The module's own address beside an autopilot.
fn own(autopilot: Source) -> Address {
    Address { component: COMPONENT, ..Address::of(autopilot) }
}

/// Whether what is for `target` is for `own`, too: 0 is everybody.
fn concerns(target: Address, own: Address) -> bool {
    [0, own.system].contains(&target.system) && [0, own.component].contains(&target.component)
}

impl Protocol for Mavlink {
    fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard> {
        let message = self.receiver.push(byte)?;
        Some(self.take(at, message).unwrap_or(Heard::Life))
    }

    fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.senders.is_armed(now)
    }

    fn rejected(&self) -> u32 {
        self.receiver.rejected
    }

    /// One message at a time, for the other port's sentences of the same reading wait meanwhile. All of them together are
    /// fewer than the slowest sensor's readings.
    fn poll(&mut self, facts: &Facts<'_>, out: &mut Output) {
        let now = facts.now;
        self.collection.see(facts, &mut self.texts);
        let Some(autopilot) = self.senders.autopilot(now) else { return };
        let mut sequence = self.sequence;
        let line = &mut Line { out, own: own(autopilot), sequence: &mut sequence };
        let _is_told = self.orders.tell(line)
            || self.tell_pose(facts, line)
            || self.tell_life(facts, line)
            || self.asking.tell(now, autopilot, line)
            || self.collection.tell(facts, line)
            || self.tell_percent(facts, line)
            || self.texts.tell(now, line)
            || self.tell_heading(facts, line);
        self.sequence = sequence;
    }

    /// Tells it to who asked. Before a restart what is in the [`Output`] is to be written first.
    fn answer(&mut self, order: Order, result: Result<(), &Refusal>) {
        self.orders.answer(order, result);
    }

    /// What is noted before an autopilot is known is told when there is one; of more than three notes the newest three.
    fn note(&mut self, text: &str) {
        self.texts.note(text);
    }
}

/// What the state of a component is called.
const fn state(glance: Glance) -> MavState {
    match glance {
        Glance::Waiting => MavState::MAV_STATE_UNINIT,
        Glance::Collecting(_) => MavState::MAV_STATE_CALIBRATING,
        Glance::Calibrated => MavState::MAV_STATE_ACTIVE,
        Glance::Refused => MavState::MAV_STATE_CRITICAL,
    }
}

/// How much of a calibration there is, percent.
const fn percent(glance: Glance) -> u8 {
    match glance {
        Glance::Waiting | Glance::Refused => 0,
        Glance::Collecting(percent) => percent,
        Glance::Calibrated => 100,
    }
}

/// The pose to tell where it is wanted, the declination known and the heading trusted: the raw heading, for the autopilot
/// filters by itself, and roll and pitch as they were at its instant.
fn pose(facts: &Facts<'_>, reset_counter: u8) -> Option<Pose> {
    let Facts { estimate, settings, .. } = *facts;
    if !settings.tells_vision {
        return None;
    }
    let (declination_deg, heading, attitude) = (settings.declination_deg?, estimate.heading.ok()?, estimate.attitude?);
    let yaw_rad = wrap_pi(heading.magnetic_rad + declination_deg.to_radians());
    Some(Pose {
        at: estimate.at,
        roll_pitch_yaw_rad: [attitude.roll_rad, attitude.pitch_rad, yaw_rad],
        yaw_variance_rad2: heading.sigma_rad * heading.sigma_rad,
        reset_counter,
    })
}

#[cfg(test)]
mod tests;

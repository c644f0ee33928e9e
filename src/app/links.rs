//! The wires between tasks.

use core::cell::Cell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_sync::watch::{Receiver, Watch};
use embassy_time::Instant;

use crate::attitude::{Lines, Report};
use crate::calibration::Sample;
use crate::compass::{Command, Glance, Outcome, Refusal, Reply};
use crate::earth::{Day, Place};
use crate::health::{Counters, Counts};
use crate::instrument::{Correction, Estimate, Iron};
use crate::magnetometer::{Identity, Reading};
use crate::port::Order;
use crate::settings::Settings;
use crate::settings::{PORTS, PortNumber, ProtocolKind};
use crate::time::Timestamp;

/// Something with the instant at which it was ready.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamped<T> {
    pub at: Timestamp,
    pub value: T,
}

/// A magnetometer that has answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FoundSensor {
    pub identity: Identity,
    pub period_us: u32,
    /// After so many equal readings an axis of it is stuck.
    pub stuck_after: u16,
}

/// A channel whose sender never waits: what finds it full is counted and lost.
pub(super) type Queue<T, const N: usize> = Channel<CriticalSectionRawMutex, T, N>;

/// A latest value that a number of tasks wait for.
pub(super) type Latest<T, const N: usize> = Watch<CriticalSectionRawMutex, T, N>;

/// A task's end of a [`Latest`].
pub(super) type Listener<'a, T, const N: usize> = Receiver<'a, CriticalSectionRawMutex, T, N>;

/// All wires between tasks. The tasks run at two priorities, so every wire is closed by a critical section, of some
/// hundred instructions at most.
pub struct Links {
    pub(super) readings: Queue<Stamped<Reading>, 4>,
    pub(super) reports: Queue<Stamped<Report>, 8>,
    pub(super) samples: Queue<Sample, 8>,
    pub(super) requests: Queue<Command, 1>,
    pub(super) replies: Queue<Result<Reply, Refusal>, 1>,
    pub(super) notices: Signal<CriticalSectionRawMutex, Outcome>,
    /// To the console: hard iron that has moved, or is back where it was.
    pub(super) iron: Signal<CriticalSectionRawMutex, Option<Iron>>,
    /// To the state machine: the button was held.
    pub(super) pressed: Signal<CriticalSectionRawMutex, ()>,
    /// To the lamp, which looks at it now and then.
    pub(super) glance: Latest<Glance, 1>,
    /// To the instrument and to the state machine.
    pub(super) sensor: Latest<FoundSensor, 2>,
    /// To the state machine: whether the autopilot is armed, if that is known.
    pub(super) armed: Latest<Option<bool>, 1>,
    /// To the state machine: where the autopilot is. Apart from the day, which may come on another port.
    pub(super) place: Latest<Place, 1>,
    /// To the state machine: what day it is.
    pub(super) day: Latest<Day, 1>,
    /// To the instrument, which looks at it now and then: the current that the motors draw, amperes.
    pub(super) current: Latest<Stamped<f32>, 0>,
    /// To the instrument: replaced as a whole, so that a heading never mixes two calibrations.
    pub(super) correction: Latest<Correction, 1>,
    /// To the ports.
    pub(super) settings: Latest<Settings, PORTS>,
    /// To the ports: what the console notes.
    pub(super) texts: Latest<Text, PORTS>,
    /// To the ports; the console looks at it now and then.
    pub(super) estimates: Latest<Estimate, PORTS>,
    /// To the state machine: what is asked for on a port.
    pub(super) orders: Queue<(PortNumber, Order), 1>,
    /// To the console, which can do it: restart.
    pub(super) restart: Signal<CriticalSectionRawMutex, ()>,
    ports: [Wires; PORTS],
    lines: Mutex<CriticalSectionRawMutex, Cell<Lines>>,
    pub(super) counters: Counters,
    pub(super) heartbeats: Heartbeats,
}

impl Links {
    /// Wires with nothing on them.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            readings: Channel::new(),
            reports: Channel::new(),
            samples: Channel::new(),
            requests: Channel::new(),
            replies: Channel::new(),
            notices: Signal::new(),
            iron: Signal::new(),
            pressed: Signal::new(),
            glance: Watch::new(),
            sensor: Watch::new(),
            armed: Watch::new(),
            place: Watch::new(),
            day: Watch::new(),
            current: Watch::new(),
            correction: Watch::new(),
            settings: Watch::new(),
            texts: Watch::new(),
            estimates: Watch::new(),
            orders: Channel::new(),
            restart: Signal::new(),
            ports: [const { Wires::new() }; PORTS],
            lines: Mutex::new(Cell::new(Lines::new())),
            counters: Counters::new(),
            heartbeats: Heartbeats::new(),
        }
    }

    /// A port's own.
    pub(super) const fn port(&self, number: PortNumber) -> &Wires {
        number.of(&self.ports)
    }

    /// Whether a report of attitude that came on a port is taken: one port's is at a time.
    pub(super) fn takes_attitude_of(&self, number: PortNumber, at: Timestamp, report: &Report) -> bool {
        self.lines.lock(|lines| {
            let mut all = lines.get();
            let takes = all.takes(at, number as u8, report.has_rates());
            lines.set(all);
            takes
        })
    }

    /// A port tells what it speaks, and whether the autopilot there is armed. It is, if that of any port is.
    pub(super) fn port_is(&self, number: PortNumber, spoken: ProtocolKind, is_armed: Option<bool>) {
        let wires = self.port(number);
        wires.spoken.store(spoken as u8, Ordering::Relaxed);
        wires.armed.store(is_armed.map_or(UNKNOWN, u8::from), Ordering::Relaxed);
        let armed = |number| self.port(number).armed.load(Ordering::Relaxed);
        let [one, two] = PortNumber::ALL.map(armed);
        let most = if one == UNKNOWN || (two != UNKNOWN && two > one) { two } else { one };
        publish(&self.armed, (most != UNKNOWN).then_some(most == u8::from(true)));
    }

    /// What the ports begin with where nothing was chosen: what was found there before the restart.
    pub(super) fn begin_with(&self, found: [ProtocolKind; PORTS]) {
        for (number, found) in PortNumber::ALL.into_iter().zip(found) {
            self.port(number).spoken.store(found as u8, Ordering::Relaxed);
        }
    }

    /// What is spoken on the ports; what they begin with until they have.
    pub(super) fn spoken(&self) -> [ProtocolKind; PORTS] {
        PortNumber::ALL.map(|number| {
            let spoken = self.port(number).spoken.load(Ordering::Relaxed);
            ProtocolKind::ALL.into_iter().find(|kind| *kind as u8 == spoken).unwrap_or(ProtocolKind::Auto)
        })
    }

    /// The counters as they are now.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counters.snapshot()
    }

    /// Puts something into a queue whose reader may be behind.
    pub(super) fn offer<T, const N: usize>(&self, queue: &Queue<T, N>, item: T) {
        if queue.try_send(item).is_err() {
            count(&self.counters.samples_dropped);
        }
    }
}

impl Default for Links {
    fn default() -> Self {
        Self::new()
    }
}

/// This instant.
pub(super) fn now() -> Timestamp {
    Timestamp::from_us(Instant::now().as_micros())
}

/// This instant's value.
pub(super) fn stamped<T>(value: T) -> Stamped<T> {
    Stamped { at: now(), value }
}

/// A task's end of a wire that has one for each task on it.
///
/// # Panics
///
/// At the start of the firmware, when a board runs more tasks than [`Links`] has ends for: a mistake in its task list.
pub(super) fn listen<T: Clone, const N: usize>(latest: &Latest<T, N>) -> Listener<'_, T, N> {
    latest.receiver().expect("an end of the wire for each task that a board runs")
}

/// Publishes a value if it is another than the last, so that nobody wakes for nothing.
pub(super) fn publish<T: Clone + PartialEq, const N: usize>(latest: &Latest<T, N>, value: T) {
    if latest.try_get().as_ref() != Some(&value) {
        latest.sender().send(value);
    }
}

/// Adds one; wraps after 2^32.
pub(super) fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// A line of the console's, for ports.
pub(super) type Text = heapless::String<TEXT>;

/// Characters of the longest note, and a little.
const TEXT: usize = 200;

/// No autopilot has said whether it is armed.
const UNKNOWN: u8 = 2;

/// The wires of one port.
pub(super) struct Wires {
    /// A sign of life; 0 of a port that does not run.
    pub heartbeat: AtomicU32,
    /// What became of an order that came there.
    pub answers: Signal<CriticalSectionRawMutex, (Order, Result<(), Refusal>)>,
    spoken: AtomicU8,
    armed: AtomicU8,
}

impl Wires {
    const fn new() -> Self {
        Self {
            heartbeat: AtomicU32::new(0),
            answers: Signal::new(),
            spoken: AtomicU8::new(ProtocolKind::Auto as u8),
            armed: AtomicU8::new(UNKNOWN),
        }
    }
}

/// Signs of life, one counter each.
#[derive(Debug)]
pub(super) struct Heartbeats {
    pub sensor: AtomicU32,
    pub instrument: AtomicU32,
    /// The executor of the tasks below those.
    pub below: AtomicU32,
}

/// The first of the signs of life are of tasks that every board runs, the first port among them.
pub(super) const ALWAYS_THERE: usize = 4;

/// Signs of life that the watchdog looks at.
pub(super) const HEARTBEATS: usize = ALWAYS_THERE - 1 + PORTS;

impl Heartbeats {
    pub const fn new() -> Self {
        Self { sensor: AtomicU32::new(0), instrument: AtomicU32::new(0), below: AtomicU32::new(0) }
    }
}

impl Links {
    /// All signs of life. That of a port that does not run stays 0.
    pub(super) fn life(&self) -> [u32; HEARTBEATS] {
        let Heartbeats { sensor, instrument, below } = &self.heartbeats;
        let [one, two] = PortNumber::ALL.map(|number| &self.port(number).heartbeat);
        [sensor, instrument, below, one, two].map(|beat| beat.load(Ordering::Relaxed))
    }
}

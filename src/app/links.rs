//! The wires between tasks.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_sync::watch::{Receiver, Watch};
use embassy_time::Instant;

use crate::attitude::Report;
use crate::calibration::Sample;
use crate::compass::{Command, Glance, Outcome, Refusal, Reply};
use crate::earth::{Day, Place};
use crate::health::{Counters, Counts};
use crate::instrument::{Correction, Estimate, Iron};
use crate::magnetometer::{Identity, Reading};
use crate::settings::Settings;
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

/// The most outlets that can run at once: one for each port, and one to spare.
pub(super) const OUTLETS: usize = 3;

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
    /// To the instrument: replaced as a whole, so that a heading never mixes two calibrations.
    pub(super) correction: Latest<Correction, 1>,
    /// To the outlets.
    pub(super) settings: Latest<Settings, OUTLETS>,
    /// To the outlets; the console looks at it now and then.
    pub(super) estimates: Latest<Estimate, OUTLETS>,
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
            correction: Watch::new(),
            settings: Watch::new(),
            estimates: Watch::new(),
            counters: Counters::new(),
            heartbeats: Heartbeats::new(),
        }
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

/// Publishes a value if it is another than the last, so that nobody wakes for nothing. For wires with one publisher.
pub(super) fn publish<T: Clone + PartialEq, const N: usize>(latest: &Latest<T, N>, value: T) {
    if latest.try_get().as_ref() != Some(&value) {
        latest.sender().send(value);
    }
}

/// Adds one; wraps after 2^32.
pub(super) fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Signs of life, one counter each.
#[derive(Debug)]
pub(super) struct Heartbeats {
    pub sensor: AtomicU32,
    pub attitude: AtomicU32,
    pub instrument: AtomicU32,
    /// Of each outlet that runs.
    pub outlets: [AtomicU32; OUTLETS],
    /// The executor of the tasks below those.
    pub below: AtomicU32,
}

/// The first of the signs of life are of tasks that every board runs, one outlet among them.
pub(super) const ALWAYS_THERE: usize = 5;

/// Signs of life that the watchdog looks at.
pub(super) const HEARTBEATS: usize = ALWAYS_THERE - 1 + OUTLETS;

impl Heartbeats {
    pub const fn new() -> Self {
        Self {
            sensor: AtomicU32::new(0),
            attitude: AtomicU32::new(0),
            instrument: AtomicU32::new(0),
            outlets: [const { AtomicU32::new(0) }; OUTLETS],
            below: AtomicU32::new(0),
        }
    }

    /// Shows life of an outlet for the first time; where it shows life from now on.
    pub fn outlet_begins(&self) -> &AtomicU32 {
        let is_free = |beat: &&AtomicU32| beat.compare_exchange(0, 1, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        let [first, ..] = &self.outlets;
        // There is one for each: `listen` has given the outlet its end of the wires.
        self.outlets.iter().find(is_free).unwrap_or(first)
    }

    /// All of them. That of an outlet that does not run stays 0.
    pub fn snapshot(&self) -> [u32; HEARTBEATS] {
        let Self { sensor, attitude, instrument, below, outlets: [first, second, third] } = self;
        [sensor, attitude, instrument, below, first, second, third].map(|beat| beat.load(Ordering::Relaxed))
    }
}

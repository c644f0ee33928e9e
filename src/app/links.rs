//! The wires between tasks.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;

use crate::attitude::{self, Lookup, Track};
use crate::calibration::{Calibration, Sample, Uncertainty};
use crate::compass::{Command, Outcome, Refusal, Reply};
use crate::frames::Attitude;
use crate::heading::{Heading, NoHeading};
use crate::magnetometer::{Identity, Reading};
use crate::settings::Settings;

/// A reading with its instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct StampedReading {
    /// When the measurement was ready, microseconds since start.
    pub time_us: u64,
    pub reading: Reading,
}

/// What the stream works with: replaced as a whole, so that a sentence never mixes two calibrations.
#[derive(Clone, Debug)]
pub(super) struct Active {
    /// The calibration in use, and how wrong a heading by it may be.
    pub calibration: Option<(Calibration, Uncertainty)>,
    pub settings: Settings,
    /// Whether samples are wanted although no attitude is known.
    pub without_attitude: bool,
}

/// All wires between tasks. The tasks run at two priorities, so every wire is closed by a critical section, of some
/// hundred instructions at most.
pub struct Links {
    pub(super) readings: Channel<CriticalSectionRawMutex, StampedReading, 4>,
    pub(super) samples: Channel<CriticalSectionRawMutex, Sample, 8>,
    pub(super) requests: Channel<CriticalSectionRawMutex, Command, 1>,
    pub(super) replies: Channel<CriticalSectionRawMutex, Result<Reply, Refusal>, 1>,
    pub(super) notices: Signal<CriticalSectionRawMutex, Outcome>,
    pub(super) found: Signal<CriticalSectionRawMutex, Identity>,
    track: Mutex<CriticalSectionRawMutex, RefCell<Track>>,
    active: Mutex<CriticalSectionRawMutex, RefCell<Active>>,
    heading: Mutex<CriticalSectionRawMutex, Cell<Result<Heading, NoHeading>>>,
    identity: Mutex<CriticalSectionRawMutex, Cell<Option<Identity>>>,
    pub(super) counters: Counters,
    pub(super) heartbeats: Heartbeats,
}

impl Links {
    /// Wires with nothing on them.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            readings: Channel::new(),
            samples: Channel::new(),
            requests: Channel::new(),
            replies: Channel::new(),
            notices: Signal::new(),
            found: Signal::new(),
            track: Mutex::new(RefCell::new(Track::new(attitude::Config::DEFAULT))),
            active: Mutex::new(RefCell::new(Active {
                calibration: None,
                settings: Settings::DEFAULT,
                without_attitude: false,
            })),
            heading: Mutex::new(Cell::new(Err(NoHeading::SensorSilent))),
            identity: Mutex::new(Cell::new(None)),
            counters: Counters::new(),
            heartbeats: Heartbeats::new(),
        }
    }

    // None of the closures below calls anything that borrows the same cell again, so the borrows cannot fail.

    pub(super) fn with_track<R>(&self, f: impl FnOnce(&mut Track) -> R) -> R {
        self.track.lock(|track| f(&mut track.borrow_mut()))
    }

    /// The attitude at an instant, interpolated or carried on; none when the source's reports do not reach it.
    pub(super) fn attitude_at(&self, time_us: u64) -> Option<Attitude> {
        match self.with_track(|track| track.at(time_us)) {
            Lookup::Interpolated(attitude) | Lookup::Extrapolated(attitude) => Some(attitude),
            Lookup::Missing | Lookup::Stale => None,
        }
    }

    pub(super) fn active(&self) -> Active {
        self.active.lock(|active| active.borrow().clone())
    }

    pub(super) fn set_active(&self, new: Active) {
        self.active.lock(|active| *active.borrow_mut() = new);
    }

    pub(super) fn heading(&self) -> Result<Heading, NoHeading> {
        self.heading.lock(Cell::get)
    }

    pub(super) fn set_heading(&self, new: Result<Heading, NoHeading>) {
        self.heading.lock(|heading| heading.set(new));
    }

    pub(super) fn identity(&self) -> Option<Identity> {
        self.identity.lock(Cell::get)
    }

    pub(super) fn set_identity(&self, new: Identity) {
        self.identity.lock(|identity| identity.set(Some(new)));
        self.found.signal(new);
    }

    /// The counters as they are now.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counters.snapshot()
    }
}

impl Default for Links {
    fn default() -> Self {
        Self::new()
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
    pub stream: AtomicU32,
    /// The executor of the tasks below those.
    pub below: AtomicU32,
}

impl Heartbeats {
    const fn new() -> Self {
        Self {
            sensor: AtomicU32::new(0),
            attitude: AtomicU32::new(0),
            stream: AtomicU32::new(0),
            below: AtomicU32::new(0),
        }
    }

    pub fn snapshot(&self) -> [u32; 4] {
        [&self.sensor, &self.attitude, &self.stream, &self.below].map(|beat| beat.load(Ordering::Relaxed))
    }
}

/// Declares the counters once, as atomics and as a snapshot.
macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// Event counters since start; each wraps after 2^32.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct Counts {
            $($(#[$doc])* pub $name: u32,)*
        }

        #[derive(Debug)]
        pub(super) struct Counters {
            $(pub $name: AtomicU32,)*
        }

        impl Counters {
            const fn new() -> Self {
                Self { $($name: AtomicU32::new(0),)* }
            }

            fn snapshot(&self) -> Counts {
                Counts { $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }
    };
}

counters! {
    /// Measurements read from the sensor.
    readings,
    /// Measurements the sensor overwrote before they were read.
    overruns,
    /// Measurements at the end of the range.
    saturated,
    /// Times the sensor had to be initialised again.
    sensor_errors,
    /// Valid attitude reports.
    attitude_reports,
    /// Attitude frames with a wrong CRC or impossible values.
    attitude_rejected,
    /// Errors of the attitude line itself.
    attitude_line_errors,
    /// Headings sent, in one or more sentences each.
    sentences,
    /// of them without a heading.
    sentences_empty,
    /// Sentences that could not be written.
    stream_errors,
    /// Readings for which no attitude came.
    unpaired,
    /// Readings or samples that found their queue full.
    samples_dropped,
    /// Successful saves.
    saves,
    /// Failed loads and saves.
    store_errors,
}

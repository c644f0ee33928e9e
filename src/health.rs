//! How the module is: what it counts, why it started, how much stack it has used. What `status` shows beside the state
//! machine's report.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::frames::Attitude;
use crate::heading::{Heading, NoHeading};
use crate::instrument::{self, Iron};
use crate::magnetometer::Identity;

/// What the module shows of itself beside the state machine's report.
#[derive(Clone, Debug)]
pub struct Health {
    /// The magnetometer that answered.
    pub sensor: Option<Identity>,
    /// The attitude at the last reading, if the source sends any.
    pub attitude: Option<Attitude>,
    /// The last heading, or why there is none.
    pub heading: Result<Heading, NoHeading>,
    /// Hard iron that has moved since the calibration, once it is sure.
    pub iron: Option<Iron>,
    /// Event counters.
    pub counts: Counts,
    /// Why the module started.
    pub reset: ResetCause,
    /// Since when, seconds.
    pub uptime_s: u32,
    /// How deep the stack has been, where that is known.
    pub stack: Option<StackUse>,
}

/// The deepest the stack has been since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StackUse {
    /// Bytes used.
    pub used: usize,
    /// Bytes there are.
    pub size: usize,
}

/// Why the module started, as far as the hardware remembers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power was switched on.
    PowerOn,
    /// The reset pin, or a debugger.
    Pin,
    /// The console's `reboot`.
    Software,
    /// A task hung and the watchdog struck.
    Watchdog,
    /// The firmware panicked or faulted; what it left as its last words.
    Panic(heapless::String<96>),
}

/// Declares the counters once, as atomics and as a snapshot.
macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// Event counters since start; each wraps after 2^32.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct Counts {
            $($(#[$doc])* pub $name: u32,)*
        }

        /// The counters themselves, for tasks of any priority to count in.
        #[derive(Debug, Default)]
        pub struct Counters {
            $($(#[$doc])* pub $name: AtomicU32,)*
        }

        impl Counters {
            /// All at zero.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: AtomicU32::new(0),)* }
            }

            /// The counts of now.
            #[must_use]
            pub fn snapshot(&self) -> Counts {
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
    /// Measurements of an axis that ends before its range does.
    sensor_clipped,
    /// Measurements of an axis that repeats itself.
    sensor_stuck,
    /// Measurements too far from the one before.
    sensor_spikes,
    /// Times the sensor did not answer, or not as it should, and had to be initialised again.
    sensor_errors,
    /// Times the sensor's configuration was found changed, and was mended.
    sensor_upsets,
    /// Valid attitude reports of the sender that is believed.
    attitude_reports,
    /// Valid attitude reports of other senders.
    attitude_foreign,
    /// Attitude and heartbeat frames with a wrong CRC or impossible values.
    attitude_rejected,
    /// Attitude reports of a source that repeats itself.
    attitude_frozen,
    /// Attitude reports too far from where the ones before lead to.
    attitude_spikes,
    /// Attitude reports whose body rates contradict their attitude.
    attitude_rates,
    /// Errors of the attitude line itself.
    attitude_line_errors,
    /// Messages sent by outlets, of one or more sentences each.
    messages,
    /// Messages among them that held no heading.
    messages_empty,
    /// Messages that could not be written.
    write_errors,
    /// Readings for which no attitude came.
    unpaired,
    /// Readings, attitude reports or samples that found their queue full.
    samples_dropped,
    /// Successful saves.
    saves,
    /// Failed loads and saves.
    store_errors,
}

impl Counters {
    /// Takes over what the instrument has counted.
    pub fn take(&self, counts: &instrument::Counts) {
        for (counter, count) in [
            (&self.unpaired, counts.unpaired),
            (&self.saturated, counts.saturated),
            (&self.sensor_clipped, counts.clipped),
            (&self.sensor_stuck, counts.stuck),
            (&self.sensor_spikes, counts.spikes),
            (&self.attitude_frozen, counts.attitude.frozen),
            (&self.attitude_spikes, counts.attitude.spikes),
            (&self.attitude_rates, counts.attitude.rates),
        ] {
            counter.store(count, Ordering::Relaxed);
        }
    }
}

//! How the module is: what it counts, why it started, how much stack it has used. What `status` shows beside the state
//! machine's report.

use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering};

use crate::frames::Attitude;
use crate::heading::{Heading, NoHeading};
use crate::instrument::{self, Iron};
use crate::magnetometer::Identity;
use crate::settings::{PORTS, PortNumber, ProtocolKind};

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
    /// The current that the motors draw, amperes, if the autopilot has told it lately.
    pub current_a: Option<f32>,
    /// Event counters.
    pub counts: Counts,
    /// What was lost of the readings since the collection began.
    pub loss: Option<Loss>,
    /// Why the module started.
    pub reset: ResetCause,
    /// Since when, seconds.
    pub uptime_s: u32,
    /// How deep the stack has been, where that is known.
    pub stack: Option<StackUse>,
    /// What is spoken on the ports; of one that searches `auto`.
    pub ports: [ProtocolKind; PORTS],
}

impl Health {
    /// What is spoken on a port.
    #[must_use]
    pub const fn port(&self, number: PortNumber) -> ProtocolKind {
        *number.of(&self.ports)
    }
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

            /// The counts of now. Not inlined: wherever it is asked for it would be as long as the list.
            #[must_use]
            #[inline(never)]
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
    /// Messages for ports, of one or more sentences each.
    messages,
    /// Messages among them that held no heading.
    messages_empty,
    /// Messages that could not be written, or had no room.
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

/// What kept readings from becoming samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// So many percent of them were at the end of the sensor's range.
    Saturated(u32),
    /// Attitude came that cannot be one, such as degrees for radians.
    ImpossibleAttitude,
    /// So many percent of them found no attitude before and after them.
    NoAttitude(u32),
}

impl Loss {
    /// The most likely one between two states of the counters; nothing if most readings became samples, or there were
    /// only a few.
    #[must_use]
    pub const fn between(before: &Counts, now: &Counts) -> Option<Self> {
        const fn percent(part: u32, whole: u32) -> u32 {
            (part as u64 * 100 / whole as u64) as u32
        }
        let readings = now.readings.wrapping_sub(before.readings);
        if readings < FEW_READINGS {
            return None;
        }
        let saturated = now.saturated.wrapping_sub(before.saturated);
        let clipped = now.sensor_clipped.wrapping_sub(before.sensor_clipped);
        let saturated = percent(saturated.saturating_add(clipped), readings);
        let unpaired = percent(now.unpaired.wrapping_sub(before.unpaired), readings);
        let believed = now.attitude_reports.wrapping_sub(before.attitude_reports);
        let rejected = now.attitude_rejected.wrapping_sub(before.attitude_rejected);
        if saturated >= MUCH_SATURATED_PERCENT {
            Some(Self::Saturated(saturated))
        } else if rejected > believed {
            Some(Self::ImpossibleAttitude)
        } else if unpaired >= MUCH_UNPAIRED_PERCENT {
            Some(Self::NoAttitude(unpaired))
        } else {
            None
        }
    }
}

/// Of fewer readings, a second of a fast sensor, nothing is said.
const FEW_READINGS: u32 = 100;

/// Saturated on a twentieth of the way, the sensor misses a sector or two of each circle.
const MUCH_SATURATED_PERCENT: u32 = 5;

/// Half of the readings without attitude: it comes less often than it may be interpolated over.
const MUCH_UNPAIRED_PERCENT: u32 = 50;

/// What to do about it, in words.
impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Saturated(percent) => {
                write!(f, "{percent} % of the readings were saturated; move the sensor away from magnets and wires")
            }
            Self::ImpossibleAttitude => {
                f.write_str("attitude came that cannot be one; check its unit: MAVLink's is radians, not degrees")
            }
            Self::NoAttitude(percent) => {
                write!(f, "{percent} % of the readings had no attitude; send ATTITUDE ten times a second or more")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Counts {
        Counts {
            readings: u32::MAX - 50,
            saturated: 900,
            sensor_clipped: 40,
            unpaired: 77,
            attitude_reports: 5000,
            attitude_rejected: 12,
            ..Counts::default()
        }
    }

    /// So much more than at some time, past the end of a counter.
    fn later(readings: u32, saturated: u32, clipped: u32, unpaired: u32, attitude: [u32; 2]) -> Option<Loss> {
        let some = some();
        let now = Counts {
            readings: some.readings.wrapping_add(readings),
            saturated: some.saturated + saturated,
            sensor_clipped: some.sensor_clipped + clipped,
            unpaired: some.unpaired + unpaired,
            attitude_reports: some.attitude_reports + attitude[0],
            attitude_rejected: some.attitude_rejected + attitude[1],
            ..some
        };
        Loss::between(&some, &now)
    }

    #[test]
    fn what_was_lost_is_named_by_its_cause() {
        assert_eq!(later(1000, 0, 0, 0, [600, 0]), None);
        assert_eq!(later(1000, 49, 0, 499, [600, 600]), None);
        assert_eq!(later(1000, 50, 0, 999, [0, 600]), Some(Loss::Saturated(5)));
        assert_eq!(later(1000, 20, 30, 0, [600, 0]), Some(Loss::Saturated(5)));
        assert_eq!(later(1000, 0, 0, 999, [600, 601]), Some(Loss::ImpossibleAttitude));
        assert_eq!(later(1000, 0, 0, 500, [600, 0]), Some(Loss::NoAttitude(50)));
        // Too few to tell.
        assert_eq!(later(99, 99, 0, 0, [0, 0]), None);
        assert_eq!(later(100, 100, 0, 0, [0, 0]), Some(Loss::Saturated(100)));
        assert_eq!(later(0, 0, 0, 0, [0, 0]), None);
    }

    #[test]
    fn each_loss_has_its_words() {
        for (loss, words) in [
            (Loss::Saturated(12), "12 % of the readings were saturated; move the sensor away from magnets and wires"),
            (
                Loss::ImpossibleAttitude,
                "attitude came that cannot be one; check its unit: MAVLink's is radians, not degrees",
            ),
            (Loss::NoAttitude(83), "83 % of the readings had no attitude; send ATTITUDE ten times a second or more"),
        ] {
            assert_eq!(loss.to_string(), words);
        }
    }
}

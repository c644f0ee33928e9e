//! Feeds the watchdog while the heading tasks and the state machine run.

use embassy_time::{Duration, Instant, Timer};

use super::task_links::{COMMON_HEARTBEAT_COUNTERS, MAX_HEARTBEAT_COUNTERS};
use crate::app::task_links::TaskLinks;

/// Interval of checks; longer than the slowest heartbeat, that of a sensor that does not answer.
const CHECK_INTERVAL: Duration = Duration::from_millis(700);

/// Longest time between feeds, microseconds, which the hardware's period must exceed: one failed check is allowed.
pub const MAX_FEED_INTERVAL_US: u64 = 2 * CHECK_INTERVAL.as_micros();

/// Uninterrupted work of all tasks after which the image counts as good, as in ArduPilot.
const GOOD_IMAGE_AFTER: Duration = Duration::from_secs(30);

const _: () = assert!(CHECK_INTERVAL.as_millis() > super::sensor::MAX_HEARTBEAT_INTERVAL_MS);
const _: () = assert!(CHECK_INTERVAL.as_millis() > super::compass::MAX_HEARTBEAT_INTERVAL_MS);

/// Hardware watchdog: resets the module unless [`feed`](Self::feed) is called within its period.
pub trait Watchdog {
    /// Restarts the watchdog's period.
    fn feed(&mut self);

    /// Marks the image as good for a boot loader that asks for it. Called with each feed after 30 s of work.
    fn mark_image_good(&mut self) {}
}

/// Feeds the watchdog if sensor, instrument, every running port and the state machine have each sent a heartbeat since
/// the last check. A console that does not yield stops the state machine, too: they share an executor.
pub async fn run_watchdog(links: &TaskLinks, mut watchdog: impl Watchdog) -> ! {
    let mut last_counts = links.heartbeat_counts();
    let mut working_since = Instant::now();
    loop {
        Timer::after(CHECK_INTERVAL).await;
        let counts = links.heartbeat_counts();
        if all_sent_heartbeats(&last_counts, &counts) {
            watchdog.feed();
            if working_since.elapsed() >= GOOD_IMAGE_AFTER {
                watchdog.mark_image_good();
            }
        } else {
            working_since = Instant::now();
        }
        last_counts = counts;
    }
}

/// Whether each task has sent a heartbeat; a line is exempt until its first one.
fn all_sent_heartbeats(last_counts: &[u32; MAX_HEARTBEAT_COUNTERS], counts: &[u32; MAX_HEARTBEAT_COUNTERS]) -> bool {
    let is_unused_line = |i: usize, beat: u32| i >= COMMON_HEARTBEAT_COUNTERS && beat == 0;
    counts
        .iter()
        .zip(last_counts)
        .enumerate()
        .all(|(i, (count, last_count))| count != last_count || is_unused_line(i, *count))
}

//! Feeds the watchdog while the heading tasks and the thread executor run.

use embassy_time::{Duration, Timer};

use super::links::{ALWAYS_THERE, HEARTBEATS, increment};
use super::{Links, Watchdog};

/// Interval of checks; longer than the slowest heartbeat, that of a sensor that does not answer.
const LOOK: Duration = Duration::from_millis(700);

/// Heartbeat interval of the thread executor. Its longest run without a wait is one step of a solve, 0.1 s.
const PULSE: Duration = Duration::from_millis(200);

/// Longest time between feeds, microseconds, which the hardware's period must exceed: one failed check is allowed.
pub const MAX_FEED_INTERVAL_US: u64 = 2 * LOOK.as_micros();

const _: () =
    assert!(LOOK.as_millis() > super::sensor::MAX_HEARTBEAT_INTERVAL_MS && LOOK.as_millis() > 2 * PULSE.as_millis());

/// Heartbeat of the thread executor: stops if a task does not yield.
pub async fn run_heartbeat(links: &Links) -> ! {
    loop {
        increment(&links.heartbeats.thread_executor);
        Timer::after(PULSE).await;
    }
}

/// Feeds the watchdog if sensor, instrument, every running port and the thread executor have each sent a heartbeat
/// since the last check.
pub async fn run(links: &Links, mut watchdog: impl Watchdog) -> ! {
    let mut before = links.heartbeat_counts();
    loop {
        Timer::after(LOOK).await;
        let now = links.heartbeat_counts();
        if all_sent_heartbeats(&before, &now) {
            watchdog.feed();
        }
        before = now;
    }
}

/// Whether each task has sent a heartbeat; a port after the first is exempt until its first one.
fn all_sent_heartbeats(before: &[u32; HEARTBEATS], now: &[u32; HEARTBEATS]) -> bool {
    let does_not_run = |i: usize, beat: u32| i >= ALWAYS_THERE && beat == 0;
    now.iter().zip(before).enumerate().all(|(i, (now, before))| now != before || does_not_run(i, *now))
}

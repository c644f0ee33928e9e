//! Feeds the watchdog while the tasks that make headings live, and those below them get their turn.

use embassy_time::{Duration, Timer};

use super::links::{ALWAYS_THERE, HEARTBEATS, count};
use super::{Links, Watchdog};

/// Between two looks. The slowest sign of life is that of a sensor that does not answer.
const LOOK: Duration = Duration::from_millis(700);

/// The lower executor shows life so often. Its longest stretch without a wait is a step of a solve, 0.1 s.
const PULSE: Duration = Duration::from_millis(200);

/// The hardware's period must be longer than this, microseconds: a look that finds life feeds it, and a look in vain is
/// allowed.
pub const LONGEST_WITHOUT_FEED_US: u64 = 2 * LOOK.as_micros();

const _: () = assert!(LOOK.as_millis() > super::sensor::LONGEST_SILENCE_MS && LOOK.as_millis() > 2 * PULSE.as_millis());

/// Shows that the executor this runs on gets round: a task that does not give way would stop it.
pub async fn pulse(links: &Links) -> ! {
    loop {
        count(&links.heartbeats.below);
        Timer::after(PULSE).await;
    }
}

/// Feeds when sensor, instrument, every port that runs and the lower executor have each shown life since the
/// last look, and only then.
pub async fn run(links: &Links, mut watchdog: impl Watchdog) -> ! {
    let mut before = links.life();
    loop {
        Timer::after(LOOK).await;
        let now = links.life();
        if all_live(&before, &now) {
            watchdog.feed();
        }
        before = now;
    }
}

/// Whether each has shown life; of the ports after the first, those that ever have.
fn all_live(before: &[u32; HEARTBEATS], now: &[u32; HEARTBEATS]) -> bool {
    let does_not_run = |i: usize, beat: u32| i >= ALWAYS_THERE && beat == 0;
    now.iter().zip(before).enumerate().all(|(i, (now, before))| now != before || does_not_run(i, *now))
}

//! Feeds the watchdog while the tasks that make headings live.

use embassy_time::{Duration, Timer};

use super::{Links, Watchdog};

/// Between two looks. The slowest sign of life, a sensor that does not answer, comes every 600 ms; the hardware's
/// period must be twice this and more.
const LOOK: Duration = Duration::from_millis(700);

/// Feeds when sensor, attitude and stream have each shown life since the last look, and only then.
pub async fn run(links: &Links, mut watchdog: impl Watchdog) -> ! {
    let mut before = links.heartbeats.snapshot();
    loop {
        Timer::after(LOOK).await;
        let now = links.heartbeats.snapshot();
        if now.iter().zip(&before).all(|(now, before)| now != before) {
            watchdog.feed();
        }
        before = now;
    }
}

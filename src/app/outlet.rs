//! Runs an outlet: waits for estimates and writes what it makes of them, at its own pace.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::Write;

use super::Links;
use super::links::{count, listen};
use crate::outlet::{Message, Outlet, Pace};
use crate::settings::Settings;

/// A port that does not take a message within this time has something wrong with it.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// Runs the outlet at a port for ever.
pub async fn run(links: &Links, mut outlet: impl Outlet, mut tx: impl Write) -> ! {
    let mut estimates = listen(&links.estimates);
    let mut changes = listen(&links.settings);
    let heartbeat = links.heartbeats.outlet_begins();
    let mut settings = Settings::DEFAULT;
    let mut pace = Pace::new();
    loop {
        // One comes for every reading, and in the sensor's silence, too.
        let estimate = estimates.changed().await;
        count(heartbeat);
        if let Some(changed) = changes.try_changed() {
            settings = changed;
        }
        let is_due = outlet.rate_hz(&settings).is_some_and(|rate_hz| pace.is_due(estimate.at, rate_hz));
        if !is_due {
            continue;
        }
        let mut message = Message::new();
        outlet.tell(&estimate, &settings, &mut message);
        count(&links.counters.messages);
        if estimate.heading.is_err() {
            count(&links.counters.messages_empty);
        }
        if !matches!(with_timeout(WRITE_PATIENCE, tx.write_all(&message)).await, Ok(Ok(()))) {
            count(&links.counters.write_errors);
        }
    }
}

//! Listens to the autopilot.

use embassy_time::{Duration, Timer, with_timeout};
use embedded_io_async::Read;

use super::Links;
use super::links::{Stamped, count, now, publish};
use crate::attitude::Senders;
use crate::wire::mavlink::{Message, Receiver};

/// The task shows life so often on a silent line.
const SILENCE: Duration = Duration::from_millis(100);

/// A line in error is left alone for a byte or two, so that it cannot take all the time there is.
const PAUSE: Duration = Duration::from_micros(200);

/// Reads bytes for ever and passes on the reports in them.
pub async fn run(links: &Links, mut rx: impl Read) -> ! {
    let mut receiver = Receiver::new();
    let mut senders = Senders::new();
    let mut bytes = [0; 64];
    loop {
        match with_timeout(SILENCE, rx.read(&mut bytes)).await {
            Ok(Ok(read)) if read > 0 => {
                take(links, &mut receiver, &mut senders, bytes.get(..read).unwrap_or_default());
            }
            Ok(_) => {
                count(&links.counters.attitude_line_errors);
                Timer::after(PAUSE).await;
            }
            Err(_silent) => {}
        }
        publish(&links.armed, senders.is_armed(now()));
        count(&links.heartbeats.attitude);
    }
}

fn take(links: &Links, receiver: &mut Receiver, senders: &mut Senders, bytes: &[u8]) {
    let rejected_before = receiver.rejected;
    for message in bytes.iter().filter_map(|&byte| receiver.push(byte)) {
        let at = now();
        match message {
            Message::Heartbeat(heartbeat) => senders.hear(at, heartbeat),
            Message::Attitude(report) if senders.takes(at, report.source) => {
                count(&links.counters.attitude_reports);
                links.offer(&links.reports, Stamped { at, value: report });
            }
            Message::Attitude(_) => count(&links.counters.attitude_foreign),
            _ => {}
        }
    }
    let rejected = receiver.rejected.wrapping_sub(rejected_before);
    links.counters.attitude_rejected.fetch_add(rejected, core::sync::atomic::Ordering::Relaxed);
}

//! Safe mode, after repeated panics: the console answers, the ports report the mode, and nothing else runs, except for
//! the node of a CAN bus ([`can`](super::can)), by which the firmware can be replaced. No other code is executed that
//! depends on stored data, retained samples, the sensor or received messages, because one of them is the probable
//! cause.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Ticker, with_timeout};
use embedded_io_async::Write;
use embedded_storage_async::nor_flash::NorFlash;

use super::task_links::CommandSource;
use crate::app::task_links::TaskLinks;
use crate::app::watchdog::Watchdog;
use crate::port::{SafeModeReporter, TransmitBuffer};
use autoswing_module::compass::{Command, ModuleState, Reply};
use autoswing_module::messages::{Message, Refusal};
use autoswing_module::settings::PORT_COUNT;
use autoswing_module::store::{Store, StoreError};

/// Interval of reports, and of feeding the watchdog.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);

/// Timeout of a report on a port that accepts no bytes.
const WRITE_TIMEOUT: Duration = Duration::from_millis(100);

/// Timeout of erasing the store; as long as that of a save.
const ERASE_TIMEOUT: Duration = Duration::from_millis(500);

const _: () = assert!(
    REPORT_INTERVAL.as_micros() + PORT_COUNT as u64 * WRITE_TIMEOUT.as_micros() + ERASE_TIMEOUT.as_micros()
        <= super::watchdog::MAX_FEED_INTERVAL_US
);

/// Answers the commands of console and CAN bus, reports on the ports and feeds the watchdog, for ever.
pub async fn run_safe_mode<F: NorFlash, const PORTS: usize>(
    links: &TaskLinks,
    mut store: Store<F>,
    mut ports: [impl Write; PORTS],
    mut watchdog: impl Watchdog,
) -> ! {
    const { assert!(PORTS <= PORT_COUNT) };
    links.broadcast_message(&Message::SafeMode);
    let mut ticker = Ticker::every(REPORT_INTERVAL);
    let mut reporter = SafeModeReporter::default();
    let mut output = TransmitBuffer::default();
    loop {
        match select(links.commands.receive(), ticker.next()).await {
            Either::First((source, command)) => {
                let reply = match command {
                    Command::Status | Command::StatusAll => Ok(Reply::SafeMode),
                    // A person at the console may restart it, a node of the bus not in flight.
                    Command::Restart if source != CommandSource::Console && links.is_armed() == Some(true) => {
                        Err(Refusal::Armed)
                    }
                    Command::Restart => {
                        links.restart_request.signal(());
                        Ok(Reply::SafeMode)
                    }
                    Command::CalClear => with_timeout(ERASE_TIMEOUT, store.erase_all())
                        .await
                        .unwrap_or(Err(StoreError::Timeout))
                        .map(|()| Reply::Done(ModuleState::Uncalibrated))
                        .map_err(Refusal::Store),
                    _ => Err(Refusal::SafeMode),
                };
                links.send_reply(source, command, reply);
            }
            Either::Second(()) => {
                watchdog.feed();
                reporter.report_safe_mode(&mut output);
                for port in &mut ports {
                    let _ = with_timeout(WRITE_TIMEOUT, port.write_all(output.pending_bytes())).await;
                }
                output.consume_bytes(usize::MAX);
            }
        }
    }
}

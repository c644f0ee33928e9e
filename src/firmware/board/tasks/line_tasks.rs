//! Tasks of the lines: console and ports.

use autoswing_firmware::app::{self, TaskLinks};
use autoswing_firmware::health::ResetCause;
use autoswing_module::settings::PortNumber;
use embassy_executor::{SpawnError, SpawnToken};

use crate::board::chosen::{Platform, UartRx, UartTx};

/// Number of ports of the selected board.
const PORT_TASK_COUNT: usize =
    if cfg!(feature = "board-holybro-rm3100") { 1 } else { autoswing_module::settings::PORT_COUNT };

/// Infallible: each task has as many instances as are spawned.
pub fn expect_spawn_token<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.expect("one task of each")
}

#[embassy_executor::task(pool_size = PORT_TASK_COUNT)]
pub async fn port_task(links: &'static TaskLinks, number: PortNumber, tx: UartTx, rx: UartRx) -> ! {
    app::port::run_port(links, number, rx, tx).await
}

#[embassy_executor::task]
pub async fn console_task(
    links: &'static TaskLinks,
    rx: UartRx,
    tx: UartTx,
    platform: Platform,
    reset_cause: ResetCause,
) -> ! {
    app::console::run_console(links, rx, tx, platform, reset_cause).await
}

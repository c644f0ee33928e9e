//! UARTs of a board with one for each port and one for the console.

use autoswing::app::TaskLinks;
use autoswing::health::ResetCause;
use autoswing::settings::{PORT_COUNT, PortNumber};
use embassy_executor::SendSpawner;

use super::line_tasks::{console_task, expect_spawn_token, port_task};
use crate::board::chosen::{Platform, UartTx, Uarts};

/// Ports that report safe mode.
pub const SAFE_MODE_PORTS: usize = PORT_COUNT;

/// Spawns the console on `below`, the ports on `above`.
pub fn spawn_uart_tasks(
    links: &'static TaskLinks,
    (above, below): (SendSpawner, SendSpawner),
    uarts: Uarts,
    (platform, reset): (Platform, ResetCause),
) {
    let (tx, rx) = uarts.console_uart;
    below.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset)));
    for (number, (tx, rx)) in PortNumber::ALL_PORTS.into_iter().zip(uarts.port_uarts) {
        above.spawn(expect_spawn_token(port_task(links, number, tx, rx)));
    }
}

/// Spawns the console alone; returns the transmitters of the ports.
pub fn spawn_in_safe_mode(
    links: &'static TaskLinks,
    below: SendSpawner,
    uarts: Uarts,
    (platform, reset): (Platform, ResetCause),
) -> [UartTx; SAFE_MODE_PORTS] {
    let (tx, rx) = uarts.console_uart;
    below.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset)));
    uarts.port_uarts.map(|(tx, _)| tx)
}

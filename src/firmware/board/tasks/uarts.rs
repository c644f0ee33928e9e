//! UARTs of a board with one for each port and one for the console.

use autoswing_firmware::app::TaskLinks;
use autoswing_firmware::health::ResetCause;
use autoswing_module::settings::{PORT_COUNT, PortNumber};
use embassy_executor::SendSpawner;

use super::line_tasks::{console_task, expect_spawn_token, port_task};
use crate::board::chosen::{Platform, UartTx, Uarts};

/// Ports that report safe mode.
pub const SAFE_MODE_PORT_COUNT: usize = PORT_COUNT;

/// Spawns the console on `slow_spawner`, the ports on `heading_spawner`.
pub fn spawn_uart_tasks(
    links: &'static TaskLinks,
    (heading_spawner, slow_spawner): (SendSpawner, SendSpawner),
    uarts: Uarts,
    (platform, reset_cause): (Platform, ResetCause),
) {
    let (tx, rx) = uarts.console_uart;
    slow_spawner.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset_cause)));
    for (number, (tx, rx)) in PortNumber::ALL_PORTS.into_iter().zip(uarts.port_uarts) {
        heading_spawner.spawn(expect_spawn_token(port_task(links, number, tx, rx)));
    }
}

/// Spawns the console alone; returns the transmitters of the ports.
pub fn spawn_in_safe_mode(
    links: &'static TaskLinks,
    slow_spawner: SendSpawner,
    uarts: Uarts,
    (platform, reset_cause): (Platform, ResetCause),
) -> [UartTx; SAFE_MODE_PORT_COUNT] {
    let (tx, rx) = uarts.console_uart;
    slow_spawner.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset_cause)));
    uarts.port_uarts.map(|(tx, _)| tx)
}

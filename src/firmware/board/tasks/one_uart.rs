//! The only UART of a board: the console, or port 1 once a protocol is selected for it.

use autoswing_firmware::app::{self, TaskLinks};
use autoswing_firmware::health::ResetCause;
use autoswing_module::settings::PortNumber;
use embassy_executor::SendSpawner;

use super::line_tasks::{console_task, expect_spawn_token, port_task};
use crate::board::chosen::{Platform, UartRx, UartTx, Uarts};

/// Number of ports that report safe mode: none, because the only UART is the console then.
pub const SAFE_MODE_PORT_COUNT: usize = 0;

/// Spawns the port on `heading_spawner`, or the console on `slow_spawner`.
pub fn spawn_uart_tasks(
    links: &'static TaskLinks,
    spawners: (SendSpawner, SendSpawner),
    uart: Uarts,
    (platform, reset_cause): (Platform, ResetCause),
) {
    spawners.1.spawn(expect_spawn_token(uart_task(links, spawners, uart, platform, reset_cause)));
}

/// Spawns the console, whatever is selected for the UART.
pub fn spawn_in_safe_mode(
    links: &'static TaskLinks,
    slow_spawner: SendSpawner,
    (tx, rx): Uarts,
    (platform, reset_cause): (Platform, ResetCause),
) -> [UartTx; SAFE_MODE_PORT_COUNT] {
    slow_spawner.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset_cause)));
    []
}

#[embassy_executor::task]
async fn uart_task(
    links: &'static TaskLinks,
    spawners: (SendSpawner, SendSpawner),
    line: (UartTx, UartRx),
    platform: Platform,
    reset_cause: ResetCause,
) {
    let ((heading_spawner, slow_spawner), (tx, rx)) = (spawners, line);
    if app::port::has_protocol(links, PortNumber::One).await {
        heading_spawner.spawn(expect_spawn_token(port_task(links, PortNumber::One, tx, rx)));
        app::console::restart_without_terminal(links, platform).await;
    } else {
        slow_spawner.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset_cause)));
    }
}

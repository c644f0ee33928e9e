//! Lines of a board with a CAN bus and one UART: the console, or port 1 once a protocol is selected for it.

use autoswing::app::{self, TaskLinks};
use autoswing::health::ResetCause;
use autoswing::settings::PortNumber;
use embassy_executor::SendSpawner;

use super::line_tasks::{console_task, expect_spawn_token, port_task};
use crate::board::chosen::{BoardLines, CanBus, Platform, UartRx, UartTx};

/// Number of ports that report safe mode: none, because the only UART is the console then.
pub const SAFE_MODE_PORTS: usize = 0;

/// Spawns CAN bus and port on `above`, the console on `below`.
pub fn spawn_line_tasks(
    links: &'static TaskLinks,
    (above, below): (SendSpawner, SendSpawner),
    lines: BoardLines,
    (platform, reset): (Platform, ResetCause),
) {
    above.spawn(expect_spawn_token(can_task(links, lines.can_bus, false)));
    below.spawn(expect_spawn_token(uart_task(links, (above, below), lines.uart, platform, reset)));
}

/// Spawns the console, whatever is selected for the UART, and the CAN bus, by which the firmware can be replaced.
pub fn spawn_in_safe_mode(
    links: &'static TaskLinks,
    below: SendSpawner,
    lines: BoardLines,
    (platform, reset): (Platform, ResetCause),
) -> [UartTx; SAFE_MODE_PORTS] {
    let (tx, rx) = lines.uart;
    below.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset)));
    below.spawn(expect_spawn_token(can_task(links, lines.can_bus, true)));
    []
}

#[embassy_executor::task]
async fn can_task(links: &'static TaskLinks, bus: CanBus, is_safe_mode: bool) -> ! {
    let CanBus { node_info: info, rx, tx, boot_loader } = bus;
    app::can::run_can(links, info, rx, tx, boot_loader, is_safe_mode).await
}

#[embassy_executor::task]
async fn uart_task(
    links: &'static TaskLinks,
    spawners: (SendSpawner, SendSpawner),
    line: (UartTx, UartRx),
    platform: Platform,
    reset: ResetCause,
) {
    let ((above, below), (tx, rx)) = (spawners, line);
    if app::port::has_protocol(links, PortNumber::One).await {
        above.spawn(expect_spawn_token(port_task(links, PortNumber::One, tx, rx)));
        app::console::restart_without_terminal(links, platform).await;
    } else {
        below.spawn(expect_spawn_token(console_task(links, rx, tx, platform, reset)));
    }
}

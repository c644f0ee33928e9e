//! Concrete tasks of all boards: the library's tasks with the selected board's types.

#[cfg(not(feature = "board-mps2-an386"))]
mod can;
mod line_tasks;
#[cfg(feature = "board-holybro-rm3100")]
mod one_uart;
#[cfg(not(feature = "board-holybro-rm3100"))]
mod uarts;

#[cfg(feature = "board-holybro-rm3100")]
use one_uart as board_uarts;
#[cfg(not(feature = "board-holybro-rm3100"))]
use uarts as board_uarts;

use autoswing::app::{self, TaskLinks};
use autoswing::collection::RetainedSamples;
use autoswing::store::Store;
use embassy_executor::SendSpawner;
use static_cell::StaticCell;

use super::chosen::{Hardware, Magnetometer, Panel, StoreFlash, UartTx, Watchdog};
use super::sample_memory;
use board_uarts::SAFE_MODE_PORTS;
use line_tasks::expect_spawn_token;

/// Initialised at run time, so that `.data` costs no flash.
static LINKS: StaticCell<TaskLinks> = StaticCell::new();

/// Spawns all tasks: heading tasks on the executor `above`, which interrupts `below` with the slow tasks. In safe mode,
/// spawns the console, a CAN bus, and the task of that mode only.
pub fn spawn_all_tasks(above: SendSpawner, below: SendSpawner, hardware: Hardware) {
    let links = LINKS.init_with(TaskLinks::new);
    let region = hardware.flash.store_region();
    let store = Store::new(hardware.flash, region);
    let restart = (hardware.platform, hardware.reset_cause);
    let is_safe_mode = hardware.reset_cause.requires_safe_mode();
    #[cfg(not(feature = "board-mps2-an386"))]
    {
        let spawner = if is_safe_mode { below } else { above };
        spawner.spawn(expect_spawn_token(can::can_task(links, hardware.can_bus, is_safe_mode)));
    }
    if is_safe_mode {
        let ports = board_uarts::spawn_in_safe_mode(links, below, hardware.uarts, restart);
        below.spawn(expect_spawn_token(safe_mode(links, store, ports, hardware.watchdog)));
        return;
    }
    board_uarts::spawn_uart_tasks(links, (above, below), hardware.uarts, restart);
    above.spawn(expect_spawn_token(sensor_task(links, hardware.magnetometer)));
    above.spawn(expect_spawn_token(instrument_task(links)));
    above.spawn(expect_spawn_token(feed_watchdog(links, hardware.watchdog)));
    above.spawn(expect_spawn_token(panel_task(links, hardware.panel)));
    below.spawn(expect_spawn_token(compass_task(links, store, sample_memory::take_sample_memory())));
}

#[embassy_executor::task]
async fn sensor_task(links: &'static TaskLinks, magnetometer: Magnetometer) -> ! {
    app::sensor::run_sensor(links, magnetometer).await
}

#[embassy_executor::task]
async fn instrument_task(links: &'static TaskLinks) -> ! {
    app::instrument::run_instrument(links).await
}

#[embassy_executor::task]
async fn feed_watchdog(links: &'static TaskLinks, watchdog: Watchdog) -> ! {
    app::watchdog::run_watchdog(links, watchdog).await
}

#[embassy_executor::task]
async fn panel_task(links: &'static TaskLinks, panel: Panel) -> ! {
    app::panel::run_panel(links, panel).await
}

#[embassy_executor::task]
async fn compass_task(
    links: &'static TaskLinks,
    store: Store<StoreFlash>,
    retained: &'static mut RetainedSamples,
) -> ! {
    app::compass::run_compass(links, store, retained).await
}

#[embassy_executor::task]
async fn safe_mode(
    links: &'static TaskLinks,
    store: Store<StoreFlash>,
    ports: [UartTx; SAFE_MODE_PORTS],
    watchdog: Watchdog,
) -> ! {
    app::safe_mode::run_safe_mode(links, store, ports, watchdog).await
}

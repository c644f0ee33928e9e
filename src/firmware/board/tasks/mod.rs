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

use autoswing::collection::RetainedSamples;
use autoswing_firmware::app::{self, TaskLinks};
use autoswing_module::store::Store;
use embassy_executor::SendSpawner;
use static_cell::StaticCell;

use super::chosen::{Hardware, Magnetometer, Panel, StoreFlash, UartTx, Watchdog};
use super::sample_memory;
use board_uarts::SAFE_MODE_PORT_COUNT;
use line_tasks::expect_spawn_token;

/// Connections of all tasks; initialised at run time, so that `.data` costs no flash.
static TASK_LINKS: StaticCell<TaskLinks> = StaticCell::new();

/// Spawns all tasks: the heading tasks on one executor, which interrupts that of the slow tasks. In safe mode, spawns
/// only the console, the task of a CAN bus, and that of safe mode.
pub fn spawn_all_tasks(heading_spawner: SendSpawner, slow_spawner: SendSpawner, hardware: Hardware) {
    let links = TASK_LINKS.init_with(TaskLinks::new);
    let region = hardware.flash.store_region();
    let store = Store::new(hardware.flash, region);
    let restart = (hardware.platform, hardware.reset_cause);
    let is_safe_mode = hardware.reset_cause.requires_safe_mode();
    #[cfg(not(feature = "board-mps2-an386"))]
    {
        let spawner = if is_safe_mode { slow_spawner } else { heading_spawner };
        spawner.spawn(expect_spawn_token(can::can_task(links, hardware.can_bus, is_safe_mode)));
    }
    if is_safe_mode {
        let ports = board_uarts::spawn_in_safe_mode(links, slow_spawner, hardware.uarts, restart);
        slow_spawner.spawn(expect_spawn_token(safe_mode_task(links, store, ports, hardware.watchdog)));
        return;
    }
    board_uarts::spawn_uart_tasks(links, (heading_spawner, slow_spawner), hardware.uarts, restart);
    heading_spawner.spawn(expect_spawn_token(sensor_task(links, hardware.magnetometer)));
    #[cfg(feature = "board-b-l475e-iot01a")]
    heading_spawner.spawn(expect_spawn_token(inertial_sensor_task(links, hardware.inertial_sensor)));
    heading_spawner.spawn(expect_spawn_token(instrument_task(links)));
    heading_spawner.spawn(expect_spawn_token(watchdog_task(links, hardware.watchdog)));
    heading_spawner.spawn(expect_spawn_token(panel_task(links, hardware.panel)));
    slow_spawner.spawn(expect_spawn_token(compass_task(links, store, sample_memory::take_sample_memory())));
}

#[embassy_executor::task]
async fn sensor_task(links: &'static TaskLinks, magnetometer: Magnetometer) -> ! {
    app::sensor::run_sensor(links, magnetometer).await
}

#[cfg(feature = "board-b-l475e-iot01a")]
#[embassy_executor::task]
async fn inertial_sensor_task(links: &'static TaskLinks, sensor: super::chosen::InertialSensor) -> ! {
    app::inertial::run_inertial_sensor(links, sensor).await
}

#[embassy_executor::task]
async fn instrument_task(links: &'static TaskLinks) -> ! {
    app::instrument::run_instrument(links).await
}

#[embassy_executor::task]
async fn watchdog_task(links: &'static TaskLinks, watchdog: Watchdog) -> ! {
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
async fn safe_mode_task(
    links: &'static TaskLinks,
    store: Store<StoreFlash>,
    ports: [UartTx; SAFE_MODE_PORT_COUNT],
    watchdog: Watchdog,
) -> ! {
    app::safe_mode::run_safe_mode(links, store, ports, watchdog).await
}

//! Concrete tasks of all boards: the library's tasks with the selected board's types.

use autoswing::app::{self, Links};
use autoswing::collection::RetainedSamples;
use autoswing::health::ResetCause;
use autoswing::settings::{PORT_COUNT, PortNumber};
use autoswing::store::Store;
use embassy_executor::{SendSpawner, SpawnError, SpawnToken};
use static_cell::StaticCell;

use super::chosen::{Hardware, Magnetometer, Panel, Platform, StoreFlash, UartRx, UartTx, Watchdog};
use super::kept;

/// Initialised at run time, so that `.data` costs no flash.
static LINKS: StaticCell<Links> = StaticCell::new();

/// Spawns all tasks: heading tasks on the executor `above`, which interrupts `below` with the slow tasks. In safe mode,
/// spawns the console and the task of that mode only.
pub fn spawn(above: SendSpawner, below: SendSpawner, hardware: Hardware) {
    let links = LINKS.init_with(Links::new);
    let region = hardware.flash.region();
    let store = Store::new(hardware.flash, region);
    let (console_tx, console_rx) = hardware.console;
    below.spawn(spawned(console(links, console_rx, console_tx, hardware.platform, hardware.reset)));
    if hardware.reset.requires_safe_mode() {
        below.spawn(spawned(safe_mode(links, store, hardware.ports.map(|(tx, _)| tx), hardware.watchdog)));
        return;
    }
    above.spawn(spawned(sensor(links, hardware.magnetometer)));
    above.spawn(spawned(instrument(links)));
    for (number, (tx, rx)) in PortNumber::ALL.into_iter().zip(hardware.ports) {
        above.spawn(spawned(port(links, number, tx, rx)));
    }
    above.spawn(spawned(watch(links, hardware.watchdog)));
    above.spawn(spawned(panel(links, hardware.panel)));
    below.spawn(spawned(compass(links, store, kept::lend())));
}

/// Infallible: each task has as many instances as are spawned.
fn spawned<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.expect("one task of each")
}

#[embassy_executor::task]
async fn sensor(links: &'static Links, magnetometer: Magnetometer) -> ! {
    app::sensor::run(links, magnetometer).await
}

#[embassy_executor::task]
async fn instrument(links: &'static Links) -> ! {
    app::instrument::run(links).await
}

#[embassy_executor::task(pool_size = PORT_COUNT)]
async fn port(links: &'static Links, number: PortNumber, tx: UartTx, rx: UartRx) -> ! {
    app::port::run(links, number, rx, tx).await
}

#[embassy_executor::task]
async fn watch(links: &'static Links, watchdog: Watchdog) -> ! {
    app::watchdog::run(links, watchdog).await
}

#[embassy_executor::task]
async fn panel(links: &'static Links, panel: Panel) -> ! {
    app::panel::run(links, panel).await
}

#[embassy_executor::task]
async fn compass(links: &'static Links, store: Store<StoreFlash>, retained: &'static mut RetainedSamples) -> ! {
    app::compass::run(links, store, retained).await
}

#[embassy_executor::task]
async fn console(links: &'static Links, rx: UartRx, tx: UartTx, platform: Platform, reset: ResetCause) -> ! {
    app::console::run(links, rx, tx, platform, reset).await
}

#[embassy_executor::task]
async fn safe_mode(
    links: &'static Links,
    store: Store<StoreFlash>,
    ports: [UartTx; PORT_COUNT],
    watchdog: Watchdog,
) -> ! {
    app::safe_mode::run(links, store, ports, watchdog).await
}

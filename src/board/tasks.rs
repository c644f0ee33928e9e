//! The tasks of the library with the types of the board that is chosen, as the executor wants them: concrete. This is
//! the one list of them, for all boards.

use autoswing::app::{self, Links};
use autoswing::collection::Kept;
use autoswing::health::ResetCause;
use autoswing::settings::{PORTS, PortNumber};
use autoswing::store::Store;
use embassy_executor::{SendSpawner, SpawnError, SpawnToken};

use super::chosen::{Magnetometer, Panel, Platform, StoreFlash, UartRx, UartTx, Watchdog};
use super::kept;

static LINKS: Links = Links::new();

/// What a board brings up for the tasks.
pub struct Hardware {
    pub magnetometer: Magnetometer,
    /// The autopilot's, and an instrument's.
    pub ports: [(UartTx, UartRx); PORTS],
    pub console: (UartTx, UartRx),
    pub watchdog: Watchdog,
    pub panel: Panel,
    pub flash: StoreFlash,
    pub platform: Platform,
    /// Why the module started.
    pub reset: ResetCause,
}

/// Spawns all tasks: those that make headings above, on an executor that interrupts the other, those that may take long
/// below.
pub fn spawn(above: SendSpawner, below: SendSpawner, hardware: Hardware) {
    above.spawn(spawned(sensor(hardware.magnetometer)));
    above.spawn(spawned(instrument()));
    for (number, (tx, rx)) in PortNumber::ALL.into_iter().zip(hardware.ports) {
        above.spawn(spawned(port(number, tx, rx)));
    }
    above.spawn(spawned(watch(hardware.watchdog)));
    above.spawn(spawned(panel(hardware.panel)));

    let region = hardware.flash.region();
    let (console_tx, console_rx) = hardware.console;
    below.spawn(spawned(compass(Store::new(hardware.flash, region), kept::lend())));
    below.spawn(spawned(console(console_rx, console_tx, hardware.platform, hardware.reset)));
    below.spawn(spawned(pulse()));
}

/// Each task is spawned once, and a port's once for each port; there is room for them, so this cannot fail.
pub fn spawned<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.expect("one task of each")
}

#[embassy_executor::task]
async fn sensor(magnetometer: Magnetometer) -> ! {
    app::sensor::run(&LINKS, magnetometer).await
}

#[embassy_executor::task]
async fn instrument() -> ! {
    app::instrument::run(&LINKS).await
}

#[embassy_executor::task(pool_size = PORTS)]
async fn port(number: PortNumber, tx: UartTx, rx: UartRx) -> ! {
    app::port::run(&LINKS, number, rx, tx).await
}

#[embassy_executor::task]
async fn watch(watchdog: Watchdog) -> ! {
    app::watchdog::run(&LINKS, watchdog).await
}

#[embassy_executor::task]
async fn panel(panel: Panel) -> ! {
    app::panel::run(&LINKS, panel).await
}

#[embassy_executor::task]
async fn pulse() -> ! {
    app::watchdog::pulse(&LINKS).await
}

#[embassy_executor::task]
async fn compass(store: Store<StoreFlash>, kept: &'static mut Kept) -> ! {
    app::compass::run(&LINKS, store, kept).await
}

#[embassy_executor::task]
async fn console(rx: UartRx, tx: UartTx, platform: Platform, reset: ResetCause) -> ! {
    app::console::run(&LINKS, rx, tx, platform, reset).await
}

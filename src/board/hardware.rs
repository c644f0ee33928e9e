//! Hardware that a board initialises for the tasks.

use autoswing::health::ResetCause;
use autoswing::settings::PORT_COUNT;

/// Initialised hardware for the tasks, in the types of a board.
pub struct Hardware<Magnetometer, UartTx, UartRx, Watchdog, Panel, StoreFlash, Platform> {
    pub magnetometer: Magnetometer,
    /// Autopilot port and instrument port.
    pub ports: [(UartTx, UartRx); PORT_COUNT],
    pub console: (UartTx, UartRx),
    pub watchdog: Watchdog,
    pub panel: Panel,
    pub flash: StoreFlash,
    pub platform: Platform,
    /// Reason for the last start.
    pub reset: ResetCause,
}

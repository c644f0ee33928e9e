//! Hardware that a board initialises for the tasks.

use autoswing::health::ResetCause;

/// Initialised hardware for the tasks, in the types of a board.
pub struct Hardware<Magnetometer, Lines, Watchdog, Panel, StoreFlash, Platform> {
    pub magnetometer: Magnetometer,
    pub board_lines: Lines,
    pub watchdog: Watchdog,
    pub panel: Panel,
    pub flash: StoreFlash,
    pub platform: Platform,
    /// Reason for the last start.
    pub reset_cause: ResetCause,
}

/// CAN bus, and a UART: the console, or port 1.
#[cfg(feature = "board-holybro-rm3100")]
pub struct CanAndUart<CanBus, UartTx, UartRx> {
    pub can_bus: CanBus,
    pub uart: (UartTx, UartRx),
}

/// UARTs of a board without a CAN bus.
#[cfg(not(feature = "board-holybro-rm3100"))]
pub struct Uarts<UartTx, UartRx> {
    /// Autopilot port and instrument port.
    pub port_uarts: [(UartTx, UartRx); autoswing::settings::PORT_COUNT],
    pub console_uart: (UartTx, UartRx),
}

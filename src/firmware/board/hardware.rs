//! Hardware that a board initialises for the tasks.

use autoswing_firmware::health::ResetCause;

/// Initialised hardware for the tasks, in the types of a board.
pub struct Hardware<Magnetometer, InertialSensor, Uarts, CanBus, Watchdog, Panel, StoreFlash, Platform> {
    pub magnetometer: Magnetometer,
    /// Gyro and accelerometer; `()` on a board without them.
    #[cfg_attr(not(feature = "board-b-l475e-iot01a"), expect(dead_code, reason = "the other boards have none"))]
    pub inertial_sensor: InertialSensor,
    pub uarts: Uarts,
    /// CAN bus; `()` on a board without a CAN controller.
    #[cfg_attr(
        feature = "board-mps2-an386",
        expect(dead_code, reason = "QEMU has no CAN controller for this machine")
    )]
    pub can_bus: CanBus,
    pub watchdog: Watchdog,
    pub panel: Panel,
    pub flash: StoreFlash,
    pub platform: Platform,
    /// Reason for the last start.
    pub reset_cause: ResetCause,
}

/// CAN bus, and what the node on it reports.
#[cfg(not(feature = "board-mps2-an386"))]
pub struct CanBus<Receiver, Sender, BootLoader> {
    pub node_info: autoswing_firmware::wire::dronecan::outbound::NodeInfo,
    pub rx: Receiver,
    pub tx: Sender,
    pub boot_loader: BootLoader,
}

/// A UART for each port, and one for the console.
#[cfg(not(feature = "board-holybro-rm3100"))]
pub struct PortAndConsoleUarts<UartTx, UartRx> {
    /// Autopilot port and instrument port.
    pub port_uarts: [(UartTx, UartRx); autoswing_module::settings::PORT_COUNT],
    pub console_uart: (UartTx, UartRx),
}

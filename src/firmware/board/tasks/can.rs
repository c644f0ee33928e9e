//! Task of the CAN bus.

use autoswing_firmware::app::{self, TaskLinks};

use crate::board::chosen::CanBus;

/// Runs the node of the bus. In safe mode the firmware can be replaced by it, on a board with a boot loader for that.
#[embassy_executor::task]
pub async fn can_task(links: &'static TaskLinks, bus: CanBus, is_safe_mode: bool) -> ! {
    let CanBus { node_info: info, rx, tx, boot_loader } = bus;
    app::can::run_can(links, info, rx, tx, boot_loader, is_safe_mode).await
}

//! Interface to a heading module in a vehicle: simulated ([`Rig`](crate::rig::Rig)), or its ARM code in an emulator.

use crate::devices::uart::HostEnd;
use crate::world::World;

/// Reason for which [`Module::run_until`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModuleRunEnd {
    /// The requested time was reached.
    Time,
    /// Power was cut; [`Rig::power_on`](crate::rig::Rig::power_on) restores it.
    PowerCut,
    /// The module cannot be run any further; the implementation knows the reason.
    Failed,
}

/// Duration of a rest, seconds.
const REST_S: f64 = 5.0;

/// Heading module in a vehicle.
pub trait Module {
    /// The surrounding world.
    fn world(&self) -> &World;

    /// Host end of the console's cable.
    fn console_cable(&self) -> &HostEnd;

    /// Host end of the autopilot's cable.
    fn autopilot_cable(&self) -> &HostEnd;

    /// Host end of the instrument's cable.
    fn instrument_cable(&self) -> &HostEnd;

    /// Time since the start of the simulation, microseconds.
    fn now_us(&self) -> u64;

    /// Advances simulation time to `until_us`.
    fn run_until(&mut self, until_us: u64) -> ModuleRunEnd;

    /// Resets the module by its reset pin; it starts when time advances.
    fn reset_module(&mut self);

    /// Advances simulation time by `seconds`.
    fn run_for_s(&mut self, seconds: f64) -> ModuleRunEnd {
        self.run_until(self.now_us() + (seconds * 1e6) as u64)
    }

    /// Stands still for some seconds, which shows the offset of the module's own gyro.
    fn rest(&mut self) {
        self.world().hold_still();
        self.run_for_s(REST_S);
        self.world().end_prescribed_motion();
    }

    /// Types a line on the console, waits for the answer and returns the printed text.
    fn send_console_line(&mut self, line: &str) -> String {
        self.console_cable().send_bytes(format!("{line}\r").as_bytes());
        // 64 characters and an answer of 1500 take 0.14 s at 115200 baud, a save with an erase 0.1 s.
        self.run_for_s(0.5);
        self.take_console_output()
    }

    /// Console output since the last call.
    fn take_console_output(&self) -> String {
        String::from_utf8_lossy(&self.console_cable().receive_bytes()).into_owned()
    }
}

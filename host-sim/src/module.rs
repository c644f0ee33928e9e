//! A heading module in an aircraft, as its pilot meets it: simulated ([`Rig`](crate::rig::Rig)) or emulated
//! ([`Emulator`](crate::emulator::Emulator)).

use crate::devices::uart::HostEnd;
use crate::world::World;

/// Why [`Module::run_until`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ran {
    /// The time asked for has come.
    Time,
    /// The power went; [`Rig::power_on`](crate::rig::Rig::power_on) brings it back.
    PowerCut,
    /// The emulator has ended, or does not answer: see
    /// [`Emulator::take_failure`](crate::emulator::Emulator::take_failure).
    Failed,
}

/// A module in an aircraft.
pub trait Module {
    /// The world it flies in.
    fn world(&self) -> &World;

    /// The far end of the console's cable.
    fn console(&self) -> &HostEnd;

    /// The far end of the autopilot's cable.
    fn autopilot(&self) -> &HostEnd;

    /// The far end of the instrument's cable.
    fn instrument(&self) -> &HostEnd;

    /// Microseconds since the simulation began.
    fn now_us(&self) -> u64;

    /// Flies on to a time.
    fn run_until(&mut self, until_us: u64) -> Ran;

    /// Flies on for some seconds.
    fn run_for_s(&mut self, seconds: f64) -> Ran {
        self.run_until(self.now_us() + (seconds * 1e6) as u64)
    }

    /// Types a line on the console, waits until the module has answered it, and gives what it printed.
    fn type_line(&mut self, line: &str) -> String {
        self.console().send(format!("{line}\r").as_bytes());
        // 64 characters there and 1500 back take 0.14 s at 115200 baud, a save with an erase 0.1 s.
        self.run_for_s(0.5);
        self.printed()
    }

    /// Takes what the console has printed since the last look.
    fn printed(&self) -> String {
        String::from_utf8_lossy(&self.console().receive()).into_owned()
    }
}

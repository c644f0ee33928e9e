//! Restart of the processor, and the largest use of its stack.

use autoswing_firmware::app;
use autoswing_firmware::health::StackUse;
use cortex_m::peripheral::SCB;

use crate::board::stack;

pub struct Platform;

impl app::Platform for Platform {
    fn reboot(&mut self) {
        SCB::sys_reset()
    }

    fn peak_stack_use(&self) -> Option<StackUse> {
        Some(stack::peak_use())
    }
}

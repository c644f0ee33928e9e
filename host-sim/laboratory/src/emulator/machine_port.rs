//! The machine's serial ports.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};
use simulator::devices::uart::{SerialCable, UartReceiver, UartTransmitter};
use testkit::simulation::{ExecutorLevel, Simulation};

use super::emulated_machine::MAX_STEP_BYTES;

/// Machine end of a cable; buffers received bytes until the machine stops.
pub struct MachinePort {
    to_machine: Rc<RefCell<VecDeque<u8>>>,
    to_cable: Rc<OutgoingBytes>,
}

#[derive(Default)]
struct OutgoingBytes {
    bytes: RefCell<Vec<u8>>,
    data_ready: Signal<NoopRawMutex, ()>,
}

impl MachinePort {
    pub fn new(cable: &SerialCable, simulation: &mut Simulation) -> Self {
        let (receiver, transmitter) = cable.module_ends();
        let wire = Self { to_machine: Rc::default(), to_cable: Rc::default() };
        simulation.spawn(ExecutorLevel::World, "to machine", forward_received(receiver, Rc::clone(&wire.to_machine)));
        simulation.spawn(ExecutorLevel::World, "from machine", forward_sent(transmitter, Rc::clone(&wire.to_cable)));
        wire
    }

    pub fn send_to_cable(&self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.to_cable.bytes.borrow_mut().extend_from_slice(bytes);
            self.to_cable.data_ready.signal(());
        }
    }

    /// Received bytes, up to the machine's limit per step.
    pub fn take_bytes_for_machine(&self) -> Vec<u8> {
        let mut waiting = self.to_machine.borrow_mut();
        let byte_count = waiting.len().min(MAX_STEP_BYTES);
        waiting.drain(..byte_count).collect()
    }
}

async fn forward_received(mut receiver: UartReceiver, to_machine: Rc<RefCell<VecDeque<u8>>>) {
    let mut buffer = [0; 64];
    loop {
        // Line errors are never injected here.
        if let Ok(read_count) = receiver.read(&mut buffer).await {
            to_machine.borrow_mut().extend(&buffer[..read_count]);
        }
    }
}

async fn forward_sent(mut transmitter: UartTransmitter, outgoing: Rc<OutgoingBytes>) {
    loop {
        outgoing.data_ready.wait().await;
        let bytes = outgoing.bytes.take();
        // A simulated cable never reports write errors.
        let _ = transmitter.write_all(&bytes).await;
    }
}

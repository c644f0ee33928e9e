//! Ports: serial lines to an autopilot or an instrument, and their protocols; the node on a CAN bus.
//!
//! A protocol performs no I/O. The task of a port (`app::port`) gives it received bytes and a snapshot of the
//! module's state, distributes the decoded messages, and writes its output. [`CanNode`] is the same for frames of a CAN
//! bus (`app::can`).

mod autopilot;
mod dronecan;
mod mavlink;
mod message_schedule;
mod msp;
mod nmea;
mod protocol_detection;
mod received_message;
mod safe_mode;
mod snapshot;
mod text_queue;
mod transmit_buffer;

pub use dronecan::{BOOT_LOADER_HANDOVER_LENGTH, CanNode, NodeContext, UpdateForBootLoader};
pub use mavlink::Mavlink;
pub use message_schedule::MessageSchedule;
pub use nmea::Nmea;
pub use protocol_detection::Port;
pub use received_message::ReceivedMessage;
pub use safe_mode::SafeModeReporter;
pub use snapshot::Snapshot;
pub use transmit_buffer::TransmitBuffer;

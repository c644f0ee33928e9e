//! DroneCAN (UAVCAN v0): frames of a CAN bus and the messages of a compass.
//!
//! Layouts and signatures are those of the DSDL definitions of github.com/dronecan/DSDL; frames and payloads are tested
//! with those of pydronecan. `canadensis` implements another version of the protocol, and the crate `dronecan` few of
//! the messages.

mod bit_stream;
mod frame;
mod inbound;
pub mod outbound;
mod receiver;
mod transfer;

pub use frame::{CanFrame, FrameHeader, NodeId, TRANSFER_ID_MASK, TransferKind, priority};
pub use inbound::{
    Allocation, BusMessage, GetSetRequest, GetSetValue, MAX_PATH_LENGTH, ParameterOpcode, Targetted, UNIQUE_ID_LENGTH,
};
pub use receiver::{InboundTransfer, MAX_RECEIVED_LENGTH, TransferReceiver};
pub use transfer::{DataType, OutboundTransfer, PAYLOAD_CAPACITY, Payload};

#[cfg(test)]
mod tests;

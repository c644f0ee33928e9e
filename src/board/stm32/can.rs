//! CAN controller FDCAN1: classic frames at 1 Mbit/s.
//!
//! It starts in restricted operation mode: it receives and acknowledges valid frames, but sends nothing, error frames
//! included, so that it does not disturb a bus at another bit rate, of which no frame is valid. Mere monitoring without
//! acknowledging would not do: the frames of a single other node would stay invalid. The first valid frame ends the
//! mode.

use autoswing::app::can::{ReceiveFrame, SendFrame};
use autoswing::wire::dronecan::CanFrame;
use embassy_stm32::can::config::{GlobalFilter, NonMatchingFilter, TxBufferMode};
use embassy_stm32::can::enums::BusError;
use embassy_stm32::can::{BufferedCanReceiver, BufferedCanSender, CanConfigurator, Frame, OperatingMode, RxBuf, TxBuf};
use embassy_stm32::gpio::Output;
use embassy_stm32::pac;
use embedded_can::Id;

/// Bit rate of DroneCAN on classic CAN, bit/s.
const BITS_PER_S: u32 = 1_000_000;

/// Capacity for received frames until the task reads them: 4 ms of a fully loaded bus. The controller itself holds
/// three.
const RECEIVE_CAPACITY: usize = 32;
/// Capacity for frames to send, besides the controller's three: the node has a queue of its own, in which a newer field
/// replaces an older one.
const SEND_CAPACITY: usize = 1;

pub struct CanBuffers {
    rx: RxBuf<RECEIVE_CAPACITY>,
    tx: TxBuf<SEND_CAPACITY>,
}

impl CanBuffers {
    pub const fn new() -> Self {
        Self { rx: RxBuf::new(), tx: TxBuf::new() }
    }
}

/// Starts a controller whose transceiver is on, in restricted mode.
pub fn start_controller(
    mut can: CanConfigurator<'static>,
    silent: Output<'static>,
    termination: Output<'static>,
    buffers: &'static mut CanBuffers,
) -> (CanReceiver, CanSender) {
    can.set_bitrate(BITS_PER_S);
    // Frames leave in the order of the node's queue: those of one transfer have the same identifier.
    let config =
        can.config().set_tx_buffer_mode(TxBufferMode::Fifo).set_automatic_bus_off_recovery(true).set_global_filter(
            GlobalFilter {
                handle_standard_frames: NonMatchingFilter::Reject,
                handle_extended_frames: NonMatchingFilter::IntoRxFifo0,
                reject_remote_standard_frames: true,
                reject_remote_extended_frames: true,
            },
        );
    can.set_config(config);
    let bus = can.start(OperatingMode::RestrictedOperationMode).buffered(&mut buffers.tx, &mut buffers.rx);
    let sender = CanSender { frames: bus.writer(), _silent: silent, termination };
    (CanReceiver { frames: bus.reader(), is_restricted: true }, sender)
}

pub struct CanReceiver {
    frames: BufferedCanReceiver,
    is_restricted: bool,
}

impl ReceiveFrame for CanReceiver {
    type Error = BusError;

    async fn receive_frame(&mut self) -> Result<CanFrame, BusError> {
        loop {
            let frame = self.frames.receive().await?.frame;
            if self.is_restricted {
                // Restricted operation mode may be left at any time (reference manual RM0440, FDCAN_CCCR).
                pac::FDCAN1.cccr().modify(|control| control.set_asm(false));
                self.is_restricted = false;
            }
            if let Id::Extended(id) = frame.id()
                && let Some(frame) = CanFrame::new(id.as_raw(), frame.data())
            {
                return Ok(frame);
            }
        }
    }
}

/// The pins keep their levels as long as they are owned.
pub struct CanSender {
    frames: BufferedCanSender,
    _silent: Output<'static>,
    termination: Output<'static>,
}

impl SendFrame for CanSender {
    type Error = BusError;

    async fn send_frame(&mut self, frame: &CanFrame) -> Result<(), BusError> {
        // Infallible: a `CanFrame` has at most 29 bits and eight bytes.
        if let Ok(frame) = Frame::new_extended(frame.frame_id(), frame.data()) {
            self.frames.write(frame).await;
        }
        Ok(())
    }

    fn set_termination(&mut self, is_on: bool) {
        self.termination.set_level(is_on.into());
    }
}

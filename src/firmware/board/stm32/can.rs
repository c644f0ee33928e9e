//! CAN controllers of the STM32: classic frames at 1 Mbit/s.
//!
//! A controller starts in a mode in which it sends nothing, error frames included, so that it does not disturb a bus at
//! another bit rate, of which no frame is valid. The first valid frame ends the mode.

use autoswing_firmware::app::can::{ReceiveFrame, SendFrame};
use autoswing_firmware::wire::dronecan::{CanFrame, UNIQUE_ID_LENGTH};
use embassy_stm32::can::frame::Envelope;
use embassy_stm32::can::{BufferedCanReceiver, BufferedCanSender, Frame, RxBuf, TxBuf};
use embassy_stm32::gpio::Output;
use embassy_stm32::uid;
use embedded_can::Id;

/// Capacity for received frames until the task reads them: 4 ms of a fully loaded bus. The controller itself holds
/// three.
const RECEIVE_CAPACITY: usize = 32;
/// Capacity for frames to send, besides the controller's three: the node has a queue of its own, in which a newer field
/// replaces an older one.
const SEND_CAPACITY: usize = 1;

pub struct CanBuffers {
    pub rx: RxBuf<RECEIVE_CAPACITY>,
    pub tx: TxBuf<SEND_CAPACITY>,
}

impl CanBuffers {
    pub const fn new() -> Self {
        Self { rx: RxBuf::new(), tx: TxBuf::new() }
    }
}

/// Controller, started in the mode in which it sends nothing.
pub trait Controller {
    /// Ends the mode; returns whether it has ended.
    fn end_silence(&mut self) -> bool;

    /// Returns the number of errors detected on the bus since the last call, at most 255: bits, stuffing, form,
    /// acknowledgement, CRC.
    fn take_error_count(&mut self) -> u32;
}

pub struct CanReceiver<C> {
    hal_receiver: BufferedCanReceiver,
    controller: C,
    is_silent: bool,
}

impl<C> CanReceiver<C> {
    /// Wraps the receiver of a controller that has been started in its silent mode.
    pub fn new(hal_receiver: BufferedCanReceiver, controller: C) -> Self {
        Self { hal_receiver, controller, is_silent: true }
    }
}

impl<C: Controller> ReceiveFrame for CanReceiver<C> {
    async fn receive_frame(&mut self) -> CanFrame {
        loop {
            // The HAL reports errors only of the moment after a received frame; the controller counts all.
            let Ok(Envelope { frame, .. }) = self.hal_receiver.receive().await else { continue };
            if self.is_silent {
                self.is_silent = !self.controller.end_silence();
            }
            // A length code above eight means eight bytes (ISO 11898-1); the HAL may report the code.
            let data = frame.raw_data().get(..frame.header().len().into()).unwrap_or(frame.raw_data());
            if let Id::Extended(id) = frame.id()
                && let Some(frame) = CanFrame::new(id.as_raw(), data)
            {
                return frame;
            }
        }
    }

    fn take_error_count(&mut self) -> u32 {
        self.controller.take_error_count()
    }
}

pub struct CanSender {
    hal_sender: BufferedCanSender,
    /// Switch of the terminating resistor, on a board with one.
    termination: Option<Output<'static>>,
}

impl CanSender {
    /// Wraps the sender of a controller.
    pub fn new(hal_sender: BufferedCanSender, termination: Option<Output<'static>>) -> Self {
        Self { hal_sender, termination }
    }
}

impl SendFrame for CanSender {
    async fn send_frame(&mut self, frame: &CanFrame) {
        // Infallible: a `CanFrame` has at most 29 bits and eight bytes.
        if let Ok(frame) = Frame::new_extended(frame.frame_id(), frame.data()) {
            self.hal_sender.write(frame).await;
        }
    }

    fn set_termination(&mut self, is_on: bool) {
        if let Some(termination) = &mut self.termination {
            termination.set_level(is_on.into());
        }
    }
}

/// Unique id of the chip, padded with zeros.
pub fn unique_id() -> [u8; UNIQUE_ID_LENGTH] {
    let mut unique_id = [0; UNIQUE_ID_LENGTH];
    for (place, byte) in unique_id.iter_mut().zip(uid::uid()) {
        *place = byte;
    }
    unique_id
}

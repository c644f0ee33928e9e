//! CAN controller FDCAN1.
//!
//! It starts in restricted operation mode: it receives and acknowledges valid frames, but sends nothing. Mere monitoring
//! without acknowledging is not enough: the frames of a single other node are valid only after it has given up error
//! frames.

use embassy_stm32::can::config::{GlobalFilter, NonMatchingFilter, TxBufferMode};
use embassy_stm32::can::{CanConfigurator, OperatingMode};
use embassy_stm32::gpio::Output;
use embassy_stm32::pac;

use super::can::{CanBuffers, CanReceiver, CanSender, Controller};

/// Bit rate of DroneCAN on classic CAN, bit/s.
const BITS_PER_S: u32 = 1_000_000;

/// Starts a controller whose transceiver is on, in restricted mode.
pub fn start_controller(
    mut can: CanConfigurator<'static>,
    termination: Output<'static>,
    buffers: &'static mut CanBuffers,
) -> (CanReceiver<RestrictedFdcan>, CanSender) {
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
    (CanReceiver::new(bus.reader(), RestrictedFdcan), CanSender::new(bus.writer(), Some(termination)))
}

pub struct RestrictedFdcan;

impl Controller for RestrictedFdcan {
    fn end_silence(&mut self) -> bool {
        // Restricted operation mode may be left at any time (reference manual RM0440, FDCAN_CCCR).
        pac::FDCAN1.cccr().modify(|control| control.set_asm(false));
        true
    }

    fn take_error_count(&mut self) -> u32 {
        // Reading the register clears the error counter.
        pac::FDCAN1.ecr().read().cel().into()
    }
}

//! CAN controller bxCAN 1 (CAN1).
//!
//! It starts in silent mode: it receives, but neither acknowledges nor sends anything. The frames of a single other node
//! are then valid after 16 attempts (3 ms): without an acknowledgement that node becomes error passive, and its error
//! frames no longer destroy the end of its frames (ISO 11898-1).

use core::num::{NonZeroU8, NonZeroU16};
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::can::filter::Mask32;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::can::{
    Can, ExtendedId, Fifo, Rx0InterruptHandler, Rx1InterruptHandler, RxPin, SceInterruptHandler, TxInterruptHandler,
    TxPin,
};
use embassy_stm32::interrupt::typelevel::{self, Binding, Handler};
use embassy_stm32::pac::can::vals::{Lec, Silm};
use embassy_stm32::peripherals::CAN1;
use embassy_stm32::{Peri, pac};
use embassy_time::{Duration, Instant};

use super::can::{CanBuffers, CanReceiver, CanSender, Controller};

/// 1 Mbit/s from the 80 MHz of the peripheral bus: 20 quanta, sample point at 75 %. Jump width and second segment allow
/// a difference of 1.9 % between the clocks of two nodes; the internal oscillator may differ by 1 % (data sheet of
/// STM32L475, HSI16, 0 to 85 degrees Celsius).
const BIT_TIMING: NominalBitTiming = NominalBitTiming {
    prescaler: NonZeroU16::new(4).unwrap(),
    seg1: NonZeroU8::new(14).unwrap(),
    seg2: NonZeroU8::new(5).unwrap(),
    sync_jump_width: NonZeroU8::new(4).unwrap(),
};

/// Longest time until initialisation mode begins: that of the longest frame in progress, 160 bits, and a margin.
const MAX_INITIALISATION_WAIT: Duration = Duration::from_micros(250);

/// Starts the controller in silent mode. It synchronises with the bus in the background.
pub fn start_controller(
    can: Peri<'static, CAN1>,
    rx: Peri<'static, impl RxPin<CAN1>>,
    tx: Peri<'static, impl TxPin<CAN1>>,
    irqs: impl Binding<typelevel::CAN1_TX, TxInterruptHandler<CAN1>>
    + Binding<typelevel::CAN1_RX0, Rx0InterruptHandler<CAN1>>
    + Binding<typelevel::CAN1_RX1, Rx1InterruptHandler<CAN1>>
    + Binding<typelevel::CAN1_SCE, SceInterruptHandler<CAN1>>
    + 'static,
    buffers: &'static mut CanBuffers,
) -> (CanReceiver<SilentBxcan>, CanSender) {
    let mut can = Can::new(can, rx, tx, irqs);
    can.modify_config().set_bit_timing(BIT_TIMING).set_silent(true);
    let mut extended_frames = Mask32::frames_with_ext_id(ExtendedId::ZERO, ExtendedId::ZERO);
    can.modify_filters().enable_bank(0, Fifo::Fifo0, *extended_frames.data_frames_only());
    // Frames leave in the order of the node's queue: those of one transfer have the same identifier.
    can.set_tx_fifo_scheduling(true);
    let bus = can.buffered(&mut buffers.tx, &mut buffers.rx);
    let ends = (bus.reader(), bus.writer());
    // Instead of the HAL's `enable`, which occupies the processor until the line is recessive.
    pac::CAN1.mcr().modify(|control| {
        control.set_abom(true);
        control.set_sleep(false);
    });
    (CanReceiver::new(ends.0, SilentBxcan { _can: can }), CanSender::new(ends.1, None))
}

/// The controller runs as long as the HAL's driver is owned.
pub struct SilentBxcan {
    _can: Can<'static>,
}

impl Controller for SilentBxcan {
    fn end_silence(&mut self) -> bool {
        // Silent mode can only be changed in initialisation mode, which begins after a frame in progress (reference
        // manual RM0351, CAN_MCR and CAN_BTR).
        pac::CAN1.mcr().modify(|control| control.set_inrq(true));
        let end = Instant::now() + MAX_INITIALISATION_WAIT;
        while !pac::CAN1.msr().read().inak() && Instant::now() < end {}
        let is_initialising = pac::CAN1.msr().read().inak();
        if is_initialising {
            pac::CAN1.btr().modify(|timing| timing.set_silm(Silm::NORMAL));
        }
        pac::CAN1.mcr().modify(|control| control.set_inrq(false));
        is_initialising
    }

    fn take_error_count(&mut self) -> u32 {
        let count = ERROR_COUNT.swap(0, Ordering::Relaxed);
        // The HAL's handler disables an interrupt whose flag it finds set.
        pac::CAN1.ier().modify(|enable| enable.set_errie(true));
        count
    }
}

/// Errors detected since the last call of [`Controller::take_error_count`].
static ERROR_COUNT: AtomicU32 = AtomicU32::new(0);

/// Limit of `ERROR_COUNT`, that of the counter in FDCAN; 4 % of the processor's time.
const MAX_ERROR_COUNT: u32 = 255;

/// Counts errors; its flag stays set beyond the limit. To be bound before the HAL's handler.
pub struct ErrorCounter;

impl Handler<typelevel::CAN1_SCE> for ErrorCounter {
    unsafe fn on_interrupt() {
        if ERROR_COUNT.load(Ordering::Relaxed) >= MAX_ERROR_COUNT {
            return;
        }
        pac::CAN1.msr().write(|status| status.set_erri(true));
        if !matches!(pac::CAN1.esr().read().lec(), Lec::NO_ERROR | Lec::CUSTOM) {
            pac::CAN1.esr().write(|errors| errors.set_lec(Lec::CUSTOM));
            ERROR_COUNT.fetch_add(1, Ordering::Relaxed);
        }
    }
}

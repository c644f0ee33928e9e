//! ArduPilot's boot loader for peripherals: the state that it leaves, the descriptor of the image, and messages to it.
//!
//! It starts the image with the processor's clock from the PLL, a running watchdog, interrupts disabled but peripherals
//! and interrupt controller as it used them (Tools/AP_Bootloader of ArduPilot).

use core::arch::naked_asm;
use core::sync::atomic::{Ordering, compiler_fence};

use autoswing_firmware::app::can::UpdateHandOver;
use autoswing_firmware::port::UpdateForBootLoader;
use autoswing_firmware::wire::dronecan::outbound::SoftwareVersion;
use cortex_m::Peripherals;
use cortex_m::peripheral::{NVIC, SCB};
use cortex_m::register::basepri;
use embassy_stm32::pac::rcc::regs::{Ahb1rstr, Apb1rstr1, Apb1rstr2, Apb2rstr};
use embassy_stm32::pac::rcc::vals::{Hpre, Sw};
use embassy_stm32::pac::{RCC, TAMP};

/// Selects the main stack before the memory is initialised: the boot loader's threads use the process stack, in memory
/// that becomes this program's variables. Feeds the boot loader's watchdog by its key register, `IWDG_KR`.
///
/// # Safety
///
/// Called by the reset handler alone, which has nothing on a stack.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn __pre_init() {
    naked_asm!(
        "ldr r0, =_stack_start",
        "msr msp, r0",
        "movs r0, #0",
        "msr control, r0",
        "isb",
        "ldr r0, =0x40003000",
        "movw r1, #0xAAAA",
        "str r1, [r0]",
        "bx lr"
    )
}

/// Resets everything that the boot loader used, and enables interrupts. Call first of all.
///
/// The clock is the internal oscillator afterwards. The HAL resets flash interface and power control: with the wait
/// states and the voltage after a reset, the processor cannot run at 160 MHz.
pub fn reset_boot_loader_state() {
    RCC.cr().modify(|cr| cr.set_hsion(true));
    while !RCC.cr().read().hsirdy() {}
    RCC.cfgr().modify(|cfgr| {
        cfgr.set_sw(Sw::HSI);
        cfgr.set_hpre(Hpre::DIV1);
    });
    while RCC.cfgr().read().sws() != Sw::HSI {}
    reset_peripherals();
    // SAFETY: no other code runs yet, and the peripherals are not used after this block.
    let mut core = unsafe { Peripherals::steal() };
    core.SYST.disable_interrupt();
    core.SYST.disable_counter();
    SCB::clear_pendst();
    SCB::clear_pendsv();
    // SAFETY: interrupts are disabled; no region protects memory of this program.
    unsafe { core.MPU.ctrl.write(0) };
    reset_interrupt_controller(&core.NVIC);
    // SAFETY: each interrupt is disabled individually, so unmasking all of them breaks no critical section.
    unsafe {
        basepri::write(0);
        cortex_m::interrupt::enable();
    }
}

/// Resets peripherals and DMA as after power-on, except for power control, which the HAL resets, and the debugger's.
fn reset_peripherals() {
    let (mut ahb1, mut apb1) = (Ahb1rstr(0), Apb1rstr1(!0));
    ahb1.set_dma1rst(true);
    ahb1.set_dma2rst(true);
    ahb1.set_dmamux1rst(true);
    apb1.set_pwrrst(false);
    RCC.ahb1rstr().write_value(ahb1);
    RCC.apb1rstr1().write_value(apb1);
    RCC.apb1rstr2().write_value(Apb1rstr2(!0));
    RCC.apb2rstr().write_value(Apb2rstr(!0));
    RCC.ahb1rstr().write_value(Ahb1rstr(0));
    RCC.apb1rstr1().write_value(Apb1rstr1(0));
    RCC.apb1rstr2().write_value(Apb1rstr2(0));
    RCC.apb2rstr().write_value(Apb2rstr(0));
}

/// Disables all interrupts, removes pending ones, and resets their priorities.
fn reset_interrupt_controller(controller: &NVIC) {
    for (enabled, pending) in controller.icer.iter().zip(&controller.icpr) {
        // SAFETY: called before the program enables interrupts.
        unsafe {
            enabled.write(!0);
            pending.write(!0);
        }
    }
    for priority in &controller.ipr {
        // SAFETY: no critical section depends on priorities.
        unsafe { priority.write(0) };
    }
}

/// Description of the image, which the boot loader searches for and checks (`app_descriptor_unsigned` in
/// AP_CheckFirmware.h). scripts/boot-loader-image writes both CRCs, the size and the commit.
#[repr(C)]
pub struct AppDescriptor {
    signature: [u8; 8],
    /// CRC of the image up to and including `signature`.
    image_crc1: u32,
    /// CRC of the image from `version_major` on.
    image_crc2: u32,
    /// Size of the image, bytes.
    image_size: u32,
    /// First 32 bits of the commit, or 0.
    git_hash: u32,
    version_major: u8,
    version_minor: u8,
    board_id: u16,
    reserved: [u8; 8],
}

impl AppDescriptor {
    /// Descriptor for a board number of ArduPilot.
    pub const fn new(board_id: u16) -> Self {
        let SoftwareVersion { major_version: major, minor_version: minor, .. } = SoftwareVersion::from_firmware(None);
        Self {
            signature: [0x40, 0xA2, 0xE4, 0xF1, 0x64, 0x68, 0x91, 0x06],
            image_crc1: 0,
            image_crc2: 0,
            image_size: 0,
            git_hash: 0,
            version_major: major,
            version_minor: minor,
            board_id,
            reserved: [0xFF; 8],
        }
    }

    /// Version, commit and CRC as set in the image.
    pub fn software_version(&self) -> SoftwareVersion {
        let number = |place: &u32| {
            // SAFETY: a reference is readable. Volatile, because a script changes the compiled value.
            unsafe { (&raw const *place).read_volatile() }
        };
        let commit = Some(number(&self.git_hash)).filter(|&commit| commit != 0);
        let image_crc = u64::from(number(&self.image_crc1)) | u64::from(number(&self.image_crc2)) << 32;
        SoftwareVersion { image_crc: Some(image_crc), ..SoftwareVersion::from_firmware(commit) }
    }
}

/// Value of [`write_to_boot_loader`]: start the image, also after a watchdog reset. Without it the boot loader stays
/// after one.
const MESSAGE_START_AT_ONCE: u32 = 0xB009_3A26;
/// Value of [`write_to_boot_loader`], with the node's number in the low byte: fetch the update in memory.
const MESSAGE_FETCH_UPDATE: u32 = 0xB008_0000;

/// Makes the registers of the backup domain accessible; the HAL enables writing to them.
fn enable_backup_registers() {
    RCC.apb1enr1().modify(|enable| enable.set_rtcapben(true));
    // A register is accessible two cycles after its clock is enabled (reference manual RM0440); reading back takes
    // them.
    RCC.apb1enr1().read();
}

/// Writes to backup register 0, which the boot loader reads after the next reset, and clears before it starts an image.
fn write_to_boot_loader(message: u32) {
    enable_backup_registers();
    TAMP.bkpr(0).write(|register| register.set_bkp(message));
}

/// Marks this image as good: a watchdog reset then starts it again. A request for an
/// update, already written for the boot loader, is kept.
pub fn mark_image_good() {
    enable_backup_registers();
    if TAMP.bkpr(0).read().bkp() == 0 {
        write_to_boot_loader(MESSAGE_START_AT_ONCE);
    }
}

/// Hand-over of firmware updates to the boot loader.
pub struct BootLoader;

impl UpdateHandOver for BootLoader {
    fn hand_over_update(&mut self, update: &UpdateForBootLoader) {
        unsafe extern "C" {
            // Memory of the update, with its address in memory.x.
            static mut __boot_loader_update: [u8; autoswing_firmware::port::BOOT_LOADER_HANDOVER_LENGTH];
        }
        // SAFETY: this memory is reserved for the boot loader, and nothing else accesses it. Volatile, because nothing
        // reads it in this run.
        unsafe { (&raw mut __boot_loader_update).write_volatile(update.boot_loader_handover()) };
        // The structure is complete before the boot loader is asked to read it.
        compiler_fence(Ordering::SeqCst);
        write_to_boot_loader(MESSAGE_FETCH_UPDATE | u32::from(update.own_node.number()));
    }
}

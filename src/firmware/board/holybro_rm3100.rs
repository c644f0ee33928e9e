//! Holybro DroneCAN RM3100 (ArduPilot: HolybroG4_Compass, board number 1088): an STM32G474 with a PNI RM3100, started
//! by ArduPilot's boot loader.
//!
//! | connection | pins | location |
//! |---|---|---|
//! | magnetometer RM3100, SPI mode 0, 1 MHz | SPI1: PA5 SCK, PA6 MISO, PA7 MOSI; PC14 chip select | on the board |
//! | power of the magnetometer, on while high | PC11 | on the board |
//! | CAN, 1 Mbit/s | FDCAN1: PA11 RX, PA12 TX | CAN connectors |
//! | transceiver, silent while high | PC13 | on the board |
//! | termination, on while high | PB4 | on the board |
//! | console, or port 1, 115200 8N1 | USART2: PA2 TX, PA3 RX | UART connector |
//! | lamp: blue LED, on while low | PC10 | on the board |
//! | red and green LED, off | PB15, PC6 | on the board |
//!
//! Pins and clocks are ArduPilot's (hwdef/HolybroG4_Compass). No one has run this on a board yet.
//!
//! # Interrupt priorities
//!
//! 1. CAN and UART: three frames must be read within 0.3 ms, a byte within 87 us.
//! 2. Clock and sensor bus: short handlers that only wake tasks.
//! 3. Executor of the heading tasks, in an unused peripheral's interrupt.
//! 4. Thread executor: solving, flash, console. These delay a heading only while a page is erased (`stm32::flash`): the
//!    image reaches into the store's bank.

use autoswing_firmware::app;
use autoswing_firmware::magnetometer::rm3100::Rm3100;
use autoswing_firmware::wire::dronecan::outbound::NodeInfo;
use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor, SendSpawner};
use embassy_stm32::can::{self, CanConfigurator};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{self, DMA1_CH1, DMA1_CH2};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::{bind_interrupts, dma, interrupt, pac, rcc, usart};
use embedded_hal_bus::spi::{ExclusiveDevice, NoDelay};
use static_cell::StaticCell;

use super::hardware;
use super::stm32::boot_loader::{self, AppDescriptor, BootLoader};
use super::stm32::can::{CanBuffers, CanReceiver, CanSender, unique_id};
use super::stm32::fdcan::{self, RestrictedFdcan};
pub use super::stm32::flash::StoreFlash;
pub use super::stm32::platform::Platform;
use super::stm32::uart::{UartBuffers, new_uart};
pub use super::stm32::uart::{UartRx, UartTx};
use super::stm32::{self, reset};

bind_interrupts!(struct Irqs {
    DMA1_CHANNEL1 => dma::InterruptHandler<DMA1_CH1>;
    DMA1_CHANNEL2 => dma::InterruptHandler<DMA1_CH2>;
    FDCAN1_IT0 => can::IT0InterruptHandler<peripherals::FDCAN1>;
    FDCAN1_IT1 => can::IT1InterruptHandler<peripherals::FDCAN1>;
    FLASH => flash::InterruptHandler;
    USART2 => usart::BufferedInterruptHandler<peripherals::USART2>;
});

const LINE_PRIORITY: Priority = Priority::P2;
const SENSOR_BUS_PRIORITY: Priority = Priority::P4;
const EXECUTOR_PRIORITY: Priority = Priority::P6;
const FLASH_PRIORITY: Priority = Priority::P8;

/// ArduPilot's number of the board; its bytes are the version of the hardware in DroneCAN.
const BOARD_ID: u16 = 1088;

#[unsafe(link_section = ".app_descriptor")]
#[used]
static DESCRIPTOR: AppDescriptor = AppDescriptor::new(BOARD_ID);

pub type Magnetometer = Rm3100<ExclusiveDevice<Spi<'static, Async, Master>, Output<'static>, NoDelay>>;
pub type Uarts = (UartTx, UartRx);
pub type CanBus = hardware::CanBus<CanReceiver<RestrictedFdcan>, CanSender, BootLoader>;
pub type Hardware = hardware::Hardware<Magnetometer, (), Uarts, CanBus, Watchdog, Panel, StoreFlash, Platform>;

/// Executor of the heading tasks.
static HEADING_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

pub fn start_board(spawn_tasks: impl FnOnce(SendSpawner, SendSpawner, Hardware)) -> ! {
    static CAN_BUFFERS: StaticCell<CanBuffers> = StaticCell::new();
    static UART_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static OTHER_EXECUTOR: StaticCell<Executor> = StaticCell::new();

    boot_loader::reset_boot_loader_state();
    let reset = reset::take_reset_cause();
    let p = embassy_stm32::init(clock_config());
    // A debugger that halts the processor also halts the watchdog.
    pac::DBGMCU.apb1lfzr().modify(|freeze| freeze.set_iwdg(true));
    let watchdog = stm32::watchdog::Watchdog::start_watchdog(p.IWDG);

    let spi = Spi::new(p.SPI1, p.PA5, p.PA7, p.PA6, p.DMA1_CH2, p.DMA1_CH1, Irqs, spi_config());
    let chip_select = Output::new(p.PC14, Level::High, Speed::Low);
    let can = CanConfigurator::new(p.FDCAN1, p.PA11, p.PA12, Irqs);
    let transceiver_silent = Output::new(p.PC13, Level::Low, Speed::Low);
    let termination = Output::new(p.PB4, Level::Low, Speed::Low);
    let (rx, tx) = fdcan::start_controller(can, termination, CAN_BUFFERS.init_with(CanBuffers::new));
    let hardware = Hardware {
        // Infallible: an output pin accepts every level.
        magnetometer: Rm3100::new(ExclusiveDevice::new_no_delay(spi, chip_select).expect("a pin")),
        inertial_sensor: (),
        uarts: new_uart(p.USART2, p.PA3, p.PA2, Irqs, UART_BUFFERS.init(UartBuffers::EMPTY)),
        can_bus: CanBus { node_info: node_info(), rx, tx, boot_loader: BootLoader },
        watchdog: Watchdog(watchdog),
        panel: Panel {
            lamp: Output::new(p.PC10, Level::High, Speed::Low),
            _sensor_power: Output::new(p.PC11, Level::High, Speed::Low),
            _transceiver_silent: transceiver_silent,
            _dark_leds: [Output::new(p.PB15, Level::High, Speed::Low), Output::new(p.PC6, Level::High, Speed::Low)],
        },
        flash: StoreFlash::new(Flash::new(p.FLASH, Irqs)),
        platform: Platform,
        reset_cause: reset,
    };
    set_priorities();

    let above = HEADING_EXECUTOR.start(interrupt::CORDIC);
    OTHER_EXECUTOR.init(Executor::new()).run(|below| spawn_tasks(above, below.make_send(), hardware))
}

/// System clock 160 MHz, CAN 80 MHz, from the 16 MHz crystal, as ArduPilot has them.
///
/// The clock of the real-time clock stays off: the boot loader resets the backup domain, and with it the message to it,
/// if it finds another one selected.
fn clock_config() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hsi = false;
    config.rcc.hsi48 = None;
    config.rcc.hse = Some(rcc::Hse { freq: Hertz(16_000_000), mode: rcc::HseMode::Oscillator });
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV2,
        mul: rcc::PllMul::MUL40,
        divp: None,
        divq: Some(rcc::PllQDiv::DIV4),
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    // The core's boost mode is required above 150 MHz.
    config.rcc.boost = true;
    config.rcc.ls = rcc::LsConfig::off();
    config.rcc.mux.fdcansel = rcc::mux::Fdcansel::PLL1_Q;
    config.bdma_interrupt_priority = SENSOR_BUS_PRIORITY;
    config
}

/// SPI mode 0 at 1 MHz.
fn spi_config() -> spi::Config {
    let mut config = spi::Config::default();
    config.frequency = Hertz(1_000_000);
    config
}

/// Sets the priorities that are not part of the HAL's configuration. The HAL's clock has the highest priority by
/// default.
fn set_priorities() {
    interrupt::FDCAN1_IT0.set_priority(LINE_PRIORITY);
    interrupt::USART2.set_priority(LINE_PRIORITY);
    interrupt::CORDIC.set_priority(EXECUTOR_PRIORITY);
    interrupt::FLASH.set_priority(FLASH_PRIORITY);
}

/// Runs the heading tasks in the interrupt of the unused CORDIC unit.
#[interrupt]
unsafe fn CORDIC() {
    // SAFETY: the executor was started with this interrupt.
    unsafe { HEADING_EXECUTOR.on_interrupt() }
}

/// Description of the node. Not a name of ArduPilot's: Mission Planner would offer its firmware.
fn node_info() -> NodeInfo {
    NodeInfo {
        node_name: "org.autoswing.holybro-rm3100",
        software_version: DESCRIPTOR.software_version(),
        hardware_version: BOARD_ID.to_be_bytes(),
        unique_id: unique_id(),
    }
}

/// Watchdog of a board whose boot loader asks for good images.
pub struct Watchdog(stm32::watchdog::Watchdog);

impl app::Watchdog for Watchdog {
    fn feed(&mut self) {
        self.0.feed();
    }

    fn mark_image_good(&mut self) {
        boot_loader::mark_image_good();
    }
}

/// The lamp, and outputs that keep their level as long as they are owned.
pub struct Panel {
    lamp: Output<'static>,
    _sensor_power: Output<'static>,
    _transceiver_silent: Output<'static>,
    _dark_leds: [Output<'static>; 2],
}

impl app::Panel for Panel {
    fn set_lamp(&mut self, on: bool) {
        self.lamp.set_level((!on).into());
    }

    fn is_pressed(&self) -> bool {
        false
    }
}

//! ST B-L475E-IOT01A, "Discovery kit IoT node": an STM32L475VG with a LIS3MDL and an LSM6DSL.
//!
//! | connection | pins | location |
//! |---|---|---|
//! | magnetometer LIS3MDL, address 0x1E | I2C2: PB10 SCL, PB11 SDA | on the board |
//! | gyro and accelerometer LSM6DSL, address 0x6A | the same; its INT1 at PD11 is not used | on the board |
//! | console, 115200 8N1 | USART1: PB6 TX, PB7 RX | USB connector (ST-LINK's virtual COM port) |
//! | port 1: autopilot, 115200 8N1 | UART4: PA0 TX, PA1 RX | Arduino connector D1, D0 |
//! | port 2: instrument, 115200 8N1 | USART2: PD5 TX, PD6 RX | PMOD connector |
//! | CAN, 1 Mbit/s, for a transceiver | CAN1: PB8 RX, PB9 TX | Arduino connector D15, D14 |
//! | LED | PB14 | LD2 |
//! | button | PC13, low while pressed | user button B2 (blue) |
//!
//! # Interrupt priorities
//!
//! 1. UARTs and CAN: at 115200 baud a byte must be read within 87 us, three frames within 0.3 ms.
//! 2. Clock and sensor bus: short handlers that only wake tasks.
//! 3. Executor of the heading tasks, in an unused peripheral's interrupt.
//! 4. Thread executor: solving, flash, console. These cannot delay a heading.

use autoswing_firmware::app;
use autoswing_firmware::app::can::NoBootLoader;
use autoswing_firmware::console::reply::VERSION;
use autoswing_firmware::inertial_sensor::lsm6dsl::Lsm6dsl;
use autoswing_firmware::magnetometer::lis3mdl::Lis3mdl;
use autoswing_firmware::wire::dronecan::outbound::{NodeInfo, SoftwareVersion};
use defmt_rtt as _;
use embassy_embedded_hal::shared_bus::asynch::i2c::I2cDevice;
use embassy_executor::{Executor, InterruptExecutor, SendSpawner};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::i2c::{self, I2c, Master};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::pac::gpio::vals::Pupdr;
use embassy_stm32::peripherals::{self, DMA1_CH4, DMA1_CH5, I2C2, PB10, PB11};
use embassy_stm32::{bind_interrupts, can, dma, interrupt, pac, rcc, usart};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use static_cell::StaticCell;

use super::hardware::{self, PortAndConsoleUarts};
use super::stm32::bxcan::{self, SilentBxcan};
use super::stm32::can::{CanBuffers, CanReceiver, CanSender, unique_id};
pub use super::stm32::flash::StoreFlash;
use super::stm32::i2c::I2cBus;
pub use super::stm32::platform::Platform;
use super::stm32::reset;
use super::stm32::uart::{UartBuffers, new_uart};
pub use super::stm32::uart::{UartRx, UartTx};
pub use super::stm32::watchdog::Watchdog;

bind_interrupts!(struct Irqs {
    I2C2_EV => i2c::EventInterruptHandler<I2C2>;
    I2C2_ER => i2c::ErrorInterruptHandler<I2C2>;
    DMA1_CHANNEL4 => dma::InterruptHandler<DMA1_CH4>;
    DMA1_CHANNEL5 => dma::InterruptHandler<DMA1_CH5>;
    USART1 => usart::BufferedInterruptHandler<peripherals::USART1>;
    USART2 => usart::BufferedInterruptHandler<peripherals::USART2>;
    UART4 => usart::BufferedInterruptHandler<peripherals::UART4>;
    CAN1_TX => can::TxInterruptHandler<peripherals::CAN1>;
    CAN1_RX0 => can::Rx0InterruptHandler<peripherals::CAN1>;
    CAN1_RX1 => can::Rx1InterruptHandler<peripherals::CAN1>;
    CAN1_SCE => bxcan::ErrorCounter, can::SceInterruptHandler<peripherals::CAN1>;
    FLASH => flash::InterruptHandler;
});

const LINE_PRIORITY: Priority = Priority::P2;
const SENSOR_BUS_PRIORITY: Priority = Priority::P4;
const EXECUTOR_PRIORITY: Priority = Priority::P6;
const FLASH_PRIORITY: Priority = Priority::P8;

/// Bus of magnetometer and inertial sensor; a transfer waits for that of the other chip.
type SharedBus = Mutex<CriticalSectionRawMutex, I2cBus>;
type SensorBus = I2cDevice<'static, CriticalSectionRawMutex, I2cBus>;

pub type Magnetometer = Lis3mdl<SensorBus>;
pub type InertialSensor = Lsm6dsl<SensorBus>;
pub type Uarts = PortAndConsoleUarts<UartTx, UartRx>;
pub type CanBus = hardware::CanBus<CanReceiver<SilentBxcan>, CanSender, NoBootLoader>;
pub type Hardware =
    hardware::Hardware<Magnetometer, InertialSensor, Uarts, CanBus, Watchdog, Panel, StoreFlash, Platform>;

/// Executor of the heading tasks.
static HEADING_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

pub fn start_board(spawn_tasks: impl FnOnce(SendSpawner, SendSpawner, Hardware)) -> ! {
    static CONSOLE_UART_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static AUTOPILOT_UART_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static INSTRUMENT_UART_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static CAN_BUFFERS: StaticCell<CanBuffers> = StaticCell::new();
    static SENSOR_BUS: StaticCell<SharedBus> = StaticCell::new();
    static OTHER_EXECUTOR: StaticCell<Executor> = StaticCell::new();

    let reset = reset::take_reset_cause();
    let p = embassy_stm32::init(clock_config());
    // A debugger that halts the processor also halts the watchdog.
    pac::DBGMCU.apb1fzr1().modify(|freeze| freeze.set_iwdg(true));
    let watchdog = Watchdog::start_watchdog(p.IWDG);

    // SAFETY: `i2c2_bus` creates the driver with these pins, and its peripherals are used nowhere else.
    let bus = unsafe { I2cBus::new(p.PB10.into(), p.PB11.into(), i2c2_bus) };
    let bus: &'static SharedBus = SENSOR_BUS.init(Mutex::new(bus));
    let (rx, tx) = bxcan::start_controller(p.CAN1, p.PB8, p.PB9, Irqs, CAN_BUFFERS.init_with(CanBuffers::new));
    // Without a transceiver the line is recessive: nothing is received, and therefore nothing is sent.
    pac::GPIOB.pupdr().modify(|pulls| pulls.set_pupdr(8, Pupdr::PULL_UP));
    let hardware = Hardware {
        magnetometer: Lis3mdl::new(SensorBus::new(bus)),
        inertial_sensor: InertialSensor::new(SensorBus::new(bus), InertialSensor::ADDRESS_SA0_LOW),
        uarts: Uarts {
            port_uarts: [
                new_uart(p.UART4, p.PA1, p.PA0, Irqs, AUTOPILOT_UART_BUFFERS.init(UartBuffers::EMPTY)),
                new_uart(p.USART2, p.PD6, p.PD5, Irqs, INSTRUMENT_UART_BUFFERS.init(UartBuffers::EMPTY)),
            ],
            console_uart: new_uart(p.USART1, p.PB7, p.PB6, Irqs, CONSOLE_UART_BUFFERS.init(UartBuffers::EMPTY)),
        },
        can_bus: CanBus { node_info: node_info(), rx, tx, boot_loader: NoBootLoader },
        watchdog,
        panel: Panel {
            lamp: Output::new(p.PB14, Level::High, Speed::Low),
            // The board has an external pull-up resistor.
            button: Input::new(p.PC13, Pull::None),
        },
        flash: StoreFlash::new(Flash::new(p.FLASH, Irqs)),
        platform: Platform,
        reset_cause: reset,
    };
    set_priorities();

    let above = HEADING_EXECUTOR.start(interrupt::TSC);
    OTHER_EXECUTOR.init(Executor::new()).run(|below| spawn_tasks(above, below.make_send(), hardware))
}

/// System clock 80 MHz, the maximum, from the internal 16 MHz oscillator; its 1 % tolerance suffices for 115200 baud.
fn clock_config() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hsi = true;
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSI,
        prediv: rcc::PllPreDiv::DIV1,
        mul: rcc::PllMul::MUL10,
        divp: None,
        divq: None,
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    config.bdma_interrupt_priority = SENSOR_BUS_PRIORITY;
    config
}

/// Sets the priorities that are not part of the HAL's configuration. The HAL's clock has the highest priority by
/// default.
fn set_priorities() {
    interrupt::USART1.set_priority(LINE_PRIORITY);
    interrupt::USART2.set_priority(LINE_PRIORITY);
    interrupt::UART4.set_priority(LINE_PRIORITY);
    interrupt::CAN1_TX.set_priority(LINE_PRIORITY);
    interrupt::CAN1_RX0.set_priority(LINE_PRIORITY);
    interrupt::CAN1_SCE.set_priority(LINE_PRIORITY);
    interrupt::I2C2_EV.set_priority(SENSOR_BUS_PRIORITY);
    interrupt::I2C2_ER.set_priority(SENSOR_BUS_PRIORITY);
    interrupt::TSC.set_priority(EXECUTOR_PRIORITY);
    interrupt::FLASH.set_priority(FLASH_PRIORITY);
}

/// Runs the heading tasks in the interrupt of the unused touch sensing controller.
#[interrupt]
unsafe fn TSC() {
    // SAFETY: the executor was started with this interrupt.
    unsafe { HEADING_EXECUTOR.on_interrupt() }
}

/// Creates the sensor bus driver.
fn i2c2_bus() -> I2c<'static, Async, Master> {
    // SAFETY: only `I2cBus` calls this, after dropping the previous driver, and nothing else uses these peripherals.
    let (i2c, scl, sda, tx, rx) =
        unsafe { (I2C2::steal(), PB10::steal(), PB11::steal(), DMA1_CH4::steal(), DMA1_CH5::steal()) };
    I2c::new(i2c, scl, sda, tx, rx, Irqs, super::stm32::i2c::i2c_config())
}

/// Description of the node.
fn node_info() -> NodeInfo {
    NodeInfo {
        node_name: "org.autoswing.b-l475e-iot01a",
        software_version: SoftwareVersion::from_firmware(SoftwareVersion::parse_commit(VERSION)),
        hardware_version: [1, 0],
        unique_id: unique_id(),
    }
}

pub struct Panel {
    lamp: Output<'static>,
    button: Input<'static>,
}

impl app::Panel for Panel {
    fn set_lamp(&mut self, on: bool) {
        self.lamp.set_level(on.into());
    }

    fn is_pressed(&self) -> bool {
        self.button.is_low()
    }
}

//! ST B-L475E-IOT01A, "Discovery kit IoT node": an STM32L475VG with a LIS3MDL.
//!
//! | wire | pins | where |
//! |---|---|---|
//! | magnetometer LIS3MDL, address 0x1E | I2C2: PB10 SCL, PB11 SDA | on the board |
//! | console, 115200 8N1 | USART1: PB6 TX, PB7 RX | USB connector (ST-LINK's virtual COM port) |
//! | port 1: autopilot, 115200 8N1 | UART4: PA0 TX, PA1 RX | Arduino connector D1, D0 |
//! | port 2: instrument, 115200 8N1 | USART2: PD5 TX, PD6 RX | PMOD connector |
//! | lamp | PB14 | LED LD2 |
//! | button | PC13, low while it is down | user button B2 (blue) |
//!
//! # Priorities
//!
//! 1. The UARTs, 115200 baud: a byte must be taken before the next has come, within 87 us.
//! 2. Clock and sensor bus: short, and they only wake tasks.
//! 3. The executor of the tasks that make headings, in an interrupt that no peripheral uses.
//! 4. The thread executor: solving, flash, console. Whatever these take, a heading is not late.

use autoswing::app::{self, watchdog};
use autoswing::health::StackUse;
use autoswing::magnetometer::lis3mdl::{self, Lis3mdl};
use cortex_m::peripheral::SCB;
use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::i2c::{self, I2c, Master};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{self, DMA1_CH4, DMA1_CH5, I2C2, IWDG, PB10, PB11};
use embassy_stm32::usart::{self, BufferedUart, BufferedUartRx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, bind_interrupts, dma, interrupt, pac, rcc};
use static_cell::StaticCell;

use super::stack;
pub use super::stm32l4::flash::StoreFlash;
use super::stm32l4::i2c::I2cBus;
use super::stm32l4::reset;
pub use super::stm32l4::uart::UartTx;
use super::tasks::{self, Hardware};

bind_interrupts!(struct Irqs {
    I2C2_EV => i2c::EventInterruptHandler<I2C2>;
    I2C2_ER => i2c::ErrorInterruptHandler<I2C2>;
    DMA1_CHANNEL4 => dma::InterruptHandler<DMA1_CH4>;
    DMA1_CHANNEL5 => dma::InterruptHandler<DMA1_CH5>;
    USART1 => usart::BufferedInterruptHandler<peripherals::USART1>;
    USART2 => usart::BufferedInterruptHandler<peripherals::USART2>;
    UART4 => usart::BufferedInterruptHandler<peripherals::UART4>;
    FLASH => flash::InterruptHandler;
});

const UART_PRIORITY: Priority = Priority::P2;
const SENSOR_BUS_PRIORITY: Priority = Priority::P4;
const EXECUTOR_PRIORITY: Priority = Priority::P6;
const FLASH_PRIORITY: Priority = Priority::P8;

/// Between two feedings the watchdog task may look in vain once, and the watchdog's clock may run at 34 kHz instead of
/// 32 (data sheet, LSI).
const WATCHDOG_PERIOD_US: u32 = 2_000_000;
const _: () = assert!(WATCHDOG_PERIOD_US as u64 * 32 > watchdog::LONGEST_WITHOUT_FEED_US * 34);

/// Buffers of the UARTs: a receive buffer holds 22 ms of input, should a reader be late.
const UART_BUFFER: usize = 256;
/// The reader of a UART is woken by so many bytes, or by a pause: 1.4 ms, which keeps the instant of an attitude true.
const UART_WAKE: usize = 16;

pub type Magnetometer = Lis3mdl<I2cBus>;
pub type UartRx = BufferedUartRx<'static>;

/// Executor of the tasks that make headings.
static HEADING_TASKS: InterruptExecutor = InterruptExecutor::new();

/// Runs the firmware.
pub fn start() -> ! {
    static CONSOLE_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static AUTOPILOT_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static INSTRUMENT_BUFFERS: StaticCell<UartBuffers> = StaticCell::new();
    static OTHER_TASKS: StaticCell<Executor> = StaticCell::new();

    let reset = reset::cause();
    let p = embassy_stm32::init(clocks());
    // A debugger that stops the processor stops the watchdog too.
    pac::DBGMCU.apb1fzr1().modify(|freeze| freeze.set_iwdg(true));
    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_PERIOD_US);
    watchdog.unleash();

    // SAFETY: `i2c2` is the driver with these pins; what it takes is taken nowhere else.
    let bus = unsafe { I2cBus::new(p.PB10.into(), p.PB11.into(), i2c2) };
    let hardware = Hardware {
        magnetometer: Lis3mdl::new(bus, lis3mdl::Config::default()),
        ports: [
            uart(p.UART4, p.PA1, p.PA0, Irqs, AUTOPILOT_BUFFERS.init(UartBuffers::NEW)),
            uart(p.USART2, p.PD6, p.PD5, Irqs, INSTRUMENT_BUFFERS.init(UartBuffers::NEW)),
        ],
        console: uart(p.USART1, p.PB7, p.PB6, Irqs, CONSOLE_BUFFERS.init(UartBuffers::NEW)),
        watchdog: Watchdog(watchdog),
        panel: Panel {
            lamp: Output::new(p.PB14, Level::High, Speed::Low),
            // The board has a resistor to pull it up.
            button: Input::new(p.PC13, Pull::None),
        },
        flash: StoreFlash::new(Flash::new(p.FLASH, Irqs)),
        platform: Platform,
        reset,
    };
    set_priorities();

    let above = HEADING_TASKS.start(interrupt::TSC);
    OTHER_TASKS.init(Executor::new()).run(|below| tasks::spawn(above, below.make_send(), hardware))
}

/// 80 MHz, the most there is, from the internal 16 MHz oscillator, whose 1 % is exact enough for 115200 baud.
fn clocks() -> embassy_stm32::Config {
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

/// Those that the HAL does not set by its configuration. Its clock has the highest priority, as it comes.
fn set_priorities() {
    interrupt::USART1.set_priority(UART_PRIORITY);
    interrupt::USART2.set_priority(UART_PRIORITY);
    interrupt::UART4.set_priority(UART_PRIORITY);
    interrupt::I2C2_EV.set_priority(SENSOR_BUS_PRIORITY);
    interrupt::I2C2_ER.set_priority(SENSOR_BUS_PRIORITY);
    interrupt::TSC.set_priority(EXECUTOR_PRIORITY);
    interrupt::FLASH.set_priority(FLASH_PRIORITY);
}

/// The interrupt of the touch sensing controller, which is not used, runs the executor.
#[interrupt]
unsafe fn TSC() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { HEADING_TASKS.on_interrupt() }
}

/// Makes the driver of the sensor bus.
fn i2c2() -> I2c<'static, Async, Master> {
    // SAFETY: only `I2cBus` calls this, when the driver made before is gone, and nothing else uses these peripherals.
    let (i2c, scl, sda, tx, rx) =
        unsafe { (I2C2::steal(), PB10::steal(), PB11::steal(), DMA1_CH4::steal(), DMA1_CH5::steal()) };
    I2c::new(i2c, scl, sda, tx, rx, Irqs, super::stm32l4::i2c::config())
}

struct UartBuffers {
    tx: [u8; UART_BUFFER],
    rx: [u8; UART_BUFFER],
}

impl UartBuffers {
    const NEW: Self = Self { tx: [0; UART_BUFFER], rx: [0; UART_BUFFER] };
}

/// A UART at 115200 8N1.
///
/// It is interrupt-driven, at 4 % of the processor's time for a line without pauses. Of the HAL's two receivers this is
/// the one that goes on after an error of the line; the other one's DMA stops.
fn uart<T: usart::Instance>(
    uart: Peri<'static, T>,
    rx: Peri<'static, impl usart::RxPin<T>>,
    tx: Peri<'static, impl usart::TxPin<T>>,
    irqs: impl interrupt::typelevel::Binding<T::Interrupt, usart::BufferedInterruptHandler<T>> + 'static,
    buffers: &'static mut UartBuffers,
) -> (UartTx, BufferedUartRx<'static>) {
    let mut config = usart::Config::default();
    config.eager_reads = Some(UART_WAKE);
    let (tx, rx) = BufferedUart::new(uart, rx, tx, &mut buffers.tx, &mut buffers.rx, irqs, config)
        .expect("80 MHz can be divided to 115200 baud")
        .split();
    (UartTx::new(tx), rx)
}

/// The watchdog.
pub struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl app::Watchdog for Watchdog {
    fn feed(&mut self) {
        self.0.pet();
    }
}

/// Lamp and button.
pub struct Panel {
    lamp: Output<'static>,
    button: Input<'static>,
}

impl app::Panel for Panel {
    fn light(&mut self, on: bool) {
        self.lamp.set_level(on.into());
    }

    fn is_pressed(&self) -> bool {
        self.button.is_low()
    }
}

/// What the console may ask of this board.
pub struct Platform;

impl app::Platform for Platform {
    fn reboot(&mut self) {
        SCB::sys_reset()
    }

    fn stack(&self) -> Option<StackUse> {
        Some(stack::high_water())
    }
}

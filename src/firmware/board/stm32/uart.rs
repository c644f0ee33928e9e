//! UARTs that continue after line errors, with a transmitter without deadlock.

use autoswing_firmware::app::SetBaud;
use autoswing_module::settings::BaudRate;
use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{self, BufferedUart, BufferedUartRx, BufferedUartTx, Error};
use embassy_stm32::{Peri, interrupt};
use embassy_time::{Duration, with_timeout};
use embedded_io_async::{ErrorType, Write};

/// Size of the UART buffers, bytes: 22 ms of input.
const BUFFER_SIZE: usize = 256;
/// Number of bytes received until the reader is woken, unless a pause occurs: 1.4 ms, which limits the timing error of
/// an attitude.
const BYTES_TO_WAKE_READER: usize = 16;

pub struct UartBuffers {
    tx: [u8; BUFFER_SIZE],
    rx: [u8; BUFFER_SIZE],
}

impl UartBuffers {
    pub const EMPTY: Self = Self { tx: [0; BUFFER_SIZE], rx: [0; BUFFER_SIZE] };
}

pub type UartRx = BufferedUartRx<'static>;

/// A UART at 115200 8N1.
///
/// Interrupt-driven, at most 4 % processor load. Of the HAL's receivers, only this one continues after a line error;
/// the DMA receiver stops. The receive pin has a pull-up, the level of an idle line: an unconnected pin would pick up
/// noise as bytes with line errors.
pub fn new_uart<T: usart::Instance>(
    uart: Peri<'static, T>,
    rx: Peri<'static, impl usart::RxPin<T>>,
    tx: Peri<'static, impl usart::TxPin<T>>,
    irqs: impl interrupt::typelevel::Binding<T::Interrupt, usart::BufferedInterruptHandler<T>> + 'static,
    buffers: &'static mut UartBuffers,
) -> (UartTx, UartRx) {
    let mut config = usart::Config::default();
    config.eager_reads = Some(BYTES_TO_WAKE_READER);
    config.rx_pull = Pull::Up;
    let (tx, rx) = BufferedUart::new(uart, rx, tx, &mut buffers.tx, &mut buffers.rx, irqs, config)
        .expect("the clocks of all boards can be divided to 115200 baud")
        .split();
    (UartTx::new(tx), rx)
}

pub struct UartTx(BufferedUartTx<'static>);

impl UartTx {
    /// Most bytes passed to the HAL at once; its buffer must be larger.
    const CHUNK_SIZE: usize = 32;
    /// Duration of a chunk at 115200 baud.
    const WRITE_ATTEMPT_TIMEOUT: Duration = Duration::from_micros(2_800);

    /// Wraps a transmitter with a buffer larger than [`CHUNK_SIZE`](Self::CHUNK_SIZE).
    fn new(tx: BufferedUartTx<'static>) -> Self {
        Self(tx)
    }
}

impl SetBaud for UartTx {
    fn set_baud(&mut self, baud: BaudRate) {
        // Infallible: the clocks of all boards can be divided to all rates. A byte being sent is corrupted.
        let _ = self.0.set_baudrate(baud.bits_per_s());
    }
}

impl ErrorType for UartTx {
    type Error = Error;
}

impl Write for UartTx {
    /// Retries the HAL's `write` (embassy-stm32 0.6), which waits for space in its buffer without registering a waker.
    /// It accepts all bytes or none, so nothing is sent twice.
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        // After an empty write the HAL would wait forever for the end of transmission.
        if bytes.is_empty() {
            return Ok(0);
        }
        let chunk = bytes.get(..Self::CHUNK_SIZE).unwrap_or(bytes);
        loop {
            if let Ok(result) = with_timeout(Self::WRITE_ATTEMPT_TIMEOUT, self.0.write(chunk)).await {
                return result;
            }
        }
    }

    async fn flush(&mut self) -> Result<(), Error> {
        self.0.flush().await
    }
}

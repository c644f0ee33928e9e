//! UART transmitter without deadlock.

use autoswing::app::SetBaud;
use autoswing::settings::Baud;
use embassy_stm32::usart::{BufferedUartTx, Error};
use embassy_time::{Duration, with_timeout};
use embedded_io_async::{ErrorType, Write};

pub struct UartTx(BufferedUartTx<'static>);

impl UartTx {
    /// Most bytes passed to the HAL at once; its buffer must be larger.
    pub const CHUNK: usize = 32;
    /// Duration of a chunk at 115200 baud.
    const RETRY: Duration = Duration::from_micros(2_800);

    /// Wraps a transmitter with a buffer larger than [`CHUNK`](Self::CHUNK).
    pub fn new(tx: BufferedUartTx<'static>) -> Self {
        Self(tx)
    }
}

impl SetBaud for UartTx {
    fn set_baud(&mut self, baud: Baud) {
        // Infallible: 80 MHz can be divided to all rates. A byte being sent is corrupted.
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
        let chunk = bytes.get(..Self::CHUNK).unwrap_or(bytes);
        loop {
            if let Ok(result) = with_timeout(Self::RETRY, self.0.write(chunk)).await {
                return result;
            }
        }
    }

    async fn flush(&mut self) -> Result<(), Error> {
        self.0.flush().await
    }
}

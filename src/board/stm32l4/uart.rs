//! A UART transmitter that always comes back.

use autoswing::app::SetBaud;
use autoswing::settings::Baud;
use embassy_stm32::usart::{BufferedUartTx, Error};
use embassy_time::{Duration, with_timeout};
use embedded_io_async::{ErrorType, Write};

/// The HAL's buffered transmitter.
pub struct UartTx(BufferedUartTx<'static>);

impl UartTx {
    /// At most so many bytes are handed to the HAL at once. Its buffer must be larger.
    pub const CHUNK: usize = 32;
    /// The time of as many bytes at 115200 baud.
    const RETRY: Duration = Duration::from_micros(2_800);

    /// Wraps a transmitter whose buffer is larger than [`CHUNK`](Self::CHUNK).
    pub fn new(tx: BufferedUartTx<'static>) -> Self {
        Self(tx)
    }
}

impl SetBaud for UartTx {
    fn set_baud(&mut self, baud: Baud) {
        // 80 MHz can be divided to any of them. What is being sent at this instant is garbled, as it would be anyway.
        let _ = self.0.set_baudrate(baud.bits_per_s());
    }
}

impl ErrorType for UartTx {
    type Error = Error;
}

impl Write for UartTx {
    /// The HAL's `write` (embassy-stm32 0.6) waits for room in its buffer without asking to be woken, so it is asked
    /// again until there is room. It takes all bytes or none, so nothing is sent twice.
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        // An empty write would leave the HAL waiting for an end of transmission that never comes.
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

//! Task of a chip that measures: initialises it and reads every measurement.

use embassy_time::{Duration, Instant, Timer, with_timeout};

use super::task_links::now;
use crate::chip::{ChipError, MeasuringChip};
use crate::log::warning;
use autoswing::time::Timestamp;

/// Delay before a failed chip is initialised again.
const RETRY_DELAY: Duration = Duration::from_millis(200);

/// Timeout of a driver call: a longer one means that the bus hangs.
const DRIVER_TIMEOUT: Duration = Duration::from_millis(400);

/// Interval of configuration checks: for so long a flipped bit may double a measurement, 2 deg of heading in a fast turn.
const VERIFICATION_INTERVAL: Duration = Duration::from_millis(100);

/// Longest time between measurements and failures of a chip that does not measure, milliseconds.
pub(super) const MAX_EVENT_INTERVAL_MS: u64 = RETRY_DELAY.as_millis() + DRIVER_TIMEOUT.as_millis();

/// Failure of a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChipFailure {
    /// The chip does not answer, or answers wrongly.
    NoAnswer,
    /// The chip's configuration has changed.
    ConfigurationLost,
}

/// Use of a chip's events.
pub(super) trait ChipEvents<C: MeasuringChip> {
    /// The chip is initialised.
    fn on_start(&mut self, chip: &C, identity: C::Identity);

    /// A measurement was read at `at`.
    fn on_measurement(&mut self, at: Timestamp, measurement: C::Measurement);

    /// The chip failed, and is initialised again.
    fn on_failure(&mut self, failure: ChipFailure);
}

/// Initialises a chip and reads every measurement; starts again after any error.
pub(super) async fn run_chip<C: MeasuringChip>(mut chip: C, mut events: impl ChipEvents<C>) -> ! {
    loop {
        let failure = match with_timeout(DRIVER_TIMEOUT, chip.init()).await {
            Ok(Ok(identity)) => {
                events.on_start(&chip, identity);
                read_until_failure(&mut chip, &mut events).await
            }
            Ok(Err(_)) | Err(_) => ChipFailure::NoAnswer,
        };
        events.on_failure(failure);
        // A chip that has lost its configuration answers, so that it is initialised again without a delay.
        if failure == ChipFailure::NoAnswer {
            warning!("a sensor does not answer, or failed its self-test");
            Timer::after(RETRY_DELAY).await;
        }
    }
}

async fn read_until_failure<C: MeasuringChip>(chip: &mut C, events: &mut impl ChipEvents<C>) -> ChipFailure {
    let mut verify_at = Instant::now() + VERIFICATION_INTERVAL;
    while let Ok(Ok(measurement)) = with_timeout(DRIVER_TIMEOUT, chip.read_measurement()).await {
        events.on_measurement(now(), measurement);
        // The configuration is verified just after a measurement, when the next one is furthest away.
        if Instant::now() >= verify_at {
            verify_at += VERIFICATION_INTERVAL;
            match with_timeout(DRIVER_TIMEOUT, chip.verify_configuration()).await {
                Ok(Ok(())) => {}
                Ok(Err(ChipError::Configuration { .. })) => return ChipFailure::ConfigurationLost,
                Ok(Err(_)) | Err(_) => break,
            }
        }
    }
    ChipFailure::NoAnswer
}

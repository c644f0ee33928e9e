use std::cell::{Cell, RefCell};
use std::rc::Rc;

use testkit::simulation::run_script;

use super::*;

/// Bus error.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BusFailure;

/// Duration of a status transfer.
const STATUS_TRANSFER_TIME: Duration = Duration::from_micros(90);

/// Simulated chip that measures at multiples of its period.
#[derive(Clone)]
struct FakeChip {
    period_us: u64,
    /// Last measurement read.
    last_read_number: Rc<Cell<u64>>,
    /// Times of status requests.
    status_requested_at_us: Rc<RefCell<Vec<u64>>>,
}

impl FakeChip {
    fn new(period_us: u64) -> Self {
        Self { period_us, last_read_number: Rc::default(), status_requested_at_us: Rc::default() }
    }

    /// Number of an unread measurement.
    async fn poll_status(&self) -> Result<Option<u64>, ChipError<BusFailure>> {
        Timer::after(STATUS_TRANSFER_TIME).await;
        let now_us = Instant::now().as_micros();
        self.status_requested_at_us.borrow_mut().push(now_us);
        let latest = now_us / self.period_us;
        Ok((latest > self.last_read_number.get()).then(|| {
            self.last_read_number.set(latest);
            latest
        }))
    }

    async fn wait_for_measurement(&self, polling: &mut PollingSchedule) -> Result<u64, ChipError<BusFailure>> {
        polling.wait_for_measurement(async || self.poll_status().await, Option::is_some).await.map(Option::unwrap)
    }
}

/// Rates of 75 to 200 Hz, oscillators off by 10 %, an RM3100's by 21 %. Each measurement is read once within two
/// polls (0.5 ms and a transfer each), and the bus is mostly idle.
#[test]
fn every_measurement_is_found_whatever_the_period() {
    for (period_us, tolerance, sleep_percent) in
        [(13_333, 10, 88), (12_500, 10, 88), (6_452, 10, 88), (5_000, 10, 88), (13_333, 21, 79)]
    {
        for actual_us in [period_us * 100 / (100 + tolerance), period_us, period_us * (100 + tolerance) / 100] {
            run_script(async move {
                let chip = FakeChip::new(actual_us);
                let mut polling = PollingSchedule::new(period_us as u32, sleep_percent);
                for number in 1..=50 {
                    assert_eq!(
                        chip.wait_for_measurement(&mut polling).await,
                        Ok(number),
                        "{actual_us} for {period_us} us"
                    );
                    let age_us = Instant::now().as_micros() - number * actual_us;
                    assert!(age_us <= 590, "{age_us} us old, {actual_us} for {period_us} us");
                }
                // The chip is polled for the rest of each period, and for the whole of the first one.
                let polls = chip.status_requested_at_us.borrow().len() as u64;
                let polled_us = actual_us - period_us * u64::from(sleep_percent) / 100;
                assert!(polls <= 50 * (2 + polled_us / 590) + actual_us / 590, "{polls} for {actual_us}");
            });
        }
    }
}

#[test]
fn a_late_reader_polls_at_once() {
    run_script(async {
        let chip = FakeChip::new(12_500);
        let mut polling = PollingSchedule::new(12_500, SLEEP_PERCENT);
        chip.wait_for_measurement(&mut polling).await.unwrap();
        Timer::after_millis(100).await;
        let start = Instant::now();
        chip.wait_for_measurement(&mut polling).await.unwrap();
        assert_eq!(start.elapsed(), STATUS_TRANSFER_TIME);
    });
}

#[test]
fn a_bus_failure_is_reported_at_once() {
    run_script(async {
        let mut polling = PollingSchedule::new(12_500, SLEEP_PERCENT);
        let answer = polling.wait_for_measurement(async || Err::<u8, _>(ChipError::Bus(BusFailure)), |_| true).await;
        assert_eq!(answer, Err(ChipError::Bus(BusFailure)));
        assert_eq!(Instant::now().as_micros(), 0);
    });
}

#[test]
fn the_first_register_that_reads_back_differently_is_reported() {
    assert_eq!(compare_readback::<BusFailure, 3>([1, 2, 3], [1, 2, 3]), Ok(()));
    assert_eq!(
        compare_readback::<BusFailure, 3>([1, 2, 3], [1, 9, 8]),
        Err(ChipError::Configuration { written: 2, read: 9 })
    );
}

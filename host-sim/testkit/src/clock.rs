//! Simulation clock behind `embassy_time`.
//!
//! The clock is thread-local, so simulations run in parallel test threads. Time stands still while tasks run and jumps
//! to the next deadline when all tasks wait (see [`Simulation`](crate::simulation::Simulation)). One tick is one
//! microsecond.

use std::cell::RefCell;
use std::task::Waker;

use embassy_time_driver::Driver;

struct Deadline {
    at_us: u64,
    /// Sequence number; equal deadlines are served in order of request.
    sequence_number: u64,
    waker: Waker,
}

struct Clock {
    now_us: u64,
    request_count: u64,
    deadlines: Vec<Deadline>,
}

thread_local! {
    static CLOCK: RefCell<Clock> = const { RefCell::new(Clock { now_us: 0, request_count: 0, deadlines: Vec::new() }) };
}

struct ThreadClock;

impl Driver for ThreadClock {
    fn now(&self) -> u64 {
        now_us()
    }

    fn schedule_wake(&self, at_us: u64, waker: &Waker) {
        CLOCK.with_borrow_mut(|clock| clock.schedule(at_us, waker));
    }
}

embassy_time_driver::time_driver_impl!(static DRIVER: ThreadClock = ThreadClock);

impl Clock {
    /// Stores only the earliest deadline per waker, as embassy's queues do: a woken task polls all its timers again. So
    /// there are at most as many deadlines as tasks.
    fn schedule(&mut self, at_us: u64, waker: &Waker) {
        self.request_count += 1;
        match self.deadlines.iter_mut().find(|deadline| deadline.waker.will_wake(waker)) {
            Some(known) if known.at_us <= at_us => {}
            Some(known) => (known.at_us, known.sequence_number) = (at_us, self.request_count),
            None => self.deadlines.push(Deadline { at_us, sequence_number: self.request_count, waker: waker.clone() }),
        }
    }

    fn take_due(&mut self) -> Vec<Deadline> {
        let now_us = self.now_us;
        let mut due: Vec<Deadline> = self.deadlines.extract_if(.., |deadline| deadline.at_us <= now_us).collect();
        due.sort_by_key(|deadline| (deadline.at_us, deadline.sequence_number));
        due
    }
}

/// Time since the start of this thread's simulation, microseconds; equals `embassy_time::Instant::now().as_micros()`.
#[must_use]
pub fn now_us() -> u64 {
    CLOCK.with_borrow(|clock| clock.now_us)
}

/// Resets time to zero and removes all deadlines.
pub fn reset() {
    CLOCK.with_borrow_mut(|clock| {
        clock.now_us = 0;
        clock.request_count = 0;
        clock.deadlines.clear();
    });
}

/// Removes the deadline of a dropped task.
pub fn remove_deadline(waker: &Waker) {
    CLOCK.with_borrow_mut(|clock| clock.deadlines.retain(|deadline| !deadline.waker.will_wake(waker)));
}

/// The earliest deadline, microseconds.
#[must_use]
pub fn next_deadline_us() -> Option<u64> {
    CLOCK.with_borrow(|clock| clock.deadlines.iter().map(|deadline| deadline.at_us).min())
}

/// Advances time to `to_us` (never back) and wakes due tasks in the order of deadlines.
pub fn advance(to_us: u64) {
    let due = CLOCK.with_borrow_mut(|clock| {
        clock.now_us = clock.now_us.max(to_us);
        clock.take_due()
    });
    // Wakes after the borrow of the clock, which a waker may read.
    for deadline in due {
        deadline.waker.wake();
    }
}

//! The virtual clock behind `embassy_time`.
//!
//! Time belongs to the thread, so that simulations run side by side in the threads of a test program. It stands still
//! while tasks run and jumps to the next deadline when none of them can: see
//! [`Simulation`](crate::simulation::Simulation). One tick is one microsecond.

use std::cell::RefCell;
use std::task::Waker;

use embassy_time_driver::Driver;

/// A task that asked to be woken.
struct Deadline {
    at_us: u64,
    /// Among equal deadlines the one asked for first is served first.
    order: u64,
    waker: Waker,
}

/// The clock of one thread.
struct Clock {
    now_us: u64,
    asked: u64,
    deadlines: Vec<Deadline>,
}

thread_local! {
    static CLOCK: RefCell<Clock> = const { RefCell::new(Clock { now_us: 0, asked: 0, deadlines: Vec::new() }) };
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
    /// Keeps one deadline a waker, the earliest, as embassy's own queues do: a task that wakes early looks at all its
    /// timers and asks again. So there are never more deadlines than tasks.
    fn schedule(&mut self, at_us: u64, waker: &Waker) {
        self.asked += 1;
        match self.deadlines.iter_mut().find(|deadline| deadline.waker.will_wake(waker)) {
            Some(known) if known.at_us <= at_us => {}
            Some(known) => (known.at_us, known.order) = (at_us, self.asked),
            None => self.deadlines.push(Deadline { at_us, order: self.asked, waker: waker.clone() }),
        }
    }

    fn take_due(&mut self) -> Vec<Deadline> {
        let now_us = self.now_us;
        let mut due: Vec<Deadline> = self.deadlines.extract_if(.., |deadline| deadline.at_us <= now_us).collect();
        due.sort_by_key(|deadline| (deadline.at_us, deadline.order));
        due
    }
}

/// Microseconds since this thread's simulation began. The same as `embassy_time::Instant::now().as_micros()`.
#[must_use]
pub fn now_us() -> u64 {
    CLOCK.with_borrow(|clock| clock.now_us)
}

/// Back to zero, with no deadlines.
pub fn reset() {
    CLOCK.with_borrow_mut(|clock| {
        clock.now_us = 0;
        clock.asked = 0;
        clock.deadlines.clear();
    });
}

/// Forgets the deadlines of a task that is gone.
pub fn forget(waker: &Waker) {
    CLOCK.with_borrow_mut(|clock| clock.deadlines.retain(|deadline| !deadline.waker.will_wake(waker)));
}

/// The earliest deadline.
#[must_use]
pub fn next_deadline_us() -> Option<u64> {
    CLOCK.with_borrow(|clock| clock.deadlines.iter().map(|deadline| deadline.at_us).min())
}

/// Moves time forward to `to_us` (never back) and wakes whoever is due, in the order of deadlines.
pub fn advance(to_us: u64) {
    let due = CLOCK.with_borrow_mut(|clock| {
        clock.now_us = clock.now_us.max(to_us);
        clock.take_due()
    });
    // Outside the borrow: a waker may run code that asks for the time.
    for deadline in due {
        deadline.waker.wake();
    }
}

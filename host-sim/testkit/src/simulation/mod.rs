//! A deterministic, single-threaded executor in virtual time.
//!
//! Tasks run in the order in which they were woken, a more urgent [`Level`] first. When none is ready, time jumps to
//! the next deadline. Computing takes no virtual time. A task runs until its next wait: a more urgent one cannot
//! interrupt it in between, as it could on a board.

use std::cell::Cell;
use std::collections::VecDeque;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Wake, Waker};

use crate::clock;

/// Polls of one task within one instant after which it is taken for a busy loop. The hungriest honest task parses a
/// full receive buffer byte by byte: some hundreds.
const BUSY_LOOP_POLLS: u32 = 100_000;

/// How urgent a task is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Not the module but what is around it (autopilot, pilot): first, and not touched by [`Simulation::power_off`].
    World,
    /// The module's interrupt executor.
    Interrupt,
    /// The module's thread-mode executor.
    Thread,
}

const LEVELS: usize = 3;

/// Why [`Simulation::run_until`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The time asked for has come.
    Time,
    /// Somebody called [`Stop::request`]; time stands at that instant.
    Stopped,
}

/// Ends [`Simulation::run_until`] from within a task: how the module asks for a reboot, or a device cuts the power.
#[derive(Clone, Debug, Default)]
pub struct Stop(Rc<Cell<bool>>);

impl Stop {
    /// Ends the run as soon as the task that is running waits.
    pub fn request(&self) {
        self.0.set(true);
    }
}

/// Identities of tasks that are ready, by level. Wakers must be `Send`, hence the lock; it is never contended.
#[derive(Default)]
struct Ready([Mutex<VecDeque<u64>>; LEVELS]);

impl Ready {
    fn push(&self, level: Level, id: u64) {
        self.0[level as usize].lock().unwrap_or_else(PoisonError::into_inner).push_back(id);
    }

    fn pop(&self) -> Option<u64> {
        self.0.iter().find_map(|queue| queue.lock().unwrap_or_else(PoisonError::into_inner).pop_front())
    }
}

struct TaskWaker {
    id: u64,
    level: Level,
    queued: AtomicBool,
    ready: Arc<Ready>,
}

impl Wake for TaskWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if !self.queued.swap(true, Ordering::Relaxed) {
            self.ready.push(self.level, self.id);
        }
    }
}

struct Task {
    name: &'static str,
    handle: Arc<TaskWaker>,
    waker: Waker,
    future: Pin<Box<dyn Future<Output = ()>>>,
    /// The instant of the last poll and how often the task was polled in it.
    polled: (u64, u32),
}

impl Drop for Task {
    fn drop(&mut self) {
        clock::forget(&self.waker);
    }
}

/// Tasks and the virtual time they live in. One at a time per thread, because the clock is the thread's.
pub struct Simulation {
    tasks: Vec<Task>,
    ready: Arc<Ready>,
    spawned: u64,
    stop: Stop,
}

impl Default for Simulation {
    fn default() -> Self {
        Self::new()
    }
}

impl Simulation {
    /// No tasks; this thread's clock starts again at zero.
    #[must_use]
    pub fn new() -> Self {
        clock::reset();
        Self { tasks: Vec::new(), ready: Arc::default(), spawned: 0, stop: Stop::default() }
    }

    /// Adds a task. It is first polled by the next run; `name` is for messages.
    pub fn spawn(&mut self, level: Level, name: &'static str, future: impl Future<Output = ()> + 'static) {
        self.spawned += 1;
        let handle = Arc::new(TaskWaker {
            id: self.spawned,
            level,
            queued: AtomicBool::new(false),
            ready: Arc::clone(&self.ready),
        });
        let waker = Waker::from(Arc::clone(&handle));
        waker.wake_by_ref();
        self.tasks.push(Task { name, handle, waker, future: Box::pin(future), polled: (0, 0) });
    }

    /// Microseconds since the simulation began.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        clock::now_us()
    }

    /// A handle that ends a run from within a task.
    #[must_use]
    pub fn stop(&self) -> Stop {
        self.stop.clone()
    }

    /// How many tasks have not ended, of all levels.
    #[must_use]
    pub fn tasks(&self) -> usize {
        self.tasks.len()
    }

    /// Runs to `until_us` inclusive: everything due at that instant has run when it returns.
    ///
    /// # Panics
    ///
    /// When a task is polled without end while time stands still: a busy loop, which on a board would starve every
    /// task below it.
    pub fn run_until(&mut self, until_us: u64) -> Ended {
        self.stop.0.set(false);
        loop {
            clock::advance(clock::now_us());
            while let Some(id) = self.ready.pop() {
                self.poll(id);
                if self.stop.0.get() {
                    return Ended::Stopped;
                }
            }
            match clock::next_deadline_us() {
                Some(at_us) if at_us <= until_us => clock::advance(at_us),
                _ => {
                    clock::advance(until_us);
                    return Ended::Time;
                }
            }
        }
    }

    /// Runs for `duration_us` from now.
    ///
    /// # Panics
    ///
    /// As [`run_until`](Self::run_until).
    pub fn run_for(&mut self, duration_us: u64) -> Ended {
        self.run_until(clock::now_us() + duration_us)
    }

    /// Drops the module's tasks wherever they wait; the world's tasks and the clock go on.
    pub fn power_off(&mut self) {
        self.tasks.retain(|task| task.handle.level == Level::World);
    }

    fn poll(&mut self, id: u64) {
        // A task that is gone may still be woken by what outlived it.
        let Some(index) = self.tasks.iter().position(|task| task.handle.id == id) else { return };
        let task = &mut self.tasks[index];
        task.handle.queued.store(false, Ordering::Relaxed);
        task.count_poll(clock::now_us());
        if task.future.as_mut().poll(&mut Context::from_waker(&task.waker)).is_ready() {
            self.tasks.remove(index);
        }
    }
}

impl Task {
    fn count_poll(&mut self, now_us: u64) {
        let polls = if self.polled.0 == now_us { self.polled.1 + 1 } else { 1 };
        assert!(polls <= BUSY_LOOP_POLLS, "task `{}` is in a busy loop: {polls} polls at {now_us} us", self.name);
        self.polled = (now_us, polls);
    }
}

#[cfg(test)]
mod tests;

//! Deterministic single-threaded executor in simulation time.
//!
//! Ready tasks run in the order of wake-up, more urgent [`ExecutorLevel`]s first. When no task is ready, time jumps to the next
//! deadline. Computation takes no simulation time. Unlike on a board, tasks do not preempt each other.

use std::cell::Cell;
use std::collections::VecDeque;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Wake, Waker};

use crate::clock;

/// Polls of one task at one instant above which it counts as a busy loop. The largest legitimate number, a few hundred,
/// comes from parsing a full receive buffer byte by byte.
const BUSY_LOOP_POLLS: u32 = 100_000;

/// Priority of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExecutorLevel {
    /// Surroundings of the module (autopilot, pilot): first, and not affected by [`Simulation::power_off`].
    World,
    /// The module's interrupt executor.
    Interrupt,
    /// The module's thread-mode executor.
    Thread,
}

const LEVEL_COUNT: usize = 3;

/// Reason for which [`Simulation::run_until`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// The requested time was reached.
    Time,
    /// A task called [`Stop::request`]; time remains at that instant.
    Stopped,
}

/// Handle that ends [`Simulation::run_until`] from within a task, for a reboot or a power cut.
#[derive(Clone, Debug, Default)]
pub struct Stop(Rc<Cell<bool>>);

impl Stop {
    /// Ends the run when the present task waits.
    pub fn request(&self) {
        self.0.set(true);
    }
}

/// Ready task IDs by level. The lock, required because wakers are `Send`, is never contended.
#[derive(Default)]
struct ReadyQueue([Mutex<VecDeque<u64>>; LEVEL_COUNT]);

impl ReadyQueue {
    fn push(&self, level: ExecutorLevel, id: u64) {
        self.0[level as usize].lock().unwrap_or_else(PoisonError::into_inner).push_back(id);
    }

    fn pop(&self) -> Option<u64> {
        self.0.iter().find_map(|queue| queue.lock().unwrap_or_else(PoisonError::into_inner).pop_front())
    }
}

struct TaskWaker {
    id: u64,
    level: ExecutorLevel,
    queued: AtomicBool,
    ready: Arc<ReadyQueue>,
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
    /// Instant of the last poll, and number of polls at it.
    poll_count_at_instant: (u64, u32),
}

impl Drop for Task {
    fn drop(&mut self) {
        clock::remove_deadline(&self.waker);
    }
}

/// Tasks and their clock. One simulation per thread at a time, because the clock is thread-local.
pub struct Simulation {
    tasks: Vec<Task>,
    ready: Arc<ReadyQueue>,
    spawned_count: u64,
    stop: Stop,
}

impl Default for Simulation {
    fn default() -> Self {
        Self::new()
    }
}

impl Simulation {
    /// A simulation without tasks; resets this thread's clock to zero.
    #[must_use]
    pub fn new() -> Self {
        clock::reset();
        Self { tasks: Vec::new(), ready: Arc::default(), spawned_count: 0, stop: Stop::default() }
    }

    /// Adds a task, first polled by the next run; `name` appears in messages.
    pub fn spawn(&mut self, level: ExecutorLevel, name: &'static str, future: impl Future<Output = ()> + 'static) {
        self.spawned_count += 1;
        let handle = Arc::new(TaskWaker {
            id: self.spawned_count,
            level,
            queued: AtomicBool::new(false),
            ready: Arc::clone(&self.ready),
        });
        let waker = Waker::from(Arc::clone(&handle));
        waker.wake_by_ref();
        self.tasks.push(Task { name, handle, waker, future: Box::pin(future), poll_count_at_instant: (0, 0) });
    }

    /// Simulation time, microseconds.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        clock::now_us()
    }

    /// A handle that ends a run from within a task.
    #[must_use]
    pub fn stop_handle(&self) -> Stop {
        self.stop.clone()
    }

    /// Number of unfinished tasks of all levels.
    #[must_use]
    pub fn task_count(&self) -> usize {
        self.tasks.len()
    }

    /// Runs to `until_us` inclusive.
    ///
    /// # Panics
    ///
    /// If a task runs a busy loop while time stands still; on a board it would starve all tasks below it.
    pub fn run_until(&mut self, until_us: u64) -> RunEnd {
        self.stop.0.set(false);
        clock::advance(clock::now_us());
        loop {
            while let Some(id) = self.ready.pop() {
                self.poll(id);
                if self.stop.0.get() {
                    return RunEnd::Stopped;
                }
            }
            match clock::next_deadline_us() {
                Some(at_us) if at_us <= until_us => clock::advance(at_us),
                _ => {
                    clock::advance(until_us);
                    return RunEnd::Time;
                }
            }
        }
    }

    /// Runs for `duration_us` from now.
    ///
    /// # Panics
    ///
    /// As [`run_until`](Self::run_until).
    pub fn run_for(&mut self, duration_us: u64) -> RunEnd {
        self.run_until(clock::now_us() + duration_us)
    }

    /// Adds a task and runs until it has ended.
    ///
    /// # Panics
    ///
    /// If it takes more than 100 s of simulation time.
    pub fn run_to_end(&mut self, level: ExecutorLevel, task: impl Future<Output = ()> + 'static) {
        let other_tasks = self.task_count();
        self.spawn(level, "script", task);
        self.run_for(100_000_000);
        assert_eq!(self.task_count(), other_tasks, "the script did not end");
    }

    /// Drops the module's tasks; tasks of level `World` and the clock continue.
    pub fn power_off(&mut self) {
        self.tasks.retain(|task| task.handle.level == ExecutorLevel::World);
    }

    fn poll(&mut self, id: u64) {
        // Wakers may outlive their task. The tasks are in the order of their ids.
        let Ok(index) = self.tasks.binary_search_by_key(&id, |task| task.handle.id) else { return };
        let task = &mut self.tasks[index];
        task.handle.queued.store(false, Ordering::Relaxed);
        task.count_poll(clock::now_us());
        if task.future.as_mut().poll(&mut Context::from_waker(&task.waker)).is_ready() {
            self.tasks.remove(index);
        }
    }
}

/// Runs a script alone, in a new simulation, until it ends.
///
/// # Panics
///
/// If it does not end within 100 s of simulation time.
pub fn run_script(script: impl Future<Output = ()> + 'static) {
    Simulation::new().run_to_end(ExecutorLevel::Interrupt, script);
}

impl Task {
    fn count_poll(&mut self, now_us: u64) {
        let polls = if self.poll_count_at_instant.0 == now_us { self.poll_count_at_instant.1 + 1 } else { 1 };
        assert!(polls <= BUSY_LOOP_POLLS, "task `{}` is in a busy loop: {polls} polls at {now_us} us", self.name);
        self.poll_count_at_instant = (now_us, polls);
    }
}

#[cfg(test)]
mod tests;

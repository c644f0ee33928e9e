use std::cell::RefCell;

use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Instant, Timer};

use super::*;

type Log = Rc<RefCell<Vec<(u64, &'static str)>>>;

fn log_event(log: &Log, event: &'static str) {
    log.borrow_mut().push((clock::now_us(), event));
}

#[test]
fn timers_fire_at_their_time_and_in_order() {
    let mut simulation = Simulation::new();
    let log = Log::default();
    for (name, delay_us) in [("late", 3_600_000_000), ("second", 500), ("first", 499), ("third", 500)] {
        let log = Rc::clone(&log);
        simulation.spawn(ExecutorLevel::Thread, name, async move {
            Timer::after_micros(delay_us).await;
            assert_eq!(Instant::now().as_micros(), clock::now_us());
            log_event(&log, name);
        });
    }
    assert_eq!(simulation.run_until(3_600_000_000), RunEnd::Time);
    assert_eq!(*log.borrow(), [(499, "first"), (500, "second"), (500, "third"), (3_600_000_000, "late")]);
    assert_eq!(simulation.task_count(), 0);
}

#[test]
fn urgent_levels_run_first_and_equal_ones_alternate() {
    let mut simulation = Simulation::new();
    let log = Log::default();
    let tasks = [
        ("thread a", ExecutorLevel::Thread),
        ("thread b", ExecutorLevel::Thread),
        ("interrupt", ExecutorLevel::Interrupt),
        ("world", ExecutorLevel::World),
    ];
    for (name, level) in tasks {
        let log = Rc::clone(&log);
        simulation.spawn(level, name, async move {
            for _ in 0..2 {
                log_event(&log, name);
                yield_now().await;
            }
        });
    }
    simulation.run_until(0);
    let names: Vec<_> = log.borrow().iter().map(|entry| entry.1).collect();
    assert_eq!(names, ["world", "world", "interrupt", "interrupt", "thread a", "thread b", "thread a", "thread b"]);
}

struct DropFlag(Rc<Cell<bool>>);

impl Drop for DropFlag {
    fn drop(&mut self) {
        self.0.set(true);
    }
}

#[test]
fn power_off_drops_the_module_and_its_timers_but_not_the_world() {
    let mut simulation = Simulation::new();
    let (dropped, log) = (Rc::new(Cell::new(false)), Log::default());
    let (guard, world_log) = (DropFlag(Rc::clone(&dropped)), Rc::clone(&log));
    simulation.spawn(ExecutorLevel::Thread, "module", async move {
        let _guard = guard;
        Timer::after_millis(10).await;
        unreachable!("the power went at 5 ms");
    });
    simulation.spawn(ExecutorLevel::World, "world", async move {
        Timer::after_millis(20).await;
        log_event(&world_log, "world");
    });
    simulation.run_until(5_000);
    simulation.power_off();
    assert!(dropped.get());
    assert_eq!(clock::next_deadline_us(), Some(20_000), "the module's timer is gone, the world's is not");

    let log_again = Rc::clone(&log);
    simulation.spawn(ExecutorLevel::Thread, "module again", async move {
        Timer::after_millis(10).await;
        log_event(&log_again, "module");
    });
    simulation.run_until(100_000);
    assert_eq!(*log.borrow(), [(15_000, "module"), (20_000, "world")], "time went on over the reboot");
    assert_eq!(clock::next_deadline_us(), None);

    let simulation = Simulation::new();
    assert_eq!(simulation.now_us(), 0, "a new simulation begins at zero");
}

#[test]
fn a_waker_of_a_dropped_task_has_no_effect() {
    let mut simulation = Simulation::new();
    let channel = Rc::new(Channel::<CriticalSectionRawMutex, u32, 4>::new());
    let receiver = Rc::clone(&channel);
    simulation.spawn(ExecutorLevel::Thread, "before", async move {
        receiver.receive().await;
        unreachable!("dropped before anything was sent");
    });
    simulation.run_until(10);
    simulation.power_off();
    simulation.spawn(ExecutorLevel::Thread, "after", std::future::pending());
    channel.try_send(1).unwrap();
    assert_eq!(simulation.run_until(20), RunEnd::Time);
}

#[test]
fn stop_ends_the_run_at_its_time() {
    let mut simulation = Simulation::new();
    let stop = simulation.stop_handle();
    simulation.spawn(ExecutorLevel::Thread, "reboot", async move {
        Timer::after_millis(7).await;
        stop.request();
        Timer::after_millis(1).await;
    });
    assert_eq!(simulation.run_until(1_000_000), RunEnd::Stopped);
    assert_eq!((simulation.now_us(), simulation.task_count()), (7_000, 1));
    assert_eq!(simulation.run_until(1_000_000), RunEnd::Time, "a stop lasts for one run");
    assert_eq!(simulation.task_count(), 0);
}

#[test]
#[should_panic(expected = "task `spinner` is in a busy loop: 100001 polls at 3 us")]
fn a_busy_loop_panics_with_the_task_name() {
    let mut simulation = Simulation::new();
    simulation.spawn(ExecutorLevel::Thread, "spinner", async {
        Timer::after_micros(3).await;
        loop {
            yield_now().await;
        }
    });
    simulation.run_until(10);
}

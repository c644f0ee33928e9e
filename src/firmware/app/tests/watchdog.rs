//! The watchdog task.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::atomic::AtomicU32;

use embassy_time::Timer;
use testkit::flash::SilentFault;

use super::TaskBench;
use super::thread_tasks::{Flash, PAGE_COUNT, bench_with_compass};
use crate::app::task_links::{
    AutopilotLine, COMMON_HEARTBEAT_COUNTERS, CommandSource, Heartbeats, MAX_HEARTBEAT_COUNTERS, increment_counter,
};
use crate::app::watchdog::{self, MAX_FEED_INTERVAL_US};
use crate::app::{TaskLinks, Watchdog};
use autoswing_module::compass::Command;
use autoswing_module::messages::Refusal;
use autoswing_module::store::StoreError;

/// Number of feeds, and time of the first mark of a good image, milliseconds.
#[derive(Clone, Default)]
struct FakeWatchdog(Rc<Cell<u32>>, Rc<Cell<Option<u64>>>);

impl Watchdog for FakeWatchdog {
    fn feed(&mut self) {
        self.0.set(self.0.get() + 1);
    }

    fn mark_image_good(&mut self) {
        self.1.set(self.1.get().or(Some(embassy_time::Instant::now().as_millis())));
    }
}

fn all_heartbeats(links: &TaskLinks) -> [&AtomicU32; MAX_HEARTBEAT_COUNTERS] {
    let Heartbeats { sensor, instrument, compass } = &links.heartbeats;
    let [one, two, can] = AutopilotLine::ALL_LINES.map(|line| &links.links_of_line(line).heartbeat);
    [sensor, instrument, compass, one, two, can]
}

/// Tasks with heartbeats, one of which may stop after a second.
fn bench_with_silent_task(silent_task: Option<usize>) -> (TaskBench, FakeWatchdog) {
    let (mut bench, watchdog_timer) = (TaskBench::new(), FakeWatchdog::default());
    let fed = watchdog_timer.clone();
    bench.spawn_task("watchdog", |links| async move { watchdog::run_watchdog(&links, fed).await });
    bench.spawn_task("tasks", |links: Rc<TaskLinks>| async move {
        for ms in (0..).step_by(100) {
            for (i, beat) in all_heartbeats(&links).into_iter().enumerate() {
                if silent_task != Some(i) || ms < 1000 {
                    increment_counter(beat);
                }
            }
            Timer::after_millis(100).await;
        }
    });
    (bench, watchdog_timer)
}

#[test]
fn the_watchdog_is_fed_while_all_tasks_run() {
    let (mut bench, watchdog_timer) = bench_with_silent_task(None);
    bench.run_for_ms(7_050);
    assert_eq!(watchdog_timer.0.get(), 10);
}

#[test]
fn the_watchdog_is_not_fed_after_any_task_stops() {
    for silent in 0..MAX_HEARTBEAT_COUNTERS {
        let (mut bench, watchdog_timer) = bench_with_silent_task(Some(silent));
        bench.run_for_ms(1_450);
        let feeds = watchdog_timer.0.get();
        assert_eq!(feeds, 2, "task {silent}");
        bench.run_for_ms(10_000);
        assert_eq!(watchdog_timer.0.get(), feeds, "task {silent}");
    }
}

/// At the first check after 30 s; a boot loader then starts the image again after a reset by the watchdog.
#[test]
fn an_image_is_marked_good_after_30_s() {
    let (mut bench, watchdog_timer) = bench_with_silent_task(None);
    bench.run_for_ms(60_000);
    assert_eq!(watchdog_timer.1.get(), Some(30_100));
}

#[test]
fn an_image_whose_tasks_do_not_run_is_not_good() {
    for silent in 0..MAX_HEARTBEAT_COUNTERS {
        let (mut bench, watchdog_timer) = bench_with_silent_task(Some(silent));
        bench.run_for_ms(60_000);
        assert_eq!(watchdog_timer.1.get(), None, "task {silent}");
    }
}

/// A check fails 20 s after the start.
#[test]
fn an_interruption_restarts_the_30_s_of_a_good_image() {
    let (mut bench, watchdog_timer) = (TaskBench::new(), FakeWatchdog::default());
    let watchdog_clone = watchdog_timer.clone();
    bench.spawn_task("watchdog", |links| async move { watchdog::run_watchdog(&links, watchdog_clone).await });
    bench.spawn_task("tasks", move |links: Rc<TaskLinks>| async move {
        for ms in (0..).step_by(100) {
            if !(19_500..21_000).contains(&ms) {
                all_heartbeats(&links).into_iter().for_each(increment_counter);
            }
            Timer::after_millis(100).await;
        }
    });
    bench.run_for_ms(50_000);
    assert_eq!(watchdog_timer.1.get(), None);
    bench.run_for_ms(3_000);
    assert_eq!(watchdog_timer.1.get(), Some(51_100));
}

/// A board has fewer lines than there are heartbeat counters.
#[test]
fn the_watchdog_does_not_wait_for_lines_that_never_ran() {
    for (counted_tasks, fed) in [(COMMON_HEARTBEAT_COUNTERS, 10), (COMMON_HEARTBEAT_COUNTERS - 1, 0)] {
        let (mut bench, watchdog_timer) = (TaskBench::new(), FakeWatchdog::default());
        let watchdog_clone = watchdog_timer.clone();
        bench.spawn_task("watchdog", |links| async move { watchdog::run_watchdog(&links, watchdog_clone).await });
        bench.spawn_task("tasks", move |links: Rc<TaskLinks>| async move {
            loop {
                all_heartbeats(&links).into_iter().take(counted_tasks).for_each(increment_counter);
                Timer::after_millis(100).await;
            }
        });
        bench.run_for_ms(7_050);
        assert_eq!(watchdog_timer.0.get(), fed, "{counted_tasks} tasks");
    }
}

/// The boards set the timeout of their watchdog from this value.
#[test]
fn the_longest_feed_interval_is_1_4_s() {
    assert_eq!(MAX_FEED_INTERVAL_US, 1_400_000);
}

#[test]
fn an_idle_state_machine_shows_that_it_runs() {
    let mut bench = bench_with_compass(Flash::new(PAGE_COUNT));
    bench.run_for_ms(998);
    assert_eq!(bench.links.heartbeat_counts(), [0, 0, 5, 0, 0, 0]);
}

/// The state machine gives a save up before the watchdog would reset the module.
#[test]
fn saves_that_never_complete_cause_no_reset() {
    let mut flash = Flash::new(PAGE_COUNT);
    flash.silent_fault = Some(SilentFault::WritesHang);
    let (mut bench, watchdog_timer) = (bench_with_compass(flash), FakeWatchdog::default());
    let fed = watchdog_timer.clone();
    bench.spawn_task("watchdog", |links| async move { watchdog::run_watchdog(&links, fed).await });
    bench.spawn_task("other tasks", |links: Rc<TaskLinks>| async move {
        loop {
            all_heartbeats(&links)
                .into_iter()
                .enumerate()
                .filter(|(i, _)| *i != 2)
                .for_each(|(_, beat)| increment_counter(beat));
            Timer::after_millis(100).await;
        }
    });
    bench.spawn_task("person", |links: Rc<TaskLinks>| async move {
        loop {
            links.commands.send((CommandSource::Console, Command::CalClear)).await;
            assert!(matches!(links.replies.receive().await, Err(Refusal::Store(StoreError::Timeout))));
        }
    });
    bench.run_for_ms(7_050);
    assert_eq!(watchdog_timer.0.get(), 10);
    assert!(bench.links.event_counts().store_errors >= 13);
}

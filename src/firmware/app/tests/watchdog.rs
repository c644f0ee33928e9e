//! The watchdog task.

use std::rc::Rc;

use embassy_time::Timer;

use super::TaskBench;
use super::devices::FakeWatchdog;
use crate::app::TaskLinks;
use crate::app::task_links::{
    AutopilotLine, COMMON_HEARTBEAT_COUNTERS, Heartbeats, MAX_HEARTBEAT_COUNTERS, increment_counter,
};
use crate::app::watchdog::{self, MAX_FEED_INTERVAL_US};

/// The watchdog, and tasks that send heartbeats every 100 ms, each as long as it runs: its index and a time in
/// milliseconds.
fn bench_with_heartbeats(is_running: impl Fn(usize, u64) -> bool + 'static) -> (TaskBench, FakeWatchdog) {
    let (mut bench, watchdog) = (TaskBench::new(), FakeWatchdog::default());
    let fed = watchdog.clone();
    bench.spawn_task("watchdog", |links| async move { watchdog::run_watchdog(&links, fed).await });
    bench.spawn_task("tasks", |links: Rc<TaskLinks>| async move {
        let Heartbeats { sensor, instrument, compass } = &links.heartbeats;
        let [one, two, can] = AutopilotLine::ALL_LINES.map(|line| &links.links_of_line(line).heartbeat);
        for ms in (0..).step_by(100) {
            let heartbeats = [sensor, instrument, compass, one, two, can].into_iter().enumerate();
            heartbeats.filter(|(task, _)| is_running(*task, ms)).for_each(|(_, beat)| increment_counter(beat));
            Timer::after_millis(100).await;
        }
    });
    (bench, watchdog)
}

/// After 30 s a boot loader starts the image again after a reset by the watchdog.
#[test]
fn the_watchdog_is_fed_and_the_image_good_after_30_s_of_all_tasks() {
    let (mut bench, watchdog) = bench_with_heartbeats(|_, _| true);
    bench.run_for_ms(60_000);
    assert_eq!((watchdog.feed_count.get(), watchdog.marked_good_at_ms.get()), (85, Some(30_100)));
}

#[test]
fn the_watchdog_is_not_fed_and_the_image_not_good_after_any_task_stops() {
    for silent in 0..MAX_HEARTBEAT_COUNTERS {
        let (mut bench, watchdog) = bench_with_heartbeats(move |task, ms| task != silent || ms < 1000);
        bench.run_for_ms(60_000);
        assert_eq!((watchdog.feed_count.get(), watchdog.marked_good_at_ms.get()), (2, None), "task {silent}");
    }
}

/// The check 20 s after the start fails. The boards set the period of their watchdog to more than the longest interval.
#[test]
fn one_failed_check_is_allowed_and_restarts_the_30_s_of_a_good_image() {
    let (mut bench, watchdog) = bench_with_heartbeats(|_, ms| !(19_600..20_300).contains(&ms));
    bench.run_for_ms(50_000);
    assert_eq!(watchdog.marked_good_at_ms.get(), None);
    bench.run_for_ms(3_000);
    assert!(watchdog.marked_good_at_ms.get().is_some());
    assert_eq!(watchdog.longest_interval_us.get(), MAX_FEED_INTERVAL_US);
}

/// A board has fewer lines than there are heartbeat counters.
#[test]
fn the_watchdog_does_not_wait_for_lines_that_never_ran() {
    for (task_count, feed_count) in [(COMMON_HEARTBEAT_COUNTERS, 10), (COMMON_HEARTBEAT_COUNTERS - 1, 0)] {
        let (mut bench, watchdog) = bench_with_heartbeats(move |task, _| task < task_count);
        bench.run_for_ms(7_050);
        assert_eq!(watchdog.feed_count.get(), feed_count, "{task_count} tasks");
    }
}

#[test]
fn an_idle_state_machine_shows_that_it_runs() {
    let mut bench = TaskBench::with_compass();
    bench.run_for_ms(998);
    assert_eq!(bench.links.heartbeat_counts(), [0, 0, 5, 0, 0, 0]);
}

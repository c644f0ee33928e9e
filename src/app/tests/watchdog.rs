//! The watchdog task: fed while all live, and only then.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::atomic::AtomicU32;

use embassy_time::Timer;

use super::Bed;
use crate::app::links::{ALWAYS_THERE, HEARTBEATS, Heartbeats, count};
use crate::app::watchdog::{self, LONGEST_WITHOUT_FEED_US};
use crate::app::{Links, Watchdog};
use crate::settings::PortNumber;

#[derive(Clone, Default)]
struct Dog(Rc<Cell<u32>>);

impl Watchdog for Dog {
    fn feed(&mut self) {
        self.0.set(self.0.get() + 1);
    }
}

fn all(links: &Links) -> [&AtomicU32; HEARTBEATS] {
    let Heartbeats { sensor, instrument, below } = &links.heartbeats;
    let [one, two] = PortNumber::ALL.map(|number| &links.port(number).heartbeat);
    [sensor, instrument, below, one, two]
}

/// Tasks that live, but for one that falls silent after a second.
fn with_silent(silent: Option<usize>) -> (Bed, Dog) {
    let (mut bed, dog) = (Bed::new(), Dog::default());
    let fed = dog.clone();
    bed.run("watchdog", |links| async move { watchdog::run(&links, fed).await });
    bed.run("tasks", |links: Rc<Links>| async move {
        for ms in (0..).step_by(100) {
            for (i, beat) in all(&links).into_iter().enumerate() {
                if silent != Some(i) || ms < 1000 {
                    count(beat);
                }
            }
            Timer::after_millis(100).await;
        }
    });
    (bed, dog)
}

/// Every 0.7 s.
#[test]
fn it_is_fed_while_all_live() {
    let (mut bed, dog) = with_silent(None);
    bed.ms(7_050);
    assert_eq!(dog.0.get(), 10);
}

#[test]
fn it_starves_when_any_one_falls_silent() {
    for silent in 0..HEARTBEATS {
        let (mut bed, dog) = with_silent(Some(silent));
        bed.ms(1_450);
        let fed = dog.0.get();
        assert_eq!(fed, 2, "task {silent}");
        bed.ms(10_000);
        assert_eq!(dog.0.get(), fed, "task {silent}");
    }
}

/// A board with one port is fed; one whose first port never comes to life is not.
#[test]
fn ports_that_do_not_run_are_not_waited_for() {
    for (living, fed) in [(ALWAYS_THERE, 10), (ALWAYS_THERE - 1, 0)] {
        let (mut bed, dog) = (Bed::new(), Dog::default());
        let kept = dog.clone();
        bed.run("watchdog", |links| async move { watchdog::run(&links, kept).await });
        bed.run("tasks", move |links: Rc<Links>| async move {
            loop {
                all(&links).into_iter().take(living).for_each(count);
                Timer::after_millis(100).await;
            }
        });
        bed.ms(7_050);
        assert_eq!(dog.0.get(), fed, "{living} tasks");
    }
}

/// What the boards' hardware is set by: two looks.
#[test]
fn the_longest_time_between_feeds_is_two_looks() {
    assert_eq!(LONGEST_WITHOUT_FEED_US, 1_400_000);
}

/// The pulse of the lower executor comes five times a second.
#[test]
fn the_lower_executor_shows_that_it_gets_round() {
    let mut bed = Bed::new();
    bed.run("pulse", |links| async move { watchdog::pulse(&links).await });
    bed.ms(999);
    assert_eq!(bed.links.life(), [0, 0, 5, 0, 0]);
}

//! Lamp and button: what a person beside the aircraft sees and can do.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use embassy_time::Instant;
use testkit::flash::RamFlash;

use super::Bed;
use super::below::ask;
use super::devices::{Chip, SENSOR};
use crate::app::compass;
use crate::app::links::{FoundSensor, publish};
use crate::app::panel::{self, Panel};
use crate::collection::Kept;
use crate::compass::{Command, Glance, Reply, State};
use crate::frames::Attitude;
use crate::heading::NoHeading;
use crate::instrument::Estimate;
use crate::store::Store;

/// When the lamp changed, milliseconds, and to what; and whether the button is down.
#[derive(Clone, Default)]
struct Post {
    lamp: Rc<RefCell<Vec<(u64, bool)>>>,
    is_down: Rc<Cell<bool>>,
}

impl Panel for Post {
    fn light(&mut self, on: bool) {
        let mut lamp = self.lamp.borrow_mut();
        if lamp.last().is_none_or(|&(_, before)| before != on) {
            lamp.push((Instant::now().as_millis(), on));
        }
    }

    fn is_pressed(&self) -> bool {
        self.is_down.get()
    }
}

fn with_panel() -> (Bed, Post) {
    let (mut bed, post) = (Bed::new(), Post::default());
    let seen = post.clone();
    bed.run("panel", |links| async move { panel::run(&links, seen).await });
    (bed, post)
}

/// Share of the time in which it is lit, percent, and changes a second, over two rounds.
fn shown(glance: Option<Glance>, heading: NoHeading, attitude: Option<Attitude>) -> (u64, u64) {
    let (mut bed, post) = with_panel();
    if let Some(glance) = glance {
        publish(&bed.links.glance, glance);
        publish(&bed.links.estimates, Estimate { attitude, heading: Err(heading), ..Estimate::NOTHING });
    }
    let begin = Instant::now().as_millis();
    bed.ms(4_000);
    let lamp = post.lamp.borrow();
    let ends = lamp.iter().skip(1).map(|&(at, _)| at).chain([begin + 4_000]);
    let lit: u64 = lamp.iter().zip(ends).filter(|((_, on), _)| *on).map(|(&(at, _), end)| end - at).sum();
    (lit / 40, lamp.len() as u64 / 4)
}

/// Each is told from the others at a glance, and none stands still.
#[test]
fn the_lamp_tells_how_it_is() {
    let flying = Some(Attitude::default());
    let of = |glance| shown(Some(glance), NoHeading::Uncalibrated, flying);
    // The lamp is looked at every 50 ms, which ends up in a part of the last round.
    for (glance, lit) in [(Glance::Waiting, 5), (Glance::Calibrated, 95)] {
        let (found, changes) = of(glance);
        assert!(found.abs_diff(lit) <= 2 && changes == 1, "{glance:?} {found} {changes}");
    }
    for (percent, lit) in [(0, 10), (10, 10), (40, 40), (90, 90), (100, 90)] {
        let (found, changes) = of(Glance::Collecting(percent));
        assert!(found.abs_diff(lit) <= 2, "{percent} {found}");
        assert_eq!(changes, 2);
    }
    let (lit, changes) = of(Glance::Refused);
    assert!(lit.abs_diff(50) <= 2 && changes >= 9, "{lit} {changes}");
}

/// Trouble, whatever the state machine says: nothing is known yet, no sensor, no attitude, a field that cannot be. Who
/// tumbles the module on a bench has no attitude, and no trouble.
#[test]
fn what_takes_the_heading_away_is_trouble() {
    let flying = Some(Attitude::default());
    let is_trouble = |glance, heading, attitude| shown(glance, heading, attitude).1 >= 9;
    assert!(is_trouble(None, NoHeading::Uncalibrated, None));
    for heading in [NoHeading::SensorSilent, NoHeading::AttitudeFrozen, NoHeading::FieldDisturbed] {
        for glance in [Glance::Waiting, Glance::Collecting(50), Glance::Calibrated] {
            assert!(is_trouble(Some(glance), heading, flying), "{heading:?} {glance:?}");
        }
    }
    assert!(is_trouble(Some(Glance::Waiting), NoHeading::Uncalibrated, None));
    assert!(!is_trouble(Some(Glance::Waiting), NoHeading::Uncalibrated, flying));
    assert!(!is_trouble(Some(Glance::Collecting(0)), NoHeading::Uncalibrated, None));
}

/// Two seconds, from both sides, and once however long it is held.
#[test]
fn the_button_is_held_for_two_seconds() {
    let (mut bed, post) = with_panel();
    for (ms, asks) in [(1_900, false), (2_060, true), (10_000, true)] {
        post.is_down.set(true);
        bed.ms(ms);
        assert_eq!(bed.links.pressed.try_take().is_some(), asks, "{ms}");
        post.is_down.set(false);
        bed.ms(3_000);
        assert!(bed.links.pressed.try_take().is_none(), "{ms}");
    }
}

/// It is `cal start`, whose answer goes to nobody: a person at the console gets his own.
#[test]
fn the_button_begins_a_collection() {
    let (mut bed, post) = with_panel();
    bed.run("compass", |links| async move {
        Box::pin(compass::run(&links, Store::new(RamFlash::<2048>::new(8), 0..2048 * 8), &mut Kept::EMPTY.clone()))
            .await;
    });
    publish(
        &bed.links.sensor,
        FoundSensor { identity: SENSOR, period_us: Chip::PERIOD_US, stuck_after: Chip::STUCK_AFTER },
    );
    bed.ms(10);
    assert_eq!(bed.links.glance.try_get(), Some(Glance::Waiting));
    post.is_down.set(true);
    bed.ms(2_100);
    assert_eq!(bed.links.glance.try_get(), Some(Glance::Collecting(0)));
    assert!(bed.links.replies.try_receive().is_err(), "nobody asked");
    let reply = ask(&mut bed, Command::CalStop);
    assert!(matches!(reply, Ok(Reply::Done(State::Uncalibrated))), "{reply:?}");
}

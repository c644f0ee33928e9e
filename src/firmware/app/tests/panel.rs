//! Lamp and button.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use embassy_time::Instant;

use super::TaskBench;
use crate::app::panel::{self, Panel};
use crate::app::task_links::{CommandSource, publish_value};
use autoswing::calibration::method_selection::Procedure;
use autoswing::frames::RollPitch;
use autoswing::heading::NoHeading;
use autoswing::instrument::Estimate;
use autoswing_module::compass::{Command, IndicatorState};

/// Times of the lamp's changes, milliseconds, with its states, and the state of the button.
#[derive(Clone, Default)]
struct FakePanel {
    lamp_changes: Rc<RefCell<Vec<(u64, bool)>>>,
    is_button_down: Rc<Cell<bool>>,
}

impl Panel for FakePanel {
    fn set_lamp(&mut self, on: bool) {
        let mut lamp = self.lamp_changes.borrow_mut();
        if lamp.last().is_none_or(|&(_, before)| before != on) {
            lamp.push((Instant::now().as_millis(), on));
        }
    }

    fn is_pressed(&self) -> bool {
        self.is_button_down.get()
    }
}

fn bench_with_panel() -> (TaskBench, FakePanel) {
    let (mut bench, fake_panel) = (TaskBench::new(), FakePanel::default());
    let fake_panel_clone = fake_panel.clone();
    bench.spawn_task("panel", |links| async move { panel::run_panel(&links, fake_panel_clone).await });
    (bench, fake_panel)
}

/// Share of time with the lamp lit, percent, and changes a second, over two periods.
fn lit_percent_and_changes(
    indicator_state: Option<IndicatorState>,
    heading: NoHeading,
    attitude: Option<RollPitch>,
) -> (u64, u64) {
    let (mut bench, fake_panel) = bench_with_panel();
    if let Some(indicator_state) = indicator_state {
        publish_value(&bench.links.indicator_state, indicator_state);
        publish_value(&bench.links.estimates, Estimate { attitude, heading: Err(heading), ..Estimate::EMPTY });
    }
    let begin = Instant::now().as_millis();
    bench.run_for_ms(4_000);
    let lamp = fake_panel.lamp_changes.borrow();
    let ends = lamp.iter().skip(1).map(|&(at, _)| at).chain([begin + 4_000]);
    let lit_ms: u64 = lamp.iter().zip(ends).filter(|((_, on), _)| *on).map(|(&(at, _), end)| end - at).sum();
    (lit_ms / 40, lamp.len() as u64 / 4)
}

#[test]
fn each_indicator_state_has_its_own_lamp_pattern() {
    let flying = Some(RollPitch::default());
    let shown_uncalibrated =
        |indicator_state| lit_percent_and_changes(Some(indicator_state), NoHeading::Uncalibrated, flying);
    // Tolerance: the lamp is polled every 50 ms, so the last period is incomplete.
    for (indicator_state, lit_percent) in [(IndicatorState::Idle, 5), (IndicatorState::Calibrated, 95)] {
        let (found, changes) = shown_uncalibrated(indicator_state);
        assert!(found.abs_diff(lit_percent) <= 2 && changes == 1, "{indicator_state:?} {found} {changes}");
    }
    for (percent, lit_percent) in [(0, 10), (10, 10), (40, 40), (90, 90), (100, 90)] {
        let (found, changes) = shown_uncalibrated(IndicatorState::Collecting(percent));
        assert!(found.abs_diff(lit_percent) <= 2, "{percent} {found}");
        assert_eq!(changes, 2);
    }
    let (lit_percent, changes) = shown_uncalibrated(IndicatorState::Refused);
    assert!(lit_percent.abs_diff(50) <= 2 && changes >= 9, "{lit_percent} {changes}");
}

/// Faults: no state yet, silent sensor, no usable attitude, implausible field. A tumble needs no attitude.
#[test]
fn every_cause_of_a_missing_heading_shows_the_fault_pattern() {
    let flying = Some(RollPitch::default());
    let is_trouble =
        |indicator_state, heading, attitude| lit_percent_and_changes(indicator_state, heading, attitude).1 >= 9;
    assert!(is_trouble(None, NoHeading::Uncalibrated, None));
    for heading in [NoHeading::SensorSilent, NoHeading::AttitudeFrozen, NoHeading::FieldDisturbed] {
        for indicator_state in [IndicatorState::Idle, IndicatorState::Collecting(50), IndicatorState::Calibrated] {
            assert!(is_trouble(Some(indicator_state), heading, flying), "{heading:?} {indicator_state:?}");
        }
    }
    assert!(is_trouble(Some(IndicatorState::Idle), NoHeading::Uncalibrated, None));
    assert!(!is_trouble(Some(IndicatorState::Idle), NoHeading::Uncalibrated, flying));
    assert!(!is_trouble(Some(IndicatorState::Collecting(0)), NoHeading::Uncalibrated, None));
}

/// The button is held for just less and just more than two seconds; a longer hold starts no second collection.
#[test]
fn the_button_acts_after_two_seconds() {
    let (mut bench, fake_panel) = bench_with_panel();
    let start_command = (CommandSource::Button, Command::CalStart(Procedure::Flight));
    for (ms, is_pressed) in [(1_900, false), (2_060, true), (10_000, true)] {
        fake_panel.is_button_down.set(true);
        bench.run_for_ms(ms);
        assert_eq!(bench.links.commands.try_receive() == Ok(start_command), is_pressed, "{ms}");
        fake_panel.is_button_down.set(false);
        bench.run_for_ms(3_000);
        assert!(bench.links.commands.try_receive().is_err(), "{ms}");
    }
}

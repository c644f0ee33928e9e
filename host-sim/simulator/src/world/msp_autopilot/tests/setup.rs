//! The module checks and sets up INAV's settings.

use autoswing::frames::Field;
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_firmware::port::{Port, Snapshot};
use autoswing_module::compass::{AutopilotAction, Command, IndicatorState};
use autoswing_module::settings::{ProtocolKind, Settings};

use super::*;

/// Module and INAV on a line without delay.
pub struct Bench {
    autopilot: MspAutopilot,
    module: Port,
    now_us: u64,
    pub settings: Settings,
    is_armed: bool,
    pub is_calibrated: bool,
    notices: Vec<String>,
}

impl Bench {
    fn new(answer_faults: AnswerFaults) -> Self {
        let mut bench = Self {
            autopilot: MspAutopilot::new(MspFirmware::Inav, answer_faults, 1),
            module: Port::new(ProtocolKind::Msp, ProtocolKind::Auto, Timestamp::START),
            now_us: 0,
            settings: Settings::DEFAULT,
            is_armed: false,
            is_calibrated: false,
            notices: vec![],
        };
        bench.run_for_s(3);
        bench
    }

    fn run_for_s(&mut self, seconds: u64) {
        let end_us = self.now_us + 1_000_000 * seconds;
        while self.now_us < end_us {
            self.now_us += 12_500;
            let state = AutopilotState { is_armed: self.is_armed, ..AUTOPILOT_STATE };
            let now = Timestamp::from_us(self.now_us);
            for byte in self.autopilot.due_reply_bytes(self.now_us, &state) {
                let _ = self.module.process_byte(now, byte);
            }
            let heading = Heading { magnetic_rad: 1.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 };
            let estimate = Estimate {
                timestamp: now,
                heading: if self.is_calibrated { Ok(heading) } else { Err(NoHeading::Uncalibrated) },
                compass_field: Some(Field::from_ut(20.0, 0.0, 48.0)),
                ..Estimate::EMPTY
            };
            let indicator_state = if self.is_calibrated { IndicatorState::Calibrated } else { IndicatorState::Idle };
            self.module.poll(&Snapshot {
                now,
                estimate: &estimate,
                settings: &self.settings,
                indicator_state,
                calibration: None,
                can_node: None,
            });
            self.notices.extend(self.module.mavlink.take_message(now).map(|notice| notice.to_string()));
            if let Some(Command::KeepReplacedNumber(replaced)) = self.module.mavlink.take_command() {
                self.settings.replaced_numbers = self.settings.replaced_numbers.with_number(replaced);
            }
            for &byte in self.module.pending_output.pending_bytes() {
                self.autopilot.receive_byte(self.now_us, byte);
            }
            self.module.pending_output.consume_bytes(usize::MAX);
        }
    }

    /// Texts of an action.
    pub fn run_action(&mut self, action: AutopilotAction) -> Vec<String> {
        self.module.begin_autopilot_action(Timestamp::from_us(self.now_us), action);
        self.notices.clear();
        self.run_for_s(40);
        self.notices.clone()
    }

    fn numbers<const COUNT: usize>(&self, names: [&str; COUNT]) -> [i16; COUNT] {
        names.map(|name| self.autopilot.settings.number(name).unwrap())
    }
}

/// INAV that uses the compass, aligned and calibrated by itself.
pub fn bench_with_own_calibration() -> Bench {
    let mut bench = Bench::new(TENTH);
    for (name, number) in [("mag_hardware", 11), ("align_mag_yaw", -900), ("magzero_y", -120)] {
        bench.autopilot.settings.set_number(name, number);
    }
    bench
}

const NAMES: [&str; 5] = ["mag_hardware", "align_mag", "align_mag_yaw", "magzero_y", "maggain_z"];
const TENTH: AnswerFaults = AnswerFaults {
    drop_probability: 0.1,
    rejection_probability: 0.0,
    truncation_probability: 0.1,
    delay_probability: 0.1,
};

/// First before the calibration, then after it; what was saved lasts beyond the restart. A third of the answers is lost,
/// cut or late.
#[test]
fn inav_is_checked_set_up_and_restored() {
    let mut bench = bench_with_own_calibration();
    let before = bench.numbers(NAMES);
    assert_eq!(
        bench.run_action(AutopilotAction::Check),
        [
            "parameter-wrong: mag_hardware is 11, wanted 0: its field is raw until the module is calibrated",
            "parameter-wrong: align_mag is 0, wanted 2: CW90 is for a field in body axes",
            "parameter-wrong: align_mag_yaw is -900, wanted 0: other angles take the place of align_mag",
            "parameter-wrong: magzero_y is -120, wanted 0: its field is corrected already",
            "autopilot: parameters of the autopilot: 4 right, 4 wrong, 0 changed; to write them: autopilot setup yes",
        ]
    );
    assert_eq!(bench.numbers(NAMES), before);
    let texts = bench.run_action(AutopilotAction::Setup);
    assert!(texts.last().unwrap().ends_with("8 right, 0 wrong, 4 changed; restart it: autopilot restart"), "{texts:?}");
    assert_eq!(bench.run_action(AutopilotAction::Restart), [] as [&str; 0]);
    assert_eq!((bench.numbers(NAMES), bench.autopilot.restart_count), ([0, 2, 0, 0, 1024], 1));
    bench.is_calibrated = true;
    bench.run_action(AutopilotAction::Setup);
    bench.run_action(AutopilotAction::Restart);
    assert_eq!(bench.numbers(NAMES), [11, 2, 0, 0, 520], "by the name of the choice, and the strength of the field");
    let texts = bench.run_action(AutopilotAction::Check);
    assert_eq!(texts.last().unwrap(), "autopilot: parameters of the autopilot: 11 right, 0 wrong, 0 changed");
    bench.run_action(AutopilotAction::Undo);
    bench.run_action(AutopilotAction::Restart);
    assert_eq!(bench.numbers(NAMES), before);
}

#[test]
fn nothing_is_written_while_armed() {
    let mut bench = Bench::new(AnswerFaults::NO_FAULTS);
    bench.is_armed = true;
    bench.run_for_s(2);
    let before = bench.numbers(NAMES);
    let texts = bench.run_action(AutopilotAction::Setup);
    assert!(texts.last().unwrap().starts_with("armed: "), "{texts:?}");
    bench.run_action(AutopilotAction::Restart);
    assert_eq!((bench.numbers(NAMES), bench.autopilot.restart_count), (before, 0));
}

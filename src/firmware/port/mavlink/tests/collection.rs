//! Progress and reports of collections.

use super::*;
use crate::synthetic::typical_quality;
use autoswing::calibration::Orientation;
use autoswing_module::messages::ExpectedAccuracy;

const PROGRESS_ID: u8 = 191;
const REPORT_ID: u8 = 192;
/// Status and flag of a stored calibration in a report.
type ReportResult = (u8, u8);

const SUCCESS: ReportResult = (4, 1);
const FAILED: ReportResult = (5, 0);
const ENDED_TEXT: &str = "collection-ended: no more samples";

fn calibration_with_hard_iron(x_ut: f32) -> (Calibration, HeadingUncertainty) {
    let calibration = Calibration {
        w: [[1.1, 0.03, 0.0], [0.01, 0.9, -0.05], [0.0, 0.01, 1.0]],
        b_ut: [x_ut, -8.0, 20.0],
        total_ut: 50.0,
        ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
    };
    let mut uncertainty = HeadingUncertainty::NO_UNCERTAINTY;
    uncertainty.relative_sensor_sigma = 0.004;
    (calibration, uncertainty)
}

impl MavlinkBench {
    fn run_with_indicator_state(&mut self, indicator_state: IndicatorState) {
        self.indicator_state = indicator_state;
        self.run_ms(1_000);
    }

    /// Reports a successful solve, whose calibration becomes active.
    fn complete_solve(&mut self, found: &(Calibration, HeadingUncertainty)) {
        self.calibration = Some(*found);
        let verdict = ExpectedAccuracy::new(typical_quality(0.3), &found.0);
        self.mavlink.queue_text(&Notice::Solved(Ok(verdict)));
        self.run_with_indicator_state(IndicatorState::Calibrated);
    }

    fn take_texts_without_prefix(&mut self) -> Vec<String> {
        self.take_texts().into_iter().map(|(_, text)| text.replace("autoswing: ", "")).collect()
    }
}

#[test]
fn texts_report_the_start_each_tenth_and_the_end_of_a_collection() {
    let mut bench = MavlinkBench::with_autopilot();
    for percent in [0, 9, 10, 19, 17, 35, 34, 29, 40, 100] {
        bench.run_with_indicator_state(IndicatorState::Collecting(percent));
    }
    assert_eq!(
        bench.take_texts_without_prefix(),
        [0, 10, 30, 40, 100].map(|percent| format!("collecting: {percent} %"))
    );
    bench.complete_solve(&calibration_with_hard_iron(12.0));
    let texts = bench.take_texts_without_prefix();
    assert!(texts.len() == 1 && texts[0].starts_with("calibrated: "), "an outcome is the end: {texts:?}");
    for percent in [55, 0, 0, 12] {
        bench.run_with_indicator_state(IndicatorState::Collecting(percent));
    }
    bench.run_with_indicator_state(IndicatorState::Idle);
    let expected = ["collecting: 50 %", "collecting: 0 %", "collecting: 10 %", ENDED_TEXT];
    assert_eq!(bench.take_texts_without_prefix(), expected);
}

/// Direction of the field, compass 0 and its mask, status, attempt, percent. The last step begins with all samples.
#[test]
fn progress_is_sent_with_the_direction_of_the_field() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.estimate.body_field = Some(autoswing::frames::Field::from_ut(0.0, 3.0, -4.0));
    for (percent, status) in [(40, 2), (100, 3)] {
        bench.run_with_indicator_state(IndicatorState::Collecting(percent));
        let progress = bench.take_messages(PROGRESS_ID);
        assert_eq!(progress.len(), 2, "two a second");
        let direction = nalgebra::Vector3::from([0, 4, 8].map(|at| progress[0].float_at(at)));
        assert!((direction - nalgebra::Vector3::new(0.0, 0.6, -0.8)).norm() < 1e-6, "{direction}");
        assert_eq!(progress[0].payload[12..17], [0, 1, status, 1, percent]);
    }
}

/// State of the module for a second, after a refused or a successful solve, or without one.
#[derive(Clone, Copy)]
enum Step {
    State(IndicatorState),
    Refuse(IndicatorState),
    Success,
}

/// A failed report has not the numbers of the active calibration. `cal stop` and `cal solve` are processed between two
/// polls, so that a solve can have no collection before it.
#[test]
fn each_end_of_a_collection_is_reported_once() {
    use IndicatorState::{Calibrated, Collecting, Idle, Refused};
    use Step::{Refuse, State, Success};
    let cases: [(&str, &[Step], &[ReportResult]); 11] = [
        ("solved", &[State(Collecting(0)), State(Collecting(100)), Success, State(Calibrated)], &[SUCCESS]),
        ("refused", &[State(Collecting(100)), Refuse(Refused)], &[FAILED]),
        ("refused with an active calibration", &[State(Collecting(100)), Refuse(Calibrated)], &[FAILED]),
        ("aborted", &[State(Collecting(50)), State(Refused)], &[FAILED]),
        ("aborted with an active calibration", &[State(Collecting(50)), State(Calibrated)], &[FAILED]),
        ("waits for the next flight", &[State(Collecting(50)), State(Idle)], &[]),
        ("refused, then waits", &[State(Collecting(30)), Refuse(Collecting(30)), State(Idle)], &[]),
        ("refused, then aborted", &[State(Collecting(30)), Refuse(Collecting(30)), State(Refused)], &[FAILED]),
        ("refused, then solved", &[State(Collecting(30)), Refuse(Collecting(30)), Success], &[SUCCESS]),
        ("refused without a collection", &[State(Idle), Refuse(Refused)], &[FAILED]),
        ("solved without a collection", &[State(Idle), Success], &[SUCCESS]),
    ];
    for (name, steps, expected) in cases {
        for calibration in [None, Some(calibration_with_hard_iron(12.0))] {
            for has_autopilot_from_start in [true, false] {
                let mut bench =
                    if has_autopilot_from_start { MavlinkBench::with_autopilot() } else { MavlinkBench::new() };
                bench.calibration = calibration;
                for step in steps {
                    match *step {
                        State(state) => bench.run_with_indicator_state(state),
                        Refuse(state) => {
                            bench.mavlink.queue_text(&Notice::Solved(Err(Refusal::NoSamples)));
                            bench.run_with_indicator_state(state);
                        }
                        Success => bench.complete_solve(&calibration_with_hard_iron(13.0)),
                    }
                }
                bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
                bench.run_ms(1_000);
                let reports = bench.take_messages(REPORT_ID);
                let results: Vec<_> = reports.iter().map(|report| (report.payload[42], report.payload[43])).collect();
                assert_eq!(results, expected, "{name}");
                for report in reports.iter().filter(|report| report.payload[43] == 0) {
                    assert_eq!(report.payload[..16], [0; 16], "{name}");
                }
            }
        }
    }
}

/// The reported parameters are compared with the calibration's own formula, with and without a mounting.
#[test]
fn a_calibration_report_corrects_as_the_calibration_does() {
    for orientation in Orientation::all_orientations() {
        let mounting = orientation.body_from_sensor();
        let (mut found, uncertainty) = calibration_with_hard_iron(12.0);
        let symmetric = nalgebra::Matrix3::new(1.1, 0.02, -0.01, 0.02, 0.9, 0.03, -0.01, 0.03, 1.0);
        let w = symmetric * mounting;
        found.w = std::array::from_fn(|row| std::array::from_fn(|column| w[(row, column)]));
        let mut bench = MavlinkBench::with_autopilot();
        bench.settings.mount = orientation;
        bench.run_with_indicator_state(IndicatorState::Collecting(100));
        bench.complete_solve(&(found, uncertainty));
        let report = bench.take_messages(REPORT_ID).pop().unwrap();
        let number = |at: usize| report.float_at(4 * at);
        // 0.4 % of 50 uT, in milligauss.
        assert!((number(0) - 2.0).abs() < 1e-5);
        let raw_mg = nalgebra::Vector3::new(200.0, -100.0, 450.0);
        let [dx, dy, dz, xy, xz, yz] = std::array::from_fn(|i| number(4 + i));
        let matrix = nalgebra::Matrix3::new(dx, xy, xz, xy, dy, yz, xz, yz, dz);
        let autopilot_corrected =
            matrix * (mounting * raw_mg + nalgebra::Vector3::new(number(1), number(2), number(3)));
        let ours = found.calibrated_field(autoswing::frames::Field::new(raw_mg / 10.0)).ut * 10.0;
        assert!(
            (autopilot_corrected - ours).norm() < 1e-2,
            "{}: {autopilot_corrected} {ours}",
            orientation.orientation_name()
        );
    }
}

#[test]
fn the_matrix_of_a_calibration_report_is_the_nearest_symmetric_one() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.run_with_indicator_state(IndicatorState::Collecting(100));
    bench.complete_solve(&calibration_with_hard_iron(12.0));
    let report = bench.take_messages(REPORT_ID).pop().unwrap();
    let numbers: [f32; 9] = std::array::from_fn(|at| report.float_at(4 + 4 * at));
    for (number, expected) in numbers.into_iter().zip([-120.0, 80.0, -200.0, 1.1, 0.9, 1.0, 0.02, 0.0, -0.02]) {
        assert!((number - expected).abs() < 1e-4, "{numbers:?}");
    }
}

#[test]
fn only_a_new_calibration_resets_the_pose() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.settings.sends_vision_yaw = true;
    bench.settings.declination_deg = Some(1.0);
    bench.estimate.heading = Ok(heading(10.0, 1.0));
    bench.estimate.attitude = Some(RollPitch::default());
    let counter = |bench: &mut MavlinkBench| {
        bench.run_ms(100);
        bench.take_messages(102).last().unwrap().payload[116]
    };
    bench.calibration = Some(calibration_with_hard_iron(1.0));
    let first = counter(&mut bench);
    bench.indicator_state = IndicatorState::Collecting(3);
    for (hard_iron_ut, resets) in [(Some(1.0), 0), (None, 0), (Some(1.0), 0), (Some(2.0), 1), (Some(2.0), 1)] {
        bench.calibration = hard_iron_ut.map(calibration_with_hard_iron);
        assert_eq!(counter(&mut bench), first + resets, "{hard_iron_ut:?}");
    }
}

//! Progress and reports of collections.

use super::*;
use crate::calibration::Orientation;
use crate::messages::ExpectedAccuracy;
use crate::store::tests::record;

const PROGRESS: u8 = 191;
const REPORT: u8 = 192;
const SUCCESS: u8 = 4;
const FAILED: u8 = 5;
const ENDED: &str = "collection-ended: no more samples";

fn calibration(x_ut: f32) -> (Calibration, HeadingUncertainty) {
    let calibration = Calibration {
        w: [[1.1, 0.03, 0.0], [0.01, 0.9, -0.05], [0.0, 0.01, 1.0]],
        b_ut: [x_ut, -8.0, 20.0],
        total_ut: 50.0,
        ..Calibration::uncalibrated(Orientation::NONE)
    };
    let mut uncertainty = HeadingUncertainty::NONE;
    uncertainty.sensor_sigma = 0.004;
    (calibration, uncertainty)
}

impl MavlinkBench {
    fn is(&mut self, glance: IndicatorState) {
        self.glance = glance;
        self.run(1_000);
    }

    /// Successful solve, whose calibration becomes active.
    fn succeeds(&mut self, found: &(Calibration, HeadingUncertainty)) {
        self.calibration = Some(*found);
        let verdict = ExpectedAccuracy::new(record(1).quality, &found.0);
        self.module.queue_text(&Notice::Solved(Ok(verdict)));
        self.is(IndicatorState::Calibrated);
    }

    /// Refused solve, and the module's state after it.
    fn fails(&mut self, glance: IndicatorState) {
        self.module.queue_text(&Notice::Solved(Err(Refusal::NoSamples)));
        self.is(glance);
    }

    fn lines(&mut self) -> Vec<String> {
        self.texts().into_iter().map(|(_, text)| text.replace("autoswing: ", "")).collect()
    }

    /// Removes and returns status and success of the sent reports.
    fn reports(&mut self) -> Vec<(u8, u8)> {
        self.take(REPORT).iter().map(|report| (report.payload[42], report.payload[43])).collect()
    }
}

#[test]
fn texts_tell_the_begin_each_tenth_and_the_end() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    for percent in [0, 9, 10, 19, 17, 35, 34, 29, 40, 100] {
        bed.is(IndicatorState::Collecting(percent));
    }
    assert_eq!(bed.lines(), [0, 10, 30, 40, 100].map(|percent| format!("collecting: {percent} %")));
    bed.is(IndicatorState::Calibrated);
    assert_eq!(bed.lines(), [ENDED]);
    bed.is(IndicatorState::Collecting(55));
    bed.is(IndicatorState::Collecting(0));
    bed.is(IndicatorState::Collecting(0));
    bed.is(IndicatorState::Collecting(12));
    bed.is(IndicatorState::Idle);
    let expected = ["collecting: 50 %", "collecting: 0 %", "collecting: 10 %", ENDED];
    assert_eq!(bed.lines(), expected);
}

/// Twice a second, with the direction of the field in body axes, if known.
#[test]
fn progress_is_told_while_it_collects() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.is(IndicatorState::Idle);
    assert_eq!(bed.take(PROGRESS), []);
    bed.is(IndicatorState::Collecting(40));
    let progress = bed.take(PROGRESS);
    assert_eq!(progress.len(), 2);
    for told in progress {
        assert_eq!(told.payload[..12], [0; 12]);
        assert_eq!(told.payload[12..27], [0, 1, 2, 1, 40, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    }
    bed.estimate.body_field = Some(crate::frames::Field::from_ut(30.0, 0.0, -40.0));
    bed.is(IndicatorState::Collecting(100));
    let told = &bed.take(PROGRESS)[0];
    assert!((told.float(0) - 0.6).abs() < 1e-6 && (told.float(8) + 0.8).abs() < 1e-6);
    assert_eq!(told.payload[14], 3);
    bed.estimate.body_field = Some(crate::frames::Field::from_ut(0.0, 0.0, 0.0));
    bed.is(IndicatorState::Collecting(100));
    assert_eq!(bed.take(PROGRESS)[0].payload[..12], [0; 12]);
    bed.is(IndicatorState::Calibrated);
    assert_eq!(bed.take(PROGRESS), []);
}

#[test]
fn a_new_calibration_is_reported_once() {
    for old in [None, Some(calibration(12.0))] {
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.calibration = old;
        bed.is(if old.is_some() { IndicatorState::Calibrated } else { IndicatorState::Idle });
        bed.is(IndicatorState::Collecting(0));
        bed.is(IndicatorState::Collecting(100));
        assert_eq!(bed.reports(), []);
        bed.succeeds(&calibration(13.0));
        bed.is(IndicatorState::Calibrated);
        assert_eq!(bed.reports(), [(SUCCESS, 1)]);
    }
}

#[test]
fn a_refused_solve_is_reported_as_failed() {
    for (before, after) in [(None, IndicatorState::Refused), (Some(calibration(1.0)), IndicatorState::Calibrated)] {
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.calibration = before;
        bed.is(IndicatorState::Collecting(100));
        bed.module.queue_text(&Notice::Solved(Err(Refusal::NoSamples)));
        bed.glance = after;
        bed.poll();
        let reports = bed.take(REPORT);
        assert!(reports.iter().all(|report| report.payload[..16] == [0; 16]), "not the numbers of the active one");
        assert_eq!(reports.iter().map(|report| report.payload[42]).collect::<Vec<_>>(), [FAILED]);
        bed.calibration = Some(calibration(2.0));
        bed.is(IndicatorState::Calibrated);
        assert_eq!(bed.reports(), []);
    }
}

/// Aborted or stopped. A module that waits for the next flight sends no report.
#[test]
fn a_collection_that_ends_without_an_outcome_has_failed() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    for (after, reports) in [
        (IndicatorState::Calibrated, vec![(FAILED, 0)]),
        (IndicatorState::Refused, vec![(FAILED, 0)]),
        (IndicatorState::Idle, vec![]),
    ] {
        bed.is(IndicatorState::Collecting(50));
        bed.is(after);
        assert_eq!(bed.reports(), reports, "{after:?}");
    }
}

#[test]
fn a_collection_that_goes_on_after_a_refused_solve_is_not_reported() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.is(IndicatorState::Collecting(30));
    bed.fails(IndicatorState::Collecting(30));
    assert_eq!(bed.reports(), []);
    assert_eq!(bed.take(PROGRESS).len(), 4);
    bed.is(IndicatorState::Idle);
    assert_eq!(bed.reports(), [], "it rests");
    bed.is(IndicatorState::Collecting(30));
    bed.is(IndicatorState::Refused);
    assert_eq!(bed.reports(), [(FAILED, 0)], "the refused solve was not its end");
    bed.is(IndicatorState::Collecting(30));
    bed.succeeds(&calibration(1.0));
    assert_eq!(bed.reports(), [(SUCCESS, 1)]);
}

/// `cal solve` after `cal stop`, both between two polls.
#[test]
fn a_solve_without_a_collection_is_reported() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.is(IndicatorState::Idle);
    bed.fails(IndicatorState::Refused);
    assert_eq!(bed.reports(), [(FAILED, 0)]);
    bed.succeeds(&calibration(1.0));
    assert_eq!(bed.reports(), [(SUCCESS, 1)]);
}

/// Compared with the calibration's own formula, with and without a mounting.
#[test]
fn a_report_has_the_numbers_of_an_autopilot_s_compass() {
    for orientation in Orientation::all() {
        let mounting = orientation.body_from_sensor();
        let (mut found, uncertainty) = calibration(12.0);
        let symmetric = nalgebra::Matrix3::new(1.1, 0.02, -0.01, 0.02, 0.9, 0.03, -0.01, 0.03, 1.0);
        let w = symmetric * mounting;
        found.w = std::array::from_fn(|row| std::array::from_fn(|column| w[(row, column)]));
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.settings.mount = orientation;
        bed.is(IndicatorState::Collecting(100));
        bed.succeeds(&(found, uncertainty));
        let report = bed.take(REPORT).pop().unwrap();
        let number = |at: usize| report.float(4 * at);
        // 0.4 % of 50 uT, in milligauss.
        assert!((number(0) - 2.0).abs() < 1e-5);
        let raw_mg = nalgebra::Vector3::new(200.0, -100.0, 450.0);
        let [dx, dy, dz, xy, xz, yz] = std::array::from_fn(|i| number(4 + i));
        let matrix = nalgebra::Matrix3::new(dx, xy, xz, xy, dy, yz, xz, yz, dz);
        let theirs = matrix * (mounting * raw_mg + nalgebra::Vector3::new(number(1), number(2), number(3)));
        let ours = found.apply(crate::frames::Field::new(raw_mg / 10.0)).ut * 10.0;
        assert!((theirs - ours).norm() < 1e-2, "{}: {theirs} {ours}", orientation.name());
    }
}

#[test]
fn the_matrix_of_a_report_is_the_nearest_symmetric_one() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.is(IndicatorState::Collecting(100));
    bed.succeeds(&calibration(12.0));
    let report = bed.take(REPORT).pop().unwrap();
    let numbers: [f32; 9] = std::array::from_fn(|at| report.float(4 + 4 * at));
    for (number, expected) in numbers.into_iter().zip([-120.0, 80.0, -200.0, 1.1, 0.9, 1.0, 0.02, 0.0, -0.02]) {
        assert!((number - expected).abs() < 1e-4, "{numbers:?}");
    }
}

#[test]
fn a_new_calibration_resets_the_pose_and_nothing_else_does() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.settings.sends_vision_yaw = true;
    bed.settings.declination_deg = Some(1.0);
    bed.estimate.heading = Ok(heading(10.0, 1.0));
    bed.estimate.attitude = Some(Attitude::default());
    let counter = |bed: &mut MavlinkBench| {
        bed.run(100);
        bed.take(102).last().unwrap().payload[116]
    };
    bed.calibration = Some(calibration(1.0));
    let first = counter(&mut bed);
    bed.glance = IndicatorState::Collecting(3);
    assert_eq!(counter(&mut bed), first);
    bed.calibration = None;
    assert_eq!(counter(&mut bed), first);
    bed.calibration = Some(calibration(1.0));
    assert_eq!(counter(&mut bed), first);
    bed.calibration = Some(calibration(2.0));
    assert_eq!(counter(&mut bed), first + 1);
    assert_eq!(counter(&mut bed), first + 1);
}

#[test]
fn a_report_waits_for_an_autopilot() {
    let mut bed = MavlinkBench::new();
    bed.is(IndicatorState::Collecting(100));
    bed.succeeds(&calibration(1.0));
    bed.is(IndicatorState::Calibrated);
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.poll();
    assert_eq!(bed.reports(), [(SUCCESS, 1)]);
}

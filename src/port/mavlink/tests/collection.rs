//! How a collection goes on, and what comes of it.

use super::*;
use crate::calibration::Orientation;

const PROGRESS: u8 = 191;
const REPORT: u8 = 192;
const SUCCESS: u8 = 4;
const FAILED: u8 = 5;

fn calibration(x_ut: f32) -> (Calibration, Uncertainty) {
    let calibration = Calibration {
        w: [[1.1, 0.03, 0.0], [0.01, 0.9, -0.05], [0.0, 0.01, 1.0]],
        b_ut: [x_ut, -8.0, 20.0],
        total_ut: 50.0,
        ..Calibration::uncalibrated(Orientation::NONE)
    };
    let mut uncertainty = Uncertainty::NONE;
    uncertainty.sensor_sigma = 0.004;
    (calibration, uncertainty)
}

impl Bed {
    fn is(&mut self, glance: Glance) {
        self.glance = glance;
        self.run(1_000);
    }

    fn lines(&mut self) -> Vec<String> {
        self.texts().into_iter().map(|(_, text)| text.replace("autoswing: ", "")).collect()
    }

    /// Status and success of the reports since this was asked last.
    fn reports(&mut self) -> Vec<(u8, u8)> {
        self.take(REPORT).iter().map(|report| (report.payload[42], report.payload[43])).collect()
    }
}

#[test]
fn texts_tell_the_begin_each_tenth_and_the_end() {
    let mut bed = Bed::beside_an_autopilot();
    for percent in [0, 9, 10, 19, 17, 35, 34, 29, 40, 100] {
        bed.is(Glance::Collecting(percent));
    }
    assert_eq!(bed.lines(), [0, 10, 30, 40, 100].map(|percent| format!("collecting {percent} %")));
    bed.is(Glance::Calibrated);
    assert_eq!(bed.lines(), ["collecting ended"]);
    bed.is(Glance::Collecting(55));
    // Begun again from nothing.
    bed.is(Glance::Collecting(0));
    bed.is(Glance::Collecting(0));
    bed.is(Glance::Collecting(12));
    bed.is(Glance::Waiting);
    let expected = ["collecting 50 %", "collecting 0 %", "collecting 10 %", "collecting ended"];
    assert_eq!(bed.lines(), expected);
}

/// Twice a second while it lasts. Where the field points is told in body axes if it is known.
#[test]
fn progress_is_told_while_it_collects() {
    let mut bed = Bed::beside_an_autopilot();
    bed.is(Glance::Waiting);
    assert_eq!(bed.take(PROGRESS), []);
    bed.is(Glance::Collecting(40));
    let progress = bed.take(PROGRESS);
    assert_eq!(progress.len(), 2);
    for told in progress {
        assert_eq!(told.payload[..12], [0; 12]);
        assert_eq!(told.payload[12..27], [0, 1, 2, 1, 40, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    }
    bed.estimate.body = Some(crate::frames::Field::from_ut(30.0, 0.0, -40.0));
    bed.is(Glance::Collecting(100));
    let told = &bed.take(PROGRESS)[0];
    assert!((told.float(0) - 0.6).abs() < 1e-6 && (told.float(8) + 0.8).abs() < 1e-6);
    assert_eq!(told.payload[14], 3);
    bed.estimate.body = Some(crate::frames::Field::from_ut(0.0, 0.0, 0.0));
    bed.is(Glance::Collecting(100));
    assert_eq!(bed.take(PROGRESS)[0].payload[..12], [0; 12]);
    bed.is(Glance::Calibrated);
    assert_eq!(bed.take(PROGRESS), []);
}

#[test]
fn a_new_calibration_is_reported_once() {
    for old in [None, Some(calibration(12.0))] {
        let mut bed = Bed::beside_an_autopilot();
        bed.calibration = old;
        bed.is(if old.is_some() { Glance::Calibrated } else { Glance::Waiting });
        bed.is(Glance::Collecting(0));
        bed.is(Glance::Collecting(100));
        assert_eq!(bed.reports(), []);
        bed.calibration = Some(calibration(13.0));
        bed.is(Glance::Calibrated);
        bed.is(Glance::Calibrated);
        assert_eq!(bed.reports(), [(SUCCESS, 1)]);
    }
}

/// The calibration comes by another way than the state, and may come first or a second later.
#[test]
fn a_calibration_may_come_before_or_after_the_end() {
    let mut bed = Bed::beside_an_autopilot();
    bed.is(Glance::Collecting(100));
    bed.calibration = Some(calibration(1.0));
    bed.is(Glance::Collecting(100));
    bed.is(Glance::Calibrated);
    assert_eq!(bed.reports(), [(SUCCESS, 1)]);
    for (late_ms, told) in [(1_000, (SUCCESS, 1)), (1_001, (FAILED, 0))] {
        bed.is(Glance::Collecting(100));
        bed.glance = Glance::Calibrated;
        bed.poll();
        bed.ms += late_ms;
        bed.poll();
        bed.calibration = Some(calibration(late_ms as f32));
        bed.poll();
        assert_eq!(bed.reports(), [told], "{late_ms}");
    }
}

#[test]
fn what_gave_no_calibration_has_failed_and_what_was_cancelled_has_not() {
    let mut bed = Bed::beside_an_autopilot();
    bed.is(Glance::Collecting(100));
    bed.is(Glance::Refused);
    assert_eq!(bed.reports(), [(FAILED, 0)]);
    bed.is(Glance::Collecting(50));
    bed.is(Glance::Waiting);
    bed.is(Glance::Refused);
    assert_eq!(bed.reports(), []);
    // One in use stays in use.
    bed.calibration = Some(calibration(1.0));
    bed.is(Glance::Calibrated);
    bed.is(Glance::Collecting(100));
    bed.is(Glance::Calibrated);
    bed.is(Glance::Calibrated);
    assert!(
        bed.sent.iter().filter(|sent| sent.id == REPORT).all(|report| report.payload[..16] == [0; 16]),
        "not its numbers"
    );
    assert_eq!(bed.reports(), [(FAILED, 0)]);
}

/// With the calibration's own formula, at a mounting and without.
#[test]
fn a_report_has_the_numbers_of_an_autopilot_s_compass() {
    for orientation in Orientation::all() {
        let mounting = orientation.body_from_sensor();
        let (mut found, uncertainty) = calibration(12.0);
        let symmetric = nalgebra::Matrix3::new(1.1, 0.02, -0.01, 0.02, 0.9, 0.03, -0.01, 0.03, 1.0);
        let w = symmetric * mounting;
        found.w = std::array::from_fn(|row| std::array::from_fn(|column| w[(row, column)]));
        let mut bed = Bed::beside_an_autopilot();
        bed.settings.mount = orientation;
        bed.is(Glance::Collecting(100));
        bed.calibration = Some((found, uncertainty));
        bed.is(Glance::Calibrated);
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

/// What is turned in it is left away: the mean of both sides.
#[test]
fn the_matrix_of_a_report_is_the_nearest_symmetric_one() {
    let mut bed = Bed::beside_an_autopilot();
    bed.is(Glance::Collecting(100));
    bed.calibration = Some(calibration(12.0));
    bed.is(Glance::Calibrated);
    let report = bed.take(REPORT).pop().unwrap();
    let numbers: [f32; 9] = std::array::from_fn(|at| report.float(4 + 4 * at));
    for (number, expected) in numbers.into_iter().zip([-120.0, 80.0, -200.0, 1.1, 0.9, 1.0, 0.02, 0.0, -0.02]) {
        assert!((number - expected).abs() < 1e-4, "{numbers:?}");
    }
}

#[test]
fn a_new_calibration_resets_the_pose_and_nothing_else_does() {
    let mut bed = Bed::beside_an_autopilot();
    bed.settings.tells_vision = true;
    bed.settings.declination_deg = Some(1.0);
    bed.estimate.heading = Ok(heading(10.0, 1.0));
    bed.estimate.attitude = Some(Attitude::default());
    let counter = |bed: &mut Bed| {
        bed.run(100);
        bed.take(102).last().unwrap().payload[116]
    };
    bed.calibration = Some(calibration(1.0));
    let first = counter(&mut bed);
    bed.glance = Glance::Collecting(3);
    assert_eq!(counter(&mut bed), first);
    bed.calibration = None;
    assert_eq!(counter(&mut bed), first);
    bed.calibration = Some(calibration(1.0));
    assert_eq!(counter(&mut bed), first);
    bed.calibration = Some(calibration(2.0));
    assert_eq!(counter(&mut bed), first + 1);
    assert_eq!(counter(&mut bed), first + 1);
}

/// What ends before anybody is there is told when somebody is.
#[test]
fn a_report_waits_for_an_autopilot() {
    let mut bed = Bed::new();
    bed.is(Glance::Collecting(100));
    bed.calibration = Some(calibration(1.0));
    bed.is(Glance::Calibrated);
    bed.is(Glance::Calibrated);
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.poll();
    assert_eq!(bed.reports(), [(SUCCESS, 1)]);
}

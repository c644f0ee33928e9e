//! Collections and calibrations as an autopilot's compass reports them: MAG_CAL_PROGRESS and MAG_CAL_REPORT.
//!
//! Every solve that ends a collection is reported, as success with the coefficients or as failed. A collection that
//! ends without an outcome (aborted or stopped) is reported as failed, too, so that a ground station does not wait,
//! unless the module is uncalibrated and waits for the next collection.

use mavlink_dialect::{MAG_CAL_PROGRESS_DATA, MAG_CAL_REPORT_DATA, MagCalStatus};
use nalgebra::Vector3;

use super::status_texts::PendingTexts;
use super::transmitter::Transmitter;
use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use crate::wire::mavlink::OutboundMessage;
use autoswing::calibration::{Calibration, Orientation};
use autoswing_module::compass::IndicatorState;
use autoswing_module::messages::{Message, SolveOutcome};

const PROGRESS_HZ: u8 = 2;

const MG_PER_UT: f32 = 10.0;

/// Mask of the only compass, number 0.
const COMPASS_MASK: u8 = 1;

/// Progress of collections, and the calibration to report.
#[derive(Debug, Default)]
pub(super) struct CollectionReporter {
    /// The active calibration, and the noise of a reading relative to the field strength.
    reported_calibration: Option<(Calibration, f32)>,
    /// Number of calibrations that became active; wraps.
    calibration_count: u8,
    /// Tenths of progress already sent as a text; none without a collection.
    reported_progress_tenths: Option<u8>,
    /// Whether the last solve succeeded; none once it was reported.
    last_solve_success: Option<bool>,
    /// Whether the pending report is a success; none without a pending report.
    pending_report_success: Option<bool>,
    progress_schedule: MessageSchedule,
}

impl CollectionReporter {
    pub const fn calibration_count(&self) -> u8 {
        self.calibration_count
    }

    /// Whether a calibration differs from the last reported one.
    pub fn is_unreported_calibration(&self, calibration: &Calibration) -> bool {
        self.reported_calibration.as_ref().is_none_or(|(reported, _)| reported != calibration)
    }

    /// Records the outcome of a solve; the next update contains the state after it.
    pub fn record_outcome(&mut self, outcome: &SolveOutcome) {
        self.last_solve_success = Some(outcome.is_ok());
    }

    /// Tracks the module's state; must be called also while no autopilot is known.
    pub fn track_state(&mut self, snapshot: &Snapshot<'_>, texts: &mut PendingTexts) {
        if let Some((calibration, uncertainty)) =
            snapshot.calibration.filter(|(calibration, _)| self.is_unreported_calibration(calibration))
        {
            self.reported_calibration = Some((*calibration, uncertainty.relative_sensor_sigma));
            self.calibration_count = self.calibration_count.wrapping_add(1);
        }
        let component = snapshot.settings.component;
        // An automatic collection continues after a refused solve: that outcome does not end it.
        let outcome = self.last_solve_success.take();
        match (self.reported_progress_tenths, snapshot.indicator_state) {
            (reported_progress_tenths, IndicatorState::Collecting(percent)) => {
                self.report_progress(reported_progress_tenths, percent, texts, component);
            }
            (Some(_), indicator) => {
                if outcome.is_none() {
                    texts.push_message(&Message::CollectionEnded, component);
                }
                self.reported_progress_tenths = None;
                self.pending_report_success = outcome.or((indicator != IndicatorState::Idle).then_some(false));
            }
            (None, _) => self.pending_report_success = outcome.or(self.pending_report_success),
        }
    }

    /// Queues a text for each tenth of progress, and for a collection that starts again from nothing.
    fn report_progress(&mut self, reported: Option<u8>, percent: u8, texts: &mut PendingTexts, component: u8) {
        let reported_progress_tenths = percent / 10;
        let is_new =
            reported.is_none_or(|reported| reported_progress_tenths > reported || (percent == 0 && reported > 0));
        if is_new {
            self.reported_progress_tenths = Some(reported_progress_tenths);
            texts.push_message(&Message::Collecting(10 * reported_progress_tenths), component);
        }
    }

    /// Sends the due message; returns whether one was sent.
    pub fn send_report_or_progress(&mut self, snapshot: &Snapshot<'_>, line: &mut Transmitter<'_>) -> bool {
        if let Some(is_success) = self.pending_report_success {
            let report =
                mag_cal_report(self.reported_calibration.as_ref().filter(|_| is_success), snapshot.settings.mount);
            let is_sent = line.send_message(OutboundMessage::new(&report));
            if is_sent {
                self.pending_report_success = None;
            }
            return is_sent;
        }
        match snapshot.indicator_state {
            IndicatorState::Collecting(percent) if self.progress_schedule.is_due(snapshot.now, PROGRESS_HZ) => {
                line.send_message(OutboundMessage::new(&mag_cal_progress(percent, snapshot)))
            }
            _ => false,
        }
    }
}

/// Progress, percent, and direction of the field in body axes. The mask of sampled directions is unused.
fn mag_cal_progress(percent: u8, snapshot: &Snapshot<'_>) -> MAG_CAL_PROGRESS_DATA {
    let field = snapshot.estimate.body_field.and_then(|body| body.ut.try_normalize(0.0)).unwrap_or_default();
    MAG_CAL_PROGRESS_DATA {
        direction_x: field.x,
        direction_y: field.y,
        direction_z: field.z,
        cal_mask: COMPASS_MASK,
        cal_status: if percent < 100 {
            MagCalStatus::MAG_CAL_RUNNING_STEP_ONE
        } else {
            MagCalStatus::MAG_CAL_RUNNING_STEP_TWO
        },
        attempt: 1,
        completion_pct: percent,
        ..MAG_CAL_PROGRESS_DATA::DEFAULT
    }
}

/// Converts a calibration to the form of autopilots, in body axes: the field is rotated, an offset added, and a
/// symmetric matrix applied, `M (R m + o)`.
///
/// With `W (m - b)` and the configured right-angle mounting `R`, the offset is `-R b`, and the matrix is the symmetric
/// one nearest to `W R^T` in the Frobenius norm, its symmetric part; the remaining rotation is dropped. The fitness is
/// the noise of a reading.
fn mag_cal_report(calibration: Option<&(Calibration, f32)>, mount: Orientation) -> MAG_CAL_REPORT_DATA {
    let failure_report = MAG_CAL_REPORT_DATA {
        cal_mask: COMPASS_MASK,
        cal_status: MagCalStatus::MAG_CAL_FAILED,
        diag_x: 1.0,
        diag_y: 1.0,
        diag_z: 1.0,
        ..MAG_CAL_REPORT_DATA::DEFAULT
    };
    let Some((calibration, relative_sensor_sigma)) = calibration else { return failure_report };
    let w = calibration.w_matrix();
    let mounting = mount.body_from_sensor();
    let offset_mg: Vector3<f32> = -(mounting * calibration.b_vector_ut()) * MG_PER_UT;
    let m = w * mounting.transpose();
    let mean = |row, column| 0.5 * (m[(row, column)] + m[(column, row)]);
    MAG_CAL_REPORT_DATA {
        cal_status: MagCalStatus::MAG_CAL_SUCCESS,
        autosaved: 1,
        fitness: MG_PER_UT * calibration.total_ut * relative_sensor_sigma,
        ofs_x: offset_mg.x,
        ofs_y: offset_mg.y,
        ofs_z: offset_mg.z,
        diag_x: mean(0, 0),
        diag_y: mean(1, 1),
        diag_z: mean(2, 2),
        offdiag_x: mean(0, 1),
        offdiag_y: mean(0, 2),
        offdiag_z: mean(1, 2),
        ..failure_report
    }
}

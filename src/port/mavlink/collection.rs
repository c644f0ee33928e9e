//! How a collection goes on, and what comes of it.

use core::fmt::Write;

use nalgebra::Vector3;

use super::Line;
use super::texts::Texts;
use crate::calibration::{Calibration, Orientation};
use crate::compass::Glance;
use crate::port::{Facts, Pace};
use crate::time::Timestamp;
use crate::wire::mavlink::{MagCalReport, Outgoing};

/// MAG_CAL_PROGRESS, messages a second.
const PROGRESS_HZ: u8 = 2;

/// A new calibration is known this long after the end of its collection, microseconds, or there is none: the two do not
/// come by the same way.
const SETTLED_US: u64 = 1_000_000;

/// Milligauss of a microtesla.
const MG_PER_UT: f32 = 10.0;

/// What is seen of collections and calibrations.
#[derive(Debug, Default)]
pub(super) struct Collection {
    /// The calibration that is in use, and the noise of a reading, over the field's strength.
    calibration: Option<(Calibration, f32)>,
    /// Counts them; wraps.
    calibrations: u8,
    phase: Phase,
    progress: Pace,
}

#[derive(Debug, Default)]
enum Phase {
    /// Nothing to tell.
    #[default]
    Idle,
    /// A collection is under way; `before` is the count of calibrations when it began, and so many tenths of it have been
    /// told.
    Collecting { before: u8, tenths: u8 },
    /// It ended at this instant with a calibration in use, but not with a new one yet.
    Ended { before: u8, at: Timestamp },
    /// It is to be told that it has failed, or what it has given.
    Known { is_success: bool },
}

impl Collection {
    /// Counts the calibrations that have come into use; wraps.
    pub const fn calibrations(&self) -> u8 {
        self.calibrations
    }

    /// Whether this is another calibration than the last.
    pub fn has_not_seen(&self, calibration: &Calibration) -> bool {
        self.calibration.as_ref().is_none_or(|(seen, _)| seen != calibration)
    }

    /// Looks at what there is to tell. To be called even while there is nobody to tell it to.
    pub fn see(&mut self, facts: &Facts<'_>, texts: &mut Texts) {
        if let Some((calibration, uncertainty)) =
            facts.calibration.filter(|(calibration, _)| self.has_not_seen(calibration))
        {
            self.calibration = Some((*calibration, uncertainty.sensor_sigma));
            self.calibrations = self.calibrations.wrapping_add(1);
        }
        let is_new = |before: u8| before != self.calibrations;
        match (&mut self.phase, facts.glance) {
            (Phase::Collecting { tenths, .. }, Glance::Collecting(percent)) => tell_further(tenths, percent, texts),
            (_, Glance::Collecting(percent)) => {
                self.phase = Phase::Collecting { before: self.calibrations, tenths: percent / 10 };
                tell_tenths(percent / 10, texts);
            }
            (&mut Phase::Collecting { before, .. }, glance) => {
                texts.note("collecting ended");
                self.phase = match glance {
                    Glance::Refused => Phase::Known { is_success: false },
                    Glance::Calibrated => Phase::Ended { before, at: facts.now },
                    Glance::Waiting | Glance::Collecting(_) => Phase::Idle,
                };
            }
            _ => {}
        }
        if let Phase::Ended { before, at } = self.phase
            && (is_new(before) || facts.now.us_since(at) > SETTLED_US)
        {
            self.phase = Phase::Known { is_success: is_new(before) };
        }
    }

    /// Sends what is due; whether it was something, and there was room for it.
    pub fn tell(&mut self, facts: &Facts<'_>, line: &mut Line<'_>) -> bool {
        match (&self.phase, facts.glance) {
            (Phase::Collecting { .. }, Glance::Collecting(percent)) if self.progress.is_due(facts.now, PROGRESS_HZ) => {
                let field = facts.estimate.body.and_then(|body| body.ut.try_normalize(0.0)).unwrap_or_default();
                line.send(Outgoing::mag_cal_progress(percent, field.into()))
            }
            (&Phase::Known { is_success }, _) => {
                let report = report(self.calibration.as_ref().filter(|_| is_success), facts.settings.mount);
                let is_sent = line.send(Outgoing::mag_cal_report(&report));
                if is_sent {
                    self.phase = Phase::Idle;
                }
                is_sent
            }
            _ => false,
        }
    }
}

/// Tells another tenth, or that the collection was begun again from nothing.
fn tell_further(tenths: &mut u8, percent: u8, texts: &mut Texts) {
    if percent / 10 > *tenths || (percent == 0 && *tenths > 0) {
        *tenths = percent / 10;
        tell_tenths(*tenths, texts);
    }
}

fn tell_tenths(tenths: u8, texts: &mut Texts) {
    let mut text = heapless::String::<24>::new();
    // It fits.
    let _ = write!(text, "collecting {} %", 10 * tenths);
    texts.note(&text);
}

/// A calibration as autopilots write theirs, in body axes: a field is turned there, an offset added, and a symmetric matrix
/// applied, `M (R m + o)`.
///
/// With `W (m - b)` and the right-angle mounting `R` that is set, the offset is `-R b`, and the matrix the symmetric one
/// nearest to `W R^T` (in the Frobenius norm): its symmetric part. What is beside the right angles of the mounting is not in
/// it. The fitness is the noise of a reading.
fn report(found: Option<&(Calibration, f32)>, mount: Orientation) -> MagCalReport {
    let is_success = found.is_some();
    let none =
        MagCalReport { is_success, fitness_mg: 0.0, offset_mg: [0.0; 3], diagonal: [1.0; 3], off_diagonal: [0.0; 3] };
    let Some((calibration, sensor_sigma)) = found else { return none };
    let w = calibration.w_matrix();
    let mounting = mount.body_from_sensor();
    let offset_ut: Vector3<f32> = -(mounting * calibration.b_vector_ut());
    let m = w * mounting.transpose();
    let mean = |row, column| 0.5 * (m[(row, column)] + m[(column, row)]);
    MagCalReport {
        fitness_mg: MG_PER_UT * calibration.total_ut * sensor_sigma,
        offset_mg: (offset_ut * MG_PER_UT).into(),
        diagonal: [mean(0, 0), mean(1, 1), mean(2, 2)],
        off_diagonal: [mean(0, 1), mean(0, 2), mean(1, 2)],
        ..none
    }
}

//! Reference headings from the user: marks of a compass swing, and the alignment.

use super::activity::Activity;
use super::storage::PendingSave;
use crate::compass::events::{Effect, Reply};
use crate::compass::state::Compass;
use crate::messages::Refusal;
use crate::settings::{OutOfRange, Settings};
use autoswing::calibration::HeadingMark;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::RecentSamples;
use autoswing::frames::wrap_pi;
use autoswing::time::WrappingMillis;

/// Largest alignment without confirmation, degrees: mountings are within 20 deg of a right angle.
const MAX_UNCONFIRMED_ALIGNMENT_DEG: f32 = 20.0;

impl Compass<'_> {
    /// Marks a heading with the mean sample of the last second.
    pub(super) fn mark_heading(&mut self, heading_deg: f32, now: WrappingMillis) -> Result<Effect, Refusal> {
        let is_swinging =
            matches!(self.activity, Activity::Collecting(_)) && self.collector.procedure() == Procedure::Swing;
        if !is_swinging {
            return Err(Refusal::NotSwinging);
        }
        check_heading_range(heading_deg)?;
        let sample = self.recent_samples.mean_at_rest(now).ok_or(Refusal::NotStationary)?;
        if !self.collector.add_mark(HeadingMark { sample, heading_rad: heading_deg.to_radians() }) {
            return Err(Refusal::TooManyMarks);
        }
        self.recent_samples = RecentSamples::new();
        Ok(Effect::Reply(Ok(Reply::MarkCount(self.collector.collection_progress().mark_count))))
    }

    /// Sets the alignment from the present and the given heading.
    pub(super) fn set_alignment(
        &mut self,
        heading_deg: Option<f32>,
        is_confirmed: bool,
        now: WrappingMillis,
    ) -> Result<Effect, Refusal> {
        let mut align_deg = 0.0;
        if let Some(heading_deg) = heading_deg {
            check_heading_range(heading_deg)?;
            let calibration = &self.active_record().ok_or(Refusal::NoCalibration)?.calibration;
            let mean_sample = self.recent_samples.mean_at_rest(now).ok_or(Refusal::NotStationary)?;
            let shown_rad =
                mean_sample.attitude.to_level_frame(calibration.corrected_body_field(&mean_sample)).heading_rad();
            // To a hundredth of a degree, as it is shown.
            align_deg = libm::roundf(100.0 * wrap_pi(heading_deg.to_radians() - shown_rad).to_degrees()) / 100.0;
            if align_deg.abs() > MAX_UNCONFIRMED_ALIGNMENT_DEG && !is_confirmed {
                return Err(Refusal::LargeAlignment { heading_deg, align_deg });
            }
        }
        let settings = Settings { align_deg, ..*self.stored_settings() };
        Ok(self.storage.request_save(PendingSave::Settings(settings)))
    }
}

fn check_heading_range(heading_deg: f32) -> Result<(), Refusal> {
    if (0.0..=360.0).contains(&heading_deg) {
        Ok(())
    } else {
        Err(Refusal::OutOfRange(OutOfRange("a magnetic heading is 0 to 360 degrees")))
    }
}

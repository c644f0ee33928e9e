//! Test of the mean innovations for slow changes, which the gates of single innovations do not detect.
//!
//! Innovations of a correct filter are white. A mean over some seconds beyond its own variance shows a state that changes
//! faster than its process noise: the gyro's offset, if only the heading shows it. An innovation that the gates do not
//! pass counts like one at the gate.

use super::innovation_gate::{Innovation, PerKind, WIDE_GATE_SIGMAS};
use crate::trig::sqrt;

/// Time constant of the means, seconds.
const MEAN_TIME_CONSTANT_S: f32 = 4.0;

/// Normalised mean beyond which an innovation is significant. With 4, a sixth more of the headings are bad after hard iron
/// has changed slowly.
const MEAN_GATE_SIGMAS: f32 = 3.0;

/// Normalised mean of strength or inclination beyond which the field or the attitude has changed, and not the gyro.
const FIELD_CHANGE_SIGMAS: f32 = 2.0;

/// Slow change that the mean innovations show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SlowChange {
    /// Strength or inclination change: the field does, or the attitude.
    Field,
    /// The heading alone changes.
    Heading,
}

/// Mean innovations of strength, inclination and heading.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeanInnovations {
    means: PerKind<f32>,
}

impl MeanInnovations {
    pub const ZERO_MEANS: Self = Self { means: [0.0; 3] };

    /// Adds the innovations of a sample `step_s` after the last one. Returns the change that is significant; none of the
    /// heading alone while strength or inclination may change as well.
    pub fn update_means(&mut self, innovations: &PerKind<Option<Innovation>>, step_s: f32) -> Option<SlowChange> {
        let part = step_s / (MEAN_TIME_CONSTANT_S + step_s);
        let mut sigmas_squared = [0.0; 3];
        for ((mean, innovation), sigmas_squared) in self.means.iter_mut().zip(innovations).zip(&mut sigmas_squared) {
            let Some(Innovation { residual, variance }) = innovation else { continue };
            let limit = WIDE_GATE_SIGMAS * sqrt(*variance);
            let limited = if residual.abs() > limit { limit.copysign(*residual) } else { *residual };
            *mean += part * (limited - *mean);
            // Variance of the exponential mean of white innovations.
            *sigmas_squared = *mean * *mean * (2.0 - part) / (variance * part);
        }
        let beyond = |kind: usize, sigmas: f32| sigmas_squared[kind] > sigmas * sigmas;
        let field_changes = |sigmas: f32| beyond(0, sigmas) || beyond(1, sigmas);
        if field_changes(MEAN_GATE_SIGMAS) {
            return Some(SlowChange::Field);
        }
        let is_of_heading = beyond(2, MEAN_GATE_SIGMAS) && !field_changes(FIELD_CHANGE_SIGMAS);
        is_of_heading.then_some(SlowChange::Heading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Result after `samples` constant innovations, given in sigmas, at 10 Hz.
    fn slow_change_after(sigmas: PerKind<f32>, samples: usize) -> Option<SlowChange> {
        let mut means = MeanInnovations::ZERO_MEANS;
        let innovations = sigmas.map(|n| Some(Innovation { residual: 0.01 * n, variance: 1e-4 }));
        (0..samples).map(|_| means.update_means(&innovations, 0.1)).last().flatten()
    }

    /// If strength or inclination changes with the heading, hard iron or attitude is the cause, and not the gyro; between
    /// two and three sigmas nobody can tell.
    #[test]
    fn a_strength_or_inclination_change_vetoes_a_heading_change() {
        for (sigmas, change) in [
            ([0.4, 0.0, 0.9], Some(SlowChange::Field)),
            ([0.0, 0.4, 0.9], Some(SlowChange::Field)),
            ([0.0, -0.4, 0.0], Some(SlowChange::Field)),
            ([0.3, 0.0, 0.9], None),
            ([0.0, 0.3, 0.9], None),
        ] {
            assert_eq!(slow_change_after(sigmas, 300), change, "{sigmas:?}");
        }
    }
}

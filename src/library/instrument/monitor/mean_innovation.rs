//! Test of the mean innovations for slow changes, which the gates of single innovations do not detect.
//!
//! Innovations of a correct filter are white. A mean over some seconds beyond its own variance shows a state that
//! changes faster than its process noise: the gyro's offset, if only the heading shows it.

use super::innovation_gate::{Innovation, PerKind};

/// Time constant of the means, seconds.
const MEAN_TIME_CONSTANT_S: f32 = 4.0;

/// Normalised mean beyond which an innovation is significant.
const HEADING_GATE_SIGMAS: f32 = 3.0;

/// Normalised mean of strength or inclination beyond which the field or the attitude has changed, and not the gyro.
const FIELD_CHANGE_SIGMAS: f32 = 2.0;

/// Mean innovations of strength, inclination and heading.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeanInnovations {
    means: PerKind<f32>,
}

impl MeanInnovations {
    pub const ZERO_MEANS: Self = Self { means: [0.0; 3] };

    /// Adds the innovations of a sample `step_s` after the last one. Returns the mean innovation of the heading,
    /// radians, if it is significant and that of no other measurement is.
    pub fn update_means(&mut self, innovations: &PerKind<Option<Innovation>>, step_s: f32) -> Option<f32> {
        let part = step_s / (MEAN_TIME_CONSTANT_S + step_s);
        let mut sigmas_squared = [0.0; 3];
        for ((mean, innovation), sigmas_squared) in self.means.iter_mut().zip(innovations).zip(&mut sigmas_squared) {
            let Some(Innovation { residual, variance }) = innovation else { continue };
            *mean += part * (residual - *mean);
            // Variance of the exponential mean of white innovations.
            *sigmas_squared = *mean * *mean * (2.0 - part) / (variance * part);
        }
        let beyond = |kind: usize, sigmas: f32| sigmas_squared[kind] > sigmas * sigmas;
        let is_of_heading =
            beyond(2, HEADING_GATE_SIGMAS) && !beyond(0, FIELD_CHANGE_SIGMAS) && !beyond(1, FIELD_CHANGE_SIGMAS);
        is_of_heading.then_some(self.means[2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Result after `samples` constant innovations, given in sigmas, at 10 Hz.
    fn slow_change_after(sigmas: PerKind<f32>, samples: usize) -> Option<f32> {
        let mut means = MeanInnovations::ZERO_MEANS;
        let innovations = sigmas.map(|n| Some(Innovation { residual: 0.01 * n, variance: 1e-4 }));
        (0..samples).map(|_| means.update_means(&innovations, 0.1)).last().flatten()
    }

    /// The exponential mean over 4 s averages like 80 samples: its sigma is a ninth of an innovation's.
    #[test]
    fn a_mean_beyond_three_of_its_sigmas_is_a_slow_change() {
        assert!(slow_change_after([0.0, 0.0, 0.4], 300).is_some_and(|rad| (0.003..0.004_1).contains(&rad)));
        assert!(slow_change_after([0.0, 0.0, -0.4], 300).is_some_and(|rad| (-0.004_1..-0.003).contains(&rad)));
        assert_eq!(slow_change_after([0.0, 0.0, 0.3], 300), None);
        assert_eq!(slow_change_after([0.0, 0.0, 0.4], 20), None);
    }

    /// If strength or inclination changes with the heading, hard iron or attitude is the cause, and not the gyro.
    #[test]
    fn a_strength_or_inclination_change_vetoes_a_heading_change() {
        assert_eq!(slow_change_after([0.3, 0.0, 0.9], 300), None);
        assert_eq!(slow_change_after([0.0, 0.3, 0.9], 300), None);
        assert_eq!(slow_change_after([0.3, 0.9, 0.0], 300), None);
    }
}

//! Mean of the last second of samples, for a vehicle at rest.

use nalgebra::Vector3;

use crate::calibration::{Rates, Sample};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;
use crate::trig::VectorLength as _;

/// Number of samples averaged: 0.8 s at 10 Hz.
const AVERAGED_SAMPLES: usize = 8;

/// Largest age of the oldest sample, milliseconds.
const MAX_AGE_MS: u32 = 2000;

/// Largest deviation from the mean, microtesla: 2 deg of a weak horizontal field.
const MAX_DEVIATION_UT: f32 = 0.7;

/// Buffer of the last samples.
#[derive(Debug, Default)]
pub struct RecentSamples {
    samples: heapless::Deque<Sample, AVERAGED_SAMPLES>,
}

impl RecentSamples {
    /// A buffer without samples.
    #[must_use]
    pub const fn new() -> Self {
        Self { samples: heapless::Deque::new() }
    }

    /// Adds the next sample.
    pub fn push_sample(&mut self, sample: Sample) {
        if self.samples.is_full() {
            self.samples.pop_front();
        }
        // Infallible: the oldest was removed if full.
        let _ = self.samples.push_back(sample);
    }

    /// Mean sample with the oldest time; `None` if the vehicle moves, or if samples are missing or too old.
    #[must_use]
    pub fn mean_at_rest(&self, now: WrappingMillis) -> Option<Sample> {
        let oldest = self.samples.front().filter(|_| self.samples.is_full())?;
        if now.ms_since(oldest.time) > MAX_AGE_MS {
            return None;
        }
        let sample_count = AVERAGED_SAMPLES as f32;
        let mean_ut = self.samples.iter().map(|sample| sample.field.ut).sum::<Vector3<f32>>() / sample_count;
        let is_steady =
            self.samples.iter().all(|sample| (sample.field.ut - mean_ut).vector_length() <= MAX_DEVIATION_UT);
        let mean = |angle: fn(&Sample) -> f32| self.samples.iter().map(angle).sum::<f32>() / sample_count;
        is_steady.then(|| Sample {
            field: Field::new(mean_ut),
            attitude: Attitude {
                roll_rad: mean(|sample| sample.attitude.roll_rad),
                pitch_rad: mean(|sample| sample.attitude.pitch_rad),
            },
            rates: if self.samples.iter().all(|sample| sample.rates.is_known()) {
                Rates::from_rad_s([
                    mean(|sample| sample.rates.roll_rad_s()),
                    mean(|sample| sample.rates.pitch_rad_s()),
                    mean(|sample| sample.rates.heading_rad_s()),
                ])
            } else {
                Rates::UNKNOWN
            },
            current: oldest.current,
            time: oldest.time,
            part: oldest.part,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_samples::test_sample;
    use super::*;

    fn millis(ms: u32) -> WrappingMillis {
        WrappingMillis::new(ms)
    }

    /// Samples every 100 ms from 1000 ms, with this x field and an attitude that follows it.
    fn samples_with_fields(fields_ut: impl IntoIterator<Item = f32>) -> RecentSamples {
        let mut recent = RecentSamples::new();
        for (i, x) in fields_ut.into_iter().enumerate() {
            let attitude = Attitude::from_deg(1.0 + x / 10.0, -2.0 - x / 10.0);
            let rates = Rates::from_rad_s([x / 100.0, -x / 50.0, x / 10.0]);
            recent.push_sample(Sample { attitude, rates, ..test_sample([x, 5.0, 40.0], 1000 + i as u32 * 100) });
        }
        recent
    }

    #[test]
    fn a_vehicle_at_rest_is_averaged() {
        let rest = samples_with_fields((0_u8..20).map(|i| 20.0 + f32::from(i % 2) * 0.4));
        let mean = rest.mean_at_rest(millis(3000)).unwrap();
        assert!((mean.field.ut - Vector3::new(20.2, 5.0, 40.0)).norm() < 1e-4, "{mean:?}");
        assert!((mean.attitude.roll_rad.to_degrees() - 3.02).abs() < 1e-4, "{mean:?}");
        assert!((mean.attitude.pitch_rad.to_degrees() + 4.02).abs() < 1e-4, "{mean:?}");
        let rates = [mean.rates.roll_rad_s(), mean.rates.pitch_rad_s(), mean.rates.heading_rad_s()];
        for (mean_rad_s, expected_rad_s) in rates.into_iter().zip([0.202, -0.404, 2.02]) {
            // One step: samples and mean are each rounded by half a step.
            assert!((mean_rad_s - expected_rad_s).abs() <= 1.0 / 1024.0, "{rates:?}");
        }
        assert_eq!(mean.time, millis(2200), "the oldest of the last eight");
    }

    #[test]
    fn a_turning_vehicle_or_old_samples_have_no_mean() {
        let turning = samples_with_fields((0_u8..20).map(|i| 20.0 + f32::from(i) * 0.3));
        assert_eq!(turning.mean_at_rest(millis(3000)), None, "3 uT a second");
        assert_eq!(samples_with_fields([20.0; 20]).mean_at_rest(millis(30_000)), None, "27 s later");
    }

    #[test]
    fn a_mean_at_rest_needs_eight_samples() {
        assert_eq!(samples_with_fields([20.0; 7]).mean_at_rest(millis(1700)), None);
        assert!(samples_with_fields([20.0; 8]).mean_at_rest(millis(1800)).is_some());
        assert_eq!(RecentSamples::new().mean_at_rest(millis(0)), None);
        // Seven samples of zero field pass the deviation test; only their number rejects them.
        let mut seven = RecentSamples::new();
        (0..7).for_each(|i| seven.push_sample(test_sample([0.0; 3], 1000 + i * 100)));
        assert_eq!(seven.mean_at_rest(millis(1700)), None);
    }

    #[test]
    fn samples_are_old_after_two_seconds() {
        assert!(samples_with_fields([20.0; 8]).mean_at_rest(millis(3000)).is_some());
        assert_eq!(samples_with_fields([20.0; 8]).mean_at_rest(millis(3001)), None);
    }

    #[test]
    fn samples_at_rest_are_within_0_7_ut_of_their_mean() {
        let swaying =
            |ut: f32| samples_with_fields([20.0 + ut, 20.0 - ut].repeat(4)).mean_at_rest(millis(1800)).is_some();
        assert!(swaying(0.69) && swaying(-0.69));
        assert!(!swaying(0.71) && !swaying(-0.71));
        // A single outlier: 0.81 uT from the others is 0.81 * 7 / 8 = 0.71 from the mean.
        let jolt = |ut: f32| {
            samples_with_fields([20.0, 20.0, 20.0, 20.0 + ut, 20.0, 20.0, 20.0, 20.0])
                .mean_at_rest(millis(1800))
                .is_some()
        };
        assert!(jolt(0.79) && !jolt(0.81));
    }

    #[test]
    fn the_mean_at_rest_uses_the_last_eight_samples() {
        let stopped = samples_with_fields([50.0; 5].into_iter().chain([20.0; 8]));
        assert_eq!(stopped.mean_at_rest(millis(2200)).map(|mean| mean.field.ut.x), Some(20.0));
    }
}

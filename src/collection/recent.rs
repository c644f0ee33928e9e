//! The last second of samples: what a person at rest means by "now".

use nalgebra::Vector3;

use crate::calibration::{Rates, Sample};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

/// Samples in it: eight tenths of a second.
const SAMPLES: usize = 8;

/// The oldest of them must not be older than this, milliseconds.
const MAX_AGE_MS: u32 = 2000;

/// None of them may lie further from their mean, microtesla: 2 deg of a weak horizontal field.
const MAX_MOVE_UT: f32 = 0.7;

/// The last samples.
#[derive(Debug, Default)]
pub struct Recent {
    samples: heapless::Deque<Sample, SAMPLES>,
}

impl Recent {
    /// No samples yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { samples: heapless::Deque::new() }
    }

    /// Takes the next sample in time.
    pub fn push(&mut self, sample: Sample) {
        if self.samples.is_full() {
            self.samples.pop_front();
        }
        // There is room: one was just taken out if there was none.
        let _ = self.samples.push_back(sample);
    }

    /// Their mean, at the time of the oldest; `None` if the vehicle moves, or the samples are few or old.
    #[must_use]
    pub fn steady(&self, now: WrappingMillis) -> Option<Sample> {
        let oldest = self.samples.front().filter(|_| self.samples.is_full())?;
        if now.since(oldest.time) > MAX_AGE_MS {
            return None;
        }
        let number = SAMPLES as f32;
        let mean_ut = self.samples.iter().map(|s| s.field.ut).sum::<Vector3<f32>>() / number;
        let steady = self.samples.iter().all(|s| (s.field.ut - mean_ut).norm() <= MAX_MOVE_UT);
        let mean = |angle: fn(&Sample) -> f32| self.samples.iter().map(angle).sum::<f32>() / number;
        steady.then(|| Sample {
            field: Field::new(mean_ut),
            attitude: Attitude { roll_rad: mean(|s| s.attitude.roll_rad), pitch_rad: mean(|s| s.attitude.pitch_rad) },
            rates: Rates::from_rad_s([
                mean(|s| s.rates.roll_rad_s()),
                mean(|s| s.rates.pitch_rad_s()),
                mean(|s| s.rates.heading_rad_s()),
            ])
            .with_current(oldest.rates.current_a()),
            time: oldest.time,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::sample;
    use super::*;

    fn at(ms: u32) -> WrappingMillis {
        WrappingMillis::new(ms)
    }

    /// Samples 100 ms apart from 1000 ms on, with their x field and an attitude that changes with it.
    fn recent(fields_ut: impl IntoIterator<Item = f32>) -> Recent {
        let mut recent = Recent::new();
        for (i, x) in fields_ut.into_iter().enumerate() {
            let attitude = Attitude::from_deg(1.0 + x / 10.0, -2.0 - x / 10.0);
            let rates = Rates::from_rad_s([x / 100.0, -x / 50.0, x / 10.0]);
            recent.push(Sample { attitude, rates, ..sample([x, 5.0, 40.0], 1000 + i as u32 * 100) });
        }
        recent
    }

    #[test]
    fn a_vehicle_at_rest_is_averaged() {
        let rest = recent((0_u8..20).map(|i| 20.0 + f32::from(i % 2) * 0.4));
        let mean = rest.steady(at(3000)).unwrap();
        assert!((mean.field.ut - Vector3::new(20.2, 5.0, 40.0)).norm() < 1e-4, "{mean:?}");
        assert!((mean.attitude.roll_rad.to_degrees() - 3.02).abs() < 1e-4, "{mean:?}");
        assert!((mean.attitude.pitch_rad.to_degrees() + 4.02).abs() < 1e-4, "{mean:?}");
        assert_eq!(mean.rates, Rates::from_rad_s([0.202, -0.404, 2.02]));
        assert_eq!(mean.time, at(2200), "the oldest of the last eight");
    }

    #[test]
    fn a_turning_vehicle_and_old_samples_are_not() {
        let turning = recent((0_u8..20).map(|i| 20.0 + f32::from(i) * 0.3));
        assert_eq!(turning.steady(at(3000)), None, "3 uT a second");
        assert_eq!(recent([20.0; 20]).steady(at(30_000)), None, "27 s later");
    }

    #[test]
    fn eight_samples_are_needed() {
        assert_eq!(recent([20.0; 7]).steady(at(1700)), None);
        assert!(recent([20.0; 8]).steady(at(1800)).is_some());
        assert_eq!(Recent::new().steady(at(0)), None);
        // In no field at all, seven divided by eight are no further from their mean than eight.
        let mut seven = Recent::new();
        (0..7).for_each(|i| seven.push(sample([0.0; 3], 1000 + i * 100)));
        assert_eq!(seven.steady(at(1700)), None);
    }

    /// The oldest of these eight was measured at 1000 ms.
    #[test]
    fn samples_are_old_after_two_seconds() {
        assert!(recent([20.0; 8]).steady(at(3000)).is_some());
        assert_eq!(recent([20.0; 8]).steady(at(3001)), None);
    }

    /// Half of them to one side of the mean, half to the other.
    #[test]
    fn samples_must_lie_within_seven_tenths_of_a_microtesla_of_their_mean() {
        let swaying = |ut: f32| recent([20.0 + ut, 20.0 - ut].repeat(4)).steady(at(1800)).is_some();
        assert!(swaying(0.69) && swaying(-0.69));
        assert!(!swaying(0.71) && !swaying(-0.71));
        // One alone is enough: 0.81 from the others is 0.81 * 7 / 8 = 0.71 from the mean.
        let jolt = |ut: f32| recent([20.0, 20.0, 20.0, 20.0 + ut, 20.0, 20.0, 20.0, 20.0]).steady(at(1800)).is_some();
        assert!(jolt(0.79) && !jolt(0.81));
    }

    #[test]
    fn only_the_last_eight_count() {
        let stopped = recent([50.0; 5].into_iter().chain([20.0; 8]));
        assert_eq!(stopped.steady(at(2200)).map(|mean| mean.field.ut.x), Some(20.0));
    }
}

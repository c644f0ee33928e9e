//! The last second of samples: what a person at rest means by "now".

use nalgebra::Vector3;

use crate::calibration::Sample;
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

/// Samples in it: eight tenths of a second.
const SAMPLES: usize = 8;

/// They must not be older than this, milliseconds.
const MAX_AGE_MS: u32 = 2000;

/// nor move by more than this from their mean, microtesla: 2 deg of a weak horizontal field.
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

    /// Their mean; `None` if the vehicle moves, or the samples are few or old.
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
            time: oldest.time,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recent(fields_ut: impl Iterator<Item = f32>) -> Recent {
        let mut recent = Recent::new();
        for (i, x) in fields_ut.enumerate() {
            let attitude = Attitude::from_deg(1.0, -2.0);
            recent.push(Sample {
                field: Field::from_ut(x, 5.0, 40.0),
                attitude,
                time: WrappingMillis::new(1000 + i as u32 * 100),
            });
        }
        recent
    }

    #[test]
    fn a_vehicle_at_rest_is_averaged() {
        let rest = recent((0_u8..20).map(|i| 20.0 + f32::from(i % 2) * 0.4));
        let mean = rest.steady(WrappingMillis::new(3000)).unwrap();
        assert!((mean.field.ut.x - 20.2).abs() < 1e-4);
        assert!((mean.attitude.pitch_rad.to_degrees() + 2.0).abs() < 1e-4);
    }

    #[test]
    fn a_turning_vehicle_and_old_samples_are_not() {
        assert_eq!(
            recent((0_u8..20).map(|i| 20.0 + f32::from(i) * 0.3)).steady(WrappingMillis::new(3000)),
            None,
            "3 uT a second"
        );
        assert_eq!(recent((0_u8..20).map(|_| 20.0)).steady(WrappingMillis::new(30_000)), None, "27 s later");
        assert_eq!(recent((0_u8..7).map(|_| 20.0)).steady(WrappingMillis::new(1700)), None, "too few");
    }
}

//! Mean of the last second of samples, for a vehicle at rest.

use nalgebra::Vector3;

use crate::calibration::{AngleRates, Sample};
use crate::frames::{Field, RollPitch};
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
    samples: heapless::HistoryBuf<Sample, AVERAGED_SAMPLES>,
}

impl RecentSamples {
    /// A buffer without samples.
    #[must_use]
    pub const fn new() -> Self {
        Self { samples: heapless::HistoryBuf::new() }
    }

    /// Adds the next sample.
    pub fn push_sample(&mut self, sample: Sample) {
        self.samples.write(sample);
    }

    /// Mean sample with the oldest time; `None` if the vehicle moves, or if samples are missing or too old.
    #[must_use]
    pub fn mean_at_rest(&self, now: WrappingMillis) -> Option<Sample> {
        let oldest = self.samples.oldest().filter(|_| self.samples.is_full())?;
        if now.ms_since(oldest.time) > MAX_AGE_MS {
            return None;
        }
        let sample_count = AVERAGED_SAMPLES as f32;
        let mean_ut = self.samples.oldest_ordered().map(|sample| sample.field.ut).sum::<Vector3<f32>>() / sample_count;
        let is_steady =
            self.samples.oldest_ordered().all(|sample| (sample.field.ut - mean_ut).vector_length() <= MAX_DEVIATION_UT);
        let mean = |angle: fn(&Sample) -> f32| self.samples.oldest_ordered().map(angle).sum::<f32>() / sample_count;
        is_steady.then(|| Sample {
            field: Field::new(mean_ut),
            attitude: RollPitch {
                roll_rad: mean(|sample| sample.attitude.roll_rad),
                pitch_rad: mean(|sample| sample.attitude.pitch_rad),
            },
            rates: if self.samples.oldest_ordered().all(|sample| sample.rates.is_known()) {
                AngleRates::from_rad_s([
                    mean(|sample| sample.rates.roll_rad_s()),
                    mean(|sample| sample.rates.pitch_rad_s()),
                    mean(|sample| sample.rates.heading_rad_s()),
                ])
            } else {
                AngleRates::UNKNOWN
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

    /// Mean at 100 ms after the last of these samples, with this x field and an attitude and rates that follow it. They
    /// are 100 ms apart, the first at 1000 ms.
    fn mean_of(fields_ut: &[f32]) -> Option<Sample> {
        mean_after(fields_ut, 100)
    }

    fn mean_after(fields_ut: &[f32], delay_ms: u32) -> Option<Sample> {
        let (mut recent, mut time_ms) = (RecentSamples::new(), 1000);
        for x in fields_ut {
            let attitude = RollPitch::from_deg(1.0 + x / 10.0, -2.0 - x / 10.0);
            let rates = AngleRates::from_rad_s([x / 100.0, -x / 50.0, x / 10.0]);
            recent.push_sample(Sample { attitude, rates, ..test_sample([*x, 5.0, 40.0], time_ms) });
            time_ms += 100;
        }
        recent.mean_at_rest(WrappingMillis::new(time_ms - 100 + delay_ms))
    }

    /// The last eight of twenty samples, after a move.
    #[test]
    fn a_vehicle_at_rest_is_averaged() {
        let mean = mean_of(&[&[50.0; 12][..], &[20.0, 20.4].repeat(4)].concat()).unwrap();
        assert!((mean.field.ut - Vector3::new(20.2, 5.0, 40.0)).norm() < 1e-4, "{mean:?}");
        assert!((mean.attitude.roll_rad.to_degrees() - 3.02).abs() < 1e-4, "{mean:?}");
        assert!((mean.attitude.pitch_rad.to_degrees() + 4.02).abs() < 1e-4, "{mean:?}");
        let rates = [mean.rates.roll_rad_s(), mean.rates.pitch_rad_s(), mean.rates.heading_rad_s()];
        for (mean_rad_s, expected_rad_s) in rates.into_iter().zip([0.202, -0.404, 2.02]) {
            // One step: samples and mean are each rounded by half a step.
            assert!((mean_rad_s - expected_rad_s).abs() <= 1.0 / 1024.0, "{rates:?}");
        }
        assert_eq!(mean.time, WrappingMillis::new(2200), "the oldest of the last eight");
    }

    /// Noise of 0.3 uT is no motion; 2 deg of heading in a weak horizontal field are 0.7 uT.
    #[test]
    fn a_vehicle_at_rest_has_eight_recent_samples_of_one_field() {
        let outlier = |ut: f32| [20.0, 20.0, 20.0, 20.0 + ut, 20.0, 20.0, 20.0, 20.0];
        let turning: Vec<f32> = (0_u8..20).map(|i| 20.0 + f32::from(i) * 0.3).collect();
        for (name, mean, is_at_rest) in [
            ("at rest", mean_of(&[20.0; 8]), true),
            ("noise", mean_of(&[20.3, 19.7].repeat(4)), true),
            ("a noisy sample", mean_of(&outlier(0.6)), true),
            ("swaying by 2 deg", mean_of(&[20.8, 19.2].repeat(4)), false),
            ("a jolt", mean_of(&outlier(-1.0)), false),
            ("turning, 3 uT a second", mean_of(&turning), false),
            ("a second later", mean_after(&[20.0; 8], 1000), true),
            ("two seconds later", mean_after(&[20.0; 8], 2000), false),
            ("seven samples", mean_of(&[20.0; 7]), false),
            ("no sample", RecentSamples::new().mean_at_rest(WrappingMillis::new(0)), false),
        ] {
            assert_eq!(mean.is_some(), is_at_rest, "{name}");
        }
        // Seven samples of zero field equal their mean; only their number rejects them.
        let mut seven = RecentSamples::new();
        (0..7).for_each(|i| seven.push_sample(test_sample([0.0; 3], 1000 + i * 100)));
        assert_eq!(seven.mean_at_rest(WrappingMillis::new(1700)), None);
    }
}

//! Averages a few consecutive readings into one sample.

use nalgebra::Vector3;

use crate::calibration::Sample;
use crate::frames::{Attitude, Field, Sensor, wrap_pi};
use crate::time::Timestamp;

/// Readings in one sample: a tenth of a second at 80 Hz. Eight readings have a third of the noise of one, and within a
/// tenth of a second a turn of 30 deg/s moves by 3 deg, which bends the mean by less than 0.02 % of the field.
pub const READINGS: u16 = 8;

/// A larger step between readings is a gap, not to be averaged over: three periods at 80 Hz.
const MAX_STEP_US: u64 = 40_000;

/// Averages runs of [`READINGS`] readings without gaps. Attitude is averaged with the field, so both keep the same
/// mean instant.
#[derive(Debug, Default)]
pub struct Averager {
    run: Option<Run>,
}

/// Sums since the first reading of a run.
#[derive(Debug)]
struct Run {
    count: u16,
    first_us: u64,
    last_us: u64,
    field_ut: Vector3<f32>,
    first_roll_rad: f32,
    /// Roll less the first one's, so that a roll through 180 deg averages right.
    roll_rad: f32,
    pitch_rad: f32,
}

impl Averager {
    /// Nothing taken yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { run: None }
    }

    /// Takes a reading with the attitude at its instant; gives a sample when it is the last of a run.
    pub fn push(&mut self, time_us: u64, field: Field<Sensor>, attitude: Attitude) -> Option<Sample> {
        let fits = |run: &Run| time_us.checked_sub(run.last_us).is_some_and(|step_us| step_us <= MAX_STEP_US);
        let mut run = self.run.take().filter(fits).unwrap_or_else(|| Run::starting(time_us, attitude));
        run.count += 1;
        run.last_us = time_us;
        run.field_ut += field.ut;
        run.roll_rad += wrap_pi(attitude.roll_rad - run.first_roll_rad);
        run.pitch_rad += attitude.pitch_rad;
        if run.count == READINGS {
            return Some(run.mean());
        }
        self.run = Some(run);
        None
    }
}

impl Run {
    fn starting(time_us: u64, attitude: Attitude) -> Self {
        Self {
            count: 0,
            first_us: time_us,
            last_us: time_us,
            field_ut: Vector3::zeros(),
            first_roll_rad: attitude.roll_rad,
            roll_rad: 0.0,
            pitch_rad: 0.0,
        }
    }

    fn mean(&self) -> Sample {
        let count = f32::from(self.count);
        let middle_us = self.first_us + (self.last_us - self.first_us) / 2;
        Sample {
            field: Field::new(self.field_ut / count),
            attitude: Attitude {
                roll_rad: wrap_pi(self.first_roll_rad + self.roll_rad / count),
                pitch_rad: self.pitch_rad / count,
            },
            time: Timestamp::from_us(middle_us).wrapping_millis(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::WrappingMillis;

    #[test]
    fn averages_field_attitude_and_time_of_a_run() {
        let mut averager = Averager::new();
        let samples: Vec<Sample> = (0..16_u16)
            .filter_map(|i| {
                let x = f32::from(i);
                averager.push(u64::from(i) * 12_500, Field::from_ut(x, 0.0, -x), Attitude::from_deg(x, -x))
            })
            .collect();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[1].field, Field::from_ut(11.5, 0.0, -11.5));
        assert!((samples[1].attitude.roll_rad.to_degrees() - 11.5).abs() < 1e-4);
        assert_eq!(samples[1].time, WrappingMillis::new(143));
    }

    #[test]
    fn a_gap_or_a_clock_that_went_back_starts_a_new_run() {
        let mut averager = Averager::new();
        let mut push = |time_us| averager.push(time_us, Field::from_ut(1.0, 0.0, 0.0), Attitude::default());
        for time_us in [0, 12_500, 25_000, 37_500, 200_000, 100_000] {
            assert!(push(time_us).is_none());
        }
        let later: Vec<_> = (1..=7_u64).filter_map(|i| push(100_000 + i * 12_500)).collect();
        assert_eq!(later.len(), 1, "the run starts at the reading after the last gap");
        assert_eq!(later[0].time, WrappingMillis::new(143));
    }
}

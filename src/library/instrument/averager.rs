//! Averages consecutive readings to one sample.

use nalgebra::Vector3;

use crate::attitude::EulerRates;
use crate::calibration::{AngleRates, Sample};
use crate::frames::{Field, RollPitch, Sensor, wrap_pi};
use crate::time::Timestamp;

/// Averages gapless runs of readings, and their attitudes, so that both refer to the same time.
#[derive(Debug)]
pub(super) struct Averager {
    readings_per_sample: u16,
    /// Longest step between readings, microseconds.
    max_step_us: u64,
    averaging_run: Option<AveragingRun>,
}

#[derive(Debug)]
struct AveragingRun {
    reading_count: u16,
    first_at: Timestamp,
    last_at: Timestamp,
    field_sum_ut: Vector3<f32>,
    first_roll_rad: f32,
    /// Sum of the rolls relative to the first one, radians, so that a roll through 180 deg averages correctly.
    relative_roll_sum_rad: f32,
    pitch_sum_rad: f32,
    /// Sum of the rates of roll, pitch and heading, rad/s; `None` if the rates at one of the readings are unknown.
    rate_sums_rad_s: Option<[f32; 3]>,
}

impl Averager {
    pub const fn new(readings_per_sample: u16, max_step_us: u64) -> Self {
        Self { readings_per_sample, max_step_us, averaging_run: None }
    }

    pub fn reset(&mut self) {
        self.averaging_run = None;
    }

    /// Adds a reading with the attitude and Euler-angle rates at its time; returns a sample at the end of a run.
    pub fn push_reading(
        &mut self,
        at: Timestamp,
        field: Field<Sensor>,
        attitude: RollPitch,
        rates: Option<EulerRates>,
    ) -> Option<Sample> {
        let continues_run = |run: &AveragingRun| at >= run.last_at && at.us_since(run.last_at) <= self.max_step_us;
        let mut run =
            self.averaging_run.take().filter(continues_run).unwrap_or_else(|| AveragingRun::new_at(at, attitude));
        run.reading_count += 1;
        run.last_at = at;
        run.field_sum_ut += field.ut;
        run.relative_roll_sum_rad += wrap_pi(attitude.roll_rad - run.first_roll_rad);
        run.pitch_sum_rad += attitude.pitch_rad;
        run.rate_sums_rad_s = run.rate_sums_rad_s.zip(rates).map(|([roll, pitch, heading], rates)| {
            [roll + rates.roll_rad_s, pitch + rates.pitch_rad_s, heading + rates.heading_rad_s]
        });
        if run.reading_count >= self.readings_per_sample {
            return Some(run.mean_sample());
        }
        self.averaging_run = Some(run);
        None
    }
}

impl AveragingRun {
    fn new_at(at: Timestamp, attitude: RollPitch) -> Self {
        Self {
            reading_count: 0,
            first_at: at,
            last_at: at,
            field_sum_ut: Vector3::zeros(),
            first_roll_rad: attitude.roll_rad,
            relative_roll_sum_rad: 0.0,
            pitch_sum_rad: 0.0,
            rate_sums_rad_s: Some([0.0; 3]),
        }
    }

    fn mean_sample(&self) -> Sample {
        let count = f32::from(self.reading_count);
        let middle = self.first_at.plus_us(self.last_at.us_since(self.first_at) / 2);
        Sample {
            rates: self
                .rate_sums_rad_s
                .map_or(AngleRates::UNKNOWN, |sums| AngleRates::from_rad_s(sums.map(|sum| sum / count))),
            time: middle.wrapping_millis(),
            ..Sample::new(
                Field::new(self.field_sum_ut / count),
                RollPitch {
                    roll_rad: wrap_pi(self.first_roll_rad + self.relative_roll_sum_rad / count),
                    pitch_rad: self.pitch_sum_rad / count,
                },
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::WrappingMillis;

    /// 80 Hz: eight readings per sample; the longest step is 3.2 periods.
    const PERIOD_US: u64 = 12_500;

    fn averager() -> Averager {
        Averager::new(8, 40_000)
    }

    #[test]
    fn averages_field_attitude_and_time_of_a_run() {
        let mut averager = averager();
        let samples: Vec<Sample> = (0..16_u16)
            .filter_map(|i| {
                let x = f32::from(i);
                let at = Timestamp::from_us(u64::from(i) * PERIOD_US);
                let rates = EulerRates { roll_rad_s: x / 10.0, pitch_rad_s: -x / 5.0, heading_rad_s: 2.0 };
                averager.push_reading(at, Field::from_ut(x, 0.0, -x), RollPitch::from_deg(x, -x), Some(rates))
            })
            .collect();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[1].field, Field::from_ut(11.5, 0.0, -11.5));
        assert!((samples[1].attitude.roll_rad.to_degrees() - 11.5).abs() < 1e-4);
        assert!((samples[1].attitude.pitch_rad.to_degrees() + 11.5).abs() < 1e-4);
        assert_eq!(samples[1].rates, AngleRates::from_rad_s([1.15, -2.3, 2.0]));
        assert_eq!(samples[1].time, WrappingMillis::new(143));
    }

    fn averaged_samples(instants_us: impl IntoIterator<Item = u64>) -> Vec<Sample> {
        let mut averager = averager();
        let field = Field::from_ut(1.0, 0.0, 0.0);
        let mut push = |us| averager.push_reading(Timestamp::from_us(us), field, RollPitch::default(), None);
        instants_us.into_iter().filter_map(&mut push).collect()
    }

    #[test]
    fn a_gap_or_a_backward_clock_step_starts_a_new_run() {
        let broken = [0, 12_500, 25_000, 37_500, 200_000, 100_000];
        assert!(averaged_samples(broken).is_empty());
        let later = averaged_samples(broken.into_iter().chain((1..=7).map(|i| 100_000 + i * PERIOD_US)));
        assert_eq!(later.len(), 1, "the run starts at the reading after the last gap");
        assert_eq!(later[0].time, WrappingMillis::new(143));
    }
}

//! Averages a few consecutive readings into one sample.

use nalgebra::Vector3;

use crate::attitude::Motion;
use crate::calibration::{Rates, Sample};
use crate::frames::{Attitude, Field, Sensor, wrap_pi};
use crate::time::Timestamp;

/// Averages runs of readings without gaps. Attitude is averaged with the field, so both keep the same mean instant.
#[derive(Debug)]
pub(super) struct Averager {
    /// Readings in one sample.
    readings: u16,
    /// A larger step between readings is a gap, not to be averaged over, microseconds.
    max_step_us: u64,
    run: Option<Run>,
}

/// Sums since the first reading of a run.
#[derive(Debug)]
struct Run {
    count: u16,
    first: Timestamp,
    last: Timestamp,
    field_ut: Vector3<f32>,
    first_roll_rad: f32,
    /// Roll less the first one's, so that a roll through 180 deg averages right.
    roll_rad: f32,
    pitch_rad: f32,
    rates_rad_s: [f32; 3],
}

impl Averager {
    /// Nothing taken yet.
    pub const fn new(readings: u16, max_step_us: u64) -> Self {
        Self { readings, max_step_us, run: None }
    }

    /// Forgets the run under way.
    pub fn reset(&mut self) {
        self.run = None;
    }

    /// Takes a reading with the attitude at its instant and how fast that changes; gives a sample when it is the last of
    /// a run.
    pub fn push(&mut self, at: Timestamp, field: Field<Sensor>, attitude: Attitude, motion: Motion) -> Option<Sample> {
        let fits = |run: &Run| at >= run.last && at.us_since(run.last) <= self.max_step_us;
        let mut run = self.run.take().filter(fits).unwrap_or_else(|| Run::starting(at, attitude));
        run.count += 1;
        run.last = at;
        run.field_ut += field.ut;
        run.roll_rad += wrap_pi(attitude.roll_rad - run.first_roll_rad);
        run.pitch_rad += attitude.pitch_rad;
        let rates_rad_s = [motion.roll_rad_s, motion.pitch_rad_s, motion.heading_rad_s];
        for (sum, rate_rad_s) in run.rates_rad_s.iter_mut().zip(rates_rad_s) {
            *sum += rate_rad_s;
        }
        if run.count >= self.readings {
            return Some(run.mean());
        }
        self.run = Some(run);
        None
    }
}

impl Run {
    fn starting(at: Timestamp, attitude: Attitude) -> Self {
        Self {
            count: 0,
            first: at,
            last: at,
            field_ut: Vector3::zeros(),
            first_roll_rad: attitude.roll_rad,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            rates_rad_s: [0.0; 3],
        }
    }

    fn mean(&self) -> Sample {
        let count = f32::from(self.count);
        let middle = self.first.plus_us(self.last.us_since(self.first) / 2);
        Sample {
            field: Field::new(self.field_ut / count),
            attitude: Attitude {
                roll_rad: wrap_pi(self.first_roll_rad + self.roll_rad / count),
                pitch_rad: self.pitch_rad / count,
            },
            rates: Rates::from_rad_s(self.rates_rad_s.map(|sum| sum / count)),
            time: middle.wrapping_millis(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::WrappingMillis;

    /// 80 Hz: eight readings a sample, and three periods and a bit are a gap.
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
                let motion = Motion { roll_rad_s: x / 10.0, pitch_rad_s: -x / 5.0, heading_rad_s: 2.0 };
                averager.push(at, Field::from_ut(x, 0.0, -x), Attitude::from_deg(x, -x), motion)
            })
            .collect();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[1].field, Field::from_ut(11.5, 0.0, -11.5));
        assert!((samples[1].attitude.roll_rad.to_degrees() - 11.5).abs() < 1e-4);
        assert!((samples[1].attitude.pitch_rad.to_degrees() + 11.5).abs() < 1e-4);
        assert_eq!(samples[1].rates, Rates::from_rad_s([1.15, -2.3, 2.0]));
        assert_eq!(samples[1].time, WrappingMillis::new(143));
    }

    /// 178, -178, 178, -178 deg lie about 180, not about 0.
    #[test]
    fn a_roll_through_180_deg_averages_to_180() {
        let mut averager = averager();
        let sample = (0..8_u16)
            .find_map(|i| {
                let roll_deg = if i % 2 == 0 { 178.0 } else { -178.0 };
                let at = Timestamp::from_us(u64::from(i) * PERIOD_US);
                averager.push(at, Field::from_ut(1.0, 0.0, 0.0), Attitude::from_deg(roll_deg, 0.0), Motion::default())
            })
            .unwrap();
        assert!((sample.attitude.roll_rad.to_degrees().abs() - 180.0).abs() < 1e-3, "{sample:?}");
    }

    /// How many samples readings at these instants make.
    fn samples(instants_us: impl IntoIterator<Item = u64>) -> Vec<Sample> {
        let mut averager = averager();
        let field = Field::from_ut(1.0, 0.0, 0.0);
        let mut push = |us| averager.push(Timestamp::from_us(us), field, Attitude::default(), Motion::default());
        instants_us.into_iter().filter_map(&mut push).collect()
    }

    #[test]
    fn a_gap_or_a_clock_that_went_back_starts_a_new_run() {
        let broken = [0, 12_500, 25_000, 37_500, 200_000, 100_000];
        assert!(samples(broken).is_empty());
        let later = samples(broken.into_iter().chain((1..=7).map(|i| 100_000 + i * PERIOD_US)));
        assert_eq!(later.len(), 1, "the run starts at the reading after the last gap");
        assert_eq!(later[0].time, WrappingMillis::new(143));
    }

    #[test]
    fn a_step_of_40_ms_is_averaged_over_and_a_longer_one_is_not() {
        let with_step =
            |step_us: u64| samples((0..8).map(|i| i * PERIOD_US + if i > 3 { step_us - PERIOD_US } else { 0 }));
        assert_eq!(with_step(40_000).len(), 1);
        assert!(with_step(40_001).is_empty());
    }
}

//! Averages consecutive readings to one sample.

use nalgebra::Vector3;

use crate::attitude::{EulerRates, GyroHeading};
use crate::calibration::{AngleRates, Sample};
use crate::frames::{Body, Field, RollPitch, Sensor, wrap_pi};
use crate::time::Timestamp;
use crate::trig;

/// Corrected field of a reading, and the gyro heading at its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CorrectedReading {
    pub field: Field<Body>,
    pub gyro_heading: GyroHeading,
}

/// Mean of a run of readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct AveragedSample {
    /// Means of the raw field and of the attitude: of a fast rotation, about one instant.
    pub sample: Sample,
    /// Mean of the corrected fields as measured at the sample's attitude and at the mean gyro heading: exactly one instant. `None` if a
    /// reading has no gyro heading, or one of another run.
    pub corrected: Option<CorrectedReading>,
    /// Rates at the last reading, by which the attitude of a late source has gone on since the sample; zero without a gyro heading.
    pub latest_rates: EulerRates,
}

/// Averages gapless runs of readings, and their attitudes and gyro headings, so that all refer to the same time.
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
    gyro_sums: Option<GyroSums>,
}

#[derive(Clone, Copy, Debug)]
struct GyroSums {
    run_number: u8,
    first_heading_rad: f32,
    /// Sum of the headings relative to the first one, radians.
    relative_heading_sum_rad: f32,
    /// Sums of the rates of roll, pitch and heading, rad/s.
    rate_sums_rad_s: [f32; 3],
    latest_rates: EulerRates,
    /// Sum of the corrected fields in the level frame, turned back to the first heading.
    field_sum_ut: Vector3<f32>,
}

impl GyroSums {
    fn before(first: &CorrectedReading) -> Self {
        Self {
            run_number: first.gyro_heading.run_number,
            first_heading_rad: first.gyro_heading.relative_heading_rad,
            relative_heading_sum_rad: 0.0,
            rate_sums_rad_s: [0.0; 3],
            latest_rates: first.gyro_heading.euler_rates,
            field_sum_ut: Vector3::zeros(),
        }
    }

    fn with_reading(self, attitude: RollPitch, added: &CorrectedReading) -> Option<Self> {
        let GyroHeading { euler_rates, relative_heading_rad, run_number } = added.gyro_heading;
        let EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s } = euler_rates;
        let [roll, pitch, heading] = self.rate_sums_rad_s;
        let turned_rad = wrap_pi(relative_heading_rad - self.first_heading_rad);
        (run_number == self.run_number).then(|| Self {
            relative_heading_sum_rad: self.relative_heading_sum_rad + turned_rad,
            rate_sums_rad_s: [roll + roll_rad_s, pitch + pitch_rad_s, heading + heading_rad_s],
            latest_rates: euler_rates,
            field_sum_ut: self.field_sum_ut + turned(attitude.to_level_frame(added.field).ut, turned_rad),
            ..self
        })
    }

    fn mean(self, count: f32, attitude: RollPitch) -> CorrectedReading {
        let [roll_rad_s, pitch_rad_s, heading_rad_s] = self.rate_sums_rad_s.map(|sum| sum / count);
        let turned_rad = self.relative_heading_sum_rad / count;
        CorrectedReading {
            field: attitude.to_body_frame(Field::new(turned(self.field_sum_ut / count, -turned_rad))),
            gyro_heading: GyroHeading {
                euler_rates: EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s },
                relative_heading_rad: wrap_pi(self.first_heading_rad + turned_rad),
                run_number: self.run_number,
            },
        }
    }
}

/// A level vector turned about the vertical, clockwise from above.
fn turned(level: Vector3<f32>, angle_rad: f32) -> Vector3<f32> {
    let (sin, cos) = trig::sin_cos(angle_rad);
    Vector3::new(cos * level.x - sin * level.y, sin * level.x + cos * level.y, level.z)
}

impl Averager {
    pub const fn new(readings_per_sample: u16, max_step_us: u64) -> Self {
        Self { readings_per_sample, max_step_us, averaging_run: None }
    }

    pub fn reset(&mut self) {
        self.averaging_run = None;
    }

    /// Adds a reading with the attitude at its time, and its corrected field if a gyro heading is known; returns the mean at the end of a
    /// run.
    pub fn push_reading(
        &mut self,
        at: Timestamp,
        field: Field<Sensor>,
        attitude: RollPitch,
        corrected: Option<CorrectedReading>,
    ) -> Option<AveragedSample> {
        let continues_run = |run: &AveragingRun| at >= run.last_at && at.us_since(run.last_at) <= self.max_step_us;
        let mut run = self
            .averaging_run
            .take()
            .filter(continues_run)
            .unwrap_or_else(|| AveragingRun::new_at(at, attitude, corrected.as_ref()));
        run.reading_count += 1;
        run.last_at = at;
        run.field_sum_ut += field.ut;
        run.relative_roll_sum_rad += wrap_pi(attitude.roll_rad - run.first_roll_rad);
        run.pitch_sum_rad += attitude.pitch_rad;
        run.gyro_sums = run.gyro_sums.zip(corrected).and_then(|(sums, added)| sums.with_reading(attitude, &added));
        if run.reading_count >= self.readings_per_sample {
            return Some(run.mean_sample());
        }
        self.averaging_run = Some(run);
        None
    }
}

impl AveragingRun {
    fn new_at(at: Timestamp, attitude: RollPitch, first: Option<&CorrectedReading>) -> Self {
        Self {
            reading_count: 0,
            first_at: at,
            last_at: at,
            field_sum_ut: Vector3::zeros(),
            first_roll_rad: attitude.roll_rad,
            relative_roll_sum_rad: 0.0,
            pitch_sum_rad: 0.0,
            gyro_sums: first.map(GyroSums::before),
        }
    }

    fn mean_sample(&self) -> AveragedSample {
        let count = f32::from(self.reading_count);
        let middle = self.first_at.plus_us(self.last_at.us_since(self.first_at) / 2);
        let attitude = RollPitch {
            roll_rad: wrap_pi(self.first_roll_rad + self.relative_roll_sum_rad / count),
            pitch_rad: self.pitch_sum_rad / count,
        };
        let corrected = self.gyro_sums.map(|sums| sums.mean(count, attitude));
        let rates = corrected.map_or(AngleRates::UNKNOWN, |corrected| {
            let EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s } = corrected.gyro_heading.euler_rates;
            AngleRates::from_rad_s([roll_rad_s, pitch_rad_s, heading_rad_s])
        });
        let time = middle.wrapping_millis();
        let sample = Sample { rates, time, ..Sample::new(Field::new(self.field_sum_ut / count), attitude) };
        let latest_rates = self.gyro_sums.map_or_else(EulerRates::default, |sums| sums.latest_rates);
        AveragedSample { sample, corrected, latest_rates }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::WrappingMillis;
    use crate::trig::VectorLength as _;

    /// 80 Hz: eight readings per sample; the longest step is 3.2 periods.
    const PERIOD_US: u64 = 12_500;

    fn averager() -> Averager {
        Averager::new(8, 40_000)
    }

    /// Two samples of a module that turns at 2 rad/s and more, through 180 deg, in a field that stands still; of these readings.
    fn averaged_turn(run_number_at: fn(u16) -> u8) -> Vec<AveragedSample> {
        let mut averager = averager();
        let mut push = |i: u16| {
            let x = f32::from(i);
            let (attitude, heading_rad) = (RollPitch::from_deg(x, -x), x / 10.0 + 2.0);
            let corrected = CorrectedReading {
                field: attitude.to_body_frame(Field::earth_field(50.0, 1.0, heading_rad)),
                gyro_heading: GyroHeading {
                    euler_rates: EulerRates { roll_rad_s: x / 10.0, pitch_rad_s: -x / 5.0, heading_rad_s: 2.0 },
                    relative_heading_rad: wrap_pi(heading_rad),
                    run_number: run_number_at(i),
                },
            };
            let at = Timestamp::from_us(u64::from(i) * PERIOD_US);
            averager.push_reading(at, Field::from_ut(x, 0.0, -x), attitude, Some(corrected))
        };
        (0..16).filter_map(&mut push).collect()
    }

    #[test]
    fn averages_field_attitude_and_time_of_a_run() {
        let samples = averaged_turn(|_| 3);
        assert_eq!(samples.len(), 2);
        let AveragedSample { sample, corrected, latest_rates } = samples[1];
        assert_eq!(sample.field, Field::from_ut(11.5, 0.0, -11.5));
        assert!((sample.attitude.roll_rad.to_degrees() - 11.5).abs() < 1e-4);
        assert!((sample.attitude.pitch_rad.to_degrees() + 11.5).abs() < 1e-4);
        assert_eq!(sample.rates, AngleRates::from_rad_s([1.15, -2.3, 2.0]));
        assert_eq!(sample.time, WrappingMillis::new(143));
        let CorrectedReading { field, gyro_heading } = corrected.unwrap();
        assert!((gyro_heading.relative_heading_rad - wrap_pi(3.15)).abs() < 1e-5, "{gyro_heading:?}");
        assert_eq!((gyro_heading.run_number, latest_rates.roll_rad_s), (3, 1.5));
        // No shorter than each reading, and of the mean heading.
        let level = sample.attitude.to_level_frame(field);
        assert!((level.ut - Field::earth_field(50.0, 1.0, 3.15).ut).vector_length() < 1e-3, "{level:?}");
    }

    #[test]
    fn readings_of_two_gyro_runs_have_no_mean_gyro_heading() {
        let samples = averaged_turn(|i| u8::from(i >= 12));
        assert_eq!([&samples[0], &samples[1]].map(|averaged| averaged.corrected.is_some()), [true, false]);
        assert!(!samples[1].sample.rates.is_known());
    }

    fn averaged_samples(instants_us: impl IntoIterator<Item = u64>) -> Vec<AveragedSample> {
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
        assert_eq!(later[0].sample.time, WrappingMillis::new(143));
    }
}

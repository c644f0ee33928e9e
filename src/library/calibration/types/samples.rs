//! Samples of a flight in order of time, each with the part of the flight to which it belongs.

use core::array;
use core::fmt::Debug;

use crate::frames::{Field, RollPitch, Sensor, wrap_pi};
use crate::time::WrappingMillis;

/// A field measurement with the attitude at its time: the input of calibration. 36 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Raw field, chip axes, microtesla.
    pub field: Field<Sensor>,
    /// Attitude interpolated to the time of the measurement.
    pub attitude: RollPitch,
    /// Rates of the attitude angles.
    pub rates: AngleRates,
    /// Motor current during the sample.
    pub current: MotorCurrent,
    /// Time of the measurement. Only order and differences within one turn are used.
    pub time: WrappingMillis,
    /// Part of the collection; [`CollectionPart::FREE`] before its assignment.
    pub part: CollectionPart,
}

impl Sample {
    /// Sample at time 0 without rates, current and part.
    #[must_use]
    pub const fn new(field: Field<Sensor>, attitude: RollPitch) -> Self {
        Self {
            field,
            attitude,
            rates: AngleRates::UNKNOWN,
            current: MotorCurrent::UNKNOWN,
            time: WrappingMillis::new(0),
            part: CollectionPart::FREE,
        }
    }

    /// Attitude extrapolated by `latency_s` seconds along its rates: compensates an attitude source that lags by that
    /// time.
    #[must_use]
    #[inline]
    pub fn latency_compensated_attitude(&self, latency_s: f32) -> RollPitch {
        let RollPitch { roll_rad, pitch_rad } = self.attitude;
        RollPitch {
            roll_rad: wrap_pi(roll_rad + latency_s * self.rates.roll_rad_s()),
            pitch_rad: pitch_rad + latency_s * self.rates.pitch_rad_s(),
        }
    }
}

/// Part of a collection: a number, not an enum, because samples lie in memory that is arbitrary at power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectionPart(u32);

impl CollectionPart {
    /// Left turns: left wing down, heading decreasing.
    pub const LEFT: Self = Self(0);
    /// Right turns: right wing down, heading increasing.
    pub const RIGHT: Self = Self(1);
    /// Small bank, all headings.
    pub const LEVEL: Self = Self(2);
    /// Arbitrary attitudes, not assigned to a turn.
    pub const FREE: Self = Self(3);
    /// Samples with given headings, which are stored apart.
    pub const MARKS: Self = Self(4);

    /// The parts of the samples without given headings.
    pub const ALL_PARTS: [Self; 4] = [Self::LEFT, Self::RIGHT, Self::LEVEL, Self::FREE];

    /// Turns to either side.
    pub const TURNS: [Self; 2] = [Self::LEFT, Self::RIGHT];

    /// English name of the part, plural.
    #[must_use]
    pub const fn part_name(self) -> &'static str {
        match self {
            Self::LEFT => "left turns",
            Self::RIGHT => "right turns",
            Self::LEVEL => "level headings",
            Self::MARKS => "marks",
            _ => "all attitudes",
        }
    }

    /// Position in [`CollectionPart::ALL_PARTS`]; marks and unknown numbers are of arbitrary attitude.
    pub(crate) const fn index(self) -> usize {
        match self.0 {
            0 => 0,
            1 => 1,
            2 => 2,
            _ => 3,
        }
    }

    pub(crate) const fn part_number(self) -> u32 {
        self.0
    }

    pub(crate) const fn from_number(number: u32) -> Self {
        Self(number)
    }
}

/// Number of parts of a collection.
pub(in crate::calibration) const PART_COUNT: usize = CollectionPart::ALL_PARTS.len();

/// View of samples in order of time, and of marks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples<'a> {
    in_time_order: &'a [Sample],
    /// Whether the view leaves a part out, by [`CollectionPart::index`].
    is_part_excluded: [bool; PART_COUNT],
    /// Samples with a given heading.
    pub marks: &'a [HeadingMark],
}

/// A sample with a known heading (compass swing). 40 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingMark {
    /// Sample at the mark.
    pub sample: Sample,
    /// Magnetic heading, radians.
    pub heading_rad: f32,
}

impl<'a> Samples<'a> {
    /// View of samples in order of time.
    #[must_use]
    pub const fn new(in_time_order: &'a [Sample]) -> Self {
        Self { in_time_order, is_part_excluded: [false; _], marks: &[] }
    }

    /// The same samples with other compass-swing marks.
    #[must_use]
    pub const fn with_marks(mut self, marks: &'a [HeadingMark]) -> Self {
        self.marks = marks;
        self
    }

    /// The samples without those of `part`.
    #[must_use]
    pub fn without_part(mut self, part: CollectionPart) -> Self {
        self.is_part_excluded[part.index()] = true;
        self
    }

    /// The samples of the parts that another view has, too.
    #[must_use]
    pub const fn with_parts_of(mut self, other: Samples<'_>) -> Self {
        self.is_part_excluded = other.is_part_excluded;
        self
    }

    /// The samples of a part alone, without marks.
    #[must_use]
    pub fn samples_of_part(self, part: CollectionPart) -> Self {
        let is_part_excluded = array::from_fn(|index| index != part.index() || self.is_part_excluded[index]);
        Self { is_part_excluded, marks: &[], ..self }
    }

    /// Iterates over the samples without a given heading, in order of time.
    pub fn iter(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        let is_part_excluded = self.is_part_excluded;
        self.in_time_order.iter().filter(move |sample| !is_part_excluded[sample.part.index()])
    }

    /// Iterates over all samples, those with given headings last.
    pub fn all_samples(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        self.iter().chain(self.marks.iter().map(|mark| &mark.sample))
    }

    pub(crate) fn has_free_flight_samples(&self) -> bool {
        self.samples_of_part(CollectionPart::FREE).iter().next().is_some()
    }
}

/// Time from the first to the last sample of a flight.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct TimeSpan {
    pub start: WrappingMillis,
    /// Positive.
    pub duration_ms: u32,
}

impl TimeSpan {
    /// `None` if all samples have the same time.
    pub fn from_samples(samples: Samples<'_>) -> Option<Self> {
        let start = samples.iter().next()?.time;
        let duration_ms = samples.iter().last()?.time.ms_since(start);
        (duration_ms > 0).then_some(Self { start, duration_ms })
    }

    /// Elapsed fraction of the time.
    pub fn elapsed_fraction(self, time: WrappingMillis) -> f32 {
        time.ms_since(self.start) as f32 / self.duration_ms as f32
    }
}

const STEPS_PER_RAD_S: f32 = 1024.0;

/// Rates of roll, pitch and heading, 1/1024 rad/s, up to 32 rad/s. A step changes the attitude by 0.006 deg in 0.1 s.
///
/// Unknown rates read as zero, because like rest they determine neither an attitude latency nor a direction of turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AngleRates([i16; 3]);

impl AngleRates {
    /// The source has no rates.
    pub const UNKNOWN: Self = Self([i16::MIN; 3]);

    /// Rates of roll, pitch and heading, rad/s, saturated at 32. NaN is 0.
    #[must_use]
    pub fn from_rad_s(rad_s: [f32; 3]) -> Self {
        Self(rad_s.map(|rate_rad_s| round_to_steps(rate_rad_s * STEPS_PER_RAD_S).max(-i16::MAX)))
    }

    /// Whether the source has rates.
    #[must_use]
    pub fn is_known(self) -> bool {
        self != Self::UNKNOWN
    }

    /// Roll rate, rad/s; 0 if unknown.
    #[must_use]
    pub fn roll_rad_s(self) -> f32 {
        self.rate_rad_s(0)
    }

    /// Pitch rate, rad/s; 0 if unknown.
    #[must_use]
    pub fn pitch_rad_s(self) -> f32 {
        self.rate_rad_s(1)
    }

    /// Heading rate, rad/s; 0 if unknown.
    #[must_use]
    pub fn heading_rad_s(self) -> f32 {
        self.rate_rad_s(2)
    }

    fn rate_rad_s(self, axis: usize) -> f32 {
        if self.is_known() { f32::from(self.0[axis]) / STEPS_PER_RAD_S } else { 0.0 }
    }

    pub(crate) const fn quantised_mut(&mut self) -> &mut [i16; 3] {
        &mut self.0
    }
}

const STEPS_PER_A: f32 = 64.0;

/// Motor current, 1/64 A, up to 512 A; -1 if unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorCurrent(i16);

impl MotorCurrent {
    /// No current is reported.
    pub const UNKNOWN: Self = Self(-1);

    /// A current in amperes: 0 if negative (charging), saturated at 512, unknown if `None` or NaN.
    #[must_use]
    pub fn from_a(current_a: Option<f32>) -> Self {
        let known = current_a.filter(|amperes| !amperes.is_nan());
        known.map_or(Self::UNKNOWN, |amperes| Self(round_to_steps(amperes.max(0.0) * STEPS_PER_A)))
    }

    /// The current in amperes, if known.
    #[must_use]
    pub fn amperes(self) -> Option<f32> {
        (self.0 >= 0).then(|| f32::from(self.0) / STEPS_PER_A)
    }

    pub(crate) const fn quantised_mut(&mut self) -> &mut i16 {
        &mut self.0
    }
}

/// Rounds to the nearest whole number. The cast saturates and maps NaN to 0.
fn round_to_steps(steps: f32) -> i16 {
    libm::roundf(steps) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::Parts;

    /// Two samples of each part in turn, and a mark; their times are 1 to 9 ms.
    fn test_samples() -> Samples<'static> {
        let sample = |time_ms| Sample {
            time: WrappingMillis::new(time_ms),
            ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), RollPitch::default())
        };
        let [left, right, level, free] = [[1, 5], [2, 6], [3, 7], [4, 8]].map(|times| times.map(sample));
        let marks = [HeadingMark { sample: sample(9), heading_rad: 0.0 }];
        Parts { left: &left, right: &right, level: &level, free: &free, marks: &marks }.samples()
    }

    fn times_ms<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> Vec<u32> {
        samples.into_iter().map(|sample| sample.time.as_ms()).collect()
    }

    #[test]
    fn samples_are_iterated_by_time_and_marks_last() {
        assert_eq!(times_ms(test_samples().iter()), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(times_ms(test_samples().all_samples()), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        let times_of_part = |part| times_ms(test_samples().samples_of_part(part).all_samples());
        assert_eq!(CollectionPart::ALL_PARTS.map(times_of_part), [[1, 5], [2, 6], [3, 7], [4, 8]]);
        assert_eq!(times_ms(Samples::default().all_samples()), []);
        assert!(test_samples().has_free_flight_samples() && !Samples::default().has_free_flight_samples());
    }

    #[test]
    fn excluded_parts_are_left_out() {
        for excluded in 0..16_u32 {
            let is_part_excluded = |part: CollectionPart| excluded >> part.index() & 1 == 1;
            let view = CollectionPart::ALL_PARTS
                .into_iter()
                .filter(|part| is_part_excluded(*part))
                .fold(test_samples(), Samples::without_part);
            let expected = (1..9)
                .filter(|time_ms| !is_part_excluded(CollectionPart::ALL_PARTS[(time_ms - 1) % 4]))
                .map(|t| t as u32);
            assert_eq!(times_ms(view.iter()), expected.collect::<Vec<_>>(), "{excluded}");
            for part in CollectionPart::ALL_PARTS {
                assert_eq!(view.samples_of_part(part).iter().count(), if is_part_excluded(part) { 0 } else { 2 });
            }
            assert_eq!(view.iter().count() + 1, view.all_samples().count());
            assert_eq!(times_ms(test_samples().with_parts_of(view).iter()), times_ms(view.iter()));
        }
    }

    #[test]
    fn unknown_parts_are_of_arbitrary_attitude() {
        assert_eq!(CollectionPart::ALL_PARTS.map(CollectionPart::index), [0, 1, 2, 3]);
        assert_eq!([4, 0xFF, u32::MAX].map(|number| CollectionPart::from_number(number).index()), [3; 3]);
    }
}

#[cfg(test)]
mod rates_tests {
    use super::*;

    fn round_trip_rad_s(rad_s: [f32; 3]) -> [f32; 3] {
        let rates = AngleRates::from_rad_s(rad_s);
        [rates.roll_rad_s(), rates.pitch_rad_s(), rates.heading_rad_s()]
    }

    #[test]
    fn rates_round_trip_within_half_a_step() {
        for rad_s in [
            [0.0; 3],
            [0.1234, -0.5678, 0.3],
            [-2.5, 2.001, -1.5],
            [31.9, -31.9, 31.9],
            [-0.001, 0.0, -0.003],
            [0.0, -0.001, 0.003],
        ] {
            for (stored, given) in round_trip_rad_s(rad_s).iter().zip(rad_s) {
                assert!((stored - given).abs() <= 0.000_489, "{rad_s:?} {stored}");
            }
        }
    }

    #[test]
    fn fast_rates_saturate_and_nan_rates_are_zero() {
        for fast in [40.0, f32::INFINITY] {
            let [roll, pitch, heading] = round_trip_rad_s([fast, -fast, fast]);
            assert!((roll - 32.0).abs() < 1e-3 && (pitch + 32.0).abs() < 1e-3 && (heading - 32.0).abs() < 1e-3);
        }
        assert_eq!(AngleRates::from_rad_s([f32::NAN; 3]), AngleRates::from_rad_s([0.0; 3]));
    }

    #[test]
    fn unknown_rates_differ_from_all_others_and_read_as_zero() {
        for rad_s in [[0.0; 3], [f32::NEG_INFINITY; 3], [f32::NAN; 3]] {
            assert!(AngleRates::from_rad_s(rad_s).is_known(), "{rad_s:?}");
        }
        let unknown = AngleRates::UNKNOWN;
        let read_rad_s = [unknown.roll_rad_s(), unknown.pitch_rad_s(), unknown.heading_rad_s()];
        assert_eq!((unknown.is_known(), read_rad_s.map(f32::to_bits)), (false, [0; 3]));
    }

    /// An unknown current differs from 0 A.
    #[test]
    fn currents_round_trip_within_half_a_step() {
        assert_eq!(MotorCurrent::UNKNOWN.amperes(), None);
        assert_eq!(MotorCurrent::from_a(None), MotorCurrent::UNKNOWN);
        for given in [0.0, 0.01, 0.5, 1.0, 10.0, 47.0, 200.0, 511.0] {
            let stored = MotorCurrent::from_a(Some(given)).amperes().unwrap();
            assert!((stored - given).abs() <= 0.5 / 64.0, "{given} {stored}");
        }
        assert_eq!(MotorCurrent::from_a(Some(-5.0)).amperes(), Some(0.0));
        for much in [512.0, 1e9, f32::INFINITY] {
            assert_eq!(MotorCurrent::from_a(Some(much)).amperes(), Some(511.984_38), "{much}");
        }
        assert_eq!(MotorCurrent::from_a(Some(f32::NAN)), MotorCurrent::UNKNOWN);
    }
}

//! Samples of a flight, and their parts.

use core::fmt::Debug;

use super::rates::{AngleRates, MotorCurrent};
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

/// Direction of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Side {
    /// Left wing down, heading decreasing.
    Left,
    /// Right wing down, heading increasing.
    Right,
}

impl Side {
    /// English name of the side, lower case.
    #[must_use]
    pub const fn side_name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Part of a collection: a number, not an enum, because samples lie in memory that is arbitrary at power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct CollectionPart(u32);

impl CollectionPart {
    /// Left turns.
    pub const LEFT: Self = Self(0);
    /// Right turns.
    pub const RIGHT: Self = Self(1);
    /// Small bank, all headings.
    pub const LEVEL: Self = Self(2);
    /// Arbitrary attitudes, not assigned to a turn.
    pub const FREE: Self = Self(3);

    /// All parts, in the order in which the sample buffer stores them.
    pub const ALL_PARTS: [Self; 4] = [Self::LEFT, Self::RIGHT, Self::LEVEL, Self::FREE];

    /// Part that contains the turns to one side.
    #[must_use]
    pub const fn from_turn_side(side: Side) -> Self {
        match side {
            Side::Left => Self::LEFT,
            Side::Right => Self::RIGHT,
        }
    }

    /// Position in [`CollectionPart::ALL_PARTS`]; unknown numbers are of arbitrary attitude.
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

/// View of samples that are ordered by part, then time, and of marks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples<'a> {
    ordered_by_part: &'a [Sample],
    /// Whether the view leaves a part out, by [`CollectionPart::index`].
    is_part_excluded: [bool; CollectionPart::ALL_PARTS.len()],
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

/// A part of the [`Samples`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplePart {
    /// Samples of the turns to one side.
    Turns(Side),
    /// Level flight.
    Level,
    /// Samples with given headings.
    Marks,
    /// All parts.
    All,
}

impl SamplePart {
    /// English name of the part, plural.
    #[must_use]
    pub const fn part_name(self) -> &'static str {
        match self {
            Self::Turns(Side::Left) => "left turns",
            Self::Turns(Side::Right) => "right turns",
            Self::Level => "level headings",
            Self::Marks => "marks",
            Self::All => "all attitudes",
        }
    }
}

impl<'a> Samples<'a> {
    /// View of samples ordered by part, then time.
    #[must_use]
    pub const fn new(ordered_by_part: &'a [Sample]) -> Self {
        Self { ordered_by_part, is_part_excluded: [false; _], marks: &[] }
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

    /// Samples of a part, in order of time.
    #[must_use]
    pub fn samples_of_part(&self, part: CollectionPart) -> &'a [Sample] {
        if self.is_part_excluded[part.index()] { &[] } else { samples_of_part(self.ordered_by_part, part) }
    }

    /// Samples of the turns of a side, in order of time.
    #[must_use]
    pub fn samples_of_turn(&self, side: Side) -> &'a [Sample] {
        self.samples_of_part(CollectionPart::from_turn_side(side))
    }

    /// Iterates over the samples without a given heading, by part, then time.
    pub fn iter(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        IncludedSamples {
            current_run: [].iter(),
            remaining: self.ordered_by_part,
            is_part_excluded: self.is_part_excluded,
        }
    }

    /// Iterates over all samples, those with given headings last.
    pub fn all_samples(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        self.iter().chain(self.marks.iter().map(|mark| &mark.sample))
    }

    pub(crate) fn has_free_flight_samples(&self) -> bool {
        !self.samples_of_part(CollectionPart::FREE).is_empty()
    }
}

/// Samples of one part, if all are ordered by part.
pub(crate) fn samples_of_part(ordered_by_part: &[Sample], part: CollectionPart) -> &[Sample] {
    let [start, end] = part_range(ordered_by_part, part);
    ordered_by_part.get(start..end).unwrap_or_default()
}

/// First and last position (exclusive) of a part, of samples ordered by part.
pub(crate) fn part_range(ordered_by_part: &[Sample], part: CollectionPart) -> [usize; 2] {
    [
        ordered_by_part.partition_point(|sample| sample.part < part),
        ordered_by_part.partition_point(|sample| sample.part <= part),
    ]
}

/// Iterator over the samples of included parts: a test of the part for each sample would be slower, and compiled into
/// every loop.
#[derive(Clone, Debug)]
struct IncludedSamples<'a> {
    current_run: core::slice::Iter<'a, Sample>,
    remaining: &'a [Sample],
    is_part_excluded: [bool; CollectionPart::ALL_PARTS.len()],
}

impl<'a> IncludedSamples<'a> {
    #[inline(never)]
    fn start_next_run(&mut self) -> Option<&'a Sample> {
        let is_part_excluded = |sample: &Sample| self.is_part_excluded[sample.part.index()];
        let start = self.remaining.iter().position(|sample| !is_part_excluded(sample))?;
        let included = self.remaining.get(start..).unwrap_or_default();
        let length = included.iter().position(is_part_excluded).unwrap_or(included.len());
        let (run, remaining) = included.split_at_checked(length)?;
        (self.current_run, self.remaining) = (run.iter(), remaining);
        self.current_run.next()
    }
}

impl<'a> Iterator for IncludedSamples<'a> {
    type Item = &'a Sample;

    fn next(&mut self) -> Option<Self::Item> {
        match self.current_run.next() {
            Some(sample) => Some(sample),
            None => self.start_next_run(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::Parts;

    /// Two samples of each part, and a mark; their times are 1 to 9 ms.
    fn test_samples() -> Samples<'static> {
        let sample = |time_ms| Sample {
            time: WrappingMillis::new(time_ms),
            ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), RollPitch::default())
        };
        let [left, right, level, free] = [[1, 2], [3, 4], [5, 6], [7, 8]].map(|times| times.map(sample));
        let marks = [HeadingMark { sample: sample(9), heading_rad: 0.0 }];
        Parts { left: &left, right: &right, level: &level, free: &free, marks: &marks }.samples()
    }

    fn times_ms<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> Vec<u32> {
        samples.into_iter().map(|sample| sample.time.as_ms()).collect()
    }

    #[test]
    fn samples_are_iterated_by_part_and_marks_last() {
        assert_eq!(times_ms(test_samples().iter()), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(times_ms(test_samples().all_samples()), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        let times_of_part = |part| times_ms(test_samples().samples_of_part(part));
        assert_eq!(CollectionPart::ALL_PARTS.map(times_of_part), [[1, 2], [3, 4], [5, 6], [7, 8]]);
        let times_of_turn = |side| times_ms(test_samples().samples_of_turn(side));
        assert_eq!([Side::Left, Side::Right].map(times_of_turn), [[1, 2], [3, 4]]);
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
            let included = || CollectionPart::ALL_PARTS.into_iter().filter(|part| !is_part_excluded(*part));
            let expected = times_ms(included().flat_map(|part| test_samples().samples_of_part(part)));
            assert_eq!(times_ms(view.iter()), expected, "{excluded}");
            assert_eq!(times_ms(included().flat_map(|part| view.samples_of_part(part))), expected, "{excluded}");
            assert_eq!(view.iter().count() + 1, view.all_samples().count());
        }
    }

    #[test]
    fn unknown_parts_are_of_arbitrary_attitude() {
        assert_eq!(CollectionPart::ALL_PARTS.map(CollectionPart::index), [0, 1, 2, 3]);
        assert_eq!([4, 0xFF, u32::MAX].map(|number| CollectionPart::from_number(number).index()), [3; 3]);
        assert!(CollectionPart::ALL_PARTS.is_sorted());
    }
}

//! Values in retained memory as words: for the checksum, and to simulate memory contents.

use crate::calibration::{AngleRates, CollectionPart, HeadingMark, MotorCurrent, Sample};
use crate::frames::{Field, RollPitch, Sensor};
use crate::time::WrappingMillis;

/// A value for which every bit pattern is valid.
pub(in crate::collection) trait MemoryWords {
    /// Visits the value as words, which the visitor may change.
    fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32));
}

/// Implements [`MemoryWords`] for a number, by its conversions to and from `u32`, or for a structure, by its fields.
macro_rules! words {
    ($type:ty, $to:expr, $from:expr) => {
        impl MemoryWords for $type {
            fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
                let mut word = $to(*self);
                visit(&mut word);
                *self = $from(word);
            }
        }
    };
    ($type:ty { $($field:ident),* $(,)? }) => {
        impl MemoryWords for $type {
            fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
                let Self { $($field),* } = self;
                $($field.visit_words(visit);)*
            }
        }
    };
}
pub(super) use words;

words!(u32, core::convert::identity, core::convert::identity);
words!(u16, u32::from, |word| word as Self);
words!(i16, |number: Self| u32::from(number.cast_unsigned()), |word| (word as u16).cast_signed());
words!(u8, u32::from, |word| word as Self);
words!(f32, f32::to_bits, f32::from_bits);
words!(WrappingMillis, Self::as_ms, Self::new);
words!(CollectionPart, Self::part_number, Self::from_number);
words!(RollPitch { roll_rad, pitch_rad });
words!(Sample { field, attitude, rates, current, time, part });
words!(HeadingMark { sample, heading_rad });

impl MemoryWords for AngleRates {
    fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
        self.quantised_mut().visit_words(visit);
    }
}

impl MemoryWords for MotorCurrent {
    fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
        self.quantised_mut().visit_words(visit);
    }
}

impl MemoryWords for Field<Sensor> {
    fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
        self.ut.iter_mut().for_each(|component| component.visit_words(visit));
    }
}

impl<T: MemoryWords, const N: usize> MemoryWords for [T; N] {
    fn visit_words(&mut self, visit: &mut impl FnMut(&mut u32)) {
        for value in self {
            value.visit_words(visit);
        }
    }
}

/// Order-dependent checksum. Each step is invertible, so any change of a single word changes it; other content collides
/// at a rate of 2^-32. FNV (Fowler, Noll, Vo) with a rotation that feeds high bits into low ones.
pub(super) struct Checksum(pub u32);

impl Checksum {
    pub const fn add_word(&mut self, word: u32) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9E37_79B9);
    }

    pub fn add_words(&mut self, value: &(impl MemoryWords + Clone)) {
        value.clone().visit_words(&mut |word| self.add_word(*word));
    }
}

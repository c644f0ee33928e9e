//! Fields of a message: little-endian numbers, and arrays of them.

use mavlink_core::types::CharArray;

/// Type of a message's field.
pub trait MessageField: Copy {
    /// Length, bytes.
    const LENGTH: usize;
    /// Value of a field that is not sent.
    const ZERO: Self;

    /// Writes the field at the start of `bytes` and returns the rest; nothing if they are too few.
    fn write(self, bytes: &mut [u8]) -> &mut [u8];

    /// Reads the field at the start of `bytes`, and the rest; zero if they are too few.
    fn read(bytes: &[u8]) -> (Self, &[u8]);

    /// The field of the numbers by index, of which an array and a text have several.
    fn from_numbers(number_at: &mut dyn FnMut(usize) -> f64) -> Self;
}

macro_rules! number_fields {
    ($($number:ty = $zero:literal),*) => {
        $(
            impl MessageField for $number {
                const LENGTH: usize = size_of::<Self>();
                const ZERO: Self = $zero;

                fn write(self, bytes: &mut [u8]) -> &mut [u8] {
                    match bytes.split_first_chunk_mut() {
                        Some((field, rest)) => {
                            *field = self.to_le_bytes();
                            rest
                        }
                        None => &mut [],
                    }
                }

                fn read(bytes: &[u8]) -> (Self, &[u8]) {
                    match bytes.split_first_chunk() {
                        Some((field, rest)) => (Self::from_le_bytes(*field), rest),
                        None => (Self::ZERO, &[]),
                    }
                }

                fn from_numbers(number_at: &mut dyn FnMut(usize) -> f64) -> Self {
                    number_at(0) as Self
                }
            }
        )*
    };
}

number_fields!(u8 = 0, i8 = 0, u16 = 0, i16 = 0, u32 = 0, i32 = 0, u64 = 0, i64 = 0, f32 = 0.0, f64 = 0.0);

impl<F: MessageField, const COUNT: usize> MessageField for [F; COUNT] {
    const LENGTH: usize = COUNT * F::LENGTH;
    const ZERO: Self = [F::ZERO; COUNT];

    fn write(self, bytes: &mut [u8]) -> &mut [u8] {
        self.into_iter().fold(bytes, |rest, element| element.write(rest))
    }

    fn read(bytes: &[u8]) -> (Self, &[u8]) {
        let (mut elements, mut rest) = (Self::ZERO, bytes);
        for element in &mut elements {
            (*element, rest) = F::read(rest);
        }
        (elements, rest)
    }

    fn from_numbers(number_at: &mut dyn FnMut(usize) -> f64) -> Self {
        core::array::from_fn(|index| F::from_numbers(&mut |_| number_at(index)))
    }
}

impl<const COUNT: usize> MessageField for CharArray<COUNT> {
    const LENGTH: usize = COUNT;
    const ZERO: Self = Self::new([0; COUNT]);

    fn write(self, bytes: &mut [u8]) -> &mut [u8] {
        <[u8; COUNT]>::from(self).write(bytes)
    }

    fn read(bytes: &[u8]) -> (Self, &[u8]) {
        let (characters, rest) = <[u8; COUNT]>::read(bytes);
        (characters.into(), rest)
    }

    fn from_numbers(number_at: &mut dyn FnMut(usize) -> f64) -> Self {
        <[u8; COUNT]>::from_numbers(number_at).into()
    }
}

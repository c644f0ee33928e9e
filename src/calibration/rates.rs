//! How fast the attitude of a sample changes.

/// Rates of roll, pitch and heading, as a sample keeps them: 12 bits each of roll and pitch, in steps of 1/500 rad/s, and
/// 8 bits of heading, in steps of 1/50 rad/s. Roll and pitch tell how late the attitude is, heading only which way the
/// vehicle turns. 4 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates(u32);

/// A rate in some bits of the word.
struct Bits {
    first: u32,
    number: u32,
    /// Steps in a radian a second.
    steps: f32,
}

/// A step turns the attitude by 0.01 deg in a tenth of a second.
const ROLL: Bits = Bits { first: 20, number: 12, steps: 500.0 };
const PITCH: Bits = Bits { first: 8, number: 12, steps: 500.0 };
/// A step turns the heading by a degree in a second.
const HEADING: Bits = Bits { first: 0, number: 8, steps: 50.0 };

impl Bits {
    /// The nearest to a rate; the largest or least there is for one beyond, nothing for what is not a number.
    fn of(&self, rad_s: f32) -> u32 {
        let most = (1 << (self.number - 1)) - 1;
        // The cast saturates, and takes what is no number to nothing.
        let steps = (libm::roundf(rad_s * self.steps) as i32).clamp(-most, most);
        (steps as u32 & ((1 << self.number) - 1)) << self.first
    }

    fn rad_s(&self, word: u32) -> f32 {
        // Up to the sign's bit, and down again with it.
        let steps = (word << (32 - self.number - self.first)).cast_signed() >> (32 - self.number);
        steps as f32 / self.steps
    }
}

impl Rates {
    /// Of a source that gives none: nothing changes, as far as is known.
    pub const NONE: Self = Self(0);

    /// The nearest to these of roll, pitch and heading, radians a second: 4.09 at the most, 2.54 of heading. What is not a
    /// number is none.
    #[must_use]
    pub fn from_rad_s([roll, pitch, heading]: [f32; 3]) -> Self {
        Self(ROLL.of(roll) | PITCH.of(pitch) | HEADING.of(heading))
    }

    /// All of them in one word.
    pub(crate) const fn word(self) -> u32 {
        self.0
    }

    /// Those of a word, whatever it is.
    pub(crate) const fn from_word(word: u32) -> Self {
        Self(word)
    }

    /// Of roll, radians a second.
    #[must_use]
    pub fn roll_rad_s(&self) -> f32 {
        ROLL.rad_s(self.0)
    }

    /// Of pitch, radians a second.
    #[must_use]
    pub fn pitch_rad_s(&self) -> f32 {
        PITCH.rad_s(self.0)
    }

    /// Of heading, radians a second.
    #[must_use]
    pub fn heading_rad_s(&self) -> f32 {
        HEADING.rad_s(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rad_s: [f32; 3]) -> [f32; 3] {
        let rates = Rates::from_rad_s(rad_s);
        [rates.roll_rad_s(), rates.pitch_rad_s(), rates.heading_rad_s()]
    }

    /// Half a step; each by itself, whatever the others are.
    #[test]
    fn rates_are_kept_to_half_a_step() {
        for rad_s in [
            [0.0; 3],
            [0.1234, -0.5678, 0.3],
            [-4.0, 3.001, -2.5],
            [4.09, -4.09, 2.54],
            [-0.002, 0.0, -0.02],
            [0.0, -0.002, 0.02],
        ] {
            let kept = of(rad_s);
            for ((kept, given), half) in kept.iter().zip(rad_s).zip([0.001_01, 0.001_01, 0.010_1]) {
                assert!((kept - given).abs() <= half, "{rad_s:?} {kept}");
            }
        }
        assert_eq!(size_of::<Rates>(), 4);
    }

    #[test]
    fn what_is_too_fast_saturates_and_what_is_no_number_is_none() {
        for fast in [40.0, f32::INFINITY] {
            let [roll, pitch, heading] = of([fast, -fast, fast]);
            assert!((roll - 4.094).abs() < 1e-4 && (pitch + 4.094).abs() < 1e-4 && (heading - 2.54).abs() < 1e-4);
            let other = of([-fast, fast, -fast]).map(f32::to_bits);
            assert_eq!(other, [-roll, -pitch, -heading].map(f32::to_bits));
        }
        assert_eq!(Rates::from_rad_s([f32::NAN; 3]), Rates::NONE);
    }
}

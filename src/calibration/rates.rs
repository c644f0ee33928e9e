//! How fast the attitude of a sample changes, and the current that flowed.

/// Rates of roll, pitch and heading, as a sample keeps them: 8 bits each of roll and pitch, in steps of 1/50 rad/s, and
/// 6 bits of heading, in steps of 1/20 rad/s. Roll and pitch tell how late the attitude is, heading only which way the
/// vehicle turns. In the other 10 bits is the current, for it would be four more bytes of every sample. 4 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates(u32);

/// A rate in some bits of the word.
struct Bits {
    first: u32,
    number: u32,
    /// Steps in a radian a second.
    steps: f32,
}

/// A step turns the attitude by 0.1 deg in a tenth of a second, and what is off by chance is a third of it.
const ROLL: Bits = Bits { first: 24, number: 8, steps: 50.0 };
const PITCH: Bits = Bits { first: 16, number: 8, steps: 50.0 };
/// Half a step turns the heading by 1.4 deg in a second.
const HEADING: Bits = Bits { first: 10, number: 6, steps: 20.0 };

/// The bits of the current: nothing is none, one is no current, and from there on it grows with the square, for motors
/// make currents of five and of two hundred amperes.
const CURRENT: u32 = 0x3FF;
/// Steps in the root of an ampere: a step is 0.1 A at 10 A, 0.2 A at 50 A.
const ROOT_STEPS: f32 = 64.0;

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
    /// Of a source that gives none: nothing changes, as far as is known, and no current is.
    pub const NONE: Self = Self(0);

    /// The nearest to these of roll, pitch and heading, radians a second: 2.54 at the most, 1.55 of heading. What is not a
    /// number is none.
    #[must_use]
    pub fn from_rad_s([roll, pitch, heading]: [f32; 3]) -> Self {
        Self(ROLL.of(roll) | PITCH.of(pitch) | HEADING.of(heading))
    }

    /// The same with a current, amperes: the nearest to it up to 255 A, none for one that is charged with, and unknown if
    /// there is none or it is not a number.
    #[must_use]
    pub fn with_current(self, current_a: Option<f32>) -> Self {
        let root = |amperes: f32| libm::roundf(libm::sqrtf(amperes.max(0.0)) * ROOT_STEPS) as u32;
        let bits =
            current_a.filter(|amperes| !amperes.is_nan()).map_or(0, |amperes| root(amperes).min(CURRENT - 1) + 1);
        Self(self.0 & !CURRENT | bits)
    }

    /// The current, amperes, if it is known.
    #[must_use]
    pub fn current_a(&self) -> Option<f32> {
        let root = (self.0 & CURRENT).checked_sub(1)? as f32 / ROOT_STEPS;
        Some(root * root)
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
        let rates = Rates::from_rad_s(rad_s).with_current(Some(100.0));
        [rates.roll_rad_s(), rates.pitch_rad_s(), rates.heading_rad_s()]
    }

    /// Half a step; each by itself, whatever the others are.
    #[test]
    fn rates_are_kept_to_half_a_step() {
        for rad_s in [
            [0.0; 3],
            [0.1234, -0.5678, 0.3],
            [-2.5, 2.001, -1.5],
            [2.54, -2.54, 1.55],
            [-0.02, 0.0, -0.05],
            [0.0, -0.02, 0.05],
        ] {
            let kept = of(rad_s);
            for ((kept, given), half) in kept.iter().zip(rad_s).zip([0.010_01, 0.010_01, 0.025_01]) {
                assert!((kept - given).abs() <= half, "{rad_s:?} {kept}");
            }
        }
        assert_eq!(size_of::<Rates>(), 4);
    }

    #[test]
    fn what_is_too_fast_saturates_and_what_is_no_number_is_none() {
        for fast in [40.0, f32::INFINITY] {
            let [roll, pitch, heading] = of([fast, -fast, fast]);
            assert!((roll - 2.54).abs() < 1e-4 && (pitch + 2.54).abs() < 1e-4 && (heading - 1.55).abs() < 1e-4);
            let other = of([-fast, fast, -fast]).map(f32::to_bits);
            assert_eq!(other, [-roll, -pitch, -heading].map(f32::to_bits));
        }
        assert_eq!(Rates::from_rad_s([f32::NAN; 3]), Rates::NONE);
    }

    /// Half a step of its root, beside whatever rates, which it leaves alone; unknown is not none, and what charges is none.
    #[test]
    fn a_current_is_kept_to_half_a_step_of_its_root() {
        let rates = Rates::from_rad_s([-1.0, 2.54, -1.55]);
        assert_eq!(rates.current_a(), None);
        for given in [0.0, 0.01, 0.5, 1.0, 10.0, 47.0, 200.0, 255.0] {
            let with = rates.with_current(Some(given));
            let kept = with.current_a().unwrap();
            assert!((kept.sqrt() - f32::sqrt(given)).abs() <= 0.5 / 64.0 + 1e-5, "{given} {kept}");
            assert_eq!(with.with_current(None), rates, "{given}");
        }
        assert_eq!(rates.with_current(Some(-5.0)).current_a(), Some(0.0));
        for much in [256.0, 1e9, f32::INFINITY] {
            assert_eq!(rates.with_current(Some(much)).current_a(), Some(255.000_98), "{much}");
        }
        assert_eq!(rates.with_current(Some(f32::NAN)), rates);
    }
}

/// Rates of roll and pitch (8 bits, 1/50 rad/s) and heading (6 bits, 1/20 rad/s), and the motor current (10 bits),
/// packed into 4 bytes to keep samples small. Roll and pitch rates determine the attitude latency; the heading rate
/// only gives the direction of turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates(u32);

use crate::trig::sqrt;
struct RateBits {
    shift: u32,
    width: u32,
    steps_per_rad_s: f32,
}

/// A step changes the attitude by 0.1 deg in 0.1 s; the rounding error is a third of that.
const ROLL: RateBits = RateBits { shift: 24, width: 8, steps_per_rad_s: 50.0 };
const PITCH: RateBits = RateBits { shift: 16, width: 8, steps_per_rad_s: 50.0 };
/// Half a step changes the heading by 1.4 deg in 1 s.
const HEADING: RateBits = RateBits { shift: 10, width: 6, steps_per_rad_s: 20.0 };

/// Mask of the current: 0 is unknown, larger values encode the square root of the current, for currents of 5 to 200 A.
const CURRENT_MASK: u32 = 0x3FF;
/// Steps per root ampere: 0.1 A at 10 A, 0.2 A at 50 A.
const STEPS_PER_ROOT_AMPERE: f32 = 64.0;

impl RateBits {
    fn encode(&self, rad_s: f32) -> u32 {
        let most = (1 << (self.width - 1)) - 1;
        // The cast saturates and maps NaN to 0.
        let steps = (libm::roundf(rad_s * self.steps_per_rad_s) as i32).clamp(-most, most);
        (steps as u32 & ((1 << self.width) - 1)) << self.shift
    }

    fn decode_rad_s(&self, word: u32) -> f32 {
        // Sign extension.
        let steps = (word << (32 - self.width - self.shift)).cast_signed() >> (32 - self.width);
        steps as f32 / self.steps_per_rad_s
    }
}

impl Rates {
    /// Zero rates and unknown current, for sources without rates.
    pub const NONE: Self = Self(0);

    /// Encodes rates of roll, pitch and heading, rad/s, saturated at 2.54 (heading 1.55). NaN is 0.
    #[must_use]
    pub fn from_rad_s([roll, pitch, heading]: [f32; 3]) -> Self {
        Self(ROLL.encode(roll) | PITCH.encode(pitch) | HEADING.encode(heading))
    }

    /// Encodes a current, amperes: 0 if negative (charging), at most 255, unknown if `None` or NaN.
    #[must_use]
    pub fn with_current(self, current_a: Option<f32>) -> Self {
        let root = |amperes: f32| libm::roundf(sqrt(amperes.max(0.0)) * STEPS_PER_ROOT_AMPERE) as u32;
        let bits =
            current_a.filter(|amperes| !amperes.is_nan()).map_or(0, |amperes| root(amperes).min(CURRENT_MASK - 1) + 1);
        Self(self.0 & !CURRENT_MASK | bits)
    }

    /// Current, amperes, if known.
    #[must_use]
    pub fn current_a(&self) -> Option<f32> {
        let root = (self.0 & CURRENT_MASK).checked_sub(1)? as f32 / STEPS_PER_ROOT_AMPERE;
        Some(root * root)
    }

    pub(crate) const fn to_bits(self) -> u32 {
        self.0
    }

    pub(crate) const fn from_bits(word: u32) -> Self {
        Self(word)
    }

    /// Roll rate, rad/s.
    #[must_use]
    pub fn roll_rad_s(&self) -> f32 {
        ROLL.decode_rad_s(self.0)
    }

    /// Pitch rate, rad/s.
    #[must_use]
    pub fn pitch_rad_s(&self) -> f32 {
        PITCH.decode_rad_s(self.0)
    }

    /// Heading rate, rad/s.
    #[must_use]
    pub fn heading_rad_s(&self) -> f32 {
        HEADING.decode_rad_s(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rad_s: [f32; 3]) -> [f32; 3] {
        let rates = Rates::from_rad_s(rad_s).with_current(Some(100.0));
        [rates.roll_rad_s(), rates.pitch_rad_s(), rates.heading_rad_s()]
    }

    #[test]
    fn rates_round_trip_within_half_a_step() {
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
    fn fast_rates_saturate_and_nan_rates_are_missing() {
        for fast in [40.0, f32::INFINITY] {
            let [roll, pitch, heading] = of([fast, -fast, fast]);
            assert!((roll - 2.54).abs() < 1e-4 && (pitch + 2.54).abs() < 1e-4 && (heading - 1.55).abs() < 1e-4);
            let other = of([-fast, fast, -fast]).map(f32::to_bits);
            assert_eq!(other, [-roll, -pitch, -heading].map(f32::to_bits));
        }
        assert_eq!(Rates::from_rad_s([f32::NAN; 3]), Rates::NONE);
    }

    /// Rounding error: half a step of the square root. An unknown current differs from 0 A.
    #[test]
    fn currents_round_trip_within_half_a_root_step() {
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

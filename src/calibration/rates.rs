//! How fast roll and pitch of a sample change.

/// Rates of roll and pitch, as a sample keeps them: in thousandths of a radian a second, up to 32 rad/s. 4 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates {
    roll: i16,
    pitch: i16,
}

/// Steps in a radian a second. One of them turns the attitude by 0.006 deg in a tenth of a second.
const STEPS: f32 = 1000.0;

impl Rates {
    /// Of a source that gives none: nothing changes, as far as is known.
    pub const NONE: Self = Self { roll: 0, pitch: 0 };

    /// The nearest to these, radians a second; those that are faster are the fastest there are, and what is not a number
    /// is none.
    #[must_use]
    pub fn from_rad_s(roll_rad_s: f32, pitch_rad_s: f32) -> Self {
        // The cast saturates, and takes what is no number to nothing.
        let steps = |rad_s: f32| libm::roundf(rad_s * STEPS) as i16;
        Self { roll: steps(roll_rad_s), pitch: steps(pitch_rad_s) }
    }

    /// Of roll, radians a second.
    #[must_use]
    pub fn roll_rad_s(&self) -> f32 {
        f32::from(self.roll) / STEPS
    }

    /// Of pitch, radians a second.
    #[must_use]
    pub fn pitch_rad_s(&self) -> f32 {
        f32::from(self.pitch) / STEPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_kept_to_half_a_thousandth() {
        for (roll_rad_s, pitch_rad_s) in [(0.0, 0.0), (0.1234, -0.5678), (-7.0, 3.001), (32.7, -32.7)] {
            let rates = Rates::from_rad_s(roll_rad_s, pitch_rad_s);
            assert!((rates.roll_rad_s() - roll_rad_s).abs() < 5.1e-4, "{rates:?}");
            assert!((rates.pitch_rad_s() - pitch_rad_s).abs() < 5.1e-4, "{rates:?}");
        }
        assert_eq!(size_of::<Rates>(), 4);
    }

    #[test]
    fn what_is_too_fast_saturates_and_what_is_no_number_is_none() {
        let rates = Rates::from_rad_s(40.0, -40.0);
        assert!((rates.roll_rad_s() - 32.767).abs() < 1e-3 && (rates.pitch_rad_s() + 32.768).abs() < 1e-3);
        let rates = Rates::from_rad_s(f32::INFINITY, f32::NEG_INFINITY);
        assert!((rates.roll_rad_s() - 32.767).abs() < 1e-3 && (rates.pitch_rad_s() + 32.768).abs() < 1e-3);
        assert_eq!(Rates::from_rad_s(f32::NAN, f32::NAN), Rates::NONE);
    }
}

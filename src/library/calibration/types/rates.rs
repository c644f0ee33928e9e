//! Rates and motor current of a sample, as small numbers.

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

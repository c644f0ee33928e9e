//! Shared parts of the closed forms of a left and a right turn, [two planes](super::two_plane) and [four
//! ellipses](super::four_ellipse): mean bank, turn centres, direction of turn.

use nalgebra::Vector3;

use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, Sample, Samples};
use crate::frames::wrap_pi;
use crate::trig;

/// Minimum number of samples of a side: five determine a conic, and each of twelve sectors should have one.
pub(in crate::calibration) const MIN_SAMPLES: usize = 12;

/// Maximum time between samples for the direction of turn, milliseconds. In 3 s a turn of 30 deg/s stays below half a
/// circle.
const MAX_GAP_MS: u32 = 3000;

/// Minimum sine of the bank difference between the sides: 10 deg.
const MIN_BANK_DIFFERENCE_SINE: f32 = 0.17;

#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct MeanBank {
    pub sin: f32,
    pub cos: f32,
}

impl MeanBank {
    pub fn from_samples(samples: Samples<'_>) -> Self {
        let roll_sum_rad = samples.iter().map(|sample| sample.attitude.roll_rad).sum::<f32>();
        let mean_rad = roll_sum_rad / samples.iter().count().max(1) as f32;
        let (sin, cos) = trig::sin_cos(mean_rad);
        Self { sin, cos }
    }

    /// Sine of the bank difference to another turn, a divisor in the closed forms.
    ///
    /// # Errors
    ///
    /// [`SolveError::SamePlane`] when the banks are less than 10 deg apart.
    pub fn sine_of_difference(self, other: Self) -> Result<f32, SolveError> {
        let sine = other.sin * self.cos - other.cos * self.sin;
        if sine.abs() < MIN_BANK_DIFFERENCE_SINE { Err(SolveError::SamePlane) } else { Ok(sine) }
    }
}

/// Centres of a left and a right turn, `c = r V + b` (Liu 2007 eq. 14): `V` the vertical field in units of H0, `r` the
/// response at the turn's bank to a vertical field of H0. Microtesla.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct TurnCentres {
    pub centres_ut: [Vector3<f32>; 2],
    pub vertical_response_ut: [Vector3<f32>; 2],
}

impl TurnCentres {
    /// `V` from the difference of the centres, where `b` cancels, by least squares.
    pub fn vertical_field(&self) -> f32 {
        let [left, right] = self.vertical_response_ut;
        let [centre_left, centre_right] = self.centres_ut;
        let between = right - left;
        between.dot(&(centre_right - centre_left)) / between.norm_squared()
    }

    /// `b` from the sum of the centres, microtesla.
    pub fn hard_iron_ut(&self, vertical: f32) -> Vector3<f32> {
        let [left, right] = self.vertical_response_ut;
        let [centre_left, centre_right] = self.centres_ut;
        (centre_left + centre_right - (left + right) * vertical) / 2.0
    }
}

/// Total change of an angle in the turns of a part, in their direction, radians: positive if it increases in right turns
/// and decreases in left ones. 0 if the samples are too far apart.
pub(in crate::calibration) fn turn_progress_rad(
    samples: Samples<'_>,
    part: CollectionPart,
    angle_rad: impl Fn(&Sample) -> f32,
) -> f32 {
    let turn = || samples.samples_of_part(part).iter();
    let progress_rad: f32 = turn()
        .zip(turn().skip(1))
        .filter(|(a, b)| b.time.ms_since(a.time) <= MAX_GAP_MS)
        .map(|(a, b)| wrap_pi(angle_rad(b) - angle_rad(a)))
        .sum();
    if part == CollectionPart::LEFT { -progress_rad } else { progress_rad }
}

/// Maximum time between neighbours for the direction of turn by gyro, milliseconds: shorter than yaw oscillations.
const MAX_RATES_GAP_MS: u32 = 1200;

/// Minimum total turn by gyro, radians: half a circle.
const MIN_GYRO_TURN_RAD: f32 = 3.1;

/// Total change of an angle in the direction of turn of the gyro, radians, positive if they agree. `None` without rates
/// or with little turning.
pub(in crate::calibration) fn turn_progress_by_rates_rad(
    samples: Samples<'_>,
    angle_rad: impl Fn(&Sample) -> f32,
) -> Option<f32> {
    let (mut progress_rad, mut turned_rad) = (0.0, 0.0);
    let mut previous: Option<&Sample> = None;
    for sample in samples.iter() {
        if let Some(previous) = previous.replace(sample)
            && sample.time.ms_since(previous.time) <= MAX_RATES_GAP_MS
        {
            let step_s = sample.time.ms_since(previous.time) as f32 * 1e-3;
            let by_gyro_rad = step_s * previous.rates.heading_rad_s().midpoint(sample.rates.heading_rad_s());
            turned_rad += by_gyro_rad.abs();
            progress_rad += wrap_pi(angle_rad(sample) - angle_rad(previous)) * by_gyro_rad.signum();
        }
    }
    (turned_rad >= MIN_GYRO_TURN_RAD).then_some(progress_rad)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::AngleRates;
    use crate::calibration::tests::synthetic::Parts;
    use crate::frames::{Field, RollPitch};
    use crate::time::WrappingMillis;

    fn turn_sample(roll_deg: f32, x_ut: f32, millis: u32) -> Sample {
        let field = Field::from_ut(x_ut, 0.0, 0.0);
        Sample { time: WrappingMillis::new(millis), ..Sample::new(field, RollPitch::from_deg(roll_deg, 3.0)) }
    }

    fn heading_progress_rad(part: CollectionPart, samples: &[(u32, f32)]) -> f32 {
        let turn_sample = |&(millis, x_ut): &(u32, f32)| Sample { part, ..turn_sample(0.0, x_ut, millis) };
        let samples: Vec<Sample> = samples.iter().map(turn_sample).collect();
        turn_progress_rad(Samples::new(&samples), part, |s| s.field.ut.x)
    }

    fn progress_with_gyro_rate(deg_s: f32, every_ms: u32, seconds: u32) -> Option<f32> {
        let circle: Vec<Sample> = (0..=seconds * 1000 / every_ms)
            .map(|i| {
                let heading_rad = wrap_pi((20.0 * (i * every_ms) as f32 * 1e-3).to_radians());
                let rates = AngleRates::from_rad_s([0.0, 0.0, deg_s.to_radians()]);
                Sample { rates, ..turn_sample(0.0, heading_rad, i * every_ms) }
            })
            .collect();
        let (first, rest) = circle.split_at(circle.len() / 2);
        turn_progress_by_rates_rad(Parts { level: first, free: rest, ..Parts::default() }.samples(), |sample| {
            sample.field.ut.x
        })
    }

    #[test]
    fn heading_progress_has_the_sign_of_the_gyro_rate() {
        for (deg_s, expected) in [(20.0, Some(TAU)), (-20.0, Some(-TAU)), (15.0, Some(TAU)), (0.0, None)] {
            let found = progress_with_gyro_rate(deg_s, 500, 18);
            let is_equal = found.zip(expected).map_or(found == expected, |(f, e)| (f - e).abs() < 0.05);
            assert!(is_equal, "{deg_s}: {found:?}");
        }
    }

    /// Half a circle, and samples a second apart, give a direction.
    #[test]
    fn little_turning_or_large_gaps_give_no_direction() {
        for (name, every_ms, seconds, is_known) in [
            ("200 deg", 500, 10, true),
            ("100 deg", 500, 5, false),
            ("a second between samples", 1000, 30, true),
            ("three seconds between samples", 3000, 30, false),
        ] {
            assert_eq!(progress_with_gyro_rate(20.0, every_ms, seconds).is_some(), is_known, "{name}");
        }
    }

    /// Where samples are missing for three seconds, the heading may have changed by more than half a circle.
    #[test]
    fn large_gaps_are_ignored() {
        for (samples, expected_rad) in [
            (&[(100, 1.0), (2100, 2.0)][..], 1.0),
            (&[(100, 1.0), (5100, 2.0)], 0.0),
            (&[(3100, 1.0), (100, 2.0)], 0.0),
            (&[(0, 0.0), (9000, 1.0), (9500, 1.25)], 0.25),
        ] {
            let found_rad = heading_progress_rad(CollectionPart::RIGHT, samples);
            assert!((found_rad - expected_rad).abs() < 1e-6, "{samples:?}: {found_rad}");
        }
    }
}

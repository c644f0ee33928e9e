//! A source that does not yet know its attitude: a filter that aligns after its start.
//!
//! It swings its roll and pitch about, by tens of degrees, while the aircraft stands. Neither the body rates nor the
//! field tell of such a motion; of one that is real the first do, and, unless it is about the field's own direction,
//! the second does as well. Both must be still, so that rates which are sent in a wrong unit are not taken for a
//! proof of rest, nor a field that is held against a wrong calibration.

use nalgebra::Vector3;

use super::Report;
use super::plausibility::Direction;
use crate::frames::{Field, Sensor};
use crate::time::Timestamp;

/// What tilt, field and rates are now is held against their means of this time, seconds.
const MEAN_S: f32 = 1.0;

/// A tilt may be off its mean by so much, radians, that nothing else tells of: 3 deg, of noise and of what an
/// acceleration does to it...
const SPARE_RAD: f32 = 0.052;

/// ... and by so many times what the rates add up to: they are of single instants.
const SPARE_TIMES: f32 = 2.0;

/// The field is still when its direction is off its mean by less than this part of what the tilt is.
const STILL: f32 = 0.3;

/// It settles for so long after it was last seen to align, seconds: a filter that is off by half a degree may pause for
/// two.
const SETTLES_S: f32 = 5.0;

/// A longer time without a report begins the means anew, seconds.
const GAP_S: f32 = 0.5;

/// The means, and how long it takes to settle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aligning {
    /// Axes of the chip: angles are the same in all.
    field: Direction,
    last: Option<Mean>,
    settles_s: f32,
}

/// Of about a second, up to a report.
#[derive(Clone, Copy, Debug)]
struct Mean {
    at: Timestamp,
    /// Where down is, body axes.
    down: Vector3<f32>,
    /// Where the field points, axes of the chip.
    field: Vector3<f32>,
    /// What the rates add up to about any axis, radians.
    turned_rad: f32,
    /// Of the last report, radians a second.
    rate_rad_s: f32,
}

impl Aligning {
    /// Nothing seen yet.
    pub const fn new() -> Self {
        Self { field: Direction::UNKNOWN, last: None, settles_s: 0.0 }
    }

    /// Takes the raw field of a reading: a calibration may not be there yet.
    pub fn see_field(&mut self, field: Field<Sensor>) {
        self.field.see(field.ut);
    }

    /// Takes a report of an instant; says whether the attitude is one that is still sought. Without a field and of a
    /// source without rates nothing can be said. Angles are small where they are compared: chords of unit vectors.
    #[inline(never)]
    pub fn see(&mut self, at: Timestamp, report: &Report) -> bool {
        let Some((field, rate_rad_s)) = self.field.mean().zip(report.turning_rad_s()) else {
            (self.last, self.settles_s) = (None, 0.0);
            return false;
        };
        let now = Mean { at, down: report.attitude.tilt().down(), field, turned_rad: 0.0, rate_rad_s };
        let Some(last) = self.last.replace(now) else { return false };
        let step_s = at.us_since(last.at) as f32 * 1e-6;
        self.settles_s = (self.settles_s - step_s).max(0.0);
        if step_s <= GAP_S {
            let mean = last.with(&now, step_s);
            let tilted_rad = (now.down - mean.down).norm();
            if tilted_rad > SPARE_RAD + SPARE_TIMES * mean.turned_rad
                && (field - mean.field).norm() < STILL * tilted_rad
            {
                self.settles_s = SETTLES_S;
            }
            // What is no number would stay so for ever.
            self.last = tilted_rad.is_finite().then_some(mean);
        }
        self.settles_s > 0.0
    }
}

impl Mean {
    /// With a report that much later.
    fn with(&self, now: &Self, step_s: f32) -> Self {
        let part = step_s / MEAN_S;
        let rate_rad_s = now.rate_rad_s.max(self.rate_rad_s);
        Self {
            at: now.at,
            down: self.down + (now.down - self.down) * part,
            field: self.field + (now.field - self.field) * part,
            turned_rad: (1.0 - part) * self.turned_rad + rate_rad_s * step_s,
            rate_rad_s: now.rate_rad_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Source;
    use super::*;
    use crate::frames::Attitude;
    use crate::time::WrappingMillis;

    /// What a source and the chip say from a time on, after ten seconds of rest.
    #[derive(Clone, Copy)]
    struct Said {
        /// Tilt after so many seconds of it, degrees: of roll or of pitch.
        tilt_deg: fn(f32) -> f32,
        is_pitch: bool,
        /// Of what tilts, this part is told by the rates, and this part by the field.
        by_rates: f32,
        by_field: f32,
    }

    /// A step of so much.
    fn step<const HUNDREDTHS: u16>(t_s: f32) -> f32 {
        if t_s >= 0.0 { f32::from(HUNDREDTHS) / 100.0 } else { 0.0 }
    }

    /// Twenty degrees a second for two seconds, and back.
    fn ramp(t_s: f32) -> f32 {
        20.0 * t_s.clamp(0.0, 2.0) - 20.0 * (t_s - 2.0).clamp(0.0, 2.0)
    }

    const STILL_RAMP: Said = Said { tilt_deg: ramp, is_pitch: false, by_rates: 0.0, by_field: 0.0 };

    /// From the beginning of what is said: when it is first said to align, and when no more, seconds.
    fn aligns(said: Said) -> Option<[f32; 2]> {
        let Said { tilt_deg, is_pitch, by_rates, by_field } = said;
        let mut aligning = Aligning::new();
        let mut found: Option<[f32; 2]> = None;
        for i in 0..1000_u16 {
            let t_s = f32::from(i) * 0.02 - 10.0;
            let rate_deg_s = (tilt_deg(t_s + 0.01) - tilt_deg(t_s - 0.01)) / 0.02;
            // A gyro at rest says something.
            let rate = (by_rates * rate_deg_s).to_radians() + 1e-4;
            let (attitude, rates_rad_s) = if is_pitch {
                (Attitude::from_deg(20.0, tilt_deg(t_s)), [0.0, rate, 0.0])
            } else {
                (Attitude::from_deg(tilt_deg(t_s), -10.0), [rate, 0.0, 0.0])
            };
            let angle = (by_field * tilt_deg(t_s)).to_radians();
            (0..40).for_each(|_| aligning.see_field(Field::from_ut(48.0 * angle.cos(), 48.0 * angle.sin(), 0.0)));
            if aligning.see(Timestamp::from_us(u64::from(i) * 20_000), &report(attitude, rates_rad_s)) {
                found = Some([found.map_or(t_s, |[from_s, _]| from_s), t_s]);
            }
        }
        found
    }

    fn report(attitude: Attitude, rates_rad_s: [f32; 3]) -> Report {
        Report { source: Source::default(), sender_time: WrappingMillis::default(), attitude, rates_rad_s }
    }

    /// 3 deg that nothing tells of, be it of roll or of pitch; 2.9 are noise. The first report of a step has taken its
    /// mean along by a fiftieth.
    #[test]
    fn a_tilt_that_nothing_tells_of_is_sought() {
        for is_pitch in [false, true] {
            let said = |tilt_deg| aligns(Said { tilt_deg, is_pitch, ..STILL_RAMP });
            assert_eq!(said(step::<290>), None);
            let [from_s, to_s] = said(step::<320>).unwrap();
            // It is off its mean by enough for a twentieth of a second, and settles in five.
            assert!(from_s.abs() < 0.01 && (to_s - 5.0).abs() < 0.1, "{from_s} {to_s}");
        }
        // What swings on is sought for as long, and for five seconds more.
        let [from_s, to_s] = aligns(STILL_RAMP).unwrap();
        assert!((0.1..0.3).contains(&from_s) && (8.8..10.0).contains(&to_s), "{from_s} {to_s}");
    }

    /// The error of a source may drift by 2 deg a second; by 4 it is a second's mean and a degree away.
    #[test]
    fn what_drifts_slowly_is_an_error() {
        assert_eq!(aligns(Said { tilt_deg: |t_s| 2.0 * t_s.clamp(0.0, 10.0), ..STILL_RAMP }), None);
        assert!(aligns(Said { tilt_deg: |t_s| 4.0 * t_s.clamp(0.0, 10.0), ..STILL_RAMP }).is_some());
    }

    /// At 20 deg/s a tilt is 20 deg off its mean, for a moment. Half of what is beyond three must be told by rates.
    #[test]
    fn what_the_rates_tell_of_is_flown() {
        let by_rates = |by_rates| aligns(Said { by_rates, ..STILL_RAMP });
        assert!(by_rates(0.3).is_some() && by_rates(-0.3).is_some());
        assert_eq!((by_rates(0.5), by_rates(-1.0), by_rates(1.0)), (None, None, None));
    }

    /// Rates of nearly nothing, as of degrees taken for radians: the field turns, and they are to blame.
    #[test]
    fn what_the_field_tells_of_is_flown() {
        let by_field = |by_field| aligns(Said { by_field, by_rates: 0.017, ..STILL_RAMP });
        assert!(by_field(0.25).is_some() && by_field(-0.25).is_some());
        assert_eq!((by_field(0.4), by_field(-0.4), by_field(1.0)), (None, None, None));
    }

    /// Nor of a source without rates, nor before the first reading, nor over a gap of more than half a second.
    #[test]
    fn what_is_not_known_is_not_held_against_it() {
        let tilted = |deg: f32| Attitude::from_deg(deg, 0.0);
        let says = |step_us: u64, rate_rad_s: f32, has_field: bool| {
            let mut aligning = Aligning::new();
            if has_field {
                aligning.see_field(Field::from_ut(20.0, 0.0, 43.0));
            }
            let mut see =
                |us: u64, deg: f32| aligning.see(Timestamp::from_us(us), &report(tilted(deg), [rate_rad_s, 0.0, 0.0]));
            see(0, 0.0) || see(step_us, 30.0)
        };
        assert!(says(20_000, 1e-4, true) && says(500_000, 1e-4, true));
        assert!(!says(500_001, 1e-4, true) && !says(20_000, 0.0, true) && !says(20_000, 1e-4, false));
    }

    /// A gap does not end it.
    #[test]
    fn it_settles_over_a_gap() {
        let mut aligning = Aligning::new();
        aligning.see_field(Field::from_ut(20.0, 0.0, 43.0));
        let mut see = |us: u64, deg: f32| {
            aligning.see(Timestamp::from_us(us), &report(Attitude::from_deg(deg, 0.0), [1e-4, 0.0, 0.0]))
        };
        assert!(!see(0, 0.0) && see(20_000, 30.0));
        assert!(see(2_000_000, 0.0) && see(5_000_000, 0.0) && !see(5_100_000, 0.0));
    }

    /// What is no number is no tilt, and does not stay.
    #[test]
    fn what_is_no_number_is_forgotten() {
        let mut aligning = Aligning::new();
        aligning.see_field(Field::from_ut(f32::NAN, 0.0, 0.0));
        let mut see = |i: u64, roll_deg: f32| {
            aligning.see_field(Field::from_ut(20.0, 0.0, 43.0));
            aligning.see(Timestamp::from_us(i * 20_000), &report(Attitude::from_deg(roll_deg, 0.0), [1e-4, 0.0, 0.0]))
        };
        assert!((0..200).all(|i| !see(i, if i == 3 { f32::NAN } else { 0.0 })));
        assert!(see(200, 30.0));
    }
}

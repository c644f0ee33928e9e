//! Whether a report can be true: one far from where the ones before lead to, and reports that repeat.

use nalgebra::Vector3;

use super::{Report, Stamped, extrapolate};
use crate::frames::{Attitude, Body, Field, wrap_pi};
use crate::time::Timestamp;
use crate::trig;

/// A report may be off what the one before it leads to by so much, radians.
const SPIKE_RAD: f32 = 0.1;

/// It may be off by so much more for each second since, radians: body rates change.
const SPIKE_RAD_S: f32 = 1.0;

/// The same of a source that gives no rates, whose reports lead nowhere: an aircraft that rolls fast.
const SPIKE_WITHOUT_RATES_RAD_S: f32 = 4.0;

/// Reports in a row that are not believed; the next one shows that the attitude is another now.
const SPIKES_IN_A_ROW: u8 = 3;

/// A report in a row of so many equal ones, itself included, may be of a source that repeats itself.
const EQUAL_REPORTS: u8 = 5;

/// It takes so long at least, microseconds: five reports at 50 Hz. A source that sends faster than it estimates repeats
/// itself, too.
const EQUAL_US: u64 = 80_000;

/// A source that was seen to change by less than this, radians, has values so fine that noise alone keeps them from
/// repeating: 0.05 deg.
const FINE_RAD: f32 = 8.7e-4;

/// A source of coarser values repeats itself in steady flight. Only when it does so for longer, microseconds, ...
const EQUAL_COARSE_US: u64 = 500_000;

/// ... the field in body axes has meanwhile turned by more than this, the cosine of 3 deg, ...
const COS_TURNED: f32 = 0.998_63;

/// ... and not only about the vertical, as it does of a vehicle that turns on level ground, is it frozen: the
/// inclination, levelled by what is repeated, has moved by more than this, radians: 1 deg.
const MOVED_RAD: f32 = 0.017_5;

/// What is tilted by more than this does not stand on level ground: the cosine of 10 deg.
const COS_TILTED: f32 = 0.984_8;

/// Readings over which the direction of the field is averaged: the noise of one is a degree in a weak field.
const FIELD_READINGS: f32 = 12.0;

/// Until it is the average of one attitude, microseconds.
const FIELD_SETTLES_US: u64 = 400_000;

/// Finds reports that cannot be true.
#[derive(Debug)]
pub(super) struct Spikes {
    /// Reports in a row that were not believed.
    in_a_row: u8,
}

impl Spikes {
    /// None so far.
    pub const fn new() -> Self {
        Self { in_a_row: 0 }
    }

    /// Whether a report of an instant is one, given the last that was believed, unless that is too long ago.
    pub fn see(&mut self, last: Option<&Stamped>, at: Timestamp, attitude: Attitude) -> bool {
        let is_far = last.is_some_and(|last| {
            let step_s = at.us_since(last.at) as f32 * 1e-6;
            let expected = extrapolate(&last.report, step_s);
            let by_time_rad_s = if last.report.has_rates() { SPIKE_RAD_S } else { SPIKE_WITHOUT_RATES_RAD_S };
            tilt_between(expected, attitude) > SPIKE_RAD + by_time_rad_s * step_s
        });
        if is_far && self.in_a_row < SPIKES_IN_A_ROW {
            self.in_a_row += 1;
            return true;
        }
        self.in_a_row = 0;
        false
    }
}

/// The angle between the down directions of two attitudes, radians: roll and pitch alone, and no more at a vertical
/// nose, where roll means nothing.
fn tilt_between(a: Attitude, b: Attitude) -> f32 {
    let chord = (a.tilt().down() - b.tilt().down()).norm();
    2.0 * trig::asin(chord / 2.0)
}

/// Where a field points, averaged over a few readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction(Option<Vector3<f32>>);

impl Direction {
    /// Before the first reading.
    pub const UNKNOWN: Self = Self(None);

    /// Takes the field of a reading, any axes.
    #[inline(never)]
    pub fn see(&mut self, field: Vector3<f32>) {
        let direction = field / field.norm();
        let before = self.0.unwrap_or(direction);
        let averaged = before + (direction - before) / FIELD_READINGS;
        // What is no number would stay so for ever.
        self.0 = averaged.iter().all(|c| c.is_finite()).then_some(averaged);
    }

    /// Of a length near one; none before the first reading.
    pub const fn mean(&self) -> Option<Vector3<f32>> {
        self.0
    }
}

/// Finds a source that repeats itself.
#[derive(Debug)]
pub(super) struct Freeze {
    last: Option<Attitude>,
    /// Reports in a row that were equal.
    equal: u8,
    /// When the first of them was, and the last.
    since: Timestamp,
    latest: Timestamp,
    /// Whether a change of less than [`FINE_RAD`] was ever seen.
    is_fine: bool,
    /// Where the field points in body axes, averaged; and where it did when it had settled after the first of the equal
    /// reports.
    field: Direction,
    field_then: Option<Vector3<f32>>,
    frozen: bool,
}

impl Freeze {
    /// Nothing seen yet.
    pub const fn new() -> Self {
        Self {
            last: None,
            equal: 0,
            since: Timestamp::START,
            latest: Timestamp::START,
            is_fine: false,
            field: Direction::UNKNOWN,
            field_then: None,
            frozen: false,
        }
    }

    /// Takes the corrected field of a reading.
    pub fn see_field(&mut self, field: Field<Body>) {
        self.field.see(field.ut);
    }

    /// Takes a report of an instant, whether or not it is believed otherwise.
    pub fn see(&mut self, at: Timestamp, report: &Report) {
        let attitude = report.attitude;
        let is_equal = self.last.is_some_and(|last| {
            last.roll_rad.to_bits() == attitude.roll_rad.to_bits()
                && last.pitch_rad.to_bits() == attitude.pitch_rad.to_bits()
        });
        if is_equal {
            self.equal = self.equal.saturating_add(1);
            if at.us_since(self.since) >= FIELD_SETTLES_US {
                // The first field may come after many reports.
                self.field_then = self.field_then.or(self.field.mean());
            }
        } else {
            self.is_fine |= self.last.is_some_and(|last| is_fine_step(last, attitude));
            self.equal = 1;
            self.since = at;
            self.field_then = None;
        }
        self.last = Some(attitude);
        self.latest = at;
        self.frozen &= is_equal;
        if self.equal >= EQUAL_REPORTS {
            let for_us = at.us_since(self.since);
            self.frozen |= self.is_fine && for_us >= EQUAL_US;
            self.frozen |= for_us >= EQUAL_COARSE_US && self.has_turned(attitude);
        }
    }

    /// When the last report was, if it was one of too many equal ones.
    pub fn frozen_at(&self) -> Option<Timestamp> {
        self.frozen.then_some(self.latest)
    }

    /// Whether the field has turned meanwhile, and not only about the vertical of this attitude.
    fn has_turned(&self, attitude: Attitude) -> bool {
        let (Some(now), Some(then)) = (self.field.mean(), self.field_then) else { return false };
        let [now, then] = [now, then].map(|direction| direction / direction.norm());
        let down = attitude.tilt().down();
        let [dip_now, dip_then] = [now, then].map(|direction| trig::asin(direction.dot(&down)));
        let is_contradicted = (dip_now - dip_then).abs() > MOVED_RAD || down.z < COS_TILTED;
        now.dot(&then) < COS_TURNED && is_contradicted
    }
}

/// Whether an angle changed, by less than coarse sources' steps.
fn is_fine_step(from: Attitude, to: Attitude) -> bool {
    let fine = |step_rad: f32| step_rad.abs() > 0.0 && step_rad.abs() < FINE_RAD;
    fine(wrap_pi(to.roll_rad - from.roll_rad)) || fine(to.pitch_rad - from.pitch_rad)
}

#[cfg(test)]
mod tests {
    use super::super::Source;
    use super::*;
    use crate::time::WrappingMillis;

    fn report(roll_deg: f32, pitch_deg: f32) -> Report {
        let attitude = Attitude::from_deg(roll_deg, pitch_deg);
        Report { source: Source::default(), sender_time: WrappingMillis::default(), attitude, rates_rad_s: [0.0; 3] }
    }

    /// The field of an aircraft that has turned by so many degrees about an axis, averaged over many readings.
    fn see_turned(freeze: &mut Freeze, axis: Vector3<f32>, turned_deg: f32) {
        let turn = nalgebra::Rotation3::new(axis.normalize() * turned_deg.to_radians());
        let field = Field::new(turn * Vector3::new(20.0, 0.0, 20.0));
        (0..200).for_each(|_| freeze.see_field(field));
    }

    /// A source whose first change is of this many degrees, and after it so many equal reports so far apart; the
    /// aircraft turns about an axis, by so many degrees in the end, from 0.4 s on.
    fn is_frozen_about(axis: Vector3<f32>, first_step_deg: f32, reports: u32, apart_us: u64, turned_deg: f32) -> bool {
        is_frozen_at([0.0, 0.0], axis, first_step_deg, reports, apart_us, turned_deg)
    }

    /// The same at a roll and a pitch.
    fn is_frozen_at(
        [roll_deg, pitch_deg]: [f32; 2],
        axis: Vector3<f32>,
        first_step_deg: f32,
        reports: u32,
        apart_us: u64,
        turned_deg: f32,
    ) -> bool {
        let mut freeze = Freeze::new();
        see_turned(&mut freeze, axis, 0.0);
        freeze.see(Timestamp::from_us(0), &report(roll_deg, pitch_deg));
        for i in 1..=reports {
            let at_us = apart_us * u64::from(i);
            let turned = at_us > 400_000 + 2 * apart_us;
            see_turned(&mut freeze, axis, if turned { turned_deg } else { 0.0 });
            freeze.see(Timestamp::from_us(at_us), &report(roll_deg + first_step_deg, pitch_deg));
        }
        freeze.frozen_at().is_some()
    }

    /// The same about the nose: roll, which changes the field's inclination by half of it here.
    fn is_frozen(first_step_deg: f32, reports: u32, apart_us: u64, turned_deg: f32) -> bool {
        is_frozen_about(Vector3::y(), first_step_deg, reports, apart_us, turned_deg)
    }

    /// 0.05 deg is the border of fine, and five the number, over 80 ms at the least.
    #[test]
    fn fine_values_are_frozen_after_five_reports() {
        for step_deg in [0.04, -0.04] {
            assert!(is_frozen(step_deg, 5, 20_000, 0.0) && !is_frozen(step_deg, 4, 30_000, 0.0), "{step_deg}");
        }
        assert!(!is_frozen(0.06, 100, 20_000, 0.0) && !is_frozen(-0.06, 100, 20_000, 0.0));
        // At 100 Hz five reports take 40 ms: nine it must be.
        assert!(!is_frozen(0.04, 8, 10_000, 0.0) && is_frozen(0.04, 9, 10_000, 0.0));
    }

    #[test]
    fn a_fine_step_of_pitch_is_as_good() {
        for pitch_deg in [0.04, -0.04] {
            let mut freeze = Freeze::new();
            freeze.see(Timestamp::from_us(0), &report(0.0, 0.0));
            (1..=5).for_each(|i| freeze.see(Timestamp::from_us(i * 20_000), &report(0.0, pitch_deg)));
            assert!(freeze.frozen_at().is_some());
            // Either angle shows that it goes on.
            freeze.see(Timestamp::from_us(120_000), &report(0.01, pitch_deg));
            assert!(freeze.frozen_at().is_none());
        }
    }

    /// More than 3 deg, over half a second at the least, and five reports.
    #[test]
    fn coarse_values_are_frozen_when_the_field_has_turned() {
        for sign in [1.0, -1.0] {
            assert!(is_frozen(0.1, 30, 20_000, sign * 3.2) && !is_frozen(0.1, 30, 20_000, sign * 2.8));
        }
        // 26 reports at 50 Hz are half a second from the first of them on.
        assert!(is_frozen(0.1, 26, 20_000, 20.0) && !is_frozen(0.1, 25, 20_000, 20.0));
        // Four at 4 Hz are long enough, and too few.
        assert!(!is_frozen(0.1, 4, 250_000, 20.0) && is_frozen(0.1, 5, 250_000, 20.0));
    }

    /// A vehicle that turns on level ground keeps its inclination, and its attitude: nothing is wrong. About an axis
    /// that is 10 deg off the vertical a turn of 8.5 deg changes it by 1.4 deg, one of 4 by 0.7.
    #[test]
    fn a_turn_about_the_vertical_is_no_contradiction() {
        for turned_deg in [5.0, 90.0, -170.0] {
            assert!(!is_frozen_about(Vector3::z(), 0.1, 30, 20_000, turned_deg), "{turned_deg}");
        }
        let tilted = Vector3::new(0.0, 10_f32.to_radians().sin(), 10_f32.to_radians().cos());
        assert!(is_frozen_about(tilted, 0.1, 30, 20_000, 8.5) && !is_frozen_about(tilted, 0.1, 30, 20_000, 4.5));
        assert!(is_frozen_about(tilted, 0.1, 30, 20_000, -8.5) && !is_frozen_about(tilted, 0.1, 30, 20_000, -4.5));
    }

    /// Only what flies turns in a bank, and what flies does not keep it to a tenth of a degree. The axis is the vertical.
    #[test]
    fn a_turn_about_the_vertical_in_a_bank_is_a_contradiction() {
        for (attitude_deg, frozen) in
            [([9.5, 0.0], false), ([10.5, 0.0], true), ([-10.5, 0.0], true), ([0.0, 9.5], false), ([0.0, -10.5], true)]
        {
            let down = Attitude::from_deg(attitude_deg[0] + 0.1, attitude_deg[1]).tilt().down();
            assert_eq!(is_frozen_at(attitude_deg, down, 0.1, 30, 20_000, 20.0), frozen, "{attitude_deg:?}");
            assert!(!is_frozen_at(attitude_deg, down, 0.1, 30, 20_000, 2.0), "{attitude_deg:?}");
        }
    }

    /// What it turned by before it settled is not held against it.
    #[test]
    fn the_field_settles_first() {
        let mut freeze = Freeze::new();
        let level = Field::<Body>::from_ut(0.0, -20.0, 40.0);
        let banked = Attitude::from_deg(25.0, 0.0);
        let in_bank = banked.body(Field::new(level.ut));
        (0..200).for_each(|_| freeze.see_field(in_bank));
        freeze.see(Timestamp::from_us(0), &report(25.0, 0.0));
        // It has just rolled out; the average of a few readings is still of the bank.
        for i in 1..100 {
            freeze.see(Timestamp::from_us(i * 20_000), &report(0.1, 0.0));
            (0..2).for_each(|_| freeze.see_field(Field::new(level.ut)));
            assert!(freeze.frozen_at().is_none(), "{i}");
        }
    }

    /// A weak field of 25 uT with a LIS3MDL's noise, at rest for ten minutes, in tenths of a degree that never change.
    #[test]
    fn a_coarse_source_at_rest_is_not_frozen() {
        let mut random = testkit::random::Random(3);
        let mut freeze = Freeze::new();
        for i in 0..600 * 80_u64 {
            if i % 8 == 0 {
                freeze.see(Timestamp::from_us(i * 12_500), &report(0.3, -1.2));
                assert!(freeze.frozen_at().is_none(), "after {i} readings");
            }
            let [x, y, z] = [10.0, -5.0, 22.0].map(|ut| ut + 0.35 * random.normal());
            freeze.see_field(Field::from_ut(x, y, z));
        }
    }

    #[test]
    fn a_field_that_is_no_number_is_forgotten() {
        let mut freeze = Freeze::new();
        freeze.see_field(Field::from_ut(f32::NAN, 0.0, 0.0));
        freeze.see_field(Field::from_ut(0.0, 0.0, 0.0));
        assert!(freeze.field.mean().is_none() && !freeze.has_turned(Attitude::default()));
        freeze.see_field(Field::from_ut(0.0, 2.0, 0.0));
        assert_eq!(freeze.field.mean(), Some(Vector3::new(0.0, 1.0, 0.0)));
    }

    #[test]
    fn the_angle_between_attitudes_is_that_of_their_down_directions() {
        let between = |a: [f32; 2], b: [f32; 2]| {
            tilt_between(Attitude::from_deg(a[0], a[1]), Attitude::from_deg(b[0], b[1])).to_degrees()
        };
        for (a, b, expected_deg) in [
            ([10.0, 0.0], [30.0, 0.0], 20.0),
            ([0.0, -10.0], [0.0, 10.0], 20.0),
            ([179.0, 0.0], [-179.0, 0.0], 2.0),
            ([0.0, 90.0], [120.0, 90.0], 0.0),
            ([0.0, 0.0], [180.0, 0.0], 180.0),
        ] {
            assert!((between(a, b) - expected_deg).abs() < 0.05, "{a:?} {b:?}: {}", between(a, b));
        }
    }
}

//! Which of many samples tells least: what a full buffer of whatever was flown gives up.
//!
//! Of the coefficients a sample says two things (METHOD in [`likelihood`](crate::calibration)): the corrected field has
//! one strength, and one dip. What a set of samples determines is the determinant of the information about all unknowns
//! together (D-optimality, V. V. Fedorov, "Theory of Optimal Experiments", 1972). By a sample's leverage `l = x^T M^-1 x`
//! the set is worth less by the factor `1 - l` without it, and the one whose two equations have the least goes.
//!
//! What the equations are depends on the coefficients. A linear change of the unknowns, such as soft iron, scales the
//! determinant for all sets alike; what it takes is where the field points. To some ten or twenty degrees a sphere through
//! the samples tells that, until a trial solve does so to a degree.
//!
//! Noise makes a reading seem worth more, and of thousands those would be kept that it makes so. All their noise would lie
//! to one side, and so would what is solved of them. So a sample is seen without the noise that a solve sees of it: its
//! strength, and with coefficients its dip. An error of attitude that shows in the dip turns the down direction towards or
//! away from the field, which leaves the derivative's direction as it is, and the reading's own is taken back. What is left
//! shows in no residual, and pulls nothing. A sample is not worth less for a dip that is off: what is kept then agrees with
//! what was found first, right or not, and of copters' calibrations one in ten was wrong instead of one in a hundred.

use nalgebra::Vector3;

use crate::calibration::{
    Calibration, LeastSquares, Orientation, Prediction, Quality, Row, Sample, Samples, Squares, centre,
};

/// What is known of each unknown beforehand, in dips: keeps what was never flown from being infinitely dear, and above
/// what `f32` can tell from nothing in a sum over all samples.
const RIDGE: f32 = 0.01;

/// A reading is no nearer to the centre than this, microtesla: keeps its direction a number.
const MIN_UT: f32 = 1e-3;

/// A reading is off by no more than this, radians, five sigmas of a sensor with 1 % of noise: what is off by more is so for
/// another reason.
const MAX_OFF_RAD: f32 = 0.05;

/// How a sample is seen.
#[derive(Clone, Debug)]
struct View {
    calibration: Calibration,
    /// Of a dip that is off, what is the reading's and not the attitude's.
    of_reading: f32,
    /// A sample that is new is worth so much less than it seems: noise makes it seem worth more, by a sphere more so.
    new: f32,
    /// Whether it is by coefficients.
    is_learnt: bool,
}

impl View {
    /// Not at all as yet. Nothing but zeros, which take no flash where a collection begins.
    const NONE: Self = Self {
        calibration: Calibration {
            w: [[0.0; 3]; 3],
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            current: crate::calibration::CurrentIron::NONE,
        },
        of_reading: 0.0,
        new: 0.0,
        is_learnt: false,
    };

    /// From the middle of a sphere.
    fn from_centre(centre_ut: Vector3<f32>) -> Self {
        let calibration = Calibration { b_ut: centre_ut.into(), ..Calibration::uncalibrated(Orientation::NONE) };
        Self { calibration, of_reading: 0.0, new: 0.8, is_learnt: false }
    }

    /// By coefficients that fit as well as this.
    fn by(calibration: &Calibration, quality: &Quality) -> Self {
        let of_reading = quality.norm_residual / quality.dip_residual_deg.to_radians();
        // Not a number, where neither is off, is one.
        Self { calibration: *calibration, of_reading: (of_reading * of_reading).min(1.0), new: 0.9, is_learnt: true }
    }

    /// What a sample says, of its strength and of its dip. By the direction of its reading, without its size, and as far as
    /// the reading was off towards the vertical, by where it was not.
    #[inline(never)]
    fn rows(&self, sample: &Sample) -> [Row; 2] {
        let field_ut = self.calibration.body(sample).ut;
        let direction = field_ut / field_ut.norm().max(MIN_UT);
        let latency_s = self.calibration.latency_s;
        let attitude = if latency_s == 0.0 { sample.attitude } else { sample.attitude_after(latency_s) };
        let seen = Prediction::new(direction, &direction, &attitude.tilt());
        if !self.is_learnt {
            return [seen.norm_row(), seen.dip_row()];
        }
        let off_rad = self.of_reading * (seen.dip_rad - self.calibration.inclination_rad);
        let off_rad = off_rad.clamp(-MAX_OFF_RAD, MAX_OFF_RAD);
        // A small turn in the plane of field and vertical.
        let direction = seen.direction - seen.towards_down * off_rad;
        let towards_down = seen.towards_down + seen.direction * off_rad;
        let truly = Prediction { x: direction, direction, towards_down, ..seen };
        [truly.norm_row(), truly.dip_row()]
    }
}

/// Beside a new sample the others are worth a little less.
const BESIDE: f32 = 0.9;

/// What a set of samples tells together. 0.9 KB.
#[derive(Debug)]
pub(super) struct Spread {
    view: View,
    design: LeastSquares<13, 1>,
    /// What the one that told least was worth.
    least: f32,
}

impl Spread {
    /// None is known.
    pub const NONE: Self = Self { view: View::NONE, design: LeastSquares::new(), least: 0.0 };

    /// None is known of another set, whose samples are seen as these are.
    pub fn of_others(&self) -> Self {
        Self { view: self.view.clone(), design: LeastSquares::new(), least: 0.0 }
    }

    /// Knows nothing again.
    pub fn forget(&mut self) {
        self.see(View::NONE);
    }

    /// Sees samples by coefficients from now on, which fit as well as this.
    pub fn learn(&mut self, calibration: &Calibration, quality: &Quality) {
        self.see(View::by(calibration, quality));
    }

    fn see(&mut self, view: View) {
        // Whatever the design tells is more than nothing: all are looked at next.
        self.view = view;
        self.least = 0.0;
    }

    /// Whether samples are seen by coefficients.
    #[cfg(test)]
    pub fn has_learnt(&self) -> bool {
        self.view.is_learnt
    }

    /// Whether a sample that is not among them may tell more than the one that told least, as far as the set is still what
    /// it was. A look at it takes a thousandth of a look at all.
    pub fn may_gain(&self, sample: &Sample) -> bool {
        // Among them its leverage would be less.
        let worth: f32 = self.leverages(sample).into_iter().map(|leverage| leverage / (1.0 + leverage)).sum();
        // What is no number is looked at, and so is all while none is known.
        worth.is_nan() || self.view.new * worth >= BESIDE * self.least
    }

    fn leverages(&self, sample: &Sample) -> [f32; 2] {
        self.view.rows(sample).map(|row| self.design.variance(&row.dense()))
    }

    /// The place of the sample that tells least of all of these, of which the first is new; `None` if nothing can be told.
    #[inline(never)]
    pub fn weakest(&mut self, samples: Samples<'_>) -> Option<usize> {
        self.design = LeastSquares::new();
        if !self.view.is_learnt {
            let (centre_ut, _) = centre(samples).filter(|(ut, _)| ut.iter().all(|c| c.is_finite()))?;
            self.view = View::from_centre(centre_ut);
        }
        let mut squares = Squares::none();
        for sample in samples.all() {
            let [strength, dip] = self.view.rows(sample);
            // One as much as the other: a sensor may be the better one, or an attitude.
            squares.add_two([&strength, &dip], [1.0; 2]);
        }
        let mut information = squares.triangle();
        for (i, row) in information.iter_mut().enumerate() {
            row[i] += RIDGE;
        }
        self.design = LeastSquares::of_normal_equations(information, [[0.0]; _]);
        let certain = core::iter::once(self.view.new).chain(core::iter::repeat(1.0));
        let worth = |(sample, certain)| certain * self.leverages(sample).iter().sum::<f32>();
        let worths = samples.all().zip(certain).map(worth).enumerate();
        let (place, least) = worths.min_by(|a, b| a.1.total_cmp(&b.1))?;
        self.least = least;
        Some(place)
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use nalgebra::Matrix3;
    use testkit::random::Random;

    use super::super::testing::sample;
    use super::*;
    use crate::frames::{Attitude, Field, Level};

    /// At a tilt, in an aircraft of some iron.
    fn at(heading_rad: f32, roll_deg: f32, pitch_deg: f32, iron: &Matrix3<f32>) -> Sample {
        let attitude = Attitude::from_deg(roll_deg, pitch_deg);
        let body = attitude.body(Field::<Level>::earth(50.0, 1.1, heading_rad)).ut;
        let field = iron * body + Vector3::new(60.0, -45.0, 80.0);
        Sample { attitude, ..sample(field.into(), 0) }
    }

    /// Sixty samples all round, tilted by up to 20 deg to all sides.
    fn varied(iron: &Matrix3<f32>) -> Vec<Sample> {
        let mut random = Random(3);
        (0..60)
            .map(|_| {
                let heading_rad = random.uniform(0.0, TAU);
                at(heading_rad, random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0), iron)
            })
            .collect()
    }

    fn weakest_of(samples: &[Sample]) -> Option<usize> {
        let mut spread = Spread::NONE;
        spread.weakest(Samples { left: samples, ..Samples::default() })
    }

    /// One of many alike, wherever they are.
    #[test]
    fn what_is_there_many_times_tells_least() {
        for first in [0, 20, 60] {
            let mut samples = varied(&Matrix3::identity());
            samples.splice(first..first, vec![at(1.0, 0.0, 0.0, &Matrix3::identity()); 40]);
            let place = weakest_of(&samples).unwrap();
            assert!((first..first + 40).contains(&place), "{first} {place}");
        }
    }

    /// Neither the one that is tilted the most, of the others level, nor the one at another heading.
    #[test]
    fn what_is_there_once_stays() {
        let level = |i: u8| at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity());
        for rare in [at(0.3, 15.0, 0.0, &Matrix3::identity()), at(0.3, 0.0, -15.0, &Matrix3::identity())] {
            let mut samples: Vec<Sample> = (0..40).map(level).collect();
            samples.insert(7, rare);
            while samples.len() > 13 {
                let place = weakest_of(&samples).unwrap();
                assert_ne!(samples.remove(place), rare, "of {}", samples.len());
            }
        }
    }

    /// Iron that bends the readings by up to 20 deg and a third: most of what is kept is the same.
    #[test]
    fn iron_changes_little_of_what_a_sample_is_worth() {
        let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
        let kept = [Matrix3::identity(), bent].map(|iron| {
            let mut samples: Vec<(usize, Sample)> = varied(&iron).into_iter().enumerate().collect();
            while samples.len() > 20 {
                let bare: Vec<Sample> = samples.iter().map(|&(_, sample)| sample).collect();
                samples.remove(weakest_of(&bare).unwrap());
            }
            samples.into_iter().map(|(number, _)| number).collect::<Vec<_>>()
        });
        let both = kept[0].iter().filter(|number| kept[1].contains(number)).count();
        // By chance it would be 7.
        assert!(both >= 12, "{both} of 20");
    }

    /// The same reading at another attitude says something else of the dip; one that is the stronger by noise alone says
    /// nothing else: among its like it goes as they do.
    #[test]
    fn another_attitude_counts_and_noise_of_the_strength_does_not() {
        let level: Vec<Sample> =
            (0..40).map(|i: u8| at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity())).collect();
        let tilted = Sample { attitude: Attitude::from_deg(8.0, 0.0), ..level[3] };
        let mut samples = level;
        samples.push(tilted);
        for _ in 0..20 {
            let place = weakest_of(&samples).unwrap();
            assert_ne!(samples.remove(place), tilted);
        }
        // Twice each of a varied flight, the second 2 % stronger: they go as often as the others do, not less.
        let samples = varied(&Matrix3::identity());
        let centre_ut = Vector3::new(60.0, -45.0, 80.0);
        let stronger = |s: &Sample| Sample { field: Field::new(centre_ut + (s.field.ut - centre_ut) * 1.02), ..*s };
        let mut both: Vec<(bool, Sample)> = samples.iter().flat_map(|s| [(false, *s), (true, stronger(s))]).collect();
        while both.len() > 60 {
            let bare: Vec<Sample> = both.iter().map(|&(_, sample)| sample).collect();
            both.remove(weakest_of(&bare).unwrap());
        }
        let kept = both.iter().filter(|(is_stronger, _)| *is_stronger).count();
        assert!((22..=38).contains(&kept), "{kept} of 60");
    }

    /// Of samples that are all as good as each other all round, the new one goes, and not by the order of its place alone:
    /// with a tenth more tilt it seems worth more by a fifth at most, with twice as much it is.
    #[test]
    fn what_is_new_must_be_clearly_worth_more() {
        let ring = |tilt_deg: f32| (0..40_u8).map(move |i| (f32::from(i) / 40.0 * TAU, tilt_deg));
        let others = ring(10.0).chain(ring(-10.0)).map(|(heading, roll)| at(heading, roll, 0.0, &Matrix3::identity()));
        let others: Vec<Sample> = others.collect();
        for (roll_deg, goes) in [(10.0, true), (10.6, true), (20.0, false)] {
            let new = at(0.05, roll_deg, 0.0, &Matrix3::identity());
            let samples: Vec<Sample> = core::iter::once(new).chain(others.iter().copied()).collect();
            assert_eq!(weakest_of(&samples) == Some(0), goes, "{roll_deg}");
        }
    }

    /// What the look at one sample says is what a look at all of them with it says, next to the limit too; and before any
    /// look at all nothing is turned away.
    #[test]
    fn one_look_says_what_a_look_at_all_would() {
        let samples = varied(&Matrix3::identity());
        let mut known = Spread::NONE;
        assert!(known.may_gain(&samples[0]));
        known.weakest(Samples { left: &samples, ..Samples::default() }).unwrap();
        let mut random = Random(5);
        let mut said = [0; 2];
        for _ in 0..200 {
            let tilt_deg = random.uniform(0.0, 14.0);
            let sample = at(random.uniform(0.0, TAU), tilt_deg, -tilt_deg, &Matrix3::identity());
            let all = [&[sample], &samples[..]].concat();
            let gains = weakest_of(&all) != Some(0);
            said[usize::from(gains)] += 1;
            assert!(!gains || known.may_gain(&sample), "{tilt_deg}");
        }
        assert!(said.iter().all(|&times| times > 20), "{said:?}");
        let inside = at(0.3, 0.0, 0.0, &Matrix3::identity());
        assert!(!known.may_gain(&inside));
        assert_eq!(weakest_of(&[&[inside], &samples[..]].concat()), Some(0));
        let no_number = Sample { field: Field::from_ut(f32::NAN, 0.0, 0.0), ..inside };
        assert!(known.may_gain(&no_number), "the caller knows what to do with it");
    }

    /// Coefficients of an aircraft of some iron as a trial solve would find them: its inverse, to a determinant of one.
    fn learnt(iron: &Matrix3<f32>, of_reading: f32) -> View {
        let w = iron.try_inverse().unwrap();
        let w = w / w.determinant().cbrt();
        let calibration = Calibration {
            w: core::array::from_fn(|i| core::array::from_fn(|j| w[(i, j)])),
            b_ut: [60.0, -45.0, 80.0],
            inclination_rad: 1.1,
            ..View::NONE.calibration
        };
        View { calibration, of_reading, new: 0.9, is_learnt: true }
    }

    /// Noise of 1 % of the field or 0.6 deg of attitude, to either side, changes nothing of what a sample says where the
    /// coefficients are known and the noise is whose it is said to be, but as much as its square; by a sphere in an aircraft
    /// whose iron bends the readings by up to 20 deg, and where it is taken for the other's, it does.
    #[test]
    fn noise_that_a_solve_sees_says_nothing() {
        const NOISE: f32 = 0.01;
        let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
        let centre_ut = Vector3::new(60.0, -45.0, 80.0);
        let by_sphere = View::from_centre(centre_ut);
        // What the dip's row changes by, of its size, at the most.
        let change = |view: &View, noisy: &dyn Fn(&Sample) -> Sample| {
            varied(&bent)
                .iter()
                .map(|sample| {
                    let [before, after] = [sample, &noisy(sample)].map(|sample| view.rows(sample)[1].dense());
                    (after - before).norm() / before.norm()
                })
                .fold(0.0, f32::max)
        };
        for size in [NOISE, -NOISE] {
            let of_reading = |sample: &Sample| {
                // Of the corrected field, across it, towards the vertical.
                let body = bent.try_inverse().unwrap() * (sample.field.ut - centre_ut);
                let down = sample.attitude.tilt().down();
                let towards_down = (down - body * (down.dot(&body) / body.norm_squared())).normalize();
                let field = Field::new(sample.field.ut + bent * towards_down * (50.0 * size));
                Sample { field, ..*sample }
            };
            let of_attitude = |sample: &Sample| {
                let body = bent.try_inverse().unwrap() * (sample.field.ut - centre_ut);
                let [by_roll, by_pitch] =
                    Prediction::new(body, &body, &sample.attitude.tilt()).dip_by_attitude(&sample.attitude.tilt());
                let Attitude { roll_rad, pitch_rad } = sample.attitude;
                let attitude = Attitude { roll_rad: roll_rad + by_roll * size, pitch_rad: pitch_rad + by_pitch * size };
                Sample { attitude, ..*sample }
            };
            // A hundredth of a radian and its square, of rows that turn by it and grow with the dip.
            assert!(change(&learnt(&bent, 1.0), &of_reading) < 0.1 * NOISE);
            assert!(change(&learnt(&bent, 0.0), &of_attitude) < 0.1 * NOISE);
            assert!(change(&learnt(&bent, 0.0), &of_reading) > 0.5 * NOISE);
            assert!(change(&by_sphere, &of_attitude) > 0.1 * NOISE);
        }
    }

    /// With coefficients all are looked at by them, other sets' too; what was known of the set before is forgotten.
    #[test]
    fn what_is_learnt_is_how_all_are_seen() {
        let samples = varied(&Matrix3::identity());
        let mut spread = Spread::NONE;
        spread.weakest(Samples { left: &samples, ..Samples::default() }).unwrap();
        let inside = at(0.3, 0.0, 0.0, &Matrix3::identity());
        assert!(!spread.may_gain(&inside));
        let Calibration { b_ut: before_ut, .. } = spread.view.calibration;
        spread.see(learnt(&Matrix3::identity(), 0.5));
        assert!(spread.may_gain(&inside));
        spread.weakest(Samples { left: &samples, ..Samples::default() }).unwrap();
        assert!(!spread.may_gain(&inside));
        assert_ne!(
            before_ut.map(f32::to_bits),
            spread.view.calibration.b_ut.map(f32::to_bits),
            "nor is it a sphere again"
        );
        let mut others = spread.of_others();
        assert_eq!(others.view.calibration, spread.view.calibration);
        assert!(others.may_gain(&inside), "what these tell, those do not");
        others.forget();
        assert_eq!(others.view.calibration, View::NONE.calibration);
    }

    #[test]
    fn of_readings_that_are_all_alike_nothing_can_be_told() {
        assert_eq!(weakest_of(&[]), None);
        assert_eq!(weakest_of(&vec![sample([20.0, 0.0, 40.0], 0); 30]), None);
    }
}

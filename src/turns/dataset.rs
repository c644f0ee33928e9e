//! Samples of left and right turns in buffers of fixed capacity, evenly spread over heading.
//!
//! The heading is not known while a compass is being calibrated, and hard iron several times the horizontal field turns
//! the raw direction into a few degrees to and fro. What is known is that a turn at constant bank is a plane ellipse in
//! sensor space. So each side's samples are projected on their own principal plane, a circle is fitted there, and the
//! angle about its centre divides the turn into sectors. No axis convention enters: a wrongly configured mounting
//! collects as well as a right one.

use nalgebra::{Matrix3, SymmetricEigen, Vector2, Vector3};

use crate::calibration::{Sample, Samples, Side};

/// Sectors a turn is divided into, 30 deg each.
pub const SECTORS: usize = 12;

/// Samples for the fit, a side: 16 a sector. 4.6 KB.
pub const FIT_CAPACITY: usize = 192;

/// Samples held back for verification, a side: 5 a sector. 1.4 KB.
pub const HELD_BACK_CAPACITY: usize = 60;

/// Fixed numbers of the dataset.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Time between two samples, milliseconds. The errors of attitude sources stay alike for about 0.5 s, so more would
    /// only look like more.
    pub spacing_ms: u32,
    /// Every so many samples one is held back.
    pub hold_back_every: u16,
    /// A sector is filled with so many samples for the fit: it was passed about twice in a turn of 13 deg/s.
    pub sector_target: u16,
    /// and a side is complete when all its sectors are and it has so many samples: about three circles.
    pub side_target: u16,
    /// The circle must have this radius, microtesla, for its sectors to mean headings: a third of the horizontal field
    /// at 75 deg of inclination. Less is noise of a heading that is held.
    pub min_radius_ut: f32,
    /// and the heading is only told from noise with so many samples.
    pub min_samples: u16,
}

impl Config {
    /// Numbers for turns of 5 to 30 deg/s.
    pub const DEFAULT: Self = Self {
        spacing_ms: 400,
        hold_back_every: 4,
        sector_target: 8,
        side_target: 132,
        min_radius_ut: 4.0,
        min_samples: 10,
    };
}

/// How well one side is covered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Samples kept for the fit.
    pub samples: u16,
    /// Samples held back for verification.
    pub held_back: u16,
    /// Sectors with at least one sample, of [`SECTORS`].
    pub sectors: u8,
    /// How much of what the side needs is there, 0..100 percent.
    pub percent: u8,
}

impl Coverage {
    /// The side has all the samples it needs.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.percent >= 100
    }
}

/// The samples of both sides, each in the order of time.
#[derive(Debug)]
pub struct Dataset {
    config: Config,
    left: SideSamples,
    right: SideSamples,
}

impl Dataset {
    /// No samples.
    #[must_use]
    pub const fn new(config: Config) -> Self {
        Self { config, left: SideSamples::new(), right: SideSamples::new() }
    }

    /// Offers a sample of a turn; keeps it if it adds something.
    pub fn push(&mut self, side: Side, sample: Sample) {
        let config = self.config;
        self.side_mut(side).push(&config, sample);
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        for side in [Side::Left, Side::Right] {
            self.side_mut(side).clear();
        }
    }

    /// Samples to solve with.
    #[must_use]
    pub fn fit(&self) -> Samples<'_> {
        Samples { left: &self.left.fit, right: &self.right.fit, ..Samples::default() }
    }

    /// Samples to verify with; none of them is among those of [`fit`](Self::fit).
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        Samples { left: &self.left.held_back, right: &self.right.held_back, ..Samples::default() }
    }

    /// How well a side is covered.
    #[must_use]
    pub fn coverage(&self, side: Side) -> Coverage {
        match side {
            Side::Left => self.left.coverage,
            Side::Right => self.right.coverage,
        }
    }

    fn side_mut(&mut self, side: Side) -> &mut SideSamples {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
        }
    }
}

#[derive(Debug)]
struct SideSamples {
    fit: heapless::Vec<Sample, FIT_CAPACITY>,
    held_back: heapless::Vec<Sample, HELD_BACK_CAPACITY>,
    /// Time of the last sample taken, and how many were.
    last: Option<(u32, u16)>,
    coverage: Coverage,
}

impl SideSamples {
    const fn new() -> Self {
        Self {
            fit: heapless::Vec::new(),
            held_back: heapless::Vec::new(),
            last: None,
            coverage: Coverage { samples: 0, held_back: 0, sectors: 0, percent: 0 },
        }
    }

    fn clear(&mut self) {
        // Not `*self = Self::new()`: that would build 6 KB on the stack.
        self.fit.clear();
        self.held_back.clear();
        self.last = None;
        self.coverage = Coverage::default();
    }

    fn push(&mut self, config: &Config, sample: Sample) {
        let too_soon = |(last_ms, _)| sample.time_ms.wrapping_sub(last_ms) < config.spacing_ms;
        if self.last.is_some_and(too_soon) || !sample.field.ut.iter().all(|c| c.is_finite()) {
            return;
        }
        let taken = self.last.map_or(0, |(_, taken)| taken);
        self.last = Some((sample.time_ms, taken.wrapping_add(1)));
        let circle = Circle::through(self.fit.iter().chain(&self.held_back));
        let sector_of = |s: &Sample| circle.map_or(0, |circle| circle.sector(s));
        if taken % config.hold_back_every == config.hold_back_every - 1 {
            insert(&mut self.held_back, sample, sector_of);
        } else {
            insert(&mut self.fit, sample, sector_of);
        }
        self.coverage = self.survey(config, circle);
    }

    fn survey(&self, config: &Config, circle: Option<Circle>) -> Coverage {
        let samples = self.fit.len() as u16;
        let held_back = self.held_back.len() as u16;
        let turned = circle.filter(|c| c.radius_ut >= config.min_radius_ut && samples >= config.min_samples);
        let Some(circle) = turned else { return Coverage { samples, held_back, sectors: 0, percent: 0 } };
        let counts = count(&self.fit, |s| circle.sector(s));
        let filled: u16 = counts.iter().map(|&n| n.min(config.sector_target)).sum();
        let by_sector = percent(filled, config.sector_target * SECTORS as u16);
        let by_number = percent(samples, config.side_target);
        Coverage {
            samples,
            held_back,
            sectors: counts.iter().filter(|&&n| n > 0).count() as u8,
            // A side that was complete stays so: a later sample can move the circle, and with it a sector's border past
            // another sample, but it takes nothing away.
            percent: if self.coverage.is_complete() { 100 } else { by_sector.min(by_number) },
        }
    }
}

/// `part` of `whole` in percent, at most 100.
fn percent(part: u16, whole: u16) -> u8 {
    (u32::from(part) * 100 / u32::from(whole).max(1)).min(100) as u8
}

/// Samples by sector.
fn count(samples: &[Sample], sector_of: impl Fn(&Sample) -> usize) -> [u16; SECTORS] {
    let mut counts = [0; SECTORS];
    for sample in samples {
        // `Circle::sector` is below SECTORS.
        if let Some(n) = counts.get_mut(sector_of(sample)) {
            *n += 1;
        }
    }
    counts
}

/// Puts a sample in; when there is no room, the oldest of the most crowded sector makes place for it, unless its own
/// sector is that one.
fn insert<const N: usize>(
    samples: &mut heapless::Vec<Sample, N>,
    sample: Sample,
    sector_of: impl Fn(&Sample) -> usize,
) {
    if samples.is_full() {
        let counts = count(samples, &sector_of);
        let crowded = (0..SECTORS).max_by_key(|&sector| counts[sector]).unwrap_or(0);
        if crowded == sector_of(&sample) {
            return;
        }
        if let Some(oldest) = samples.iter().position(|s| sector_of(s) == crowded) {
            samples.remove(oldest);
        }
    }
    // There is room: the most crowded sector of a full buffer is not empty.
    let _ = samples.push(sample);
}

/// A circle in the principal plane of a turn's samples.
#[derive(Clone, Copy, Debug)]
struct Circle {
    /// A point of the plane: the samples' mean.
    origin_ut: Vector3<f32>,
    /// Two directions that span it.
    axes: [Vector3<f32>; 2],
    /// The centre, in the plane's coordinates.
    centre_ut: Vector2<f32>,
    radius_ut: f32,
}

impl Circle {
    /// Least squares of `x^2 + y^2 + a x + b y + c` (Kasa's fit) in the plane of the largest two principal axes. An arc
    /// is enough; `None` while there is no arc to speak of.
    fn through<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<Self> {
        let fields = samples.map(|s| s.field.ut);
        let number = fields.clone().count() as f32;
        if number < 3.0 {
            return None;
        }
        let origin_ut = fields.clone().sum::<Vector3<f32>>() / number;
        let scatter: Matrix3<f32> = fields.clone().map(|f| (f - origin_ut) * (f - origin_ut).transpose()).sum();
        let axes = principal_axes(scatter)?;
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for field in fields {
            let p = axes.map(|axis| axis.dot(&(field - origin_ut)));
            let row = Vector3::new(p[0], p[1], 1.0);
            normal += row * row.transpose();
            right -= row * (p[0] * p[0] + p[1] * p[1]);
        }
        let solution = normal.cholesky()?.solve(&right);
        let centre_ut = Vector2::new(-solution.x / 2.0, -solution.y / 2.0);
        let radius_ut = libm::sqrtf((centre_ut.norm_squared() - solution.z).max(0.0));
        radius_ut.is_finite().then_some(Self { origin_ut, axes, centre_ut, radius_ut })
    }

    /// Which sector a sample lies in, 0..[`SECTORS`].
    fn sector(&self, sample: &Sample) -> usize {
        let p = self.axes.map(|axis| axis.dot(&(sample.field.ut - self.origin_ut)));
        let angle_rad = libm::atan2f(p[1] - self.centre_ut.y, p[0] - self.centre_ut.x);
        let turns = angle_rad / core::f32::consts::TAU + 0.5;
        // The cast saturates and takes NaN to 0, so the index is in range for every input.
        ((turns * SECTORS as f32) as usize).min(SECTORS - 1)
    }
}

/// The eigenvectors of the two largest eigenvalues.
fn principal_axes(scatter: Matrix3<f32>) -> Option<[Vector3<f32>; 2]> {
    // A bound on iterations, because the unbounded variant never ends on what is not finite.
    let eigen = SymmetricEigen::try_new(scatter, f32::EPSILON, 100)?;
    let smallest = eigen.eigenvalues.imin();
    Some([1, 2].map(|step| eigen.eigenvectors.column((smallest + step) % 3).into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Attitude, Field, Level};

    const HARD_IRON_UT: Vector3<f32> = Vector3::new(60.0, -45.0, 80.0);

    /// A turn as a sensor sees it: 20 uT horizontal, 45 down, hard iron five times that, 1 deg of bank wander.
    fn turn(roll_deg: f32, from_s: u16, to_s: u16, rate_deg_s: f32) -> impl Iterator<Item = Sample> {
        (from_s * 10..to_s * 10).map(move |i| {
            let t_s = f32::from(i) / 10.0;
            let attitude = Attitude::from_deg(roll_deg + (t_s * 4.2).sin(), 2.0);
            let body = attitude.body(Field::<Level>::earth(49.2, 1.152, (rate_deg_s * t_s).to_radians()));
            Sample { field: Field::new(body.ut + HARD_IRON_UT), attitude, time_ms: u32::from(i) * 100 }
        })
    }

    fn collect(samples: impl Iterator<Item = Sample>) -> Dataset {
        let mut dataset = Dataset::new(Config::DEFAULT);
        for sample in samples {
            dataset.push(Side::Right, sample);
        }
        dataset
    }

    #[test]
    fn three_circles_fill_a_side_in_spite_of_the_hard_iron() {
        // 28 s a circle. Half a circle is 6 of 12 sectors, one more where it ends inside one.
        let half = collect(turn(25.0, 0, 14, 13.0)).coverage(Side::Right);
        assert!((6..=8).contains(&half.sectors), "{half:?}");
        assert!(!half.is_complete());
        let full = collect(turn(25.0, 0, 84, 13.0)).coverage(Side::Right);
        assert_eq!((full.sectors, full.percent), (12, 100), "{full:?}");
    }

    #[test]
    fn a_complete_side_stays_complete() {
        for tenths in 100..200_u16 {
            let mut dataset = Dataset::new(Config::DEFAULT);
            let mut completed = false;
            for sample in turn(25.0, 0, 150, f32::from(tenths) / 10.0) {
                dataset.push(Side::Right, sample);
                let complete = dataset.coverage(Side::Right).is_complete();
                assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time_ms);
                completed = complete;
            }
            assert!(completed);
        }
    }

    #[test]
    fn a_held_heading_is_no_coverage_however_long() {
        let straight = collect(turn(25.0, 0, 300, 0.0)).coverage(Side::Right);
        // Bank wander draws a short line, which is an arc of two sectors at most.
        assert!(straight.sectors <= 2 && straight.percent < 20, "{straight:?}");
    }

    #[test]
    fn a_full_buffer_makes_room_for_headings_it_lacks() {
        // Ten minutes to and fro over a third of the circle, then one circle: the new headings must all come in.
        let third = (0..12).flat_map(|i| turn(25.0, i * 50, i * 50 + 9, 13.0));
        let later = turn(25.0, 700, 728, 13.0);
        let dataset = collect(third.chain(later));
        let coverage = dataset.coverage(Side::Right);
        assert_eq!(coverage.samples as usize, FIT_CAPACITY, "the buffer was full");
        assert_eq!(coverage.sectors, 12);
        assert!(dataset.fit().right.is_sorted_by_key(|s| s.time_ms));
    }

    #[test]
    fn held_back_samples_are_apart_from_those_of_the_fit_and_as_well_spread() {
        let dataset = collect(turn(25.0, 0, 120, 13.0));
        let (fit, held) = (dataset.fit().right, dataset.held_back().right);
        assert!(held.iter().all(|h| fit.iter().all(|f| f.time_ms != h.time_ms)));
        let circle = Circle::through(held.iter()).unwrap();
        assert!(count(held, |s| circle.sector(s)).iter().all(|&n| n >= 2));
    }

    #[test]
    fn nothing_a_sensor_could_say_panics() {
        let values = [0.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, -400.0];
        let samples = (0..600_u32).map(|i| Sample {
            field: Field::from_ut(values[i as usize % 6], values[i as usize / 6 % 6], values[i as usize / 36 % 6]),
            attitude: Attitude::from_deg(25.0, 0.0),
            time_ms: i * 400,
        });
        assert!(collect(samples).coverage(Side::Right).samples > 0);
    }
}

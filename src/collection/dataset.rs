//! Samples of left and right turns in buffers of fixed capacity, evenly spread over heading.
//!
//! What a sample adds depends on where it lies on the side's circle (`circle.rs`), and for samples of all attitudes on
//! how far it is from the others.

use super::circle::Circle;
use crate::calibration::{Part, Sample, Samples, Side};
use crate::time::WrappingMillis;

/// Sectors a turn is divided into, 30 deg each.
pub const SECTORS: usize = 12;

/// Samples for the fit, a side: 16 a sector. 4.6 KB.
pub const FIT_CAPACITY: usize = 192;

/// Samples held back for verification, a side: 5 a sector. 1.4 KB.
pub const HELD_BACK_CAPACITY: usize = 60;

/// Samples of level flight for the fit: 5 a sector. 1.5 KB.
pub const LEVEL_FIT_CAPACITY: usize = 64;

/// Samples of level flight held back. 0.5 KB.
pub const LEVEL_HELD_BACK_CAPACITY: usize = 20;

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
    /// Samples of all attitudes are so far apart, microtesla: a thirtieth of a circle in a weak field.
    pub apart_ut: f32,
    /// When there is no room for more of them, this is multiplied by so much and the crowded ones go.
    pub apart_growth: f32,
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
        apart_ut: 5.0,
        apart_growth: 1.3,
    };

    /// For level flight, whose part is smaller: two circles.
    const LEVEL: Self = Self { sector_target: 4, side_target: 48, ..Self::DEFAULT };
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

/// The samples of both sides and of level flight, each in the order of time.
#[derive(Debug)]
pub struct Dataset {
    left: PartSamples<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    right: PartSamples<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    level: PartSamples<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
    /// Distance that samples of all attitudes keep now, microtesla.
    apart_ut: f32,
}

impl Dataset {
    /// No samples.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            left: PartSamples::new(),
            right: PartSamples::new(),
            level: PartSamples::new(),
            apart_ut: Config::DEFAULT.apart_ut,
        }
    }

    /// Offers a sample of a turn; keeps it if it adds something.
    pub fn push_turn(&mut self, side: Side, sample: Sample) {
        match side {
            Side::Left => self.left.push(&Config::DEFAULT, sample),
            Side::Right => self.right.push(&Config::DEFAULT, sample),
        }
    }

    /// Offers a sample of level flight; keeps it if it adds something.
    pub fn push_level(&mut self, sample: Sample) {
        self.level.push(&Config::LEVEL, sample);
    }

    /// Offers a sample of whatever attitude; keeps it if it is far from the others. They lie where left turns would, of
    /// which there are none then.
    pub fn push_any(&mut self, sample: Sample) {
        self.left.push_apart(&Config::DEFAULT, &mut self.apart_ut, sample);
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.left.clear();
        self.right.clear();
        self.level.clear();
        self.apart_ut = Config::DEFAULT.apart_ut;
    }

    /// Samples to solve with, without marks.
    #[must_use]
    pub fn fit(&self) -> Samples<'_> {
        Samples { left: &self.left.fit, right: &self.right.fit, level: &self.level.fit, marks: &[] }
    }

    /// Samples to verify with; none of them is among those of [`fit`](Self::fit).
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        Samples { left: &self.left.held_back, right: &self.right.held_back, level: &self.level.held_back, marks: &[] }
    }

    /// How well a part is covered.
    #[must_use]
    pub fn coverage(&self, part: Part) -> Coverage {
        match part {
            Part::Turns(Side::Right) => self.right.coverage,
            Part::Level => self.level.coverage,
            Part::Turns(Side::Left) | Part::All | Part::Marks => self.left.coverage,
        }
    }
}

impl Default for Dataset {
    fn default() -> Self {
        Self::new()
    }
}

#[derive(Debug)]
struct PartSamples<const FIT: usize, const HELD: usize> {
    fit: heapless::Vec<Sample, FIT>,
    held_back: heapless::Vec<Sample, HELD>,
    /// Time of the last sample taken, and how many were.
    last: Option<(WrappingMillis, u16)>,
    coverage: Coverage,
}

impl<const FIT: usize, const HELD: usize> PartSamples<FIT, HELD> {
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
        let too_soon = |(last, _)| sample.time.since(last) < config.spacing_ms;
        if self.last.is_some_and(too_soon) || !sample.field.ut.iter().all(|c| c.is_finite()) {
            return;
        }
        let taken = self.last.map_or(0, |(_, taken)| taken);
        self.last = Some((sample.time, taken.wrapping_add(1)));
        let circle = Circle::through(&Samples { left: &self.fit, right: &self.held_back, ..Samples::default() });
        let sector_of = |s: &Sample| circle.map_or(0, |circle| circle.sector(s));
        if taken % config.hold_back_every == config.hold_back_every - 1 {
            insert(&mut self.held_back, sample, sector_of);
        } else {
            insert(&mut self.fit, sample, sector_of);
        }
        self.coverage = self.survey(config, circle);
    }

    /// As [`push`](Self::push), but what counts is the distance from the samples there are.
    fn push_apart(&mut self, config: &Config, apart_ut: &mut f32, sample: Sample) {
        if self.last.is_some_and(|(last, _)| sample.time.since(last) < config.spacing_ms) {
            return;
        }
        // What is not finite is near to nothing and far from nothing.
        let is_apart =
            |from: &[Sample], apart_ut: f32| from.iter().all(|s| (s.field.ut - sample.field.ut).norm() >= apart_ut);
        if !(sample.field.ut.iter().all(|c| c.is_finite())
            && is_apart(&self.fit, *apart_ut)
            && is_apart(&self.held_back, *apart_ut))
        {
            return;
        }
        let taken = self.last.map_or(0, |(_, taken)| taken);
        self.last = Some((sample.time, taken.wrapping_add(1)));
        if taken % config.hold_back_every == config.hold_back_every - 1 && !self.held_back.is_full() {
            let _ = self.held_back.push(sample);
        } else {
            if self.fit.is_full() {
                *apart_ut *= config.apart_growth;
                thin(&mut self.fit, *apart_ut);
            }
            // If thinning made no room, the samples are spread as they should be without this one.
            let _ = self.fit.push(sample);
        }
        let samples = self.fit.len() as u16;
        let held_back = self.held_back.len() as u16;
        self.coverage = Coverage { samples, held_back, sectors: 0, percent: percent(samples, config.side_target / 2) };
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
            // A part that was complete stays so: a later sample can move the circle, and with it a sector's border past
            // another sample, but it takes nothing away.
            percent: if self.coverage.is_complete() { 100 } else { by_sector.min(by_number) },
        }
    }
}

/// Removes every sample that is nearer than `apart_ut` to one before it.
fn thin<const N: usize>(samples: &mut heapless::Vec<Sample, N>, apart_ut: f32) {
    let mut i = 0;
    while let Some(sample) = samples.get(i).copied() {
        let crowded = samples.iter().take(i).any(|s| (s.field.ut - sample.field.ut).norm() < apart_ut);
        if crowded {
            samples.remove(i);
        } else {
            i += 1;
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

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::frames::{Attitude, Field, Level};

    const RIGHT: Part = Part::Turns(Side::Right);

    const HARD_IRON_UT: Vector3<f32> = Vector3::new(60.0, -45.0, 80.0);

    /// A turn as a sensor sees it: 20 uT horizontal, 45 down, hard iron five times that, 1 deg of bank wander.
    fn turn(roll_deg: f32, from_s: u16, to_s: u16, rate_deg_s: f32) -> impl Iterator<Item = Sample> {
        (from_s * 10..to_s * 10).map(move |i| {
            let t_s = f32::from(i) / 10.0;
            let attitude = Attitude::from_deg(roll_deg + (t_s * 4.2).sin(), 2.0);
            let body = attitude.body(Field::<Level>::earth(49.2, 1.152, (rate_deg_s * t_s).to_radians()));
            Sample {
                field: Field::new(body.ut + HARD_IRON_UT),
                attitude,
                time: WrappingMillis::new(u32::from(i) * 100),
            }
        })
    }

    fn collect(samples: impl Iterator<Item = Sample>) -> Dataset {
        let mut dataset = Dataset::new();
        for sample in samples {
            dataset.push_turn(Side::Right, sample);
        }
        dataset
    }

    #[test]
    fn three_circles_fill_a_side_in_spite_of_the_hard_iron() {
        // 28 s a circle. Half a circle is 6 of 12 sectors, one more where it ends inside one.
        let half = collect(turn(25.0, 0, 14, 13.0)).coverage(RIGHT);
        assert!((6..=8).contains(&half.sectors), "{half:?}");
        assert!(!half.is_complete());
        let full = collect(turn(25.0, 0, 84, 13.0)).coverage(RIGHT);
        assert_eq!((full.sectors, full.percent), (12, 100), "{full:?}");
    }

    #[test]
    fn a_complete_side_stays_complete() {
        for tenths in 100..200_u16 {
            let mut dataset = Dataset::new();
            let mut completed = false;
            for sample in turn(25.0, 0, 150, f32::from(tenths) / 10.0) {
                dataset.push_turn(Side::Right, sample);
                let complete = dataset.coverage(RIGHT).is_complete();
                assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time.count());
                completed = complete;
            }
            assert!(completed);
        }
    }

    #[test]
    fn a_held_heading_is_no_coverage_however_long() {
        let straight = collect(turn(25.0, 0, 300, 0.0)).coverage(RIGHT);
        // Bank wander draws a short line, which is an arc of two sectors at most.
        assert!(straight.sectors <= 2 && straight.percent < 20, "{straight:?}");
    }

    #[test]
    fn a_full_buffer_makes_room_for_headings_it_lacks() {
        // Ten minutes to and fro over a third of the circle, then one circle: the new headings must all come in.
        let third = (0..12).flat_map(|i| turn(25.0, i * 50, i * 50 + 9, 13.0));
        let later = turn(25.0, 700, 728, 13.0);
        let dataset = collect(third.chain(later));
        let coverage = dataset.coverage(RIGHT);
        assert_eq!(coverage.samples as usize, FIT_CAPACITY, "the buffer was full");
        assert_eq!(coverage.sectors, 12);
        assert!(dataset.fit().right.is_sorted_by_key(|s| s.time.count()));
    }

    #[test]
    fn held_back_samples_are_apart_from_those_of_the_fit_and_as_well_spread() {
        let dataset = collect(turn(25.0, 0, 120, 13.0));
        let (fit, held) = (dataset.fit().right, dataset.held_back().right);
        assert!(held.iter().all(|h| fit.iter().all(|f| f.time != h.time)));
        let circle = Circle::through(&Samples { left: held, ..Samples::default() }).unwrap();
        assert!(count(held, |s| circle.sector(s)).iter().all(|&n| n >= 2));
    }

    #[test]
    fn nothing_a_sensor_could_say_panics() {
        let values = [0.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, -400.0];
        let samples = (0..600_u32).map(|i| Sample {
            field: Field::from_ut(values[i as usize % 6], values[i as usize / 6 % 6], values[i as usize / 36 % 6]),
            attitude: Attitude::from_deg(25.0, 0.0),
            time: WrappingMillis::new(i * 400),
        });
        assert!(collect(samples).coverage(RIGHT).samples > 0);
    }
}

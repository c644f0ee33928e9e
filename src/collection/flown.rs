//! What was flown since a collection began, kept or not: a person who is refused is told what was wrong with it.

use core::fmt;

use super::Progress;
use super::dataset::SECTORS;
use super::detector::Config;
use crate::calibration::{Manoeuvre, Sample, Side};
use crate::frames::Attitude;
use crate::time::WrappingMillis;
use crate::wire::decimal::Decimal;

/// Why samples of turns are missing, or show too little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lack {
    /// Samples come too far apart to follow a turn.
    TooSlow {
        /// Their mean distance, seconds.
        every_s: f32,
    },
    /// The attitude shows next to no tilt: nothing is flown, or it is in other units.
    NoTilt {
        /// The most it shows, degrees.
        most_deg: f32,
    },
    /// Banks were too small, or not held.
    LittleTilt {
        /// The most tilt, degrees.
        most_deg: f32,
    },
    /// Only turns to this side were flown.
    OneSide(Side),
    /// The turns to this side are only an arc, however many samples they have: they were turned too slowly, or not
    /// round.
    Arc {
        /// The side.
        side: Side,
        /// How much of the circle, of [`SECTORS`].
        sectors: u8,
    },
    /// This would tell most of what is still unknown.
    Missing(Manoeuvre),
}

/// What to do otherwise, in words.
impl fmt::Display for Lack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooSlow { every_s } => {
                write!(f, "a sample comes every {} s, too slow for turns; ", Decimal::<1>(every_s))?;
                f.write_str("send field and attitude ten times a second")
            }
            Self::NoTilt { most_deg } => {
                write!(
                    f,
                    "the attitude tilts by {} deg at most; tilt by 15 deg or more to both sides, ",
                    Decimal::<1>(most_deg)
                )?;
                f.write_str("or if that was flown, check its unit: radians for degrees?")
            }
            Self::LittleTilt { most_deg } => {
                write!(
                    f,
                    "too little bank, {} deg at most; fly turns at 15 deg of bank or more each way",
                    Decimal::<1>(most_deg)
                )
            }
            Self::OneSide(side) => {
                let other = if side == Side::Left { Side::Right } else { Side::Left };
                write!(f, "only {} turns were flown; fly {} turns, too", side.name(), other.name())
            }
            Self::Arc { side, sectors } => {
                write!(
                    f,
                    "the {} turns went through {sectors} of {SECTORS} sectors, too slow or too short; ",
                    side.name()
                )?;
                f.write_str("fly full circles")
            }
            Self::Missing(manoeuvre) => write!(f, "missing: {manoeuvre}"),
        }
    }
}

/// Fixed numbers.
const LIMITS: Limits = Limits {
    settle_ms: 1000,
    enough: 20,
    enough_ms: 20_000,
    no_tilt_rad: 2_f32.to_radians(),
    held_ms: 5000,
    arc_samples: 60,
    arc_sectors: 8,
};

struct Limits {
    /// Tilt is a mean of about so long, milliseconds: gusts are no turns.
    settle_ms: u32,
    /// Of fewer samples nothing is said.
    enough: u32,
    /// Nor of a shorter time, milliseconds.
    enough_ms: u32,
    /// Less than any flight, radians; 90 deg in radians, taken for degrees, are 1.6.
    no_tilt_rad: f32,
    /// A side was flown when it was banked to for so long, milliseconds: gusts do that for a second or two.
    held_ms: u32,
    /// So many samples are 32 s of turning at the least.
    arc_samples: u16,
    /// No more of the circle than this in that time: slower than 8 deg/s, and not round.
    arc_sectors: u8,
}

/// What was flown. 40 bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flown {
    samples: u32,
    /// Samples so far from the one before that no turn lasts over it.
    gaps: u32,
    last: Option<WrappingMillis>,
    lasted_ms: u32,
    /// Mean of the last second.
    attitude: Attitude,
    most_rad: f32,
    left_ms: u32,
    right_ms: u32,
}

impl Flown {
    pub const NOTHING: Self = Self {
        samples: 0,
        gaps: 0,
        last: None,
        lasted_ms: 0,
        attitude: Attitude { roll_rad: 0.0, pitch_rad: 0.0 },
        most_rad: 0.0,
        left_ms: 0,
        right_ms: 0,
    };

    /// What of it outlives a restart: all that is counted.
    pub fn words(&self) -> [u32; 6] {
        let Self { samples, gaps, lasted_ms, most_rad, left_ms, right_ms, .. } = *self;
        [samples, gaps, lasted_ms, most_rad.to_bits(), left_ms, right_ms]
    }

    /// What was flown before a restart, by these words.
    pub const fn from_words([samples, gaps, lasted_ms, most_rad, left_ms, right_ms]: [u32; 6]) -> Self {
        let most_rad = f32::from_bits(most_rad);
        Self { samples, gaps, lasted_ms, most_rad, left_ms, right_ms, ..Self::NOTHING }
    }

    /// When the last sample was taken.
    pub fn last(&self) -> Option<WrappingMillis> {
        self.last
    }

    /// Takes the next sample in time.
    pub fn push(&mut self, sample: &Sample) {
        let Attitude { roll_rad, pitch_rad } = sample.attitude;
        if !(roll_rad.is_finite() && pitch_rad.is_finite()) {
            return;
        }
        self.samples = self.samples.saturating_add(1);
        let Some(last) = self.last.replace(sample.time) else {
            self.attitude = sample.attitude;
            return;
        };
        let step_ms = sample.time.since(last);
        self.lasted_ms = self.lasted_ms.saturating_add(step_ms);
        self.gaps += u32::from(step_ms > Config::DEFAULT.max_gap_ms);
        let share = step_ms as f32 / (step_ms as f32 + LIMITS.settle_ms as f32);
        self.attitude.roll_rad += share * (roll_rad - self.attitude.roll_rad);
        self.attitude.pitch_rad += share * (pitch_rad - self.attitude.pitch_rad);
        let Attitude { roll_rad, pitch_rad } = self.attitude;
        self.most_rad = self.most_rad.max(libm::fabsf(roll_rad)).max(libm::fabsf(pitch_rad));
        if libm::fabsf(roll_rad) >= Config::DEFAULT.enter_roll_rad {
            let side_ms = if roll_rad < 0.0 { &mut self.left_ms } else { &mut self.right_ms };
            *side_ms = side_ms.saturating_add(step_ms);
        }
    }

    /// Whether there is enough of it to say anything.
    fn is_enough(&self) -> bool {
        self.samples >= LIMITS.enough && self.lasted_ms >= LIMITS.enough_ms
    }

    /// That it hardly tilted, however it was flown.
    pub fn no_tilt(&self) -> Option<Lack> {
        let is_so = self.is_enough() && self.most_rad < LIMITS.no_tilt_rad;
        is_so.then(|| Lack::NoTilt { most_deg: self.most_rad.to_degrees() })
    }

    /// What was wrong with it as turns, of which so much was kept; nothing if that cannot be said.
    pub fn lack(&self, progress: &Progress) -> Option<Lack> {
        let Limits { held_ms, arc_samples, arc_sectors, .. } = LIMITS;
        if !self.is_enough() {
            return None;
        }
        if 2 * u64::from(self.gaps) > u64::from(self.samples) {
            return Some(Lack::TooSlow { every_s: self.lasted_ms as f32 / self.samples as f32 / 1e3 });
        }
        if let Some(lack) = self.no_tilt() {
            return Some(lack);
        }
        let most_deg = self.most_rad.to_degrees();
        match (self.left_ms >= held_ms, self.right_ms >= held_ms) {
            (false, false) => return Some(Lack::LittleTilt { most_deg }),
            (true, false) => return Some(Lack::OneSide(Side::Left)),
            (false, true) => return Some(Lack::OneSide(Side::Right)),
            (true, true) => {}
        }
        [(Side::Left, progress.left), (Side::Right, progress.right)].into_iter().find_map(|(side, kept)| {
            let is_arc = kept.samples >= arc_samples && kept.sectors <= arc_sectors;
            is_arc.then_some(Lack::Arc { side, sectors: kept.sectors })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Collector;
    use super::super::testing::{banked, memory, turn};
    use super::*;
    use crate::calibration::ladder::Procedure;

    /// Banks held for so many seconds each, a sample every so many milliseconds.
    fn flown(step_ms: u32, banks: &[(f32, u32)]) -> Option<Lack> {
        let mut flown = Flown::NOTHING;
        let mut time_ms = u32::MAX - 5000;
        for &(roll_deg, seconds) in banks {
            for _ in 0..seconds * 1000 / step_ms {
                flown.push(&banked(roll_deg, 0.0, time_ms));
                time_ms = time_ms.wrapping_add(step_ms);
            }
        }
        flown.lack(&Progress::default())
    }

    /// Turns of 2 s and more between samples are not seen to last; half a second is as far as a turn goes on.
    #[test]
    fn samples_too_far_apart_are_too_slow() {
        let turns = [(-25.0, 60), (25.0, 60)];
        assert_eq!(flown(500, &turns), None);
        let Some(Lack::TooSlow { every_s }) = flown(510, &turns) else { panic!() };
        assert!((every_s - 0.51).abs() < 0.01, "{every_s}");
        // More than half of them.
        let mixed = |slow: u32| {
            let mut flown = Flown::NOTHING;
            let mut time_ms = 0;
            for i in 0..100 {
                time_ms += if i % 20 < slow { 1000 } else { 100 };
                flown.push(&banked(if i < 50 { 25.0 } else { -25.0 }, 0.0, time_ms));
            }
            flown.lack(&Progress::default())
        };
        assert!(
            matches!((mixed(10), mixed(11)), (None, Some(Lack::TooSlow { .. }))),
            "{:?} {:?}",
            mixed(10),
            mixed(11)
        );
    }

    /// 45 deg are 0.8 in radians.
    #[test]
    fn an_attitude_that_hardly_tilts_may_be_in_radians() {
        assert!(
            matches!(flown(100, &[(-0.8, 60), (0.8, 60)]), Some(Lack::NoTilt { most_deg }) if (most_deg - 0.8).abs() < 0.01)
        );
        assert!(matches!(flown(100, &[(-1.9, 60), (1.9, 60)]), Some(Lack::NoTilt { .. })));
        assert!(matches!(flown(100, &[(-2.1, 60), (2.1, 60)]), Some(Lack::LittleTilt { .. })));
        // Pitch is tilt, too.
        let mut flown = Flown::NOTHING;
        (0..300).for_each(|i| flown.push(&banked(0.0, -15.0, i * 100)));
        assert!(matches!(flown.lack(&Progress::default()), Some(Lack::LittleTilt { most_deg }) if most_deg > 14.0));
    }

    /// From 10 deg on, for 5 s; the mean of a second comes a little later.
    #[test]
    fn banks_that_are_small_or_short_are_too_little() {
        assert!(
            matches!(flown(100, &[(-9.9, 60), (9.9, 60)]), Some(Lack::LittleTilt { most_deg }) if (most_deg - 9.9).abs() < 0.1)
        );
        assert_eq!(flown(100, &[(-10.1, 60), (10.1, 60)]), None);
        // At 20 deg the mean comes to 10 as late as it leaves it.
        let for_tenths = |tenths: u32| {
            let mut flown = Flown::NOTHING;
            for i in 0..600 {
                let roll_deg = if (300..300 + tenths).contains(&i) { 20.0 } else { 0.0 };
                flown.push(&banked(roll_deg, 0.0, i * 100));
            }
            flown.lack(&Progress::default())
        };
        assert!(matches!(for_tenths(48), Some(Lack::LittleTilt { .. })), "{:?}", for_tenths(48));
        assert_eq!(for_tenths(52), Some(Lack::OneSide(Side::Right)));
        // A second of 20 deg is a mean of 20 (1 - 0.91^10).
        let gust = for_tenths(10);
        assert!(matches!(gust, Some(Lack::LittleTilt { most_deg }) if (most_deg - 12.3).abs() < 0.2), "{gust:?}");
    }

    #[test]
    fn a_side_that_is_missing_is_named() {
        assert_eq!(flown(100, &[(-25.0, 60)]), Some(Lack::OneSide(Side::Left)));
        assert_eq!(flown(100, &[(25.0, 60)]), Some(Lack::OneSide(Side::Right)));
        assert_eq!(flown(100, &[(25.0, 60), (-25.0, 4)]), Some(Lack::OneSide(Side::Right)));
        assert_eq!(flown(100, &[(25.0, 60), (-25.0, 7)]), None);
    }

    /// Of less than 20 s, or 20 samples, nothing is said.
    #[test]
    fn a_short_flight_is_not_judged() {
        assert_eq!(flown(100, &[(0.0, 20)]), None);
        assert!(flown(100, &[(0.0, 21)]).is_some());
        assert_eq!(flown(2000, &[(0.0, 38)]), None);
        assert!(flown(2000, &[(0.0, 40)]).is_some());
        assert_eq!(flown(100, &[(f32::NAN, 100)]), None, "what is no number is no flight");
    }

    /// Circles of 90 s go round; arcs of 120 deg in 90 s each do not.
    #[test]
    fn turns_that_are_an_arc_are_named() {
        let through = |rate_deg_s: f32, seconds: u16| {
            let mut collector = Collector::new(memory());
            collector.begin(Procedure::Turns);
            turn(-25.0, 0, seconds, -rate_deg_s).for_each(|sample| collector.push(sample));
            turn(25.0, seconds, 2 * seconds, rate_deg_s).for_each(|sample| collector.push(sample));
            collector.lack()
        };
        assert_eq!(through(4.5, 90), None);
        assert!(
            matches!(through(1.3, 90), Some(Lack::Arc { side: Side::Left, sectors }) if sectors <= 8),
            "{:?}",
            through(1.3, 90)
        );
        let kept = |samples, sectors| Progress {
            right: super::super::dataset::Coverage { samples, sectors, ..Default::default() },
            ..Progress::default()
        };
        let mut both = Flown::NOTHING;
        turn(-25.0, 0, 20, 9.0).chain(turn(25.0, 20, 40, 9.0)).for_each(|sample| both.push(&sample));
        assert_eq!(both.lack(&kept(60, 8)), Some(Lack::Arc { side: Side::Right, sectors: 8 }));
        assert_eq!((both.lack(&kept(59, 8)), both.lack(&kept(60, 9))), (None, None));
    }

    /// Nothing is said of procedures that are not flown in turns, and a new collection knows nothing of the last.
    #[test]
    fn it_is_of_this_collection() {
        let mut collector = Collector::new(memory());
        for (procedure, is_said) in
            [(Procedure::Turns, true), (Procedure::Flight, false), (Procedure::Level, false), (Procedure::Swing, false)]
        {
            collector.begin(procedure);
            (0..300).for_each(|i| collector.push(banked(5.0, 0.0, i * 100)));
            assert_eq!(collector.lack().is_some(), is_said, "{procedure:?}");
        }
        collector.begin(Procedure::Flight);
        assert_eq!(collector.lack(), None);
        (0..300).for_each(|i| collector.push(banked(1.9, 0.0, i * 100)));
        assert!(matches!(collector.lack(), Some(Lack::NoTilt { .. })), "of whatever is flown nothing else is asked");
        collector.begin(Procedure::Turns);
        assert_eq!(collector.lack(), None);
    }

    #[test]
    fn each_lack_has_its_words() {
        for (lack, words) in [
            (
                Lack::TooSlow { every_s: 1.04 },
                "a sample comes every 1.0 s, too slow for turns; send field and attitude ten times a second",
            ),
            (
                Lack::NoTilt { most_deg: 0.44 },
                "the attitude tilts by 0.4 deg at most; tilt by 15 deg or more to both sides, or if that was flown, \
                 check its unit: radians for degrees?",
            ),
            (
                Lack::LittleTilt { most_deg: 6.3 },
                "too little bank, 6.3 deg at most; fly turns at 15 deg of bank or more each way",
            ),
            (Lack::OneSide(Side::Left), "only left turns were flown; fly right turns, too"),
            (Lack::OneSide(Side::Right), "only right turns were flown; fly left turns, too"),
            (
                Lack::Arc { side: Side::Right, sectors: 5 },
                "the right turns went through 5 of 12 sectors, too slow or too short; fly full circles",
            ),
            (Lack::Missing(Manoeuvre::Round), "missing: turn once round, level"),
        ] {
            assert_eq!(lack.to_string(), words);
        }
    }
}

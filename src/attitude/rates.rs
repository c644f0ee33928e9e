//! Whether a source's body rates are those of its angles.
//!
//! Rates with the wrong sign, or degrees where radians are meant, carry the attitude of a report to where it never is.
//! They show in the angles themselves: from one report to the next these change by what the rates say, or they do not.

use super::Report;
use super::motion::Motion;
use crate::frames::{Attitude, wrap_pi};
use crate::time::Timestamp;

/// How long a step of the angles is remembered, seconds.
const MEMORY_S: f32 = 1.0;

/// Rates are not believed when what they leave of the steps is more than so many times the steps' own squares, and a
/// little, radians squared: half a degree within the memory.
const MOST_LEFT: f32 = 2.0;
const MOST_OF_NOTHING: f32 = 8e-5;

/// The squares of the angles' steps from report to report, and of what the rates leave of them.
#[derive(Clone, Debug)]
pub(super) struct RatesCheck {
    last: Option<(Timestamp, Attitude, Motion)>,
    steps: f32,
    left: f32,
    contradicted: bool,
}

impl RatesCheck {
    /// Before any report.
    pub const fn new() -> Self {
        Self { last: None, steps: 0.0, left: 0.0, contradicted: false }
    }

    /// Takes a report that was sent at `at`, so long after the one before if that is known; gives whether its rates are
    /// believed.
    pub fn see(&mut self, at: Timestamp, report: &Report, max_gap_us: u32) -> bool {
        let Some(motion) = Motion::of(report) else {
            self.last = None;
            return false;
        };
        if let Some((before_at, before, by)) =
            self.last.filter(|(last, ..)| at.us_since(*last) <= u64::from(max_gap_us))
        {
            let step_s = at.us_since(before_at) as f32 * 1e-6;
            let mean = by.towards(&motion, 0.5);
            let steps = [
                (wrap_pi(report.attitude.roll_rad - before.roll_rad), mean.roll_rad_s * step_s),
                (report.attitude.pitch_rad - before.pitch_rad, mean.pitch_rad_s * step_s),
            ];
            let kept = MEMORY_S / (MEMORY_S + step_s);
            let sum = |of: fn((f32, f32)) -> f32| steps.map(of).iter().map(|step| step * step).sum::<f32>();
            self.steps = kept * (self.steps + sum(|(step, _)| step));
            self.left = kept * (self.left + sum(|(step, by_rates)| step - by_rates));
        }
        self.last = Some((at, report.attitude, motion));
        // Once they are not believed they have to be better than nothing.
        let most = if self.contradicted { self.steps } else { MOST_LEFT * self.steps + MOST_OF_NOTHING };
        self.contradicted = self.left > most;
        !self.contradicted
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::{Config, Source};
    use super::*;
    use crate::time::WrappingMillis;

    const MAX_GAP_US: u32 = Config::DEFAULT.max_gap_us;

    /// A source of 50 reports a second; roll and pitch as they are, what is told of them and of their rates.
    struct Flying {
        check: RatesCheck,
        random: Random,
        at_us: u64,
        angles_rad: [f32; 2],
        /// What is sent of the rates.
        factor: f32,
        /// Noise of the angles from report to report, and of the rates, radians and radians a second.
        noise_rad: f32,
        noise_rad_s: f32,
    }

    impl Flying {
        fn new() -> Self {
            Self {
                check: RatesCheck::new(),
                random: Random(1),
                at_us: 0,
                angles_rad: [0.0; 2],
                factor: 1.0,
                noise_rad: 0.0,
                noise_rad_s: 0.0,
            }
        }

        /// So many reports with these rates of roll and pitch, radians a second; whether all, or none, were believed.
        fn fly(&mut self, rates_rad_s: [f32; 2], reports: usize) -> (bool, bool) {
            let believed: Vec<bool> = (0..reports).map(|_| self.report(rates_rad_s, 20_000)).collect();
            (believed.iter().all(|&one| one), believed.iter().all(|&one| !one))
        }

        fn report(&mut self, rates_rad_s: [f32; 2], step_us: u64) -> bool {
            self.at_us += step_us;
            for (angle, rate) in self.angles_rad.iter_mut().zip(rates_rad_s) {
                *angle += rate * step_us as f32 * 1e-6;
            }
            let [roll_rad, pitch_rad] = self.angles_rad.map(|angle| angle + self.noise_rad * self.random.normal());
            let [p, q] = rates_rad_s.map(|rate| self.factor * rate + self.noise_rad_s * self.random.normal());
            let report = Report {
                source: Source::default(),
                sender_time: WrappingMillis::default(),
                attitude: Attitude { roll_rad: wrap_pi(roll_rad), pitch_rad },
                // Level as far as these equations go: pitch and roll stay small, but for a roll through upside down.
                rates_rad_s: [p, q * roll_rad.cos(), -q * roll_rad.sin()],
            };
            self.check.see(Timestamp::from_us(self.at_us), &report, MAX_GAP_US)
        }

        /// To and fro, two seconds.
        fn rock(&mut self) -> (bool, bool) {
            let parts = [[0.3, 0.1], [-0.3, -0.1], [-0.3, 0.1], [0.3, -0.1]].map(|rates| self.fly(rates, 25));
            (parts.iter().all(|part| part.0), parts.iter().all(|part| part.1))
        }
    }

    /// The angles themselves jitter, as do the rates; in flight and standing still.
    #[test]
    fn true_rates_are_believed() {
        for (noise_deg, noise_deg_s) in [(0.0, 0.0), (0.1, 0.5), (0.0, 2.0), (0.5, 0.0)] {
            let mut flying = Flying {
                noise_rad: f32::to_radians(noise_deg),
                noise_rad_s: f32::to_radians(noise_deg_s),
                ..Flying::new()
            };
            for _ in 0..20 {
                assert!(flying.rock().0 && flying.fly([1e-3, 0.0], 50).0, "{noise_deg} {noise_deg_s}");
            }
        }
    }

    /// What is left of steps that are 1 by rates that are f is (1 - f)^2 of their squares: 2 of them at f = -0.414 and
    /// 2.414.
    #[test]
    fn rates_are_believed_as_long_as_they_leave_less_than_twice_the_steps() {
        for (factor, believed) in
            [(-0.38, true), (-0.45, false), (2.38, true), (2.45, false), (-1.0, false), (57.3, false), (0.0175, true)]
        {
            for axis in 0..2 {
                let mut flying = Flying { factor, ..Flying::new() };
                let mut rates = [0.0; 2];
                rates[axis] = 0.5;
                flying.fly(rates, 2);
                rates[axis] = -0.5;
                let (all, _) = flying.fly(rates, 100);
                assert_eq!(all, believed, "{factor} {axis}");
            }
        }
    }

    /// What is not believed shows within a tenth of a second of rolling, stays so while nothing moves, and is forgiven
    /// when it is right again.
    #[test]
    fn wrong_rates_are_told_soon_and_right_ones_again() {
        for factor in [-1.0, 57.3] {
            let mut flying = Flying { factor, ..Flying::new() };
            flying.fly([0.3, 0.0], 5);
            assert!(flying.fly([0.3, 0.0], 20).1 && flying.rock().1 && flying.fly([0.0, 1e-4], 20).1, "{factor}");
            flying.factor = 1.0;
            for _ in 0..4 {
                flying.rock();
            }
            assert!(flying.rock().0, "{factor}");
        }
    }

    /// Rates that leave half as much again of the steps are let pass, but not forgiven: for that they have to leave less.
    #[test]
    fn what_was_wrong_has_to_be_better_than_nothing() {
        assert!(Flying { factor: -0.2, ..Flying::new() }.fly([0.5, 0.0], 200).0);
        let mut flying = Flying { factor: -1.0, ..Flying::new() };
        flying.fly([0.5, 0.0], 100);
        flying.factor = -0.2;
        assert!(flying.fly([0.5, 0.0], 400).1);
        flying.factor = 0.1;
        flying.fly([0.5, 0.0], 200);
        assert!(flying.fly([0.5, 0.0], 10).0);
    }

    /// Standing still with a gyro that is off by a constant: its steps of 0.02 s within a second make 3.6 deg/s half a
    /// degree.
    #[test]
    fn a_little_bias_is_no_contradiction() {
        for (bias_deg_s, believed) in [(3.4_f32, true), (3.8, false), (-3.4, true), (-3.8, false)] {
            let mut check = RatesCheck::new();
            let report = Report {
                source: Source::default(),
                sender_time: WrappingMillis::default(),
                attitude: Attitude::default(),
                rates_rad_s: [bias_deg_s.to_radians(), 0.0, 0.0],
            };
            let all = (0..500).all(|i| check.see(Timestamp::from_us(i * 20_000), &report, MAX_GAP_US));
            assert_eq!(all, believed, "{bias_deg_s}");
        }
    }

    /// Over a gap nothing is known of the rates between, and over one of no rates neither.
    #[test]
    fn a_gap_says_nothing() {
        for (step_us, believed) in [(250_000, false), (251_000, true)] {
            let mut flying = Flying { factor: -1.0, ..Flying::new() };
            let all = (0..10).all(|i| flying.report([if i % 2 == 0 { 0.5 } else { 0.4 }, 0.0], step_us));
            assert_eq!(all, believed, "{step_us}");
        }
        let mut flying = Flying { factor: 0.0, ..Flying::new() };
        assert!(flying.fly([0.5, 0.0], 10).1, "there are none");
        flying.factor = 1.0;
        assert!(flying.fly([0.5, 0.0], 50).0);
    }

    /// A roll through upside down is no step of a whole turn.
    #[test]
    fn roll_goes_round() {
        assert!(Flying::new().fly([3.0, 0.0], 500).0);
    }
}

//! Trial solves: a collection in flight is solved now and then while it goes on, which tells how good it is by now, what is
//! missing, and when it is over.

use super::Refusal;
use crate::calibration::{Advice, Envelope, Manoeuvre, NOTICEABLE, Solution};
use crate::collection::{Collector, Lack};
use crate::time::WrappingMillis;

/// Fixed numbers.
struct Config {
    /// No trial before so many samples are kept: forty to fit to, three for each unknown, and every fourth held back.
    min_samples: u16,
    /// Trials begin at least so far apart, milliseconds. A chip at 80 MHz solves for a quarter of a second, or for half a
    /// second where it looks twice: a twentieth of its time.
    apart_ms: u32,
    /// So many measurements must have come since the last one: standing tells nothing new.
    min_news: u16,
    /// So many of them must have been kept, too: of nearly the same samples nearly the same comes.
    min_kept: u16,
    /// Where fewer are, one trial in so many takes place, a minute of flying: that what is flown tells nothing is told.
    rarely: u8,
    /// After so many measurements without any tilt, a minute of turning, what is good for level headings is good: what
    /// tilts has done so by then.
    level_news: u32,
    /// After so many trials none of which was noticeably better than those before, a minute of flying, more of the same
    /// makes it no better: the buffer is full of as good samples. One that did not take place was no better.
    stalled_trials: u8,
}

const CONFIG: Config = Config {
    min_samples: 53,
    apart_ms: 10_000,
    min_news: 10,
    min_kept: 10,
    rarely: 6,
    level_news: 600,
    stalled_trials: 6,
};

/// What a collection in flight would end in by now.
#[derive(Clone, Debug, PartialEq)]
pub struct Prospect {
    /// The heading error to expect, degrees RMS; none where no coefficients were found.
    pub expected_deg: Option<f32>,
    /// What would make it smaller; none if nothing would by much.
    pub missing: Option<Manoeuvre>,
    /// Whether more of the same would make it no smaller: what is left of it is what the attitude source may be off.
    pub is_at_floor: bool,
    /// Whether trial after trial it has become no smaller, whatever was flown.
    pub is_stalled: bool,
    /// Why it would not be accepted.
    pub refusal: Option<Refusal>,
}

impl Prospect {
    /// Of a trial that found nothing.
    pub(super) fn none(refusal: Refusal) -> Self {
        Self { expected_deg: None, missing: None, is_at_floor: false, is_stalled: false, refusal: Some(refusal) }
    }

    /// Of what a trial found, and why it would not be accepted.
    pub(super) fn new(found: &Solution, refusal: Option<Refusal>) -> Self {
        Self {
            expected_deg: Some(found.quality.expected_rms_deg),
            missing: found.advice.filter(Advice::gains).map(|advice| advice.manoeuvre),
            is_at_floor: found.advice.as_ref().is_some_and(Advice::is_at_floor),
            is_stalled: false,
            refusal,
        }
    }

    /// What is wanting, in words for whoever is refused.
    pub(super) fn lack(&self) -> Option<Lack> {
        self.missing.map(Lack::Missing)
    }

    /// Whether it is as good as wanted.
    fn is_good(&self, wanted_deg: f32) -> bool {
        self.expected_deg.is_some_and(|expected_deg| expected_deg <= wanted_deg)
    }

    /// Whether the collection is over: it is as good as wanted, which counts where that is `confirmed`, or nothing that
    /// could be flown would make it better. What is refused for want of samples goes on.
    fn is_over(&self, wanted_deg: f32, confirmed: bool) -> bool {
        let is_good = confirmed && self.is_good(wanted_deg);
        let is_all = (self.is_at_floor || self.is_stalled) && self.missing.is_none();
        let goes_on = self.refusal.as_ref().is_some_and(Refusal::is_for_want_of_samples);
        (is_good || is_all) && !goes_on
    }
}

/// When a collection is solved on trial.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// When the last trial began, or would have, and how many measurements there were then; their number wraps.
    began: WrappingMillis,
    news: u16,
    /// How many samples had been kept when the last one took place; wraps.
    kept: u16,
    /// How many would have begun since it.
    passed: u8,
    /// How many it stood for, itself and those that did not take place before it; none if there was none.
    stands_for: u8,
}

impl Pace {
    /// No trial yet.
    pub const NONE: Self =
        Self { began: WrappingMillis::new(0), news: 0, kept: 0, passed: CONFIG.rarely - 1, stands_for: 0 };

    /// Whether it is time for a trial; if so, it counts as begun.
    pub fn is_due(&mut self, collector: &Collector, now: WrappingMillis) -> bool {
        let (news, kept) = (collector.news() as u16, collector.kept());
        let is_early = if self.stands_for == 0 {
            kept < CONFIG.min_samples
        } else {
            now.since(self.began) < CONFIG.apart_ms || news.wrapping_sub(self.news) < CONFIG.min_news
        };
        if is_early {
            return false;
        }
        (self.began, self.news) = (now, news);
        self.passed += 1;
        let is_due = self.passed >= CONFIG.rarely || kept.wrapping_sub(self.kept) >= CONFIG.min_kept;
        if is_due {
            (self.kept, self.passed, self.stands_for) = (kept, 0, self.passed);
        }
        is_due
    }
}

/// The trials of a collection.
#[derive(Debug)]
pub(super) struct Trials {
    /// Whether the solve that runs is a trial.
    pub runs: bool,
    pace: Pace,
    /// The least error that any of them expected, degrees RMS, or nearly so; and how many came since.
    best: (f32, u8),
    /// What came of the last one.
    pub prospect: Option<Prospect>,
}

impl Trials {
    pub const NONE: Self = Self { runs: false, pace: Pace::NONE, best: (f32::INFINITY, 0), prospect: None };

    /// Whether it is time for one; if so, it counts as begun.
    pub fn is_due(&mut self, collector: &Collector, now: WrappingMillis) -> bool {
        self.pace.is_due(collector, now)
    }

    /// Takes what came of a trial; whether the collection is over with it.
    ///
    /// With iron by current among the unknowns the errors of a few pushes can be explained away, and less error is
    /// expected than there is: twice running that is rare. Of 400 copters with 20 uT in hover, simulated, five were off by
    /// three times of what they expected if one trial was enough, and two so.
    pub fn end(&mut self, found: &Solution, refusal: Option<Refusal>, collector: &Collector, wanted_deg: f32) -> bool {
        let mut prospect = Prospect::new(found, refusal);
        prospect.is_stalled = self.is_stalled(found.quality.expected_rms_deg);
        let is_of_use = found.quality.envelope == Envelope::Banked || collector.news() >= CONFIG.level_news;
        let is_confirmed = !found.calibration.current.is_used()
            || self.prospect.as_ref().is_some_and(|before| before.is_good(wanted_deg));
        let is_over = is_of_use && prospect.is_over(wanted_deg, is_confirmed);
        self.runs = false;
        self.prospect = Some(prospect);
        is_over
    }

    /// Whether it has not become better for long, this one counted.
    fn is_stalled(&mut self, expected_deg: f32) -> bool {
        let (best_deg, since) = self.best;
        self.best = if expected_deg <= NOTICEABLE * best_deg {
            (expected_deg, 0)
        } else {
            (best_deg, since.saturating_add(self.pace.stands_for))
        };
        self.best.1 >= CONFIG.stalled_trials
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::acceptance::Rejection;
    use crate::calibration::ladder::Procedure;
    use crate::calibration::{Calibration, CurrentIron, Method, Orientation, Quality, Uncertainty};
    use crate::calibration::{Rates, Sample};
    use crate::collection::Kept;
    use crate::frames::{Attitude, Field, Level};

    /// When trials are due, seconds, and what each stands for, of ten samples a second: turns of 18 s, level for 400 s, tilted by
    /// 15 deg ahead for 40, and level again. Their readings are the same in every turn.
    fn due_in_turns() -> Vec<(f32, u8)> {
        let mut kept = Kept::EMPTY;
        let mut collector = Collector::new(&mut kept);
        collector.begin(Procedure::Flight);
        let mut pace = Pace::NONE;
        let mut due = Vec::new();
        for tenths in 0..6000_u16 {
            let t_s = f32::from(tenths) / 10.0;
            let pitch_deg = if (400.0..440.0).contains(&t_s) { -15.0 } else { 0.0 };
            let attitude = Attitude::from_deg(0.0, pitch_deg);
            let heading_rad = f32::from(tenths % 180).to_radians() * 2.0;
            let field = Field::new(attitude.body(Field::<Level>::earth(50.0, 1.1, heading_rad)).ut);
            let time = WrappingMillis::new(u32::from(tenths) * 100);
            collector.push(Sample { field, attitude, rates: Rates::NONE, time });
            if pace.is_due(&collector, time) {
                due.push((t_s, pace.stands_for));
            }
        }
        due
    }

    /// A full buffer that takes nothing more of the same turn is tried once a minute, which is six that were no better; what it
    /// does take is tried ten seconds after the last one, or that would have been, at the latest.
    #[test]
    fn what_adds_nothing_is_tried_once_a_minute() {
        let due = due_in_turns();
        // Its six hundred places are filled in two minutes, five a second.
        let expected = [[1; 11].as_slice(), &[6, 6, 6, 6, 5, 1, 1, 1, 6, 6]].concat();
        let tens: Vec<u8> = due.windows(2).map(|pair| ((pair[1].0 - pair[0].0) / 10.0).round() as u8).collect();
        assert_eq!(tens, expected, "{due:?}");
        let stand_for: Vec<u8> = due.iter().skip(1).map(|&(_, stands_for)| stands_for).collect();
        assert_eq!(stand_for, expected, "{due:?}");
    }

    /// Trials that each stand for so many, those that did not take place counted.
    fn each_for(stands_for: u8) -> Trials {
        Trials { pace: Pace { stands_for, ..Pace::NONE }, ..Trials::NONE }
    }

    /// Six in a row that are not better by a twentieth than the best before; then a better one counts anew.
    #[test]
    fn what_does_not_become_better_is_at_its_floor() {
        let mut trials = each_for(1);
        assert!(!trials.is_stalled(2.0));
        for _ in 0..5 {
            assert!(!trials.is_stalled(1.91));
        }
        assert!(trials.is_stalled(1.91) && trials.is_stalled(3.0) && trials.is_stalled(f32::NAN));
        assert!(!trials.is_stalled(1.89), "a twentieth less");
        for deg in [1.85, 1.81, 1.80, 1.86, 2.5] {
            assert!(!trials.is_stalled(deg));
        }
        assert!(trials.is_stalled(1.80), "all of them against 1.89");
    }

    /// A trial that took place after five that did not is six that were no better.
    #[test]
    fn trials_that_did_not_take_place_were_no_better() {
        for (stands_for, stalled) in [(5, [false, true]), (6, [true, true]), (2, [false, false])] {
            let mut trials = each_for(stands_for);
            assert!(!trials.is_stalled(2.0), "the first one");
            assert_eq!([2.0, 2.0].map(|deg| trials.is_stalled(deg)), stalled, "{stands_for}");
        }
    }

    /// It is over when it is as good as wanted, or when neither more of the same nor anything else helps; unless what is
    /// wrong with it is that samples are wanting.
    #[test]
    fn it_is_over_when_nothing_helps() {
        let over = |expected_deg, missing, is_at_floor, refusal| {
            let prospect = Prospect { expected_deg, missing, is_at_floor, is_stalled: false, refusal };
            let stalled = Prospect { is_at_floor: false, is_stalled: is_at_floor, ..prospect.clone() };
            assert_eq!(prospect.is_over(1.0, true), stalled.is_over(1.0, true), "either is a reason");
            assert_eq!(prospect.is_over(1.0, false), is_at_floor && prospect.is_over(1.0, true), "good is not enough");
            prospect.is_over(1.0, true)
        };
        let missing = Some(Manoeuvre::Round);
        assert!(over(Some(0.99), missing, false, None) && over(Some(1.0), None, false, None));
        assert!(!over(Some(1.01), missing, false, None) && !over(Some(1.01), None, false, None));
        assert!(over(Some(1.4), None, true, None));
        assert!(!over(Some(1.4), missing, true, None), "something else would help");
        assert!(!over(None, None, false, None) && !over(Some(f32::NAN), None, false, None));
        let held_back = Refusal::Rejected(Rejection::TooFewHeldBack { have: 5, need: 8 });
        let not_better = Refusal::Rejected(Rejection::NotBetter { candidate: 1.1, incumbent: 1.0 });
        assert!(!over(Some(0.5), None, true, Some(held_back)), "more samples come");
        assert!(over(Some(0.5), None, false, Some(not_better.clone())), "more would not change it");
        assert!(!over(Some(1.4), None, false, Some(not_better)));
    }

    /// What a trial finds: expected degrees, and what each ampere adds.
    fn found(expected_rms_deg: f32, ut_per_a: f32) -> Solution {
        let quality = Quality {
            method: Method::MaximumLikelihood,
            envelope: Envelope::Banked,
            expected_rms_deg,
            expected_worst_deg: expected_rms_deg,
            norm_residual: 0.0,
            dip_residual_deg: 0.0,
            samples: 100,
            latency: None,
        };
        let current = CurrentIron { ut_per_a: [ut_per_a, 0.0, 0.0], ..CurrentIron::NONE };
        let calibration = Calibration { current, ..Calibration::uncalibrated(Orientation::NONE) };
        Solution { calibration, quality, uncertainty: Uncertainty::NONE, advice: None, iron: None, bank: None }
    }

    /// One trial that is good may be so by chance where iron goes with the current: two running are not. A bad one between
    /// two good ones begins anew, as the beginning does; without such iron the first one is enough.
    #[test]
    fn with_iron_by_current_two_good_trials_running_end_it() {
        let mut kept = Kept::EMPTY;
        let collector = Collector::new(&mut kept);
        for (ut_per_a, trials_deg, ends) in [
            (0.0, &[0.9][..], &[true][..]),
            (0.0, &[1.1, 0.9], &[false, true]),
            (0.5, &[0.9, 0.9], &[false, true]),
            (0.5, &[1.1, 0.9, 0.9], &[false, false, true]),
            (0.5, &[0.9, 1.1, 0.9, 0.9], &[false, false, false, true]),
        ] {
            let mut trials = Trials::NONE;
            let ended: Vec<bool> =
                trials_deg.iter().map(|&deg| trials.end(&found(deg, ut_per_a), None, &collector, 1.0)).collect();
            assert_eq!(ended, ends, "{ut_per_a} uT/A, {trials_deg:?}");
        }
    }
}

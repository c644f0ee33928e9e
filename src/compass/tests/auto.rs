//! A collection that nobody asked for: when it begins, when it rests, who takes it over, and what ends it.

use super::*;
use crate::calibration::tests::synthetic::hovered;

/// A hundred seconds of a multirotor, four samples a second.
fn hover(seed: u64) -> Vec<Sample> {
    hovered(&airframe(), 0.3, &mut Random(seed))
}

impl Bed {
    fn arm(&mut self, is_armed: bool) {
        assert!(matches!(self.compass.step(Event::Armed(Some(is_armed))), Effect::None));
    }

    /// Takes samples, their time counted from its own, and runs each trial to its end. What ended the collection, if
    /// anything.
    fn takes(&mut self, samples: &[Sample]) -> Option<Outcome> {
        for sample in samples {
            self.now = self.now.wrapping_add(250);
            let sample = Sample { time: self.time(), ..*sample };
            assert!(matches!(self.compass.step(Event::Sample(sample)), Effect::None));
            while self.compass.is_busy() {
                match self.compass.step(Event::Advance) {
                    Effect::None => {}
                    end => return Some(self.settle(end)),
                }
            }
        }
        None
    }

    /// How many samples are kept to fit to.
    fn kept(&mut self) -> u16 {
        self.report().progress.left.samples
    }
}

/// Nothing is typed: it is armed, flies, and is calibrated.
#[test]
fn who_flies_is_calibrated() {
    let mut bed = Bed::new();
    bed.arm(true);
    let outcome = bed.takes(&hover(1)).unwrap().unwrap();
    assert!(outcome.quality.expected_rms_deg <= Settings::DEFAULT.accuracy_deg);
    assert_eq!(bed.compass.state(), State::Calibrated);
    // Calibrated it does not collect again.
    assert!(bed.takes(&hover(2)[..100]).is_none());
    assert_eq!(bed.compass.state(), State::Calibrated);
    assert!(!bed.report().is_auto);
}

/// Carried about before it is armed, it collects nothing; what it has rests between two flights, and goes on.
#[test]
fn on_the_ground_it_rests() {
    let mut bed = Bed::new();
    bed.arm(false);
    let flown = hover(3);
    assert!(bed.takes(&flown[..100]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (State::Uncalibrated, 0));
    assert!(bed.report().awaits_arming && !bed.report().is_auto);
    bed.arm(true);
    assert!(bed.takes(&flown[..60]).is_none());
    let kept = bed.kept();
    assert!(kept > 20 && bed.report().is_auto && !bed.report().awaits_arming, "{kept}");
    bed.arm(false);
    assert!(bed.takes(&flown[60..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (State::Collecting, kept));
    assert!(bed.report().awaits_arming);
    bed.arm(true);
    assert!(bed.takes(&flown[60..100]).is_none());
    assert!(bed.kept() > kept);
}

/// Five seconds without a word of an autopilot: there is none that would tell. One that falls silent stops nothing.
#[test]
fn without_an_autopilot_that_tells_it_begins_after_five_seconds() {
    let mut bed = Bed::new();
    let flown = hover(4);
    assert!(bed.takes(&flown[..49]).is_none());
    assert_eq!(bed.compass.state(), State::Uncalibrated);
    assert!(!bed.report().awaits_arming);
    assert!(bed.takes(&flown[49..52]).is_none());
    assert_eq!(bed.compass.state(), State::Collecting);
    let mut bed = Bed::new();
    bed.arm(true);
    assert!(bed.takes(&flown[..20]).is_none());
    let kept = bed.kept();
    bed.compass.step(Event::Armed(None));
    assert!(bed.takes(&flown[20..60]).is_none());
    assert!(bed.kept() > kept);
}

/// `cal start` keeps what the module has collected; a procedure of another kind cannot use it.
#[test]
fn a_person_takes_it_over() {
    let mut bed = Bed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(5)[..60]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalStart(Procedure::Flight)), State::Collecting);
    assert_eq!(bed.kept(), kept);
    assert!(!bed.report().is_auto);
    // From now on it is the person's, armed or not, and nothing of it is forgotten unasked.
    bed.arm(false);
    assert!(bed.takes(&hover(5)[60..70]).is_none());
    assert!(bed.kept() > kept);
    for procedure in [Procedure::Flight, Procedure::Turns] {
        let refused = bed.refused(Command::CalStart(procedure));
        assert_eq!(refused, Refusal::Collecting { by: Procedure::Flight, wanted: procedure });
        let words = format!("flight is being collected; to forget that: cal start {} again", procedure.name());
        assert_eq!(refused.to_string(), words);
    }
    assert_eq!(bed.done(Command::CalStartAgain(None)), State::Collecting);
    assert_eq!((bed.kept(), bed.report().progress.procedure), (0, Procedure::Flight));
    let mut bed = Bed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(5)[..60]).is_none());
    assert_eq!(bed.done(Command::CalStart(Procedure::Turns)), State::Collecting);
    assert_eq!((bed.kept(), bed.report().progress.procedure), (0, Procedure::Turns));
    assert_eq!(bed.done(Command::CalStartAgain(None)), State::Collecting);
    assert_eq!(bed.report().progress.procedure, Procedure::Turns);
    assert_eq!(bed.done(Command::CalStartAgain(Some(Procedure::Level))), State::Collecting);
    assert_eq!(bed.report().progress.procedure, Procedure::Level);
}

/// Whoever stops, aborts or starts decides: the module begins nothing, and what was collected is there to be solved, until
/// it is told to, or has forgotten its calibrations.
#[test]
fn a_person_s_word_holds() {
    for command in [Command::CalStop, Command::CalAbort] {
        let mut bed = Bed::new();
        bed.arm(true);
        assert!(bed.takes(&hover(6)[..60]).is_none());
        let kept = bed.kept();
        assert_eq!(bed.done(command), State::Uncalibrated);
        assert!(bed.takes(&hover(6)[60..160]).is_none());
        let expected = if command == Command::CalStop { kept } else { 0 };
        assert_eq!((bed.compass.state(), bed.kept()), (State::Uncalibrated, expected), "{command:?}");
        let told = if command == Command::CalStop { Command::Set(Setting::Auto(true)) } else { Command::CalClear };
        bed.arm(false);
        bed.saved(told).unwrap();
        bed.arm(true);
        assert!(bed.takes(&hover(6)[60..62]).is_none());
        assert_eq!(bed.compass.state(), State::Collecting, "{told:?}");
    }
    // Refused, what a person has flown stays to be solved with another setting.
    let mut bed = Bed::new();
    bed.arm(true);
    bed.done(Command::CalStart(Procedure::Flight));
    assert!(bed.takes(&hover(8)[..100]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalSolve(None)), State::Solving);
    let end = bed.solve();
    assert!(bed.settle(end).is_err());
    assert!(bed.takes(&hover(8)[100..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (State::Uncalibrated, kept));
}

/// Off, it begins nothing, and ends what it has begun; what a person began is his.
#[test]
fn it_can_be_switched_off() {
    let mut bed = Bed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(7)[..60]).is_none());
    bed.saved(Command::Set(Setting::Auto(false))).unwrap();
    assert_eq!((bed.compass.state(), bed.kept()), (State::Uncalibrated, 0));
    assert!(bed.takes(&hover(7)[60..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (State::Uncalibrated, 0));
    bed.done(Command::CalStart(Procedure::Flight));
    assert!(bed.takes(&hover(7)[..60]).is_none());
    let kept = bed.kept();
    for on in [true, false] {
        bed.saved(Command::Set(Setting::Auto(on))).unwrap();
        assert_eq!((bed.compass.state(), bed.kept()), (State::Collecting, kept), "{on}");
    }
}

/// What a person asks to be solved too early is refused, and goes on with all its samples.
#[test]
fn a_solve_in_vain_costs_nothing() {
    let mut bed = Bed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(8)[..100]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalSolve(None)), State::Solving);
    let end = bed.solve();
    assert!(bed.settle(end).is_err());
    assert_eq!((bed.compass.state(), bed.kept()), (State::Collecting, kept));
    assert!(bed.report().is_auto);
    assert!(bed.takes(&hover(8)[100..]).unwrap().is_ok());
    assert_eq!(bed.compass.state(), State::Calibrated);
}

//! Automatic collection: start, pause, takeover and end.

use super::*;
use crate::calibration::tests::synthetic::multirotor_samples;

/// 100 s of a multirotor, 4 samples/s.
fn hover(seed: u64) -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(seed))
}

impl TestBed {
    fn arm(&mut self, is_armed: bool) {
        assert!(matches!(self.compass.step(Event::Armed(Some(is_armed))), Effect::None));
    }

    /// Processes samples and trial solves until the collection ends.
    fn takes(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
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

    fn kept(&mut self) -> u16 {
        self.report().progress.left.samples
    }
}

#[test]
fn flying_starts_a_collection_and_calibrates() {
    let mut bed = TestBed::new();
    bed.arm(true);
    let outcome = bed.takes(&hover(1)).unwrap().unwrap();
    assert!(outcome.quality.expected_rms_deg <= Settings::DEFAULT.accuracy_deg);
    assert_eq!(bed.compass.state(), ModuleState::Calibrated);
    assert!(bed.takes(&hover(2)[..100]).is_none());
    assert_eq!(bed.compass.state(), ModuleState::Calibrated);
    assert!(!bed.report().is_automatic);
}

#[test]
fn on_the_ground_it_rests() {
    let mut bed = TestBed::new();
    bed.arm(false);
    let flown = hover(3);
    assert!(bed.takes(&flown[..100]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Uncalibrated, 0));
    assert!(bed.report().awaits_arming && !bed.report().is_automatic);
    bed.arm(true);
    assert!(bed.takes(&flown[..60]).is_none());
    let kept = bed.kept();
    assert!(kept > 20 && bed.report().is_automatic && !bed.report().awaits_arming, "{kept}");
    bed.arm(false);
    assert!(bed.takes(&flown[60..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Collecting, kept));
    assert!(bed.report().awaits_arming);
    bed.arm(true);
    assert!(bed.takes(&flown[60..100]).is_none());
    assert!(bed.kept() > kept);
}

/// A lost armed state does not end the collection.
#[test]
fn without_an_autopilot_that_tells_it_begins_after_five_seconds() {
    let mut bed = TestBed::new();
    let flown = hover(4);
    assert!(bed.takes(&flown[..49]).is_none());
    assert_eq!(bed.compass.state(), ModuleState::Uncalibrated);
    assert!(!bed.report().awaits_arming);
    assert!(bed.takes(&flown[49..52]).is_none());
    assert_eq!(bed.compass.state(), ModuleState::Collecting);
    let mut bed = TestBed::new();
    bed.arm(true);
    assert!(bed.takes(&flown[..20]).is_none());
    let kept = bed.kept();
    bed.compass.step(Event::Armed(None));
    assert!(bed.takes(&flown[20..60]).is_none());
    assert!(bed.kept() > kept);
}

/// `cal start` keeps an automatic collection unless the procedure differs.
#[test]
fn a_person_takes_it_over() {
    let mut bed = TestBed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(5)[..60]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalStart(Procedure::Flight)), ModuleState::Collecting);
    assert_eq!(bed.kept(), kept);
    assert!(!bed.report().is_automatic);
    // It then continues while disarmed; only `again` discards it.
    bed.arm(false);
    assert!(bed.takes(&hover(5)[60..70]).is_none());
    assert!(bed.kept() > kept);
    for procedure in [Procedure::Flight, Procedure::Turns] {
        let refused = bed.refused(Command::CalStart(procedure));
        assert_eq!(refused, Refusal::Collecting { present: Procedure::Flight, requested: procedure });
        assert!(refused.to_string().ends_with(&format!(": cal start {} again", procedure.name())), "{refused}");
    }
    assert_eq!(bed.done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!((bed.kept(), bed.report().progress.procedure), (0, Procedure::Flight));
    let mut bed = TestBed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(5)[..60]).is_none());
    assert_eq!(bed.done(Command::CalStart(Procedure::Turns)), ModuleState::Collecting);
    assert_eq!((bed.kept(), bed.report().progress.procedure), (0, Procedure::Turns));
    assert_eq!(bed.done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!(bed.report().progress.procedure, Procedure::Turns);
    assert_eq!(bed.done(Command::CalStartNew(Some(Procedure::Level))), ModuleState::Collecting);
    assert_eq!(bed.report().progress.procedure, Procedure::Level);
}

/// No automatic start until `cal auto on` or `cal clear`.
#[test]
fn user_control_prevents_automatic_starts() {
    for command in [Command::CalStop, Command::CalAbort] {
        let mut bed = TestBed::new();
        bed.arm(true);
        assert!(bed.takes(&hover(6)[..60]).is_none());
        let kept = bed.kept();
        assert_eq!(bed.done(command), ModuleState::Uncalibrated);
        assert!(bed.takes(&hover(6)[60..160]).is_none());
        let expected = if command == Command::CalStop { kept } else { 0 };
        assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Uncalibrated, expected), "{command:?}");
        let told =
            if command == Command::CalStop { Command::Set(SettingChange::Auto(true)) } else { Command::CalClear };
        bed.arm(false);
        bed.saved(told).unwrap();
        bed.arm(true);
        assert!(bed.takes(&hover(6)[60..62]).is_none());
        assert_eq!(bed.compass.state(), ModuleState::Collecting, "{told:?}");
    }
    let mut bed = TestBed::new();
    bed.arm(true);
    bed.done(Command::CalStart(Procedure::Flight));
    assert!(bed.takes(&hover(8)[..100]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bed.solve();
    assert!(bed.settle(end).is_err());
    assert!(bed.takes(&hover(8)[100..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Uncalibrated, kept));
}

#[test]
fn it_can_be_switched_off() {
    let mut bed = TestBed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(7)[..60]).is_none());
    bed.saved(Command::Set(SettingChange::Auto(false))).unwrap();
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Uncalibrated, 0));
    assert!(bed.takes(&hover(7)[60..160]).is_none());
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Uncalibrated, 0));
    bed.done(Command::CalStart(Procedure::Flight));
    assert!(bed.takes(&hover(7)[..60]).is_none());
    let kept = bed.kept();
    for on in [true, false] {
        bed.saved(Command::Set(SettingChange::Auto(on))).unwrap();
        assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Collecting, kept), "{on}");
    }
}

#[test]
fn a_solve_in_vain_costs_nothing() {
    let mut bed = TestBed::new();
    bed.arm(true);
    assert!(bed.takes(&hover(8)[..100]).is_none());
    let kept = bed.kept();
    assert_eq!(bed.done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bed.solve();
    assert!(bed.settle(end).is_err());
    assert_eq!((bed.compass.state(), bed.kept()), (ModuleState::Collecting, kept));
    assert!(bed.report().is_automatic);
    assert!(bed.takes(&hover(8)[100..]).unwrap().is_ok());
    assert_eq!(bed.compass.state(), ModuleState::Calibrated);
}

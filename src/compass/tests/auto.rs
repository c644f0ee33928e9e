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
    fn collect_until_end(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
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
        self.report().progress.left_turns.samples
    }
}

#[test]
fn flying_starts_a_collection_and_calibrates() {
    let mut bench = TestBed::new();
    bench.arm(true);
    let outcome = bench.collect_until_end(&hover(1)).unwrap().unwrap();
    assert!(outcome.quality.expected_rms_deg <= Settings::DEFAULT.accuracy_deg);
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    assert!(bench.collect_until_end(&hover(2)[..100]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    assert!(!bench.report().is_automatic);
}

#[test]
fn while_disarmed_no_samples_are_collected() {
    let mut bench = TestBed::new();
    bench.arm(false);
    let hover_samples = hover(3);
    assert!(bench.collect_until_end(&hover_samples[..100]).is_none());
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Uncalibrated, 0));
    assert!(bench.report().awaits_arming && !bench.report().is_automatic);
    bench.arm(true);
    assert!(bench.collect_until_end(&hover_samples[..60]).is_none());
    let kept = bench.kept();
    assert!(kept > 20 && bench.report().is_automatic && !bench.report().awaits_arming, "{kept}");
    bench.arm(false);
    assert!(bench.collect_until_end(&hover_samples[60..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Collecting, kept));
    assert!(bench.report().awaits_arming);
    bench.arm(true);
    assert!(bench.collect_until_end(&hover_samples[60..100]).is_none());
    assert!(bench.kept() > kept);
}

#[test]
fn without_armed_state_a_collection_starts_after_five_seconds() {
    let mut bench = TestBed::new();
    let hover_samples = hover(4);
    assert!(bench.collect_until_end(&hover_samples[..49]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
    assert!(!bench.report().awaits_arming);
    assert!(bench.collect_until_end(&hover_samples[49..52]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Collecting);
    let mut bench = TestBed::new();
    bench.arm(true);
    assert!(bench.collect_until_end(&hover_samples[..20]).is_none());
    let kept = bench.kept();
    bench.compass.step(Event::Armed(None));
    assert!(bench.collect_until_end(&hover_samples[20..60]).is_none());
    assert!(bench.kept() > kept);
}

/// `cal start` keeps an automatic collection unless the procedure differs.
#[test]
fn cal_start_takes_control_of_an_automatic_collection() {
    let mut bench = TestBed::new();
    bench.arm(true);
    assert!(bench.collect_until_end(&hover(5)[..60]).is_none());
    let kept = bench.kept();
    assert_eq!(bench.done(Command::CalStart(Procedure::Flight)), ModuleState::Collecting);
    assert_eq!(bench.kept(), kept);
    assert!(!bench.report().is_automatic);
    // A collection under user control continues while disarmed; only `again` discards it.
    bench.arm(false);
    assert!(bench.collect_until_end(&hover(5)[60..70]).is_none());
    assert!(bench.kept() > kept);
    for procedure in [Procedure::Flight, Procedure::Turns] {
        let refused = bench.refused(Command::CalStart(procedure));
        assert_eq!(refused, Refusal::Collecting { present: Procedure::Flight, requested: procedure });
        assert!(
            refused.to_string().ends_with(&format!(": cal start {} again", procedure.procedure_name())),
            "{refused}"
        );
    }
    assert_eq!(bench.done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!((bench.kept(), bench.report().progress.procedure), (0, Procedure::Flight));
    let mut bench = TestBed::new();
    bench.arm(true);
    assert!(bench.collect_until_end(&hover(5)[..60]).is_none());
    assert_eq!(bench.done(Command::CalStart(Procedure::Turns)), ModuleState::Collecting);
    assert_eq!((bench.kept(), bench.report().progress.procedure), (0, Procedure::Turns));
    assert_eq!(bench.done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!(bench.report().progress.procedure, Procedure::Turns);
    assert_eq!(bench.done(Command::CalStartNew(Some(Procedure::Level))), ModuleState::Collecting);
    assert_eq!(bench.report().progress.procedure, Procedure::Level);
}

#[test]
fn user_control_prevents_automatic_starts() {
    for command in [Command::CalStop, Command::CalAbort] {
        let mut bench = TestBed::new();
        bench.arm(true);
        assert!(bench.collect_until_end(&hover(6)[..60]).is_none());
        let kept = bench.kept();
        assert_eq!(bench.done(command), ModuleState::Uncalibrated);
        assert!(bench.collect_until_end(&hover(6)[60..160]).is_none());
        let expected = if command == Command::CalStop { kept } else { 0 };
        assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Uncalibrated, expected), "{command:?}");
        let request =
            if command == Command::CalStop { Command::Set(SettingChange::Auto(true)) } else { Command::CalClear };
        bench.arm(false);
        bench.saved(request).unwrap();
        bench.arm(true);
        assert!(bench.collect_until_end(&hover(6)[60..62]).is_none());
        assert_eq!(bench.compass.module_state(), ModuleState::Collecting, "{request:?}");
    }
    let mut bench = TestBed::new();
    bench.arm(true);
    bench.done(Command::CalStart(Procedure::Flight));
    assert!(bench.collect_until_end(&hover(8)[..100]).is_none());
    let kept = bench.kept();
    assert_eq!(bench.done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.solve();
    assert!(bench.settle(end).is_err());
    assert!(bench.collect_until_end(&hover(8)[100..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Uncalibrated, kept));
}

#[test]
fn automatic_collection_can_be_switched_off() {
    let mut bench = TestBed::new();
    bench.arm(true);
    assert!(bench.collect_until_end(&hover(7)[..60]).is_none());
    bench.saved(Command::Set(SettingChange::Auto(false))).unwrap();
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Uncalibrated, 0));
    assert!(bench.collect_until_end(&hover(7)[60..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Uncalibrated, 0));
    bench.done(Command::CalStart(Procedure::Flight));
    assert!(bench.collect_until_end(&hover(7)[..60]).is_none());
    let kept = bench.kept();
    for on in [true, false] {
        bench.saved(Command::Set(SettingChange::Auto(on))).unwrap();
        assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Collecting, kept), "{on}");
    }
}

#[test]
fn a_failed_solve_continues_the_automatic_collection() {
    let mut bench = TestBed::new();
    bench.arm(true);
    assert!(bench.collect_until_end(&hover(8)[..100]).is_none());
    let kept = bench.kept();
    assert_eq!(bench.done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.solve();
    assert!(bench.settle(end).is_err());
    assert_eq!((bench.compass.module_state(), bench.kept()), (ModuleState::Collecting, kept));
    assert!(bench.report().is_automatic);
    assert!(bench.collect_until_end(&hover(8)[100..]).unwrap().is_ok());
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
}

/// A forged report of disarming, in hover. Rest counts after five seconds; a sensor that fails does not prevent it.
#[test]
fn a_disarmed_vehicle_is_in_flight_until_it_is_at_rest() {
    let mut bench = TestBed::new();
    bench.done(Command::CalStart(Procedure::Level));
    let hover_samples = hover(6);
    let fly = |bench: &mut TestBed| assert!(bench.collect_until_end(&hover_samples[..60]).is_none());
    bench.arm(true);
    fly(&mut bench);
    bench.arm(false);
    assert_eq!(bench.refused(Command::Restart), Refusal::Armed);
    fly(&mut bench);
    assert_eq!(bench.refused(Command::Restart), Refusal::Armed);
    let last_sample = bench.now;
    bench.now = last_sample.wrapping_add(5_001);
    bench.done(Command::Restart);
    bench.now = last_sample;
    bench.stand(some_field(), 50);
    assert_eq!(bench.refused(Command::Restart), Refusal::Armed);
    bench.stand(some_field(), 2);
    bench.done(Command::Restart);
    fly(&mut bench);
    bench.done(Command::Restart);
    bench.arm(true);
    assert_eq!(bench.refused(Command::Restart), Refusal::Armed);
}

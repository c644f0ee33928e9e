//! Automatic collection: start, pause, takeover and end.

use super::*;
use crate::synthetic::multirotor_samples;
use autoswing::calibration::CollectionPart;

/// 100 s of a multirotor, 4 samples/s.
fn hover_samples(seed: u64) -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(seed))
}

impl TestBed {
    fn report_armed(&mut self, is_armed: bool) {
        assert!(matches!(self.compass.process_event(Event::ArmedStateReported(Some(is_armed))), Effect::None));
    }

    /// Processes samples and trial solves until the collection ends.
    fn collect_until_end(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
        for sample in samples {
            self.now_ms = self.now_ms.wrapping_add(250);
            let sample = Sample { time: self.time(), ..*sample };
            assert!(matches!(self.compass.process_event(Event::Sample(sample)), Effect::None));
            while self.compass.needs_solve_step() {
                match self.compass.process_event(Event::AdvanceSolve) {
                    Effect::None => {}
                    end => return Some(self.outcome_after_save(end)),
                }
            }
        }
        None
    }

    fn stored_sample_count(&mut self) -> u16 {
        self.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count
    }
}

#[test]
fn flying_starts_a_collection_and_calibrates() {
    let mut bench = TestBed::new();
    bench.report_armed(true);
    let outcome = bench.collect_until_end(&hover_samples(1)).unwrap().unwrap();
    assert!(outcome.quality.expected_rms_deg <= Settings::DEFAULT.accuracy_deg);
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    assert!(bench.collect_until_end(&hover_samples(2)[..100]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    assert!(!bench.status_report().is_automatic);
}

#[test]
fn while_disarmed_no_samples_are_collected() {
    let mut bench = TestBed::new();
    bench.report_armed(false);
    let hover_samples = hover_samples(3);
    assert!(bench.collect_until_end(&hover_samples[..100]).is_none());
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Uncalibrated, 0));
    assert!(bench.status_report().awaits_arming && !bench.status_report().is_automatic);
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples[..60]).is_none());
    let kept = bench.stored_sample_count();
    assert!(kept > 20 && bench.status_report().is_automatic && !bench.status_report().awaits_arming, "{kept}");
    bench.report_armed(false);
    assert!(bench.collect_until_end(&hover_samples[60..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Collecting, kept));
    assert!(bench.status_report().awaits_arming);
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples[60..100]).is_none());
    assert!(bench.stored_sample_count() > kept);
}

#[test]
fn without_armed_state_a_collection_starts_after_five_seconds() {
    let mut bench = TestBed::new();
    let hover_samples = hover_samples(4);
    assert!(bench.collect_until_end(&hover_samples[..49]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
    assert!(!bench.status_report().awaits_arming);
    assert!(bench.collect_until_end(&hover_samples[49..52]).is_none());
    assert_eq!(bench.compass.module_state(), ModuleState::Collecting);
    let mut bench = TestBed::new();
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples[..20]).is_none());
    let kept = bench.stored_sample_count();
    bench.compass.process_event(Event::ArmedStateReported(None));
    assert!(bench.collect_until_end(&hover_samples[20..60]).is_none());
    assert!(bench.stored_sample_count() > kept);
}

/// `cal start` keeps an automatic collection unless the procedure differs.
#[test]
fn cal_start_takes_control_of_an_automatic_collection() {
    let mut bench = TestBed::new();
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples(5)[..60]).is_none());
    let kept = bench.stored_sample_count();
    assert_eq!(bench.expect_done(Command::CalStart(Procedure::Flight)), ModuleState::Collecting);
    assert_eq!(bench.stored_sample_count(), kept);
    assert!(!bench.status_report().is_automatic);
    // A collection under user control continues while disarmed; only `again` discards it.
    bench.report_armed(false);
    assert!(bench.collect_until_end(&hover_samples(5)[60..70]).is_none());
    assert!(bench.stored_sample_count() > kept);
    for procedure in [Procedure::Flight, Procedure::Turns] {
        let refused = bench.expect_refusal(Command::CalStart(procedure));
        assert_eq!(
            refused,
            Refusal::Collecting { present_procedure: Procedure::Flight, requested_procedure: procedure }
        );
        assert!(
            refused.to_string().ends_with(&format!(": cal start {} again", procedure.procedure_name())),
            "{refused}"
        );
    }
    assert_eq!(bench.expect_done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!(
        (bench.stored_sample_count(), bench.status_report().collection_progress.procedure),
        (0, Procedure::Flight)
    );
    let mut bench = TestBed::new();
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples(5)[..60]).is_none());
    assert_eq!(bench.expect_done(Command::CalStart(Procedure::Turns)), ModuleState::Collecting);
    assert_eq!(
        (bench.stored_sample_count(), bench.status_report().collection_progress.procedure),
        (0, Procedure::Turns)
    );
    assert_eq!(bench.expect_done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert_eq!(bench.status_report().collection_progress.procedure, Procedure::Turns);
    assert_eq!(bench.expect_done(Command::CalStartNew(Some(Procedure::Level))), ModuleState::Collecting);
    assert_eq!(bench.status_report().collection_progress.procedure, Procedure::Level);
}

#[test]
fn user_control_prevents_automatic_starts() {
    for command in [Command::CalStop, Command::CalAbort] {
        let mut bench = TestBed::new();
        bench.report_armed(true);
        assert!(bench.collect_until_end(&hover_samples(6)[..60]).is_none());
        let kept = bench.stored_sample_count();
        assert_eq!(bench.expect_done(command), ModuleState::Uncalibrated);
        assert!(bench.collect_until_end(&hover_samples(6)[60..160]).is_none());
        let expected = if command == Command::CalStop { kept } else { 0 };
        assert_eq!(
            (bench.compass.module_state(), bench.stored_sample_count()),
            (ModuleState::Uncalibrated, expected),
            "{command:?}"
        );
        let request =
            if command == Command::CalStop { Command::Set(SettingChange::Auto(true)) } else { Command::CalClear };
        bench.report_armed(false);
        bench.save_by_command(request).unwrap();
        bench.report_armed(true);
        assert!(bench.collect_until_end(&hover_samples(6)[60..62]).is_none());
        assert_eq!(bench.compass.module_state(), ModuleState::Collecting, "{request:?}");
    }
    let mut bench = TestBed::new();
    bench.report_armed(true);
    bench.expect_done(Command::CalStart(Procedure::Flight));
    assert!(bench.collect_until_end(&hover_samples(8)[..100]).is_none());
    let kept = bench.stored_sample_count();
    assert_eq!(bench.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_err());
    assert!(bench.collect_until_end(&hover_samples(8)[100..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Uncalibrated, kept));
}

#[test]
fn automatic_collection_can_be_switched_off() {
    let mut bench = TestBed::new();
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples(7)[..60]).is_none());
    bench.save_by_command(Command::Set(SettingChange::StreamRateHz(20))).unwrap();
    assert_eq!(bench.compass.module_state(), ModuleState::Collecting, "another setting");
    bench.save_by_command(Command::Set(SettingChange::Auto(false))).unwrap();
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Uncalibrated, 0));
    assert!(bench.collect_until_end(&hover_samples(7)[60..160]).is_none());
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Uncalibrated, 0));
    bench.expect_done(Command::CalStart(Procedure::Flight));
    assert!(bench.collect_until_end(&hover_samples(7)[..60]).is_none());
    let kept = bench.stored_sample_count();
    for on in [true, false] {
        bench.save_by_command(Command::Set(SettingChange::Auto(on))).unwrap();
        assert_eq!(
            (bench.compass.module_state(), bench.stored_sample_count()),
            (ModuleState::Collecting, kept),
            "{on}"
        );
    }
}

#[test]
fn a_failed_solve_continues_the_automatic_collection() {
    let mut bench = TestBed::new();
    bench.report_armed(true);
    assert!(bench.collect_until_end(&hover_samples(8)[..100]).is_none());
    let kept = bench.stored_sample_count();
    assert_eq!(bench.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_err());
    assert_eq!((bench.compass.module_state(), bench.stored_sample_count()), (ModuleState::Collecting, kept));
    assert!(bench.status_report().is_automatic);
    assert!(bench.collect_until_end(&hover_samples(8)[100..]).unwrap().is_ok());
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
}

/// A forged report of disarming, in hover. Rest counts after five seconds; a sensor that fails does not prevent it.
#[test]
fn a_disarmed_vehicle_is_in_flight_until_it_is_at_rest() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Level));
    let hover_samples = hover_samples(6);
    let fly = |bench: &mut TestBed| assert!(bench.collect_until_end(&hover_samples[..60]).is_none());
    bench.report_armed(true);
    fly(&mut bench);
    bench.report_armed(false);
    assert_eq!(bench.expect_refusal(Command::Restart), Refusal::Armed);
    fly(&mut bench);
    assert_eq!(bench.expect_refusal(Command::Restart), Refusal::Armed);
    let last_sample = bench.now_ms;
    bench.now_ms = last_sample.wrapping_add(5_001);
    bench.expect_done(Command::Restart);
    bench.now_ms = last_sample;
    bench.collect_at_rest(test_field(), 50);
    assert_eq!(bench.expect_refusal(Command::Restart), Refusal::Armed);
    bench.collect_at_rest(test_field(), 2);
    bench.expect_done(Command::Restart);
    fly(&mut bench);
    bench.expect_done(Command::Restart);
    bench.report_armed(true);
    assert_eq!(bench.expect_refusal(Command::Restart), Refusal::Armed);
}

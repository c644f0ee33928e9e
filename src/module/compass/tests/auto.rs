//! Automatic collection: start, pause, takeover and end.

use super::*;

fn armed_vehicle() -> TestBed<'static> {
    let mut bed = TestBed::new();
    bed.report_armed(Some(true));
    bed
}

/// A module that has collected the first 15 s of a hover automatically.
fn collecting_automatically(samples: &[Sample]) -> TestBed<'static> {
    let mut bed = armed_vehicle();
    bed.collect(&samples[..60]);
    let report = bed.status_report();
    assert!(report.is_automatic && !report.awaits_arming);
    bed
}

#[test]
fn without_armed_state_a_collection_starts_after_five_seconds() {
    let samples = hover_samples(4);
    let mut bed = TestBed::new();
    bed.collect(&samples[..49]);
    assert_eq!(bed.state(), ModuleState::Uncalibrated);
    assert!(!bed.status_report().awaits_arming);
    bed.collect(&samples[49..52]);
    assert_eq!(bed.state(), ModuleState::Collecting);
    let mut bed = collecting_automatically(&samples);
    let (_, kept) = bed.state_and_fit_count();
    bed.report_armed(None);
    bed.collect(&samples[60..100]);
    assert!(bed.state_and_fit_count().1 > kept);
}

/// `cal start` keeps an automatic collection unless the procedure differs; under user control it continues while
/// disarmed, and only `again` discards it.
#[test]
fn cal_start_takes_control_of_an_automatic_collection() {
    let samples = hover_samples(5);
    let mut bed = collecting_automatically(&samples);
    let kept = bed.state_and_fit_count();
    bed.start(Procedure::Flight);
    assert_eq!(bed.state_and_fit_count(), kept);
    assert!(!bed.status_report().is_automatic);
    bed.report_armed(Some(false));
    bed.collect(&samples[60..70]);
    assert!(bed.state_and_fit_count().1 > kept.1);
    for procedure in [Procedure::Flight, Procedure::Turns] {
        assert_eq!(
            bed.expect_refusal(Command::CalStart(procedure)),
            Refusal::Collecting { present_procedure: Procedure::Flight, requested_procedure: procedure }
        );
    }
    let mut other_procedure = collecting_automatically(&samples);
    other_procedure.start(Procedure::Turns);
    assert_eq!(other_procedure.state_and_fit_count().1, 0);
    for (bed, new_procedures) in [
        (&mut bed, &[(None, Procedure::Flight)][..]),
        (&mut other_procedure, &[(None, Procedure::Turns), (Some(Procedure::Level), Procedure::Level)]),
    ] {
        for (requested, procedure) in new_procedures {
            assert_eq!(bed.expect_done(Command::CalStartNew(*requested)), ModuleState::Collecting);
            assert_eq!(bed.state_and_fit_count().1, 0);
            assert_eq!(bed.status_report().collection_progress.procedure, *procedure);
        }
    }
}

#[test]
fn user_control_prevents_automatic_starts() {
    let samples = hover_samples(6);
    for (command, keeps_samples, return_to_automatic) in [
        (Command::CalStop, true, Command::Set(setting_change("AUTO", 1.0))),
        (Command::CalAbort, false, Command::CalClear),
    ] {
        let mut bed = collecting_automatically(&samples);
        let (_, kept) = bed.state_and_fit_count();
        assert_eq!(bed.expect_done(command), ModuleState::Uncalibrated);
        bed.collect(&samples[60..160]);
        let expected = if keeps_samples { kept } else { 0 };
        assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, expected), "{command:?}");
        assert_eq!(bed.status_report().last_trial.is_some(), keeps_samples, "{command:?}");
        bed.report_armed(Some(false));
        bed.expect_saved(return_to_automatic);
        bed.report_armed(Some(true));
        bed.collect(&samples[60..62]);
        assert_eq!(bed.state(), ModuleState::Collecting, "{return_to_automatic:?}");
    }
}

/// Yaw turns alone determine nothing: the solve fails.
#[test]
fn a_failed_solve_ends_the_user_s_collection_and_continues_an_automatic_one() {
    let samples = hover_samples(8);
    for is_automatic in [false, true] {
        let mut bed = armed_vehicle();
        if !is_automatic {
            bed.start(Procedure::Flight);
        }
        bed.collect(&samples[..100]);
        let (_, kept) = bed.state_and_fit_count();
        assert!(bed.solve().is_err());
        if is_automatic {
            assert_eq!(bed.state_and_fit_count(), (ModuleState::Collecting, kept));
            assert!(bed.status_report().is_automatic);
            assert!(bed.collect_until_end(&samples[100..]).unwrap().is_ok());
            assert_eq!(bed.state(), ModuleState::Calibrated);
        } else {
            bed.collect(&samples[100..160]);
            assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, kept));
        }
    }
}

#[test]
fn automatic_collection_can_be_switched_off() {
    let samples = hover_samples(7);
    let mut bed = collecting_automatically(&samples);
    assert_eq!(bed.set(setting_change("STREAM_RATE", 20.0)), ModuleState::Collecting, "another setting");
    bed.set(setting_change("AUTO", 0.0));
    assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, 0));
    bed.collect(&samples[60..160]);
    assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, 0));
    bed.start(Procedure::Flight);
    bed.collect(&samples[..60]);
    let user_collection = bed.state_and_fit_count();
    for on in [true, false] {
        bed.set(setting_change("AUTO", f32::from(u8::from(on))));
        assert_eq!(bed.state_and_fit_count(), user_collection, "{on}");
    }
}

/// A forged report of disarming, in hover. Rest counts after five seconds; a sensor that fails does not prevent it.
#[test]
fn a_disarmed_vehicle_is_in_flight_until_it_is_at_rest() {
    let samples = &hover_samples(6)[..60];
    let mut bed = armed_vehicle();
    bed.start(Procedure::Level);
    bed.collect(samples);
    bed.report_armed(Some(false));
    assert_eq!(bed.expect_refusal(Command::Restart), Refusal::Armed);
    bed.collect(samples);
    assert_eq!(bed.expect_refusal(Command::Restart), Refusal::Armed);
    let last_sample_ms = bed.now_ms;
    bed.advance_clock(5_001);
    bed.expect_done(Command::Restart);
    bed.now_ms = last_sample_ms;
    bed.collect_at_rest(test_field(), 50);
    assert_eq!(bed.expect_refusal(Command::Restart), Refusal::Armed);
    bed.collect_at_rest(test_field(), 2);
    bed.expect_done(Command::Restart);
    bed.collect(samples);
    bed.expect_done(Command::Restart);
    bed.report_armed(Some(true));
    assert_eq!(bed.expect_refusal(Command::Restart), Refusal::Armed);
}

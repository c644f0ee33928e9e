//! Collections in flight with trial solves.

use core::slice;

use super::*;
use autoswing::calibration::{Manoeuvre, MotorCurrent};
use nalgebra::Vector3;

impl TestBed<'_> {
    fn trial_result(&mut self) -> Option<TrialResult> {
        self.status_report().last_trial
    }
}

#[test]
fn two_successive_good_trials_are_required_with_and_without_motor_current() {
    for ut_per_a in [0.4, 0.0] {
        let (mut bed, mut good_trials) = (TestBed::with_accuracy(1.5), 0);
        let outcome = hover_samples(1).into_iter().enumerate().find_map(|(number, mut sample)| {
            let current_a = 15.0 + 5.0 * (number as f32 * 0.3).sin();
            sample.current = MotorCurrent::from_a(Some(current_a));
            sample.field.ut += Vector3::new(0.6, -0.7, 0.4) * ut_per_a * current_a;
            let before = bed.trial_result();
            let outcome = bed.collect_until_end(slice::from_ref(&sample));
            let expected_deg = bed.trial_result().filter(|now| Some(now) != before.as_ref())?.expected_error_deg;
            good_trials += usize::from(expected_deg.is_some_and(|expected_deg| expected_deg <= 1.5));
            outcome
        });
        assert!(outcome.unwrap().unwrap().quality.expected_rms_deg <= 1.5);
        assert_eq!(bed.active_record().calibration.motor_current.is_applied(), ut_per_a > 0.0);
        assert_eq!(good_trials, 2, "{ut_per_a}");
    }
}

/// At an unreachable accuracy the trial's solution serves for sample selection; a new collection discards it.
#[test]
fn a_collection_continues_until_the_accuracy_is_reached() {
    let mut bed = TestBed::with_accuracy(0.2);
    assert!(bed.trial_result().is_none() && !bed.compass.collector.uses_trial_solution(), "no trial yet");
    assert_eq!(bed.compass.indicator_state(), IndicatorState::Collecting(0));
    bed.collect(&hover_samples(2)[..300]);
    assert!(bed.compass.collector.uses_trial_solution());
    let Some(TrialResult { expected_error_deg: Some(expected_deg), refusal: None, .. }) = bed.trial_result() else {
        panic!("{:?}", bed.trial_result())
    };
    assert!((0.2..1.0).contains(&expected_deg), "{expected_deg}");
    let percent = (100.0 * 0.2 / expected_deg) as u8;
    assert_eq!(bed.compass.indicator_state(), IndicatorState::Collecting(percent));
    let found_deg = bed.solve().unwrap().quality.expected_rms_deg;
    assert!(found_deg <= expected_deg, "{found_deg} {expected_deg}");
    bed.start(Procedure::Flight);
    assert!(!bed.compass.collector.uses_trial_solution());
}

#[test]
fn the_recommended_manoeuvre_is_reported() {
    let samples = hover_samples(3);
    let mut bed = TestBed::with_accuracy(1.0);
    bed.collect(&samples[..160]);
    let refusal = bed.solve().unwrap_err();
    assert!(refusal.to_string().contains("deg; the attitude tilts by 1.1 deg at most; tilt by 15"), "{refusal}");
    let mut bed = TestBed::with_accuracy(1.0);
    bed.collect(&samples[..164]);
    let missing_manoeuvre = bed.trial_result().unwrap().missing_manoeuvre;
    assert!(matches!(missing_manoeuvre, Some(Manoeuvre::Tilt(_, None))), "{missing_manoeuvre:?}");
    let refusal = bed.solve().unwrap_err();
    assert_eq!(refusal.stable_code(), "not-accurate");
    assert!(refusal.to_string().contains("deg; missing: tilt "), "{refusal}");
    assert!(matches!(bed.request_reply(Command::CalAdvise), Ok(Reply::Advice(_))));
}

/// The first follows three samples for each of 13 unknowns, as a fit needs: 13 s with those held back.
#[test]
fn trial_solves_are_ten_seconds_apart() {
    let mut bed = TestBed::with_accuracy(0.2);
    let samples = hover_samples(4);
    let mut sample_count = bed.collect_until_trial(&samples);
    assert!((12 * 4..15 * 4).contains(&sample_count), "{sample_count}");
    for _ in 0..3 {
        bed.run_trial_solve();
        let interval = bed.collect_until_trial(&samples[sample_count..]);
        assert_eq!(interval, 10 * 4);
        sample_count += interval;
    }
}

/// Runs the first trial, with this many samples before its first step and one before each further step up to twenty.
fn collect_during_trial(samples_before_first_step: usize) -> TestBed<'static> {
    let mut bed = TestBed::with_accuracy(0.2);
    let samples = hover_samples(9);
    let trial_start = bed.collect_until_trial(&samples);
    let sample_count = samples_before_first_step.max(20);
    let before = bed.compass.collector.stored_count();
    for (i, sample) in samples[trial_start..].iter().take(sample_count).enumerate() {
        if i >= samples_before_first_step {
            bed.expect_none(Event::AdvanceSolve);
        }
        bed.advance_clock(100);
        bed.expect_none(Event::Sample(Sample { time: bed.time(), ..*sample }));
        assert_eq!(bed.state(), ModuleState::Collecting);
    }
    bed.run_trial_solve();
    assert_eq!(usize::from(bed.compass.collector.stored_count() - before), sample_count, "every one is stored");
    bed
}

#[test]
fn a_trial_that_takes_too_long_is_ended_without_loss_of_samples() {
    assert!(collect_during_trial(SAMPLES_DURING_SOLVE_CAPACITY).trial_result().is_some());
    assert!(collect_during_trial(SAMPLES_DURING_SOLVE_CAPACITY + 1).trial_result().is_none());
}

#[test]
fn commands_interrupt_trial_solves() {
    let in_trial = || {
        let mut bed = TestBed::with_accuracy(0.2);
        bed.collect_until_trial(&hover_samples(7));
        bed
    };
    let mut bed = in_trial();
    assert_eq!(bed.status_report().module_state, ModuleState::Collecting);
    bed.set(setting_change("STREAM_RATE", 5.0));
    assert!(bed.compass.needs_solve_step(), "neither a report nor another setting interrupts it");
    for (command, state) in [
        (Command::CalStop, ModuleState::Uncalibrated),
        (Command::CalAbort, ModuleState::Uncalibrated),
        (Command::CalStartNew(None), ModuleState::Collecting),
    ] {
        let mut bed = in_trial();
        assert_eq!(bed.expect_done(command), state);
        assert!(!bed.compass.needs_solve_step() && bed.trial_result().is_none(), "{command:?}");
    }
    let mut bed = in_trial();
    assert_eq!(bed.set(setting_change("INCLINATION", 55.0)), ModuleState::Collecting);
    assert!(!bed.compass.needs_solve_step());
    let mut bed = in_trial();
    assert_eq!(bed.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    assert_eq!(bed.expect_refusal(Command::CalStop), Refusal::Busy, "a user requested this solve");
}

/// The samples are usable with the corrected mounting.
#[test]
fn a_trial_solve_reports_a_refusal_in_flight() {
    let mut bed = TestBed::with_setting(mount_change(Orientation::from_name("yaw90").unwrap()));
    bed.start(Procedure::Flight);
    bed.collect(&hover_samples(8));
    let trial = bed.trial_result().unwrap();
    let contradicted = SolveError::MountContradicted { found: Orientation::IDENTITY_ROTATION };
    assert_eq!((trial.refusal, trial.expected_error_deg), (Some(Refusal::Solve(contradicted)), None));
    bed.set(setting_change("MOUNT", 0.0));
    assert!(bed.solve().is_ok());
}

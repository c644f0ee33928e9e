//! Collections in flight with trial solves.

use core::slice;

use super::*;
use crate::synthetic::measured_sample;
use autoswing::calibration::{AngleRates, Manoeuvre, MotorCurrent};
use nalgebra::Vector3;

impl TestBed<'_> {
    fn trial_result(&mut self) -> Option<TrialResult> {
        self.status_report().last_trial
    }
}

#[test]
fn a_flight_collection_ends_at_the_configured_accuracy() {
    let durations_ms = [1.5, 0.5].map(|accuracy_deg| {
        let mut bed = TestBed::with_accuracy(accuracy_deg);
        let start = bed.time();
        let accuracy = bed.collect_until_end(&hover_samples(1)).unwrap().unwrap();
        let expected_deg = accuracy.quality.expected_rms_deg;
        assert!(expected_deg <= accuracy_deg, "{expected_deg}");
        assert_eq!(bed.state(), ModuleState::Calibrated);
        assert!(rms(&airframe().errors_deg(&bed.active_record().calibration)) < 3.0 * expected_deg);
        bed.time().ms_since(start)
    });
    // Yaw turns alone (40 s) do not suffice; a higher accuracy takes longer.
    assert!(durations_ms[0] > 40_000 && durations_ms[0] < durations_ms[1], "{durations_ms:?}");
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

/// Only one trial follows, with the samples since the last one.
#[test]
fn a_vehicle_at_rest_causes_no_further_trial_solve() {
    let mut bed = TestBed::with_accuracy(0.2);
    let samples = hover_samples(5);
    bed.collect(&samples[..80]);
    bed.collect_until_trial(&[samples[79]; 60]);
    bed.run_trial_solve();
    let last_trial = bed.trial_result();
    for _ in 0..540 {
        bed.advance_clock(250);
        bed.expect_none(Event::Sample(Sample { time: bed.time(), ..samples[79] }));
        assert!(!bed.compass.needs_solve_step());
    }
    assert_eq!(bed.trial_result(), last_trial);
    bed.collect(&samples[160..]);
    assert_ne!(bed.trial_result(), last_trial);
}

/// At 10 samples/s and 20 deg/s: a vehicle that tilts by less than 10 deg is not calibrated in flight; with
/// more tilt it is, in less than a minute.
#[test]
fn a_vehicle_without_tilt_is_not_calibrated_in_flight() {
    let ends_after_s = |tilt_deg: f32| {
        let (mut bed, mut random) = (TestBed::with_accuracy(3.0), Random(6));
        for tenths in 0..1500_u16 {
            let t_s = f32::from(tenths) * 0.1;
            let attitude = RollPitch::from_deg(tilt_deg * (t_s / 1.1).sin(), tilt_deg * (t_s / 1.7).cos());
            let sample = measured_sample(&airframe(), attitude, t_s * 0.35, 0.1, &mut random);
            let (rates, time) =
                (AngleRates::from_rad_s([0.0, 0.0, 0.35]), WrappingMillis::new(u32::from(tenths) * 100));
            bed.expect_none(Event::Sample(Sample { rates, time, ..sample }));
            while bed.compass.needs_solve_step() {
                if matches!(bed.compass.process_event(Event::AdvanceSolve), Effect::Save) {
                    return Ok(t_s);
                }
            }
        }
        Err(bed.solve().unwrap_err().stable_code())
    };
    assert!(ends_after_s(11.0).is_ok_and(|t_s| t_s < 60.0));
    assert_eq!(ends_after_s(9.0), Err("unobservable"));
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

/// The result does not depend on when samples arrive during a trial, whose own samples must not change.
#[test]
fn samples_during_a_trial_are_stored_after_it() {
    let fit = |bed: &TestBed| bed.compass.collector.fit_samples().all_samples().copied().collect::<Vec<Sample>>();
    let [mut early, mut late] = [20, 0].map(collect_during_trial);
    assert_eq!(fit(&early), fit(&late));
    assert!(early.trial_result().is_some() && early.trial_result() == late.trial_result());
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
    bed.set(SettingChange::new("STREAM_RATE", Whole(5)));
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
    assert_eq!(bed.set(SettingChange::new("INCLINATION", Number(Some(55.0)))), ModuleState::Collecting);
    assert!(!bed.compass.needs_solve_step());
    let mut bed = in_trial();
    assert_eq!(bed.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    assert_eq!(bed.expect_refusal(Command::CalStop), Refusal::Busy, "a user requested this solve");
}

/// The samples are usable with the corrected mounting.
#[test]
fn a_trial_solve_reports_a_refusal_in_flight() {
    let mut bed = TestBed::with_setting(SettingChange::new(
        "MOUNT",
        Whole(Orientation::from_name("yaw90").unwrap().number().into()),
    ));
    bed.start(Procedure::Flight);
    bed.collect(&hover_samples(8));
    let trial = bed.trial_result().unwrap();
    let contradicted = SolveError::MountContradicted { found: Orientation::IDENTITY_ROTATION };
    assert_eq!((trial.refusal, trial.expected_error_deg), (Some(Refusal::Solve(contradicted)), None));
    bed.set(SettingChange::new("MOUNT", Whole(0)));
    assert!(bed.solve().is_ok());
}

#[test]
fn a_collection_ends_though_its_calibration_is_no_better() {
    let refused_count = (0..8)
        .filter(|seed| {
            let mut bed = TestBed::with_accuracy(0.5);
            bed.collect_until_end(&hover_samples(20 + seed)).unwrap().unwrap();
            bed.start(Procedure::Flight);
            let second = bed.collect_until_end(&hover_samples(40 + seed)).expect("an end of the second collection");
            second.is_err_and(|refusal| refusal.stable_code() == "not-better")
        })
        .count();
    assert!(refused_count >= 1, "{refused_count}");
}

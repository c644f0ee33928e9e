//! Collections in flight with trial solves.

use super::*;
use crate::synthetic::multirotor_samples;
use autoswing::calibration::{CollectionPart, Manoeuvre, MotorCurrent, Rates};
use nalgebra::Vector3;

/// 100 s of a multirotor, 4 samples/s: 40 s of yaw turns, then tilts to all sides.
fn hover_samples(seed: u64) -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(seed))
}

impl TestBed {
    fn with_accuracy(accuracy_deg: f32) -> Self {
        let mut bench = Self::new();
        bench.save_by_command(Command::Set(SettingChange::Accuracy(accuracy_deg))).unwrap();
        bench.expect_done(Command::CalStart(Procedure::Flight));
        bench
    }

    /// Processes samples and trial solves; returns the outcome and the number of samples at the end.
    fn collect_hover_samples(&mut self, samples: &[Sample]) -> Option<(SolveOutcome, usize)> {
        self.collect_with_trial_callback(samples, &mut |_| ())
    }

    /// Processes samples and trial solves, with a callback after each trial.
    fn collect_with_trial_callback(
        &mut self,
        samples: &[Sample],
        on_trial: &mut dyn FnMut(TrialResult),
    ) -> Option<(SolveOutcome, usize)> {
        let began = self.now_ms;
        for (number, sample) in samples.iter().enumerate() {
            self.now_ms = began.wrapping_add(250 * number as u32);
            let sample = Sample { time: self.time(), ..*sample };
            assert!(matches!(self.compass.process_event(Event::Sample(sample)), Effect::None));
            let is_trial_running = self.compass.needs_solve_step();
            while self.compass.needs_solve_step() {
                assert_eq!(self.compass.module_state(), ModuleState::Collecting, "nobody asked for a solve");
                match self.compass.process_event(Event::AdvanceSolve) {
                    Effect::None => {}
                    end => return Some((self.outcome_after_save(end), number)),
                }
            }
            if is_trial_running {
                self.trial_result().into_iter().for_each(&mut *on_trial);
            }
        }
        None
    }

    fn trial_result(&mut self) -> Option<TrialResult> {
        self.status_report().last_trial
    }
}

#[test]
fn a_flight_collection_ends_at_the_configured_accuracy() {
    let mut ends = Vec::new();
    for accuracy_deg in [1.5, 0.5] {
        let mut bench = TestBed::with_accuracy(accuracy_deg);
        let (outcome, samples) = bench.collect_hover_samples(&hover_samples(1)).unwrap();
        let expected_deg = outcome.unwrap().quality.expected_rms_deg;
        assert!(expected_deg <= accuracy_deg, "{expected_deg}");
        assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
        let calibration = bench.compass.active_record().unwrap().calibration;
        assert!(rms(&airframe().errors_deg(&calibration)) < 3.0 * expected_deg);
        ends.push(samples);
    }
    // Yaw turns alone (160 samples) do not suffice; a higher accuracy takes longer.
    assert!(ends[0] > 160 && ends[0] < ends[1], "{ends:?}");
}

#[test]
fn two_successive_good_trials_are_required_with_and_without_motor_current() {
    for ut_per_a in [0.4, 0.0] {
        let mut samples = hover_samples(1);
        for (number, sample) in samples.iter_mut().enumerate() {
            let current_a = 15.0 + 5.0 * (number as f32 * 0.3).sin();
            sample.current = MotorCurrent::from_a(Some(current_a));
            sample.field.ut += Vector3::new(0.6, -0.7, 0.4) * ut_per_a * current_a;
        }
        let (mut bench, mut good) = (TestBed::with_accuracy(1.5), 0);
        let (outcome, _) = bench
            .collect_with_trial_callback(&samples, &mut |prospect| {
                good += usize::from(prospect.expected_error_deg.is_some_and(|expected_deg| expected_deg <= 1.5));
            })
            .unwrap();
        assert!(outcome.unwrap().quality.expected_rms_deg <= 1.5);
        assert_eq!(bench.compass.active_record().unwrap().calibration.motor_current.is_applied(), ut_per_a > 0.0);
        assert_eq!(good, 1, "{ut_per_a}: the second one ends the collection");
    }
}

/// At an unreachable accuracy the trial's solution serves for sample selection; a new collection discards it.
#[test]
fn a_collection_continues_until_the_accuracy_is_reached() {
    let mut bench = TestBed::with_accuracy(0.2);
    assert!(bench.trial_result().is_none() && !bench.compass.collector.uses_trial_solution(), "not tried");
    assert_eq!(bench.compass.indicator_state(), IndicatorState::Collecting(0));
    assert!(bench.collect_hover_samples(&hover_samples(2)[..300]).is_none());
    assert!(bench.compass.collector.uses_trial_solution());
    let Some(TrialResult { expected_error_deg: Some(expected_deg), refusal: None, .. }) = bench.trial_result() else {
        panic!("{:?}", bench.trial_result())
    };
    assert!((0.2..1.0).contains(&expected_deg), "{expected_deg}");
    let percent = (100.0 * 0.2 / expected_deg) as u8;
    assert_eq!(bench.compass.indicator_state(), IndicatorState::Collecting(percent));
    assert_eq!(bench.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.run_solve();
    let found = bench.outcome_after_save(end).unwrap().quality.expected_rms_deg;
    assert!(found <= expected_deg, "{found} {expected_deg}");
    bench.compass.collector.begin_procedure(Procedure::Flight);
    assert!(!bench.compass.collector.uses_trial_solution());
}

#[test]
fn the_recommended_manoeuvre_is_reported() {
    let mut bench = TestBed::with_accuracy(1.0);
    assert!(bench.collect_hover_samples(&hover_samples(3)[..160]).is_none());
    bench.expect_done(Command::CalSolve(None));
    let end = bench.run_solve();
    let refusal = bench.outcome_after_save(end).unwrap_err();
    assert!(refusal.to_string().contains("deg; the attitude tilts by 1.1 deg at most; tilt by 15"), "{refusal}");
    let mut bench = TestBed::with_accuracy(1.0);
    assert!(bench.collect_hover_samples(&hover_samples(3)[..164]).is_none());
    let prospect = bench.trial_result().unwrap();
    assert!(matches!(prospect.missing_manoeuvre, Some(Manoeuvre::Tilt(_, None))), "{prospect:?}");
    bench.expect_done(Command::CalSolve(None));
    let end = bench.run_solve();
    let refusal = bench.outcome_after_save(end).unwrap_err();
    assert_eq!(refusal.stable_code(), "not-accurate");
    assert!(refusal.to_string().contains("deg; missing: tilt "), "{refusal}");
    assert!(matches!(bench.request_reply(Command::CalAdvise), Ok(Reply::Advice(_))));
}

/// Trials begin at 40 fit samples; some of four samples per second are held back.
#[test]
fn trial_solves_are_ten_seconds_apart() {
    let mut bench = TestBed::with_accuracy(0.2);
    let mut began = Vec::new();
    for (number, sample) in hover_samples(4).into_iter().enumerate().take(200) {
        let sample = Sample { time: WrappingMillis::new(250 * number as u32), ..sample };
        bench.compass.process_event(Event::Sample(sample));
        if bench.compass.needs_solve_step() {
            began.push((
                number,
                bench.compass.collector.collection_progress().coverage_of(CollectionPart::FREE).fit_count,
            ));
            bench.solve_trial();
        }
    }
    assert_eq!(began[0].1, 40, "{began:?}");
    assert!(began.windows(2).all(|pair| pair[1].0 - pair[0].0 == 40), "{began:?}");
}

#[test]
fn a_vehicle_at_rest_causes_no_further_trial_solve() {
    let mut bench = TestBed::with_accuracy(0.2);
    let hover_samples = hover_samples(5);
    assert!(bench.collect_hover_samples(&hover_samples[..80]).is_none());
    let mut trials = 0;
    for _ in 0..600 {
        bench.now_ms = bench.now_ms.wrapping_add(250);
        let sample = Sample { time: bench.time(), ..hover_samples[79] };
        bench.compass.process_event(Event::Sample(sample));
        trials += u8::from(bench.compass.needs_solve_step());
        bench.solve_trial();
    }
    assert_eq!(trials, 1, "of what came since the last one");
    let before = bench.trial_result();
    assert_eq!(bench.trial_result(), before);
    assert!(bench.collect_hover_samples(&hover_samples[160..]).is_none());
    assert_ne!(bench.trial_result(), before);
}

/// At 10 samples/s and 20 deg/s: a vehicle that tilts by less than 10 deg is not calibrated in flight; with
/// more tilt it is, in less than a minute.
#[test]
fn a_vehicle_without_tilt_is_not_calibrated_in_flight() {
    let rover = |tilt_deg: f32, samples: u16| -> Vec<Sample> {
        let mut random = Random(6);
        (0..samples)
            .map(|i| {
                let t_s = f32::from(i) * 0.1;
                let attitude = Attitude::from_deg(tilt_deg * (t_s / 1.1).sin(), tilt_deg * (t_s / 1.7).cos());
                let rates = Rates::from_rad_s([0.0, 0.0, 0.35]);
                let field =
                    crate::synthetic::measured_sample(&airframe(), attitude, t_s * 0.35, 0.1, &mut random).field;
                Sample { rates, time: WrappingMillis::new(u32::from(i) * 100), ..Sample::new(field, attitude) }
            })
            .collect()
    };
    let ends_after = |tilt_deg: f32| {
        let mut bench = TestBed::with_accuracy(3.0);
        for (number, sample) in rover(tilt_deg, 1500).into_iter().enumerate() {
            bench.compass.process_event(Event::Sample(sample));
            while bench.compass.needs_solve_step() {
                if matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::Save) {
                    return Ok(number);
                }
            }
        }
        bench.expect_done(Command::CalSolve(None));
        let end = bench.run_solve();
        Err(bench.outcome_after_save(end).unwrap_err().stable_code())
    };
    assert!(ends_after(11.0).is_ok_and(|number| number < 600));
    assert_eq!(ends_after(9.0), Err("unobservable"));
}

/// Runs the first trial, with this many samples before its first step and one before each further step up to twenty.
fn collect_during_trial(samples_before_first_step: usize) -> TestBed {
    let mut bench = TestBed::with_accuracy(0.2);
    let mut samples =
        (0..).zip(hover_samples(9)).map(|(i, sample)| Sample { time: WrappingMillis::new(100 * i), ..sample });
    while !bench.compass.needs_solve_step() {
        bench.compass.process_event(Event::Sample(samples.next().unwrap()));
    }
    let stored = |bench: &TestBed| bench.compass.collector.stored_count();
    let before = stored(&bench);
    for (i, sample) in samples.take(samples_before_first_step.max(20)).enumerate() {
        if i >= samples_before_first_step {
            assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::None));
        }
        assert!(matches!(bench.compass.process_event(Event::Sample(sample)), Effect::None));
        assert_eq!(bench.compass.module_state(), ModuleState::Collecting);
    }
    bench.solve_trial();
    assert_eq!(usize::from(stored(&bench) - before), samples_before_first_step.max(20), "every one is stored");
    bench
}

/// The result does not depend on when samples arrive during a trial, whose own samples must not change.
#[test]
fn samples_during_a_trial_are_stored_after_it() {
    let fit = |bench: &TestBed| bench.compass.collector.fit_samples().all_samples().copied().collect::<Vec<Sample>>();
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
    let bench_in_trial = || {
        let mut bench = TestBed::with_accuracy(0.2);
        for (number, sample) in hover_samples(7).into_iter().enumerate() {
            bench
                .compass
                .process_event(Event::Sample(Sample { time: WrappingMillis::new(250 * number as u32), ..sample }));
            if bench.compass.needs_solve_step() {
                break;
            }
        }
        assert!(bench.compass.needs_solve_step());
        bench
    };
    let mut bench = bench_in_trial();
    assert_eq!(bench.status_report().module_state, ModuleState::Collecting);
    assert!(bench.compass.needs_solve_step(), "a look changes nothing");
    bench.save_by_command(Command::Set(SettingChange::StreamRateHz(5))).unwrap();
    assert!(bench.compass.needs_solve_step());
    assert_eq!(bench.expect_done(Command::CalStop), ModuleState::Uncalibrated);
    assert!(!bench.compass.needs_solve_step());
    let mut bench = bench_in_trial();
    assert_eq!(bench.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    assert_eq!(bench.expect_refusal(Command::CalStop), Refusal::Busy, "this one was asked for");
    let mut bench = bench_in_trial();
    bench.save_by_command(Command::Set(SettingChange::Inclination(Some(55.0)))).unwrap();
    assert_eq!((bench.compass.module_state(), bench.compass.needs_solve_step()), (ModuleState::Collecting, false));
    let mut bench = bench_in_trial();
    assert_eq!(bench.expect_done(Command::CalAbort), ModuleState::Uncalibrated);
    assert!(bench.trial_result().is_none() && !bench.compass.needs_solve_step());
    let mut bench = bench_in_trial();
    assert_eq!(bench.expect_done(Command::CalStartNew(None)), ModuleState::Collecting);
    assert!(!bench.compass.needs_solve_step() && bench.trial_result().is_none());
}

#[test]
fn a_trial_solve_reports_a_refusal_in_flight() {
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Mount(Orientation::from_name("yaw90").unwrap()))).unwrap();
    bench.expect_done(Command::CalStart(Procedure::Flight));
    assert!(bench.collect_hover_samples(&hover_samples(8)).is_none());
    let prospect = bench.trial_result().unwrap();
    let Some(Refusal::Solve(SolveError::MountContradicted { found })) = prospect.refusal else {
        panic!("{prospect:?}")
    };
    assert_eq!((found, prospect.expected_error_deg), (Orientation::IDENTITY_ROTATION, None));
    // The samples are usable with the corrected mounting.
    bench.save_by_command(Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION))).unwrap();
    bench.expect_done(Command::CalSolve(None));
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_ok());
}

#[test]
fn a_collection_ends_though_its_calibration_is_no_better() {
    let mut refused = 0;
    for seed in 0..8 {
        let mut bench = TestBed::with_accuracy(0.5);
        let (first, _) = bench.collect_hover_samples(&hover_samples(20 + seed)).unwrap();
        first.unwrap();
        bench.expect_done(Command::CalStart(Procedure::Flight));
        let Some((second, _)) = bench.collect_hover_samples(&hover_samples(40 + seed)) else {
            panic!("{seed}: it goes on")
        };
        refused += usize::from(second.is_err_and(|refusal| refusal.stable_code() == "not-better"));
    }
    assert!(refused >= 1, "{refused}");
}

impl TestBed {
    fn solve_trial(&mut self) {
        while self.compass.needs_solve_step() {
            assert!(matches!(self.compass.process_event(Event::AdvanceSolve), Effect::None));
        }
    }
}

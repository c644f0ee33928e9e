//! Unit tests of `trial_solves`.

use super::*;
use autoswing::acceptance::Rejection;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{
    AttitudeEnvelope, Calibration, Deviation, HeadingUncertainty, Method, Orientation, Quality, Sample,
    UnobservableQuantities,
};
use autoswing::collection::RetainedSamples;
use autoswing::frames::{Attitude, Field, Level};

/// Times of trials, seconds, and the number each represents: 10 samples/s in turns of 18 s, pitched by -15 deg from
/// 400 to 440 s, with the same readings in each turn. `result` has the result of the trial with this number.
fn trial_times_in_turns(result: impl Fn(usize) -> Option<Solution>) -> Vec<(f32, u8)> {
    let mut retained = RetainedSamples::EMPTY;
    let mut collector = Collector::new(&mut retained);
    collector.begin_procedure(Procedure::Flight);
    let mut trials = TrialSolves::NO_TRIALS;
    let mut due = Vec::new();
    for tenths in 0..6000_u16 {
        let t_s = f32::from(tenths) / 10.0;
        let pitch_deg = if (400.0..440.0).contains(&t_s) { -15.0 } else { 0.0 };
        let attitude = Attitude::from_deg(0.0, pitch_deg);
        let heading_rad = f32::from(tenths % 180).to_radians() * 2.0;
        let field = Field::new(attitude.to_body_frame(Field::<Level>::earth_field(50.0, 1.1, heading_rad)).ut);
        let time = WrappingMillis::new(u32::from(tenths) * 100);
        collector.push_sample(Sample { time, ..Sample::new(field, attitude) });
        if trials.start_trial_if_due(&collector, time) {
            due.push((t_s, trials.schedule.represented_trials));
            if let Some(solution) = result(due.len()) {
                trials.record_result(&solution, None, 1.0);
            }
        }
    }
    due
}

/// New samples cause a trial within 10 s.
#[test]
fn trial_solves_without_new_samples_run_once_a_minute() {
    let due = trial_times_in_turns(|_| None);
    // The buffer's 600 places fill in two minutes at 5 samples/s.
    let expected = [[1; 11].as_slice(), &[6, 6, 6, 6, 5, 1, 1, 1, 6, 6]].concat();
    let tens: Vec<u8> = due.windows(2).map(|pair| ((pair[1].0 - pair[0].0) / 10.0).round() as u8).collect();
    assert_eq!(tens, expected, "{due:?}");
    let represented_counts: Vec<u8> = due.iter().skip(1).map(|&(_, represented)| represented).collect();
    assert_eq!(represented_counts, expected, "{due:?}");
}

/// A trial that reaches the accuracy first causes the next one within 10 s.
#[test]
fn an_unconfirmed_accuracy_is_tried_again_without_new_samples() {
    let intervals_s = |result: Solution| {
        let due = trial_times_in_turns(|number| (number == 14).then_some(result));
        [due[14].0 - due[13].0, due[15].0 - due[14].0].map(|interval_s| (interval_s / 10.0).round() as u8)
    };
    assert_eq!(intervals_s(solution_with(0.9)), [1, 6]);
    assert_eq!(intervals_s(solution_with(1.1)), [6, 6], "not accurate");
}

fn trials_representing(represented: u8) -> TrialSolves {
    TrialSolves {
        schedule: TrialSchedule { represented_trials: represented, ..TrialSchedule::NO_TRIAL },
        ..TrialSolves::NO_TRIALS
    }
}

#[test]
fn six_trial_solves_without_improvement_are_stalled() {
    let mut trials = trials_representing(1);
    assert!(!trials.update_stalled(2.0));
    for _ in 0..5 {
        assert!(!trials.update_stalled(1.91));
    }
    assert!(trials.update_stalled(1.91) && trials.update_stalled(3.0) && trials.update_stalled(f32::NAN));
    assert!(!trials.update_stalled(1.89), "a twentieth less");
    for deg in [1.85, 1.81, 1.80, 1.86, 2.5] {
        assert!(!trials.update_stalled(deg));
    }
    assert!(trials.update_stalled(1.80), "all of them against 1.89");
}

#[test]
fn skipped_trial_solves_count_as_without_improvement() {
    for (represented, stalled) in [(5, [false, true]), (6, [true, true]), (2, [false, false])] {
        let mut trials = trials_representing(represented);
        assert!(!trials.update_stalled(2.0), "the first one");
        assert_eq!([2.0, 2.0].map(|deg| trials.update_stalled(deg)), stalled, "{represented}");
    }
}

#[test]
fn a_collection_ends_when_accurate_or_not_improvable() {
    let over = |expected_deg, missing, is_at_floor, refusal| {
        let prospect = TrialResult {
            expected_error_deg: expected_deg,
            missing_manoeuvre: missing,
            is_limited_by_attitude: is_at_floor,
            is_stalled: false,
            refusal,
        };
        let stalled = TrialResult { is_limited_by_attitude: false, is_stalled: is_at_floor, ..prospect.clone() };
        let is_accurate = prospect.reaches_accuracy(1.0);
        assert_eq!(prospect.ends_collection(is_accurate), stalled.ends_collection(is_accurate), "either is a reason");
        assert_eq!(
            prospect.ends_collection(false),
            is_at_floor && prospect.ends_collection(is_accurate),
            "good is not enough"
        );
        prospect.ends_collection(is_accurate)
    };
    let missing = Some(Manoeuvre::YawTurn);
    assert!(over(Some(0.99), missing, false, None) && over(Some(1.0), None, false, None));
    assert!(!over(Some(1.01), missing, false, None) && !over(Some(1.01), None, false, None));
    assert!(over(Some(1.4), None, true, None));
    assert!(!over(Some(1.4), missing, true, None), "something else would help");
    assert!(!over(None, None, false, None) && !over(Some(f32::NAN), None, false, None));
    let held_back = Refusal::Rejected(Rejection::TooFewHeldBack { have: 5, need: 8 });
    let not_better = Refusal::Rejected(Rejection::NotBetter { candidate_score: 1.1, incumbent_score: 1.0 });
    assert!(!over(Some(0.5), None, true, Some(held_back)), "more samples come");
    assert!(over(Some(0.5), None, false, Some(not_better.clone())), "more would not change it");
    assert!(!over(Some(1.4), None, false, Some(not_better)));
}

fn solution_with(expected_rms_deg: f32) -> Solution {
    let quality = Quality {
        method: Method::MaximumLikelihood,
        envelope: AttitudeEnvelope::Banked,
        expected_rms_deg,
        expected_worst_deg: expected_rms_deg,
        norm_residual: 0.0,
        inclination_residual_deg: 0.0,
        samples: 100,
        latency: None,
        knows_inclination: true,
    };
    Solution {
        calibration: Calibration::uncalibrated(Orientation::IDENTITY_ROTATION),
        quality,
        uncertainty: HeadingUncertainty::NO_UNCERTAINTY,
        advice: None,
        hard_iron_change: None,
        bank_scale_error: None,
    }
}

#[test]
fn the_accuracy_must_be_reached_twice_in_a_row() {
    for (trials_deg, ends) in [
        (&[0.9, 0.9][..], &[false, true][..]),
        (&[1.1, 0.9, 0.9], &[false, false, true]),
        (&[0.9, 1.1, 0.9, 0.9], &[false, false, false, true]),
    ] {
        let mut trials = TrialSolves::NO_TRIALS;
        let ended: Vec<bool> =
            trials_deg.iter().map(|&deg| trials.record_result(&solution_with(deg), None, 1.0)).collect();
        assert_eq!(ended, ends, "{trials_deg:?}");
    }
}

/// Whether each of a series of trials, ten seconds apart, ends the collection; with expected errors at their floor or
/// far from it.
fn ends_of_trials(trials_deg: &[f32], is_at_floor: bool) -> Vec<bool> {
    let mut trials = trials_representing(1);
    let solution = |deg| {
        let advice = Advice {
            weakest_deviation: Deviation::Heeling,
            weakest_deviation_deg: deg,
            expected_deg: deg,
            manoeuvre: Manoeuvre::Level,
            expected_after_deg: deg,
            error_floor_deg: if is_at_floor { deg } else { 0.5 * deg },
            unobservable: UnobservableQuantities::default(),
        };
        Solution { advice: Some(advice), ..solution_with(deg) }
    };
    trials_deg.iter().map(|&deg| trials.record_result(&solution(deg), None, 0.5)).collect()
}

/// Whether the last of a series of trials ends the collection, and none before it.
fn ends_at_last(trials_deg: &[f32], is_at_floor: bool) -> bool {
    let ends = ends_of_trials(trials_deg, is_at_floor);
    ends.iter().position(|is_end| *is_end) == Some(trials_deg.len() - 1)
}

/// The expected error is then settled, and as small as that of the best trial.
#[test]
fn attitude_limits_a_collection_only_as_confirmed_by_the_best_trial() {
    for trials_deg in [&[5.4, 1.8, 1.8, 1.8][..], &[1.3, 2.9, 2.9, 2.9, 1.36, 1.33, 1.33], &[2.0, 2.15, 2.05]] {
        assert!(ends_at_last(trials_deg, true), "{trials_deg:?}");
    }
    assert!(!ends_of_trials(&[5.4], true).contains(&true));
}

/// Trials of recorded flights: the best one was an early fluke, and the expected error was still falling, or rose.
#[test]
fn a_collection_does_not_end_while_the_expected_error_changes() {
    let falling = [1.71, 2.31, 5.33, 4.40, 3.36, 2.08, 1.95, 1.15];
    assert!(!ends_of_trials(&falling, false).contains(&true));
    let rising = [0.96, 0.96, 1.07, 1.07, 1.06, 1.06, 1.27, 2.08, 1.97, 2.07];
    assert!(ends_at_last(&rising, false));
    assert!(ends_at_last(&rising[..6].iter().chain(&[1.06]).copied().collect::<Vec<_>>(), false), "settled");
}

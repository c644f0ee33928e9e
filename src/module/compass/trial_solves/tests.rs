//! Unit tests of `trial_solves`.

use super::*;
use crate::store::CalibrationRecord;
use crate::store::tests::calibration_record;
use autoswing::acceptance::Rejection;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Deviation, Quality, Sample, UnobservableQuantities};
use autoswing::collection::RetainedSamples;
use autoswing::frames::{Field, Level, RollPitch};

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
        let attitude = RollPitch::from_deg(0.0, pitch_deg);
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

/// A limit by the attitude and a stall are equal reasons; a good trial alone is not enough.
#[test]
fn a_collection_ends_when_accurate_or_not_improvable() {
    let missing = Some(Manoeuvre::YawTurn);
    let held_back = Refusal::Rejected(Rejection::TooFewHeldBack { have: 5, need: 8 });
    let not_better = Refusal::Rejected(Rejection::NotBetter { candidate_score: 1.1, incumbent_score: 1.0 });
    for (name, expected_error_deg, missing_manoeuvre, is_not_improvable, refusal, is_over) in [
        ("accurate", Some(1.0), missing, false, None, true),
        ("not accurate", Some(1.01), None, false, None, false),
        ("not improvable", Some(1.4), None, true, None, true),
        ("a manoeuvre would help", Some(1.4), missing, true, None, false),
        ("failed", None, None, false, None, false),
        ("no number", Some(f32::NAN), None, false, None, false),
        ("more samples come", Some(0.5), None, true, Some(held_back), false),
        ("more samples would not change it", Some(0.5), None, false, Some(not_better.clone()), true),
        ("neither accurate nor better", Some(1.4), None, false, Some(not_better), false),
    ] {
        for is_stalled in [false, true] {
            let result = TrialResult {
                expected_error_deg,
                missing_manoeuvre,
                is_limited_by_attitude: is_not_improvable && !is_stalled,
                is_stalled: is_not_improvable && is_stalled,
                refusal: refusal.clone(),
            };
            assert_eq!(result.ends_collection(result.reaches_accuracy(1.0)), is_over, "{name}");
            assert_eq!(result.ends_collection(false), is_over && is_not_improvable, "{name}");
        }
    }
}

fn solution_with(expected_rms_deg: f32) -> Solution {
    let CalibrationRecord { calibration, quality, uncertainty, .. } = calibration_record(1);
    let quality = Quality { expected_rms_deg, ..quality };
    Solution { calibration, quality, uncertainty, advice: None, hard_iron_change: None, bank_scale_error: None }
}

/// Number of the trial that ends the collection; each trial represents this number of trials, ten seconds apart, and its
/// expected error is at its floor or far from it. No manoeuvre is worthwhile, and the accuracy is not reached.
fn end_of_trials(trials_deg: &[f32], represented_trials: u8, is_at_floor: bool) -> Option<usize> {
    let schedule = TrialSchedule { represented_trials, ..TrialSchedule::NO_TRIAL };
    let mut trials = TrialSolves { schedule, ..TrialSolves::NO_TRIALS };
    trials_deg.iter().position(|&deg| {
        let advice = Advice {
            weakest_deviation: Deviation::Heeling,
            weakest_deviation_deg: deg,
            expected_deg: deg,
            manoeuvre: Manoeuvre::Level,
            expected_after_deg: deg,
            error_floor_deg: if is_at_floor { deg } else { 0.5 * deg },
            unobservable: UnobservableQuantities::default(),
        };
        trials.record_result(&Solution { advice: Some(advice), ..solution_with(deg) }, None, 0.5)
    })
}

/// Skipped trials count; the expected error must be settled. Two series are of recorded flights: the best trial was an
/// early fluke, and the expected error was still falling, or rose.
#[test]
fn a_minute_without_improvement_ends_a_collection() {
    let falling = [1.71, 2.31, 5.33, 4.40, 3.36, 2.08, 1.95, 1.15];
    let rising = [0.96, 0.96, 1.07, 1.07, 1.06, 1.06, 1.27, 2.08, 1.97, 2.07];
    let rising_then_settled = [0.96, 0.96, 1.07, 1.07, 1.06, 1.06, 1.06];
    for (name, represented_trials, trials_deg, end) in [
        ("constant", 1, &[2.0; 7][..], Some(6)),
        ("2 % better", 1, &[2.0, 1.96, 1.96, 1.96, 1.96, 1.96, 1.96], Some(6)),
        ("8 % better each half minute", 1, &[2.0, 2.0, 2.0, 1.84, 1.84, 1.84, 1.69, 1.69, 1.69], None),
        ("each for a minute", 6, &[2.0; 2], Some(1)),
        ("each for 50 s", 5, &[2.0; 3], Some(2)),
        ("each for 20 s", 2, &[2.0; 3], None),
        ("the first is no number", 1, &[f32::NAN, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0], None),
        ("falling", 1, &falling, None),
        ("rising", 1, &rising, Some(9)),
        ("settled", 1, &rising_then_settled, Some(6)),
    ] {
        assert_eq!(end_of_trials(trials_deg, represented_trials, false), end, "{name}");
    }
}

/// The expected error is then settled, and as small as that of the best trial.
#[test]
fn attitude_limits_a_collection_only_as_confirmed_by_the_best_trial() {
    for trials_deg in [&[5.4, 1.8, 1.8, 1.8][..], &[1.3, 2.9, 2.9, 2.9, 1.36, 1.33, 1.33], &[2.0, 2.15, 2.05]] {
        assert_eq!(end_of_trials(trials_deg, 1, true), Some(trials_deg.len() - 1), "{trials_deg:?}");
    }
    assert_eq!(end_of_trials(&[5.4], 1, true), None);
}

use super::*;
use crate::replay::evaluation::CorrectionSource;

/// Turns with a motor current of 10 to 30 A that interferes by 0.36 uT/A, and a second compass like the first.
fn flight_with_current() -> LoggedFlight {
    let mut recording = record_turns(0.0);
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.current_a = 20.0 + 10.0 * libm::sin(i as f64 / 70.0);
        sample.field_ut[0][0] += 0.3 * sample.current_a;
        sample.field_ut[0][1] -= 0.2 * sample.current_a;
        sample.field_ut = vec![sample.field_ut[0]; 2];
    }
    log::read_flight(&mut encode_dataflash(&recording).as_slice(), FieldUnit::Milligauss).unwrap()
}

#[test]
fn a_chosen_compass_is_evaluated_in_the_time_window() {
    let options = EvaluationOptions {
        compared_module: Some(RowSelection::All),
        compass_number: Some(2),
        time_window_s: [20.0, 220.0],
        field_latency_s: Some(0.0),
        ..EvaluationOptions::DEFAULT
    };
    let evaluation = evaluate_flight(&flight_with_current(), &options);
    let [compass] = &evaluation.compasses[..] else { panic!("{} compasses", evaluation.compasses.len()) };
    assert_eq!(compass.compass_number, 2);
    let (used, unused): (Vec<&ReplayRow>, Vec<&ReplayRow>) = compass.rows.iter().partition(|row| row.is_usable);
    assert!(used.iter().all(|row| (20.0..=220.0).contains(&row.t_s)));
    assert!(unused.iter().all(|row| !(20.0..=220.0).contains(&row.t_s)));
    assert_eq!((compass.row_counts.used, compass.row_counts.excluded), (used.len(), unused.len()));
    // 200 s at 10 Hz; the record lasts from 2 s to 240 s.
    assert!(used.len().abs_diff(2000) <= 2 && unused.len().abs_diff(380) <= 3, "{:?}", compass.row_counts);
}

/// Hard iron of 9.6 uT and 6 uT forward and 4 uT to the left by the mean current bend headings by 21 deg RMS at 31 uT
/// horizontal; the variation of the current by 2.5 uT RMS bends them by 3 deg.
#[test]
fn corrections_are_scored_against_the_reference() {
    let options = EvaluationOptions {
        compared_module: Some(RowSelection::All),
        compass_number: Some(1),
        field_latency_s: Some(0.0),
        ..EvaluationOptions::DEFAULT
    };
    let evaluation = evaluate_flight(&flight_with_current(), &options);
    let compass = &evaluation.compasses[0];
    let rms_deg = |source| compass.score_by(source).unwrap().rms_deg;
    assert!(
        (19.0..23.0).contains(&rms_deg(CorrectionSource::Uncorrected)),
        "{}",
        rms_deg(CorrectionSource::Uncorrected)
    );
    // Noise of the attitude and of the field.
    assert!(rms_deg(CorrectionSource::Module) < 1.0, "{}", rms_deg(CorrectionSource::Module));
    assert!(rms_deg(CorrectionSource::Sphere) > rms_deg(CorrectionSource::Module));
}
